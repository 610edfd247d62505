"""What the tip did, found from the waveform before an E_v is reported.

It snapped, climbed down, flew, rubbed, or stuck and slipped.
"""

import math
from enum import StrEnum

import numpy as np

from stepblocks.bench.signal.landmarks import estimate_white_noise
from stepblocks.bench.signal.motion import Motion, find_first_swing
from stepblocks.bench.signal.saw import Sawtooth

_FLIGHT_SAMPLES = 3  # fewer samples without load are no flight that a record can show
_NO_LOAD = 5.0  # standard deviations of the noise about the lowest normal force that count as none
_LIGHT = 0.25  # of the load: a tip that presses more has not flown
_BACK_NOISE = 6.0  # a way back of the tip that is longer than this many standard deviations is one


class Regime(StrEnum):
    """What the tip did."""

    SNAP = "snap"
    CLIMB_DOWN = "climb-down"
    FLIGHT = "flight"
    RUBBING = "rubbing"
    STICK_SLIP = "stick-slip"


def classify_regime(motion: Motion, saw: Sawtooth | None, *, rings_freely: bool) -> Regime:
    """Say what the tip did.

    Parameters
    ----------
    motion : Motion
    saw : Sawtooth or None
        What the tip drew before the edge.
    rings_freely : bool
        Whether a damped cosine explains the ring, as of a tool whose tip hangs free.
    """
    if saw is not None:
        return Regime.STICK_SLIP
    if rings_freely:
        return Regime.SNAP
    if _loses_contact(motion):
        return Regime.FLIGHT
    if motion.fall_time * motion.frequency > 1.0:
        return Regime.CLIMB_DOWN
    if _reverses_past_friction(motion) or _moves_backward(motion):
        return Regime.RUBBING
    return Regime.SNAP


def _loses_contact(motion: Motion) -> bool:
    """Tell whether the tip presses on nothing for some samples after the release."""
    end = motion.time[motion.fall_end_sample] + 5.0 / motion.frequency
    after = motion.normal[motion.peak : int(np.searchsorted(motion.time, end))]
    lowest = float(after.min())
    no_load = lowest + _NO_LOAD * estimate_white_noise(motion.normal)
    unloaded = after < min(no_load, _LIGHT * motion.load)
    return bool(np.count_nonzero(unloaded) >= _FLIGHT_SAMPLES)


def _moves_backward(motion: Motion) -> bool:
    """Tell whether the tip goes back by more than the noise in its first swing."""
    end = motion.time[motion.fall_end_sample] + 1.5 / motion.frequency
    swing = slice(motion.fall_end_sample, int(np.searchsorted(motion.time, end)))
    # where the tip stands, but for the stiffness: it slips back where that falls
    place = motion.slope * motion.time[swing] - motion.smoothed_force[swing]
    if not place.size:
        return False
    back = float(np.max(np.maximum.accumulate(place) - place))
    return back > _BACK_NOISE * motion.noise / math.sqrt(5.0)


def _reverses_past_friction(motion: Motion) -> bool:
    """Tell whether the tip turns at the end of its first swing, past friction's other side."""
    # it stops where the force is as far from sliding as its swing, but for the ramp
    swing = find_first_swing(motion)
    of_ramp = motion.slope / motion.angular_frequency
    stopped_squared = swing.depth**2 - of_ramp**2
    stopped = math.sqrt(max(stopped_squared, 0.0))
    shift = 2.0 * motion.damping * motion.slope / motion.angular_frequency
    return stopped - swing.std > 2.0 * motion.level + shift
