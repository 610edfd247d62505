"""Levelling: roughly, just good enough to find a feature, and by two planes with a common slope beside one.

A line through the whole profile would level through the feature. The median of the slopes over a fiftieth of the
profile does not see a feature that covers less than half of it; heights are never taken from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Mask, NoiseUncertainty, noise_uncertainty, outlier_mask

LEAST_FACE = 20  # points of a face or shoulder that is fitted


def check_profile(x: Array, z: Array, least: int) -> None:
    """Refuse what is no profile of at least `least` points in equal steps."""
    if x.ndim != 1 or x.shape != z.shape:
        raise MetrologyError(f"profile must be two equally long rows, got {x.shape} and {z.shape}")
    if len(x) < least:
        raise MetrologyError(f"profile must have at least {least} points, got {len(x)}")
    steps = np.diff(x)
    if not (np.isfinite(x).all() and (steps > 0.0).all() and np.ptp(steps) < 0.01 * np.mean(steps)):
        raise MetrologyError("positions of the profile must increase in equal steps within 1 %")


def despiked(heights: Array) -> Array:
    """Return the running median over five points, which removes spikes and keeps edges."""
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(heights, size=5, mode="nearest"))


def without_spikes(heights: Array) -> Array:
    """Return heights with the known ones replaced by their running median, to start a fit that spikes must not pull."""
    calm = np.array(heights, dtype=np.float64)
    known = np.isfinite(calm)
    calm[known] = despiked(calm[known])
    return calm


def roughly_levelled(position: Array, heights: Array) -> Array:
    """Return heights less the median slope."""
    lag = max(len(heights) // 50, 1)
    slope = float(np.median((heights[lag:] - heights[:-lag]) / (position[lag:] - position[:-lag])))
    return np.asarray(heights - slope * (position - position[0]))


def split_gains(values: Array) -> tuple[Array, Array]:
    """Return for every split of a row how much of its variance two means explain, and the second less the first mean."""
    below, count = np.cumsum(values)[:-1], np.arange(1, len(values))
    rest = len(values) - count
    gap = (below[-1] + values[-1] - below) / rest - below / count
    return gap**2 * count * rest, gap


def two_levels(levelled: Array) -> tuple[float, float]:
    """Return the lower and the upper of the two levels that explain most of the variance of the heights.

    Source: N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62, doi:10.1109/TSMC.1979.4310076, on the sorted values.
    """
    ordered = np.sort(levelled)
    split = int(np.argmax(split_gains(ordered)[0])) + 1
    return float(np.median(ordered[:split])), float(np.median(ordered[split:]))


def weighted(design: Array, z: Array, used: Mask) -> tuple[Array, Array]:
    """Return with which weights each point counts in a least-squares fit over those used, and its solution."""
    weights = np.where(used, np.linalg.inv(design[:, used] @ design[:, used].T) @ design, 0.0)
    return weights, weights[:, used] @ z[used]


@dataclass(frozen=True)
class TwoPlanes:
    """Two parallel faces, the one behind the middle of a profile higher by `height`."""

    tilt: float  # common slope [1]
    offset: float  # height of the first face at the middle [m]
    height: float  # m
    noise: NoiseUncertainty  # of the height [m]
    weights: Array  # shape (3, n); with which each point counts in tilt, offset and height
    residuals: Array  # shape (n,); m
    used: Mask  # shape (n,); points that took part
    rejected: int  # points left out as spikes


def fit_two_planes(x: Array, z: Array, middle: float, used: Mask) -> TwoPlanes:
    """Fit ``z = a (x - middle) + b + h s(x)``, s = 0 before and 1 behind the middle, by least squares without spikes.

    Source: ISO 5436-1 leaves a single edge to convention; this is the two-plane one, which has no feature to level through.
    """
    scale = float(max(abs(x[0] - middle), abs(x[-1] - middle)))
    design = np.stack([(x - middle) / scale, np.ones_like(x), (x > middle).astype(float)])
    calm, whole = without_spikes(z), int(used.sum())
    for turn in range(6):
        weights, solution = weighted(design, z if turn else calm, used)
        residuals = z - solution @ design
        spikes = outlier_mask(residuals, used)
        if turn > 0 and not spikes.any():
            break
        used = used & ~spikes
    noise = noise_uncertainty(weights[2], residuals, used, list(design))
    weights[0] /= scale
    tilt, offset, height = float(solution[0]) / scale, float(solution[1]), float(solution[2])
    return TwoPlanes(tilt, offset, height, noise, weights, residuals, used, whole - int(used.sum()))
