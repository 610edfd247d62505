"""What the tip did, found from the waveform before an E_v is reported.

It snapped, climbed down, flew, rubbed, or stuck and slipped.

A tip that sticks and slips before the edge draws a saw: it is loaded along the ramp ``k v`` up to
static friction, slips, and sticks again as far below the sliding force as it was above. What lies
before the edge then is no sliding, and no ring either.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.approach import Landmarks, estimate_white_noise
from stepblocks.bench.signal.separable import fit_linear, propagate_std

# where nothing is known of the ring yet: frequency [Hz] and decay time [s]
USUAL_TOOL = (
    300.0,
    21e-3,
)

_TEETH = 2  # a saw has at least so many
_TOOTH_NOISE = 9.0  # a tooth stands out by this many standard deviations of the noise
_SLOPE_SHARE = 0.4  # a tooth climbs as the ramp does, to this share
_ALIKE = 0.5  # and is at least this high beside the usual one: a ring that dies is no saw
_FLIGHT_SAMPLES = 3  # fewer samples without load are no flight that a record can show
_NO_LOAD = 5.0  # standard deviations of the noise about the lowest normal force that count as none
_LIGHT = 0.25  # of the load: a tip that presses more has not flown
_SWING_SHARE = 0.14  # of a period about the bottom of a swing, in which a quartic follows it
_BACK_NOISE = 6.0  # a way back of the tip that is longer than this many standard deviations is one
# [m/s] over which static friction falls to kinetic, where `stribeck_friction` of the loop begins
# too
_STRIBECK = 5e-3
_SCATTER = 2.4  # reduced chi squared of four degrees of freedom, 95 %
# a swing less deep than this many standard deviations has no bottom that noise would not choose
_FAINT = 6.0


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
    def smooth(self) -> Array:
        """Tangential force, five samples averaged [N]."""
        return np.convolve(self.force, np.full(5, 0.2), mode="same")

    @cached_property
    def fallen(self) -> int:
        """First sample after the release at which the force is down at that of sliding.

        The noise is the tolerance.
        """
        below = np.flatnonzero(
            self.smooth[self.peak : -2] <= self.level + 2.0 * self.noise / math.sqrt(5.0)
        )
        return self.peak + int(below[0]) if below.size else self.force.size - 3


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
        calm = force.copy()
        noise = (force - np.convolve(force, np.full(5, 0.2), mode="same"))[
            : self.onset
        ] / math.sqrt(0.8)
        calm[: self.onset] = self.kinetic[0] + noise
        return calm


def find_saw(
    time: Array, force: Array, marks: Landmarks, tool: Tool, stiffness: float
) -> Sawtooth | None:
    """Look for teeth before the edge; None where the tip slides."""
    from scipy.signal import find_peaks

    smooth = np.convolve(force, np.full(3, 1.0 / 3.0), mode="same")[: marks.peak]
    share = (smooth - marks.level) / marks.rise
    climb = slice(int(np.flatnonzero(share < 0.4)[-1]), int(np.flatnonzero(share < 0.85)[-1]) + 1)
    slope = (
        float(np.polyfit(time[climb], force[climb], 1)[0]) if climb.stop - climb.start > 2 else 0.0
    )
    tops, bottoms = (
        find_peaks(sign * smooth[2:], prominence=_TOOTH_NOISE * marks.noise)[0] + 2
        for sign in (1.0, -1.0)
    )
    # a tooth is a bottom with a top after it and no bottom between
    teeth = [(b, int(tops[tops > b][0])) for b in bottoms if np.any(tops > b)]
    teeth = [(b, top) for b, top in teeth if not np.any((bottoms > b) & (bottoms < top))]
    if slope <= 0.0 or len(tops) < _TEETH or not teeth or bottoms[-1] < tops[-1]:
        return None
    rises = np.array([(smooth[top] - smooth[b], time[top] - time[b]) for b, top in teeth])
    off = abs(float(np.median(rises[:, 0] / rises[:, 1])) / slope - 1.0)
    if off > _SLOPE_SHARE or rises[-1, 0] < _ALIKE * float(np.median(rises[:, 0])):
        return None
    frequency, decay = tool
    root = math.sqrt(len(teeth))
    low, high = (
        np.array([find_extremum(time, force, i, 0.1 / frequency, marks.noise)[0] for i in where])
        for where in zip(*teeth, strict=True)
    )
    top, bottom = float(np.median(high)), float(np.median(low))
    top_std, bottom_std = (max(float(np.std(one)), marks.noise) / root for one in (high, low))
    # it swings about the force of sliding and loses what the damper takes in half a period
    kept = math.exp(-0.5 / (frequency * decay))
    kinetic = (top * kept + bottom) / (1.0 + kept)
    # the handle moves on while it lets go, so that the top lies over static friction
    late = slope / (2.0 * math.pi * frequency)
    static = kinetic + math.sqrt(max((top - kinetic) ** 2 - late**2, 0.0))
    # a slip of sine form, U at its fastest, feels exp(-u / V) of static over kinetic friction, on
    # average (V / U)^2 where it is fast; the handle adds its own speed. How fast friction falls is
    # hardly known: half of that is uncertain
    fastest = 2.0 * math.pi * frequency * (top - kinetic) / stiffness
    unseen = (
        (static - kinetic)
        * min((_STRIBECK / fastest) ** 2, 0.5)
        * math.exp(-slope / stiffness / _STRIBECK)
    )
    kinetic_std = math.hypot(0.5 * math.hypot(top_std, bottom_std), 0.5 * unseen)
    kinetic -= unseen
    last = int(bottoms[-1])
    onset = int(np.searchsorted(time, time[last] + max(kinetic - float(smooth[last]), 0.0) / slope))
    return Sawtooth(
        amplitude=(top - bottom, math.hypot(top_std, bottom_std)),
        stick_time=(
            float(np.median(rises[:, 1])),
            float(np.std(rises[:, 1])) / root + float(np.median(np.diff(time))),
        ),
        static=(static, math.hypot(top_std, kinetic_std)),
        kinetic=(kinetic, kinetic_std),
        onset=min(onset, marks.peak - 3),
    )


def find_extremum(
    time: Array, force: Array, index: int, reach: float, noise: float
) -> tuple[float, float, float]:
    """Value, standard uncertainty [N] and instant [s] of a bottom or top, by a quartic about it."""
    near = np.abs(time - time[index]) <= max(reach, 4.0 * float(np.median(np.diff(time))))
    t = (time[near] - time[index]) / reach
    columns = np.vander(t, 5, increasing=True)
    weights, residuals = fit_linear(columns, force[near])
    # so few samples do not tell their own noise, unless they scatter as noise does in one of twenty
    # cases
    excess = float(residuals @ residuals) / noise**2 / max(t.size - 5, 1)
    unit = np.linalg.inv(columns.T @ columns) * noise**2 * (excess if excess > _SCATTER else 1.0)
    grid = np.linspace(-0.9, 0.9, 361)
    curve = np.vander(grid, 5, increasing=True) @ weights
    turned = np.argmin(curve) if 2.0 * weights[0] < curve[0] + curve[-1] else np.argmax(curve)
    # one that hardly stands out of the noise stays where it was looked for: noise would choose its
    # own
    at = float(grid[turned]) if np.ptp(curve) > _FAINT * noise else 0.0
    gradient = np.asarray(at ** np.arange(5), dtype=float)
    return float(gradient @ weights), propagate_std(gradient, unit), float(time[index]) + at * reach


def find_first_swing(motion: Motion) -> tuple[float, float, float]:
    """Bottom of the first swing below the sliding level after a slip.

    The results are its depth, the standard uncertainty of that [N], and its instant [s].
    """
    # the tip runs forward all through that swing, so that friction is part of the level, whatever
    # comes after it
    time, force = motion.time, motion.force
    period = 1.0 / motion.frequency
    fallen = motion.fallen
    reach = (1.0 if time[fallen] - time[motion.peak] < period else 1.5) * period
    end = max(int(np.searchsorted(time, time[fallen] + reach)), fallen + 1)
    smooth = motion.smooth
    if motion.level - float(smooth[fallen:end].min()) < _FAINT * motion.noise:
        width = max(int(0.2 * period / float(np.median(np.diff(time)))), 1)
        smooth = np.convolve(force, np.full(width, 1.0 / width), mode="same")
    bottom, std, instant = find_extremum(
        time,
        force,
        min(fallen + int(np.argmin(smooth[fallen:end])), time.size - 6),
        _SWING_SHARE * period,
        motion.noise,
    )
    depth = motion.level - bottom
    before = instant - period
    if before < time[motion.peak] + 0.5 * period:
        return depth, std, instant
    # a tip that came down slowly rang meanwhile: which dip was the first below sliding is a matter
    # of noise, and where one just touches, the odds of that reading alone are noise themselves:
    # they are those that another would put it below
    begin, end = np.searchsorted(time, [before - 0.25 * period, before + 0.25 * period])
    bottom, spread, _ = find_extremum(
        time, force, int(begin + np.argmin(smooth[begin:end])), _SWING_SHARE * period, motion.noise
    )
    odds = 0.5 * math.erfc((bottom - motion.level) / spread / 2.0)
    apart = depth - max(motion.level - bottom, 0.0)
    return depth - odds * apart, math.hypot(std, math.sqrt(odds * (1.0 - odds)) * apart), instant


def classify_regime(motion: Motion, saw: Sawtooth | None, bell: bool) -> str:
    """Say what the tip did.

    `bell` says that a damped cosine explains the ring, as of a tool whose tip hangs free.
    """
    if saw is not None:
        return "stick-slip"
    if bell:
        return "snap"
    time, peak, fallen = motion.time, motion.peak, motion.fallen
    after = motion.normal[peak : int(np.searchsorted(time, time[fallen] + 5.0 / motion.frequency))]
    unloaded = after < min(
        float(after.min()) + _NO_LOAD * estimate_white_noise(motion.normal), _LIGHT * motion.load
    )
    if np.count_nonzero(unloaded) >= _FLIGHT_SAMPLES:
        return "flight"
    if (time[fallen] - time[peak]) * motion.frequency > 1.0:
        return "climb-down"
    # where the tip stands, but for the stiffness: it slips back where that falls
    swing = slice(fallen, int(np.searchsorted(time, time[fallen] + 1.5 / motion.frequency)))
    place = motion.slope * time[swing] - motion.smooth[swing]
    back = float(np.max(np.maximum.accumulate(place) - place)) if place.size else 0.0
    # it stops where the force is as far from sliding as its swing, but for the ramp, and slips back
    # past friction's other side
    omega = 2.0 * math.pi * motion.frequency
    depth, std, _ = find_first_swing(motion)
    stopped = math.sqrt(max(depth**2 - (motion.slope / omega) ** 2, 0.0))
    turns = stopped - std > 2.0 * motion.level + 2.0 * motion.damping * motion.slope / omega
    return "rubbing" if turns or back > _BACK_NOISE * motion.noise / math.sqrt(5.0) else "snap"
