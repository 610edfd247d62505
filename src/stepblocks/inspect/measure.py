"""A scan in, measured characteristics out, each with its budget: the evaluation of an edge, a groove, a margin, a tip."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile, rows_of
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, Measured, measured_from_profiles, with_budget
from stepblocks.inspect.edge import Edge, fit_edge
from stepblocks.inspect.form import fit_face, zone_of_flatness, zone_of_parallelism
from stepblocks.inspect.margin_gap import fit_margin
from stepblocks.inspect.noise import Array, Mask, NoiseUncertainty
from stepblocks.inspect.tip import Cap, fit_cap

Window = tuple[float, float, str]  # begin, end [m] and name
S = TypeVar("S")
T = TypeVar("T")

_NARROWER = 0.7  # of the cap of a tip, over which its radius is fitted again [1]
_MOST_PROFILES = 60  # of a map that are evaluated; of more, as many are taken evenly over the map


@dataclass(frozen=True)
class Shown:
    """What a plot shows: one profile, levelled on its lower or outer face."""

    position: Array  # m
    height: Array  # m
    windows: tuple[Window, ...] = ()  # the stretches that were evaluated
    fitted: Array | None = None  # what was fitted to it [m]
    dropped: Mask | None = None  # points left out as spikes


@dataclass(frozen=True)
class How:
    """How a scan is to be evaluated; what is not said follows the data."""

    exclusion: float | None = None  # half width kept out at every edge [m]; where the flank is
    degree: int | None = None  # of the polynomial that a profile is levelled by, 1 to 3; as the data carry
    begin: float | None = None  # of the part of each profile that is looked at [m]; all of it
    end: float | None = None  # likewise [m]
    edges: tuple[int, ...] | None = None  # which features, counted from 1; all
    along: Literal["x", "y"] | None = None  # direction of the profiles of a map; whichever shows features
    stylus_radius: float = 0.0  # m
    stylus_cone: float = 0.0  # full angle of the stylus [rad]


AS_FOUND = How()


@dataclass(frozen=True)
class Inspected:
    """What a scan says."""

    values: dict[str, Measured]  # by key of the characteristic
    convention: str  # how the values are defined
    notes: tuple[str, ...]  # what was left out or cut
    shown: Shown | None = None  # none of what another program measured
    arc: bool = True  # whether the edge is an arc, which its radius then says all of


def measure_edge(scan: Profile | HeightMap, instrument: Instrument, how: How = AS_FOUND) -> Inspected:
    """Height and edge radius of a step; of a map also flatness and parallelism of the faces."""
    rows, notes = sampled(scan, how)
    results = _evaluated(rows, lambda row: fit_edge(row.position, row.height, how.exclusion), notes)
    edges = [edge for _, edge in results]
    form = Component("form", _form_of(results), how="change with twice the exclusion, rectangular")
    heights = [NoiseUncertainty(e.height_std, e.height_dof) for e in edges]
    # the noise that the radius is whitened with is as well known as that of the height
    radii = [NoiseUncertainty(e.radius_std, e.height_dof) for e in edges]
    height = measured_from_profiles("step height", [e.height for e in edges], heights, instrument, [form])
    flanks = [e.flank for e in edges if e.flank is not None]
    sloped = 2 * len(flanks) > len(edges)
    # a stylus rounds a corner by its own radius
    corners = [e.radius - how.stylus_radius for e in edges if (e.flank is not None) == sloped]
    radii = [noise for noise, e in zip(radii, edges, strict=True) if (e.flank is not None) == sloped]
    radius = measured_from_profiles("edge radius", corners, radii, instrument, axes=(1.0, 1.0))
    if how.stylus_radius > 0.0:
        notes.append(f"the stylus radius of {how.stylus_radius * 1e6:.3g} um is taken off the edge radius")
    if sloped:
        angle, off = np.mean([one.angle for one in flanks]), np.mean([one.angle_std for one in flanks])
        slope = f"{np.degrees(angle):.1f} +-{np.degrees(2.0 * off):.1f} deg"
        said = f"the edge is no arc: its flank slopes by {slope}, its radius is that of the corner"
        if how.stylus_cone > 0.0 and angle > 0.5 * np.pi - 0.5 * how.stylus_cone - 2.0 * off - np.radians(1.0):
            said += ", and the flank may be steeper: it is as steep as the cone of the stylus"
        notes.append(said)
    values = {"step_height": height, "edge_radius": radius}
    first, edge = results[0]
    if isinstance(scan, HeightMap):
        values |= _faces(scan, edge, instrument, notes)
    if rejected := sum(one.rejected for one in edges):
        notes.append(f"{rejected} points missing or left out as spikes")
    if any(e.radius < 3.0 * first.spacing for e in edges):
        limit = max(e.radius_limit for e in edges)
        notes.append(f"edge sharper than the sampling resolves; radius below {limit * 1e6:.2g} um at 95 %")
    convention = f"two planes with a common slope, {edge.exclusion * 1e6:.4g} um excluded on either side of the edge; radius by arc"
    if sloped:
        convention = f"{convention} of the corner beside its flank"
    x, before, behind = first.position, edge.position - edge.exclusion, edge.position + edge.exclusion
    windows = (float(x[0]), before, "face"), (behind, float(x[-1]), "face")
    shown = _shown(first, edge.tilt, (x < before) if edge.rising else (x > behind), windows)
    shown = replace(shown, dropped=edge.dropped if len(edge.dropped) == len(x) else None)
    return Inspected(values, convention, tuple(notes), shown, arc=not sloped)


def sampled(scan: Profile | HeightMap, how: How = AS_FOUND) -> tuple[list[Profile], list[str]]:
    """Return the profiles of a scan that are evaluated, cropped and in equal steps, and notes on what that took."""
    rows, notes = rows_of(scan), []
    if len(rows) > _MOST_PROFILES:
        chosen = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROFILES).round().astype(int))
        notes = [f"{len(chosen)} of {len(rows)} profiles evaluated"]
        rows = [rows[index] for index in chosen]
    begin, end = -np.inf if how.begin is None else how.begin, np.inf if how.end is None else how.end
    if how.begin is not None or how.end is not None:
        inside = (rows[0].position >= begin) & (rows[0].position <= end)
        if inside.sum() < 3:
            raise MetrologyError(f"the part from {begin:g} to {end:g} m must hold 3 points, got {int(inside.sum())}")
        kept = [(row, row.height[inside]) for row in rows]
        rows = [Profile(row.position[inside], z, row.source, row.scale) for row, z in kept if np.isfinite(z).any()]
    steps = np.diff(rows[0].position)
    if np.ptp(steps) > 0.01 * steps.mean():
        x = np.arange(rows[0].position[0], rows[0].position[-1], float(np.median(steps)))
        # across a gap of several steps nothing is known
        far = np.abs(x - rows[0].position[np.searchsorted(rows[0].position, x).clip(0, len(steps))]) > 3.0 * np.median(
            steps
        )
        rows = [Profile(x, np.where(far, np.nan, np.interp(x, row.position, row.height)), row.source) for row in rows]
        notes.append(
            f"positions set to equal steps of {np.median(steps) * 1e6:.4g} um, between which heights are interpolated"
        )
    return rows, notes


def _evaluated(rows: list[Profile], evaluate: Callable[[Profile], T], notes: list[str]) -> list[tuple[Profile, T]]:
    """Evaluate profile by profile; refused ones are named, and all refused is an error."""
    results, refused = tried(evaluate, rows)
    if not results:
        raise MetrologyError(f"no profile can be evaluated: {refused[0]}")
    if refused:
        notes.append(f"{len(refused)} of {len(rows)} profiles refused, the first since {refused[0]}")
    return results


def tried(evaluate: Callable[[S], T], asked: Iterable[S]) -> tuple[list[tuple[S, T]], list[str]]:
    """Return what can be evaluated with its result, and why the others were refused."""
    results, refused = [], []
    for one in asked:
        try:
            results.append((one, evaluate(one)))
        except MetrologyError as error:
            refused.append(str(error))
    return results, refused


def _form_of(results: list[tuple[Profile, Edge]]) -> float:
    """Change of the mean height when twice as much is excluded, beyond what noise alone changes, as a rectangle."""

    def wider(result: tuple[Profile, Edge]) -> Edge:
        row, edge = result
        return fit_edge(row.position, row.height, 2.0 * edge.exclusion)

    pairs = [(edge, wide) for (_, edge), wide in tried(wider, results[:: max(len(results) // 10, 1)])[0]]
    if not pairs:
        return 0.0
    # a fit through fewer of the same points differs by what its variance has grown
    noise = np.mean([max(wide.height_std**2 - edge.height_std**2, 0.0) for edge, wide in pairs]) / len(pairs)
    beyond = float(np.mean([wide.height - edge.height for edge, wide in pairs])) ** 2 - float(noise)
    return float(np.sqrt(max(beyond, 0.0) / 3.0))


def drawn(profile: Profile, fitted: Array, windows: tuple[Window, ...]) -> Shown:
    """Show a profile and its fit, both levelled by the line through the ends of the fit."""
    x = profile.position
    line = np.polynomial.Polynomial.fit(x[[0, -1]], fitted[[0, -1]], 1)(x)
    return Shown(x, profile.height - line, windows, fitted - line)


def _shown(profile: Profile, tilt: float, face: Mask, windows: tuple[Window, ...]) -> Shown:
    """Show a profile levelled on one of its faces."""
    z = profile.height - tilt * profile.position
    return Shown(profile.position, z - np.nanmedian(z[face]), windows)


def _faces(scan: HeightMap, edge: Edge, instrument: Instrument, notes: list[str]) -> dict[str, Measured]:
    x = scan.x
    sides = [x < edge.position - edge.exclusion, x > edge.position + edge.exclusion]
    low, high = sides if edge.rising else sides[::-1]
    faces = [fit_face(x, scan.y, scan.height, np.broadcast_to(side, scan.height.shape)) for side in (low, high)]
    zones = {
        "flatness_lower": ("flatness, lower face", zone_of_flatness(faces[0])),
        "flatness_upper": ("flatness, upper face", zone_of_flatness(faces[1])),
        "parallelism": ("parallelism, upper face to A", zone_of_parallelism(faces[1], faces[0])),
    }
    notes.append(
        f"flatness and parallelism are those of the form, polynomials of degree {max(face.degree for face in faces)}, over what "
        "was scanned; zones of all points, noise included: "
        + ", ".join(f"{label} {zone.all_points * 1e6:.3g} um" for label, zone in zones.values())
    )
    origin = "draws from the covariance of the form"
    return {
        key: with_budget(label, zone.zone, [Component("noise", zone.std, zone.dof, origin)], instrument)
        for key, (label, zone) in zones.items()
    }


def measure_margin(scan: Profile | HeightMap, instrument: Instrument, how: How = AS_FOUND) -> Inspected:
    """Measure opening and rise of a margin, and the absolute discrepancy."""
    rows, notes = sampled(scan, how)
    results = _evaluated(rows, lambda row: fit_margin(row.position, row.height), notes)
    ones = [one for _, one in results]
    share = float(np.mean([one.opening / one.absolute for one in ones]))
    sampling = float(np.mean([one.opening_sampling for one in ones]))

    origin = "one interval at either edge, rectangular; the same in every profile"
    sizes = {  # length and noise of each, its share in what lies between samples, and the axes that it answers to
        "vertical_discrepancy": ([(m.opening, m.opening_noise) for m in ones], 1.0, (0.0, 1.0)),
        "horizontal_discrepancy": ([(m.rise, m.rise_noise) for m in ones], None, (1.0, 0.0)),
        "absolute_discrepancy": ([(m.absolute, m.absolute_noise) for m in ones], share, (1.0 - share**2, share**2)),
    }
    values = {}
    for key, (found, part, axes) in sizes.items():
        lengths, noise = [length for length, _ in found], [own for _, own in found]
        others = [] if part is None else [Component("sampling", part * sampling, how=origin)]
        values[key] = measured_from_profiles(key.replace("_", " "), lengths, noise, instrument, others, axes)
    first = results[0][0]
    left = np.nanmedian(first.height[: len(first.height) // 4])
    convention = "shoulders by two planes with a common slope; edges at half the depth of the gap"
    return Inspected(values, convention, tuple(notes), Shown(first.position, first.height - left))


def measure_tip(
    scan: Profile | HeightMap, instrument: Instrument, how: How = AS_FOUND, nominal: float = 0.0
) -> Inspected:
    """Radius of a probe tip of about `nominal` [m]: from a height map that looks at it along its axis, or a profile over it."""
    notes: list[str] = []
    if isinstance(scan, Profile):
        (scan,), notes = sampled(scan, how)
    cap = fit_cap(scan, nominal)
    narrower = [
        found.radius for _, found in tried(lambda part: fit_cap(scan, nominal, part), _NARROWER * _reached(cap))[0]
    ]
    change = max((abs(one - cap.radius) for one in narrower), default=0.0)
    how_form = "change over a cap of seven tenths of it, less its noise, rectangular"
    # a cap of 0.7 of the angle knows its radius by a quarter as well
    beyond = float(np.sqrt(max(change**2 - (3.0 * cap.noise.std) ** 2, 0.0) / 3.0))
    parts = [Component("form", beyond, how=how_form)]
    radius = cap.radius - how.stylus_radius
    if how.stylus_radius > 0.0:
        notes.append(f"the stylus radius of {how.stylus_radius * 1e6:.4g} um is taken off")
    # of a cap, height h over width a, R is a^2 / 2h: twice the lateral error, once the vertical
    value = measured_from_profiles("ball radius", [radius], [cap.noise], instrument, parts, axes=(1.0, 2.0))
    covered = f"over a cap of {np.degrees(cap.cap_angle):.3g} deg"
    notes.append(f"form of the ball {cap.form * 1e6:.3g} um, noise included, {covered}")
    if cap.rejected:
        notes.append(f"{cap.rejected} points left out as spikes")
    convention = "least-squares sphere through the cap, in heights"
    if isinstance(scan, Profile):
        convention = "least-squares circle through the cap of the profile, in heights"
    x, z, fitted = cap.drawn
    low = float(np.nanmin(z))
    return Inspected({"ball_radius": value}, convention, tuple(notes), Shown(x, z - low, (), fitted - low))


def _reached(cap: Cap) -> Array:
    """Reach of the cap that the points cover, as a part of the radius."""
    return np.array([np.sin(cap.cap_angle)])
