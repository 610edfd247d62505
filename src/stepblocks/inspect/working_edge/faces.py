"""Form of the faces beside a working edge, and their profiles for roughness."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.inspect.budget import (
    Bound,
    Component,
    Instrument,
    Measured,
    Source,
    make_measured_with_instrument,
)
from stepblocks.inspect.evaluation import Extent
from stepblocks.inspect.filtering import choose_face_cutoff
from stepblocks.inspect.form import (
    FaceForm,
    compute_flatness,
    compute_parallelism,
    estimate_zone,
    fit_face,
)
from stepblocks.inspect.noise import Array
from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.inspect.working_edge.crossing import CrossedEdges
from stepblocks.inspect.working_edge.drift import Drift, find_drift
from stepblocks.scans.scan import HeightMap, ScannedProfile

_MOST_ACROSS = 300  # points of a map along either side through which the form of a face is fitted
_MOST_PROFILES = 12  # of faces that are kept for their roughness
_LOWER, _UPPER, _PARALLELISM = "flatness_lower", "flatness_upper", "parallelism"


@dataclass(frozen=True)
class MeasuredFaces:
    """Form of both faces, by key of its characteristic."""

    values: dict[str, Measured]
    covered: dict[str, Extent]  # how far the faces were scanned


@dataclass(frozen=True)
class _Zone:
    """A form tolerance and the faces that it is of."""

    name: str
    compute: Callable[..., float]  # of the points of the faces [m]
    faces: tuple[FaceForm, ...]


def measure_faces(
    scan: HeightMap,
    across: Array,
    exclusion: float,
    instrument: Instrument,
    notes: list[Note],
) -> MeasuredFaces:
    """Measure flatness and parallelism of the faces of a map.

    Parameters
    ----------
    scan : HeightMap
    across : array, shape (ny, nx)
        Distance of its points from the edge towards the upper face [m].
    exclusion : float
        Half width kept out of the faces [m].
    instrument : Instrument
    notes : list of Note
        Takes how the zones are defined.

    Returns
    -------
    MeasuredFaces
    """
    # a form of degree three needs no more points
    rows, columns = scan.height.shape
    thin_y = max(rows // _MOST_ACROSS, 1)
    thin_x = max(columns // _MOST_ACROSS, 1)
    x = scan.x[::thin_x]
    y = scan.y[::thin_y]
    height = scan.height[::thin_y, ::thin_x]
    side = across[::thin_y, ::thin_x]
    on_lower = side < -exclusion
    on_upper = side > exclusion
    drift = find_drift(x, y, height, on_lower, on_upper)
    if drift is not None:
        height = height - drift.offsets[:, np.newaxis]
        notes.append(NoteKind.DRIFT_OR_BEND.make_note(zone=drift.range_of_offsets * 1e6))
    lower = fit_face(x, y, height, on_lower)
    upper = fit_face(x, y, height, on_upper)
    zones = {
        _LOWER: _Zone("flatness, lower face", compute_flatness, (lower,)),
        _UPPER: _Zone("flatness, upper face", compute_flatness, (upper,)),
        _PARALLELISM: _Zone("parallelism, upper face to A", compute_parallelism, (upper, lower)),
    }
    notes.append(_make_zones_note(list(zones.values()), max(lower.degree, upper.degree)))
    if lower.is_wavy or upper.is_wavy:
        cutoff = choose_face_cutoff((scan.dy * thin_y, scan.dx * thin_x))
        notes.append(NoteKind.WAVINESS_OF_FACES.make_note(cutoff=cutoff * 1e3))
    known = np.isfinite(height)
    covered = {
        _LOWER: Extent(float(np.ptp(side[on_lower & known])), float(y[-1])),
        _UPPER: Extent(float(np.ptp(side[on_upper & known])), float(y[-1])),
    }
    covered[_PARALLELISM] = min(covered.values())
    values = {}
    for key, zone in zones.items():
        values[key] = _measure_form_zone(zone, instrument, drift)
    return MeasuredFaces(values, covered)


def _make_zones_note(zones: list[_Zone], degree: int) -> Note:
    """Make a note on how zones are defined, and on those of all points."""
    listed = []
    for zone in zones:
        points = [face.points for face in zone.faces]
        width = zone.compute(*points) * 1e6
        listed.append(f"{zone.name} {width:.3g} um")
    return NoteKind.FORM_OF_FACES.make_note(degree=degree, zones=", ".join(listed))


def _measure_form_zone(zone: _Zone, instrument: Instrument, drift: Drift | None) -> Measured:
    """Return the zone of a form with its budget; a bound where drift was taken off the faces."""
    form = estimate_zone(zone.compute, *zone.faces)
    how = "draws from the covariance of the form"
    components = [Component(Source.NOISE, form.std, form.dof, how)]
    if drift is None:
        return make_measured_with_instrument(zone.name, form.value, components, instrument)
    how = "a quarter of what both faces share along the edge"
    components.append(Component(Source.DRIFT, 0.25 * drift.range_of_offsets, how=how))
    measured = make_measured_with_instrument(zone.name, form.value, components, instrument)
    return replace(measured, bound=Bound.AT_LEAST)


def iterate_face_profiles(crossed: CrossedEdges) -> Iterator[ScannedProfile]:
    """Yield the two faces of some profiles, levelled, those of the lower face first."""
    chosen = crossed.sample_evenly(_MOST_PROFILES)
    for side in (-1.0, 1.0):
        for crossing in chosen:
            points = crossing.levelled_points
            inside = side * points.across > crossing.edge.exclusion
            row = crossing.row
            yield ScannedProfile(row.position[inside], points.level[inside], row.source)
