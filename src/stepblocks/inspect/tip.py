"""Radius and form of a probe tip: a sphere through the heights of the cap of a map, or a circle through those of a profile.

The noise of a scan is along z and correlated. So the sphere is fitted to heights, with the forms
that leave its curvature alone (astigmatism, coma), and its uncertainty goes through the
autocovariance of the residuals.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import null_space

from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Estimate, Mask, estimate_linear, find_outliers

# reach of the cap that is fitted, as a part of the nominal radius [1]: 44 degrees of the ball,
# clear of the cone
_CAP = 0.7
_MOST_ACROSS = 256  # points of a map along either side that are fitted; of more, every so many
_CENTRINGS = 4
_FEW = (
    4.0  # degrees of freedom below which the residuals are too smooth for their autocovariance [1]
)
_CELLS = 150  # into which such residuals are averaged
_KEPT = 0.5  # part of the usual number of points, from which a cell counts [1]
_POWERS = (
    1.0,
    1.5,
    2.0,
)  # of the lag in the laws of correlation that are tried, from ragged to smooth [1]


@dataclass(frozen=True)
class Cap:
    """Sphere through the cap of a tip."""

    radius: Estimate  # m
    form: float  # peak to valley of the distances from the sphere, noise included [m]
    cap_angle: float  # half angle of the cap [rad]
    rejected: int  # points left out as spikes
    points: int  # of the cap, with these
    drawn: tuple[
        Array, Array, Array
    ]  # position, height and fit along the row with most of the cap [m]


def fit_cap(scan: Profile | HeightMap, nominal: float, reach: float = _CAP) -> Cap:
    """Fit a sphere, or a circle, to the heights within `reach` of the nominal radius [m] around the apex."""
    if isinstance(scan, Profile):
        x, y, z = (
            scan.position[np.newaxis, :],
            np.zeros((1, len(scan.position))),
            scan.height[np.newaxis, :],
        )
    else:
        thin = tuple(max(size // _MOST_ACROSS, 1) for size in scan.height.shape)
        (x, y), z = (
            np.meshgrid(scan.x[:: thin[1]], scan.y[:: thin[0]]),
            scan.height[:: thin[0], :: thin[1]],
        )
    flat = len(z) == 1
    asked = f"a cap of a ball of about {nominal * 1e6:.4g} um"
    top = z > np.nanmax(z) - 0.02 * nominal
    place = float(np.median(x[top])), float(np.median(y[top]))
    for _ in range(
        _CENTRINGS
    ):  # the apex by the fit, since the highest points lie on a slope of noise
        face = (np.hypot(x - place[0], y - place[1]) < reach * nominal) & np.isfinite(z)
        if face.sum() < 10:
            raise MetrologyError(
                f"tip must show at least 10 points of its cap, got {int(face.sum())} "
                f"[{scan.source}]"
            )
        state = _fit_algebraic(np.stack([x[face], y[face], z[face]], axis=1), nominal, flat)
        place = state[0], state[1]
    used = face.copy()
    for left in reversed(range(20)):
        across = state[3] ** 2 - (x - state[0]) ** 2 - (y - state[1]) ** 2
        if not (across[used] > 0.0).all():
            raise MetrologyError(f"tip must show {asked}, got none [{scan.source}]")
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
        spikes = find_outliers(
            residuals, used
        )  # after the fit, since the start knows no form, and form is no spike
        if not left or (np.abs(step).max() < 1e-9 * state[3] and not spikes.any()):
            break
        used &= ~spikes
    if used.sum() < 2 * len(design) or not 0.2 < state[3] / nominal < 5.0:
        got = f"{int(used.sum())} points on one of {state[3] * 1e6:.4g} um"
        raise MetrologyError(f"tip must show {asked}, got {got} [{scan.source}]")
    spread = np.zeros(z.shape)
    spread[used] = weights[2]
    radius = estimate_linear(float(state[3]), spread, residuals, used, design)
    if radius.dof < _FEW:
        radius = _estimate_by_form(radius.value, x, y, residuals, used, design)
    outward = np.stack([x - state[0], y - state[1], z - state[2]])[:, used]
    distance = np.linalg.norm(outward, axis=0)
    axis = outward.mean(axis=1) / np.linalg.norm(outward.mean(axis=1))
    cap_angle = float(np.arccos(np.clip((axis @ (outward / distance)).min(), -1.0, 1.0)))
    row = int(np.argmax(used.sum(axis=1)))
    circle = state[2] + np.sqrt(
        np.maximum(state[3] ** 2 - (x[row] - state[0]) ** 2 - (y[row] - state[1]) ** 2, 0.0)
    )
    drawn = x[row], z[row], np.where(used[row], circle, np.nan)
    return Cap(
        radius,
        float(np.ptp(distance)),
        cap_angle,
        int(face.sum() - used.sum()),
        int(face.sum()),
        drawn,
    )


def _estimate_by_form(
    value: float, x: Array, y: Array, residuals: Array, used: Mask, design: Array
) -> Estimate:
    """State a radius by residuals that are mostly form: what smooth laws of correlation, each as likely as it is, say of it."""
    # Restricted likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545), which knows
    # what the fit has swallowed, over exp(-(lag / length)^power) and a white part; the logarithm of
    # the variance is the mean over all of them.
    size = int(np.ceil((used.sum() / _CELLS) ** (1.0 if len(used) == 1 else 0.5)))
    rows, columns = (one // size for one in np.nonzero(used))
    _, cell, count = np.unique(rows * used.size + columns, return_inverse=True, return_counts=True)
    kept = count >= _KEPT * np.median(count)
    means = [(np.bincount(cell, one[used]) / count)[kept] for one in (x, y, residuals, *design)]
    lag = np.hypot(*(one[:, np.newaxis] - one for one in means[:2]))
    gain = np.linalg.pinv(np.stack(means[3:]).T)[2]
    free = null_space(np.stack(means[3:]))
    found = []
    for power, length in product(_POWERS, np.geomspace(np.min(lag[lag > 0.0]), lag.max(), 12)):
        law = np.exp(-((lag / length) ** power))
        values, vectors = np.linalg.eigh(free.T @ law @ free)
        squares = (vectors.T @ free.T @ means[2]) ** 2
        for white in np.geomspace(1e-6, 1.0, 7):
            seen = np.maximum(values, 0.0) + white
            scale = float(np.mean(squares / seen))
            likelihood = -0.5 * float(np.sum(np.log(seen)) + len(seen) * np.log(scale))
            found.append((likelihood, scale * float(gain @ law @ gain + white * gain @ gain)))
    likelihood, variance = np.array(found).T[0], np.log(np.array(found).T[1])
    weight = np.exp(likelihood - likelihood.max())
    mean = float(np.average(variance, weights=weight))
    # of a variance with n degrees of freedom the logarithm scatters by the root of 2 / n
    scatter = float(np.average((variance - mean) ** 2, weights=weight)) + 2.0 / free.shape[1]
    return Estimate(value, float(np.exp(0.5 * mean)), max(2.0 / scatter, 1.0))


def _fit_algebraic(points: Array, unit: float, flat: bool) -> Array:
    """Centre and radius [m] of the sphere ``|p|^2 = 2 c p + q`` through points of shape (n, 3), or of a circle over x."""
    origin = points.mean(axis=0)
    p = (points - origin) / unit
    design = np.column_stack([2.0 * (p[:, ::2] if flat else p), np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(design, np.sum(p**2, axis=1), rcond=1e-10)
    squared = float(solution[-1] + solution[:-1] @ solution[:-1])
    if rank < design.shape[1] or squared <= 0.0 or squared > 1e8:
        raise MetrologyError("points must determine a sphere, got points on a plane or a line")
    centre = np.array([solution[0], 0.0, solution[1]]) if flat else solution[:3]
    return np.append(centre * unit + origin, np.sqrt(squared) * unit)
