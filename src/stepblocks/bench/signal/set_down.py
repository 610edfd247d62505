"""The begin of a record: the tip in the air, the load coming on, a handle that stands still."""

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from stepblocks.bench.signal import Array, Estimate, Trace

_FEWEST_STILL = 40  # samples before the tip is set down, fewer say nothing of a zero
_EDGE = 8  # samples at which the load is coming on
_CALM = 7e-3  # [s] two periods of a ring, over which it averages out
_STANDS = 0.4  # of the sliding force, within which a handle that stands still is pulled
_LOADED = 10.0  # the load is at least this many times the scatter without one
# shares of the samples below the normal force without and with load [%]
_LOW_PERCENT, _HIGH_PERCENT = 0.5, 80.0
_LOAD_BEGINS, _LOAD_STANDS = 0.05, 0.95  # shares of the load
_PARTS = 8  # of the record in the air, whose means tell the uncertainty of a zero
_SMOOTH = 5  # samples
_RAMP_SHARE = 1.5  # what climbs before the foot to this many times the sliding force is a ramp

_UNKNOWN = Estimate(math.nan, math.nan)


class SetDown(NamedTuple):
    """Where a trial begins in its record, and what the gauges show without load.

    Attributes
    ----------
    first : int
        First sample from which the tip slides.
    tangential_zero, normal_zero : Estimate
        [N]; NaN where the record has no part without load.
    """

    first: int
    tangential_zero: Estimate
    normal_zero: Estimate


def find_set_down_and_zeros(trace: Trace) -> SetDown:
    """Find the first sample from which the tip slides, and the zeros of both gauges.

    What comes before is an unloaded part, of which the zeros are the means, the load coming on, and
    a handle that stands still; a record may lack any of them.
    """
    duration = float(trace.time[-1] - trace.time[0])
    calm = max(round(_CALM * (trace.time.size - 1) / duration), 5)
    loaded = _find_full_load_and_zeros(trace, calm)
    force = trace.tangential[loaded.first :]
    motion = _find_sliding_start(
        force, loaded.tangential_zero.value, calm, is_pulled_up=loaded.first > 0
    )
    return loaded._replace(first=loaded.first + motion)


def _smooth_force(force: Array) -> Array:
    """Return a running mean of the force; its ends fall towards zero."""
    return np.convolve(force, np.full(_SMOOTH, 1.0 / _SMOOTH), mode="same")


def _find_full_load_and_zeros(trace: Trace, calm_samples: int) -> SetDown:
    """Find the first sample under full load, and the zeros; `calm_samples` is two periods."""
    normal = _smooth_force(trace.normal)
    low, high = np.percentile(normal[2:-2], (_LOW_PERCENT, _HIGH_PERCENT))
    half_loaded = int(np.argmax(normal[2:] > 0.5 * (low + high))) + 2
    spread = float(np.std(trace.normal[: max(half_loaded // 2, 1)]))
    is_set_down = high - low >= _LOADED * max(spread, 1e-12)
    if half_loaded < _FEWEST_STILL + _EDGE or not is_set_down:
        return SetDown(0, _UNKNOWN, _UNKNOWN)
    zero = float(np.median(normal[2 : half_loaded // 2]))
    load = high - zero
    mean = uniform_filter1d(trace.normal, max(min(calm_samples, half_loaded // 4), 5))
    before = mean[: half_loaded + 1] <= zero + _LOAD_BEGINS * load
    begin = int(np.flatnonzero(before)[-1])
    still = begin - (half_loaded - begin) - _EDGE  # the load comes on smoothly
    tangential_zero = normal_zero = _UNKNOWN
    if still >= _FEWEST_STILL:
        tangential_zero = _measure_zero_force(trace.tangential[:still])
        normal_zero = _measure_zero_force(trace.normal[:still])
    rising = int(np.argmax(mean[half_loaded:] >= zero + _LOAD_STANDS * load))
    return SetDown(half_loaded + rising, tangential_zero, normal_zero)


def _measure_zero_force(force: Array) -> Estimate:
    """Return the mean of a force without load [N]."""
    # samples are correlated: the uncertainty of the mean comes from the means of eighths
    means = [part.mean() for part in np.array_split(force, _PARTS)]
    std = float(np.std(means, ddof=1)) / math.sqrt(float(_PARTS))
    return Estimate(float(np.mean(force)), std)


def _find_sliding_start(force: Array, zero: float, calm_samples: int, *, is_pulled_up: bool) -> int:
    """Return the index of the first sample at the sliding force.

    Parameters
    ----------
    force : Array
        Shape (n,), tangential force under load [N].
    zero : float
        Force at rest [N]; NaN where it is not known.
    calm_samples : int
        Samples in two periods of a ring.
    is_pulled_up : bool
        Whether the load came on in the record, so that no sliding came before.
    """
    smooth = _smooth_force(force)
    smooth[:2] = force[:2]
    smooth[-2:] = force[-2:]
    at_rest = zero
    if not math.isfinite(zero):
        at_rest = float(np.median(smooth[:calm_samples]))
    climb = smooth[: int(np.argmax(smooth)) + 1] - at_rest
    foot = _find_ramp_start(climb, calm_samples)
    level = float(np.median(climb[max(foot - 3 * calm_samples, 0) : foot]))
    mean = uniform_filter1d(force, calm_samples) - at_rest
    start = int(np.argmax(np.append(mean[:foot] >= 0.5 * level, True)))
    if _does_handle_stand_still(mean, start, foot, calm_samples, level):
        first = max(start - calm_samples // 2, 0)
    elif is_pulled_up:
        first = 0
    else:
        return 0
    return first + int(np.argmax(climb[first:] >= level))


def _find_ramp_start(force_over_rest: Array, calm_samples: int) -> int:
    """Return the sample at which the ramp begins; `force_over_rest` is in newtons."""
    # the line through the middle of the ramp meets the force at rest before the ramp begins; where
    # the spring hardens, time as a parabola of the force does
    low = _find_last_index_below_share(force_over_rest, 0.5)
    middle = _find_last_index_below_share(force_over_rest, 0.7)
    upper = _find_last_index_below_share(force_over_rest, 0.9)
    line = 4.5 * middle - 3.5 * upper
    parabola = 7.875 * low - 11.25 * middle + 4.375 * upper
    return max(int(min(line, parabola)), calm_samples)


def _find_last_index_below_share(force_over_rest: Array, share: float) -> int:
    """Return the number of samples up to the last one below a share of the top."""
    below = np.append(True, force_over_rest < share * force_over_rest[-1])
    return int(np.flatnonzero(below)[-1])


def _does_handle_stand_still(
    mean_force: Array, start: int, ramp_start: int, calm_samples: int, level: float
) -> bool:
    """Tell whether the handle stands still at first, until `start`.

    `mean_force` is the force over rest [N], `level` that of sliding.
    """
    if not 2 * calm_samples <= start < ramp_start:
        return False
    if not float(np.ptp(mean_force[: start - calm_samples])) < _STANDS * level:
        return False
    # what still climbs before the foot is a ramp, no sliding
    sliding = min(level, float(mean_force[min(start + calm_samples, ramp_start)]))
    return float(mean_force[ramp_start - calm_samples // 2]) < _RAMP_SHARE * sliding
