"""What a person perceives of a ring: level over threshold, whether two blocks can be told apart, and fair spacings.

The figures are few and their confidence is limited; each constant says where it comes from. None of them was measured
on a hand-held explorer but the paper's threshold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels
from stepblocks.contact.counterface import Step
from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint
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
            require_positive(name, getattr(self, name))
        require_not_negative("masking", self.masking)

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
PAPER_OBSERVER = Observer(PAPER.tool.detection_threshold, PAPER.tool.ring_duration, level_difference=1.5, masking=0.41)


def sensation_level(energy: float, observer: Observer = PAPER_OBSERVER, masker_power: float = 0.0) -> float:
    """Level of a ring over its threshold.

    Examples
    --------
    >>> round(sensation_level(10e-6), 1)
    38.9
    """
    require_positive("energy", energy, "J")
    require_not_negative("masker_power", masker_power, "W")
    threshold = observer.threshold_power + observer.masking * masker_power
    return 10.0 * math.log10(energy / observer.ring_duration / threshold)


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


def height_of_energy(energy: float, point: OperatingPoint, edge_radius: float = 0.0) -> float:
    """Height H [m] of the step that rings with `energy` [J], the exact inverse of equations (1) and (2).

    Examples
    --------
    >>> energy = Step(25e-6).release(PAPER).vibration_energy
    >>> round(height_of_energy(energy, PAPER) * 1e6, 9)
    25.0
    """
    require_positive("energy", energy, "J")
    force = math.sqrt(2.0 * point.tool.stiffness * energy / point.tool.conversion)
    angle = math.atan2(force, point.normal_load) - math.atan(point.friction)
    if angle <= 0.0:
        raise ContactError(
            f"energy of {energy:g} J is less than sliding friction alone stores: no step rings so little"
        )
    return float((point.ball_radius + edge_radius) * 2.0 * math.sin(0.5 * angle) ** 2)


def equally_felt_heights(
    count: int,
    lowest: float,
    highest: float,
    point: OperatingPoint,
    edge_radius: float = 0.0,
    observer: Observer = PAPER_OBSERVER,
) -> tuple[NDArray[np.float64], float]:
    """Heights of a set whose blocks are equally spaced in predicted sensation instead of in micrometres.

    Sensation is taken to grow with the logarithm of the energy (Fechner), as a constant Weber fraction implies.

    Examples
    --------
    >>> heights, spacing = equally_felt_heights(5, 10e-6, 75e-6, PAPER)
    >>> heights.round(8).tolist()
    [1e-05, 2.316e-05, 4.137e-05, 5.99e-05, 7.5e-05]
    """
    if count < 2 or not 0.0 < lowest < highest:
        raise ContactError(
            f"a set needs at least 2 blocks and increasing heights, got {count}, {lowest:g}, {highest:g}"
        )
    ends = []
    for height in (lowest, highest):
        release = Step(height, edge_radius).release(point)
        if release.status is not Status.RELEASES:
            limit = kernels.locking_height(point.ball_radius + edge_radius, point.friction)
            raise ContactError(f"a step of {height:g} m is {release.status}; it locks from {limit:g} m on")
        ends.append(release.vibration_energy)
    energies = np.geomspace(ends[0], ends[1], count)
    heights = np.array([height_of_energy(float(energy), point, edge_radius) for energy in energies])
    spacing, _ = discriminability(float(energies[0]), float(energies[1]), observer)
    return heights, spacing
