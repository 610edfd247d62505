"""Where things happen in a trace, to within a few samples: sliding, loading, slip.

Everything finer is fitted; see `stepblocks.bench.signal.approach` and `stepblocks.bench.signal.ring`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RISE_OVER_NOISE = 12.0  # a peak must stand out by this many standard deviations of the noise
_TOP_SAMPLES, _TOP_NOISE = 12, 4.0  # samples after the highest that noise alone can put below it
_RISE_OVER_LEAD = 1.5  # and be this many times what happens in the first part of the record
_FALL_SHARE = 0.5  # a tip that slipped has given back at least this share of the rise
_LEAST_RING = 15e-3  # [s] some four periods of a ring
_SLIDE_SAMPLES = 40  # fewer samples before the edge say nothing of the sliding force


class LandmarkError(Exception):
    """The trace lacks a part of the course of a trial; the message is the reason for its exclusion."""


@dataclass(frozen=True)
class Landmarks:
    """Samples between which the parts of a trial lie."""

    onset: float  # begin of loading, to some samples [s]
    peak: int  # sample of the largest tangential force before the slip
    level: float  # tangential force while sliding before the edge, to the noise [N]
    rise: float  # peak over `level` [N]
    noise: float  # standard deviation of the white part of the noise of the tangential force [N]


def white_noise(values: Array) -> float:
    """Return the standard deviation of white noise, from fourth differences: blind to what is slow and to spikes."""
    fourth = np.abs(np.diff(values, n=4))
    # the median alone comes in steps where the record is quantised; it only says what is a spike
    quiet = fourth[fourth <= 4.0 * np.median(fourth) / 0.6745]
    return float(np.sqrt(np.mean(quiet**2) / 70.0)) if quiet.size else 0.0


def find_landmarks(time: Array, force: Array) -> Landmarks:
    """Find sliding, loading and slip in a tangential force."""
    noise = white_noise(force)
    smooth = np.convolve(force, np.full(5, 0.2), mode="same")
    smooth[:2], smooth[-2:] = force[:2], force[-2:]
    peak = _peak_sample(force, smooth, noise)
    lead = smooth[: max(peak // 4, 1)]
    level = float(np.median(lead))
    rise = float(force[peak]) - level
    # a start-up ring is as old as the record; a slip stands out over it
    floor = max(_RISE_OVER_NOISE * noise, _RISE_OVER_LEAD * float(np.abs(lead - level).max()))
    if rise < floor:
        raise LandmarkError(
            f"no slip: the tangential force never rises over sliding (by {rise:.3g} N in noise {noise:.2g} N)"
        )
    below = smooth[: peak + 1] - level < 0.5 * rise
    if not below.any():
        raise LandmarkError("no sliding before the edge: the record begins under load")
    after = smooth[peak:]
    if float(after.min()) > level + (1.0 - _FALL_SHARE) * rise:
        raise LandmarkError("no release: the tangential force does not fall after its peak")
    if time[-1] - time[peak] < _LEAST_RING:
        raise LandmarkError(f"truncated: the record ends {(time[-1] - time[peak]) * 1e3:.3g} ms after the slip")
    onset = _line_onset(time, smooth, peak, level, rise)
    if np.searchsorted(time, onset) < _SLIDE_SAMPLES:
        raise LandmarkError(f"no sliding before the edge: loading begins {onset - time[0]:.3g} s into the record")
    return Landmarks(onset=onset, peak=peak, level=level, rise=rise, noise=noise)


def _peak_sample(force: Array, smooth: Array, noise: float) -> int:
    """Last sample before the fall: on a gentle ramp noise lifts an earlier one over it."""
    coarse = int(np.argmax(smooth))
    first = max(coarse - 4, 0)
    peak = first + int(np.argmax(force[first : coarse + 5]))
    high = force[peak : peak + _TOP_SAMPLES] > force[peak] - _TOP_NOISE * noise
    return peak + (int(np.argmin(high)) if not high.all() else high.size) - 1


def _line_onset(time: Array, smooth: Array, peak: int, level: float, rise: float) -> float:
    """Where the line through the middle of the ramp meets the sliding level."""
    climb = smooth[: peak + 1] - level
    low = int(np.flatnonzero(climb < 0.25 * rise)[-1])
    high = int(np.flatnonzero(climb < 0.75 * rise)[-1]) + 1
    high = max(high, low + 2)
    slope = (smooth[high] - smooth[low]) / (time[high] - time[low])
    if slope <= 0.0:
        raise LandmarkError("no loading: the tangential force does not climb steadily to its peak")
    return float(time[low] - climb[low] / slope)
