"""Records of known truth: what a rig would write for a trial whose every figure is given.

The same course as on the bench: sliding, ramp, slip, ring, with hum, drift, start-up ring, noise, a sensor of finite
bandwidth and a converter of finite steps on top. Nothing here knows where the figures come from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.rubbing_ring import rubbing_force
from stepblocks.bench.signal.trace import Trace

Array = NDArray[np.float64]

_LEAST_SLIDE, _MOST_SLIDE = 50e-3, 80e-3  # [s] before the edge
_OVERSAMPLING = 16  # a sensor is filtered on a finer clock than the converter's


@dataclass(frozen=True)
class Truth:
    """What a trial is."""

    load: float  # Normal force [N]
    sliding_force: float  # Tangential force while sliding [N]
    slope: float  # Slope of the loading ramp [N/s]
    peak_force: float  # Tangential force at release [N]
    amplitude: float  # Amplitude of the ring at release [N]
    frequency: float  # Of the ring [Hz, s]
    decay_time: float
    sympathetic: float = 0.25  # Amplitude of the normal force that rings along, per amplitude of the tangential one [1]
    gap: float = 0.0  # Twice the friction that turns with the tip [N]; 0 for a ring without
    release_decay: float = 0.4e-3  # Time in which the rest of the peak dies [s]


@dataclass(frozen=True)
class Rig:
    """What a rig adds."""

    sample_rate: float = 10e3  # [Hz]
    noise: float = 4.5e-3  # Standard deviation of white noise [N]
    quantum: float = 0.5e-3  # Step of the converter [N]; 0 for none
    hum: float = 3e-3  # Amplitude of the mains hum [N]
    mains: float = 50.0  # Its frequency [Hz]
    drift: float = 0.0  # Of both channels [N/s]
    start_up: float = 0.0  # Amplitude of the ring when the handle starts [N]
    bandwidth: float = math.inf  # Corner of a first-order sensor [Hz]; inf for an ideal one
    tail: float = 5.0  # Length of the record after the slip, in decay times


def record(truth: Truth, rig: Rig, random: np.random.Generator, gain: float = 1.0) -> tuple[Trace, float, float]:
    """Make one record."""
    onset = float(random.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    release = onset + (truth.peak_force - truth.sliding_force) / truth.slope
    # the clock does not know of the events: their phase against it is any
    count = math.ceil((release + rig.tail * truth.decay_time) * rig.sample_rate)
    factor = oversampling(rig)
    fine = np.arange(count * factor) / (rig.sample_rate * factor)
    tangential = gain * _tangential(fine, truth, rig, onset, release, random)
    normal = truth.load + _sympathetic(fine, truth, release)
    return disturbed(tangential, normal, rig, random), onset, release


def disturbed(tangential: Array, normal: Array, rig: Rig, random: np.random.Generator) -> Trace:
    """Put on true forces what a rig adds: the sensor's lag, hum, drift, noise, the steps of the converter."""
    factor = oversampling(rig)
    if factor > 1:
        tangential, normal = _sensor(tangential, rig, factor), _sensor(normal, rig, factor)
    count = tangential.size
    time = np.round(np.arange(count) / rig.sample_rate, 9)
    channels = []
    for values in (tangential, normal):
        phase = random.uniform(0.0, 2.0 * math.pi)
        hum = rig.hum * np.sin(2.0 * np.pi * rig.mains * time + phase)
        noisy = values + hum + rig.drift * time + rig.noise * random.standard_normal(count)
        channels.append(np.round(noisy / rig.quantum) * rig.quantum if rig.quantum > 0.0 else noisy)
    return Trace(time, channels[0], channels[1])


def oversampling(rig: Rig) -> int:
    """How many true values `disturbed` wants per sample: more than one where the sensor lags."""
    return 1 if math.isinf(rig.bandwidth) else _OVERSAMPLING


def _tangential(
    time: Array, truth: Truth, rig: Rig, onset: float, release: float, random: np.random.Generator
) -> Array:
    force = truth.sliding_force + truth.slope * np.maximum(time - onset, 0.0)
    phase = random.uniform(0.0, 2.0 * math.pi)
    ring = np.exp(-time / truth.decay_time) * np.cos(2.0 * np.pi * truth.frequency * time + phase)
    force = force + rig.start_up * np.where(time < onset, ring, 0.0)
    after = time >= release
    since = time[after] - release
    rest = truth.peak_force - truth.sliding_force - truth.amplitude
    omega = 2.0 * math.pi * truth.frequency
    if truth.gap > 0.0:
        start = (truth.sliding_force + truth.amplitude, -truth.amplitude / truth.decay_time)
        ringing = rubbing_force(
            since, truth.sliding_force, truth.gap, truth.frequency, truth.decay_time, start, truth.slope
        )
    else:
        ringing = truth.sliding_force + truth.amplitude * np.exp(-since / truth.decay_time) * np.cos(omega * since)
    force[after] = ringing + rest * np.exp(-since / truth.release_decay)
    return force


def _sympathetic(time: Array, truth: Truth, release: float) -> Array:
    since = np.maximum(time - release, 0.0)
    size = truth.sympathetic * truth.amplitude
    ring = size * np.exp(-since / truth.decay_time) * np.cos(2.0 * np.pi * truth.frequency * since + 0.25 * np.pi)
    return np.where(time >= release, ring, 0.0)


def _sensor(values: Array, rig: Rig, factor: int) -> Array:
    from scipy.signal import lfilter

    keep = math.exp(-2.0 * math.pi * rig.bandwidth / (rig.sample_rate * factor))
    followed = lfilter([1.0 - keep], [1.0, -keep], values, zi=np.array([keep * values[0]]))[0]
    return np.asarray(followed[::factor], dtype=float)
