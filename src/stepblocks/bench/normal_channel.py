"""The normal force: load while sliding, and the sympathetic ring after the slip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.aftermath import Aftermath
from stepblocks.bench.approach import Approach
from stepblocks.bench.separable import covariance_of, propagated

__all__ = ["normal_level", "sympathetic_force"]

Array = NDArray[np.float64]

_SETTLE = 0.8e-3  # [s] after the slip in which the normal channel shows the release itself
_ONSET_GUARD = 1e-3  # [s]


def _hum(time: Array, mains: float) -> Array:
    phase = 2.0 * np.pi * mains * time
    return np.column_stack([np.cos(phase), np.sin(phase)])


def normal_level(time: Array, normal: Array, approach: Approach) -> tuple[float, float]:
    """Return the normal force while sliding, hum and drift apart, and its standard uncertainty [N]."""
    end = int(np.searchsorted(time, approach.onset - _ONSET_GUARD))
    t, y = time[:end], normal[:end]
    columns = np.column_stack([np.ones_like(t), t - t.mean(), _hum(t, approach.mains)])
    weights = np.linalg.lstsq(columns, y, rcond=None)[0]
    covariance, _ = covariance_of(columns, y - columns @ weights)
    return float(weights[0]), float(np.sqrt(covariance[0, 0]))


def sympathetic_force(time: Array, normal: Array, approach: Approach, after: Aftermath) -> tuple[float, float]:
    """Amplitude of the normal force that rings along with the tangential one, at the release [N].

    It is the part of the normal force with the frequency and the decay of the tangential ring.
    """
    begin = int(np.searchsorted(time, max(after.start + _SETTLE, after.origin)))
    t, y = time[begin:], normal[begin:]
    since = t - after.start
    phase = 2.0 * np.pi * after.frequency[0] * since
    decay = np.exp(-since / after.decay_time[0])
    columns = np.column_stack(
        [decay * np.cos(phase), decay * np.sin(phase), np.ones_like(t), t - t.mean(), _hum(t, approach.mains)]
    )
    weights = np.linalg.lstsq(columns, y, rcond=None)[0]
    covariance, _ = covariance_of(columns, y - columns @ weights)
    amplitude = float(np.hypot(weights[0], weights[1]))
    if amplitude == 0.0:
        return 0.0, float(np.sqrt(covariance[0, 0]))
    gradient = np.zeros(6)
    gradient[:2] = weights[:2] / amplitude
    return amplitude, propagated(gradient, covariance)
