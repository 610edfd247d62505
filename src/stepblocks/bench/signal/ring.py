"""The ring after the slip: that of a tool damped like a bell, or of one whose tip rubs.

A bell rings as ``A exp(-t / tau) cos(2 pi f t + phase)`` about a level, with what is left of the
release, hum and drift. Of a tip that rubs ``m x'' = f - F sgn(x') - c x'`` makes, with ``f = k (v t
- x)`` and ``D = 2 F``,

    f'' = -w^2 (f - L) - (2 / tau) f',    L = L+ while the tip slips forward (f' < k v), L+ - D
    while it slips back.

Each half cycle is a damped cosine about its level and costs the amplitude D; where the tip stops
between the levels, it sticks, and the force climbs along the ramp ``k v`` until it slips forward
again.
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import cast

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.separable import (
    SeparableFit,
    build_damped_wave_columns,
    build_wave_columns,
    compute_misfit,
    compute_numeric_jacobian,
    estimate_covariance,
    fit_separable,
    guess_ring,
    propagate_std,
)
from stepblocks.contact.kernels import compute_softened_force

# relative spread of frequency and decay time
GUESSED_SPREAD = (0.05, 0.4)  # about a guess from the trial itself
KNOWN_SPREAD = (0.02, 0.12)  # about what other trials give

_GOOD = 4.0  # misfit at which no other start is tried
# relative difference of costs that the optimiser's own tolerance makes; then the likelier start
# leads
_ALIKE = 1e-7
_ROUNDING = 1e-12  # change of a force that is rounding [N]
_SCALE = np.array([0.01, 0.05, 2.0, 5e-3, 0.05, 10.0, 0.1])  # in which the values of a fit move
_STEP = 1e-5  # of differences, in units of that scale
_MOST_PHASES = 5000
_EVEN = 1e-9  # of the time between two samples, within which they are even
# twice the sliding force times this: a tip that stops farther below it clearly slips back
_BEYOND = 1.4
_BEGIN = 8e-3  # time after the slip in which a wrong fit of a ring shows [s]
_RELEASE_DECAY = (0.05e-3, 0.4e-3, 1.5e-3)  # [s] least, first guess, most
_LITTLE = 0.02  # g A^2 with which a tool that hardens is tried
_HARD = 7.0  # misfit up to which another kind of ring than a cosine is taken
_CLOSER = 0.05  # share of the misfit of the cosine, likewise
_FINE_STEP = 1e-5  # [s] of the motion of a tool that hardens


@dataclass(frozen=True)
class Ring:
    """A damped ring and its uncertainties.

    Attributes
    ----------
    frequency : Estimate
        [Hz].
    decay_time : Estimate
        In which the amplitude falls to 1/e [s].
    level : Estimate
        About which it rings at `origin` [N].
    origin : float
        Instant that the fit counts from [s].
    columns : callable
        Of the fit, at times since `origin` [s] for a shape.
    fit : SeparableFit
        Shape: frequency, decay time, decay time of the release, of a tool that hardens g A^2 too;
        weights: level, drift, hum (2), release, of a gauge that bends its overtones (3), ring (2).
    misfit : float
        By how many standard errors the residuals miss the noise.
    """

    frequency: Estimate
    decay_time: Estimate
    level: Estimate
    origin: float
    columns: Callable[[Array, Array], Array]
    fit: SeparableFit
    misfit: float

    def curve(self, time: Array) -> Array:
        """Return the whole fit [N] at the instants `time`."""
        return self._model(time - self.origin, self.fit.shape)

    def curve_std(self, instant: float) -> float:
        """Return the standard uncertainty of `curve` at one instant [N]."""
        at = np.array([instant - self.origin])
        slopes = compute_numeric_jacobian(
            lambda shape: self._model(at, shape),
            self.fit.shape,
            np.array([1e-3, 1e-6, 1e-6, 1e-4])[: self.fit.shape.size],
        )
        return propagate_std(
            np.concatenate([slopes[0], self.columns(at, self.fit.shape)[0]]),
            self.fit.covariance,
        )

    def amplitude(self, instant: float) -> Estimate:
        """Amplitude of the ring, carried to an instant by its decay.

        Its standard uncertainty stands beside it [N].
        """
        cosine, sine = self.fit.weights[-2:]
        reach = instant - self.origin
        decay = self.decay_time[0]
        growth = float(np.exp(-reach / decay))
        size = float(np.hypot(cosine, sine))
        carried = size * growth
        gradient = np.zeros(self.fit.covariance.shape[0])
        gradient[1] = carried * reach / decay**2
        if size > 0.0:
            gradient[-2:] = growth * cosine / size, growth * sine / size
        return carried, propagate_std(gradient, self.fit.covariance)

    def _model(self, since: Array, shape: Array) -> Array:
        return np.asarray(self.columns(since, shape) @ self.fit.weights, dtype=float)


def fit_cosine(time: Array, force: Array, origin: float, mains: float, noise: float) -> Ring:
    """Fit a damped cosine to the samples after a slip."""
    start = np.array([*guess_ring(time, force), _RELEASE_DECAY[1]])
    return _fit_damped(
        time, force, origin, noise, partial(_build_ring_columns, origin, mains), start
    )


def fit_ring(
    time: Array, force: Array, origin: float, mains: float, noise: float, cosine: Ring | None = None
) -> Ring:
    """Fit a damped ring to the samples after a slip: `cosine`, where it is fitted already.

    Where it is seen, the ring is that of a tool that hardens, after Duffing, or of a gauge that
    bends.
    """
    fit_damped = partial(_fit_damped, time, force, origin, noise)
    build = partial(_build_ring_columns, origin, mains)
    ring = cosine or fit_cosine(time, force, origin, mains, noise)
    shape = ring.fit.shape
    since = time - origin
    found = [ring]
    if ring.fit.would_gain_from(_build_overtones(since, shape)):
        found.append(fit_damped(partial(build, bent=True), shape))
    about = ring.level[0] / ring.amplitude(origin)[0]
    hard = np.append(shape, _LITTLE)
    change = build(since, hard, about=about) - build(since, shape)
    if ring.fit.would_gain_from((change @ ring.fit.weights)[:, None]):
        harder = fit_damped(partial(build, about=about), hard)
        # about which level it rings is in units of an amplitude that a cosine misses
        about = harder.level[0] / harder.amplitude(origin)[0]
        found.append(fit_damped(partial(build, about=about), harder.fit.shape))
    best = min(found, key=lambda one: one.misfit)
    return best if best.misfit < max(_HARD, _CLOSER * ring.misfit) else ring


def _fit_damped(
    time: Array,
    force: Array,
    origin: float,
    noise: float,
    columns: Callable[[Array, Array], Array],
    start: Array,
) -> Ring:
    count = start.size
    least = 0.85 if count == 3 else 0.7
    fit = fit_separable(
        partial(columns, time - origin),
        force,
        start=start,
        lower=np.array([least * start[0], 1e-3, _RELEASE_DECAY[0], 0.0])[:count],
        upper=np.array([1.15 * start[0], 1.0, _RELEASE_DECAY[2], 3.0])[:count],
        scale=np.array([1.0, 5e-3, 1e-4, 0.05])[:count],
    )
    return Ring(
        frequency=(float(fit.shape[0]), fit.std(0)),
        decay_time=(float(fit.shape[1]), fit.std(1)),
        level=(float(fit.weights[0]), fit.std(count)),
        origin=origin,
        columns=columns,
        fit=fit,
        misfit=compute_misfit(
            fit.residuals,
            count + fit.weights.size,
            int(np.searchsorted(time, origin + _BEGIN)),
            noise,
        ),
    )


def _build_ring_columns(
    origin: float,
    mains: float,
    since: Array,
    shape: Array,
    *,
    about: float = 0.0,
    bent: bool = False,
) -> Array:
    # Level and drift from the slip on, hum on the clock of the record, rest of the release,
    # overtones of a gauge that bends, and ring.
    frequency, decay, release, *cubic = shape.tolist()
    hum = build_wave_columns(since + origin, mains)
    ring = (
        _build_hardening_columns(since, (frequency, decay, *cubic), about)
        if cubic
        else build_damped_wave_columns(since, frequency, decay)
    )
    columns = [np.ones_like(since), since, hum, np.exp(-since / release)]
    return np.column_stack([*columns, *([_build_overtones(since, shape)] if bent else []), ring])


def _build_overtones(since: Array, shape: Array) -> Array:
    # What the square of a ring holds: its octave, and a level that dies with it
    frequency, decay = shape[:2].tolist()
    return np.column_stack(
        [
            np.exp(-2.0 * since / decay),
            build_damped_wave_columns(since, 2.0 * frequency, 0.5 * decay),
        ]
    )


def _build_hardening_columns(since: Array, tool: tuple[float, ...], about: float) -> Array:
    # Force over its level of a tool with ``F = u + g u^3`` that is let go at an amplitude of 1, and
    # its rate over its pulsation. `tool` is the frequency of small swings about the level, the
    # decay time, and g; `about` is the level.
    frequency, decay, cubic = tool
    rest, first = compute_softened_force(about, cubic), compute_softened_force(about + 1.0, cubic)
    omega = 2.0 * math.pi * frequency / math.sqrt(1.0 + 3.0 * cubic * rest**2)
    time = np.abs(since)  # a little before the release the same as after it
    count = int(float(time.max()) / _FINE_STEP) + 2
    swing = _compile_once(_integrate_swing)(count, (omega, decay, cubic), about, first - rest, rest)
    clock = _FINE_STEP * np.arange(count)
    rate = np.interp(time, clock, swing[:, 1]) * np.sign(since) / (-2.0 * math.pi * frequency)
    return np.column_stack([np.interp(time, clock, swing[:, 0]), rate])


def _integrate_swing(
    count: int, tool: tuple[float, float, float], about: float, begin: float, rest: float
) -> Array:
    # Force over its level and its rate, step by step; written for a compiler, nothing checked
    omega, decay, cubic = tool
    result = np.empty((count, 2))
    kick = 0.5 * _FINE_STEP * omega**2
    shrink = math.exp(-_FINE_STEP / decay)
    u, v = rest + begin, -begin / decay
    for n in range(count):
        over = u + cubic * u**3 - about
        result[n] = over, (1.0 + 3.0 * cubic * u**2) * v
        u += _FINE_STEP * (v * shrink - kick * over)
        v = (v * shrink - kick * over - kick * (u + cubic * u**3 - about)) * shrink
    return result


@dataclass(frozen=True)
class RubbingRing:
    """A ring limited by friction and its uncertainties.

    Attributes
    ----------
    values : Array
        Shape (7,): level L+ [N], gap D [N], frequency [Hz], decay time [s], force at `origin` over
        L+ [N], slope there [N/s], drift [N/s].
    covariance : Array
        Shape (7, 7), of `values`.
    slope : float
        Of the force while the tip sticks [N/s].
    origin : float
        Instant that the fit counts from [s].
    misfit : float
        By how many standard errors the residuals miss the noise, see `separable.misfit`.
    residuals : Array
        Shape (n,), data minus fit [N].
    knows_gap : bool
        Whether the tip ever slipped back, so that the gap shows.
    """

    values: Array
    covariance: Array
    slope: float
    origin: float
    misfit: float
    residuals: Array
    knows_gap: bool

    def curve(self, time: Array) -> Array:
        """Return the fit without hum [N] at the instants `time`, all after `origin`."""
        return _compute_rubbing_with_drift(self.values, time - self.origin, self.slope)

    def std(self, index: int) -> float:
        """Return the standard uncertainty of one of `values`."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))


def compute_rubbing_force(
    time: Array, level: float, gap: float, tool: Tool, start: tuple[float, float], slope: float
) -> Array:
    """Force of the tool after the slip [N], piece by piece in closed form.

    It is 1e6 from where the tip chatters without end.
    """
    # `level` holds while the tip slips forward and is lower by `gap` while it slips back [N];
    # `start` is the force [N] and its rate [N/s] at 0; `slope` is that of the force while the tip
    # sticks [N/s].
    return np.asarray(
        _compile_once(_compute_rubbing)(time, (level, gap), tool, start, slope), dtype=float
    )


@cache
def _compile_once(kernel: Callable[..., Array]) -> Callable[..., Array]:
    # Compile a kernel when it is first wanted: a fit calls it some hundred times
    from numba import njit

    return cast("Callable[..., Array]", njit(cache=True, error_model="numpy")(kernel))


def _compute_rubbing(
    time: Array,
    levels: tuple[float, float],
    tool: tuple[float, float],
    start: tuple[float, float],
    slope: float,
) -> Array:
    # Go half cycle by half cycle, see `compute_rubbing_force`: in each the force over its level is
    # the real part of a swing that turns and dies, e^(pole t). It is compiled and checks nothing.
    (level, gap), (frequency, decay), (force, rate) = levels, tool, start
    omega = 2.0 * math.pi * frequency
    result = np.empty_like(time)
    count = time.size
    pole = complex(-1.0 / decay, omega)
    step = 2.0 * math.pi / omega / 20.0
    onward = cmath.exp(pole * step)
    # at the speed of the ramp the damping alone pulls as much as this deflection; it shifts where
    # the tip sticks
    shift = 2.0 / decay * slope / (omega * omega + 1.0 / (decay * decay))
    begin = 0.0
    done = 0
    forward = rate < slope
    for _ in range(_MOST_PHASES):
        rest = level if forward else level - gap
        swing = complex(force - rest, -(rate + (force - rest) / decay) / omega)
        moved = pole * swing  # its real part is the rate of the force
        # the tip turns where the force climbs as fast as the ramp; too small a ring never does
        turn = math.inf
        if gap > 0.0 and not (forward and abs(moved) <= slope):
            low, later = 0.0, moved * onward
            while low <= time[count - 1] - begin + step:
                if later.real > slope if forward else later.real < slope:
                    turn = low + 0.5 * step
                    for _ in range(6):  # Newton's, to the last digit
                        later = moved * cmath.exp(pole * turn)
                        left = (later.real - slope) / (pole * later).real
                        turn = min(max(turn - left, low), low + step)
                    break
                low += step
                later *= onward
        since = stride = 0.0
        factor = complex(1.0, 0.0)
        later = swing
        while done < count and time[done] - begin < turn:
            ahead = time[done] - begin - since
            if abs(ahead - stride) > _EVEN * abs(stride):
                stride, factor = ahead, cmath.exp(pole * ahead)
            since += ahead
            later *= factor
            result[done] = rest + later.real
            done += 1
        if done >= count:
            return result
        swing *= cmath.exp(pole * turn)
        force, rate = rest + swing.real, (pole * swing).real
        begin += turn
        if forward and force >= level - gap - shift and slope > 0.0:
            # it sticks, and is loaded along the ramp until it slips forward again
            wait = max(level - shift - force, 0.0) / slope
            while done < count and time[done] - begin < wait:
                result[done] = force + slope * (time[done] - begin)
                done += 1
            force = max(level - shift, force)
            rate = slope * (1.0 - 1e-9)
            begin += wait
        else:
            forward = not forward
    # not-a-number, or a tip that chatters without end: no model, and a fit must see that by its
    # size
    result[done:] = 1e6
    return result


def _compute_rubbing_with_drift(values: Array, time: Array, slope: float) -> Array:
    level, gap, frequency, decay, offset, rate, drift = values
    return np.asarray(
        compute_rubbing_force(time, level, gap, (frequency, decay), (level + offset, rate), slope)
        + drift * time,
        dtype=float,
    )


def fit_rubbing_ring(
    time: Array,
    force: Array,
    level: float,
    tool: Tool,
    slope: float,
    noise: float,
    *,
    spread: Tool = GUESSED_SPREAD,
) -> RubbingRing:
    """Fit a ring limited by friction, from a guess of its level and of the tool.

    Hum has been taken off before.
    """
    from scipy.optimize import least_squares

    frequency, decay = tool
    origin = float(time[0])
    # what is known of the tool holds a ring that is too faint to tell; a clear ring outweighs it
    known = noise / np.array([spread[0] * frequency, spread[1] * decay])
    begin = int(np.searchsorted(time, origin + _BEGIN))
    t = time - origin
    offset = float(force[:3].mean()) - level
    lower = np.array([-np.inf, 0.0, 0.7 * frequency, 2e-3, -np.inf, -np.inf, -np.inf])
    upper = np.array(
        [np.inf, max(4.0 * abs(offset), 0.2), 1.3 * frequency, 0.5, np.inf, np.inf, np.inf]
    )
    holding = np.pad(np.diag(known), ((0, 0), (2, 3)))  # of the third and fourth of seven values
    compute = partial(_compute_rubbing_with_drift, time=t, slope=slope)

    def differentiate(p: Array) -> Array:
        base = compute(p)
        slopes = [(compute(p + step) - base) / step.max() for step in np.diag(_STEP * _SCALE)[:-1]]
        return np.vstack([np.column_stack([*slopes, t]), holding])  # the drift is a line

    best = None
    # dry friction is the sliding force itself and turns with the tip: the likely gap is twice the
    # level
    for gap in (2.0 * abs(level), 0.3 * abs(offset), 0.0):
        found = least_squares(
            lambda p: np.append(compute(p) - force, (p[2:4] - (frequency, decay)) * known),
            np.clip(
                np.array([level, gap + 1e-6, frequency, decay, offset, 0.0, 0.0]), lower, upper
            ),
            jac=differentiate,
            bounds=(lower, upper),
            x_scale=_SCALE,
            max_nfev=40,
        )
        if best is None or found.cost < (1.0 - _ALIKE) * best.cost:
            best = found
        # a tip that never slips back in this course says nothing of the gap
        change = compute(best.x) - compute(best.x * [1.0, 0.98, 1.0, 1.0, 1.0, 1.0, 1.0])
        if compute_misfit(best.fun[:-2], 7, begin, noise) < _GOOD and bool(
            np.any(np.abs(change) > _ROUNDING)
        ):
            break
    assert best is not None
    values = np.asarray(best.x, dtype=float)
    residuals = -np.asarray(best.fun[:-2], dtype=float)
    jacobian = compute_numeric_jacobian(compute, values, 1e-3 * _SCALE, lower, upper)
    # a sample between two turns changes by the gap itself; a gap that moves less than one sample
    # was not seen
    knows_gap = bool(np.abs(jacobian[:, 1]).sum() > 1.0 and values[1] > 1e-5)
    # and of one that stops little beyond the other side of friction other gaps tell as much
    stopped = values[4] ** 2 - (slope / (2.0 * math.pi * values[2])) ** 2
    return RubbingRing(
        values,
        estimate_covariance(jacobian, residuals, holding),
        slope,
        origin,
        compute_misfit(residuals, 7, begin, noise),
        residuals,
        knows_gap and bool(stopped > (_BEYOND * 2.0 * level) ** 2),
    )
