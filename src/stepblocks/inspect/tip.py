"""Radius and form of a probe tip: a sphere through the heights of the cap of a map along the tip's axis.

The noise of a map is along z and correlated from pixel to pixel. So the sphere is fitted to heights, and its uncertainty
goes through the autocovariance of the residual map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap
from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, NoiseUncertainty, noise_uncertainty, outlier_mask

# reach of the cap that is fitted, as a part of the nominal radius [1]: 44 degrees of the ball, clear of the cone
_CAP = 0.7


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
    state = _algebraic(np.stack([x[face], y[face], z[face]], axis=1), nominal)
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
    outward = np.stack([x - state[0], y - state[1], z - state[2]])[:, used]
    distance = np.linalg.norm(outward, axis=0)
    unit = outward / distance
    axis = unit.mean(axis=1) / np.linalg.norm(unit.mean(axis=1))
    cap_angle = float(np.arccos(np.clip((axis @ unit).min(), -1.0, 1.0)))
    return Cap(float(state[3]), noise, float(np.ptp(distance)), cap_angle, int(face.sum() - used.sum()))


def _algebraic(points: Array, unit: float) -> Array:
    """Centre and radius [m] of the sphere ``|p|^2 = 2 c p + q`` through points of shape (n, 3)."""
    origin = points.mean(axis=0)
    p = (points - origin) / unit
    solution, _, rank, _ = np.linalg.lstsq(
        np.column_stack([2.0 * p, np.ones(len(p))]), np.sum(p**2, axis=1), rcond=1e-10
    )
    squared = float(solution[3] + solution[:3] @ solution[:3])
    if rank < 4 or squared <= 0.0 or squared > 1e8:
        raise MetrologyError("points must determine a sphere, got points on a plane or a line")
    return np.append(solution[:3] * unit + origin, np.sqrt(squared) * unit)
