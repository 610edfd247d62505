"""How perceived magnitudes grow with the stimulus: Stevens' power law."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.bounded import Bounded

_FEWEST_LEVELS = 3  # of the stimulus, for an exponent and a correlation


class ParticipantExponent(NamedTuple):
    """Power law of one participant.

    Attributes
    ----------
    participant : str
        Name.
    exponent : float
        Of the stimulus [1].
    correlation : float
        Of the logarithms of magnitude and stimulus [1].
    """

    participant: str
    exponent: float
    correlation: float


@dataclass(frozen=True)
class PowerLaw:
    """How the perceived magnitude grows with the stimulus.

    Attributes
    ----------
    exponent, low, high : float
        Mean over participants, with its 95 % interval by Student's t [1].
    by_participant : tuple of ParticipantExponent
        In the order of the judgements.
    condition : str
        In which it was measured.
    """

    exponent: float
    low: float
    high: float
    by_participant: tuple[ParticipantExponent, ...]
    condition: str = ""

    @property
    def bounds(self) -> Bounded:
        """The exponent with its interval."""
        return Bounded(self.exponent, self.low, self.high)


def fit_power_law(
    frame: Table, magnitude: str, level: str, participant: str, condition: str = ""
) -> PowerLaw:
    """Fit ``magnitude = constant * level ** exponent`` to each participant, who keeps a modulus.

    Parameters
    ----------
    frame : DataFrame
        One row per judgement.
    magnitude, level, participant : str
        Columns; magnitudes and levels are positive.
    condition : str
        In which the magnitudes were given.

    Raises
    ------
    StudyError
        If a magnitude or level is not positive, a participant has fewer than three levels, or
        there are fewer than two participants.

    References
    ----------
    Stevens, S. S. (1957), Psychological Review 64, 153-181, doi:10.1037/h0046162.
    """
    from scipy import stats

    if not (frame[[magnitude, level]] > 0.0).all(axis=None):
        raise StudyError(f"{magnitude} and {level} must be positive in every row")
    exponents = []
    for person, judgements in frame.groupby(participant, sort=False):
        levels = judgements[level].nunique()
        if levels < _FEWEST_LEVELS:
            raise StudyError(f"an exponent needs three levels, got {levels} [participant {person}]")
        line = stats.linregress(np.log(judgements[level]), np.log(judgements[magnitude]))
        exponents.append(ParticipantExponent(str(person), float(line.slope), float(line.rvalue)))
    if len(exponents) < 2:
        raise StudyError(f"an interval over participants needs at least two, got {len(exponents)}")
    slopes = [law.exponent for law in exponents]
    mean = float(np.mean(slopes))
    reach = float(stats.t.ppf(0.975, len(slopes) - 1) * stats.sem(slopes))
    return PowerLaw(mean, mean - reach, mean + reach, tuple(exponents), condition)
