"""A scan in, measured characteristics out, each with its budget: the evaluation of an edge, a groove, a margin, a tip."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile, rows_of
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, Measured, measured_from_profiles, with_budget
from stepblocks.inspect.edge import Edge, fit_edge
from stepblocks.inspect.form import fit_face, zone_of_flatness, zone_of_parallelism
from stepblocks.inspect.margin_gap import fit_margin
from stepblocks.inspect.masked_step import masked_step
from stepblocks.inspect.noise import Array, Mask, NoiseUncertainty
from stepblocks.inspect.tip import fit_cap
from stepblocks.inspect.type_a1 import evaluate_a1, find_features

Window = tuple[float, float, str]  # begin, end [m] and name
S = TypeVar("S")
T = TypeVar("T")

_MOST_PROFILES = 60  # of a map that are evaluated; of more, as many are taken evenly over the map


@dataclass(frozen=True)
class Shown:
    """What a plot shows: one profile, levelled on its lower or outer face."""

    position: Array  # m
    height: Array  # m
    windows: tuple[Window, ...] = ()  # the stretches that were evaluated


@dataclass(frozen=True)
class Inspected:
    """What a scan says."""

    values: dict[str, Measured]  # by key of the characteristic
    convention: str  # how the values are defined
    notes: tuple[str, ...]  # what was left out or cut
    shown: Shown


def measure_edge(scan: Profile | HeightMap, instrument: Instrument, exclusion: float | None = None) -> Inspected:
    """Height and edge radius of a step; of a map also flatness and parallelism of the faces."""
    rows, notes = _sampled(scan)
    results = _evaluated(rows, lambda row: fit_edge(row.position, row.height, exclusion), notes)
    edges = [edge for _, edge in results]
    form = Component("form", _form_of(results), how="change with twice the exclusion, rectangular")
    heights = [NoiseUncertainty(e.height_std, e.height_dof) for e in edges]
    # the noise that the radius is whitened with is as well known as that of the height
    radii = [NoiseUncertainty(e.radius_std, e.height_dof) for e in edges]
    height = measured_from_profiles("step height", [e.height for e in edges], heights, instrument, [form])
    radius = measured_from_profiles("edge radius", [e.radius for e in edges], radii, instrument, axes=(1.0, 1.0))
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
    x, before, behind = first.position, edge.position - edge.exclusion, edge.position + edge.exclusion
    windows = (float(x[0]), before, "face"), (behind, float(x[-1]), "face")
    shown = _shown(first, edge.tilt, (x < before) if edge.rising else (x > behind), windows)
    return Inspected(values, convention, tuple(notes), shown)


def _sampled(scan: Profile | HeightMap) -> tuple[list[Profile], list[str]]:
    """Return the profiles of a scan that are evaluated, and a note if not all are."""
    rows = rows_of(scan)
    if len(rows) <= _MOST_PROFILES:
        return rows, []
    chosen = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROFILES).round().astype(int))
    return [rows[index] for index in chosen], [f"{len(chosen)} of {len(rows)} profiles evaluated"]


def _evaluated(rows: list[Profile], evaluate: Callable[[Profile], T], notes: list[str]) -> list[tuple[Profile, T]]:
    """Evaluate profile by profile; refused ones are named, and all refused is an error."""
    results, refused = _tried(evaluate, rows)
    if not results:
        raise MetrologyError(f"no profile can be evaluated: {refused[0]}")
    if refused:
        notes.append(f"{len(refused)} of {len(rows)} profiles refused, the first since {refused[0]}")
    return results


def _tried(evaluate: Callable[[S], T], asked: Iterable[S]) -> tuple[list[tuple[S, T]], list[str]]:
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

    pairs = [(edge, wide) for (_, edge), wide in _tried(wider, results[:: max(len(results) // 10, 1)])[0]]
    if not pairs:
        return 0.0
    # a fit through fewer of the same points differs by what its variance has grown
    noise = np.mean([max(wide.height_std**2 - edge.height_std**2, 0.0) for edge, wide in pairs]) / len(pairs)
    beyond = float(np.mean([wide.height - edge.height for edge, wide in pairs])) ** 2 - float(noise)
    return float(np.sqrt(max(beyond, 0.0) / 3.0))


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
    how = "draws from the covariance of the form"
    return {
        key: with_budget(label, zone.zone, [Component("noise", zone.std, zone.dof, how)], instrument)
        for key, (label, zone) in zones.items()
    }


def measure_groove(scan: Profile | HeightMap, instrument: Instrument, key: str = "groove_depth") -> Inspected:
    """Depth of a groove or height of a ridge by type A1; of a grating, where its windows lie on neighbours, by a masked step."""
    rows, notes = _sampled(scan)
    if isinstance(scan, HeightMap) and _is_grating(rows):
        return _masked(scan, instrument, key)
    results = _evaluated(rows, lambda row: evaluate_a1(row.position, row.height), notes)
    noise = [one.noise for _, one in results]
    value = measured_from_profiles(key.replace("_", " "), [abs(one.depth) for _, one in results], noise, instrument)
    if outliers := sum(one.outliers for _, one in results):
        notes.append(f"{outliers} points left out as spikes")
    first, best = results[0]
    windows = tuple((*span, name) for span, name in zip(best.windows, "ACB", strict=True))
    outer = (first.position >= best.windows[0][0]) & (first.position <= best.windows[0][1])
    convention = "ISO 5436-1 type A1, profile by profile, unfiltered"
    return Inspected({key: value}, convention, tuple(notes), _shown(first, best.tilt, outer, windows))


def _is_grating(rows: list[Profile]) -> bool:
    found, _ = _tried(lambda row: find_features(row.position, row.height), rows)
    crossed = [len(features) for _, features in found if features]  # rows between the holes of a grating cross none
    return len(crossed) >= 3 and float(np.median(crossed)) >= 2.0


def _masked(scan: HeightMap, instrument: Instrument, key: str) -> Inspected:
    step = masked_step(scan)
    try:
        form = abs(masked_step(scan, 1.5 * step.exclusion).depth - step.depth) / np.sqrt(3.0)
    except MetrologyError:
        form = np.nan
    how = "scatter over rows, with the correlation of neighbours"
    noise = Component("noise", step.noise.std, step.noise.dof, how)
    change = Component("form", float(form), how="change with one and a half times the exclusion, rectangular")
    value = with_budget(key.replace("_", " "), abs(step.depth), [noise], instrument, [change])
    convention = (
        f"masked step over {step.features} features and {step.rows} rows: each row levelled on the reference between the "
        f"features, {step.exclusion * 1e6:.3g} um kept from every edge"
    )
    note = "type A1 not used: the profiles cross several features, so its windows would lie on the neighbours"
    return Inspected({key: value}, convention, (note,), Shown(*step.profile))


def measure_margin(scan: Profile | HeightMap, instrument: Instrument) -> Inspected:
    """Measure opening and rise of a margin, and the absolute discrepancy."""
    rows, notes = _sampled(scan)
    results = _evaluated(rows, lambda row: fit_margin(row.position, row.height), notes)
    ones = [one for _, one in results]
    share = float(np.mean([one.opening / one.absolute for one in ones]))
    sampling = float(np.mean([one.opening_sampling for one in ones]))

    how = "one interval at either edge, rectangular; the same in every profile"
    sizes = {  # length and noise of each, its share in what lies between samples, and the axes that it answers to
        "vertical_discrepancy": ([(m.opening, m.opening_noise) for m in ones], 1.0, (0.0, 1.0)),
        "horizontal_discrepancy": ([(m.rise, m.rise_noise) for m in ones], None, (1.0, 0.0)),
        "absolute_discrepancy": ([(m.absolute, m.absolute_noise) for m in ones], share, (1.0 - share**2, share**2)),
    }
    values = {}
    for key, (found, part, axes) in sizes.items():
        lengths, noise = [length for length, _ in found], [own for _, own in found]
        others = [] if part is None else [Component("sampling", part * sampling, how=how)]
        values[key] = measured_from_profiles(key.replace("_", " "), lengths, noise, instrument, others, axes)
    first = results[0][0]
    left = np.nanmedian(first.height[: len(first.height) // 4])
    convention = "shoulders by two planes with a common slope; edges at half the depth of the gap"
    return Inspected(values, convention, tuple(notes), Shown(first.position, first.height - left))


def measure_tip(scan: Profile | HeightMap, instrument: Instrument, nominal: float) -> Inspected:
    """Radius of a probe tip [m] from a height map that looks at it along its axis."""
    if not isinstance(scan, HeightMap):
        raise MetrologyError(f"a tip needs a height map, got a profile [{scan.source}]")
    cap = fit_cap(scan, nominal)
    # of a cap, height h over width a, R is a^2 / 2h: twice the lateral error, once the vertical
    value = measured_from_profiles("ball radius", [cap.radius], [cap.noise], instrument, axes=(1.0, 2.0))
    middle = scan.height[scan.height.shape[0] // 2]
    covered = f"over a cap of {np.degrees(cap.cap_angle):.3g} deg"
    notes = [f"form of the ball {cap.form * 1e6:.3g} um, noise included, {covered}"]
    if cap.rejected:
        notes.append(f"{cap.rejected} points left out as spikes")
    convention = "least-squares sphere through the cap, in heights"
    return Inspected({"ball_radius": value}, convention, tuple(notes), Shown(scan.x, middle - np.nanmin(middle)))
