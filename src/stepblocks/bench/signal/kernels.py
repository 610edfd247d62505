"""Motions of a tool step by step and piece by piece, compiled when they are first wanted.

The functions are written for a compiler and check nothing.
"""

import cmath
import math

import numpy as np

from stepblocks.bench.signal import Array
from stepblocks.compute.compiled import njit

FINE_STEP = 1e-5  # of the motion of a tool that hardens [s]
_MOST_PHASES = 5000  # half cycles, after which a tip chatters without end
_EVEN = 1e-9  # of the time between two samples, within which they are even
_STEPS_PER_CYCLE = 20.0  # in which a turn of the tip is looked for
_NEWTON_STEPS = 6  # to the last digit
_NO_MODEL = 1e6  # force where there is no model, which a fit sees by its size [N]


@njit(cache=True, error_model="numpy")
def integrate_swing(
    time: Array,
    tool: tuple[float, float, float],
    level: float,
    first_force: float,
    linear_force_at_level: float,
) -> Array:
    """Integrate the swing of a tool with ``F = u + g u^3`` that is let go.

    Parameters
    ----------
    time : Array
        Shape (n,), instants from 0 on [s].
    tool : tuple of float
        Pulsation [rad/s], decay time [s], and g.
    level : float
        Force at rest.
    first_force, linear_force_at_level : float
        Deflection u when it is let go over that at rest, and that at rest.

    Returns
    -------
    Array
        Shape (2, n), force over its level and its rate, on straight lines between the steps.
    """
    omega, decay, cubic = tool
    count = int(time.max() / FINE_STEP) + 2
    force = np.empty(count)
    rate = np.empty(count)
    kick = 0.5 * FINE_STEP * omega**2
    shrink = math.exp(-FINE_STEP / decay)
    u = linear_force_at_level + first_force
    v = -first_force / decay
    for n in range(count):
        over = u + cubic * u**3 - level
        force[n] = over
        stiffness = 1.0 + 3.0 * cubic * u**2
        rate[n] = stiffness * v
        half_way = v * shrink - kick * over
        u += FINE_STEP * half_way
        over_then = u + cubic * u**3 - level
        v = (half_way - kick * over_then) * shrink
    result = np.empty((2, time.size))
    for i in range(time.size):
        steps = time[i] / FINE_STEP
        n = int(steps)
        share = steps - n
        force_change = force[n + 1] - force[n]
        rate_change = rate[n + 1] - rate[n]
        result[0, i] = force[n] + share * force_change
        result[1, i] = rate[n] + share * rate_change
    return result


@njit(cache=True, error_model="numpy")
def compute_rubbing_curve(
    time: Array,
    levels: tuple[float, float],
    tool: tuple[float, float],
    force_and_rate: tuple[float, float],
    slope: float,
) -> Array:
    """Compute the force of a tool whose tip rubs, half cycle by half cycle.

    In each the force over its level is the real part of a swing that turns and dies, e^(pole t).

    Parameters
    ----------
    time : Array
        Shape (n,), instants from 0 on [s].
    levels : tuple of float
        Level while the tip slips forward, and by how much it is lower while it slips back [N].
    tool : tuple of float
        Frequency [Hz] and decay time [s].
    force_and_rate : tuple of float
        Force [N] and its rate [N/s] at 0.
    slope : float
        Rate of the force while the tip sticks [N/s].

    Returns
    -------
    Array
        Shape (n,) [N].
    """
    level, gap = levels
    frequency, decay = tool
    force, rate = force_and_rate
    omega = 2.0 * math.pi * frequency
    result = np.empty_like(time)
    count = time.size
    pole = complex(-1.0 / decay, omega)
    step = 2.0 * math.pi / omega / _STEPS_PER_CYCLE
    # at the speed of the ramp the damping alone pulls as much as this deflection; it shifts where
    # the tip sticks
    shift = 2.0 / decay * slope / (omega * omega + 1.0 / (decay * decay))
    begin = 0.0
    done = 0
    forward = rate < slope
    for _ in range(_MOST_PHASES):
        about = level if forward else level - gap
        swing = complex(force - about, -(rate + (force - about) / decay) / omega)
        moved = pole * swing  # its real part is the rate of the force
        # the tip turns where the force climbs as fast as the ramp; too small a ring never does
        turn = math.inf
        if gap > 0.0 and not (forward and abs(moved) <= slope):
            turn = _find_turning_time(moved, pole, step, slope, forward, time[count - 1] - begin)
        done = _fill_swing_samples(result, time, done, begin, turn, about, swing, pole)
        if done >= count:
            return result
        swing *= cmath.exp(pole * turn)
        force = about + swing.real
        rate = (pole * swing).real
        begin += turn
        if forward and force >= level - gap - shift and slope > 0.0:
            # it sticks, and is loaded along the ramp until it slips forward again
            wait = max(level - shift - force, 0.0) / slope
            done = _fill_ramp_samples(result, time, done, begin, wait, force, slope)
            force = max(level - shift, force)
            rate = slope * (1.0 - 1e-9)
            begin += wait
        else:
            forward = not forward
    # not-a-number, or a tip that chatters without end
    result[done:] = _NO_MODEL
    return result


@njit(cache=True, error_model="numpy")
def compute_drifting_rubbing_curve(time: Array, values: Array, slope: float) -> Array:
    """Compute the force of the seven values of a `RubbingRing`, shape (n,); see there."""
    level, gap, frequency, decay, offset, rate, drift = values
    force = compute_rubbing_curve(
        time, (level, gap), (frequency, decay), (level + offset, rate), slope
    )
    return force + drift * time


@njit(cache=True, error_model="numpy")
def differentiate_drifting_rubbing_curve(
    time: Array, values: Array, steps: Array, slope: float
) -> Array:
    """Find the slopes of `compute_drifting_rubbing_curve` by differences, shape (7, n).

    `steps` are those of the values, shape (7,). The last value is the drift, a line.
    """
    slopes = np.empty((values.size, time.size))
    force = compute_drifting_rubbing_curve(time, values, slope)
    moved = values.copy()
    for place in range(values.size - 1):
        moved[place] = values[place] + steps[place]
        slopes[place] = (compute_drifting_rubbing_curve(time, moved, slope) - force) / steps[place]
        moved[place] = values[place]
    slopes[-1] = time
    return slopes


@njit(cache=True, error_model="numpy")
def _find_turning_time(
    complex_rate: complex, pole: complex, step: float, slope: float, forward: bool, duration: float
) -> float:
    """Return when the tip turns: where the force climbs as fast as the ramp [s].

    It is infinite where the tip does not turn within the duration [s]. The rate of the force
    [N/s] is the real part of `complex_rate`, which turns with the pole.
    """
    onward = cmath.exp(pole * step)
    low = 0.0
    later = complex_rate * onward
    while low <= duration + step:
        if later.real > slope if forward else later.real < slope:
            turn = low + 0.5 * step
            for _ in range(_NEWTON_STEPS):
                later = complex_rate * cmath.exp(pole * turn)
                left = (later.real - slope) / (pole * later).real
                turn = min(max(turn - left, low), low + step)
            return turn
        low += step
        later *= onward
    return math.inf


@njit(cache=True, error_model="numpy")
def _fill_swing_samples(
    result: Array,
    time: Array,
    filled_count: int,
    phase_start: float,
    turning_time: float,
    level: float,
    swing: complex,
    pole: complex,
) -> int:
    """Fill in the samples up to a turn; return how many samples are filled in.

    `level` is the level of the force [N], `swing` its motion about it at `phase_start` [s].
    """
    since = 0.0
    stride = 0.0
    factor = complex(1.0, 0.0)
    later = swing
    while filled_count < time.size and time[filled_count] - phase_start < turning_time:
        ahead = time[filled_count] - phase_start - since
        if abs(ahead - stride) > _EVEN * abs(stride):
            stride = ahead
            factor = cmath.exp(pole * ahead)
        since += ahead
        later *= factor
        result[filled_count] = level + later.real
        filled_count += 1
    return filled_count


@njit(cache=True, error_model="numpy")
def _fill_ramp_samples(
    result: Array,
    time: Array,
    filled_count: int,
    phase_start: float,
    sticking_time: float,
    force: float,
    slope: float,
) -> int:
    """Fill in the samples while the tip sticks; return how many samples are filled in."""
    while filled_count < time.size and time[filled_count] - phase_start < sticking_time:
        result[filled_count] = force + slope * (time[filled_count] - phase_start)
        filled_count += 1
    return filled_count
