"""Flatness of a face and parallelism to a datum, by minimum zone (ISO 1101).

Both are found of points, and of the form without the noise.

The zone that holds all measured points grows with noise and with their number, and says little of a
face. Stated is that of the form, a polynomial of total degree three or less over what was scanned;
what noise adds to it is drawn and taken off.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import fit_without_spikes
from stepblocks.inspect.noise import Array, Estimate, Mask, estimate_linear

# largest total degree of the form [1]; lower along a side with fewer than four points per degree
_MOST_DEGREE = 3
_DRAWS = 40
_SCALES = (1.0, np.sqrt(3.0))
# ratio of the two growths from which it differs from the root of two [1]; forty draws scatter it by
# a third
_SEVERAL = 2.0
_GRID = 9  # points along either side at which the form is judged


def compute_flatness(points: Array) -> float:
    """Flatness of a face by minimum zone (ISO 1101) of its points [m], of shape (n, 3).

    Points with a nan are left out.
    """
    return _find_minimum_zone(_require_face_points(points))[0]


def compute_parallelism(points: Array, datum: Array) -> float:
    """Parallelism of a face to a datum [m], points of shape (n, 3).

    It is the width along the normal of the minimum zone of the datum.
    """
    return float(
        np.ptp(_require_face_points(points) @ _find_minimum_zone(_require_face_points(datum))[1])
    )


def _require_face_points(points: Array) -> Array:
    MetrologyError.require(
        points.ndim == 2 and points.shape[1] == 3,
        f"points must be rows of x, y, z, got shape {points.shape}",
    )
    cloud = points[np.isfinite(points).all(axis=1)]
    MetrologyError.require(
        len(cloud) >= 4
        and np.linalg.matrix_rank(cloud[:, :2] - cloud[:, :2].mean(axis=0), tol=1e-12) >= 2,
        f"points must span a face: at least 4 that are not on one line, got {len(cloud)}",
    )
    return cloud


def _find_minimum_zone(cloud: Array) -> tuple[float, Array]:
    # Width of the narrowest zone [m], and its normal: a linear programme over the corners of the
    # convex hull.
    from scipy.optimize import linprog
    from scipy.spatial import ConvexHull, QhullError

    centred = cloud - cloud.mean(axis=0)
    scale = float(np.ptp(cloud[:, :2], axis=0).max())
    design = np.column_stack([centred[:, :2] / scale, np.ones(len(cloud))])
    solution = np.linalg.lstsq(design, centred[:, 2], rcond=None)[0]
    residual = centred[:, 2] - design @ solution
    zone = 0.0
    unit = float(np.ptp(residual))
    if unit > 1e-15:
        try:
            corners = ConvexHull(np.column_stack([design[:, :2], residual / unit])).vertices
        except QhullError:
            corners = np.arange(len(cloud))
        d = design[corners]
        r = residual[corners] / unit
        result = linprog(
            [0, 0, 0, 1],
            A_ub=np.hstack([np.vstack([-d, d]), -np.ones((2 * len(d), 1))]),
            b_ub=np.concatenate([-r, r]),
            bounds=[(None, None)] * 3 + [(0, None)],
        )
        MetrologyError.require(
            result.success, f"minimum zone must be solvable, got: {result.message}"
        )
        solution, zone = solution + result.x[:3] * unit, 2.0 * float(result.x[3]) * unit
    upward = np.array([*(-solution[:2] / scale), 1.0])
    length = float(np.linalg.norm(upward))
    return zone / length, upward / length


@dataclass(frozen=True)
class FaceForm:
    """Form of one face.

    A polynomial, the covariance of its coefficients, and where it was measured.
    """

    points: Array  # shape (n, 3); measured points [m]
    grid: Array  # shape (m, 2); positions over the face at which the form is judged [m]
    columns: Array  # shape (k, m); terms of the polynomial there [1]
    solution: Array  # shape (k,); coefficients [m]
    root: Array  # shape (k, k); rows whose products add up to their covariance [m]
    dof: float  # degrees of freedom of that covariance
    degree: int  # total degree

    def shape(self, added: Array | float = 0.0) -> Array:
        """Return the form as points [m], with `added` [m] on its coefficients."""
        return np.column_stack([self.grid, (self.solution + added) @ self.columns])

    def draws(self, random: np.random.Generator) -> list[Array]:
        """Return what noise may have added to the coefficients [m].

        It gives every draw and its mirror image.
        """
        # With mirror images the mean over the draws keeps only what curves, and that is the growth.
        half = random.normal(size=(_DRAWS // 2, len(self.root))) @ self.root
        return [*half, *-half]


def fit_face(x: Array, y: Array, height: Array, face: Mask) -> FaceForm:
    """Fit the form of a face of a map.

    `height` and `face` have the shape (ny, nx) over columns `x` and rows `y` [m].
    """
    used = face & np.isfinite(height)
    rows, columns = np.flatnonzero(used.any(axis=1)), np.flatnonzero(used.any(axis=0))
    MetrologyError.require(
        used.sum() >= 20 and len(rows) >= 2 and len(columns) >= 2,
        f"face must have at least 20 points on two rows and columns, got {int(used.sum())}",
    )
    mx, my = np.meshgrid(x, y)
    points = np.stack([mx[used], my[used], height[used]], axis=1)
    sides = (x[columns[0]], x[columns[-1]]), (y[rows[0]], y[rows[-1]])
    middles, halves = (
        [0.5 * (begin + end) for begin, end in sides],
        [0.5 * (end - begin) for begin, end in sides],
    )
    degrees = [min(_MOST_DEGREE, max(len(index) // 4, 1)) for index in (columns, rows)]
    powers = [
        (i, j)
        for i in range(degrees[0] + 1)
        for j in range(degrees[1] + 1)
        if i + j <= max(degrees)
    ]
    design = _evaluate_terms(
        (x[np.newaxis, :] - middles[0]) / halves[0],
        (y[:, np.newaxis] - middles[1]) / halves[1],
        powers,
    )
    fit = fit_without_spikes(design.reshape(len(design), -1), height.ravel(), used.ravel())
    kept, residuals = fit.used.reshape(height.shape), fit.residuals.reshape(height.shape)
    count = float(kept.sum())
    # for terms that vary little over the correlation length, the covariance is that of white noise
    # times one factor
    mean = estimate_linear(0.0, kept / count, residuals, kept, design)
    # not by eigenvectors, whose signs hang on the last bit: the draws would
    root = np.linalg.cholesky(fit.weights @ fit.weights.T).T * (mean.std * np.sqrt(count))
    gx, gy = (one.ravel() for one in np.meshgrid(*[np.linspace(-1.0, 1.0, _GRID)] * 2))
    grid = np.array(middles) + np.array(halves) * np.column_stack([gx, gy])
    # of a face that does not fill its rectangle, as in a turned map, only where it lies
    at = [
        np.searchsorted(axis, one).clip(0, len(axis) - 1)
        for axis, one in zip((x, y), grid.T, strict=True)
    ]
    inside = face[at[1], at[0]]
    gx, gy, grid = gx[inside], gy[inside], grid[inside]
    return FaceForm(
        points,
        grid,
        _evaluate_terms(gx, gy, powers),
        fit.solution,
        root,
        mean.dof,
        degree=max(i + j for i, j in powers),
    )


def _evaluate_terms(at_x: Array, at_y: Array, powers: list[tuple[int, int]]) -> Array:
    # Return products of Legendre's polynomials at positions from -1 to 1.
    basis = np.polynomial.Legendre.basis
    return np.stack([np.asarray(basis(i)(at_x) * basis(j)(at_y)) for i, j in powers])


def estimate_zone(width: Callable[..., float], *faces: FaceForm) -> Estimate:
    """Return the zone of the form of faces, less what noise adds to it.

    What is taken off counts in the uncertainty, as a rectangle beside the scatter.
    """
    # The fit holds the noise once, draws at the two scales hold it as its root of two and twice.
    # Where one term sets the zone, the zone grows with the standard deviation of the noise and the
    # second growth is the first times the root of two; where several do, it grows with a higher
    # power, and the power follows from the two. Either way it is followed back to no noise.
    random = np.random.default_rng(1101)
    draws = list(zip(*(face.draws(random) for face in faces), strict=True))
    once, twice = np.array(
        [
            [
                width(*[face.shape(scale * one) for face, one in zip(faces, draw, strict=True)])
                for draw in draws
            ]
            for scale in _SCALES
        ]
    )
    zone = width(*(face.shape() for face in faces))
    first, second = float(once.mean()) - zone, float(twice.mean() - once.mean())
    ratio = second / first if second > _SEVERAL * first > 0.0 else np.sqrt(2.0)
    growth = min(max(first / (ratio - 1.0), 0.0), zone)
    return Estimate(
        zone - growth,
        float(np.hypot(once.std(ddof=1), growth / np.sqrt(3.0))),
        min(face.dof for face in faces),
    )
