"""Radius and form of a probe tip: a sphere through points, and through the cap of a height map along the tip's axis.

The noise of a map is along z and correlated from pixel to pixel. So there the sphere is fitted to heights and its uncertainty
goes through the autocovariance of the residual map, where the orthogonal fit takes independent points; that fit gives the
start, finds spikes, and its form is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap
from stepblocks.errors import MetrologyError
from stepblocks.inspect.form import known_points
from stepblocks.inspect.noise import Array, NoiseUncertainty, noise_uncertainty, outlier_mask

# reach of the cap that is fitted, as a part of the nominal radius [1]: 44 degrees of the ball, clear of the cone
_CAP = 0.7


@dataclass(frozen=True)
class Sphere:
    """Least-squares sphere."""

    radius: float  # m
    radius_std: float  # standard uncertainty from the scatter of the points [m]
    centre: tuple[float, float, float]  # m
    form: float  # peak to valley of the distances from the sphere (sphericity, least squares) [m]
    rejected: int  # points left out as spikes
    cap_angle: float  # half angle of the cap that the points cover [rad]


@dataclass(frozen=True)
class Cap:
    """Sphere through the cap of a tip."""

    radius: float  # m
    noise: NoiseUncertainty  # uncertainty of the radius from noise and roughness [m]
    form: float  # peak to valley of the distances from the sphere, noise included [m]
    cap_angle: float  # half angle of the cap [rad]
    rejected: int  # points left out as spikes


def fit_cap(scan: HeightMap, nominal: float) -> Cap:
    """Fit a sphere to the heights of the cap of a tip, within 0.7 of its nominal radius [m] around the apex."""
    x, y = np.meshgrid(scan.x, scan.y)
    z = scan.height
    top = z > np.nanmax(z) - 0.02 * nominal
    face = (np.hypot(x - x[top].mean(), y - y[top].mean()) < _CAP * nominal) & np.isfinite(z)
    sphere = fit_sphere(np.stack([x[face], y[face], z[face]], axis=1))
    state = np.array([*sphere.centre, sphere.radius])
    used = face.copy()
    for _ in range(20):
        across = state[3] ** 2 - (x - state[0]) ** 2 - (y - state[1]) ** 2
        if not (across[used] > 0.0).all():
            cap = f"a cap of a ball of about {nominal * 1e6:.4g} um"
            raise MetrologyError(f"tip must show {cap}, got none [{scan.source}]")
        rise = np.sqrt(np.where(used, across, 1.0))
        residuals = np.where(used, z - state[2] - rise, np.nan)
        spikes = outlier_mask(residuals, used)
        used &= ~spikes
        columns = (x - state[0]) / rise, (y - state[1]) / rise, np.ones_like(rise), state[3] / rise
        design = [np.where(used, column, 0.0) for column in columns]
        inverse = np.linalg.inv(np.array([[np.sum(a * b) for b in design] for a in design]))
        weights = np.tensordot(inverse, np.stack(design), 1)
        step = np.sum(weights[:, used] * residuals[used], axis=1)
        state += step
        if np.abs(step).max() < 1e-12 * state[3] and not spikes.any():
            break
    noise = noise_uncertainty(weights[3], residuals, used, design)
    return Cap(float(state[3]), noise, sphere.form, sphere.cap_angle, int(face.sum() - used.sum()))


def fit_sphere(points: Array) -> Sphere:
    """Fit a sphere by orthogonal distances to points of shape (n, 3) [m].

    Levenberg-Marquardt of ``|p - c| - R`` from the algebraic fit ``|p|^2 = 2 c p + q``; spikes beyond five robust standard
    deviations are left out and counted. Independent errors of the points are assumed; over a cap of half angle t the
    uncertainty of R grows as 1 / t^2.
    """
    from scipy.optimize import least_squares

    cloud = known_points(points)
    if len(cloud) < 10:
        raise MetrologyError(f"sphere must have at least 10 points, got {len(cloud)}")
    origin = cloud.mean(axis=0)
    scale = float(np.linalg.norm(cloud - origin, axis=1).max())
    if scale <= 0.0:
        raise MetrologyError("sphere must have points apart from one another")
    p = (cloud - origin) / scale
    keep = np.ones(len(p), dtype=bool)
    for _ in range(5):
        start = _algebraic(p[keep])
        fitted = least_squares(_distances, start, args=(p[keep],), method="lm", x_scale=1.0)
        off = outlier_mask(fitted.fun * scale)
        if not off.any():
            break
        keep[keep] = ~off
    centre, radius = fitted.x[:3], float(fitted.x[3])
    variance = float(np.sum(fitted.fun**2)) / max(int(keep.sum()) - 4, 1)
    covariance = np.linalg.inv(fitted.jac.T @ fitted.jac) * variance
    outward = (p[keep] - centre) / np.linalg.norm(p[keep] - centre, axis=1)[:, np.newaxis]
    axis = outward.mean(axis=0)
    axis /= np.linalg.norm(axis)
    x, y, z = (centre * scale + origin).tolist()
    return Sphere(
        radius=radius * scale,
        radius_std=float(np.sqrt(covariance[3, 3])) * scale,
        centre=(x, y, z),
        form=float(np.ptp(fitted.fun)) * scale,
        rejected=int((~keep).sum()),
        cap_angle=float(np.arccos(np.clip((outward @ axis).min(), -1.0, 1.0))),
    )


def _algebraic(p: Array) -> Array:
    design = np.column_stack([2.0 * p, np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(design, np.sum(p**2, axis=1), rcond=1e-10)
    squared = float(solution[3] + solution[:3] @ solution[:3])
    if rank < 4 or squared <= 0.0 or squared > 1e8:
        raise MetrologyError("points must determine a sphere, got points on a plane or a line")
    return np.append(solution[:3], np.sqrt(squared))


def _distances(parameters: Array, p: Array) -> Array:
    return np.asarray(np.linalg.norm(p - parameters[:3], axis=1) - parameters[3])
