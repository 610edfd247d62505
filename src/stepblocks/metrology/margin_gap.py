"""Gap and discrepancies of a crown margin, from a profile across it.

Terms of Holmes et al. 1989 (J. Prosthet. Dent. 62:405, doi:10.1016/0022-3913(89)90170-4) for a planar junction: the two
shoulders are fitted as in the two-plane convention of a single edge; the opening lies between the points
where the profile leaves them. Horizontal opening and vertical discrepancy together give the absolute discrepancy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.errors import MetrologyError
from stepblocks.metrology.levelling import despiked, roughly_levelled, two_levels
from stepblocks.metrology.roughness_noise import autocovariance, estimator_covariance, outlier_mask

__all__ = ["Margin", "fit_margin"]

Array = NDArray[np.float64]

_LEAST_POINTS = 20


@dataclass(frozen=True)
class Margin:
    """What a profile across a margin says.

    Attributes
    ----------
    opening, opening_std : float
        Distance between the two edges along the profile, and its standard uncertainty [m].
    rise, rise_std : float
        Height of the right shoulder over the left, the vertical discrepancy [m].
    absolute : float
        Hypotenuse of both, the absolute marginal discrepancy [m].
    absolute_std : float
        Its standard uncertainty [m].
    depth : float
        How deep the profile reached into the gap, below the lower shoulder [m].
    """

    opening: float
    opening_std: float
    rise: float
    rise_std: float
    absolute: float
    absolute_std: float
    depth: float


def fit_margin(position: ArrayLike, height: ArrayLike) -> Margin:
    """Measure opening and vertical discrepancy of a margin.

    Parameters
    ----------
    position, height : array_like, shape (n,)
        Profile across the margin, equally spaced [m]; nan where a point is missing (as often inside a gap).

    Returns
    -------
    Margin
        Opening, rise, absolute discrepancy.

    Raises
    ------
    MetrologyError
        If the profile is malformed, or shows no gap between two shoulders.

    Notes
    -----
    An edge is where the profile has fallen below its own shoulder by half the depth of the gap under the lower
    shoulder; missing points count as gap. The opening is known to one sampling interval at each edge, as a rectangle.
    """
    x, z = np.asarray(position, dtype=np.float64), np.asarray(height, dtype=np.float64)
    if x.ndim != 1 or x.shape != z.shape or len(x) < 3 * _LEAST_POINTS:
        raise MetrologyError(f"profile must be two rows of at least {3 * _LEAST_POINTS} points, got {x.shape}")
    steps = np.diff(x)
    if not ((steps > 0.0).all() and np.ptp(steps) < 0.01 * steps.mean()):
        raise MetrologyError("positions of the profile must increase in equal steps within 1 %")
    known = np.isfinite(z)
    level = np.full_like(z, np.nan)
    level[known] = despiked(roughly_levelled(x[known], z[known]))
    begin, end = _gap(level)
    tilt, rise, rise_std, offset, middle = _shoulders(x, z, begin, end)
    flat = z - tilt * (x - middle) - offset
    left, right, depth = _edges(x, flat, rise, begin, end)
    opening = right - left
    opening_std = float(steps.mean()) / np.sqrt(6.0)  # two rectangles of one interval
    absolute = float(np.hypot(opening, rise))
    if absolute > 0.0:
        absolute_std = float(np.hypot(opening * opening_std, rise * rise_std) / absolute)
    else:
        absolute_std = float(np.hypot(opening_std, rise_std))
    return Margin(opening, opening_std, rise, rise_std, absolute, absolute_std, depth)


def _gap(level: Array) -> tuple[int, int]:
    """Return the indices of the longest stretch that is missing or far below both shoulders."""
    lower, upper = two_levels(level[np.isfinite(level)])
    quarter = len(level) // 4
    shoulders = min(np.nanmedian(level[:quarter]), np.nanmedian(level[-quarter:]))
    bottom = float(np.nanmin(level))
    limit = shoulders - 0.5 * (shoulders - bottom)
    if not shoulders - bottom > max(abs(upper - lower) * 0.2, 1e-12):
        raise MetrologyError("profile must show a gap below both shoulders, got none")
    inside = ~np.isfinite(level) | (level < limit)
    change = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    stretches = list(zip(change[::2], change[1::2], strict=True))
    begin, end = max(stretches, key=lambda pair: pair[1] - pair[0])
    if begin < _LEAST_POINTS or len(level) - end < _LEAST_POINTS:
        raise MetrologyError(f"gap must leave {_LEAST_POINTS} points of a shoulder on either side")
    return int(begin), int(end)


def _shoulders(x: Array, z: Array, begin: int, end: int) -> tuple[float, float, float, float, float]:
    margin = max((end - begin) // 2, 3)
    index = np.arange(len(x))
    left, right = index < begin - margin, index >= end + margin
    used = (left | right) & np.isfinite(z)
    if (left & used).sum() < _LEAST_POINTS or (right & used).sum() < _LEAST_POINTS:
        raise MetrologyError(f"shoulders must keep {_LEAST_POINTS} points each beside the gap")
    middle = 0.5 * float(x[begin] + x[end - 1])
    scale = float(np.ptp(x))
    design = np.stack([(x - middle) / scale, np.ones_like(x), (x > middle).astype(float)])
    for _ in range(4):
        inverse = np.linalg.inv(design[:, used] @ design[:, used].T)
        weights = np.where(used, inverse @ design, 0.0)
        solution = weights[:, used] @ z[used]
        residuals = z - solution @ design
        spikes = np.zeros_like(used)
        spikes[used] = outlier_mask(residuals[used])
        if not spikes.any():
            break
        used &= ~spikes
    kept = np.where(used, residuals, np.nan)
    covariance = estimator_covariance(weights, autocovariance([kept[left], kept[right]]))
    return (
        float(solution[0]) / scale, float(solution[2]), float(np.sqrt(covariance[2, 2])), float(solution[1]), middle,
    )  # fmt: skip


def _edges(x: Array, flat: Array, rise: float, begin: int, end: int) -> tuple[float, float, float]:
    lower = min(0.0, rise)
    inner = flat[begin:end]
    depth = float(lower - np.nanmin(inner)) if np.isfinite(inner).any() else np.nan
    drop = 0.5 * depth if np.isfinite(depth) else 0.0
    level = lower - drop
    solid = np.isfinite(flat) & (flat > level)
    middle = (begin + end) // 2
    left = int(np.flatnonzero(solid[:middle])[-1])
    right = middle + int(np.flatnonzero(solid[middle:])[0])
    return _crossing(x, flat, level, left, left + 1), _crossing(x, flat, level, right - 1, right), depth


def _crossing(x: Array, flat: Array, level: float, low: int, high: int) -> float:
    a, b = flat[low], flat[high]
    if not (np.isfinite(a) and np.isfinite(b)) or a == b:
        return float(0.5 * (x[low] + x[high]))
    return float(x[low] + (level - a) / (b - a) * (x[high] - x[low]))
