"""Dimensions measured on a triangle mesh: levels, walls, spheres, volume, closedness."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_ALONG_EDGE = 1e-3  # least extent along y of a triangle on a wall of the junction [m]
_ON_EDGE = 0.2e-6  # how far from an edge a vertex may be and still belong to it [m]
_SQUARE = 1.0 - 1e-6  # least cosine of an angle to an axis that counts as along it [1]
_ON_LEVEL = 0.5e-6  # how far from a level a vertex may be and still belong to it [m]
_BELOW_ENGRAVING = -50e-6  # height that the deepest wall of a junction reaches [m]
_ROUNDING = 1e-9  # of heights [m]
_NEAR_BALL = 1.5  # radius within which vertices are those of a ball, in its radii [1]
_LEAST_AREA = 1e-6  # of a triangle whose plane is known, as a part of the largest [1]
_LEAST_POINTS = 5  # of a sphere with a form


class SphereFit(NamedTuple):
    """What was measured on a ball.

    Attributes
    ----------
    radius : float
        Of the least-squares sphere [m].
    form : float
        Largest distance of a vertex from that sphere [m].
    sag : float
        Largest chordal error against the radius that was asked for [m].
    """

    radius: float
    form: float
    sag: float


@dataclass(frozen=True)
class _Planes:
    """Planes of the triangles: unit normals, shape (m, 3), and areas [m^2], shape (m,)."""

    normals: Floats
    areas: Floats


@dataclass(eq=False)
class MeshMeasures:
    """A mesh as it was read, with what can be measured on it.

    Attributes
    ----------
    vertices : array, shape (n, 3)
        Points [m].
    triangles : array, shape (m, 3)
        Indices of the corners.
    """

    vertices: Floats
    triangles: NDArray[np.int64]

    @cached_property
    def _planes(self) -> _Planes:
        """Unit normals and areas [m^2] of the triangles."""
        corners = self.vertices[self.triangles]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(doubled, axis=1)
        normals = np.divide(
            doubled, lengths[:, None], out=np.zeros_like(doubled), where=lengths[:, None] > 0.0
        )
        return _Planes(normals, 0.5 * lengths)

    @property
    def _is_upward(self) -> NDArray[np.bool_]:
        """Which triangles face upwards, shape (m,)."""
        return np.asarray(self._planes.normals[:, 2] > _SQUARE)

    @property
    def radii(self) -> Floats:
        """Distance of each vertex from the z axis [m]."""
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
        begin, end = edges.T
        span = int(triangles.max()) + 1
        forward = begin * span + end
        backward = end * span + begin
        keys, counts = np.unique(forward, return_counts=True)
        has_neighbour = np.isin(keys, backward)
        return int(np.count_nonzero(~has_neighbour | (counts != 1)))

    def count_inward_normals(self, normals: Floats) -> int:
        """Count the stated normals, shape (m, 3) or (0, 3), that oppose the order of the corners.

        Where none is stated, it is zero, and none is counted.
        """
        if not len(normals):
            return 0
        return int(np.count_nonzero((normals * self._planes.normals).sum(axis=1) < 0.0))

    def measure_face_height_beside(self, edge_x: float, side: int) -> float:
        """Measure the height of the level face beside a line across x [m].

        Parameters
        ----------
        edge_x : float
            Where the line lies [m].
        side : {1, -1}
            1 for the face to the right of the line, -1 for the face to the left.

        Returns
        -------
        float
            Mean height [m]; nan where no level triangle touches the line.
        """
        x = self.vertices[self.triangles, 0]
        z = self.vertices[self.triangles, 2]
        nearest = (side * (x - edge_x)).min(axis=1)
        touches = (nearest > -_ON_EDGE) & (nearest < _ON_EDGE)
        chosen = self._is_upward & touches
        if not chosen.any():
            return math.nan
        heights = z[chosen].mean(axis=1)
        return float(np.average(heights, weights=self._planes.areas[chosen]))

    def find_level_face_start(self, level: float, tolerance: float = _ON_LEVEL) -> float:
        """Find where the level face that reaches the right end of a block begins [m].

        Parameters
        ----------
        level : float
            Its height [m].
        tolerance : float, optional
            How far from that height its vertices may lie [m].

        Returns
        -------
        float
            Least x of the triangles that are joined to the right end [m]; nan where there are none.
        """
        from trimesh.graph import connected_component_labels

        off = np.abs(self.vertices[self.triangles, 2] - level).max(axis=1)
        chosen = self.triangles[self._is_upward & (off < tolerance)]
        if not len(chosen):
            return math.nan
        count = len(self.vertices)
        edges = np.concatenate([chosen[:, :2], chosen[:, 1:]])
        label = connected_component_labels(edges, count)
        is_on_level = np.isin(np.arange(count), chosen)
        x = np.where(is_on_level, self.vertices[:, 0], -np.inf)
        right_end = int(np.argmax(x))
        return float(self.vertices[label == label[right_end], 0].min())

    def measure_wall_position(self, facing: int, reach: float) -> float:
        """Measure where the deepest upright wall across x near the edge lies [m].

        Parameters
        ----------
        facing : {1, -1}
            Whether its normal is +x or -x.
        reach : float
            How far from x = 0 it may lie [m].

        Returns
        -------
        float
            Mean x [m]; nan where there is no such wall.
        """
        corners = self.vertices[self.triangles]
        x = corners[:, :, 0].mean(axis=1)
        # the walls of engraved letters are short
        is_long = np.ptp(corners[:, :, 1], axis=1) > _ALONG_EDGE
        is_upright = facing * self._planes.normals[:, 0] > _SQUARE
        is_near = np.abs(x) < reach
        is_deep = corners[:, :, 2].min(axis=1) < _BELOW_ENGRAVING
        chosen = is_long & is_upright & is_near & is_deep
        if not chosen.any():
            return math.nan
        return float(np.average(x[chosen], weights=self._planes.areas[chosen]))

    def fit_sphere(self, radius: float, ball_end_height: float) -> SphereFit:
        """Fit the ball of a tip on the z axis.

        Parameters
        ----------
        radius : float
            The radius that was asked for [m]; the ball stands on z = 0.
        ball_end_height : float
            Height at which the ball ends [m].
        """
        is_of_ball = (self.vertices[:, 2] <= ball_end_height + _ROUNDING) & (
            self.radii < _NEAR_BALL * radius
        )
        fitted, form = fit_sphere_radius_and_form(self.vertices[is_of_ball])
        is_on_ball = is_of_ball[self.triangles].all(axis=1)
        if not is_on_ball.any():
            return SphereFit(fitted, form, math.nan)
        centre = np.array([0.0, 0.0, radius])
        middles = self.vertices[self.triangles[is_on_ball]].mean(axis=1) - centre
        sag = radius - np.linalg.norm(middles, axis=1).min()
        return SphereFit(fitted, form, float(sag))

    def measure_concavity(self) -> float:
        """Measure how far the farthest vertex stands out of the plane of any triangle [m]."""
        areas = self._planes.areas
        has_plane = areas > _LEAST_AREA * areas.max()
        normals = self._planes.normals[has_plane]
        points = self.vertices[self.triangles[has_plane, 0]]
        offsets = np.einsum("ij,ij->i", normals, points)
        farthest = (normals @ self.vertices.T - offsets[:, None]).max()
        return float(max(farthest, 0.0))


def fit_sphere_radius_and_form(vertices: Floats) -> tuple[float, float]:
    """Fit the least-squares sphere through the vertices of a tip's ball.

    Parameters
    ----------
    vertices : array, shape (n, 3)
        Points [m].

    Returns
    -------
    radius, form : float
        Radius, and largest distance of a vertex from the sphere [m]; nan where there are too few.
    """
    if len(vertices) < _LEAST_POINTS:
        return math.nan, math.nan
    # solve in units of the ball, where the squares are of order one
    scale = float(np.ptp(vertices, axis=0).max())
    points = vertices / scale
    design = np.column_stack([2.0 * points, np.ones(len(points))])
    squares = (points * points).sum(axis=1)
    solution, *_ = np.linalg.lstsq(design, squares, rcond=None)
    centre = solution[:3]
    radius = math.sqrt(solution[3] + centre @ centre)
    distances = np.linalg.norm(points - centre, axis=1)
    form = float(np.abs(distances - radius).max())
    return radius * scale, form * scale
