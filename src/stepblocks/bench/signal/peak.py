"""The peak of the tangential force: the corner of ramp and release, or a rounded top."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import label
from scipy.special import expit

from stepblocks.bench.signal import Array
from stepblocks.bench.signal.aftermath import Aftermath, estimate_sliding_noise
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.landmarks import Landmarks
from stepblocks.bench.signal.local_peak import Window, average_peak_over_shapes
from stepblocks.bench.signal.ring import Ring
from stepblocks.bench.signal.separable import fit_with_covariance, propagate_std

_CORNER_REACH = 3.5  # samples about the highest one in which a corner may lie
_FALL_SAMPLES = 6
_CLEAR_FALL = 0.02  # of the rise: the first sample after a corner has fallen by this at least
_CLEAR_NOISE = 5.0  # and by this many standard deviations of the noise
_FIRST_SAMPLES = 5  # about the highest one, among which the fall begins
# of the rise: a rounded peak is fitted where the force is within this of the highest
_TOP_SHARE = 0.06
_TOP_NOISE = 3.0  # or within this many standard deviations of the noise
_TOP_REACH = 6e-3  # [s] at most this far from the highest sample
_FALL_AT_ONCE = 0.5  # of the rise
# logarithm of the odds against the corner of ramp and ring beforehand: the fit of the ring has used
# the samples about the peak itself
_LOG_PRICE_OF_RING = 4.0
# a cubic is not the law of a rounded peak: pulls on drags in time are wider by this
_ROUND_SPREAD = 1.3


@dataclass(frozen=True)
class Peak:
    """Peak of the tangential force.

    Attributes
    ----------
    time : float
        Release instant [s].
    force : float
        [N].
    force_std : float
        [N].
    corner : bool
        Whether the ramp ran into the release in a corner; otherwise the peak is rounded.
    """

    time: float
    force: float
    force_std: float
    corner: bool


def measure_peak(
    time: Array, force: Array, landmarks: Landmarks, approach: Approach, aftermath: Aftermath
) -> Peak:
    """Find the peak: the corner of ramp and release, both fitted.

    Where the corner is rounded, it is the top of a cubic. `time` [s] and `force` [N] have shape
    (n,).
    """
    # the highest sample is no measure of it: noise lifts it, and the release falls between two
    # samples
    corner = None
    if approach.end >= landmarks.peak - 1:
        if isinstance(aftermath.ring, Ring):
            corner = _average_corner_and_local_peak(
                time, force, landmarks, approach, aftermath.ring
            )
        else:
            corner = _find_corner_from_fall(time, force, landmarks, approach)
    if corner is None:
        return _find_rounded_peak(time, force, landmarks, approach)
    return corner


def _find_ramp_ring_crossing(
    time: Array, landmarks: Landmarks, approach: Approach, ring: Ring
) -> Peak | None:
    """Find where the line of the ramp meets the curve of a bell; None where they do not."""
    from scipy.optimize import brentq

    top = float(time[landmarks.peak])
    step = float(np.median(np.diff(time)))

    def compute_excess(instant: float) -> float:
        """Return the curve of the ring less the line of the ramp at an instant [N]."""
        instants = np.array([instant])
        curve = ring.compute_curve(instants)[0]
        line = approach.compute_ramp_line(instants)[0]
        return float(curve - line)

    low = top - _CORNER_REACH * step
    high = top + _CORNER_REACH * step
    if not compute_excess(low) > 0.0 > compute_excess(high):
        return None
    instant = float(brentq(compute_excess, low, high, xtol=1e-9))
    before = compute_excess(instant - 0.1 * step)
    after = compute_excess(instant + 0.1 * step)
    fall = (after - before) / (0.2 * step)
    if fall >= 0.0:
        return None
    # the force at the corner moves along the ramp by slope * dt, dt = (errors of both) /
    # (difference of slopes)
    share = approach.initial_slope / -fall
    ramp = approach.compute_ramp_force(instant)
    of_ramp = (1.0 - share) * ramp.std
    of_ring = share * ring.compute_curve_std(instant)
    return Peak(instant, ramp.value, math.hypot(of_ramp, of_ring), corner=True)


def _average_corner_and_local_peak(
    time: Array, force: Array, landmarks: Landmarks, approach: Approach, ring: Ring
) -> Peak:
    """Average what the samples about the peak show with the corner of ramp and ring.

    The corner takes for granted that the fit of the ring holds back to the release; both count by
    the likelihood of the samples about the peak.
    """
    noise = estimate_sliding_noise(time, approach, landmarks)
    window = Window.cut_around_peak(time, force, landmarks, approach, noise)
    local = average_peak_over_shapes(window)
    top = float(time[landmarks.peak])
    ramp = approach.compute_ramp_force(top)
    shown_instant = top + window.sample * local.since
    shown_force = ramp.value + local.height
    shown_std = math.hypot(local.std, ramp.std)
    shown = Peak(shown_instant, shown_force, shown_std, corner=True)
    corner = _find_ramp_ring_crossing(time, landmarks, approach, ring)
    if corner is None:
        # where ramp and ring do not meet, the line has bent hum and drift to what is neither
        instant = time[[landmarks.peak]]
        clean = approach.compute_ramp_line(instant) - approach.compute_hum(instant)
        return replace(shown, force=float(clean[0]) + local.height)
    instants = top + window.sample * window.since
    ring_over_line = ring.compute_curve(instants) - approach.compute_ramp_line(instants)
    expected = np.where(instants > corner.time, ring_over_line, 0.0)
    log_likelihood = window.compute_log_likelihood(expected)
    log_odds = log_likelihood - local.log_likelihood - _LOG_PRICE_OF_RING
    return _average_peaks(corner, shown, float(expit(log_odds)))


def _average_peaks(first: Peak, second: Peak, share_of_first: float) -> Peak:
    """Average two peaks, the first of which counts by a share; the spread of both is uncertain."""
    share_of_second = 1.0 - share_of_first
    force = share_of_first * first.force + share_of_second * second.force
    square_of_first = first.force_std**2 + (first.force - force) ** 2
    square_of_second = second.force_std**2 + (second.force - force) ** 2
    variance = share_of_first * square_of_first
    variance += share_of_second * square_of_second
    instant = share_of_first * first.time + share_of_second * second.time
    return Peak(instant, force, math.sqrt(variance), corner=True)


def _find_corner_from_fall(
    time: Array, force: Array, landmarks: Landmarks, approach: Approach
) -> Peak | None:
    """Find where the line of the ramp meets a parabola through the first samples after it."""
    first = _find_first_sample_after_corner(time, force, landmarks, approach)
    if first is None:
        return None
    fall = slice(first, first + _FALL_SAMPLES)
    step = float(np.median(np.diff(time)))
    excess = force[fall] - approach.compute_ramp_line(time[fall])
    steps = (time[fall] - time[first]) / step
    columns = np.vander(steps, 3, increasing=True)
    weights, covariance = fit_with_covariance(columns, excess)
    place = _find_last_downward_zero(weights)
    if place is None:
        return None
    rate = (weights[1] + 2.0 * weights[2] * place) / step
    if rate >= 0.0:
        return None
    gradient = np.asarray(place ** np.arange(3), dtype=float)
    of_residuals = propagate_std(gradient, covariance)
    unit_covariance = np.asarray(np.linalg.inv(columns.T @ columns), dtype=float)
    of_noise = propagate_std(gradient, unit_covariance) * landmarks.noise
    instant = float(time[first]) + place * step
    # how a fall begins between two samples is not seen
    unseen = approach.initial_slope * step / math.sqrt(12.0)
    ramp = approach.compute_ramp_force(instant)
    std_of_fall = approach.initial_slope / -rate * max(of_residuals, of_noise)
    return Peak(instant, ramp.value, math.hypot(ramp.std, std_of_fall, unseen), corner=True)


def _find_first_sample_after_corner(
    time: Array, force: Array, landmarks: Landmarks, approach: Approach
) -> int | None:
    """Return the index of the first sample after a corner; None where there is no corner."""
    # noise decides which of the samples about a corner is the highest; the fall begins where the
    # line is left
    below = approach.compute_ramp_line(time) - force
    deep = max(_CLEAR_FALL * landmarks.rise, _CLEAR_NOISE * landmarks.noise)
    candidates = range(landmarks.peak - 1, landmarks.peak - 1 + _FIRST_SAMPLES)
    for first in candidates:
        if below[first] > deep and below[first + 1] > below[first]:
            break
    else:
        return None
    if first + _FALL_SAMPLES > time.size or abs(below[first - 1]) > deep:
        return None
    return first


def _find_last_downward_zero(parabola_coefficients: Array) -> float | None:
    """Return where before its origin a parabola last falls through zero [samples], or None."""
    grid = np.linspace(-_CORNER_REACH, 0.0, 701)
    excess = np.vander(grid, 3, increasing=True) @ parabola_coefficients
    above = np.flatnonzero(excess > 0.0)
    if not above.size or excess[-1] >= 0.0:
        return None
    return float(grid[above[-1]])


def _find_rounded_peak(time: Array, force: Array, landmarks: Landmarks, approach: Approach) -> Peak:
    """Return the top of a cubic about the highest sample."""
    clean = force - approach.compute_hum(time)
    top = _find_top_samples(time, clean, landmarks)
    since = time[top] - time[landmarks.peak]
    reach = float(np.abs(since).max())
    columns = np.vander(since / reach, 4, increasing=True)
    weights, covariance = fit_with_covariance(columns, clean[top])
    grid = np.linspace(since[0], since[-1], 801) / reach
    heights = np.vander(grid, 4, increasing=True) @ weights
    best = int(np.argmax(heights))
    place = grid[best]
    gradient = np.asarray(place ** np.arange(4), dtype=float)
    std = _ROUND_SPREAD * propagate_std(gradient, covariance)
    instant = float(time[landmarks.peak] + place * reach)
    return Peak(instant, float(heights[best]), std, corner=False)


def _find_top_samples(time: Array, force_without_hum: Array, landmarks: Landmarks) -> slice:
    """Return the slice of the samples of a rounded peak, by the force without hum [N]."""
    smooth = np.convolve(force_without_hum, np.full(5, 0.2), mode="same")
    tolerance = max(_TOP_SHARE * landmarks.rise, _TOP_NOISE * landmarks.noise)
    is_high = smooth > smooth[landmarks.peak] - tolerance
    is_near = np.abs(time - time[landmarks.peak]) < _TOP_REACH
    parts, _ = label(is_high & is_near)
    top = np.flatnonzero(parts == parts[landmarks.peak])
    first = min(int(top[0]), landmarks.peak - 3)
    last = max(int(top[-1]), landmarks.peak + 3)
    # no cubic follows a fall between two samples, as of a simulated tip without mass
    steepest = np.diff(force_without_hum[landmarks.peak : last + 1]).min()
    if steepest < -_FALL_AT_ONCE * landmarks.rise:
        last = landmarks.peak
    return slice(first, last + 1)
