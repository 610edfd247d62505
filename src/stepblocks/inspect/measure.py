"""A scan in, measured characteristics out, each with its budget: the evaluation of an edge, a groove, a margin, a tip."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile, list_profiles
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    add_instrument_components,
    average_profiles,
)
from stepblocks.inspect.edge import Edge, fit_edge, fit_step
from stepblocks.inspect.edge_arc import compute_edge_profile
from stepblocks.inspect.form import (
    FaceForm,
    compute_flatness,
    compute_parallelism,
    estimate_zone,
    fit_face,
)
from stepblocks.inspect.margin_gap import fit_margin
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Estimate, Mask, estimate_robust_scale
from stepblocks.inspect.tip import fit_cap

Window = tuple[float, float, str]  # begin, end [m] and name
S = TypeVar("S")
T = TypeVar("T")

_NARROWER = 0.7  # of the cap of a tip, over which its radius is fitted again [1]
_MOST_ACROSS = 300  # points of a map along either side through which the form of a face is fitted
_LEAST_SHARE = 0.5  # of the profiles of a map that must agree on what they cross [1]
_MOST_PROFILES = 60  # of a map that are evaluated; of more, as many are taken evenly over the map


@dataclass(frozen=True)
class ShownMap:
    """What a plot shows of a map; arrays of shape (ny, nx)."""

    height: Array  # levelled [m]
    residual: Array  # what the evaluation leaves, nan where a point took no part [m]
    outlines: tuple[tuple[str, Mask], ...]  # name of a part that was evaluated, and its mask
    size: tuple[float, float]  # along x and y [m]


@dataclass(frozen=True)
class Shown:
    """What a plot shows: one profile, levelled on its lower or outer face, and the map that it is of."""

    position: Array  # m
    height: Array  # m
    windows: tuple[Window, ...] = ()  # the stretches that were evaluated
    fitted: Array | None = None  # what was fitted to it [m]
    dropped: Mask | None = None  # points left out as spikes
    map: ShownMap | None = None


@dataclass(frozen=True)
class EvaluationOptions:
    """How a scan is to be evaluated; what is not said follows the data."""

    exclusion: float | None = None  # half width kept out at every edge [m]; where the flank is
    degree: int | None = (
        None  # of the polynomial that a profile is levelled by, 1 to 3; as the data carry
    )
    begin: float | None = None  # of the part of each profile that is looked at [m]; all of it
    end: float | None = None  # likewise [m]
    edges: tuple[int, ...] | None = None  # which features, counted from 1; all
    along: Literal["x", "y"] | None = (
        None  # direction of the profiles of a map; whichever shows features
    )
    stylus_radius: float = 0.0  # m
    stylus_cone: float = 0.0  # full angle of the stylus [rad]


AS_FOUND = EvaluationOptions()


@dataclass(frozen=True)
class Evaluation:
    """What a scan says."""

    values: dict[str, Measured]  # by key of the characteristic
    convention: str  # how the values are defined
    notes: tuple[str, ...]  # what was left out or cut
    shown: Shown | None = None  # none of what another program measured
    arc: bool = True  # whether the edge is an arc, which its radius then says all of


def measure_edge(
    scan: Profile | HeightMap, instrument: Instrument, how: EvaluationOptions = AS_FOUND
) -> Evaluation:
    """Height and edge radius of a step; of a map also flatness and parallelism of the faces."""
    rows, notes = sample_profiles(scan, how)
    found, refused = evaluate_each(
        lambda row: fit_edge(row.position, row.height, how.exclusion), rows
    )
    crossed = np.array(
        [(one.height.value, one.position, one.exclusion) for _, one in found]
    ).reshape(-1, 3, 1)
    results = keep_agreeing(found, crossed.swapaxes(0, 1), rows, refused, notes)
    edges = [edge for _, edge in results]
    form = Component(
        "form", _estimate_form(results), how="change with twice the exclusion, rectangular"
    )
    height = average_profiles("step height", [one.height for one in edges], instrument, [form])
    flanks = [one.flank for one in edges if one.flank is not None]
    sloped = 2 * len(flanks) > len(edges)
    corners = [one.radius for one in edges if (one.flank is not None) == sloped]
    # what lies between two samples of a sharp edge is the same in every profile, and does not
    # average
    sharp = np.mean([one.value for one in corners]) < 3.0 * rows[0].spacing
    unresolved = rows[0].spacing / np.sqrt(12.0) if sharp else 0.0
    corners = [
        # a stylus rounds a corner by its own radius
        Estimate(
            one.value - how.stylus_radius,
            float(np.sqrt(max(one.std**2 - unresolved**2, 0.0))),
            one.dof,
        )
        for one in corners
    ]
    sampling = (
        [Component("sampling", unresolved, how="one interval, rectangular")]
        if unresolved > 0.0
        else []
    )
    radius = average_profiles("edge radius", corners, instrument, sampling, axes=(1.0, 1.0))
    if how.stylus_radius > 0.0:
        notes.append(
            f"the stylus radius of {how.stylus_radius * 1e6:.3g} um is taken off the edge radius"
        )
    if sloped:
        angle, off = (
            np.mean([one.angle for one in flanks]),
            np.mean([one.angle_std for one in flanks]),
        )
        slope = f"{np.degrees(angle):.1f} +-{np.degrees(2.0 * off):.1f} deg"
        said = f"the edge is no arc: its flank slopes by {slope}, its radius is that of the corner"
        if (
            how.stylus_cone > 0.0
            and angle > 0.5 * np.pi - 0.5 * how.stylus_cone - 2.0 * off - np.radians(1.0)
        ):
            said += ", and the flank may be steeper: it is as steep as the cone of the stylus"
        notes.append(said)
    values = {"step_height": height, "edge_radius": radius}
    first, edge = results[0]
    drawn = None
    if isinstance(scan, HeightMap):
        faces, drawn = _measure_faces(scan, edge, instrument, notes)
        values |= faces
    if rejected := sum(one.rejected for one in edges):
        notes.append(f"{rejected} points missing or left out as spikes")
    if any(one.radius.value < 3.0 * first.spacing for one in edges):
        limit = max(one.radius_limit for one in edges)
        notes.append(
            f"edge sharper than the sampling resolves; radius below {limit * 1e6:.2g} um at 95 %"
        )
    convention = (
        f"two planes with a common slope, {edge.exclusion * 1e6:.4g} um excluded on either side "
        "of the edge; radius by arc"
    )
    if sloped:
        convention = f"{convention} of the corner beside its flank"
    x, before, behind = (
        first.position,
        edge.position - edge.exclusion,
        edge.position + edge.exclusion,
    )
    windows = (float(x[0]), before, "face"), (behind, float(x[-1]), "face")
    level = first.height - edge.tilt * x
    lower = (x < before) if edge.rising else (x > behind)
    sign, corner = (1.0 if edge.rising else -1.0), 0.0 if sloped else max(edge.radius.value, 0.0)
    fitted = compute_edge_profile(sign * x, sign * edge.position, edge.height.value, corner)
    shown = Shown(x, level - np.nanmedian(level[lower]), windows, fitted, edge.dropped, drawn)
    return Evaluation(values, convention, tuple(notes), shown, arc=not sloped)


def sample_profiles(
    scan: Profile | HeightMap, how: EvaluationOptions = AS_FOUND
) -> tuple[list[Profile], list[str]]:
    """Return the profiles of a scan that are evaluated, cropped and in equal steps, and notes on what that took."""
    rows, notes = list_profiles(scan), []
    if len(rows) > _MOST_PROFILES:
        chosen = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROFILES).round().astype(int))
        notes = [f"{len(chosen)} of {len(rows)} profiles evaluated"]
        rows = [rows[index] for index in chosen]
    x = rows[0].position
    begin, end = x[0] if how.begin is None else how.begin, x[-1] if how.end is None else how.end
    inside = (x >= begin) & (x <= end)
    measured = [row for row in rows if np.isfinite(row.height[inside]).any()]
    if inside.sum() < 3 or not measured:
        raise MetrologyError(
            f"part from {begin * 1e6:g} to {end * 1e6:g} um must hold 3 points, got {inside.sum()}"
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
    return [Profile(x, z, row.source) for z, row in zip(heights, measured, strict=True)], notes


def keep_agreeing(
    found: list[tuple[Profile, T]],
    crossed: Array,
    rows: list[Profile],
    refused: list[str],
    notes: list[str],
) -> list[tuple[Profile, T]]:
    """Return the profiles that agree on what they cross; refused, with the share, where they are less than half of those asked."""
    # `crossed`, shape (3, profiles, features), are height, place and slack of place of each feature
    # [m]. They must lie where the others have them, a slant over the map allowed, and be as high.
    heights, places, slack = crossed
    alike = np.ones(len(found), dtype=bool)
    if len(found) > 2:
        lag, middle = len(found) // 2, np.median(heights, axis=0)
        slant = np.median((places[lag:] - places[:-lag]) / lag, axis=0)
        off = places - slant * np.arange(len(found))[:, np.newaxis]
        off -= np.median(off, axis=0)
        scatter = np.array([estimate_robust_scale(column) for column in off.T])
        alike = np.all(np.abs(off) <= np.maximum(slack, 8.0 * scatter + LEAST_SCATTER), axis=1)
        alike &= np.all(np.abs(heights - middle) <= 0.5 * np.abs(middle), axis=1)
    kept = [one for one, same in zip(found, alike, strict=True) if same]
    asked, reason = len(rows), f"since {refused[0]}" if refused else "since it crosses others"
    if not kept or len(kept) < _LEAST_SHARE * asked:
        if asked == 1:
            raise MetrologyError(refused[0])
        got = f"{len(kept)} of {asked} ({_LEAST_SHARE:.0%} needed), the first other {reason}"
        raise MetrologyError(f"profiles must agree on the features that they cross, got {got}")
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


def evaluate_each(
    evaluate: Callable[[S], T], asked: Iterable[S]
) -> tuple[list[tuple[S, T]], list[str]]:
    """Return what can be evaluated with its result, and why the others were refused."""
    results, refused = [], []
    for one in asked:
        try:
            results.append((one, evaluate(one)))
        except MetrologyError as error:
            refused.append(str(error))
    return results, refused


def _estimate_form(results: list[tuple[Profile, Edge]]) -> float:
    """Change of the mean height when twice as much is excluded, beyond what noise alone changes, as a rectangle."""
    some = results[:: max(len(results) // 10, 1)]
    wider = evaluate_each(
        lambda one: fit_step(one[0].position, one[0].height, 2.0 * one[1].exclusion), some
    )[0]
    pairs = [(edge.height, wide) for (_, edge), wide in wider]
    if not pairs:
        return 0.0
    # a fit through fewer of the same points differs by what its variance has grown
    noise = np.mean([max(wide.std**2 - edge.std**2, 0.0) for edge, wide in pairs]) / len(pairs)
    beyond = float(np.mean([wide.value - edge.value for edge, wide in pairs])) ** 2 - float(noise)
    return float(np.sqrt(max(beyond, 0.0) / 3.0))


def _measure_faces(
    scan: HeightMap, edge: Edge, instrument: Instrument, notes: list[str]
) -> tuple[dict[str, Measured], ShownMap]:
    """Flatness and parallelism of the faces of a map, and how they lie in it."""
    # a form of degree three needs no more
    across, along = (slice(None, None, max(size // _MOST_ACROSS, 1)) for size in scan.height.shape)
    x, y, height = scan.x[along], scan.y[across], scan.height[across, along]
    sides = [x < edge.position - edge.exclusion, x > edge.position + edge.exclusion]
    lower, upper = (
        np.broadcast_to(side, height.shape) for side in (sides if edge.rising else sides[::-1])
    )
    low, high = (fit_face(x, y, height, face) for face in (lower, upper))
    level = height - edge.tilt * x
    level = level - np.nanmedian(np.where(lower, level, np.nan), axis=1, keepdims=True)
    rest = np.where(upper, level - edge.height.value, np.where(lower, level, np.nan))
    known = np.isfinite(height)
    parts = ("upper face", upper & known), ("lower face", lower & known)
    drawn = ShownMap(level, rest, parts, (float(x[-1]), float(y[-1])))
    asked: dict[str, tuple[str, Callable[..., float], tuple[FaceForm, ...]]] = {
        "flatness_lower": ("flatness, lower face", compute_flatness, (low,)),
        "flatness_upper": ("flatness, upper face", compute_flatness, (high,)),
        "parallelism": ("parallelism, upper face to A", compute_parallelism, (high, low)),
    }
    zones = [
        (name, zone(*[face.points for face in faces]) * 1e6) for name, zone, faces in asked.values()
    ]
    notes.append(
        "flatness and parallelism are those of the form, polynomials of degree "
        f"{max(low.degree, high.degree)}, over what was "
        "scanned; zones of all points, noise included: "
        f"{', '.join(f'{name} {size:.3g} um' for name, size in zones)}"
    )
    values = {}
    for key, (name, zone, faces) in asked.items():
        form = estimate_zone(zone, *faces)
        noise = Component("noise", form.std, form.dof, "draws from the covariance of the form")
        values[key] = add_instrument_components(name, form.value, [noise], instrument)
    return values, drawn


def measure_margin(
    scan: Profile | HeightMap, instrument: Instrument, how: EvaluationOptions = AS_FOUND
) -> Evaluation:
    """Measure opening and rise of a margin, and the absolute discrepancy."""
    rows, notes = sample_profiles(scan, how)
    found, refused = evaluate_each(lambda row: fit_margin(row.position, row.height), rows)
    openings = np.array([[one.opening.value] for _, one in found]).reshape(-1, 1)
    results = keep_agreeing(
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
    for key, (each, part, axes) in sizes.items():
        origin = "one interval at either edge, rectangular; the same in every profile"
        others = [Component("sampling", part * sampling, how=origin)] if part > 0.0 else []
        values[key] = average_profiles(key.replace("_", " "), each, instrument, others, axes)
    first = results[0][0]
    left = np.nanmedian(first.height[: len(first.height) // 4])
    convention = "shoulders by two planes with a common slope; edges at half the depth of the gap"
    return Evaluation(values, convention, tuple(notes), Shown(first.position, first.height - left))


def measure_tip(
    scan: Profile | HeightMap,
    instrument: Instrument,
    how: EvaluationOptions = AS_FOUND,
    nominal: float = 0.0,
) -> Evaluation:
    """Radius of a probe tip of about `nominal` [m]: from a height map that looks at it along its axis, or a profile over it."""
    notes: list[str] = []
    if isinstance(scan, Profile):
        (scan,), notes = sample_profiles(scan, how)
    cap = fit_cap(scan, nominal)
    radius, reach = (
        cap.radius,
        float(np.sin(cap.cap_angle)),
    )  # of what the points cover, as a part of the radius
    narrower = evaluate_each(lambda part: fit_cap(scan, nominal, part), [_NARROWER * reach])[0]
    change = max((abs(one.radius.value - radius.value) for _, one in narrower), default=0.0)
    # a cap of 0.7 of the angle knows its radius by a quarter as well
    beyond = float(np.sqrt(max(change**2 - (3.0 * radius.std) ** 2, 0.0) / 3.0))
    form = Component(
        "form", beyond, how="change over a cap of seven tenths of it, less its noise, rectangular"
    )
    if how.stylus_radius > 0.0:
        radius = replace(radius, value=radius.value - how.stylus_radius)
        notes.append(f"the stylus radius of {how.stylus_radius * 1e6:.4g} um is taken off")
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
        if isinstance(scan, Profile)
        else "sphere through the cap"
    )
    x, z, fitted = cap.drawn
    low = float(np.nanmin(z))
    shown = Shown(x, z - low, (), fitted - low)
    return Evaluation(
        {"ball_radius": value}, f"least-squares {through}, in heights", tuple(notes), shown
    )
