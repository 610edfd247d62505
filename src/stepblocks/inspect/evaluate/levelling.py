"""Rough levelling, just good enough to find a feature; heights are never taken from it.

A line through the whole profile would level through the feature. The median of the slopes over a fiftieth of the
profile does not see a feature that covers less than half of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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


def two_levels(levelled: Array) -> tuple[float, float]:
    """Return the lower and the upper of the two levels that explain most of the variance of the heights.

    Source: N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62, doi:10.1109/TSMC.1979.4310076, on the sorted values.
    """
    ordered = np.sort(levelled)
    below = np.cumsum(ordered)[:-1]
    count = np.arange(1, len(ordered))
    rest = len(ordered) - count
    gain = (below / count - (below[-1] + ordered[-1] - below) / rest) ** 2 * count * rest
    split = int(np.argmax(gain)) + 1
    return float(np.median(ordered[:split])), float(np.median(ordered[split:]))
