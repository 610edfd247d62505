"""The kind of ring after the slip, and its figures carried back to the release."""

import math
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.approach import Approach, Landmarks
from stepblocks.bench.signal.regimes import USUAL_TOOL, Motion, Sawtooth, find_first_swing
from stepblocks.bench.signal.ring import (
    GUESSED_SPREAD,
    KNOWN_SPREAD,
    Ring,
    RubbingRing,
    fit_cosine,
    fit_ring,
    fit_rubbing_ring,
)
from stepblocks.bench.signal.separable import (
    build_damped_wave_columns,
    build_wave_columns,
    fit_with_covariance,
    guess_ring,
    propagate_std,
)
from stepblocks.contact.kernels import compute_softened_force

# [s] first samples after the peak, in which the sensor itself follows; no tie with a sample
_RELEASE_TIME = 0.25e-3
_GOOD = 5.0  # misfit up to which a fit is taken at once
# of a bell's amplitude, and of the sliding level: what misses a bell by less, of a tip that slips
# back without a gap, are loops of the gauge and no friction
_SLIGHT = 0.005
_GAP = 0.1  # of the sliding level, likewise, from which a gap is friction: a bent gauge makes 0.007
_BETTER = 0.85  # a second kind of fit must leave this share of the squared residuals at most
_TAIL_SHARE = (
    0.35  # last share of the record after the slip, in which only the tool's own ring is left
)
_SETTLED = 7.0  # misfit up to which a trough is taken for the begin of the free ring
_MUCH_BETTER = (
    0.5  # a later trough must leave this share at most: some of the ring is lost with each
)
_MOST_COLOUR = 3.0  # the noise while sliding counts up to this many times the white noise
_MOST_TROUGHS = 8
_KNOWN_DECAY_SPREAD = (
    0.01  # by which the median of a session's clear trials misses the decay time of its tool
)
_FAR = 2.5  # spreads of the tool's figures within which a fit is still of that tool
_FIRST_SWINGS = 25e-3  # [s]
_HEARD = 1.3
_USUAL_DECAY = 25e-3  # [s] first guess where nothing says better
_SETTLE = 0.8e-3  # [s] after the slip in which the normal channel shows the release itself
_ONSET_GUARD = 1e-3  # [s]
_NOT_KNOWN = (math.nan, math.nan)


@dataclass(frozen=True)
class Swing:
    """First swing after a slip: how far below the sliding level it went, and when.

    Attributes
    ----------
    depth : Estimate
        Level less the force in the trough, and its standard uncertainty [N].
    instant : float
        When the trough was reached [s].
    decay_time : Estimate
        Of the tool, and its standard uncertainty [s].
    half : float
        Of the tool's period [s].
    """

    depth: Estimate
    instant: float
    decay_time: Estimate
    half: float = 0.0

    def amplitude(self, instant: float) -> Estimate:
        """Amplitude carried back to `instant`, and its standard uncertainty [N].

        Viscous decay alone is taken into account.
        """
        (depth, depth_std), (decay, decay_std) = self.depth, self.decay_time
        reach = self.instant - instant
        growth = float(np.exp(reach / decay))
        carried = depth * growth
        return carried, float(np.hypot(depth_std * growth, carried * reach / decay**2 * decay_std))


@dataclass(frozen=True)
class Aftermath:
    """Figures of the ring at the release instant, each with its standard uncertainty.

    Attributes
    ----------
    ring : Ring | RubbingRing
        The fit.
    start : float
        Instant to which the amplitude is carried back [s].
    amplitude : Estimate
        [N].
    frequency : Estimate
        [Hz].
    decay_time : Estimate
        [s].
    level : Estimate
        [N].
    friction_decay : Estimate
        Loss of amplitude to friction per time, beside the exponential decay [N/s].
    swing : Swing | None
        First after the slip, which tells the amplitude of a ring that is no bell's.
    sample : float
        Time between two samples [s].
    """

    ring: Ring | RubbingRing
    start: float
    amplitude: Estimate
    frequency: Estimate
    decay_time: Estimate
    level: Estimate
    friction_decay: Estimate = _NOT_KNOWN
    swing: Swing | None = None
    sample: float = 0.0

    @property
    def damped(self) -> bool:
        """Whether it rings like a bell; else its tip rubs."""
        return self.swing is None

    def carry_to(self, instant: float) -> "Aftermath":
        """Return the same with the amplitude at another instant [s]."""
        if isinstance(self.ring, Ring):
            return replace(self, start=instant, amplitude=self.ring.amplitude(instant))
        assert self.swing is not None
        # a tip that took its time to fall has rung for half a period all the same when it has swung
        # through
        instant = max(instant, self.swing.instant - self.swing.half)
        return replace(self, start=instant, amplitude=self.swing.amplitude(instant))


def fit_aftermath(
    time: Array,
    force: Array,
    marks: Landmarks,
    approach: Approach,
    tool: Tool | None = None,
    *,
    saw: Sawtooth | None = None,
) -> Aftermath:
    """Fit the ring after a slip, as that of a bell or of a tool whose tip rubs."""
    marks = replace(marks, noise=estimate_sliding_noise(time, approach, marks))
    top = float(time[marks.peak])
    # it is no bell, and what the tip draws when the ring has died is no part of that
    if saw is not None:
        end = int(np.searchsorted(time, top + _FIRST_SWINGS))
        time, force = time[:end], force[:end]
    first = int(np.searchsorted(time, top + _RELEASE_TIME))
    cosine = (
        fit_cosine(time[first:], force[first:], top, approach.mains, marks.noise)
        if saw is None
        else None
    )
    rubbing = (
        None
        if cosine and cosine.misfit < _GOOD
        else _fit_best_rubbing(time, force, marks, approach, tool)
    )
    # a tip that clearly slips back is no bell that hardens, or that its gauge bends
    if rubbing is None or (
        saw is None
        and not (
            rubbing.misfit < _GOOD
            and rubbing.knows_gap
            and rubbing.values[1] > _GAP * rubbing.values[0]
        )
    ):
        bell = fit_bell(time, force, top, approach.mains, marks.noise, cosine)
        assert isinstance(bell.ring, Ring)
        if rubbing is None or bell.ring.misfit < _GOOD:
            return bell
        left = bell.ring.fit.residuals[time[first:] >= rubbing.origin]
        # what misses a bell in its first swing alone hardly weighs in the sum
        if (
            rubbing.misfit > _GOOD
            and float(np.sum(rubbing.residuals**2)) > _BETTER * float(np.sum(left**2))
        ) or (
            rubbing.values[1] < _SLIGHT * rubbing.values[0]
            and float(np.std(bell.ring.fit.residuals))
            < _SLIGHT * min(bell.amplitude[0], marks.rise)
        ):
            return bell
    frequency, decay = tool or (float(rubbing.values[2]), float(rubbing.values[3]))
    known = KNOWN_SPREAD[1] if tool is USUAL_TOOL else _KNOWN_DECAY_SPREAD
    spread = min(known * decay, rubbing.std(3)) if tool else rubbing.std(3)
    clean = force - approach.hum(time)
    reach = top - approach.center
    drift = float(approach.fit.weights[1]) * reach
    depth, std, instant = find_first_swing(
        Motion(
            time,
            clean,
            clean,
            marks.peak,
            approach.level + drift,
            0.0,
            approach.slope,
            marks.noise,
            frequency,
        )
    )
    # a tool that hardens swings less far below its level than above it, where it was let go
    swung = compute_softened_force(max(depth, 0.0), approach.hardening)
    depth += 3.0 * approach.hardening * approach.level * swung * (swung - approach.level)
    level_std = approach.level_std if saw is None else saw.kinetic[1]
    drift_std = approach.fit.std(approach.fit.shape.size + 1) * reach
    return _measure_aftermath_of_rubbing(
        rubbing,
        Swing(
            (depth, math.hypot(std, level_std, drift_std)),
            instant,
            (decay, spread),
            0.5 / frequency,
        ),
        float(np.median(np.diff(time))),
        tool,
    )


def fit_bell(
    time: Array,
    force: Array,
    release: float,
    mains: float,
    noise: float,
    cosine: Ring | None = None,
) -> Aftermath:
    """Fit a damped ring, counted from the release."""
    first = int(np.searchsorted(time, release + _RELEASE_TIME))
    bell = fit_ring(time[first:], force[first:], release, mains, noise, cosine)
    return Aftermath(
        bell, release, bell.amplitude(release), bell.frequency, bell.decay_time, bell.level
    )


def estimate_sliding_noise(time: Array, approach: Approach, marks: Landmarks) -> float:
    """Noise while sliding, be it white or coloured [N]."""
    before = approach.fit.residuals[: int(np.searchsorted(time, approach.onset))]
    return min(max(float(np.std(before)), marks.noise), _MOST_COLOUR * marks.noise)


def _measure_aftermath_of_rubbing(
    fit: RubbingRing, swing: Swing, sample: float, tool: Tool | None
) -> Aftermath:
    level, gap, frequency, decay = (float(v) for v in fit.values[:4])
    # a fit of few swings may find another tool: then it knows no better than that
    far = (
        (abs(frequency - tool[0]), abs(decay - tool[1]))
        if tool is not None
        and any(abs(fit.values[2 + i] - tool[i]) > _FAR * KNOWN_SPREAD[i] * tool[i] for i in (0, 1))
        else (0.0, 0.0)
    )
    known = fit.knows_gap and not any(far)
    seen = (
        (frequency, float(np.hypot(fit.std(2), far[0]))),
        (decay, float(np.hypot(fit.std(3), far[1]))),
    )
    loss = (2.0 * gap * frequency, 2.0 * frequency * fit.std(1)) if known else _NOT_KNOWN
    return Aftermath(
        fit, -math.inf, _NOT_KNOWN, *seen, (level, fit.std(0)), loss, swing, sample
    ).carry_to(-math.inf)


def _fit_best_rubbing(
    time: Array, force: Array, marks: Landmarks, approach: Approach, tool: Tool | None
) -> RubbingRing | None:
    # Fit from one trough after the other, until the tip no longer climbs
    clean = force - approach.hum(time)
    after = clean[marks.peak :]
    level = float(np.median(after[int(after.size * (1.0 - _TAIL_SHARE)) :]))
    best: RubbingRing | None = None
    for guess in _guess_tools(time, clean, marks, approach, tool):
        for trough in _find_troughs(time, clean, marks, level, guess[0]):
            fit = fit_rubbing_ring(
                time[trough:],
                clean[trough:],
                level,
                guess,
                approach.slope,
                marks.noise,
                spread=KNOWN_SPREAD if tool else GUESSED_SPREAD,
            )
            if best is None or fit.misfit < _MUCH_BETTER * best.misfit:
                best = fit
            if best.misfit < _SETTLED:
                return best
    return best


def _guess_tools(
    time: Array, clean: Array, marks: Landmarks, approach: Approach, tool: Tool | None
) -> list[Tool]:
    # Frequency and decay time of the tool. Told, from its start-up, from its late ring, from its
    # first swings.
    if told := tool or approach.start_up:
        return [told]
    late = marks.peak + int((time.size - marks.peak) * 0.25)
    frequency, decay = guess_ring(time[late:], clean[late:])
    early = slice(marks.peak, int(np.searchsorted(time, time[marks.peak] + _FIRST_SWINGS)))
    swings = guess_ring(time[early], np.gradient(clean[early]))[0]
    # where the tip came to rest there is nothing to hear late, and what is heard of decay then is
    # noise
    heard = float(np.std(clean[late:])) > _HEARD * marks.noise
    return (
        [(frequency, decay), (swings, decay)]
        if heard
        else [(swings, _USUAL_DECAY), (frequency, _USUAL_DECAY)]
    )


def _find_troughs(
    time: Array, clean: Array, marks: Landmarks, level: float, frequency: float
) -> list[int]:
    # Troughs after the slip
    half = max(int(0.5 * (time.size - 1) / (time[-1] - time[0]) / frequency), 2)
    smooth = np.convolve(clean, np.full(5, 0.2), mode="same")
    found: list[int] = []
    index = marks.peak
    while len(found) < _MOST_TROUGHS:
        below = np.flatnonzero(smooth[index : smooth.size - 2] < level)
        if not below.size:
            break
        crossing = index + int(below[0])
        trough = crossing + int(np.argmin(smooth[crossing : crossing + half]))
        found.append(trough)
        above = np.flatnonzero(smooth[trough : smooth.size - 2] > level)
        if not above.size or trough + int(above[0]) + 4 * half >= time.size:
            break
        index = trough + int(above[0])
    return found


def measure_normal_level(time: Array, normal: Array, approach: Approach) -> Estimate:
    """Return the normal force while sliding, without hum and drift.

    Its standard uncertainty stands beside it [N].
    """
    end = int(np.searchsorted(time, approach.onset - _ONSET_GUARD))
    weights, covariance = fit_with_covariance(
        _build_still_columns(time[:end], approach), normal[:end]
    )
    return float(weights[0]), float(np.sqrt(covariance[0, 0]))


def _build_still_columns(t: Array, approach: Approach) -> Array:
    return np.column_stack([np.ones_like(t), t - t.mean(), build_wave_columns(t, approach.mains)])


def measure_sympathetic_force(
    time: Array, normal: Array, approach: Approach, after: Aftermath
) -> Estimate:
    """Amplitude at the release of the ring in the normal force [N].

    The ring has the frequency and the decay of the tangential force.
    """
    begin = int(np.searchsorted(time, max(after.start + _SETTLE, after.ring.origin)))
    still = _build_still_columns(time[begin:], approach)
    since = time[begin:] - after.start

    def ringing(frequency: float, decay_time: float) -> Estimate:
        columns = np.column_stack([build_damped_wave_columns(since, frequency, decay_time), still])
        weights, covariance = fit_with_covariance(columns, normal[begin:])
        size = float(np.hypot(weights[0], weights[1]))
        if size == 0.0:
            return 0.0, float(np.sqrt(covariance[0, 0]))
        return size, propagate_std(weights[:2] / size, covariance[:2, :2])

    (frequency, frequency_std), (decay, decay_std) = after.frequency, after.decay_time
    amplitude, own = ringing(frequency, decay)
    errors = [
        own,
        # what is uncertain of the tangential ring, whose course this one is taken to follow
        ringing(frequency + frequency_std, decay)[0] - amplitude,
        ringing(frequency, decay + decay_std)[0] - amplitude,
        amplitude * after.sample / decay if decay > 0.0 else 0.0,
    ]
    return amplitude, float(np.linalg.norm(errors))
