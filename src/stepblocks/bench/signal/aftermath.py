"""The kind of ring after the slip, and its figures carried back to the release."""

import math
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.bench.signal import USUAL_TOOL, Array, Estimate, Tool
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.landmarks import Landmarks
from stepblocks.bench.signal.motion import Motion, find_first_swing
from stepblocks.bench.signal.ring import Ring, fit_damped_cosine, fit_damped_ring
from stepblocks.bench.signal.rubbing import (
    GUESSED_SPREAD,
    KNOWN_SPREAD,
    RubbingRing,
    fit_rubbing_ring,
)
from stepblocks.bench.signal.saw import Sawtooth
from stepblocks.bench.signal.separable import guess_ring_frequency_and_decay
from stepblocks.contact.kernels import compute_unhardened_force

# [s] first samples after the peak, in which the sensor itself follows; no tie with a sample
_RELEASE_TIME = 0.25e-3
_GOOD = 5.0  # misfit up to which a fit is taken at once
# of a bell's amplitude, and of the sliding level: what misses a bell by less, of a tip that slips
# back without a gap, are loops of the gauge and no friction
_SLIGHT = 0.005
_GAP = 0.1  # of the sliding level, likewise, from which a gap is friction: a bent gauge makes 0.007
_BETTER = 0.85  # a second kind of fit must leave this share of the squared residuals at most
# last share of the record after the slip, in which only the tool's own ring is left
_TAIL_SHARE = 0.35
_LATE_SHARE = 0.25  # of the record after the slip, from which on it shows the tool
_SETTLED = 7.0  # misfit up to which a trough is taken for the begin of the free ring
# a later trough must leave this share at most: some of the ring is lost with each
_MUCH_BETTER = 0.5
_MOST_COLOUR = 3.0  # the noise while sliding counts up to this many times the white noise
_MOST_TROUGHS = 8
# by which the median of a session's clear trials misses the decay time of its tool
_KNOWN_DECAY_SPREAD = 0.01
_FAR = 2.5  # spreads of the tool's figures within which a fit is still of that tool
_FIRST_SWINGS = 25e-3  # [s]
_HEARD = 1.3
_USUAL_DECAY = 25e-3  # [s] first guess where nothing says better
# [s] in which pulses die that the rest of a release may leave beside an exponential
_REST_TIMES = np.array([0.2e-3, 0.8e-3, 2.5e-3])
_LATE_BEGINS = (2.6e-3, 6.0e-3)  # [s] after the release, where the rest may be gone
_VISIBLE = 1e-3  # of the amplitude of the ring, from which on a misfit counts
_REST_MEAN = 4  # samples that are averaged to see it
_REST_SIGMAS = 4.0  # standard deviations of noise within which it counts as zero
_NOT_KNOWN = Estimate(math.nan, math.nan)


@dataclass(frozen=True)
class Swing:
    """First swing after a slip: how far below the sliding level it went, and when.

    Attributes
    ----------
    depth : Estimate
        Level less the force in the trough [N].
    instant : float
        When the trough was reached [s].
    decay_time : Estimate
        Of the tool [s].
    half : float
        Half a period of the tool [s].
    """

    depth: Estimate
    instant: float
    decay_time: Estimate
    half: float = 0.0

    def compute_amplitude(self, time_of_interest: float) -> Estimate:
        """Return the amplitude carried back to `time_of_interest` [N].

        Viscous decay alone is taken into account.
        """
        depth, depth_std = self.depth
        decay_time, decay_std = self.decay_time
        since = self.instant - time_of_interest
        growth = float(np.exp(since / decay_time))
        carried = depth * growth
        std_of_decay = carried * since / decay_time**2 * decay_std
        return Estimate(carried, float(np.hypot(depth_std * growth, std_of_decay)))


@dataclass(frozen=True)
class Aftermath:
    """Figures of the ring at the release instant.

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
    is_late : bool
        Whether a bell was fitted from where the rest of a slow release was gone.
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
    is_late: bool = False

    @property
    def rings_freely(self) -> bool:
        """Whether it rings like a bell; else its tip rubs."""
        return self.swing is None

    def carry_amplitude_to(self, instant: float) -> "Aftermath":
        """Return the same with the amplitude at another instant [s]."""
        if isinstance(self.ring, Ring):
            return replace(self, start=instant, amplitude=self.ring.compute_amplitude(instant))
        assert self.swing is not None
        # a tip that took its time to fall has rung for half a period all the same when it has swung
        # through
        instant = max(instant, self.swing.instant - self.swing.half)
        return replace(self, start=instant, amplitude=self.swing.compute_amplitude(instant))


def fit_aftermath(
    time: Array,
    force: Array,
    landmarks: Landmarks,
    approach: Approach,
    tool: Tool | None = None,
    *,
    sawtooth: Sawtooth | None = None,
) -> Aftermath:
    """Fit the ring after a slip, as that of a bell or of a tool whose tip rubs.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N].
    landmarks : Landmarks
    approach : Approach
    tool : Tool or None
        None where it is not known.
    sawtooth : Sawtooth or None
        What the tip drew before the edge.
    """
    landmarks = replace(landmarks, noise=estimate_sliding_noise(time, approach, landmarks))
    top = float(time[landmarks.peak])
    cosine = None
    if sawtooth is None:
        first = int(np.searchsorted(time, top + _RELEASE_TIME))
        cosine = fit_damped_cosine(
            time[first:], force[first:], top, approach.mains_frequency, landmarks.noise
        )
        late = fit_ring_after_rest(time, force, cosine, landmarks.noise)
        if late is not None:
            return late
    else:
        # it is no bell, and what the tip draws when the ring has died is no part of that
        end = int(np.searchsorted(time, top + _FIRST_SWINGS))
        time, force = time[:end], force[:end]
    rubbing = None
    if cosine is None or not cosine.misfit < _GOOD:
        rubbing = _fit_best_rubbing(time, force, landmarks, approach, tool)
    # a tip that clearly slips back is no bell that hardens, or that its gauge bends
    if rubbing is None or (sawtooth is None and not _clearly_rubs(rubbing)):
        bell = fit_bell_ring(time, force, top, approach.mains_frequency, landmarks.noise, cosine)
        if rubbing is None or _is_bell_likelier(time, bell, rubbing, landmarks):
            return bell
    swing = _measure_swing(time, force, landmarks, approach, rubbing, tool=tool, sawtooth=sawtooth)
    sample = float(np.median(np.diff(time)))
    return _make_rubbing_aftermath(rubbing, swing, sample, tool)


def _clearly_rubs(rubbing: RubbingRing) -> bool:
    """Tell whether a tip clearly rubs, by the misfit and the gap of its fit."""
    if not rubbing.misfit < _GOOD or not rubbing.knows_gap:
        return False
    return rubbing.backward_force_drop.value > _GAP * rubbing.forward_sliding_force.value


def _is_bell_likelier(
    time: Array, bell: Aftermath, rubbing: RubbingRing, landmarks: Landmarks
) -> bool:
    """Tell whether a ring is rather that of a bell than that of a tip that rubs."""
    ring = bell.ring
    assert isinstance(ring, Ring)
    if ring.misfit < _GOOD:
        return True
    residuals = ring.fit.residuals
    fitted = time[time.size - residuals.size :]
    # what misses a bell in its first swing alone hardly weighs in the sum
    of_bell = float(np.sum(residuals[fitted >= rubbing.time_zero] ** 2))
    of_rubbing = float(np.sum(rubbing.residuals**2))
    if rubbing.misfit > _GOOD and of_rubbing > _BETTER * of_bell:
        return True
    has_no_gap = rubbing.backward_force_drop.value < _SLIGHT * rubbing.forward_sliding_force.value
    slight_miss = _SLIGHT * min(bell.amplitude.value, landmarks.rise)
    return has_no_gap and float(np.std(residuals)) < slight_miss


def _measure_swing(
    time: Array,
    force: Array,
    landmarks: Landmarks,
    approach: Approach,
    rubbing: RubbingRing,
    *,
    tool: Tool | None,
    sawtooth: Sawtooth | None,
) -> Swing:
    """Measure the first swing of a tip that rubs; see `fit_aftermath`."""
    frequency = rubbing.frequency.value
    decay_time = rubbing.decay_time
    if tool is not None:
        frequency, known_decay_time = tool
        known_spread = _KNOWN_DECAY_SPREAD
        if tool is USUAL_TOOL:
            known_spread = KNOWN_SPREAD.decay_time
        spread = min(known_spread * known_decay_time, rubbing.decay_time.std)
        decay_time = Estimate(known_decay_time, spread)
    clean = force - approach.compute_hum(time)
    drift = approach.compute_drift(float(time[landmarks.peak]))
    level = approach.sliding_force + drift.value
    motion = Motion(
        time,
        clean,
        normal=clean,
        peak=landmarks.peak,
        level=level,
        load=0.0,
        slope=approach.initial_slope,
        noise=landmarks.noise,
        frequency=frequency,
    )
    bottom = find_first_swing(motion)
    # a tool that hardens swings less far below its level than above it, where it was let go
    swung = compute_unhardened_force(max(bottom.depth, 0.0), approach.hardening_coefficient)
    level_of_slide = approach.sliding_force
    beyond = swung - level_of_slide
    asymmetry = 3.0 * approach.hardening_coefficient * level_of_slide * swung * beyond
    depth = bottom.depth + asymmetry
    level_std = approach.sliding_force_std
    if sawtooth is not None:
        level_std = sawtooth.kinetic.std
    depth_std = math.hypot(bottom.std, level_std, drift.std)
    return Swing(Estimate(depth, depth_std), bottom.instant, decay_time, 0.5 / frequency)


def fit_ring_after_rest(time: Array, force: Array, early: Ring, noise: float) -> Aftermath | None:
    """Fit a bell from where the rest of a slow release is gone, and carry it back to the release.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N].
    early : Ring
        The damped cosine from the release on, beside a rest that dies by an exponential.
    noise : float
        Standard deviation of a sample [N].

    Returns
    -------
    Aftermath or None
        None where the rest dies by the exponential, or what is left out is no rest: that of a
        release lies above the ring and only dies, while friction makes the first swings larger.
    """
    release = early.time_zero
    since = time[time.size - early.fit.residuals.size :] - release
    pulses = np.exp(-since[:, None] / _REST_TIMES)
    begun = early.fit.residuals[since < _LATE_BEGINS[-1]]
    is_visible = float(np.std(begun)) > _VISIBLE * early.compute_amplitude(release).value
    if not is_visible or not early.fit.would_gain_from(pulses):
        return None
    for begin in _LATE_BEGINS:
        first = int(np.searchsorted(time, release + begin))
        late = fit_damped_cosine(time[first:], force[first:], release, early.basis.mains, noise)
        if late.misfit < _GOOD and not late.fit.would_gain_from(pulses[-(time.size - first) :]):
            break
    else:
        return None
    left_out = slice(int(np.searchsorted(time, release + _RELEASE_TIME)), first)
    residual = force[left_out] - late.compute_curve_without_release(time[left_out])
    if not _is_dying_rest(residual, noise):
        return None
    return Aftermath(
        late,
        release,
        late.compute_amplitude(release),
        late.frequency,
        late.decay_time,
        late.level,
        is_late=True,
    )


def _is_dying_rest(residual: Array, noise: float) -> bool:
    """Tell whether what a ring leaves of the first samples, shape (m,) [N], lies above and dies."""
    size = min(_REST_MEAN, residual.size)
    means = np.convolve(residual, np.full(size, 1.0 / size), mode="valid")
    slack = _REST_SIGMAS * noise / math.sqrt(size)
    stays_above = bool(means.min() > -slack)
    only_dies = bool((np.diff(means) < math.sqrt(2.0) * slack).all())
    return stays_above and only_dies and bool(means[0] > slack)


def fit_bell_ring(
    time: Array,
    force: Array,
    release: float,
    mains: float,
    noise: float,
    cosine: Ring | None = None,
) -> Aftermath:
    """Fit a damped ring, counted from the release.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N].
    release : float
        [s].
    mains : float
        Mains frequency [Hz].
    noise : float
        Standard deviation of a sample [N].
    cosine : Ring, optional
        The damped cosine, where it is fitted already.
    """
    first = int(np.searchsorted(time, release + _RELEASE_TIME))
    bell = fit_damped_ring(time[first:], force[first:], release, mains, noise, cosine)
    amplitude = bell.compute_amplitude(release)
    return Aftermath(bell, release, amplitude, bell.frequency, bell.decay_time, bell.level)


def estimate_sliding_noise(time: Array, approach: Approach, landmarks: Landmarks) -> float:
    """Estimate the noise while sliding, be it white or coloured [N]."""
    first_of_ramp = int(np.searchsorted(time, approach.onset))
    scatter = float(np.std(approach.fit.residuals[:first_of_ramp]))
    return min(max(scatter, landmarks.noise), _MOST_COLOUR * landmarks.noise)


def _make_rubbing_aftermath(
    rubbing: RubbingRing, swing: Swing, sample_interval: float, tool: Tool | None
) -> Aftermath:
    """Return the figures of a tip that rubs; `sample_interval` is in seconds."""
    frequency, decay_time = rubbing.frequency, rubbing.decay_time
    knows_gap = rubbing.knows_gap
    if tool is not None and _is_far_from_tool(rubbing, tool):
        # a fit of few swings may find another tool: then it knows no better than that
        known_frequency, known_decay_time = tool
        frequency = _widen_to_known_value(frequency, known_frequency)
        decay_time = _widen_to_known_value(decay_time, known_decay_time)
        knows_gap = False
    friction_decay = _NOT_KNOWN
    if knows_gap:
        loss = 2.0 * rubbing.backward_force_drop.value * rubbing.frequency.value
        friction_decay = Estimate(
            loss, 2.0 * rubbing.frequency.value * rubbing.backward_force_drop.std
        )
    aftermath = Aftermath(
        rubbing,
        -math.inf,
        _NOT_KNOWN,
        frequency,
        decay_time,
        rubbing.forward_sliding_force,
        friction_decay,
        swing,
        sample_interval,
    )
    return aftermath.carry_amplitude_to(-math.inf)


def _is_far_from_tool(rubbing: RubbingRing, tool: Tool) -> bool:
    """Tell whether a fit found another tool than the known one."""
    frequency, decay_time = tool
    far_frequency = _FAR * KNOWN_SPREAD.frequency * frequency
    far_decay_time = _FAR * KNOWN_SPREAD.decay_time * decay_time
    if abs(rubbing.frequency.value - frequency) > far_frequency:
        return True
    return abs(rubbing.decay_time.value - decay_time) > far_decay_time


def _widen_to_known_value(estimate: Estimate, known_value: float) -> Estimate:
    """Return an estimate whose uncertainty reaches to what is known."""
    miss = abs(estimate.value - known_value)
    return Estimate(estimate.value, float(np.hypot(estimate.std, miss)))


def _fit_best_rubbing(
    time: Array, force: Array, landmarks: Landmarks, approach: Approach, tool: Tool | None
) -> RubbingRing | None:
    """Fit a tip that rubs from one trough after the other, until the tip no longer climbs.

    The result is None where the force has no trough after the slip.
    """
    clean = force - approach.compute_hum(time)
    after = clean[landmarks.peak :]
    level = float(np.median(after[int(after.size * (1.0 - _TAIL_SHARE)) :]))
    spread = GUESSED_SPREAD
    if tool is not None:
        spread = KNOWN_SPREAD
    best: RubbingRing | None = None
    for guess in _list_tool_guesses(time, clean, landmarks, approach, tool):
        frequency, _ = guess
        for trough in _find_troughs(time, clean, landmarks, level, frequency):
            fit = fit_rubbing_ring(
                time[trough:],
                clean[trough:],
                level,
                guess,
                approach.initial_slope,
                landmarks.noise,
                spread=spread,
            )
            if best is None or fit.misfit < _MUCH_BETTER * best.misfit:
                best = fit
            if best.misfit < _SETTLED:
                return best
    return best


def _list_tool_guesses(
    time: Array,
    force_without_hum: Array,
    landmarks: Landmarks,
    approach: Approach,
    tool: Tool | None,
) -> list[Tool]:
    """Return the tool as known, or as its start-up, its late ring and its first swings show it.

    `force_without_hum` is that of the tangential gauge, shape (n,) [N].
    """
    known = tool or approach.start_up_ring
    if known is not None:
        return [known]
    late = landmarks.peak + int((time.size - landmarks.peak) * _LATE_SHARE)
    late_ring = guess_ring_frequency_and_decay(time[late:], force_without_hum[late:])
    end = int(np.searchsorted(time, time[landmarks.peak] + _FIRST_SWINGS))
    early = slice(landmarks.peak, end)
    first_swings = guess_ring_frequency_and_decay(
        time[early], np.gradient(force_without_hum[early])
    )
    # where the tip came to rest there is nothing to hear late, and what is heard of decay then is
    # noise
    is_heard = float(np.std(force_without_hum[late:])) > _HEARD * landmarks.noise
    if is_heard:
        return [late_ring, first_swings._replace(decay_time=late_ring.decay_time)]
    return [
        first_swings._replace(decay_time=_USUAL_DECAY),
        late_ring._replace(decay_time=_USUAL_DECAY),
    ]


def _find_troughs(
    time: Array, force_without_hum: Array, landmarks: Landmarks, level: float, frequency: float
) -> list[int]:
    """Return the samples of the troughs below a level after the slip, eight at most.

    `force_without_hum` is the tangential force, shape (n,) [N], `frequency` that of the tool [Hz].
    """
    rate = (time.size - 1) / (time[-1] - time[0])
    half_period = max(int(0.5 * rate / frequency), 2)
    smooth = np.convolve(force_without_hum, np.full(5, 0.2), mode="same")
    usable = smooth[: smooth.size - 2]
    troughs: list[int] = []
    index = landmarks.peak
    while len(troughs) < _MOST_TROUGHS:
        below = np.flatnonzero(usable[index:] < level)
        if not below.size:
            break
        crossing = index + int(below[0])
        trough = crossing + int(np.argmin(smooth[crossing : crossing + half_period]))
        troughs.append(trough)
        above = np.flatnonzero(usable[trough:] > level)
        if not above.size:
            break
        index = trough + int(above[0])
        if index + 4 * half_period >= time.size:
            break
    return troughs
