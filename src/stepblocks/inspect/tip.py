"""Radius and form of a probe tip.

A sphere is fitted to the heights of the cap of a map, a circle to those of a profile.

The noise of a scan is along z and correlated. So the sphere is fitted to heights, with the forms
that leave its curvature alone (astigmatism, coma), and its uncertainty goes through the
autocovariance of the residuals.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Estimate, estimate_linear, find_outliers
from stepblocks.scans.scan import HeightMap, ScannedProfile

# reach of the cap that is fitted, as a part of the nominal radius [1]: 44 degrees of the ball,
# clear of the cone
_CAP = 0.7
_MOST_ACROSS = 256  # points of a map along either side that are fitted; of more, every so many
_CENTRINGS = 4


@dataclass(frozen=True)
class Cap:
    """Sphere through the cap of a tip."""

    radius: Estimate  # m
    form: float  # peak to valley of the distances from the sphere, noise included [m]
    cap_angle: float  # half angle of the cap [rad]
    rejected: int  # points left out as spikes
    points: int  # of the cap, with these
    # position, height and fit along the row with most of the cap [m]
    drawn: tuple[Array, Array, Array]


def fit_cap(scan: ScannedProfile | HeightMap, nominal: float, reach: float = _CAP) -> Cap:
    """Fit a sphere, or a circle, to the heights around the apex.

    `reach` is a share of the nominal radius [1].
    """
    if isinstance(scan, ScannedProfile):
        x, z = scan.position[np.newaxis, :], scan.height[np.newaxis, :]
        y = np.zeros_like(x)
    else:
        thin = tuple(max(size // _MOST_ACROSS, 1) for size in scan.height.shape)
        x, y = np.meshgrid(scan.x[:: thin[1]], scan.y[:: thin[0]])
        z = scan.height[:: thin[0], :: thin[1]]
    flat = len(z) == 1
    asked = f"a cap of a ball of about {nominal * 1e6:.4g} um"
    top = z > np.nanmax(z) - 0.02 * nominal
    place = float(np.median(x[top])), float(np.median(y[top]))
    # the apex by the fit, since the highest points lie on a slope of noise
    for _ in range(_CENTRINGS):
        face = (np.hypot(x - place[0], y - place[1]) < reach * nominal) & np.isfinite(z)
        MetrologyError.require(
            face.sum() >= 10,
            f"tip must show at least 10 points of its cap, got {int(face.sum())} [{scan.source}]",
        )
        state = _fit_algebraic(np.stack([x[face], y[face], z[face]], axis=1), nominal, flat)
        place = state[0], state[1]
    used = face.copy()
    for left in reversed(range(20)):
        across = state[3] ** 2 - (x - state[0]) ** 2 - (y - state[1]) ** 2
        MetrologyError.require(
            (across[used] > 0.0).all(), f"tip must show {asked}, got none [{scan.source}]"
        )
        rise = np.sqrt(np.where(used, across, 1.0))
        residuals = np.where(used, z - state[2] - rise, np.nan)
        u, v = (x - state[0]) / (reach * nominal), (y - state[1]) / (reach * nominal)
        columns = [(x - state[0]) / rise, np.ones_like(rise), state[3] / rise]
        if not flat:
            columns += [
                (y - state[1]) / rise,
                u * u - v * v,
                u * v,
                u * (u * u + v * v),
                v * (u * u + v * v),
            ]
        design = np.stack([np.where(used, column, 0.0) for column in columns])
        weights = np.linalg.pinv(design[:, used].T)
        solution = weights @ residuals[used]
        residuals -= np.tensordot(solution, design, 1)
        step = np.array([solution[0], 0.0 if flat else solution[3], solution[1], solution[2]])
        state += step
        # after the fit, since the start knows no form, and form is no spike
        spikes = find_outliers(residuals, used)
        if not left or (np.abs(step).max() < 1e-9 * state[3] and not spikes.any()):
            break
        used &= ~spikes
    MetrologyError.require(
        used.sum() >= 2 * len(design) and 0.2 < state[3] / nominal < 5.0,
        f"tip must show {asked}, got {int(used.sum())} points on one of "
        f"{state[3] * 1e6:.4g} um [{scan.source}]",
    )
    spread = np.zeros(z.shape)
    spread[used] = weights[2]
    radius = estimate_linear(float(state[3]), spread, residuals, used, design)
    outward = np.stack([x - state[0], y - state[1], z - state[2]])[:, used]
    distance = np.linalg.norm(outward, axis=0)
    axis = outward.mean(axis=1) / np.linalg.norm(outward.mean(axis=1))
    cap_angle = float(np.arccos(np.clip((axis @ (outward / distance)).min(), -1.0, 1.0)))
    row = int(np.argmax(used.sum(axis=1)))
    circle = state[2] + np.sqrt(
        np.maximum(state[3] ** 2 - (x[row] - state[0]) ** 2 - (y[row] - state[1]) ** 2, 0.0)
    )
    return Cap(
        radius,
        float(np.ptp(distance)),
        cap_angle,
        int(face.sum() - used.sum()),
        int(face.sum()),
        (x[row], z[row], np.where(used[row], circle, np.nan)),
    )


def _fit_algebraic(points: Array, unit: float, flat: bool) -> Array:
    # Centre and radius [m] of the sphere ``|p|^2 = 2 c p + q`` through points of shape (n, 3), or
    # of a circle over x.
    origin = points.mean(axis=0)
    p = (points - origin) / unit
    design = np.column_stack([2.0 * (p[:, ::2] if flat else p), np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(design, np.sum(p**2, axis=1), rcond=1e-10)
    squared = float(solution[-1] + solution[:-1] @ solution[:-1])
    MetrologyError.require(
        rank >= design.shape[1] and 0.0 < squared <= 1e8,
        "points must determine a sphere, got points on a plane or a line",
    )
    centre = np.array([solution[0], 0.0, solution[1]]) if flat else solution[:3]
    return np.append(centre * unit + origin, np.sqrt(squared) * unit)
