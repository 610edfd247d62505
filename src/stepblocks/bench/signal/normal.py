"""The normal force of a trial: its level while sliding, and the ring that it shares."""

import numpy as np

from stepblocks.bench.signal import Array, Estimate
from stepblocks.bench.signal.aftermath import Aftermath
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.separable import (
    build_damped_wave_columns,
    build_wave_columns,
    fit_with_covariance,
    propagate_std,
)

_SETTLE = 0.8e-3  # [s] after the slip in which the normal channel shows the release itself
_ONSET_GUARD = 1e-3  # [s] before the onset, of which the instant is not known better


def measure_sliding_normal_force(time: Array, normal_force: Array, approach: Approach) -> Estimate:
    """Return the normal force while sliding, without hum and drift [N].

    `time` [s] and `normal_force` [N] have shape (n,).
    """
    end = int(np.searchsorted(time, approach.onset - _ONSET_GUARD))
    columns = _build_drift_and_hum_columns(time[:end], approach.mains_frequency)
    weights, covariance = fit_with_covariance(columns, normal_force[:end])
    std = float(np.sqrt(covariance[0, 0]))
    return Estimate(float(weights[0]), std)


def _build_drift_and_hum_columns(time: Array, mains: float) -> Array:
    """Return the columns of level, drift and hum, shape (n, 4)."""
    hum = build_wave_columns(time, mains)
    return np.column_stack([np.ones_like(time), time - time.mean(), hum])


def measure_normal_ring_amplitude(
    time: Array, normal_force: Array, approach: Approach, after: Aftermath
) -> Estimate:
    """Return the amplitude at the release of the ring in the normal force [N].

    The ring has the frequency and the decay of the tangential force. `time` [s] and
    `normal_force` [N] have shape (n,).
    """
    settled = max(after.start + _SETTLE, after.ring.time_zero)
    begin = int(np.searchsorted(time, settled))
    still = _build_drift_and_hum_columns(time[begin:], approach.mains_frequency)
    since = time[begin:] - after.start

    def measure_ring(frequency: float, decay_time: float) -> Estimate:
        """Measure the amplitude of a ring of known frequency [Hz] and decay time [s]."""
        ring = build_damped_wave_columns(since, frequency, decay_time)
        columns = np.column_stack([ring, still])
        weights, covariance = fit_with_covariance(columns, normal_force[begin:])
        size = float(np.hypot(weights[0], weights[1]))
        if size == 0.0:
            return Estimate(0.0, float(np.sqrt(covariance[0, 0])))
        return Estimate(size, propagate_std(weights[:2] / size, covariance[:2, :2]))

    frequency, frequency_std = after.frequency
    decay_time, decay_std = after.decay_time
    amplitude, own_std = measure_ring(frequency, decay_time)
    # what is uncertain of the tangential ring, whose course this one is taken to follow
    of_frequency = measure_ring(frequency + frequency_std, decay_time).value - amplitude
    of_decay_time = measure_ring(frequency, decay_time + decay_std).value - amplitude
    of_instant = 0.0
    if decay_time > 0.0:
        of_instant = amplitude * after.sample / decay_time
    std = np.linalg.norm([own_std, of_frequency, of_decay_time, of_instant])
    return Estimate(amplitude, float(std))
