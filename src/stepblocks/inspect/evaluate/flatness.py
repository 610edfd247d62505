"""Flatness of a face and parallelism to a datum, by minimum zone.

Minimum zone is what ISO 1101 defines: the least distance of two parallel planes that hold all points. It is a linear
programme, solved by scipy's HiGHS. The least-squares deviation, which instruments often print, is never smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.errors import MetrologyError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plane:
    """Plane ``z = slope_x x + slope_y y + offset`` through a face."""

    slope_x: float  # Slopes [1]
    slope_y: float
    offset: float  # Height at the origin [m]
    zone: float  # Width of the zone around it that holds every point, along the normal [m]
    zone_least_squares: float  # The same about the least-squares plane [m]


def _points(points: ArrayLike) -> Array:
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise MetrologyError(f"points must be rows of x, y, z, got shape {cloud.shape}")
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if len(cloud) < 4 or np.linalg.matrix_rank(cloud[:, :2] - cloud[:, :2].mean(axis=0), tol=1e-12) < 2:
        raise MetrologyError(f"points must span a face: at least 4 that are not on one line, got {len(cloud)}")
    return cloud


def flatness(points: ArrayLike) -> Plane:
    """Flatness of a face by minimum zone.

    Examples
    --------
    >>> import numpy as np
    >>> x, y = np.meshgrid(np.arange(5) * 1e-3, np.arange(4) * 1e-3)
    >>> z = 0.01 * x + np.where((x == 2e-3) & (y == 1e-3), 1e-6, 0.0)
    >>> round(flatness(np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)).zone * 1e6, 3)
    1.0
    """
    from scipy.optimize import linprog
    from scipy.spatial import ConvexHull, QhullError

    cloud = _points(points)
    centre, scale = cloud.mean(axis=0), float(np.ptp(cloud[:, :2], axis=0).max())
    design = np.column_stack([(cloud[:, :2] - centre[:2]) / scale, np.ones(len(cloud))])
    solution = np.linalg.lstsq(design, cloud[:, 2] - centre[2], rcond=None)[0]
    residual = cloud[:, 2] - centre[2] - design @ solution
    unit = float(np.ptp(residual))
    if unit <= 1e-15:
        return _plane(solution, centre, scale, 0.0, 0.0)
    reduced = np.column_stack([design[:, :2], residual / unit])
    try:
        corners = ConvexHull(reduced).vertices  # only the hull can touch the zone
    except QhullError:
        corners = np.arange(len(cloud))
    d, r = design[corners], residual[corners] / unit
    ones = np.ones((len(d), 1))
    bounds = np.vstack([np.hstack([-d, -ones]), np.hstack([d, -ones])])
    result = linprog([0, 0, 0, 1], A_ub=bounds, b_ub=np.concatenate([-r, r]), bounds=[(None, None)] * 3 + [(0, None)])
    if not result.success:
        raise MetrologyError(f"minimum zone must be solvable, got: {result.message}")
    correction = result.x[:3] * unit
    return _plane(solution + correction, centre, scale, 2.0 * float(result.x[3]) * unit, unit)


def _plane(solution: Array, centre: Array, scale: float, zone: float, least_squares: float) -> Plane:
    slope_x, slope_y = float(solution[0]) / scale, float(solution[1]) / scale
    offset = float(solution[2] + centre[2] - slope_x * centre[0] - slope_y * centre[1])
    normal = (1.0 + slope_x**2 + slope_y**2) ** 0.5
    return Plane(slope_x, slope_y, offset, zone / normal, least_squares / normal)


def parallelism(points: ArrayLike, datum: Plane) -> float:
    """Parallelism of a face to a datum plane: the width along the datum's normal that holds every point."""
    cloud = _points(points)
    above = cloud[:, 2] - datum.slope_x * cloud[:, 0] - datum.slope_y * cloud[:, 1]
    return float(np.ptp(above) / (1.0 + datum.slope_x**2 + datum.slope_y**2) ** 0.5)
