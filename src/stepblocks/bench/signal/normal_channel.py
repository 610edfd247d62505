"""The normal force: load while sliding, and the sympathetic ring after the slip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.aftermath import Aftermath
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.separable import covariance_of, fit_linear, propagated, wave

Array = NDArray[np.float64]

_SETTLE = 0.8e-3  # [s] after the slip in which the normal channel shows the release itself
_ONSET_GUARD = 1e-3  # [s]


def normal_level(time: Array, normal: Array, approach: Approach) -> tuple[float, float]:
    """Return the normal force while sliding, hum and drift apart, and its standard uncertainty [N]."""
    end = int(np.searchsorted(time, approach.onset - _ONSET_GUARD))
    t, y = time[:end], normal[:end]
    columns = np.column_stack([np.ones_like(t), t - t.mean(), wave(t, approach.mains)])
    weights, residuals = fit_linear(columns, y)
    covariance = covariance_of(columns, residuals)
    return float(weights[0]), float(np.sqrt(covariance[0, 0]))


def sympathetic_force(time: Array, normal: Array, approach: Approach, after: Aftermath) -> tuple[float, float]:
    """Amplitude of the normal force that rings along with the tangential one, at the release [N].

    It is the part of the normal force with the frequency and the decay of the tangential ring.
    """
    begin = int(np.searchsorted(time, max(after.start + _SETTLE, after.origin)))
    t, y = time[begin:], normal[begin:]
    still = np.column_stack([np.ones_like(t), t - t.mean(), wave(t, approach.mains)])

    def ringing(frequency: float, decay_time: float) -> tuple[float, float]:
        since = t - after.start
        columns = np.column_stack([np.exp(-since / decay_time)[:, None] * wave(since, frequency), still])
        weights, residuals = fit_linear(columns, y)
        covariance = covariance_of(columns, residuals)
        size = float(np.hypot(weights[0], weights[1]))
        if size == 0.0:
            return 0.0, float(np.sqrt(covariance[0, 0]))
        gradient = np.zeros(6)
        gradient[:2] = weights[:2] / size
        return size, propagated(gradient, covariance)

    (frequency, frequency_std), (decay, decay_std) = after.frequency, after.decay_time
    amplitude, own = ringing(frequency, decay)
    # what is uncertain of the tangential ring, whose course this one is taken to follow
    moved = ringing(frequency + frequency_std, decay)[0], ringing(frequency, decay + decay_std)[0]
    late = amplitude * after.sample / decay if decay > 0.0 else 0.0
    return amplitude, float(np.linalg.norm([own, moved[0] - amplitude, moved[1] - amplitude, late]))
