"""Peak force and release instant: where the ramp ends in a corner, or where a rounded peak is highest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.aftermath import Aftermath
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.landmarks import Landmarks
from stepblocks.bench.signal.ring import Ring
from stepblocks.bench.signal.separable import covariance_of, fit_linear, propagated

Array = NDArray[np.float64]

_CORNER_REACH = 3.5  # samples about the highest one in which a corner may lie
_FALL_SAMPLES = 6
_CLEAR_FALL = 0.02  # of the rise: the first sample after a corner has fallen by this at least
_TOP_SHARE = 0.06  # of the rise: a rounded peak is fitted where the force is within this of the highest
_TOP_REACH = 6e-3  # [s] at most this far from the highest sample
_ROUND_SPREAD = 1.3  # a cubic is not the law of a rounded peak: pulls on drags in time are wider by this


@dataclass(frozen=True)
class Peak:
    """Peak of the tangential force."""

    time: float  # release instant [s]
    force: float  # [N]
    force_std: float  # [N]
    corner: bool  # whether the ramp ran into the release in a corner; otherwise the peak is rounded


def peak_of(time: Array, force: Array, marks: Landmarks, approach: Approach, after: Aftermath) -> Peak:
    """Find the peak.

    The highest sample is no measure of it: noise lifts it, and the release falls between two samples. A corner is the
    intersection of ramp and release, both fitted; a rounded peak is the top of a cubic through its neighbourhood.
    """
    if approach.end >= marks.peak - 1:
        if isinstance(after.ring, Ring):
            corner = _corner(time, marks, approach, after.ring)
        else:
            corner = _corner_of_fall(time, force, marks, approach)
        if corner is not None:
            return corner
    return _rounded(time, force, marks, approach)


def _corner(time: Array, marks: Landmarks, approach: Approach, ring: Ring) -> Peak | None:
    from scipy.optimize import brentq

    top = float(time[marks.peak])
    step = float(np.median(np.diff(time)))

    def excess(instant: float) -> float:
        at = np.array([instant])
        return float(ring.curve(at)[0] - approach.line(at)[0])

    low, high = top - _CORNER_REACH * step, top + _CORNER_REACH * step
    if not excess(low) > 0.0 > excess(high):
        return None
    instant = float(brentq(excess, low, high, xtol=1e-9))
    fall = (excess(instant + 0.1 * step) - excess(instant - 0.1 * step)) / (0.2 * step)
    if fall >= 0.0:
        return None
    line_std, curve_std = approach.line_std(instant), ring.curve_std(instant)
    # the force at the corner moves along the ramp by slope * dt, dt = (errors of both) / (difference of slopes)
    share = approach.slope / -fall
    spread = float(np.hypot((1.0 - share) * line_std, share * curve_std))
    return Peak(instant, approach.ramp(instant), spread, corner=True)


def _corner_of_fall(time: Array, force: Array, marks: Landmarks, approach: Approach) -> Peak | None:
    """Corner of the ramp and a parabola through the first samples after it."""
    # noise decides which of the samples about a corner is the highest; the fall begins where the line is left
    below = approach.line(time) - force
    deep = max(_CLEAR_FALL * marks.rise, 5.0 * marks.noise)
    first = marks.peak - 1
    while first < marks.peak + 4 and not (below[first] > deep and below[first + 1] > below[first]):
        first += 1
    last = first + _FALL_SAMPLES
    if last > time.size or first == marks.peak + 4 or abs(below[first - 1]) > deep:
        return None
    step = float(np.median(np.diff(time)))
    t = (time[first:last] - time[first]) / step
    y = force[first:last] - approach.line(time[first:last])
    columns = np.vander(t, 3, increasing=True)
    weights, residuals = fit_linear(columns, y)
    grid = np.linspace(-_CORNER_REACH, 0.0, 701)
    excess = np.vander(grid, 3, increasing=True) @ weights
    above = np.flatnonzero(excess > 0.0)
    if not above.size or excess[-1] >= 0.0:
        return None
    at = float(grid[above[-1]])
    fall = (weights[1] + 2.0 * weights[2] * at) / step
    if fall >= 0.0:
        return None
    gradient = np.asarray(at ** np.arange(3), dtype=float)
    covariance = covariance_of(columns, residuals)
    noise = max(
        propagated(gradient, covariance),
        propagated(gradient, np.asarray(np.linalg.inv(columns.T @ columns), dtype=float)) * marks.noise,
    )
    instant = float(time[first]) + at * step
    # how a fall begins between two samples is not seen
    unseen = approach.slope * step / math.sqrt(12.0)
    spread = math.hypot(approach.line_std(instant), approach.slope / -fall * noise, unseen)
    return Peak(instant, approach.ramp(instant), spread, corner=True)


def _rounded(time: Array, force: Array, marks: Landmarks, approach: Approach) -> Peak:
    clean = force - approach.hum(time)
    near = np.convolve(clean, np.full(5, 0.2), mode="same")
    close = near > near[marks.peak] - max(_TOP_SHARE * marks.rise, 3.0 * marks.noise)
    first = last = marks.peak
    while first > 0 and close[first - 1] and time[marks.peak] - time[first - 1] < _TOP_REACH:
        first -= 1
    while last < time.size - 1 and close[last + 1] and time[last + 1] - time[marks.peak] < _TOP_REACH:
        last += 1
    first, last = min(first, marks.peak - 3), max(last, marks.peak + 3)
    t = time[first : last + 1] - time[marks.peak]
    y = clean[first : last + 1]
    reach = float(np.abs(t).max())
    columns = np.vander(t / reach, 4, increasing=True)
    weights, residuals = fit_linear(columns, y)
    covariance = covariance_of(columns, residuals)
    grid = np.linspace(t[0], t[-1], 801) / reach
    heights = np.vander(grid, 4, increasing=True) @ weights
    best = int(np.argmax(heights))
    gradient = np.asarray(grid[best] ** np.arange(4), dtype=float)
    spread = _ROUND_SPREAD * propagated(gradient, covariance)
    return Peak(float(time[marks.peak] + grid[best] * reach), float(heights[best]), spread, corner=False)
