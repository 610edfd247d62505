"""Dimensions measured on a triangle mesh: levels, walls, spheres, volume, closedness."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_ALONG_EDGE = 1e-3  # least extent along y of a triangle on a wall of the junction [m]
_ON_EDGE = 0.2e-6  # how far from an edge a vertex may be and still belong to it [m]


@dataclass(eq=False)
class MeshMeasures:
    """A mesh as it was read, with what can be measured on it."""

    vertices: Floats  # points [m], shape (n, 3)
    triangles: NDArray[np.int64]  # indices of the corners, shape (m, 3)

    @cached_property
    def _normals_and_areas(self) -> tuple[Floats, Floats]:
        corners = self.vertices[self.triangles]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(doubled, axis=1)
        units = np.divide(
            doubled, lengths[:, None], out=np.zeros_like(doubled), where=lengths[:, None] > 0.0
        )
        return units, 0.5 * lengths

    @property
    def radii(self) -> Floats:
        """Distances of the vertices from the axis of z [m]."""
        return np.hypot(self.vertices[:, 0], self.vertices[:, 1])

    @cached_property
    def volume(self) -> float:
        """Volume that it encloses [m^3]; negative if it is wound inwards."""
        middle = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        corners = (self.vertices - middle)[self.triangles]
        terms = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        return math.fsum(terms.tolist()) / 6.0

    def count_bad_edges(self) -> int:
        """Count the directed edges that do not meet exactly one neighbour running the other way."""
        triangles = self.triangles
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        span = int(triangles.max()) + 1
        forward, backward = edges[:, 0] * span + edges[:, 1], edges[:, 1] * span + edges[:, 0]
        keys, counts = np.unique(forward, return_counts=True)
        return int(np.count_nonzero(~np.isin(keys, backward) | (counts != 1)))

    def measure_level_beside(self, edge: float, side: int) -> float:
        """Measure the height of the level face beside a line across x [m].

        `side` is 1 to the right of the line and -1 to the left of it.
        """
        normals, areas = self._normals_and_areas
        x, z = self.vertices[self.triangles, 0], self.vertices[self.triangles, 2]
        nearest = (side * (x - edge)).min(axis=1)
        chosen = (normals[:, 2] > 1.0 - 1e-6) & (nearest > -_ON_EDGE) & (nearest < _ON_EDGE)
        return (
            float(np.average(z[chosen].mean(axis=1), weights=areas[chosen]))
            if chosen.any()
            else math.nan
        )

    def start_of_level(self, level: float, within: float = 0.5e-6) -> float:
        """Where the level face that reaches the right end of a block begins [m]."""
        from trimesh.graph import connected_component_labels

        normals, _ = self._normals_and_areas
        near = np.abs(self.vertices[self.triangles, 2] - level).max(axis=1) < within
        chosen = self.triangles[(normals[:, 2] > 1.0 - 1e-6) & near]
        if not len(chosen):
            return math.nan
        count = len(self.vertices)
        label = connected_component_labels(np.concatenate([chosen[:, :2], chosen[:, 1:]]), count)
        x = np.where(np.isin(np.arange(count), chosen), self.vertices[:, 0], -np.inf)
        return float(self.vertices[label == label[int(np.argmax(x))], 0].min())

    def measure_wall_position(self, facing: int, reach: float) -> float:
        """Find the deepest upright wall across x near the edge [m]; its normal is +x or -x."""
        normals, areas = self._normals_and_areas
        x = self.vertices[self.triangles, 0].mean(axis=1)
        chosen = (
            # the walls of engraved letters are short
            (np.ptp(self.vertices[self.triangles, 1], axis=1) > _ALONG_EDGE)
            & (facing * normals[:, 0] > 1.0 - 1e-6)
            & (np.abs(x) < reach)
            & (self.vertices[self.triangles, 2].min(axis=1) < -50e-6)
        )
        return float(np.average(x[chosen], weights=areas[chosen])) if chosen.any() else math.nan

    def fit_sphere(self, radius: float, below: float) -> tuple[float, float, float]:
        """Fit the ball of a tip on the z axis, up to a height.

        The results are radius, form and chordal error against `radius` [m].
        """
        of_ball = (self.vertices[:, 2] <= below + 1e-9) & (self.radii < 1.5 * radius)
        fitted, form = fit_sphere_radius(self.vertices[of_ball])
        on_ball = of_ball[self.triangles].all(axis=1)
        middles = self.vertices[self.triangles[on_ball]].mean(axis=1) - np.array([0.0, 0.0, radius])
        sag = radius - np.linalg.norm(middles, axis=1).min() if on_ball.any() else math.nan
        return fitted, form, float(sag)

    def measure_concavity(self) -> float:
        """How far the farthest vertex stands out of the plane of any triangle [m]."""
        normals, areas = self._normals_and_areas
        real = areas > 1e-6 * areas.max()
        offsets = np.einsum("ij,ij->i", normals[real], self.vertices[self.triangles[real, 0]])
        return float(max((normals[real] @ self.vertices.T - offsets[:, None]).max(), 0.0))


def fit_sphere_radius(vertices: Floats) -> tuple[float, float]:
    """Least-squares sphere through the vertices of a tip's ball."""
    if len(vertices) < 5:
        return math.nan, math.nan
    # solve in units of the ball, where the squares are of order one
    scale = float(np.ptp(vertices, axis=0).max())
    p = vertices / scale
    solution, *_ = np.linalg.lstsq(
        np.column_stack([2.0 * p, np.ones(len(p))]), (p * p).sum(axis=1), rcond=None
    )
    centre = solution[:3]
    radius = math.sqrt(solution[3] + centre @ centre)
    return radius * scale, float(np.abs(np.linalg.norm(p - centre, axis=1) - radius).max()) * scale
