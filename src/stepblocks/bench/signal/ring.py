"""The ring after the slip: frequency, decay and amplitude, for a tool damped like a bell.

The force after the slip is a level, what is left of the release itself (it dies in under a millisecond) and a ring
``A exp(-t / tau) cos(2 pi f t + phase)``; hum and drift are fitted along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.separable import (
    SeparableFit,
    damped_wave,
    fit_linear,
    fit_separable,
    misfit,
    numeric_jacobian,
    propagated,
    wave,
)

BEGIN = 8e-3  # time after the slip in which a wrong fit of a ring shows [s]

_LOWEST = 80.0  # [Hz] below lie hum and its first harmonic
_RELEASE_DECAY = (0.05e-3, 0.4e-3, 1.5e-3)  # [s] least, first guess, most
_DECAYS = (5e-3, 12e-3, 25e-3, 60e-3)  # [s] first guesses of the decay time


@dataclass(frozen=True)
class Ring:
    """A damped ring and its uncertainties."""

    frequency: Estimate  # [Hz]
    decay_time: Estimate  # in which the amplitude falls to 1/e [s]
    level: Estimate  # about which it rings at `origin` [N]
    origin: float  # instant that the fit counts from [s]
    mains: float  # mains frequency fitted along [Hz]
    # shape: frequency, decay time, decay time of the release; weights: level, drift, hum (2), release, ring (2)
    fit: SeparableFit
    misfit: float  # by how many standard errors the residuals miss the noise

    def curve(self, time: Array) -> Array:
        """Return the whole fit [N] at the instants `time`."""
        return self._model(time - self.origin, self.fit.shape)

    def curve_std(self, instant: float) -> float:
        """Return the standard uncertainty of `curve` at one instant [N]."""
        at = np.array([instant - self.origin])
        slopes = numeric_jacobian(lambda shape: self._model(at, shape), self.fit.shape, np.array([1e-3, 1e-6, 1e-6]))
        columns = _columns(at, self.origin, self.mains, self.fit.shape)
        return propagated(np.concatenate([slopes[0], columns[0]]), self.fit.covariance)

    def amplitude(self, instant: float) -> Estimate:
        """Amplitude of the ring, carried to an instant by its decay, and its standard uncertainty [N]."""
        cosine, sine = self.fit.weights[5:7]
        reach, decay = instant - self.origin, self.decay_time[0]
        growth = float(np.exp(-reach / decay))
        size = float(np.hypot(cosine, sine))
        carried = size * growth
        gradient = np.zeros(self.fit.covariance.shape[0])
        gradient[1] = carried * reach / decay**2
        if size > 0.0:
            gradient[8], gradient[9] = growth * cosine / size, growth * sine / size
        return carried, propagated(gradient, self.fit.covariance)

    def _model(self, since: Array, shape: Array) -> Array:
        return np.asarray(_columns(since, self.origin, self.mains, shape) @ self.fit.weights, dtype=float)


def guess_ring(time: Array, values: Array) -> Tool:
    """Frequency [Hz] and decay time [s] of the strongest ring in `values`, roughly."""
    count = values.size
    rate = (count - 1) / (time[-1] - time[0])
    size = 1 << (4 * count - 1).bit_length()
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(2 * count)[count:], size))
    frequencies = np.fft.rfftfreq(size, 1.0 / rate)
    spectrum[frequencies < _LOWEST] = 0.0
    frequency = float(frequencies[int(np.argmax(spectrum))])
    since = time - time[0]

    def left(decay: float) -> float:
        rest = fit_linear(np.column_stack([np.ones_like(since), damped_wave(since, frequency, decay)]), values)[1]
        return float(rest @ rest)

    return frequency, min(_DECAYS, key=left)


def fit_ring(time: Array, force: Array, origin: float, mains: float, noise: float) -> Ring:
    """Fit a damped ring to the samples after a slip."""
    frequency, decay = guess_ring(time, force)
    since = time - origin
    fit = fit_separable(
        lambda shape: _columns(since, origin, mains, shape),
        force,
        start=np.array([frequency, decay, _RELEASE_DECAY[1]]),
        lower=np.array([0.85 * frequency, 1e-3, _RELEASE_DECAY[0]]),
        upper=np.array([1.15 * frequency, 1.0, _RELEASE_DECAY[2]]),
        scale=np.array([1.0, 5e-3, 1e-4]),
    )
    return Ring(
        frequency=(float(fit.shape[0]), fit.std(0)),
        decay_time=(float(fit.shape[1]), fit.std(1)),
        level=(float(fit.weights[0]), fit.std(3)),
        origin=origin,
        mains=mains,
        fit=fit,
        misfit=misfit(fit.residuals, 10, int(np.searchsorted(time, origin + BEGIN)), noise),
    )


def _columns(since: Array, origin: float, mains: float, shape: Array) -> Array:
    """Level and drift from the slip on, hum on the clock of the record, rest of the release, ring."""
    frequency, decay, release = shape
    hum, ring = wave(since + origin, mains), damped_wave(since, frequency, decay)
    return np.column_stack([np.ones_like(since), since, hum, np.exp(-since / release), ring])
