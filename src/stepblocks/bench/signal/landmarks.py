"""Where the parts of a trial lie in its record: sliding, loading and slip."""

from dataclasses import dataclass

import numpy as np

from stepblocks.bench.faults import Bound, FaultKind, LandmarkError
from stepblocks.bench.signal import Array

_SIGMA_PER_MEDIAN = 0.6745  # median of the absolute deviation of normal noise, in sigmas
_SPIKE_SIGMAS = 4.0  # of fourth differences, beyond which they are spikes
_VARIANCE_OF_FOURTH = 70.0  # of fourth differences of white noise of variance 1
_RISE_OVER_NOISE = 12.0  # a peak must stand out by this many standard deviations of the noise
_TOP_SAMPLES = 12  # samples after the highest that noise alone can put below it
_TOP_NOISE = 4.0  # by this many standard deviations of the noise
_RISE_OVER_LEAD = 1.5  # and be this many times what happens in the first part of the record
_FALL_SHARE = 0.5  # a tip that slipped has given back at least this share of the rise
_LEAST_RING = 15e-3  # [s] some four periods of a ring
_SLIDE_SAMPLES = 40  # fewer samples before the edge say nothing of the sliding force


@dataclass(frozen=True)
class Landmarks:
    """Samples between which the parts of a trial lie.

    Attributes
    ----------
    onset : float
        Begin of loading, to some samples [s].
    peak : int
        Sample of the largest tangential force before the slip.
    level : float
        Tangential force while sliding before the edge, to the noise [N].
    rise : float
        Peak over `level` [N].
    noise : float
        Standard deviation of the white part of the noise of the tangential force [N].
    """

    onset: float
    peak: int
    level: float
    rise: float
    noise: float


def estimate_white_noise(values: Array) -> float:
    """Return the standard deviation of white noise, from fourth differences.

    Slow changes and spikes do not count.
    """
    fourth = np.abs(np.diff(values, n=4))
    # the median alone comes in steps where the record is quantised; it only says what is a spike
    quiet = fourth[fourth <= _SPIKE_SIGMAS * np.median(fourth) / _SIGMA_PER_MEDIAN]
    if not quiet.size:
        return 0.0
    return float(np.sqrt(np.mean(quiet**2) / _VARIANCE_OF_FOURTH))


def find_landmarks(time: Array, force: Array) -> Landmarks:
    """Find sliding, loading and slip in a tangential force.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N].

    Raises
    ------
    LandmarkError
        If the record does not show one of them.
    """
    noise = estimate_white_noise(force)
    smooth = _smooth_over_five_samples(force)
    peak = _find_peak_sample(force, smooth, noise)
    lead = smooth[: max(peak // 4, 1)]
    level = float(np.median(lead))
    rise = float(force[peak]) - level
    # a start-up ring is as old as the record; a slip stands out over it
    start_up = float(np.abs(lead - level).max())
    least_rise = max(_RISE_OVER_NOISE * noise, _RISE_OVER_LEAD * start_up)
    if rise < least_rise:
        raise LandmarkError(
            FaultKind.NO_SLIP,
            f"the tangential force rises over sliding by {rise:.3g} N, less than the "
            f"{least_rise:.2g} N that stand out of noise and start-up",
        )
    if not np.any(smooth[: peak + 1] - level < 0.5 * rise):
        raise LandmarkError(FaultKind.NO_SLIDING, "the record begins under load")
    if float(smooth[peak:].min()) > level + (1.0 - _FALL_SHARE) * rise:
        raise LandmarkError(
            FaultKind.NO_RELEASE,
            "the tangential force does not fall after its peak",
            Bound.PEAK_FORCE,
        )
    after_slip = float(time[-1] - time[peak])
    if after_slip < _LEAST_RING:
        raise LandmarkError(
            FaultKind.TRUNCATED, f"the record ends {after_slip * 1e3:.3g} ms after the slip"
        )
    onset = _find_onset(time, smooth, peak, level, rise)
    return Landmarks(onset, peak, level, rise, noise)


def find_bounded_landmarks(time: Array, force: Array) -> Landmarks:
    """Find sliding and loading up to the first sample at the top.

    That sample is where the range of a gauge or the record ends. Parameters are those of
    `find_landmarks`.

    Raises
    ------
    LandmarkError
        If there is no ramp up to the top.
    """
    noise = estimate_white_noise(force)
    peak = int(np.argmax(force))
    level = float(np.median(force[: max(peak // 4, 1)]))
    rise = float(force[peak]) - level
    if rise < _RISE_OVER_NOISE * noise or peak < 4 * _SLIDE_SAMPLES:
        raise LandmarkError(FaultKind.NO_RAMP)
    onset = _find_onset(time, force, peak, level, rise)
    return Landmarks(onset, peak, level, rise, noise)


def _smooth_over_five_samples(force: Array) -> Array:
    """Return a running mean of five samples; the ends stay as they are."""
    smooth = np.convolve(force, np.full(5, 0.2), mode="same")
    smooth[:2] = force[:2]
    smooth[-2:] = force[-2:]
    return smooth


def _find_peak_sample(force: Array, smoothed_force: Array, noise: float) -> int:
    """Return the last sample before the fall; forces [N] have shape (n,)."""
    coarse = int(np.argmax(smoothed_force))
    first = max(coarse - 4, 0)
    peak = first + int(np.argmax(force[first : coarse + 5]))
    # on a gentle ramp noise lifts an earlier sample over the last one
    high = force[peak : peak + _TOP_SAMPLES] > force[peak] - _TOP_NOISE * noise
    if high.all():
        return peak + len(high) - 1
    return peak + int(np.argmin(high)) - 1


def _find_onset(time: Array, smoothed_force: Array, peak: int, level: float, rise: float) -> float:
    """Return where the line through the middle of the ramp meets the sliding level [s]."""
    climb = smoothed_force[: peak - 1] - level  # the last two samples have some of the fall
    low = int(np.flatnonzero(climb < 0.25 * rise)[-1])
    last_below_high = int(np.flatnonzero(climb < 0.75 * rise)[-1])
    high = max(last_below_high + 1, low + 2)
    slope = (smoothed_force[high] - smoothed_force[low]) / (time[high] - time[low])
    if slope <= 0.0:
        raise LandmarkError(
            FaultKind.NO_LOADING, "the tangential force does not climb steadily to its peak"
        )
    onset = float(time[low] - climb[low] / slope)
    if np.searchsorted(time, onset) < _SLIDE_SAMPLES:
        raise LandmarkError(
            FaultKind.NO_SLIDING, f"loading begins {onset - time[0]:.3g} s into the record"
        )
    return onset
