"""Sliding and loading: the level before the edge, and the ramp.

The ramp has an onset and a slope; hum, drift and start-up are fitted beside them.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.landmarks import Landmarks
from stepblocks.bench.signal.separable import (
    SeparableFit,
    build_damped_wave_columns,
    build_wave_columns,
    compute_residual_sum_of_squares,
    fit_separable,
    propagate_std,
)

_MAINS = (50.0, 60.0)  # [Hz]
_RAMP_SHARE = 0.85  # of the rise; the first pass stays clear of a rounded peak
# of its time, up to which the slope of a bent ramp is measured; `contact.state` predicts it so
_LINE_SHARE = 0.9
_START_UP_GAIN = 0.02  # a start-up ring must explain this share of the variance, or it is left out
_LINE_SIGMAS = 4.0
# standard deviations of the noise below the highest sample, down to which samples after the one
# that is taken for the peak count as its top, and how many of them at most
_TOP_NOISE = 16.0
_TOP_SAMPLES = 6

# places of the weights of a fit
_LEVEL, _DRIFT, _SLOPE = range(3)
_HUM = slice(3, 5)
_BEND = slice(5, 7)  # square and cube of a bent ramp
_START_UP = slice(-2, None)  # ring when the handle started


@dataclass(frozen=True)
class Clock:
    """What a fit of sliding and ramp begins with.

    Attributes
    ----------
    mains : float
        Mains frequency that is fitted along [Hz].
    center : float
        Instant at which the level holds [s].
    bent : bool
        Whether the ramp bends, by the square and the cube of time.
    """

    mains: float
    center: float
    bent: bool = False


@dataclass(frozen=True)
class Approach:
    """What was fitted to a trace up to its peak.

    Attributes
    ----------
    fit : SeparableFit
        Shape: onset (and frequency and decay time of a start-up ring); weights: level, drift,
        slope, hum (2), square and cube of a bent ramp (and start-up ring).
    end : int
        First sample that no longer follows the line of the ramp.
    clock : Clock
    """

    fit: SeparableFit
    end: int
    clock: Clock

    @property
    def onset(self) -> float:
        """Begin of loading [s]."""
        return float(self.fit.shape[0])

    @property
    def sliding_force(self) -> float:
        """Tangential force while sliding [N]."""
        return float(self.fit.weights[_LEVEL])

    @property
    def sliding_force_std(self) -> float:
        """Standard uncertainty of `sliding_force` [N]."""
        return self._get_weight_std(_LEVEL)

    @property
    def initial_slope(self) -> float:
        """Slope of the ramp where it begins [N/s]."""
        return float(self.fit.weights[_SLOPE])

    @property
    def mains_frequency(self) -> float:
        """Mains frequency [Hz]."""
        return self.clock.mains

    @cached_property
    def ramp_coefficients(self) -> Array:
        """What the ramp climbs by the powers of time: slope, square and cube."""
        bend = np.zeros(2)
        if self.clock.bent:
            bend = self.fit.weights[_BEND]
        return np.append(self.initial_slope, bend)

    @cached_property
    def hardening_coefficient(self) -> float:
        """Coefficient g of ``F = u + g u^3`` [1/N^2]; a ramp that flattens shows none."""
        return max(float(self.ramp_coefficients[2] / self.initial_slope**3), 0.0)

    @property
    def start_up_ring(self) -> Tool | None:
        """Ring when the handle started; None where there is no such ring."""
        if self.fit.shape.size != 3:
            return None
        return Tool(float(self.fit.shape[1]), float(self.fit.shape[2]))

    def _get_weight_std(self, index: int) -> float:
        """Return the standard uncertainty of a linear weight of the fit."""
        return self.fit.get_std(self.fit.shape.size + index)

    def compute_drift(self, instant: float) -> Estimate:
        """Return how far the level has drifted since `clock.center` [N]."""
        since = instant - self.clock.center
        drift = float(self.fit.weights[_DRIFT]) * since
        return Estimate(drift, self._get_weight_std(_DRIFT) * since)

    def compute_mean_slope(self, release: float) -> Estimate:
        """Return the slope of the straight line through the ramp up to a share of its time [N/s].

        `release` is the instant of the release [s].
        """
        # the least-squares line through t^2 and t^3 over 0 to T climbs by T and by 0.9 T^2
        end = _LINE_SHARE * (release - self.onset)
        climb = np.array([1.0, end, 0.9 * end**2])
        return self._estimate_level_plus_ramp(0.0, climb, 0.0)

    def compute_ramp_force(self, instant: float) -> Estimate:
        """Return the force on the line of the ramp without hum and drift [N]."""
        since = instant - self.onset
        steepness = float(self.ramp_coefficients @ (1.0, 2.0 * since, 3.0 * since**2))
        climb = np.array([since, since**2, since**3])
        return self._estimate_level_plus_ramp(1.0, climb, -steepness)

    def _estimate_level_plus_ramp(
        self, level_share: float, ramp_shares: Array, onset_slope: float
    ) -> Estimate:
        """Return the sum of level and climb in these shares.

        Parameters
        ----------
        level_share : float
            Share of the level.
        ramp_shares : Array
            Shape (3,), shares of slope, square and cube.
        onset_slope : float
            By how much the sum moves with the onset [N/s].
        """
        first_weight = self.fit.shape.size
        gradient = np.zeros(self.fit.covariance.shape[0])
        gradient[0] = onset_slope
        gradient[first_weight + _LEVEL] = level_share
        gradient[first_weight + _SLOPE] = ramp_shares[0]
        if self.clock.bent:
            gradient[first_weight + _BEND.start : first_weight + _BEND.stop] = ramp_shares[1:]
        value = level_share * self.sliding_force + float(ramp_shares @ self.ramp_coefficients)
        return Estimate(value, propagate_std(gradient, self.fit.covariance))

    def compute_ramp_line(self, time: Array) -> Array:
        """Return the line of the ramp with drift and hum [N], continued past its end."""
        columns = _build_approach_columns(time, time - self.onset, self.clock)
        weights = self.fit.weights[: columns.shape[1]]
        return np.asarray(columns @ weights, dtype=float)

    def compute_hum(self, time: Array) -> Array:
        """Return the hum alone [N], continued over the whole record."""
        columns = build_wave_columns(time, self.mains_frequency)
        return np.asarray(columns @ self.fit.weights[_HUM], dtype=float)

    def compute_sliding_curve(self, time: Array) -> Array:
        """Return the level with hum and the ring of the start, if any [N].

        Times are on the clock of the fit.
        """
        force = self.sliding_force + self.compute_hum(time)
        if self.start_up_ring is None:
            return force
        frequency, decay_time = self.start_up_ring
        ring = build_damped_wave_columns(time, frequency, decay_time)
        return np.asarray(force + ring @ self.fit.weights[_START_UP], dtype=float)


def find_mains_frequency(time: Array, force: Array) -> float:
    """Return the mains frequency that explains more of `force` [Hz]."""

    def compute_rest_of_hum(mains: float) -> float:
        hum = build_wave_columns(time, mains)
        return compute_residual_sum_of_squares(np.column_stack([np.ones_like(time), hum]), force)

    return min(_MAINS, key=compute_rest_of_hum)


def _build_approach_columns(time: Array, time_since_onset: Array, clock: Clock) -> Array:
    """Return the columns of level, drift, slope, hum and, of a bent ramp, square and cube.

    `time_since_onset` is zero before the onset in a fit; the result has shape (n, 5 or 7).
    """
    return _insert_ramp_columns(_build_sliding_columns(time, clock), time_since_onset, clock)


def _build_sliding_columns(time: Array, clock: Clock) -> Array:
    """Return the columns of level, drift and hum, shape (n, 4)."""
    lines = np.stack([np.ones_like(time), time - clock.center]).T
    hum = build_wave_columns(time, clock.mains)
    return np.hstack([lines, hum])


def _insert_ramp_columns(sliding_columns: Array, time_since_onset: Array, clock: Clock) -> Array:
    """Insert the slope after level and drift, and append what bends it."""
    columns = [sliding_columns[:, :_SLOPE], time_since_onset[:, None], sliding_columns[:, _SLOPE:]]
    if clock.bent:
        columns.append(_build_bend_columns(time_since_onset))
    return np.hstack(columns)


def _build_bend_columns(time_since_onset: Array) -> Array:
    """Return the square and the cube of the time since the onset."""
    return np.vander(time_since_onset, 4)[:, 1::-1]


def fit_approach(
    time: Array,
    force: Array,
    landmarks: Landmarks,
    start_up_ring: Tool | None,
    *,
    is_straight: bool = False,
) -> Approach:
    """Fit sliding and ramp together.

    The ramp may bend, where it clearly does.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N].
    landmarks : Landmarks
    start_up_ring : Tool or None
        Ring that the handle's start may have left in the record; None where it is not looked for.
    is_straight : bool
        Whether the ramp is taken to be straight.
    """
    slide_end = int(np.searchsorted(time, landmarks.onset))
    mains = find_mains_frequency(time[:slide_end], force[:slide_end])
    middle_of_slide = float(time[: max(slide_end, 1)].mean())
    clock = Clock(mains, middle_of_slide)
    approach = _fit_ramp(time, force, landmarks, clock, start_up_ring)
    if is_straight:
        return approach
    fitted_time = time[: approach.fit.residuals.size]
    since = np.maximum(fitted_time - approach.onset, 0.0)
    if approach.fit.would_gain_from(_build_bend_columns(since)):
        return _fit_ramp(time, force, landmarks, replace(clock, bent=True), start_up_ring)
    return approach


def _fit_ramp(
    time: Array, force: Array, landmarks: Landmarks, clock: Clock, start_up_ring: Tool | None
) -> Approach:
    """Fit sliding and ramp up to where the force leaves the line of the ramp."""
    climb = force[: landmarks.peak + 1] - landmarks.level
    end = int(np.flatnonzero(climb < _RAMP_SHARE * landmarks.rise)[-1]) + 1
    fit = _fit_sliding_and_ramp(time[:end], force[:end], landmarks.onset, clock, start_up_ring)
    approach = Approach(fit, end, clock)
    # the filter of a converter rings a sample or two ahead of a corner
    remainder = slice(end, max(landmarks.peak - 2, end))
    misses = force[remainder] - approach.compute_ramp_line(time[remainder])
    line_std = approach.compute_ramp_force(float(time[landmarks.peak])).std
    left = _find_sample_leaving_ramp_line(misses, landmarks.noise, line_std)
    followed = landmarks.peak
    if left is not None:
        followed = end + left
    certain = min(followed, landmarks.peak - _count_samples_past_release(force, landmarks))
    if certain <= end:
        return replace(approach, end=max(followed, end))
    fit = _fit_sliding_and_ramp(
        time[:certain], force[:certain], approach.onset, clock, start_up_ring
    )
    return Approach(fit, followed, clock)


def _count_samples_past_release(force: Array, landmarks: Landmarks) -> int:
    """Count the samples up to the peak that may lie past the release, where the force falls gently.

    A fall that begins level takes about as long to the noise as from there to four times as deep,
    and noise decides which sample of it is taken for the peak.
    """
    after = force[landmarks.peak + 1 : landmarks.peak + 1 + _TOP_SAMPLES]
    below_top = after < force[landmarks.peak] - _TOP_NOISE * landmarks.noise
    if not below_top.any():
        return after.size
    return int(np.argmax(below_top))


def _fit_sliding_and_ramp(
    time: Array, force: Array, onset: float, clock: Clock, start_up: Tool | None
) -> SeparableFit:
    """Fit sliding, ramp and, where it shows, a start-up ring to all of some samples."""
    duration = float(time[-1]) - onset
    reach = max(0.25 * duration, 5.0 * float(np.median(np.diff(time))))

    sliding = _build_sliding_columns(time, clock)

    def build_ramp_columns(shape: Array) -> Array:
        """Return the columns of sliding and a ramp from an onset [s] on; the shape is (onset,)."""
        since = np.maximum(time - float(shape[0]), 0.0)
        return _insert_ramp_columns(sliding, since, clock)

    def build_ringing_columns(shape: Array) -> Array:
        """Return the same and a ring up to the onset; the shape is that, frequency and decay."""
        onset, frequency, decay_time = shape
        since = time - time[0]
        decay = np.where(time < onset, np.exp(-since / decay_time), 0.0)
        ring = decay[:, None] * build_wave_columns(since, float(frequency))
        return np.hstack([build_ramp_columns(shape), ring])

    start = np.array([onset])
    fit = fit_separable(
        build_ramp_columns,
        force,
        start,
        lower=start - 4.0 * reach,
        upper=start + 2.0 * reach,
        scale=np.array([reach]),
    )
    if start_up is None or not _shows_start_up_ring(time, fit, start_up):
        return fit
    frequency, decay_time = start_up
    fitted_onset = fit.shape[0]
    start = np.array([fitted_onset, frequency, decay_time])
    lower = np.array([fitted_onset - reach, 0.8 * frequency, 0.2 * decay_time])
    upper = np.array([fitted_onset + reach, 1.25 * frequency, 5.0 * decay_time])
    scale = np.array([reach, 0.02 * frequency, 0.3 * decay_time])
    return fit_separable(build_ringing_columns, force, start, lower, upper, scale)


def _shows_start_up_ring(time: Array, fit: SeparableFit, start_up_ring: Tool) -> bool:
    """Tell whether what sliding and ramp leave over holds a ring that begins with the record."""
    frequency, decay_time = start_up_ring
    before = time < fit.shape[0]
    since = time[before] - time[0]
    residuals = fit.residuals[before]
    without_ring = float(residuals @ residuals)
    ring = build_damped_wave_columns(since, frequency, decay_time)
    with_ring = compute_residual_sum_of_squares(ring, residuals)
    # two parameters more explain 2/n of white noise by chance
    least_share = max(_START_UP_GAIN, 20.0 / max(since.size, 1))
    return bool(without_ring - with_ring > least_share * without_ring)


def _find_sample_leaving_ramp_line(
    ramp_residuals: Array, noise: float, line_std: float
) -> int | None:
    """Find the first sample from which on the force is off the line of the ramp for good.

    Parameters
    ----------
    ramp_residuals : Array
        Shape (n,), force less the line [N].
    noise, line_std : float
        Standard deviation of a sample, and standard uncertainty of the line [N].

    Returns
    -------
    int or None
        None where the force stays on the line.
    """
    if not ramp_residuals.size:
        return None
    window = min(4, ramp_residuals.size)
    mean = np.convolve(ramp_residuals, np.full(window, 1.0 / window), mode="valid")
    limit = _LINE_SIGMAS * math.hypot(noise / math.sqrt(window), line_std)
    off = np.abs(mean) > limit
    if not off[-1]:
        return None
    # noise may cross the limit for a moment; only what stays off to the peak is the peak's own
    # rounding
    last_on_line = int(np.flatnonzero(~off).max(initial=0))
    return max(last_on_line - 3, 0)
