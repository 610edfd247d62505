"""Magnitude estimation: Stevens' exponent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError


@dataclass(frozen=True)
class PowerLaw:
    """How the felt magnitude grows with the stimulus."""

    exponent: float  # Mean over participants and its 95 % interval by Student's t [1]
    low: float
    high: float
    by_participant: tuple[tuple[str, float, float], ...]  # Participant, exponent, and correlation of the logarithms


def power_law(frame: Any, magnitude: str, level: str, participant: str) -> PowerLaw:
    """Fit ``magnitude = constant * level ** exponent`` to each participant; each keeps an own modulus.

    Source: Stevens, S. S. (1957), Psychological Review 64, 153-181, doi:10.1037/h0046162.
    """
    from scipy import stats

    if not ((frame[magnitude] > 0.0).all() and (frame[level] > 0.0).all()):
        raise StudyError(f"{magnitude} and {level} must be positive in every row")
    found = []
    for person, own in frame.groupby(participant, sort=False):
        if own[level].nunique() < 3:
            raise StudyError(f"an exponent needs three levels, got {own[level].nunique()} [participant {person}]")
        line = stats.linregress(np.log(own[level]), np.log(own[magnitude]))
        found.append((str(person), float(line.slope), float(line.rvalue)))
    if len(found) < 2:
        raise StudyError(f"an interval over participants needs at least two, got {len(found)}")
    slopes = [slope for _, slope, _ in found]
    mean, error = float(np.mean(slopes)), float(np.std(slopes, ddof=1)) / len(slopes) ** 0.5
    reach = float(stats.t.ppf(0.975, len(slopes) - 1)) * error
    return PowerLaw(mean, mean - reach, mean + reach, tuple(found))
