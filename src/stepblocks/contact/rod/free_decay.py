"""What a damping test measures: a tip is moved a fixed distance and let go, and its ring is fitted.

The uncertainties are the least that any unbiased fit can have (Cramer and Rao), for white noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stepblocks.contact.domain import require_positive
from stepblocks.contact.operating_point import Tool
from stepblocks.errors import ContactError

_RECORD = 5.0  # time constants: all but 5e-5 of the energy is recorded
_MOST_RELEASES = 10_000


@dataclass(frozen=True)
class DecayTest:
    """A planned test of one probe."""

    displacement: float  # distance by which the tip is moved before it is let go [m]
    force: float  # force that this takes [N]
    peak_acceleration: float  # of the tip as it starts [m/s^2]
    frequency: float  # what will be counted [Hz]
    log_decrement: float  # what will be read from the amplitudes [1]
    decay_time: float  # time constant of the amplitude [s]
    periods_above_noise: int  # whole periods until the amplitude has sunk to three times the noise
    record_time: float  # time to record [s]
    samples: int  # samples of one release
    frequency_std: float  # least standard uncertainty of the frequency from one release [Hz]
    log_decrement_std: float  # of the logarithmic decrement [1]
    releases: int  # releases after which the logarithmic decrement is known as well as wanted


def plan_decay_test(tool: Tool, displacement: float, noise: float, rate: float, wanted: float) -> DecayTest:
    """Say what a test of a tool's ring will measure, and how well; `wanted` is relative, of the logarithmic decrement.

    Source: Cramer-Rao bound of a damped sine with unknown amplitude, phase, frequency and decay; for a long record
    ``var(1/tau) = 16 noise^2 / (amplitude^2 rate tau^3)``.
    """
    for name, value in (("displacement", displacement), ("noise", noise), ("rate", rate), ("wanted", wanted)):
        require_positive(name, value)
    frequency, decay_time = tool.frequency, tool.decay_time
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
        displacement=displacement,
        force=tool.stiffness * displacement,
        peak_acceleration=(math.tau * frequency) ** 2 * displacement,
        frequency=frequency,
        log_decrement=decrement,
        decay_time=decay_time,
        periods_above_noise=math.floor(decay_time * math.log(displacement / (3.0 * noise)) * frequency),
        record_time=count / rate,
        samples=count,
        frequency_std=frequency_std,
        log_decrement_std=decrement_std,
        releases=releases,
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
