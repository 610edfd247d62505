"""The motion of the tip after its release, and its first swing below the sliding level."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from stepblocks.bench.signal import Array
from stepblocks.bench.signal.extremum import FAINT, find_extremum

_SWING_SHARE = 0.14  # of a period about the bottom of a swing, in which a quartic follows it


@dataclass(frozen=True)
class Motion:
    """What a regime is recognised by.

    Attributes
    ----------
    time : Array
        Shape (n,) [s].
    force : Array
        Shape (n,), tangential, hum taken off [N].
    normal : Array
        Shape (n,) [N].
    peak : int
        Sample of the release.
    level : float
        Tangential force of sliding [N].
    load : float
        Normal force of sliding [N].
    slope : float
        K v [N/s].
    noise : float
        Of the tangential force [N].
    frequency : float
        Of the tool [Hz].
    damping : float
        Its damping ratio [1].
    """

    time: Array
    force: Array
    normal: Array
    peak: int
    level: float
    load: float
    slope: float
    noise: float
    frequency: float
    damping: float = 0.0

    @cached_property
    def smoothed_force(self) -> Array:
        """Tangential force, five samples averaged [N]."""
        return np.convolve(self.force, np.full(5, 0.2), mode="same")

    @cached_property
    def fall_end_sample(self) -> int:
        """First sample after the release at which the force is down at that of sliding.

        The noise is the tolerance.
        """
        highest = self.level + 2.0 * self.noise / math.sqrt(5.0)
        below = np.flatnonzero(self.smoothed_force[self.peak : -2] <= highest)
        if not below.size:
            return self.force.size - 3
        return self.peak + int(below[0])

    @property
    def angular_frequency(self) -> float:
        """Pulsation of the tool [rad/s]."""
        return 2.0 * math.pi * self.frequency

    @property
    def fall_time(self) -> float:
        """Time from the release until the force is down at that of sliding [s]."""
        return float(self.time[self.fall_end_sample] - self.time[self.peak])


class FirstSwing(NamedTuple):
    """Bottom of the first swing below the sliding level after a slip.

    Attributes
    ----------
    depth : float
        Below the sliding level [N].
    std : float
        Its standard uncertainty [N].
    instant : float
        [s].
    """

    depth: float
    std: float
    instant: float


def find_first_swing(motion: Motion) -> FirstSwing:
    """Find the bottom of the first swing below the sliding level after a slip."""
    # the tip runs forward all through that swing, so that friction is part of the level, whatever
    # comes after it
    time, force = motion.time, motion.force
    period = 1.0 / motion.frequency
    reach = _SWING_SHARE * period
    swing = _find_swing_samples(motion, period)
    smooth = _smooth_force_for_swing(motion, swing, period)
    lowest = swing.start + int(np.argmin(smooth[swing]))
    bottom = find_extremum(time, force, min(lowest, time.size - 6), reach, motion.noise)
    depth = motion.level - bottom.force
    before = bottom.instant - period
    if before < time[motion.peak] + 0.5 * period:
        return FirstSwing(depth, bottom.std, bottom.instant)
    # a tip that came down slowly rang meanwhile: which dip was the first below sliding is a matter
    # of noise, and where one just touches, the odds of that reading alone are noise themselves:
    # they are those that another would put it below
    begin, end = np.searchsorted(time, [before - 0.25 * period, before + 0.25 * period])
    lowest_before = int(begin + np.argmin(smooth[begin:end]))
    dip = find_extremum(time, force, lowest_before, reach, motion.noise)
    odds = 0.5 * math.erfc((dip.force - motion.level) / dip.std / 2.0)
    difference = depth - max(motion.level - dip.force, 0.0)
    spread = math.sqrt(odds * (1.0 - odds)) * difference
    return FirstSwing(depth - odds * difference, math.hypot(bottom.std, spread), bottom.instant)


def _find_swing_samples(motion: Motion, period: float) -> slice:
    """Return the samples in which the bottom of the first swing lies."""
    reach = period
    if motion.fall_time >= period:
        reach = 1.5 * period
    stop = int(np.searchsorted(motion.time, motion.time[motion.fall_end_sample] + reach))
    return slice(motion.fall_end_sample, max(stop, motion.fall_end_sample + 1))


def _smooth_force_for_swing(motion: Motion, swing_samples: slice, period: float) -> Array:
    """Return the force [N] averaged over few samples, or over more where the swing is faint."""
    depth = motion.level - float(motion.smoothed_force[swing_samples].min())
    if depth >= FAINT * motion.noise:
        return motion.smoothed_force
    sample = float(np.median(np.diff(motion.time)))
    width = max(int(0.2 * period / sample), 1)
    return np.convolve(motion.force, np.full(width, 1.0 / width), mode="same")
