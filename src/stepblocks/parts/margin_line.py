"""The margin line of a scanned tooth or crown, and stations along it."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array
from stepblocks.errors import StimulusError

_MOST_TRIANGLES = 5_000_000
_SMALLEST, _LARGEST = 2e-3, 0.15  # of what is scanned, from a short crown to a whole arch [m]
_BESIDE = 0.5e-3  # how far a picked point may lie from the scan [m]
_MOST_KNOTS = 60  # of the margin line: between them it is smooth
# of either side from which their shape is taken, and along the margin: a scan's noise averages out
# [m]
_FITTED = 1e-3
_SAMPLES, _SECTIONS = 51, 9  # of either side of a section, and beside each other at a station
_COVERED = 1.0 / 3.0  # share of a side that must be there: a hole beside the margin is bridged [1]
_OUTLYING = 4.0  # robust standard deviations beyond which a sample is debris or the edge of a hole


def find_stations_confined(
    path: Path,
    scale: float,
    margin: list[list[float]],
    count: int,
    towards: Sequence[float],
    shows: str,
) -> dict[str, object]:
    """Measure `count` sections across a margin, in a confined process.

    Each has place, axis across, axis outwards, curvature, slope, curvature and scatter [SI].
    """
    # a scan errs by more than a gap: only slope and curvature of either side are taken from it, by
    # least squares
    from scipy.spatial import cKDTree

    mesh, line, around = _load_tooth(path, scale, margin)
    middle = around.mean(axis=0)
    draw = np.linalg.svd(around - middle, full_matrices=False)[2][2]
    draw *= math.copysign(1.0, float(draw @ towards))
    StimulusError.require(
        draw @ towards >= 0.5 * np.linalg.norm(towards),
        f"crown_towards must leave the plane of the margin by 30 deg or more [{path.name}]",
    )
    radii = np.linalg.norm(mesh.triangles - mesh.triangles_center[:, None], axis=2).max(axis=1)
    beside = cKDTree(around).query(mesh.triangles_center)[0] < 3.0 * _FITTED + radii
    mesh.update_faces(beside)
    mesh.remove_unreferenced_vertices()
    found = []
    for number in range(count):
        where = line.x[-1] * number / count + np.linspace(-0.5 * _FITTED, 0.5 * _FITTED, _SECTIONS)
        place = line(where[_SECTIONS // 2])
        near = np.flatnonzero(
            np.linalg.norm(mesh.triangles_center - place, axis=1) < 3.0 * _FITTED + radii[beside]
        )
        frames = [
            (at, _find_section_axes(at, along, middle, draw))
            for at, along in zip(line(where), line(where, 1), strict=True)
        ]
        hole, sides, level = _fit_sections(
            [_cut_section(mesh, near, *frame) for frame in frames], shows
        )
        StimulusError.require(
            not hole,
            f"the scan must show a third of the {hole} within {_FITTED * 1e3:g} mm of the "
            f"margin, got a hole at station {number + 1} [{path.name}]",
        )
        # where the sides meet, the axis across and the axis outwards, both along the level tooth
        lying = level @ frames[_SECTIONS // 2][1][:2] + np.outer([1.0, 0.0, 0.0], place)
        found.append([*lying.ravel(), *sides])
    # digits far below what a scan tells, which are the same on every processor
    return {
        "stations": np.where([0] * 9 + [1, 1, 1, 0], np.round(found, 6), np.round(found, 9)) + 0.0
    }


def read_tooth_confined(path: Path, scale: float, margin: list[list[float]]) -> dict[str, object]:
    """Read the surface that a margin runs along, in a confined process: vertices [m], triangles."""
    mesh, *_ = _load_tooth(path, scale, margin)
    return {"vertices": np.asarray(mesh.vertices), "triangles": np.asarray(mesh.faces)}


def _load_tooth(path: Path, scale: float, margin: list[list[float]]) -> tuple[Any, Any, Array]:
    # Load the shells of a scan that a margin runs along, its line, and points on that
    import trimesh
    from scipy.spatial import cKDTree

    mesh = trimesh.load_mesh(path, file_type=path.suffix[1:].lower())
    StimulusError.require(
        0 < len(mesh.faces) <= _MOST_TRIANGLES and np.isfinite(mesh.vertices).all(),
        f"a mesh must have 1 to {_MOST_TRIANGLES} triangles between finite points, got "
        f"{len(mesh.faces)} triangles [{path.name}]",
    )
    mesh.apply_scale(scale)
    size = float(mesh.extents.max())
    StimulusError.require(
        _SMALLEST <= size <= _LARGEST,
        f"unit must make the mesh a tooth of {_SMALLEST * 1e3:g} to {_LARGEST * 1e3:g} mm, "
        f"got {size * 1e3:.4g} mm [{path.name}]",
    )
    mesh.update_faces(mesh.nondegenerate_faces())
    pieces = trimesh.graph.connected_components(
        mesh.face_adjacency, nodes=np.arange(len(mesh.faces))
    )
    picked = np.asarray(margin, dtype=np.float64) * scale
    longest = float(mesh.edges_unique_length.max())
    points = [mesh.vertices[np.unique(mesh.faces[piece])] for piece in pieces]
    beside = cKDTree(np.concatenate(points)).query(picked)[0] - longest
    StimulusError.require(
        beside.max() <= _BESIDE,
        f"margin must lie on the mesh within {_BESIDE * 1e3:g} mm, got "
        f"{beside.max() * 1e3:.3g} mm off at point {int(beside.argmax()) + 1} [{path.name}]",
    )
    line = _read_closed_line(picked, path)
    around = line(np.linspace(0.0, line.x[-1], 500))
    # debris and loose islands are no side of a margin: tooth and crown go along most of its line
    shares = [float((cKDTree(one).query(around)[0] < _FITTED + longest).mean()) for one in points]
    least = min(_COVERED, max(shares))
    mesh.update_faces(
        np.concatenate(
            [piece for piece, share in zip(pieces, shares, strict=True) if share >= least]
        )
    )
    mesh.remove_unreferenced_vertices()
    return mesh, line, around


def _read_closed_line(points: Array, path: Path) -> Any:
    # Smooth closed line through points, over the length of their chords
    from scipy.interpolate import CubicSpline

    line = np.vstack([points, points[:1]])
    chords = np.linalg.norm(np.diff(line, axis=0), axis=1)
    StimulusError.require(
        len(points) >= 3 and chords.min() != 0.0 and chords.max() <= chords.sum() / 3.0,
        "margin must close round the tooth, no two neighbours further apart than a third "
        f"of it, got {len(points)} points [{path.name}]",
    )
    at = np.concatenate([[0.0], np.cumsum(chords)])
    if len(points) > _MOST_KNOTS:
        knots = np.linspace(0.0, at[-1], _MOST_KNOTS + 1)
        line = np.column_stack([np.interp(knots, at, axis, period=at[-1]) for axis in line.T])
        at = knots
    return CubicSpline(at, line, bc_type="periodic")


def _find_section_axes(place: Array, along: Array, middle: Array, draw: Array) -> Array:
    # Find the axes of a section: across to the crown, outwards, along the margin; shape (3, 3)
    outward = np.cross(along, draw)
    outward *= math.copysign(
        1.0 / float(np.linalg.norm(outward)), float(outward @ (place - middle))
    )
    across = np.cross(outward, along)
    across *= math.copysign(1.0 / float(np.linalg.norm(across)), float(across @ draw))
    return np.stack([across, outward, along])


def _cut_section(mesh: object, near: NDArray[np.int64], place: Array, axes: Array) -> Array:
    # Find the outermost points (x to the crown, z outwards) of a section, shape (n, 2)
    import trimesh

    across, outward, along = axes
    cut = trimesh.intersections.mesh_plane(mesh, along, place, local_faces=near) - place
    x, z = cut @ across, cut @ outward
    upright = x[:, 0] == x[:, 1]
    (x0, x1), (z0, z1) = x[~upright].T, z[~upright].T
    where = np.linspace(-2.0 * _FITTED, 2.0 * _FITTED, 4 * _SAMPLES)
    share = (where[:, None] - x0) / (x1 - x0)
    crossed = np.where((share >= 0.0) & (share <= 1.0), z0 + share * (z1 - z0), -np.inf)
    top = crossed.max(axis=1, initial=-np.inf)
    return np.asarray(np.column_stack([where, top])[top > -2.0 * _FITTED])


def _fit_sections(sections: list[Array], shows: str) -> tuple[str, list[float], Array]:
    # Find the missing side, if any; curvature of the tooth, slope of the crown, scatter; and in the
    # frame of the middle section the origin and the axes of the level one
    # sections share their shape, each at a level of its own, in a frame turned until the tooth, or
    # else the crown, is level
    points = np.concatenate(sections)
    which = np.repeat(np.arange(_SECTIONS), [len(one) for one in sections])
    fit = np.zeros(_SECTIONS + 4)
    scatter = 0.0
    origin, axes = np.zeros(2), np.eye(2)
    for _ in range(6):  # the turn converges by a factor of a hundred each time
        within = np.abs(points[:, 0]) <= _FITTED
        sides = {"tooth": within & (points[:, 0] < 0.0), "crown": within & (points[:, 0] > 0.0)}
        sides = {name: side for name, side in sides.items() if shows in (name, "both")}
        for name, side in sides.items():
            if side.sum() < _COVERED * _SAMPLES * _SECTIONS:
                return name, [], axes
        kept = np.any(list(sides.values()), axis=0)
        x, z = points[kept].T
        own = which[kept][:, None] == np.arange(_SECTIONS)
        bows = [np.where(side, x**k / k, 0.0) for side in (x < 0.0, x > 0.0) for k in (1, 2)]
        columns = np.column_stack([own, *bows])
        used = np.ones(len(x), dtype=bool)
        for _ in range(3):
            fit = np.linalg.lstsq(columns[used], z[used], rcond=None)[0]
            rest = z - columns @ fit
            scatter = float(np.std(rest[used]))
            used = np.abs(rest) <= max(_OUTLYING * 1.4826 * float(np.median(np.abs(rest))), 1e-9)
        turn = math.atan(fit[-4 if "tooth" in sides else -2])
        c, s = math.cos(turn), math.sin(turn)
        points[:, 1] -= fit[which]
        points = points @ np.array([[c, -s], [s, c]])
        origin = origin + fit[_SECTIONS // 2] * axes[1]
        axes = np.array([[c, s], [-s, c]]) @ axes
    tooth, slope, crown = map(float, fit[-3:])
    lean = math.atan(slope) if shows == "both" else 0.0
    return "", [tooth, lean, crown, scatter], np.vstack([origin, axes])
