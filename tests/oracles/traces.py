"""Closed-form courses of a drag over an edge: sliding, a straight ramp, a release in an instant, a
damped ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """What a trace is, no dimension of it at 1."""

    level: float = 0.12  # sliding force [N]
    onset: float = 0.0612  # begin of loading [s]
    slope: float = 98.1  # of the ramp [N/s]
    peak: float = 1.2  # force at release [N]
    amplitude: float = 0.53  # of the ring at release [N]
    frequency: float = 287.0  # [Hz]
    decay_time: float = 17e-3  # [s]
    phase: float = 0.0  # of the ring at release [rad]
    rest_decay: float = 0.4e-3  # in which what is left of the peak dies [s]
    load: float = 0.8  # normal force [N]

    @property
    def release(self) -> float:
        """Instant at which the ramp reaches the peak [s]."""
        return self.onset + (self.peak - self.level) / self.slope

    def clock(self, rate: float = 10e3, tail: float = 0.1) -> Floats:
        """Instants of a record that ends some time after the release [s]."""
        return np.arange(round((self.release + tail) * rate)) / rate

    def ring(self, time: Floats) -> Floats:
        """Ring about the sliding level [N], 0 before the release."""
        since = np.maximum(time - self.release, 0.0)
        swing = np.cos(2.0 * np.pi * self.frequency * since + self.phase)
        return np.where(
            time >= self.release, self.amplitude * np.exp(-since / self.decay_time) * swing, 0.0
        )

    def force(self, time: Floats) -> Floats:
        """Tangential force [N]; it is continuous at the release."""
        since = np.maximum(time - self.release, 0.0)
        rest = self.peak - self.level - self.amplitude * np.cos(self.phase)
        after = self.level + self.ring(time) + rest * np.exp(-since / self.rest_decay)
        return np.where(
            time < self.release, self.level + self.slope * np.maximum(time - self.onset, 0.0), after
        )


def hum(time: Floats, amplitude: float, frequency: float = 50.0, phase: float = 0.7) -> Floats:
    """Mains hum [N]."""
    return amplitude * np.sin(2.0 * np.pi * frequency * time + phase)
