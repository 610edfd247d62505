"""The saw that a tip draws before the edge where it sticks and slips.

A tip that sticks and slips before the edge draws a saw: it is loaded along the ramp ``k v`` up to
static friction, slips, and sticks again as far below the sliding force as it was above. What lies
before the edge then is no sliding, and no ring either.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.extremum import find_extremum
from stepblocks.bench.signal.landmarks import Landmarks

_TEETH = 2  # a saw has at least so many
_TOOTH_NOISE = 9.0  # a tooth stands out by this many standard deviations of the noise
_RAMP_BEGIN, _RAMP_END = 0.4, 0.85  # shares of the rise between which the ramp is measured
_SLOPE_SHARE = 0.4  # a tooth climbs as the ramp does, to this share
_ALIKE = 0.5  # and is at least this high beside the usual one: a ring that dies is no saw
# [m/s] over which static friction falls to kinetic, where `stribeck_friction` of the loop begins
# too
_STRIBECK = 5e-3


@dataclass(frozen=True)
class Sawtooth:
    """A limit cycle of sticking and slipping before the edge.

    Attributes
    ----------
    amplitude : Estimate
        From bottom to top [N].
    stick_time : Estimate
        From a bottom to the next top [s].
    static : Estimate
        Force at which the tip lets go [N].
    kinetic : Estimate
        Force of sliding, about which it slips [N].
    onset : int
        Sample at which the ramp of the edge passes the force of sliding.
    """

    amplitude: Estimate
    stick_time: Estimate
    static: Estimate
    kinetic: Estimate
    onset: int

    def remove_saw(self, force: Array) -> Array:
        """Return the force as if the tip had slid up to the edge; the noise stays."""
        smooth = np.convolve(force, np.full(5, 0.2), mode="same")
        noise = (force - smooth)[: self.onset] / math.sqrt(0.8)
        calm = force.copy()
        calm[: self.onset] = self.kinetic.value + noise
        return calm


class _Tooth(NamedTuple):
    """Samples of a bottom and of the top after it."""

    bottom: int
    top: int


@dataclass(frozen=True)
class _Teeth:
    """Teeth of a saw before the edge.

    Attributes
    ----------
    teeth : list of _Tooth
    rises : Array
        Shape (m,), force from bottom to top [N].
    times : Array
        Shape (m,), time from bottom to top [s].
    last_bottom : int
        Sample from which the ramp of the edge climbs.
    last_force : float
        Force there [N].
    """

    teeth: list[_Tooth]
    rises: Array
    times: Array
    last_bottom: int
    last_force: float


def find_sawtooth(
    time: Array, force: Array, landmarks: Landmarks, tool: Tool, stiffness: float
) -> Sawtooth | None:
    """Look for teeth before the edge.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N].
    landmarks : Landmarks
    tool : Tool
    stiffness : float
        Spring constant [N/m].

    Returns
    -------
    Sawtooth or None
        None where the tip slides.
    """
    smooth = np.convolve(force, np.full(3, 1.0 / 3.0), mode="same")[: landmarks.peak]
    slope = _measure_ramp_slope(time, force, smooth, landmarks)
    if slope <= 0.0:
        return None
    teeth = _find_teeth(time, smooth, landmarks.noise)
    if teeth is None or not _do_teeth_climb_like_ramp(teeth, slope):
        return None
    return _measure_sawtooth(
        time, force, landmarks, teeth, tool=tool, stiffness=stiffness, slope=slope
    )


def _measure_ramp_slope(
    time: Array, force: Array, smoothed_force: Array, landmarks: Landmarks
) -> float:
    """Return the slope of the ramp of the edge [N/s]; 0 where too few samples show it."""
    share = (smoothed_force - landmarks.level) / landmarks.rise
    first = int(np.flatnonzero(share < _RAMP_BEGIN)[-1])
    stop = int(np.flatnonzero(share < _RAMP_END)[-1]) + 1
    if stop - first <= 2:
        return 0.0
    slope, _ = np.polyfit(time[first:stop], force[first:stop], 1)
    return float(slope)


def _find_teeth(time: Array, smoothed_force: Array, noise: float) -> _Teeth | None:
    """Find the teeth of a force [N] up to its peak; None where there are too few."""
    tops = _find_top_samples(smoothed_force, noise)
    bottoms = _find_top_samples(-1.0 * smoothed_force, noise)
    if len(tops) < _TEETH or not len(bottoms) or bottoms[-1] < tops[-1]:
        return None
    teeth = []
    for bottom in bottoms:
        later_tops = tops[tops > bottom]
        if not later_tops.size:
            continue
        top = int(later_tops[0])
        has_bottom_between = np.any((bottoms > bottom) & (bottoms < top))
        if not has_bottom_between:
            teeth.append(_Tooth(bottom, top))
    if not teeth:
        return None
    rises = np.array([smoothed_force[tooth.top] - smoothed_force[tooth.bottom] for tooth in teeth])
    times = np.array([time[tooth.top] - time[tooth.bottom] for tooth in teeth])
    last = int(bottoms[-1])
    return _Teeth(teeth, rises, times, last, float(smoothed_force[last]))


def _find_top_samples(force: Array, noise: float) -> NDArray[np.intp]:
    """Return the samples of the tops that stand out of the noise."""
    from scipy.signal import find_peaks

    tops, _ = find_peaks(force[2:], prominence=_TOOTH_NOISE * noise)
    return np.asarray(tops + 2)


def _do_teeth_climb_like_ramp(teeth: _Teeth, slope: float) -> bool:
    """Tell whether teeth climb as steeply as the ramp, and do not die away like a ring."""
    steepness = float(np.median(teeth.rises / teeth.times))
    if abs(steepness / slope - 1.0) > _SLOPE_SHARE:
        return False
    return bool(teeth.rises[-1] >= _ALIKE * float(np.median(teeth.rises)))


def _measure_sawtooth(
    time: Array,
    force: Array,
    landmarks: Landmarks,
    teeth: _Teeth,
    *,
    tool: Tool,
    stiffness: float,
    slope: float,
) -> Sawtooth:
    """Measure amplitude, time of sticking and both frictions; see `find_sawtooth`.

    `slope` is that of the ramp [N/s].
    """
    frequency, decay_time = tool
    reach = 0.1 / frequency
    low, high = [], []
    for tooth in teeth.teeth:
        low.append(find_extremum(time, force, tooth.bottom, reach, landmarks.noise).force)
        high.append(find_extremum(time, force, tooth.top, reach, landmarks.noise).force)
    root = math.sqrt(len(teeth.teeth))
    top = float(np.median(high))
    bottom = float(np.median(low))
    top_std = max(float(np.std(high)), landmarks.noise) / root
    bottom_std = max(float(np.std(low)), landmarks.noise) / root
    # it swings about the force of sliding and loses what the damper takes in half a period
    kept = math.exp(-0.5 / (frequency * decay_time))
    kinetic = (top * kept + bottom) / (1.0 + kept)
    # the handle moves on while it lets go, so that the top lies over static friction
    omega = 2.0 * math.pi * frequency
    late = slope / omega
    static = kinetic + math.sqrt(max((top - kinetic) ** 2 - late**2, 0.0))
    unseen = _compute_mean_friction_excess(
        static - kinetic, omega * (top - kinetic), slope, stiffness
    )
    amplitude_std = math.hypot(top_std, bottom_std)
    kinetic_std = math.hypot(0.5 * amplitude_std, 0.5 * unseen)
    kinetic -= unseen
    climb = max(kinetic - teeth.last_force, 0.0)
    onset = int(np.searchsorted(time, time[teeth.last_bottom] + climb / slope))
    stick_time = float(np.median(teeth.times))
    stick_std = float(np.std(teeth.times)) / root + float(np.median(np.diff(time)))
    return Sawtooth(
        amplitude=Estimate(top - bottom, amplitude_std),
        stick_time=Estimate(stick_time, stick_std),
        static=Estimate(static, math.hypot(top_std, kinetic_std)),
        kinetic=Estimate(kinetic, kinetic_std),
        onset=min(onset, landmarks.peak - 3),
    )


def _compute_mean_friction_excess(
    friction_drop: float, fastest_force: float, slope: float, stiffness: float
) -> float:
    """Return the average excess of static over kinetic friction that acts during a slip [N].

    Parameters
    ----------
    friction_drop : float
        Static over kinetic friction [N].
    fastest_force : float
        Greatest rate of the force during the slip [N/s].
    slope : float
        Rate of the force along the ramp [N/s].
    stiffness : float
        Spring constant [N/m].
    """
    # a slip of sine form, U at its fastest, feels exp(-u / V) of static over kinetic friction, on
    # average (V / U)^2 where it is fast; the handle adds its own speed. How fast friction falls is
    # hardly known: half of that is uncertain
    fastest = fastest_force / stiffness
    share = min((_STRIBECK / fastest) ** 2, 0.5)
    return friction_drop * share * math.exp(-slope / stiffness / _STRIBECK)
