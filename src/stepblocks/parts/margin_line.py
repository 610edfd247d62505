"""The margin line of a scanned tooth or crown: stations along it, and how tooth and crown run on from it on either side.

A scan errs by more than a gap: what is taken from it is the slope and the curvature of either side, least squares over a
millimetre; whatever the scan shows of a gap or of a step is not. Only what the margin cannot be crossed by is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StimulusError

Array = NDArray[np.float64]
Margin = str | Sequence[Sequence[float]]
_FITTED = 1e-3  # of either side from which their shape is taken, and along the margin: a scan's noise averages out [m]
RIM = "rim"  # the margin is where the mesh ends
_MOST_BYTES, _MOST_TRIANGLES = 500_000_000, 5_000_000
_SMALLEST, _LARGEST = 2e-3, 0.15  # of what is scanned, from a short crown to a whole arch [m]
_BESIDE = 0.5e-3  # how far a picked point may lie from the scan [m]
_SAMPLES, _SECTIONS = 51, 9  # of either side of a section, and beside each other at a station: they share its shape
_COVERED = (
    1.0 / 3.0
)  # share of a side that must be there to tell its shape: a hole of 0.3 mm may lie beside the margin [1]
_OUTLYING = 4.0  # robust standard deviations beyond which a sample is debris or the edge of a hole


def stations_in(
    path: Path, scale: float, margin: Margin, count: int, towards: Sequence[float], shows: str
) -> dict[str, Any]:
    """Measure `count` sections across a margin; called in the confined process.

    Lengths of the file and of picked points times `scale` are metres; `towards` points roughly from the root to the crown, and
    the scan `shows` the tooth, the crown or both. Each row of ``stations`` is place x, y, z [m], curvature of the tooth [1/m],
    slope against the tooth [rad] and curvature of the crown, and scatter of the scan about both [m].
    """
    import trimesh

    if path.stat().st_size > _MOST_BYTES:
        raise StimulusError(f"a mesh must have at most {_MOST_BYTES} bytes, got {path.stat().st_size} [{path.name}]")
    mesh = trimesh.load_mesh(path, file_type=path.suffix[1:].lower())
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all() or len(mesh.faces) > _MOST_TRIANGLES:
        rule = f"1 to {_MOST_TRIANGLES} triangles between finite points"
        raise StimulusError(f"a mesh must have {rule}, got {len(mesh.faces)} triangles [{path.name}]")
    mesh.apply_scale(scale)
    size = float(mesh.extents.max())
    if not _SMALLEST <= size <= _LARGEST:
        rule = f"a tooth of {_SMALLEST * 1e3:g} to {_LARGEST * 1e3:g} mm"
        raise StimulusError(f"unit must make the mesh {rule}, got {size * 1e3:.4g} mm [{path.name}]")
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    pieces = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
    large = max(map(len, pieces))
    mesh.update_faces(np.isin(np.arange(len(mesh.faces)), np.concatenate([p for p in pieces if len(p) > 0.05 * large])))
    line = _rim(mesh, path) if margin == RIM else _picked(mesh, np.asarray(margin, dtype=np.float64) * scale, path)
    draw = np.linalg.svd(line - line.mean(axis=0), full_matrices=False)[2][2]
    draw *= math.copysign(1.0, float(draw @ towards))
    if draw @ towards < 0.5 * np.linalg.norm(towards):
        raise StimulusError(f"crown_towards must leave the plane of the margin by 30 deg or more [{path.name}]")
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    centres = mesh.triangles_center
    radii = np.linalg.norm(mesh.triangles - centres[:, None], axis=2).max(axis=1)
    found = []
    for number in range(count):
        where = length[-1] * number / count + np.linspace(-0.5 * _FITTED, 0.5 * _FITTED, _SECTIONS)
        place = _along(line, length, where[[_SECTIONS // 2]])[0]
        near = np.flatnonzero(np.linalg.norm(centres - place, axis=1) < 3.0 * _FITTED + radii)
        hole, sides = _sides([_section(mesh, near, *frame) for frame in _frames(line, length, where, draw)], shows)
        if hole:
            rule = f"must show a third of the {hole} within {_FITTED * 1e3:g} mm of the margin"
            raise StimulusError(f"the scan {rule}, got a hole at station {number + 1} [{path.name}]")
        found.append([*place, *sides])
    # far below what a scan tells, and the same digits on every processor
    return {
        "stations": np.array(
            [[round(value, 6 if k in (3, 4, 5) else 9) + 0.0 for k, value in enumerate(row)] for row in found]
        )
    }


def _rim(mesh: Any, path: Path) -> Array:
    """Longest closed border of an open mesh; holes have shorter ones."""
    loops = [np.asarray(loop) for loop in mesh.outline().discrete] if not mesh.is_watertight else []
    closed = [loop for loop in loops if len(loop) > 3 and np.allclose(loop[0], loop[-1])]
    if not closed:
        raise StimulusError(f"margin must be a closed rim of the mesh, or points picked on it, got none [{path.name}]")
    lengths = [float(np.linalg.norm(np.diff(loop, axis=0), axis=1).sum()) for loop in closed]
    return np.asarray(closed[int(np.argmax(lengths))])


def _picked(mesh: Any, points: Array, path: Path) -> Array:
    """Close the smooth line through picked points."""
    from scipy.interpolate import CubicSpline
    from scipy.spatial import cKDTree

    closed = np.vstack([points, points[:1]])
    chords = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    if chords.max() > chords.sum() / 3.0 or chords.min() == 0.0:
        rule = "close round the tooth, no two neighbours the same or further apart than a third of the line"
        raise StimulusError(
            f"margin must {rule}, got {chords.max() * 1e3:.3g} of {chords.sum() * 1e3:.3g} mm [{path.name}]"
        )
    beside = cKDTree(mesh.vertices).query(points)[0] - float(mesh.edges_unique_length.max())
    if beside.max() > _BESIDE:
        got = f"{beside.max() * 1e3:.3g} mm off at point {int(beside.argmax()) + 1}"
        raise StimulusError(f"margin must lie on the mesh within {_BESIDE * 1e3:g} mm, got {got} [{path.name}]")
    length = np.concatenate([[0.0], np.cumsum(chords)])
    return np.asarray(CubicSpline(length, closed, bc_type="periodic")(np.linspace(0.0, length[-1], 2001)))


def _along(line: Array, length: Array, where: Array) -> Array:
    """Places on a closed line at distances along it."""
    return np.column_stack([np.interp(where, length, axis, period=length[-1]) for axis in line.T])


def _frames(line: Array, length: Array, where: Array, draw: Array) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Place, tangent, direction out of the tooth and direction to the crown, by chords of a fiftieth of the line."""
    middle, half = line.mean(axis=0), 0.01 * length[-1]
    chords = _along(line, length, where + half) - _along(line, length, where - half)
    for place, chord in zip(_along(line, length, where), chords, strict=True):
        tangent = chord / np.linalg.norm(chord)
        outward = np.cross(tangent, draw)
        outward *= math.copysign(1.0 / float(np.linalg.norm(outward)), float(outward @ (place - middle)))
        across = np.cross(outward, tangent)
        yield place, tangent, outward, across * math.copysign(1.0, float(across @ draw))


def _section(mesh: Any, near: NDArray[np.int64], place: Array, tangent: Array, outward: Array, across: Array) -> Array:
    """Outermost points (x, z) of the section across the margin, on either side; shape (n, 2)."""
    import trimesh

    cut = trimesh.intersections.mesh_plane(mesh, tangent, place, local_faces=near) - place
    x, z = cut @ across, cut @ outward
    across_it = x[:, 0] != x[:, 1]
    (x0, x1), (z0, z1) = x[across_it].T, z[across_it].T
    where = np.linspace(-2.0 * _FITTED, 2.0 * _FITTED, 4 * _SAMPLES)[:, None]
    share = (where - x0) / (x1 - x0)
    crossed = np.where((share >= 0.0) & (share <= 1.0), z0 + share * (z1 - z0), -np.inf)
    top = crossed.max(axis=1, initial=-np.inf)
    return np.asarray(np.column_stack([where[:, 0], top])[top > -2.0 * _FITTED])


def _sides(sections: list[Array], shows: str) -> tuple[str, list[float]]:
    """Name of the side that is not there, if any; curvature of the tooth, slope and curvature of the crown, scatter.

    Sections beside each other share their shape, and each has a level of its own. The frame is turned until the tooth is level at
    the margin; where only the crown is shown, until that is.
    """
    points, which = np.concatenate(sections), np.repeat(np.arange(_SECTIONS), [len(one) for one in sections])
    fit, scatter = np.zeros(_SECTIONS + 4), 0.0
    for _ in range(6):  # the turn converges by a factor of a hundred each time
        within = np.abs(points[:, 0]) <= _FITTED
        sides = {name: within & (points[:, 0] * way > 0.0) for name, way in (("tooth", -1.0), ("crown", 1.0))}
        sides = {name: side for name, side in sides.items() if shows in (name, "both")}
        for name, side in sides.items():
            if side.sum() < _COVERED * _SAMPLES * _SECTIONS:
                return name, []
        kept = np.any(list(sides.values()), axis=0)
        (x, z), own = points[kept].T, which[kept][:, None] == np.arange(_SECTIONS)
        bows = [np.where(side, x**k / k, 0.0) for side in (x < 0.0, x > 0.0) for k in (1, 2)]
        columns, used = np.column_stack([own, *bows]), np.ones(len(x), dtype=bool)
        for _ in range(3):
            fit = np.linalg.lstsq(columns[used], z[used], rcond=None)[0]
            rest = z - columns @ fit
            scatter = float(np.std(rest[used]))
            used = np.abs(rest) <= max(_OUTLYING * 1.4826 * float(np.median(np.abs(rest))), 1e-9)
        turn = math.atan(fit[-4 if "tooth" in sides else -2])
        c, s = math.cos(turn), math.sin(turn)
        points[:, 1] -= fit[which]
        points = points @ np.array([[c, -s], [s, c]])
    tooth, slope, crown = map(float, fit[-3:])
    return "", [tooth, math.atan(slope) if shows == "both" else 0.0, crown, scatter]
