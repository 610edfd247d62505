"""Sliding and loading: level before the edge, onset, slope of the ramp, with hum, drift and start-up fitted along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.landmarks import Landmarks
from stepblocks.bench.signal.separable import SeparableFit, fit_linear, fit_separable, propagated, wave

Array = NDArray[np.float64]

_MAINS = (50.0, 60.0)  # [Hz]
_RAMP_SHARE = 0.85  # of the rise; the first pass stays clear of a rounded peak
_START_UP_GAIN = 0.02  # a start-up ring must explain this share of the variance, or it is left out
_LINE_SIGMAS = 4.0


@dataclass(frozen=True)
class Approach:
    """What was fitted to a trace up to its peak."""

    level: float  # tangential force while sliding [N]
    level_std: float  # [N]
    onset: float  # begin of loading [s]
    slope: float  # of the ramp [N/s]
    slope_std: float  # [N/s]
    end: int  # first sample that no longer follows the line of the ramp
    mains: float  # mains frequency that was fitted along [Hz]
    fit: SeparableFit  # shape: onset (and start-up ring); weights: level, drift, slope, hum (and start-up ring)
    center: float  # instant at which `level` holds [s]

    @property
    def start_up(self) -> tuple[float, float] | None:
        """Frequency [Hz] and decay time [s] of the ring when the handle started, where there is one."""
        return (float(self.fit.shape[1]), float(self.fit.shape[2])) if self.fit.shape.size == 3 else None

    def line(self, time: Array) -> Array:
        """Line of the ramp with drift and hum [N], continued past its end."""
        columns = _columns(time, self.onset, self.center, self.mains)
        columns[:, 2] = time - self.onset
        return np.asarray(columns @ self.fit.weights[:5], dtype=float)

    def line_std(self, time: float) -> float:
        """Return the standard uncertainty of `ramp` at one instant [N]."""
        columns = np.array([1.0, 0.0, time - self.onset, 0.0, 0.0])
        size = self.fit.shape.size
        gradient = np.zeros(self.fit.covariance.shape[0])
        gradient[0] = -self.slope
        gradient[size : size + 5] = columns
        return propagated(gradient, self.fit.covariance)

    def hum(self, time: Array) -> Array:
        """Hum alone [N], continued over the whole record."""
        return np.asarray(wave(time, self.mains) @ self.fit.weights[3:5], dtype=float)

    def sliding(self, time: Array) -> Array:
        """Level with hum and, where there is one, the start-up ring [N], on the clock of the fit."""
        force = self.level + self.hum(time)
        if self.start_up is None:
            return force
        frequency, decay = self.start_up
        ring = np.exp(-time / decay)[:, None] * wave(time, frequency)
        return np.asarray(force + ring @ self.fit.weights[5:7], dtype=float)

    def ramp(self, time: float) -> float:
        """Force on the line of the ramp without hum and drift [N]."""
        return self.level + self.slope * (time - self.onset)


def mains_of(time: Array, values: Array) -> float:
    """Mains frequency that explains more of `values` [Hz]."""
    left = {}
    for mains in _MAINS:
        rest = fit_linear(np.column_stack([np.ones_like(time), wave(time, mains)]), values)[1]
        left[mains] = float(rest @ rest)
    return min(left, key=left.__getitem__)


def _columns(time: Array, onset: float, center: float, mains: float) -> Array:
    return np.column_stack([np.ones_like(time), time - center, np.maximum(time - onset, 0.0), wave(time, mains)])


def fit_approach(time: Array, force: Array, marks: Landmarks, start_up: tuple[float, float] | None) -> Approach:
    """Fit sliding and ramp together."""
    climb = np.flatnonzero(force[: marks.peak + 1] - marks.level < _RAMP_SHARE * marks.rise)
    end = int(climb[-1]) + 1
    slide_end = int(np.searchsorted(time, marks.onset))
    center = float(time[: max(slide_end, 1)].mean())
    mains = mains_of(time[:slide_end], force[:slide_end])
    step = float(np.median(np.diff(time)))
    fit = _fit_until(time[:end], force[:end], marks.onset, center, mains, start_up, step=step)
    onset = float(fit.shape[0])
    # the filter of a converter rings a sample or two ahead of a corner
    rest = slice(end, max(marks.peak - 2, end))
    miss = force[rest] - _columns(time[rest], onset, center, mains) @ fit.weights[:5]
    extended = end + left if (left := _leaves_line(miss, marks.noise)) is not None else marks.peak
    if extended > end:
        end = extended
        fit = _fit_until(time[:end], force[:end], onset, center, mains, start_up, step=step)
    return Approach(
        level=float(fit.weights[0]),
        level_std=fit.std(fit.shape.size),
        onset=float(fit.shape[0]),
        slope=float(fit.weights[2]),
        slope_std=fit.std(fit.shape.size + 2),
        end=end,
        mains=mains,
        fit=fit,
        center=center,
    )


def _fit_until(
    t: Array, y: Array, onset: float, center: float, mains: float, start_up: tuple[float, float] | None, *, step: float
) -> SeparableFit:
    reach = max(0.25 * (float(t[-1]) - onset), 5.0 * step)

    def plain(shape: Array) -> Array:
        return _columns(t, float(shape[0]), center, mains)

    first = np.array([onset])
    fit = fit_separable(plain, y, first, first - 4.0 * reach, first + 2.0 * reach, np.array([reach]))
    if start_up is None:
        return fit

    def ringing(shape: Array) -> Array:
        decay = np.where(t < shape[0], np.exp(-(t - t[0]) / shape[2]), 0.0)
        return np.column_stack([plain(shape), decay[:, None] * wave(t - t[0], float(shape[1]))])

    frequency, decay_time = start_up
    if not _rings(t, fit, frequency, decay_time):
        return fit
    guess = np.array([fit.shape[0], frequency, decay_time])
    lower = np.array([guess[0] - reach, 0.8 * frequency, 0.2 * decay_time])
    upper = np.array([guess[0] + reach, 1.25 * frequency, 5.0 * decay_time])
    return fit_separable(ringing, y, guess, lower, upper, np.array([reach, 0.02 * frequency, 0.3 * decay_time]))


def _rings(time: Array, fit: SeparableFit, frequency: float, decay_time: float) -> bool:
    """Whether what sliding and ramp leave over holds a ring that begins with the record."""
    before = time < fit.shape[0]
    t, left = time[before] - time[0], fit.residuals[before]
    rest = fit_linear(np.exp(-t / decay_time)[:, None] * wave(t, frequency), left)[1]
    had, has = float(left @ left), float(rest @ rest)
    # two parameters more explain 2/n of white noise by chance
    return bool(had - has > max(_START_UP_GAIN, 20.0 / max(t.size, 1)) * had)


def _leaves_line(miss: Array, noise: float) -> int | None:
    """First sample from which on the force is off the line of the ramp for good; None where it stays on it."""
    if not miss.size:
        return None
    window = min(4, miss.size)
    mean = np.convolve(miss, np.full(window, 1.0 / window), mode="valid")
    off = np.abs(mean) > _LINE_SIGMAS * noise / np.sqrt(window)
    if not off[-1]:
        return None
    # noise may cross the limit for a moment; only what stays off to the peak is the peak's own rounding
    on = np.flatnonzero(~off)
    return max(int(on[-1]) - 3, 0) if on.size else 0
