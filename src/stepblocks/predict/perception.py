"""What a person perceives of a ring: level over threshold, whether two blocks can be told apart, and fair spacings.

The figures are few and their confidence is limited; each constant says where it comes from. None of them was measured
on a hand-held explorer but the paper's threshold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels
from stepblocks.contact.energy import Status
from stepblocks.contact.uncertainty import Inputs, release_of
from stepblocks.errors import ContactError


@dataclass(frozen=True)
class Observer:
    """A person, as far as vibration of 250-350 Hz at the fingertip goes."""

    threshold_power: float  # Power that is just detected [W]
    ring_duration: float  # Time over which the energy of a ring is spent [s]
    # Just noticeable difference of the level [dB of power]; 75 % correct in two-alternative choice
    level_difference: float
    masking: float  # Share of a masking vibration's power that adds to the threshold [1]

    def __post_init__(self) -> None:
        for name in ("threshold_power", "ring_duration", "level_difference"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ContactError(f"{name} must be positive and finite, got {value:g}")
        if not (math.isfinite(self.masking) and self.masking >= 0.0):
            raise ContactError(f"masking must be finite and not negative, got {self.masking:g}")

    @property
    def weber_fraction(self) -> float:
        """Just noticeable relative change of energy [1]."""
        return float(10.0 ** (0.1 * self.level_difference) - 1.0)


# Threshold and duration: the paper. 1.5 dB (Weber fraction 0.41 of energy, 0.19 of amplitude): a median of 0.20 of
# amplitude stands in the abstract of "Vibrotactile difference thresholds: effects of vibration frequency, vibration
# magnitude, contact area, and body location" (thenar, 125 Hz, 10 dB over threshold, 12 subjects; up to 0.58
# elsewhere). Craig (1972, Perception & Psychophysics 11, 150) is remembered, not checked, for 1.5 dB. The fraction
# rises towards threshold, which is ignored, and was not measured on a short ring felt through a tool: treat it as a
# factor of two. Masking: a signal must exceed a masker of the same channel by the Weber fraction; an assumption, not
# a measurement
PAPER_OBSERVER = Observer(threshold_power=0.08e-6, ring_duration=16e-3, level_difference=1.5, masking=0.41)


def sensation_level(energy: float, observer: Observer = PAPER_OBSERVER, masker_power: float = 0.0) -> float:
    """Level of a ring over its threshold.

    Examples
    --------
    >>> round(sensation_level(10e-6), 1)
    38.9
    """
    if not (math.isfinite(energy) and energy > 0.0):
        raise ContactError(f"energy must be positive and finite, got {energy:g} J")
    if not (math.isfinite(masker_power) and masker_power >= 0.0):
        raise ContactError(f"masker_power must be finite and not negative, got {masker_power:g} W")
    threshold = observer.threshold_power + observer.masking * masker_power
    return 10.0 * math.log10(energy / observer.ring_duration / threshold)


def detectable(energy: float, observer: Observer = PAPER_OBSERVER, masker_power: float = 0.0) -> bool:
    """Whether a ring lies over its threshold, masked or not."""
    return sensation_level(energy, observer, masker_power) > 0.0


def discriminability(first: float, second: float, observer: Observer = PAPER_OBSERVER) -> tuple[float, float]:
    """How well two rings can be told apart.

    Signal detection theory with a decision variable that is linear in decibels: one just noticeable difference is
    75 % correct, so ``P = Phi(n z(0.75))``.

    Examples
    --------
    >>> discriminability(10e-6, 10e-6)
    (0.0, 0.5)
    """
    from scipy.stats import norm

    levels = sensation_level(first, observer), sensation_level(second, observer)
    steps = abs(levels[0] - levels[1]) / observer.level_difference
    return steps, float(norm.cdf(steps * norm.ppf(0.75)))


def height_of_energy(energy: float, inputs: Inputs) -> float:
    """Height H [m] of the step that rings with `energy` [J], the exact inverse of equations (1) and (2).

    Examples
    --------
    >>> inputs = Inputs(25e-6, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2)
    >>> energy = release_of(inputs)[2]
    >>> round(height_of_energy(energy, inputs) * 1e6, 9)
    25.0
    """
    if not (math.isfinite(energy) and energy > 0.0):
        raise ContactError(f"energy must be positive and finite, got {energy:g} J")
    force = math.sqrt(2.0 * inputs.stiffness * energy / inputs.conversion)
    angle = math.atan2(force, inputs.normal_load) - math.atan(inputs.friction)
    if angle <= 0.0:
        raise ContactError(
            f"energy of {energy:g} J is less than sliding friction alone stores: no step rings so little"
        )
    return float((inputs.ball_radius + inputs.edge_radius) * 2.0 * math.sin(0.5 * angle) ** 2)


def equally_felt_heights(
    count: int, lowest: float, highest: float, inputs: Inputs, observer: Observer = PAPER_OBSERVER
) -> tuple[NDArray[np.float64], float]:
    """Heights of a set whose blocks are equally spaced in predicted sensation instead of in micrometres.

    Sensation is taken to grow with the logarithm of the energy (Fechner), as a constant Weber fraction implies.

    Examples
    --------
    >>> inputs = Inputs(25e-6, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2)
    >>> heights, spacing = equally_felt_heights(5, 10e-6, 75e-6, inputs)
    >>> heights.round(8).tolist()
    [1e-05, 2.316e-05, 4.137e-05, 5.99e-05, 7.5e-05]
    """
    if count < 2 or not 0.0 < lowest < highest:
        raise ContactError(
            f"a set needs at least 2 blocks and increasing heights, got {count}, {lowest:g}, {highest:g}"
        )
    ends = []
    for height in (lowest, highest):
        status, _, energy = release_of(replace(inputs, height=height))
        if status is not Status.RELEASES:
            limit = kernels.locking_height(inputs.ball_radius + inputs.edge_radius, inputs.friction)
            raise ContactError(f"a step of {height:g} m is {status}; it locks from {limit:g} m on")
        ends.append(energy)
    energies = np.geomspace(ends[0], ends[1], count)
    heights = np.array([height_of_energy(float(energy), inputs) for energy in energies])
    spacing, _ = discriminability(float(energies[0]), float(energies[1]), observer)
    return heights, spacing
