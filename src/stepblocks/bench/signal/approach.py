"""Sliding and loading: where they lie, the level before the edge, and the ramp.

The ramp has an onset and a slope; hum, drift and start-up are fitted beside them.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.separable import (
    SeparableFit,
    build_damped_wave_columns,
    build_wave_columns,
    compute_rest,
    fit_separable,
    propagate_std,
)
from stepblocks.errors import RuleError

_MAINS = (50.0, 60.0)  # [Hz]
_RAMP_SHARE = 0.85  # of the rise; the first pass stays clear of a rounded peak
# of its time, up to which the slope of a bent ramp is measured; `contact.state` predicts it so
_LINE_SHARE = 0.9
_START_UP_GAIN = 0.02  # a start-up ring must explain this share of the variance, or it is left out
_LINE_SIGMAS = 4.0
_RISE_OVER_NOISE = 12.0  # a peak must stand out by this many standard deviations of the noise
_TOP_SAMPLES = 12  # samples after the highest that noise alone can put below it
_TOP_NOISE = 4.0  # by this many standard deviations of the noise
_RISE_OVER_LEAD = 1.5  # and be this many times what happens in the first part of the record
_FALL_SHARE = 0.5  # a tip that slipped has given back at least this share of the rise
_LEAST_RING = 15e-3  # [s] some four periods of a ring
_SLIDE_SAMPLES = 40  # fewer samples before the edge say nothing of the sliding force


class LandmarkError(RuleError):
    """The trace lacks a part of the course of a trial.

    The message is the reason for its exclusion.
    """


@dataclass(frozen=True)
class Landmarks:
    """Samples between which the parts of a trial lie.

    Attributes
    ----------
    onset : float
        Begin of loading, to some samples [s].
    peak : int
        Sample of the largest tangential force before the slip.
    level : float
        Tangential force while sliding before the edge, to the noise [N].
    rise : float
        Peak over `level` [N].
    noise : float
        Standard deviation of the white part of the noise of the tangential force [N].
    """

    onset: float
    peak: int
    level: float
    rise: float
    noise: float


def estimate_white_noise(values: Array) -> float:
    """Return the standard deviation of white noise, from fourth differences.

    Slow changes and spikes do not count.
    """
    fourth = np.abs(np.diff(values, n=4))
    # the median alone comes in steps where the record is quantised; it only says what is a spike
    quiet = fourth[fourth <= 4.0 * np.median(fourth) / 0.6745]
    return float(np.sqrt(np.mean(quiet**2) / 70.0)) if quiet.size else 0.0


def find_landmarks(time: Array, force: Array) -> Landmarks:
    """Find sliding, loading and slip in a tangential force."""
    noise = estimate_white_noise(force)
    smooth = np.convolve(force, np.full(5, 0.2), mode="same")
    smooth[:2], smooth[-2:] = force[:2], force[-2:]
    peak = _find_peak_sample(force, smooth, noise)
    lead = smooth[: max(peak // 4, 1)]
    level = float(np.median(lead))
    rise = float(force[peak]) - level
    # a start-up ring is as old as the record; a slip stands out over it
    least = max(_RISE_OVER_NOISE * noise, _RISE_OVER_LEAD * float(np.abs(lead - level).max()))
    left = float(time[-1] - time[peak])
    rules = {
        f"no slip: the tangential force rises over sliding by {rise:.3g} N, less than the "
        f"{least:.2g} N that stand out of noise and start-up": rise < least,
        "no sliding before the edge: the record begins under load": not np.any(
            smooth[: peak + 1] - level < 0.5 * rise
        ),
        "no release: the tangential force does not fall after its peak": (
            float(smooth[peak:].min()) > level + (1.0 - _FALL_SHARE) * rise
        ),
        f"truncated: the record ends {left * 1e3:.3g} ms after the slip": left < _LEAST_RING,
    }
    if faults := [fault for fault, broken in rules.items() if broken]:
        raise LandmarkError(faults[0])
    return _add_onset(time, smooth, Landmarks(math.nan, peak, level, rise, noise))


def find_bounded_landmarks(time: Array, force: Array) -> Landmarks:
    """Find sliding and loading up to the first sample at the top.

    That sample is where the range of a gauge or the record ends.
    """
    noise = estimate_white_noise(force)
    peak = int(np.argmax(force))
    level = float(np.median(force[: max(peak // 4, 1)]))
    rise = float(force[peak]) - level
    LandmarkError.require(
        not rise < _RISE_OVER_NOISE * noise and peak >= 4 * _SLIDE_SAMPLES,
        "no ramp",
    )
    return _add_onset(time, force, Landmarks(math.nan, peak, level, rise, noise))


def _find_peak_sample(force: Array, smooth: Array, noise: float) -> int:
    # Last sample before the fall: on a gentle ramp noise lifts an earlier one over it
    coarse = int(np.argmax(smooth))
    first = max(coarse - 4, 0)
    peak = first + int(np.argmax(force[first : coarse + 5]))
    high = force[peak : peak + _TOP_SAMPLES] > force[peak] - _TOP_NOISE * noise
    return peak + (int(np.argmin(high)) if not high.all() else high.size) - 1


def _add_onset(time: Array, smooth: Array, marks: Landmarks) -> Landmarks:
    # Put the onset where the line through the middle of the ramp meets the sliding level
    climb = smooth[: marks.peak - 1] - marks.level  # the last two samples have some of the fall
    low = int(np.flatnonzero(climb < 0.25 * marks.rise)[-1])
    high = max(int(np.flatnonzero(climb < 0.75 * marks.rise)[-1]) + 1, low + 2)
    slope = (smooth[high] - smooth[low]) / (time[high] - time[low])
    LandmarkError.require(
        not slope <= 0.0,
        "no loading: the tangential force does not climb steadily to its peak",
    )
    onset = float(time[low] - climb[low] / slope)
    LandmarkError.require(
        np.searchsorted(time, onset) >= _SLIDE_SAMPLES,
        f"no sliding before the edge: loading begins {onset - time[0]:.3g} s into the record",
    )
    return replace(marks, onset=onset)


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


@dataclass
class Approach:
    """What was fitted to a trace up to its peak.

    Attributes
    ----------
    fit : SeparableFit
        Shape: onset (and start-up ring); weights: level, drift, slope, hum (2), square and cube of
        a bent ramp (and start-up ring).
    end : int
        First sample that no longer follows the line of the ramp.
    clock : Clock
    """

    fit: SeparableFit
    end: int
    clock: Clock

    def __post_init__(self) -> None:
        fit = self.fit
        self.onset = float(fit.shape[0])  # begin of loading [s]
        # tangential force while sliding [N]
        self.level = float(fit.weights[0])
        self.level_std = fit.std(fit.shape.size)
        self.slope = float(fit.weights[2])  # of the ramp where it begins [N/s]
        self.mains, self.center = self.clock.mains, self.clock.center
        # slope and, of a ramp that bends, square and cube: what it climbs by powers of time
        self.climb = np.append(self.slope, fit.weights[5:7] if self.clock.bent else np.zeros(2))
        # g of ``F = u + g u^3`` [1/N^2]; a ramp that flattens shows none
        self.hardening = max(float(self.climb[2] / self.slope**3), 0.0)

    def mean_slope(self, release: float) -> Estimate:
        """Slope of the straight line through the ramp up to a share of its time.

        Its standard uncertainty stands beside it [N/s].
        """
        # the least-squares line through t^2 and t^3 over 0 to T climbs by T and by 0.9 T^2
        end = _LINE_SHARE * (release - self.onset)
        return self._combine(0.0, np.array([1.0, end, 0.9 * end**2]), 0.0)

    def _combine(self, level: float, climb: Array, onset: float) -> Estimate:
        # Sum of level and climb in these shares, which moves with the onset by so much
        first = self.fit.shape.size
        gradient = np.zeros(self.fit.covariance.shape[0])
        gradient[[0, first, first + 2]] = onset, level, climb[0]
        if self.clock.bent:
            gradient[first + 5 : first + 7] = climb[1:]
        return level * self.level + float(climb @ self.climb), propagate_std(
            gradient, self.fit.covariance
        )

    @property
    def start_up(self) -> Tool | None:
        """Frequency [Hz] and decay time [s] of the ring when the handle started.

        The result is None where there is no such ring.
        """
        return (
            (float(self.fit.shape[1]), float(self.fit.shape[2]))
            if self.fit.shape.size == 3
            else None
        )

    def line(self, time: Array) -> Array:
        """Line of the ramp with drift and hum [N], continued past its end."""
        columns = _build_approach_columns(time, time - self.onset, self.clock)
        return np.asarray(columns @ self.fit.weights[: columns.shape[1]], dtype=float)

    def hum(self, time: Array) -> Array:
        """Hum alone [N], continued over the whole record."""
        return np.asarray(build_wave_columns(time, self.mains) @ self.fit.weights[3:5], dtype=float)

    def sliding(self, time: Array) -> Array:
        """Level with hum and the ring of the start [N].

        The ring is left out where there is none; times are on the clock of the fit.
        """
        force = self.level + self.hum(time)
        if self.start_up is None:
            return force
        frequency, decay = self.start_up
        return np.asarray(
            force + build_damped_wave_columns(time, frequency, decay) @ self.fit.weights[-2:],
            dtype=float,
        )

    def ramp(self, time: float) -> Estimate:
        """Force on the line of the ramp without hum and drift.

        Its standard uncertainty stands beside it [N].
        """
        since = time - self.onset
        steep = float(self.climb @ (1.0, 2.0 * since, 3.0 * since**2))
        return self._combine(1.0, np.array([since, since**2, since**3]), -steep)


def find_mains(time: Array, values: Array) -> float:
    """Mains frequency that explains more of `values` [Hz]."""
    return min(
        _MAINS,
        key=lambda mains: compute_rest(
            np.column_stack([np.ones_like(time), build_wave_columns(time, mains)]), values
        ),
    )


def _build_approach_columns(time: Array, since: Array, clock: Clock) -> Array:
    # `since` is the time since the onset, of a fit zero before it
    columns = [
        np.ones_like(time),
        time - clock.center,
        since,
        build_wave_columns(time, clock.mains),
    ]
    return np.column_stack([*columns, np.vander(since, 4)[:, 1::-1]] if clock.bent else columns)


def fit_approach(
    time: Array, force: Array, marks: Landmarks, start_up: Tool | None, *, straight: bool = False
) -> Approach:
    """Fit sliding and ramp together.

    The ramp may bend, where it clearly does.
    """
    slide_end = int(np.searchsorted(time, marks.onset))
    clock = Clock(
        find_mains(time[:slide_end], force[:slide_end]),
        float(time[: max(slide_end, 1)].mean()),
    )
    found = _fit_ramp(time, force, marks, clock, start_up)
    since = np.maximum(time[: found.fit.residuals.size] - found.onset, 0.0)
    if not straight and found.fit.would_gain_from(np.vander(since, 4)[:, 1::-1]):
        found = _fit_ramp(time, force, marks, replace(clock, bent=True), start_up)
    return found


def _fit_ramp(
    time: Array, force: Array, marks: Landmarks, clock: Clock, start_up: Tool | None
) -> Approach:
    end = (
        int(np.flatnonzero(force[: marks.peak + 1] - marks.level < _RAMP_SHARE * marks.rise)[-1])
        + 1
    )
    found = Approach(_fit_until(time[:end], force[:end], marks.onset, clock, start_up), end, clock)
    # the filter of a converter rings a sample or two ahead of a corner
    rest = slice(end, max(marks.peak - 2, end))
    left = _find_end_of_line(
        force[rest] - found.line(time[rest]),
        marks.noise,
        found.ramp(float(time[marks.peak]))[1],
    )
    extended = marks.peak if left is None else end + left
    if extended > end:
        return Approach(
            _fit_until(time[:extended], force[:extended], found.onset, clock, start_up),
            extended,
            clock,
        )
    return found


def _fit_until(
    t: Array, y: Array, onset: float, clock: Clock, start_up: Tool | None
) -> SeparableFit:
    reach = max(0.25 * (float(t[-1]) - onset), 5.0 * float(np.median(np.diff(t))))

    def build_columns(shape: Array) -> Array:
        return _build_approach_columns(t, np.maximum(t - float(shape[0]), 0.0), clock)

    first = np.array([onset])
    fit = fit_separable(
        build_columns, y, first, first - 4.0 * reach, first + 2.0 * reach, np.array([reach])
    )
    if start_up is None:
        return fit

    def ringing(shape: Array) -> Array:
        decay = np.where(t < shape[0], np.exp(-(t - t[0]) / shape[2]), 0.0)
        return np.column_stack(
            [build_columns(shape), decay[:, None] * build_wave_columns(t - t[0], float(shape[1]))]
        )

    # does what sliding and ramp leave over hold a ring that begins with the record?
    frequency, decay_time = start_up
    before = t < fit.shape[0]
    since = t[before] - t[0]
    left = fit.residuals[before]
    had = float(left @ left)
    has = compute_rest(build_damped_wave_columns(since, frequency, decay_time), left)
    # two parameters more explain 2/n of white noise by chance
    if not had - has > max(_START_UP_GAIN, 20.0 / max(since.size, 1)) * had:
        return fit
    guess = np.array([fit.shape[0], frequency, decay_time])
    return fit_separable(
        ringing,
        y,
        guess,
        np.array([guess[0] - reach, 0.8 * frequency, 0.2 * decay_time]),
        np.array([guess[0] + reach, 1.25 * frequency, 5.0 * decay_time]),
        np.array([reach, 0.02 * frequency, 0.3 * decay_time]),
    )


def _find_end_of_line(miss: Array, noise: float, unsure: float) -> int | None:
    # First sample from which on the force is off the line of the ramp for good, beyond noise and
    # what the line itself is unsure by. None where it stays on it.
    if not miss.size:
        return None
    window = min(4, miss.size)
    mean = np.convolve(miss, np.full(window, 1.0 / window), mode="valid")
    off = np.abs(mean) > _LINE_SIGMAS * math.hypot(noise / math.sqrt(window), unsure)
    if not off[-1]:
        return None
    # noise may cross the limit for a moment; only what stays off to the peak is the peak's own
    # rounding
    return max(int(np.flatnonzero(~off).max(initial=0)) - 3, 0)
