"""What a damping test measures: a tip is moved a fixed distance and let go, and its ring is fitted.

The uncertainties are the least that any unbiased fit can have (Cramer and Rao), for white noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import ContactError

_RECORD = 5.0  # time constants: all but 5e-5 of the energy is recorded
_MOST_RELEASES = 10_000


@dataclass(frozen=True)
class DecayTest:
    """A planned test of one probe."""

    displacement: float  # Distance by which the tip is moved before it is let go [m]
    force: float  # Force that this takes [N]
    peak_acceleration: float  # Of the tip as it starts [m/s^2]
    frequency: float  # What will be counted [Hz]
    log_decrement: float  # What will be read from the amplitudes [1]
    decay_time: float  # Time constant of the amplitude [s]
    periods_above_noise: int  # Whole periods until the amplitude has sunk to three times the noise
    record_time: float  # Time to record [s]
    samples: int  # Samples of one release
    frequency_std: float  # Least standard uncertainty of the frequency from one release [Hz]
    log_decrement_std: float  # Of the logarithmic decrement [1]
    releases: int  # Releases after which the logarithmic decrement is known as well as wanted


def plan_decay_test(
    stiffness: float, frequency: float, decay_time: float, displacement: float, noise: float, rate: float, wanted: float
) -> DecayTest:
    """Say what a test of a ring will measure, and how well.

    Source: Cramer-Rao bound of a damped sine with unknown amplitude, phase, frequency and decay; for a long record
    ``var(1/tau) = 16 noise^2 / (amplitude^2 rate tau^3)``.
    """
    given = {
        "stiffness": stiffness,
        "frequency": frequency,
        "decay_time": decay_time,
        "displacement": displacement,
        "noise": noise,
        "rate": rate,
        "wanted": wanted,
    }
    for name, value in given.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ContactError(f"{name} must be positive and finite, got {value:g}")
    if rate < 4.0 * frequency:
        raise ContactError(f"rate must be at least four samples per period ({4.0 * frequency:.4g} Hz), got {rate:g} Hz")
    if displacement <= 3.0 * noise:
        raise ContactError(
            f"displacement must exceed three times the noise ({3e6 * noise:g} um), got {displacement * 1e6:g} um"
        )
    count = max(math.ceil(_RECORD * decay_time * rate), 8)
    decrement = 1.0 / (decay_time * frequency)
    angular_std, rate_std = _least(displacement, frequency, decay_time, noise, rate, count)
    frequency_std = angular_std / math.tau
    decrement_std = math.hypot(rate_std / frequency, decrement * frequency_std / frequency)
    releases = max(math.ceil((decrement_std / (wanted * decrement)) ** 2), 1)
    if releases > _MOST_RELEASES:
        raise ContactError(
            f"the wanted uncertainty {wanted:g} would take {releases} releases, more than {_MOST_RELEASES}"
        )
    return DecayTest(
        displacement,
        stiffness * displacement,
        (math.tau * frequency) ** 2 * displacement,
        frequency,
        decrement,
        decay_time,
        math.floor(decay_time * math.log(displacement / (3.0 * noise)) * frequency),
        count / rate,
        count,
        frequency_std,
        decrement_std,
        releases,
    )


def _least(
    amplitude: float, frequency: float, decay_time: float, noise: float, rate: float, count: int
) -> tuple[float, float]:
    """Least standard uncertainties of the angular frequency and of the decay rate [1/s]."""
    time = np.arange(count) / rate
    envelope, phase = np.exp(-time / decay_time), math.tau * frequency * time
    cosine, sine = envelope * np.cos(phase), envelope * np.sin(phase)
    scaled = time / decay_time  # so that all columns are of order one
    slopes = np.column_stack([cosine, -sine, -scaled * sine, -scaled * cosine]) * amplitude
    covariance = np.linalg.inv(slopes.T @ slopes) * noise**2
    return math.sqrt(covariance[2, 2]) / decay_time, math.sqrt(covariance[3, 3]) / decay_time
