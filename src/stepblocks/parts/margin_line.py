"""The margin line of a scanned tooth or crown, and stations along it.

A scan errs by more than a gap: only slope and curvature of either side are taken from it, by least
squares.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array
from stepblocks.errors import StimulusError
from stepblocks.parts.margin_section import (
    COVERED,
    FITTED,
    SECTIONS,
    SectionFrame,
    Side,
    cut_outermost_section,
    fit_sections,
    make_section_frame,
)

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline
    from trimesh import Trimesh

_MOST_TRIANGLES = 5_000_000
_SMALLEST = 2e-3  # of what is scanned: a short crown [m]
_LARGEST = 0.15  # a whole arch [m]
_BESIDE = 0.5e-3  # how far a picked point may lie from the scan [m]
_LEAST_KNOTS = 3
_MOST_KNOTS = 60  # of the margin line: between them it is smooth
_CHORDS_ROUND = 3.0  # least length of the line over that between two neighbours
_LINE_POINTS = 500  # by which the line is compared with shells and triangles
_REACH = 3.0 * FITTED  # about a place, within which triangles are cut [m]
_LEAST_LEAN = 0.5  # sine of the least angle of the crown's direction to the plane of the margin
_LENGTH_DIGITS = 9  # far below what a scan tells, and the same on every processor
_SLOPE_DIGITS = 6


@dataclass(frozen=True)
class _ScannedTooth:
    """The shells of a scan that a margin runs along."""

    mesh: "Trimesh"  # [m]
    line: "CubicSpline"  # of the margin, over the length of its chords [m]
    around: Array  # points on the line, shape (n, 3) [m]


def measure_stations_in_worker(
    path: Path,
    mesh_unit: float,
    margin_points: list[list[float]],
    station_count: int,
    crown_direction: Sequence[float],
    shown_sides: str,
) -> dict[str, object]:
    """Measure `station_count` sections across a margin, in a confined process.

    Parameters
    ----------
    path : Path
        The mesh.
    mesh_unit : float
        Unit of the mesh [m].
    margin_points : list of list of float, shape (n, 3)
        Points of the margin line [unit of the mesh].
    station_count : int
        Number of stations.
    crown_direction : sequence of float
        Rough direction of the crown from the root.
    shown_sides : str
        Sides that the scan covers: ``"tooth"``, ``"crown"`` or ``"both"``.

    Returns
    -------
    dict of str to ndarray
        ``stations``, shape (count, 13): place, axis across, axis outwards, curvature of the
        tooth, slope and curvature of the crown, scatter [SI].

    Raises
    ------
    StimulusError
        If the mesh is no tooth in that unit, or shows too little beside the margin.
    """
    tooth = _load_tooth(path, mesh_unit, margin_points)
    middle = tooth.around.mean(axis=0)
    draw = _find_path_of_draw(tooth.around - middle, crown_direction, path)
    mesh = tooth.mesh
    radii = _remove_triangles_far_from_line(mesh, tooth.around)
    rows = []
    for number in range(station_count):
        along_line = tooth.line.x[-1] * number / station_count
        offsets = np.linspace(-0.5 * FITTED, 0.5 * FITTED, SECTIONS)
        places = tooth.line(along_line + offsets)
        directions = tooth.line(along_line + offsets, 1)
        place = places[SECTIONS // 2]
        distances = np.linalg.norm(mesh.triangles_center - place, axis=1)
        near = np.flatnonzero(distances < _REACH + radii)
        frames = []
        for origin, direction in zip(places, directions, strict=True):
            frames.append(make_section_frame(origin, direction, middle, draw))
        station = f"station {number + 1}"
        shape = _fit_station_shape(mesh, near, frames, shown_sides, station, path)
        rows.append(np.hstack(shape))
    table = np.array(rows)
    rounded = np.round(table, _LENGTH_DIGITS)
    rounded[:, 9:12] = np.round(table[:, 9:12], _SLOPE_DIGITS)
    return {"stations": rounded + 0.0}  # no zero keeps a sign


def _find_path_of_draw(
    margin_offsets: Array, crown_direction: Sequence[float], path: Path
) -> Array:
    """Find the unit vector square to the plane of a margin, towards the crown, shape (3,).

    `margin_offsets` are its points from their middle, shape (n, 3).
    """
    _, _, axes = np.linalg.svd(margin_offsets, full_matrices=False)
    draw: Array = axes[2]
    draw *= math.copysign(1.0, float(draw @ crown_direction))
    if not draw @ crown_direction >= _LEAST_LEAN * np.linalg.norm(crown_direction):
        raise StimulusError(
            f"crown_towards must leave the plane of the margin by 30 deg or more [{path.name}]"
        )
    return draw


def _remove_triangles_far_from_line(mesh: "Trimesh", line_points: Array) -> Array:
    """Remove the triangles far from a line, in place; return the radii of those kept [m].

    The radius of a triangle is its farthest corner's distance from the centre.
    """
    from scipy.spatial import cKDTree

    corners = mesh.triangles - mesh.triangles_center[:, None]
    radii: Array = np.linalg.norm(corners, axis=2).max(axis=1)
    distances, _ = cKDTree(line_points).query(mesh.triangles_center)
    is_near: NDArray[np.bool_] = distances < _REACH + radii
    mesh.update_faces(is_near)
    mesh.remove_unreferenced_vertices()
    return radii[is_near]


class _StationShape(NamedTuple):
    """Shape of tooth and crown at a station, in the frame of the mesh."""

    place: Array  # where the sides meet, shape (3,) [m]
    across: Array  # unit vector along the level tooth, towards the crown, shape (3,)
    outward: Array  # unit vector square to it, shape (3,)
    tooth_curvature: float  # [1/m]
    crown_slope: float  # [rad]
    crown_curvature: float  # [1/m]
    scatter: float  # [m]


def _fit_station_shape(
    mesh: "Trimesh",
    triangle_indices: NDArray[np.int64],
    frames: list[SectionFrame],
    shown_sides: str,
    station_name: str,
    path: Path,
) -> _StationShape:
    """Fit one shape to all sections of a station; refuse a hole beside the margin.

    `triangle_indices` are the indices of the triangles that are cut, `shown_sides` the sides that
    the scan covers, `station_name` its name in a message.
    """
    sections = [cut_outermost_section(mesh, triangle_indices, frame) for frame in frames]
    fit = fit_sections(sections, shown_sides)
    if isinstance(fit, Side):
        raise StimulusError(
            f"the scan must show a third of the {fit} within {FITTED * 1e3:g} mm of the "
            f"margin, got a hole at {station_name} [{path.name}]"
        )
    middle = frames[SECTIONS // 2]
    level = fit.level @ np.stack([middle.across, middle.outward])
    place, across, outward = level + np.outer([1.0, 0.0, 0.0], middle.place)
    return _StationShape(
        place,
        across,
        outward,
        fit.tooth_curvature,
        fit.crown_slope,
        fit.crown_curvature,
        fit.scatter,
    )


def read_tooth_in_worker(
    path: Path, mesh_unit: float, margin_points: list[list[float]]
) -> dict[str, object]:
    """Read the surface that a margin runs along, in a confined process: vertices [m], triangles."""
    mesh = _load_tooth(path, mesh_unit, margin_points).mesh
    return {"vertices": np.asarray(mesh.vertices), "triangles": np.asarray(mesh.faces)}


def _load_tooth(path: Path, mesh_unit: float, margin_points: list[list[float]]) -> _ScannedTooth:
    """Load a scan in metres, and leave the shells that its margin runs along."""
    import trimesh

    mesh = trimesh.load_mesh(path, file_type=path.suffix[1:].lower())
    _refuse_unusable_mesh(mesh, path)
    mesh.apply_scale(mesh_unit)
    _refuse_implausible_tooth_size(mesh, path)
    mesh.update_faces(mesh.nondegenerate_faces())
    shells = trimesh.graph.connected_components(
        mesh.face_adjacency, nodes=np.arange(len(mesh.faces))
    )
    picked = np.asarray(margin_points, dtype=np.float64) * mesh_unit
    longest_edge = float(mesh.edges_unique_length.max())
    shell_points = [mesh.vertices[np.unique(mesh.faces[shell])] for shell in shells]
    _refuse_points_off_mesh(picked, np.concatenate(shell_points), longest_edge, path)
    line = _make_closed_spline(picked, path)
    around = line(np.linspace(0.0, line.x[-1], _LINE_POINTS))
    kept = _find_shells_along_line(around, shell_points, FITTED + longest_edge)
    mesh.update_faces(np.concatenate([shells[index] for index in kept]))
    mesh.remove_unreferenced_vertices()
    return _ScannedTooth(mesh, line, around)


def _refuse_unusable_mesh(mesh: "Trimesh", path: Path) -> None:
    """Refuse a mesh that is empty, too large or not finite."""
    count = len(mesh.faces)
    if not 0 < count <= _MOST_TRIANGLES or not np.isfinite(mesh.vertices).all():
        raise StimulusError(
            f"a mesh must have 1 to {_MOST_TRIANGLES} triangles between finite points, got "
            f"{count} triangles [{path.name}]"
        )


def _refuse_implausible_tooth_size(mesh: "Trimesh", path: Path) -> None:
    """Refuse a mesh [m] whose size is not that of a tooth, as in a wrong unit."""
    size = float(mesh.extents.max())
    if not _SMALLEST <= size <= _LARGEST:
        raise StimulusError(
            f"unit must make the mesh a tooth of {_SMALLEST * 1e3:g} to {_LARGEST * 1e3:g} mm, "
            f"got {size * 1e3:.4g} mm [{path.name}]"
        )


def _refuse_points_off_mesh(
    picked_points: Array, mesh_points: Array, longest_edge: float, path: Path
) -> None:
    """Refuse picked points, shape (n, 3), that lie too far from the points of a mesh [m]."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(mesh_points).query(picked_points)
    beside = np.asarray(distances) - longest_edge
    if not beside.max() <= _BESIDE:
        raise StimulusError(
            f"margin must lie on the mesh within {_BESIDE * 1e3:g} mm, got "
            f"{beside.max() * 1e3:.3g} mm off at point {int(beside.argmax()) + 1} [{path.name}]"
        )


def _find_shells_along_line(
    line_points: Array, shell_points: Sequence[Array], reach: float
) -> list[int]:
    """Find the shells that go along most of a line; return their indices.

    Debris and loose islands are no side of a margin. `reach` is how far from the line a shell
    still goes along it [m].
    """
    from scipy.spatial import cKDTree

    shares = []
    for points in shell_points:
        distances, _ = cKDTree(points).query(line_points)
        shares.append(float(np.mean(distances < reach)))
    least_share = min(COVERED, max(shares))
    return [index for index, share in enumerate(shares) if share >= least_share]


def _make_closed_spline(points: Array, path: Path) -> "CubicSpline":
    """Make a smooth closed line through points, shape (n, 3), over the length of their chords."""
    from scipy.interpolate import CubicSpline

    line = np.vstack([points, points[:1]])
    chords = np.linalg.norm(np.diff(line, axis=0), axis=1)
    longest = chords.sum() / _CHORDS_ROUND
    if len(points) < _LEAST_KNOTS or chords.min() == 0.0 or not chords.max() <= longest:
        raise StimulusError(
            "margin must close round the tooth, no two neighbours further apart than a third "
            f"of it, got {len(points)} points [{path.name}]"
        )
    lengths = np.concatenate([[0.0], np.cumsum(chords)])
    if len(points) > _MOST_KNOTS:
        whole = lengths[-1]
        knots = np.linspace(0.0, whole, _MOST_KNOTS + 1)
        line = np.column_stack([np.interp(knots, lengths, axis, period=whole) for axis in line.T])
        lengths = knots
    return CubicSpline(lengths, line, bc_type="periodic")
