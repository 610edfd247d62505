"""Dimensions measured on a triangle mesh: levels, walls, spheres, volume, closedness, winding, convexity.

All reductions run in float64 whatever the file stored.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]
_ALONG_EDGE = 1e-3  # least extent along y of a triangle on a wall of the junction [m]
_ON_EDGE = 0.2e-6  # how far from an edge a vertex may be and still belong to it [m]


def _normals(vertices: Vertices, triangles: Triangles) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    corners = vertices[triangles]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(doubled, axis=1)
    units = np.divide(doubled, lengths[:, None], out=np.zeros_like(doubled), where=lengths[:, None] > 0.0)
    return units, 0.5 * lengths


def mesh_volume(vertices: Vertices, triangles: Triangles) -> float:
    """Volume enclosed by a mesh; negative if it is wound inwards."""
    corners = (vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)))[triangles]
    terms = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return math.fsum(terms.tolist()) / 6.0


def bad_edges(triangles: Triangles) -> int:
    """Count the directed edges that do not meet exactly one neighbour running the other way."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    span = int(triangles.max()) + 1
    forward, backward = edges[:, 0] * span + edges[:, 1], edges[:, 1] * span + edges[:, 0]
    keys, counts = np.unique(forward, return_counts=True)
    lonely = ~np.isin(keys, backward)
    return int(np.count_nonzero(lonely | (counts != 1)))


def level_beside(vertices: Vertices, triangles: Triangles, edge: float, side: int) -> float:
    """Height of the level face that ends at a line across x."""
    normals, areas = _normals(vertices, triangles)
    x, z = vertices[triangles, 0], vertices[triangles, 2]
    beyond = side * (x - edge)
    chosen = (normals[:, 2] > 1.0 - 1e-6) & (beyond.min(axis=1) > -_ON_EDGE) & (beyond.min(axis=1) < _ON_EDGE)
    if not chosen.any():
        return math.nan
    return float(np.average(z[chosen].mean(axis=1), weights=areas[chosen]))


def start_of_level(vertices: Vertices, triangles: Triangles, level: float, within: float = 0.5e-6) -> float:
    """Where the level face that reaches the right end of a block begins."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    normals, _ = _normals(vertices, triangles)
    near = np.abs(vertices[triangles, 2] - level).max(axis=1) < within
    level_triangles = triangles[(normals[:, 2] > 1.0 - 1e-6) & near]
    if not len(level_triangles):
        return math.nan
    a, b = level_triangles[:, [0, 1]].ravel(), level_triangles[:, [1, 2]].ravel()
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(len(vertices), len(vertices)))
    _, label = connected_components(graph, directed=False)
    x = np.where(np.isin(np.arange(len(vertices)), level_triangles), vertices[:, 0], -np.inf)
    return float(vertices[label == label[int(np.argmax(x))], 0].min())


def wall_position(vertices: Vertices, triangles: Triangles, facing: int, reach: float) -> float:
    """Position of the deepest upright wall across x near the edge."""
    normals, areas = _normals(vertices, triangles)
    x, z = vertices[triangles, 0].mean(axis=1), vertices[triangles, 2]
    along = np.ptp(vertices[triangles, 1], axis=1) > _ALONG_EDGE  # the walls of engraved letters are short
    chosen = along & (facing * normals[:, 0] > 1.0 - 1e-6) & (np.abs(x) < reach) & (z.min(axis=1) < -50e-6)
    return float(np.average(x[chosen], weights=areas[chosen])) if chosen.any() else math.nan


def sphere_radius(vertices: Vertices) -> tuple[float, float]:
    """Least-squares sphere through the vertices of a tip's ball."""
    if len(vertices) < 5:
        return math.nan, math.nan
    scale = float(np.ptp(vertices, axis=0).max())  # solve in units of the ball, where the squares are of order one
    p = vertices / scale
    system = np.column_stack([2.0 * p, np.ones(len(p))])
    solution, *_ = np.linalg.lstsq(system, (p * p).sum(axis=1), rcond=None)
    centre = solution[:3]
    radius = math.sqrt(solution[3] + centre @ centre)
    form = np.abs(np.linalg.norm(p - centre, axis=1) - radius).max()
    return radius * scale, float(form) * scale


def concavity(vertices: Vertices, triangles: Triangles) -> float:
    """How far the farthest vertex stands out of the plane of any triangle."""
    normals, areas = _normals(vertices, triangles)
    real = areas > 1e-6 * areas.max()
    offsets = np.einsum("ij,ij->i", normals[real], vertices[triangles[real, 0]])
    return float(max((normals[real] @ vertices.T - offsets[:, None]).max(), 0.0))
