"""The ring of a tool whose tip rubs: friction pulls at it one way or the other, and the ring dies on a straight line.

With ``f = k (v t - x)`` the force of the tool, ``m x'' = f - F sgn(x') - c x'`` becomes

    f'' = -w^2 (f - L) - (2 / tau) f',    L = L+ while the tip slips forward (f' < k v), L+ - D while it slips back,

with ``D = 2 F``. Each half cycle is a damped cosine about its level and costs the amplitude D; where the tip stops
between the levels, it sticks, and the force climbs along the ramp ``k v`` until it slips forward again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.separable import covariance_of, numeric_jacobian

__all__ = ["RubbingRing", "fit_rubbing_ring", "rubbing_force"]

Array = NDArray[np.float64]

_MOST_PHASES = 400
_MOST_STEPS = 2000
_GOOD = 1.3  # squared noise over white noise at which no other start is tried


@dataclass(frozen=True)
class RubbingRing:
    """A ring limited by friction and its uncertainties.

    Attributes
    ----------
    values : ndarray, shape (7,)
        Level L+ [N], gap D [N], frequency [Hz], decay time [s], force at `origin` over L+ [N], slope there [N/s],
        drift [N/s].
    covariance : ndarray, shape (7, 7)
        Of `values`.
    slope : float
        Slope of the force while the tip sticks [N/s].
    origin : float
        Instant that the fit counts from [s].
    chi_square : float
        Squared noise of the fit over the white noise of the trace.
    """

    values: Array
    covariance: Array
    slope: float
    origin: float
    chi_square: float
    residuals: Array

    def curve(self, time: Array) -> Array:
        """The fit without hum [N] at the instants `time`, all after `origin`."""
        return _model(self.values, time - self.origin, self.slope)

    @property
    def knows_gap(self) -> bool:
        """Whether the ring ever turned back, so that its gap shows."""
        return bool(0.0 < self.covariance[1, 1] < np.inf) and self.std(1) < 10.0 * max(float(self.values[1]), 1e-9)

    def std(self, index: int) -> float:
        """Standard uncertainty of one of `values`."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def amplitude(self, instant: float) -> tuple[float, float]:
        """Amplitude about L+ carried back to `instant`, and its standard uncertainty [N].

        Between the slip and `origin` the tip only slips forward, so the friction is part of L+ and costs nothing;
        viscous decay is carried back.
        """
        reach = instant - self.origin

        def size(values: Array) -> Array:
            omega = 2.0 * np.pi * values[2]
            swing = np.hypot(values[4], (values[5] + values[4] / values[3]) / omega)
            return np.array([swing * np.exp(-reach / values[3])])

        step = 1e-4 * _SCALE
        unbounded = np.full(7, np.inf)
        gradient = numeric_jacobian(size, self.values, step, -unbounded, unbounded)[0]
        return float(size(self.values)[0]), float(np.sqrt(max(gradient @ self.covariance @ gradient, 0.0)))


_SCALE = np.array([0.01, 0.05, 2.0, 5e-3, 0.05, 10.0, 0.1])


def rubbing_force(
    time: Array, level: float, gap: float, frequency: float, decay_time: float, start: tuple[float, float], slope: float
) -> Array:
    """Force of the tool after the slip, piece by piece in closed form.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Instants since the begin [s], ascending from 0 or later.
    level, gap : float
        L+ and D [N].
    frequency, decay_time : float
        Of the damped ring [Hz, s].
    start : tuple of float
        Force [N] and its slope [N/s] at time 0.
    slope : float
        Slope while the tip sticks, ``k v`` [N/s].

    Returns
    -------
    ndarray, shape (n,)
        Force [N].

    Examples
    --------
    Without a gap it is the damped cosine.

    >>> t = np.linspace(0.0, 0.02, 50)
    >>> w = 2 * np.pi * 300.0
    >>> f = rubbing_force(t, 0.1, 0.0, 300.0, 0.02, (1.1, -1.0 / 0.02), 50.0)
    >>> bool(np.allclose(f, 0.1 + np.exp(-t / 0.02) * np.cos(w * t)))
    True
    """
    omega = 2.0 * math.pi * frequency
    result = np.empty_like(time)
    begin, force, rate, done = 0.0, start[0], start[1], 0
    forward = rate < slope
    for _ in range(_MOST_PHASES):
        rest = level if forward else level - gap
        a = force - rest
        b = (rate + a / decay_time) / omega
        turn = _turn(a, b, omega, decay_time, slope, forward) if gap > 0.0 else math.inf
        upto = done + int(np.searchsorted(time[done:], begin + turn))
        t = time[done:upto] - begin
        result[done:upto] = rest + np.exp(-t / decay_time) * (a * np.cos(omega * t) + b * np.sin(omega * t))
        done = upto
        if done >= time.size:
            return result
        shrink, c, s = math.exp(-turn / decay_time), math.cos(omega * turn), math.sin(omega * turn)
        force = rest + shrink * (a * c + b * s)
        rate = shrink * ((b * omega - a / decay_time) * c - (a * omega + b / decay_time) * s)
        begin += turn
        if forward and force >= level - gap and slope > 0.0:
            wait = max(level - force, 0.0) / slope
            upto = done + int(np.searchsorted(time[done:], begin + wait))
            result[done:upto] = force + slope * (time[done:upto] - begin)
            done = upto
            force, rate, begin = max(level, force), slope * (1.0 - 1e-9), begin + wait
            if done >= time.size:
                return result
        else:
            forward = not forward
    result[done:] = level
    return result


def _turn(a: float, b: float, omega: float, decay: float, slope: float, forward: bool) -> float:
    """First instant at which the force climbs faster (slower, where not `forward`) than the ramp; inf for never."""
    p, q = b * omega - a / decay, a * omega + b / decay
    size = math.hypot(p, q)
    if forward and size <= slope:
        return math.inf
    sign = 1.0 if forward else -1.0

    def excess(t: float) -> float:
        return sign * (math.exp(-t / decay) * (p * math.cos(omega * t) - q * math.sin(omega * t)) - slope)

    # the rate is size exp(-t/decay) cos(omega t + phase): within each period it passes `slope` near a known phase
    step = 2.0 * math.pi / omega / 20.0
    last = decay * math.log(size / slope) if forward and slope > 0.0 else math.inf
    low, high = 0.0, step
    for _ in range(_MOST_STEPS):
        if excess(high) > 0.0:
            break
        low, high = high, high + step
        if low > last:
            return math.inf
    else:
        return math.inf
    for _ in range(26):
        middle = 0.5 * (low + high)
        if excess(middle) > 0.0:
            high = middle
        else:
            low = middle
    return high


def _model(values: Array, time: Array, slope: float) -> Array:
    level, gap, frequency, decay, offset, rate, drift = values
    force = rubbing_force(time, level, gap, frequency, decay, (level + offset, rate), slope)
    return np.asarray(force + drift * (time - time.mean()), dtype=float)


def fit_rubbing_ring(
    time: Array,
    force: Array,
    origin: float,
    guess: tuple[float, float, float],
    slope: float,
    noise: float,
) -> RubbingRing:
    """Fit a ring limited by friction to the samples from `origin` on, hum taken off before.

    Parameters
    ----------
    time, force : ndarray, shape (n,)
        Instants [s] and force [N]; the first sample near the first trough after the slip.
    origin : float
        Instant to count from [s].
    guess : tuple of float
        Level [N], frequency [Hz] and decay time [s].
    slope : float
        Slope of the loading ramp [N/s].
    noise : float
        White noise of the trace [N].

    Returns
    -------
    RubbingRing
        The best of several starts.
    """
    from scipy.optimize import least_squares

    level, frequency, decay = guess
    t = time - origin
    offset = float(force[:3].mean()) - level
    lower = np.array([-np.inf, 0.0, 0.7 * frequency, 2e-3, -np.inf, -np.inf, -np.inf])
    upper = np.array([np.inf, max(4.0 * abs(offset), 0.2), 1.3 * frequency, 0.5, np.inf, np.inf, np.inf])
    best = None
    # dry friction is the sliding force itself and turns with the tip: the likely gap is twice the level
    for gap in (2.0 * abs(level), 0.3 * abs(offset), 0.0):
        start = np.array([level, gap + 1e-6, frequency, decay, offset, 0.0, 0.0])
        found = least_squares(
            lambda p: _model(p, t, slope) - force,
            np.clip(start, lower, upper),
            bounds=(lower, upper),
            x_scale=_SCALE,
            max_nfev=40,
            diff_step=1e-6,
        )
        if best is None or found.cost < best.cost:
            best = found
        if 2.0 * best.cost < _GOOD * noise**2 * t.size:
            break
    assert best is not None
    values = np.asarray(best.x, dtype=float)
    jacobian = numeric_jacobian(lambda p: _model(p, t, slope), values, 1e-3 * _SCALE, lower, upper)
    residuals = -np.asarray(best.fun, dtype=float)
    covariance, spread = covariance_of(jacobian, residuals)
    chi_square = (spread / noise) ** 2 if noise > 0.0 else np.inf
    return RubbingRing(values, covariance, slope, origin, chi_square, residuals)
