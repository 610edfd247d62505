"""Measure the characteristics of a scan: an edge, a groove, a margin or a tip.

Each characteristic has its uncertainty budget.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    average_profiles,
)
from stepblocks.inspect.margin_gap import fit_margin
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Mask, estimate_robust_scale
from stepblocks.inspect.tip import fit_cap
from stepblocks.scans.scan import HeightMap, ScannedProfile, list_profiles

Window = tuple[float, float, str]  # begin, end [m] and name
S = TypeVar("S")
T = TypeVar("T")

_NARROWER = 0.7  # of the cap of a tip, over which its radius is fitted again [1]
LEAST_SHARE = 0.5  # of the profiles of a map that must agree on what they cross [1]
_UNLIKE = 1.25  # ratio of the largest to the smallest feature from which no mean is taken [1]
_MOST_PROFILES = 60  # of a map that are evaluated; of more, as many are taken evenly over the map


@dataclass(frozen=True)
class Shown:
    """What a plot shows of a scan.

    It is one profile, levelled on its lower or outer face, and the map that it belongs to.

    Attributes
    ----------
    position, height : array, shape (n,)
        m.
    windows : tuple of (float, float, str)
        The stretches that were evaluated [m], with their names.
    fitted : array or None
        What was fitted to the profile [m].
    dropped : array of bool or None
        Points left out as spikes.
    """

    position: Array
    height: Array
    windows: tuple[Window, ...] = ()
    fitted: Array | None = None
    dropped: Mask | None = None


@dataclass(frozen=True)
class EvaluationOptions:
    """How a scan is to be evaluated; what is not given follows the data.

    Attributes
    ----------
    exclusion : float or None
        Half width kept out at every edge [m]; by default where the flank is.
    degree : int or None
        Of the polynomial that a profile is levelled by, 1 to 3; by default as the data carry.
    begin, end : float or None
        Part of each profile that is looked at [m]; by default all of it.
    edges : tuple of int or None
        Which features, counted from 1; by default all.
    along : {"x", "y"} or None
        Direction of the profiles of a map; by default whichever shows features.
    area : tuple of float or None
        Rectangle of a map that is looked at, from and to along x, from and to along y [m].
        Positions count from its corner; by default the whole map.
    stylus_radius : float or None
        Radius of the stylus [m], 0 of an optical instrument. Where it is not stated, a radius of an
        edge is an upper bound.
    stylus_cone : float or None
        Full angle of the stylus [rad], 0 of an optical instrument. Where it is not stated, 60 and
        90 deg are taken as possible (ISO 3274).
    """

    exclusion: float | None = None
    degree: int | None = None
    begin: float | None = None
    end: float | None = None
    edges: tuple[int, ...] | None = None
    along: Literal["x", "y"] | None = None
    area: tuple[float, ...] | None = None
    stylus_radius: float | None = None
    stylus_cone: float | None = None


AS_FOUND = EvaluationOptions()


@dataclass(frozen=True)
class Evaluation:
    """What a scan says.

    Attributes
    ----------
    values : dict of Measured
        By key of the characteristic.
    convention : str
        How the values are defined.
    notes : tuple of str
        What was left out or cut.
    shown : Shown or None
        What a plot shows; None of what another program measured.
    arc : bool
        Whether the edge is an arc, of which its radius then says all.
    missing : dict of str
        Why a characteristic was not measured, by its key.
    covered : dict of tuple of float
        How far a face was scanned across and along the edge [m], by key of the form characteristic.
    surface : ScannedProfile or None
        The edge between level faces, where it is no arc and was seen.
    faces : tuple of ScannedProfile
        Profiles of the faces, levelled, for their roughness.
    """

    values: dict[str, Measured]
    convention: str
    notes: tuple[str, ...]
    shown: Shown | None = None
    arc: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)
    covered: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    surface: ScannedProfile | None = None
    faces: tuple[ScannedProfile, ...] = ()


def sample_profiles(
    scan: ScannedProfile | HeightMap, options: EvaluationOptions = AS_FOUND
) -> tuple[list[ScannedProfile], list[str]]:
    """Return the profiles of a scan that are evaluated, cropped and in equal steps.

    Notes say what was left out or resampled.
    """
    rows = list_profiles(scan)
    notes = []
    if len(rows) > _MOST_PROFILES:
        chosen = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROFILES).round().astype(int))
        notes = [f"{len(chosen)} of {len(rows)} profiles evaluated"]
        rows = [rows[index] for index in chosen]
    x = rows[0].position
    begin, end = (
        x[0] if options.begin is None else options.begin,
        x[-1] if options.end is None else options.end,
    )
    inside = (x >= begin) & (x <= end)
    measured = [row for row in rows if np.isfinite(row.height[inside]).any()]
    MetrologyError.require(
        inside.sum() >= 3 and measured,
        f"part from {begin * 1e6:g} to {end * 1e6:g} um must hold 3 points, got {inside.sum()}",
    )
    x = x[inside]
    heights = [row.height[inside] for row in measured]
    step = float(np.median(np.diff(x)))
    if np.ptp(np.diff(x)) > 0.01 * np.diff(x).mean():
        even = np.arange(x[0], x[-1], step)
        # across a gap of several steps nothing is known
        far = np.abs(even - x[np.searchsorted(x, even).clip(0, len(x) - 1)]) > 3.0 * step
        heights = [np.where(far, np.nan, np.interp(even, x, z)) for z in heights]
        x = even
        notes.append(
            f"positions set to equal steps of {step * 1e6:.4g} um, between which heights are "
            "interpolated"
        )
    rows = [replace(row, position=x, height=z) for z, row in zip(heights, measured, strict=True)]
    return rows, notes


def keep_profiles_that_agree(
    found: list[tuple[ScannedProfile, T]],
    crossed: Array,
    rows: list[ScannedProfile],
    refused: list[str],
    notes: list[str],
) -> list[tuple[ScannedProfile, T]]:
    """Return the profiles that agree on what they cross.

    Refused, with the share, where they are less than half of those asked.
    """
    # `crossed`, shape (3, profiles, features), are height, place and slack of place of each feature
    # [m]. They must lie where the others have them, a slant over the map allowed, and be as high.
    heights, places, slack = crossed
    alike = np.ones(len(found), dtype=bool)
    if len(found) > 2:
        lag = len(found) // 2
        middle = np.median(heights, axis=0)
        slant = np.median((places[lag:] - places[:-lag]) / lag, axis=0)
        off = places - slant * np.arange(len(found))[:, np.newaxis]
        off -= np.median(off, axis=0)
        scatter = np.array([estimate_robust_scale(column) for column in off.T])
        alike = np.all(np.abs(off) <= np.maximum(slack, 8.0 * scatter + LEAST_SCATTER), axis=1)
        alike &= np.all(np.abs(heights - middle) <= 0.5 * np.abs(middle), axis=1)
    kept = [one for one, same in zip(found, alike, strict=True) if same]
    asked = len(rows)
    reason = f"since {refused[0]}" if refused else "since it crosses others"
    if not kept or len(kept) < LEAST_SHARE * asked:
        if asked == 1:
            raise MetrologyError(refused[0])
        raise MetrologyError(
            "profiles must agree on the features that they cross, got "
            f"{len(found) - len(kept) + len(refused)} of {asked} that do not "
            f"({1.0 - LEAST_SHARE:.0%} allowed), the first {reason}"
        )
    showing = {id(row) for row, _ in kept}
    places = [number for number, row in enumerate(rows) if id(row) in showing]
    if (between := places[-1] - places[0] + 1) > len(kept):
        notes.append(f"{between - len(kept)} of {between} profiles refused, the first {reason}")
    if between < asked:  # a feature may end within a map
        notes.append(
            f"{asked - between} of {asked} profiles lie beyond those that show it, the first "
            f"{reason}"
        )
    return kept


def list_directions(
    scan: ScannedProfile | HeightMap, along: Literal["x", "y"] | None
) -> Sequence[ScannedProfile | HeightMap]:
    """Return a scan so that its profiles run along x, along y, or either where none is asked."""
    if isinstance(scan, ScannedProfile):
        return [scan]
    turned = replace(scan, height=np.ascontiguousarray(scan.height.T), dx=scan.dy, dy=scan.dx)
    return {"x": [scan], "y": [turned], None: [scan, turned]}[along]


def evaluate_each(
    evaluate: Callable[[S], T], items: Iterable[S], most_refused: float = np.inf
) -> tuple[list[tuple[S, T]], list[str]]:
    """Return what can be evaluated with its result, and why the others were refused.

    Once more than `most_refused` were, the rest is left alone.
    """
    results, refused = list[tuple[S, T]](), list[str]()
    for one in itertools.takewhile(lambda _: len(refused) <= most_refused, items):
        try:
            results.append((one, evaluate(one)))
        except MetrologyError as error:
            refused.append(str(error))
    return results, refused


def list_features(
    key: str, each: Sequence[Measured], average: Callable[[], Measured], notes: list[str]
) -> dict[str, Measured]:
    """Return features by their numbers, with their mean where they are alike; one by its key."""
    if len(each) == 1:
        return {key: each[0]}
    values = {f"{key}_{number}": one for number, one in enumerate(each, 1)}
    depths = [one.value for one in each]
    if max(depths) <= _UNLIKE * min(depths):
        return {key: average(), **values}
    listed = ", ".join(f"{one * 1e6:.4g}" for one in depths)
    notes.append(f"{len(each)} unlike features of {listed} um, in this order; no mean is taken")
    return values


def measure_margin(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions = AS_FOUND
) -> Evaluation:
    """Measure opening and rise of a margin, and the absolute discrepancy."""
    rows, notes = sample_profiles(scan, options)
    found, refused = evaluate_each(lambda row: fit_margin(row.position, row.height), rows)
    openings = np.array([[one.opening.value] for _, one in found]).reshape(-1, 1)
    results = keep_profiles_that_agree(
        found, np.stack([openings, 0.0 * openings, 0.0 * openings]), rows, refused, notes
    )
    ones = [one for _, one in results]
    share = float(np.mean([one.opening.value / one.absolute.value for one in ones]))
    sampling = float(np.mean([one.sampling for one in ones]))
    sizes = {  # of each its share in what lies between samples, and the axes that it answers to
        "vertical_discrepancy": ([one.opening for one in ones], 1.0, (0.0, 1.0)),
        "horizontal_discrepancy": ([one.rise for one in ones], 0.0, (1.0, 0.0)),
        "absolute_discrepancy": ([one.absolute for one in ones], share, (1.0 - share**2, share**2)),
    }
    values = {}
    origin = "one interval at either edge, rectangular; the same in every profile"
    for key, (each, part, axes) in sizes.items():
        others = [Component("sampling", part * sampling, how=origin)] if part > 0.0 else []
        values[key] = average_profiles(key.replace("_", " "), each, instrument, others, axes)
    first = results[0][0]
    return Evaluation(
        values,
        "shoulders by two planes with a common slope; edges at half the depth of the gap",
        tuple(notes),
        Shown(first.position, first.height - np.nanmedian(first.height[: len(first.height) // 4])),
    )


def measure_tip(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions = AS_FOUND,
    nominal: float = 0.0,
) -> Evaluation:
    """Radius of a probe tip of about `nominal` [m].

    The scan is a height map that looks along the axis of the tip, or a profile over it.
    """
    notes: list[str] = []
    if isinstance(scan, ScannedProfile):
        (scan,), notes = sample_profiles(scan, options)
    cap = fit_cap(scan, nominal)
    radius = cap.radius
    # of what the points cover, as a part of the radius
    reach = float(np.sin(cap.cap_angle))
    narrower = evaluate_each(lambda part: fit_cap(scan, nominal, part), [_NARROWER * reach])[0]
    change = max((abs(one.radius.value - radius.value) for _, one in narrower), default=0.0)
    form = Component(
        "form",
        # a cap of 0.7 of the angle knows its radius by a quarter as well
        float(np.sqrt(max(change**2 - (3.0 * radius.std) ** 2, 0.0) / 3.0)),
        how="change over a cap of seven tenths of it, less its noise, rectangular",
    )
    if options.stylus_radius:
        radius = replace(radius, value=radius.value - options.stylus_radius)
        notes.append(f"the stylus radius of {options.stylus_radius * 1e6:.4g} um is taken off")
    # of a cap, height h over width a, R is a^2 / 2h: twice the lateral error, once the vertical
    value = average_profiles("ball radius", [radius], instrument, [form], axes=(1.0, 2.0))
    notes.append(
        f"form of the ball {cap.form * 1e6:.3g} um, with noise, over "
        f"{np.degrees(cap.cap_angle):.3g} deg"
    )
    if cap.rejected:
        notes.append(f"{cap.rejected} of {cap.points} points left out as spikes")
    through = (
        "circle through the cap of the profile"
        if isinstance(scan, ScannedProfile)
        else "sphere through the cap"
    )
    x, z, fitted = cap.drawn
    low = float(np.nanmin(z))
    return Evaluation(
        {"ball_radius": value},
        f"least-squares {through}, in heights",
        tuple(notes),
        Shown(x, z - low, (), fitted - low),
    )
