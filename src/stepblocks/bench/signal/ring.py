"""The ring after the slip: frequency, decay and amplitude, for a tool damped like a bell.

The force after the slip is a level, what is left of the release itself (it dies in under a millisecond) and a ring
``A exp(-t / tau) cos(2 pi f t + phase)``; hum and drift are fitted along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.separable import (
    SeparableFit,
    covariance_of,
    fit_separable,
    misfit,
    numeric_jacobian,
    propagated,
)

Array = NDArray[np.float64]

BEGIN = 8e-3  # Time after the slip [s] in which a wrong fit of a ring shows

_LOWEST = 80.0  # [Hz] below lie hum and its first harmonic
_RELEASE_DECAY = (0.05e-3, 0.4e-3, 1.5e-3)  # [s] least, first guess, most
_DECAYS = (5e-3, 12e-3, 25e-3, 60e-3)  # [s] first guesses of the decay time


@dataclass(frozen=True)
class Ring:
    """A damped ring and its uncertainties."""

    frequency: float  # Frequency of the ring [Hz]
    frequency_std: float
    decay_time: float  # Time in which the amplitude falls to 1/e [s]
    decay_time_std: float
    level: float  # Level about which it rings in the end [N]
    level_std: float
    origin: float  # Instant that the fit counts from [s]
    mains: float  # Mains frequency fitted along [Hz]
    center: float
    time: Array
    # Shape: frequency, decay time, decay time of the release; weights: level, drift, hum (2), release, ring (2)
    fit: SeparableFit
    # By how many standard errors the residuals miss the noise; see `stepblocks.bench.signal.separable.misfit`
    misfit: float

    def curve(self, time: Array) -> Array:
        """Return the whole fit [N] at the instants `time`."""
        columns = _columns(time - self.origin, self.center - self.origin, self.mains, self.origin, self.fit.shape)
        return np.asarray(columns @ self.fit.weights, dtype=float)

    def curve_std(self, instant: float) -> float:
        """Return the standard uncertainty of `curve` at one instant [N]."""
        bound = np.full(3, np.inf)

        def model(shape: Array) -> Array:
            at = np.array([instant - self.origin])
            return np.asarray(
                _columns(at, self.center - self.origin, self.mains, self.origin, shape) @ self.fit.weights
            )

        slopes = numeric_jacobian(model, self.fit.shape, np.array([1e-3, 1e-6, 1e-6]), -bound, bound)[0]
        at = np.array([instant - self.origin])
        columns = _columns(at, self.center - self.origin, self.mains, self.origin, self.fit.shape)[0]
        gradient = np.concatenate([slopes, columns])
        return propagated(gradient, self.fit.covariance)


def guess_ring(time: Array, values: Array) -> tuple[float, float]:
    """Frequency [Hz] and decay time [s] of the strongest ring in `values`, roughly."""
    count = values.size
    rate = (count - 1) / (time[-1] - time[0])
    size = 1 << (4 * count - 1).bit_length()
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(2 * count)[count:], size))
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    spectrum[frequency < _LOWEST] = 0.0
    peak = float(frequency[int(np.argmax(spectrum))])
    best, least = _DECAYS[0], np.inf
    t = time - time[0]
    wave = np.column_stack([np.cos(2 * np.pi * peak * t), np.sin(2 * np.pi * peak * t)])
    for decay in _DECAYS:
        columns = np.column_stack([np.ones_like(t), np.exp(-t / decay)[:, None] * wave])
        rest = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        if float(rest @ rest) < least:
            best, least = decay, float(rest @ rest)
    return peak, best


def _columns(time: Array, center: float, mains: float, origin: float, shape: Array) -> Array:
    frequency, decay, release = shape
    hum = 2.0 * np.pi * mains * (time + origin)
    phase = 2.0 * np.pi * frequency * time
    ring = np.exp(-time / decay)
    return np.column_stack(
        [
            np.ones_like(time),
            time - center,
            np.cos(hum),
            np.sin(hum),
            np.exp(-time / release),
            ring * np.cos(phase),
            ring * np.sin(phase),
        ]
    )


def fit_ring(time: Array, force: Array, origin: float, mains: float, noise: float) -> Ring:
    """Fit a damped ring to the samples after a slip."""
    guess = guess_ring(time, force)
    t = time - origin
    center = 0.0  # the level is that at the slip, whatever drifts afterwards
    start = np.array([guess[0], guess[1], _RELEASE_DECAY[1]])
    lower = np.array([0.85 * guess[0], 1e-3, _RELEASE_DECAY[0]])
    upper = np.array([1.15 * guess[0], 1.0, _RELEASE_DECAY[2]])
    fit = fit_separable(
        lambda p: _columns(t, center, mains, origin, p), force, start, lower, upper, np.array([1.0, 5e-3, 1e-4])
    )
    spread = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    return Ring(
        frequency=float(fit.shape[0]),
        frequency_std=float(spread[0]),
        decay_time=float(fit.shape[1]),
        decay_time_std=float(spread[1]),
        level=float(fit.weights[0]),
        level_std=float(spread[3]),
        origin=origin,
        mains=mains,
        center=center + origin,
        time=time,
        fit=fit,
        misfit=misfit(fit.residuals, 10, int(np.searchsorted(time, origin + BEGIN)), noise),
    )


def ring_amplitude(ring: Ring, instant: float) -> tuple[float, float]:
    """Amplitude of the ring at an instant, and its standard uncertainty [N].

    The uncertainty holds what is uncertain in the decay time as far as the amplitude is carried back by it.
    """
    cosine, sine = ring.fit.weights[5:7]
    reach = instant - ring.origin
    growth = float(np.exp(-reach / ring.decay_time))
    size = float(np.hypot(cosine, sine))
    amplitude = size * growth
    gradient = np.zeros(ring.fit.covariance.shape[0])
    gradient[1] = amplitude * reach / ring.decay_time**2
    if size > 0.0:
        gradient[8], gradient[9] = growth * cosine / size, growth * sine / size
    return amplitude, propagated(gradient, ring.fit.covariance)


def linear_decay(ring: Ring) -> tuple[float, float]:
    """Loss of amplitude per time beside the exponential decay, and its standard uncertainty [N/s].

    The part of the decay that friction gives, ``a' = -a / tau - d``, to first order in d: one Gauss-Newton step of the
    fitted ring with d as one parameter more. It may come out negative by its uncertainty.
    """
    fit, t = ring.fit, ring.time - ring.origin
    lower, upper = np.full(3, -np.inf), np.full(3, np.inf)

    def model(shape: Array) -> Array:
        columns = _columns(t, ring.center - ring.origin, ring.mains, ring.origin, shape)
        return np.asarray(columns @ fit.weights, dtype=float)

    phase = 2.0 * np.pi * ring.frequency * t
    cosine, sine = fit.weights[5:7]
    size = float(np.hypot(cosine, sine))
    if size == 0.0:
        return float("nan"), float("nan")
    loss = -ring.decay_time * (1.0 - np.exp(-t / ring.decay_time))
    loss = loss * (cosine * np.cos(phase) + sine * np.sin(phase)) / size
    slopes = numeric_jacobian(model, fit.shape, np.array([1e-4, 1e-6, 1e-8]), lower, upper)
    columns = _columns(t, ring.center - ring.origin, ring.mains, ring.origin, fit.shape)
    jacobian = np.column_stack([slopes, columns, loss])
    scale = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    scale[scale == 0.0] = 1.0
    step = np.linalg.lstsq(jacobian / scale, fit.residuals, rcond=1e-10)[0] / scale
    covariance, _ = covariance_of(jacobian, fit.residuals - jacobian @ step)
    return float(step[-1]), float(np.sqrt(max(covariance[-1, -1], 0.0)))
