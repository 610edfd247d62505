"""What a person perceives of a ring: its level over threshold, and whether two differ."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER
from stepblocks.contact.rod import compute_finger_share, compute_modes
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import Prediction

if TYPE_CHECKING:
    import pandas as pd

# heights at which the drag is asked from the lowest to the highest block: 2 % of the energy between
# two
# columns of a table of neighbours, which may have no rows
_NEIGHBOURS = ["set", "tip_radius_um", "normal_load_n", "friction", "lower", "higher"]
_NEIGHBOURS += [
    "lower_level_db",
    "higher_level_db",
    "just_noticeable_differences",
    "correct",
    "felt_by",
]


@dataclass(frozen=True)
class Observer:
    """A person, as far as vibration of 250-350 Hz at the fingertip goes."""

    threshold_power: float  # that is just detected [W]
    ring_duration: float  # over which the energy of a ring is spent [s]
    level_difference: float  # just noticeable [dB of power]; 75 % correct in two-alternative choice
    masking: float  # share of a masking vibration's power that adds to the threshold [1]
    reach: float = 1.0  # share of the ring's energy at the tip that arrives at the finger [1]

    def __post_init__(self) -> None:
        for name in ("threshold_power", "ring_duration", "level_difference", "reach"):
            require_positive(name, getattr(self, name))
        require_not_negative("masking", self.masking)


# None of these was measured on a hand-held explorer but the threshold. Threshold and duration: the
# paper. 1.5 dB (Weber fraction 0.41 of energy, 0.19 of amplitude): a median of 0.20 of amplitude
# stands in the abstract of "Vibrotactile difference thresholds: effects of vibration frequency,
# vibration magnitude, contact area, and body location" (thenar, 125 Hz, 10 dB over threshold, 12
# subjects; up to 0.58 elsewhere). Craig (1972, Perception & Psychophysics 11, 150) is remembered,
# not checked, for 1.5 dB. The fraction rises towards threshold, which is ignored, and was not
# measured on a short ring felt through a tool: treat it as a factor of two. Masking: a signal must
# exceed a masker of the same channel by the Weber fraction; an assumption, not a measurement
PAPER_OBSERVER = Observer(
    PAPER.tool.detection_threshold, PAPER.tool.ring_duration, level_difference=1.5, masking=0.41
)


def compute_sensation_level(
    energy: float, observer: Observer = PAPER_OBSERVER, masker_power: float = 0.0
) -> float:
    """Compute the level of a ring over its threshold [dB]."""
    require_positive("energy", energy, "J")
    require_not_negative("masker_power", masker_power, "W")
    threshold = observer.threshold_power + observer.masking * masker_power
    return 10.0 * math.log10(energy * observer.reach / observer.ring_duration / threshold)


def compute_discriminability(
    first: float, second: float, observer: Observer = PAPER_OBSERVER
) -> tuple[float, float]:
    """Compute how well two rings can be told apart.

    Returns the number n of just noticeable differences, of 75 % correct each, and the probability
    ``Phi(n z(0.75))`` of a correct judgement.
    """
    from scipy.stats import norm

    levels = compute_sensation_level(first, observer), compute_sensation_level(second, observer)
    steps = abs(levels[0] - levels[1]) / observer.level_difference
    return steps, float(norm.cdf(steps * norm.ppf(0.75)))


def choose_energies(compared: Sequence[Prediction]) -> tuple[list[float], str]:
    """Choose the energies [J] that a person compares, by the formula or by the drag.

    An energy is NaN where nothing slips; the second value says which of both counts.
    """
    # by the drag where one of them differs: a change of model between two blocks would be felt as a
    # difference
    if any(one.differs for one in compared):
        return [math.nan if one.in_time is None else one.in_time.energy for one in compared], "drag"
    return [one.release.vibration_energy for one in compared], "formula"


def make_observer(stimuli: StimulusSet) -> Observer:
    """Return the observer of a set: its threshold and duration, at the finger of its probe."""
    tool, probe = stimuli.prediction.tool, stimuli.probe
    person = replace(
        PAPER_OBSERVER, threshold_power=tool.detection_threshold, ring_duration=tool.ring_duration
    )
    if probe is None:
        return person
    share = compute_finger_share(
        probe.rod(), probe.stiffness.value, compute_modes(probe.rod()), duration=tool.ring_duration
    )
    return replace(person, reach=share / tool.conversion)


def compare_neighbours(stimuli: StimulusSet, predictions: Iterable[Prediction]) -> pd.DataFrame:
    """Tabulate how well each block differs from the next higher one in each condition."""
    import pandas as pd

    blocks, observer = {block.id for block in stimuli.step_block}, make_observer(stimuli)
    felt = [p for p in predictions if p.stimulus in blocks and p.release.status is Status.RELEASES]

    def condition(p: Prediction) -> tuple[float, float, float]:
        return p.point.ball_radius, p.point.friction, p.point.normal_load

    rows = []
    felt.sort(key=lambda p: (*condition(p), p.face.far_side))
    for (tip, friction, load), group in groupby(felt, condition):
        compared = list(group)
        energies, by = choose_energies(compared)
        ringing = [
            (one.stimulus, energy)
            for one, energy in zip(compared, energies, strict=True)
            if energy > 0.0
        ]
        for (lower, low), (higher, high) in pairwise(ringing):
            levels = (compute_sensation_level(energy, observer) for energy in (low, high))
            told = compute_discriminability(low, high, observer)
            rows.append(
                (stimuli.name, tip * 1e6, load, friction, lower, higher, *levels, *told, by)
            )
    return pd.DataFrame(rows, columns=_NEIGHBOURS)
