"""The ring of a tool whose tip rubs: friction pulls at it one way or the other, and the ring dies on a straight line.

With ``f = k (v t - x)`` the force of the tool, ``m x'' = f - F sgn(x') - c x'`` becomes

    f'' = -w^2 (f - L) - (2 / tau) f',    L = L+ while the tip slips forward (f' < k v), L+ - D while it slips back,

with ``D = 2 F``. Each half cycle is a damped cosine about its level and costs the amplitude D; where the tip stops
between the levels, it sticks, and the force climbs along the ramp ``k v`` until it slips forward again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np

from stepblocks.bench.signal import Array, Tool
from stepblocks.bench.signal.ring import BEGIN
from stepblocks.bench.signal.separable import covariance_of, misfit, numeric_jacobian

# relative spread of frequency and decay time about a guess from the trial itself, and about what others told
GUESSED, TOLD = (0.05, 0.4), (0.02, 0.12)

_GOOD = 4.0  # misfit at which no other start is tried
_ALIKE = 1e-7  # relative difference of costs that the optimiser's own tolerance makes; then the likelier start leads
_ROUNDING = 1e-12  # change of a force that is rounding [N]
_SCALE = np.array([0.01, 0.05, 2.0, 5e-3, 0.05, 10.0, 0.1])  # in which the values of a fit move
_MOST_PHASES = 5000


@dataclass(frozen=True)
class RubbingRing:
    """A ring limited by friction and its uncertainties."""

    # shape (7,): level L+ [N], gap D [N], frequency [Hz], decay time [s], force at `origin` over L+ [N], slope there
    # [N/s], drift [N/s]
    values: Array
    covariance: Array  # shape (7, 7), of `values`
    slope: float  # of the force while the tip sticks [N/s]
    origin: float  # instant that the fit counts from [s]
    misfit: float  # by how many standard errors the residuals miss the noise, see `separable.misfit`
    residuals: Array  # shape (n,), data minus fit [N]
    knows_gap: bool  # whether the tip ever slipped back, so that the gap shows

    def curve(self, time: Array) -> Array:
        """Return the fit without hum [N] at the instants `time`, all after `origin`."""
        return _model(self.values, time - self.origin, self.slope)

    def std(self, index: int) -> float:
        """Return the standard uncertainty of one of `values`."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))


def rubbing_force(time: Array, level: float, gap: float, tool: Tool, start: tuple[float, float], slope: float) -> Array:
    """Force of the tool after the slip [N], piece by piece in closed form; 1e6 from where on the tip chatters without end.

    `level` holds while the tip slips forward and is lower by `gap` while it slips back [N]; `start` is the force [N] and its
    rate [N/s] at 0; `slope` is that of the force while the tip sticks [N/s].

    >>> t = np.linspace(0.0, 0.02, 50)
    >>> w = 2 * np.pi * 300.0
    >>> f = rubbing_force(t, 0.1, 0.0, (300.0, 0.02), (1.1, -1.0 / 0.02), 50.0)
    >>> bool(np.allclose(f, 0.1 + np.exp(-t / 0.02) * np.cos(w * t)))
    True
    """
    return np.asarray(_compiled()(time, level, gap, *tool, *start, slope), dtype=float)


@cache
def _compiled() -> Callable[..., Array]:
    """Compile the kernel when it is first wanted: a fit calls it some hundred times."""
    from numba import njit

    return cast("Callable[..., Array]", njit(cache=True)(_kernel))


def _kernel(
    time: Array, level: float, gap: float, frequency: float, decay: float, force: float, rate: float, slope: float
) -> Array:
    """Go half cycle by half cycle; written for a compiler, nothing checked. See `rubbing_force`."""
    omega = 2.0 * math.pi * frequency
    result = np.empty_like(time)
    count = time.size
    step = 2.0 * math.pi / omega / 20.0
    # at the speed of the ramp the damping alone pulls as much as this deflection; it shifts where the tip sticks
    shift = 2.0 / decay * slope / (omega * omega + 1.0 / (decay * decay))
    begin, done = 0.0, 0
    forward = rate < slope
    for _ in range(_MOST_PHASES):
        rest = level if forward else level - gap
        a = force - rest
        b = (rate + a / decay) / omega
        p, q = b * omega - a / decay, a * omega + b / decay
        sign = 1.0 if forward else -1.0
        # the tip turns where the force climbs as fast as the ramp; too small a ring never does
        horizon = time[count - 1] - begin + step
        turn = math.inf
        if gap > 0.0 and not (forward and math.hypot(p, q) <= slope):
            low, high = 0.0, step
            while low <= horizon:
                rise = math.exp(-high / decay) * (p * math.cos(omega * high) - q * math.sin(omega * high))
                if sign * (rise - slope) > 0.0:
                    for _ in range(36):
                        middle = 0.5 * (low + high)
                        rise = math.exp(-middle / decay) * (p * math.cos(omega * middle) - q * math.sin(omega * middle))
                        if sign * (rise - slope) > 0.0:
                            high = middle
                        else:
                            low = middle
                    turn = high
                    break
                low, high = high, high + step
        while done < count and time[done] - begin < turn:
            t = time[done] - begin
            result[done] = rest + math.exp(-t / decay) * (a * math.cos(omega * t) + b * math.sin(omega * t))
            done += 1
        if done >= count:
            return result
        shrink, c, s = math.exp(-turn / decay), math.cos(omega * turn), math.sin(omega * turn)
        force = rest + shrink * (a * c + b * s)
        rate = shrink * ((b * omega - a / decay) * c - (a * omega + b / decay) * s)
        begin += turn
        if forward and force >= level - gap - shift and slope > 0.0:
            # it sticks, and is loaded along the ramp until it slips forward again
            wait = max(level - shift - force, 0.0) / slope
            while done < count and time[done] - begin < wait:
                result[done] = force + slope * (time[done] - begin)
                done += 1
            force, rate, begin = max(level - shift, force), slope * (1.0 - 1e-9), begin + wait
        else:
            forward = not forward
    # not-a-number, or a tip that chatters without end: no model, and a fit must see that by its size
    result[done:] = 1e6
    return result


def _model(values: Array, time: Array, slope: float) -> Array:
    level, gap, frequency, decay, offset, rate, drift = values
    force = rubbing_force(time, level, gap, (frequency, decay), (level + offset, rate), slope)
    return np.asarray(force + drift * time, dtype=float)


def fit_rubbing_ring(
    time: Array, force: Array, level: float, tool: Tool, slope: float, noise: float, *, spread: Tool = GUESSED
) -> RubbingRing:
    """Fit a ring limited by friction, hum taken off before, from a guess of its level and of the tool."""
    from scipy.optimize import least_squares

    (frequency, decay), origin = tool, float(time[0])
    # what is known of the tool holds a ring that is too faint to tell; a clear ring outweighs it
    known = noise / np.array([spread[0] * frequency, spread[1] * decay])
    begin = int(np.searchsorted(time, origin + BEGIN))
    t = time - origin
    offset = float(force[:3].mean()) - level
    lower = np.array([-np.inf, 0.0, 0.7 * frequency, 2e-3, -np.inf, -np.inf, -np.inf])
    upper = np.array([np.inf, max(4.0 * abs(offset), 0.2), 1.3 * frequency, 0.5, np.inf, np.inf, np.inf])
    best = None
    # dry friction is the sliding force itself and turns with the tip: the likely gap is twice the level
    for gap in (2.0 * abs(level), 0.3 * abs(offset), 0.0):
        start = np.array([level, gap + 1e-6, frequency, decay, offset, 0.0, 0.0])
        found = least_squares(
            lambda p: np.append(_model(p, t, slope) - force, (p[2:4] - (frequency, decay)) * known),
            np.clip(start, lower, upper),
            bounds=(lower, upper),
            x_scale=_SCALE,
            max_nfev=40,
            diff_step=1e-6,
        )
        if best is None or found.cost < (1.0 - _ALIKE) * best.cost:
            best = found
        # a tip that never slips back in this course says nothing of the gap
        moved = _model(best.x, t, slope) - _model(best.x * [1.0, 0.98, 1.0, 1.0, 1.0, 1.0, 1.0], t, slope)
        if misfit(best.fun[:-2], 7, begin, noise) < _GOOD and bool(np.any(np.abs(moved) > _ROUNDING)):
            break
    assert best is not None
    values, residuals = np.asarray(best.x, dtype=float), -np.asarray(best.fun[:-2], dtype=float)
    jacobian = numeric_jacobian(lambda p: _model(p, t, slope), values, 1e-3 * _SCALE, lower, upper)
    prior = np.zeros((2, 7))
    prior[0, 2], prior[1, 3] = known
    covariance, missed = covariance_of(jacobian, residuals, prior), misfit(residuals, 7, begin, noise)
    # a sample between two turns changes by the gap itself; a gap that moves less than one sample was not seen
    knows_gap = bool(np.abs(jacobian[:, 1]).sum() > 1.0 and values[1] > 1e-5)
    return RubbingRing(values, covariance, slope, origin, missed, residuals, knows_gap)
