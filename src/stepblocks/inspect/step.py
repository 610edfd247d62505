"""A step measured: at its edge by two planes, or by a groove or ridge beside it, and which evaluation of that answers."""

from __future__ import annotations

from typing import Literal

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, Measured, calibration_of, measured_from_profiles
from stepblocks.inspect.evaluate.edge import Edge, fit_edge
from stepblocks.inspect.evaluate.face_form import FormZone, fit_face, zone_of_flatness, zone_of_parallelism
from stepblocks.inspect.evaluate.masked_step import masked_step
from stepblocks.inspect.evaluate.noise_uncertainty import NoiseUncertainty
from stepblocks.inspect.evaluate.type_a1 import evaluate_a1, find_features
from stepblocks.inspect.inspection import Inspected, Shown, evaluated, sampled


def measure_edge(scan: Profile | HeightMap, instrument: Instrument, exclusion: float | None = None) -> Inspected:
    """Height and edge radius of a step; of a map also flatness and parallelism of the faces."""
    rows, notes = sampled(scan)
    results = evaluated(rows, lambda row: fit_edge(row.position, row.height, exclusion), notes)
    edges = [edge for _, edge in results]
    values = {
        "step_height": measured_from_profiles(
            "step height",
            [e.height for e in edges],
            [NoiseUncertainty(e.height_std, e.height_dof) for e in edges],
            instrument,
            [Component("form", _form_of(results), how="change with twice the exclusion, rectangular")],
        ),
        # the noise that the radius is whitened with is as well known as that of the height
        "edge_radius": measured_from_profiles(
            "edge radius",
            [e.radius for e in edges],
            [NoiseUncertainty(e.radius_std, e.height_dof) for e in edges],
            instrument,
            axes=(1.0, 1.0),
        ),
    }
    first, edge = results[0]
    if isinstance(scan, HeightMap):
        values |= _faces(scan, edge, instrument, notes)
    rejected = sum(one.rejected for one in edges)
    if rejected:
        notes.append(f"{rejected} points missing or left out as spikes")
    if any(e.radius < 3.0 * first.spacing for e in edges):
        limit = max(e.radius_limit for e in edges)
        notes.append(f"edge sharper than the sampling resolves; radius below {limit * 1e6:.2g} um at 95 %")
    convention = f"two planes with a common slope, {edge.exclusion * 1e6:.4g} um excluded on either side of the edge; radius by arc"
    return Inspected(values, convention, tuple(notes), _shown_edge(first, edge))


def _form_of(results: list[tuple[Profile, Edge]]) -> float:
    """Change of the mean height when twice as much is excluded, beyond what noise alone changes, as a rectangle."""
    changes, noise = [], []
    for row, edge in results[:: max(len(results) // 10, 1)]:
        try:
            wider = fit_edge(row.position, row.height, 2.0 * edge.exclusion)
        except MetrologyError:
            continue
        changes.append(wider.height - edge.height)
        # a fit through fewer of the same points differs by what its variance has grown
        noise.append(max(wider.height_std**2 - edge.height_std**2, 0.0))
    if not changes:
        return 0.0
    beyond = float(np.mean(changes)) ** 2 - float(np.mean(noise)) / len(noise)
    return float(np.sqrt(max(beyond, 0.0) / 3.0))


def _shown_edge(profile: Profile, edge: Edge) -> Shown:
    x = profile.position
    low = (x < edge.position - edge.exclusion) if edge.rising else (x > edge.position + edge.exclusion)
    z = profile.height - edge.tilt * x
    z = z - np.nanmedian(z[low])
    left = (float(x[0]), edge.position - edge.exclusion, "face")
    right = (edge.position + edge.exclusion, float(x[-1]), "face")
    return Shown(x, z, (left, right))


def _faces(scan: HeightMap, edge: Edge, instrument: Instrument, notes: list[str]) -> dict[str, Measured]:
    x = scan.x
    low, high = x < edge.position - edge.exclusion, x > edge.position + edge.exclusion
    if not edge.rising:
        low, high = high, low
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
    return {key: _zone(label, zone, instrument) for key, (label, zone) in zones.items()}


def _zone(label: str, zone: FormZone, instrument: Instrument) -> Measured:
    parts = (
        Component("noise", zone.std, zone.dof, "draws from the covariance of the form"),
        *calibration_of(zone.zone, instrument, (1.0, 0.0)),
        Component("resolution", instrument.resolution / np.sqrt(12.0), how="one count, rectangular"),
    )
    return Measured(label, zone.zone, parts)


def measure_groove(
    scan: Profile | HeightMap, instrument: Instrument, key: str = "groove_depth", exclude: bool = False
) -> Inspected:
    """Depth of a groove or height of a ridge, by type A1, or of many small features by a masked step.

    Type A1 needs a plane face of one width on either side, W = R - L. In a map where most profiles cross two features or
    more, the windows A and B of one would lie on the next: such a map (a grating) is evaluated by
    `stepblocks.inspect.evaluate.masked_step.masked_step`, and the convention says so.
    """
    if isinstance(scan, HeightMap) and _is_grating(scan):
        return _masked(scan, instrument, key)
    rows, notes = sampled(scan)
    policy: Literal["refuse", "exclude"] = "exclude" if exclude else "refuse"
    results = evaluated(rows, lambda row: evaluate_a1(row.position, row.height, contaminated=policy), notes)
    noise = [NoiseUncertainty(one.depth_std, one.depth_dof) for _, one in results]
    value = measured_from_profiles(key.replace("_", " "), [abs(one.depth) for _, one in results], noise, instrument)
    excluded = sum(one.excluded for _, one in results)
    if excluded:
        notes.append(f"{excluded} points cut from the windows since a flank reached into them")
    outliers = sum(one.outliers for _, one in results)
    if outliers:
        notes.append(f"{outliers} points left out as spikes")
    first, best = results[0]
    windows = tuple((*span, name) for span, name in zip(best.windows, "ACB", strict=True))
    outer = (first.position >= best.windows[0][0]) & (first.position <= best.windows[0][1])
    z = first.height - best.tilt * first.position
    return Inspected(
        {key: value},
        "ISO 5436-1 type A1, profile by profile, unfiltered",
        tuple(notes),
        Shown(first.position, z - np.nanmedian(z[outer]), windows),
    )


def _is_grating(scan: HeightMap) -> bool:
    rows, _ = sampled(scan)
    counts = []
    for row in rows:
        try:
            counts.append(len(find_features(row.position, row.height)))
        except MetrologyError:
            continue
    # rows between the holes of a grating cross none
    crossed = [count for count in counts if count > 0]
    return len(crossed) >= 3 and float(np.median(crossed)) >= 2.0


def _masked(scan: HeightMap, instrument: Instrument, key: str) -> Inspected:
    step = masked_step(scan)
    try:
        form = abs(masked_step(scan, 1.5 * step.exclusion).depth - step.depth) / np.sqrt(3.0)
    except MetrologyError:
        form = np.nan
    value = Measured(
        key.replace("_", " "),
        abs(step.depth),
        (
            Component("noise", step.depth_std, step.depth_dof, "scatter over rows, with the correlation of neighbours"),
            *calibration_of(step.depth, instrument, (1.0, 0.0)),
            Component("form", float(form), how="change with one and a half times the exclusion, rectangular"),
            Component("resolution", instrument.resolution / np.sqrt(12.0), how="one count, rectangular"),
        ),
    )
    convention = (
        f"masked step over {step.features} features and {step.rows} rows: each row levelled on the reference between the "
        f"features, {step.exclusion * 1e6:.3g} um kept from every edge"
    )
    note = "type A1 not used: the profiles cross several features, so its windows would lie on the neighbours"
    shown = step.profile
    return Inspected({key: value}, convention, (note,), Shown(shown[0], shown[1], ()))
