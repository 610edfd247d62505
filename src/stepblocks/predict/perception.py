"""What a person compares when two rings are felt one after the other."""

import math
from collections.abc import Sequence

from stepblocks.predict.predictions import Model, Prediction

# Just noticeable difference of power [dB] at the fingertip, 250-350 Hz (Weber fraction 0.41 of
# energy, 0.19 of amplitude). It was not measured on a hand-held explorer: a median of 0.20 of
# amplitude stands in the abstract of "Vibrotactile difference thresholds: effects of vibration
# frequency, vibration magnitude, contact area, and body location" (thenar, 125 Hz, 10 dB over
# threshold, 12 subjects; up to 0.58 elsewhere). Craig (1972, Perception & Psychophysics 11, 150) is
# remembered, not checked, for 1.5 dB. The fraction rises towards threshold, which is ignored, and
# was not measured on a short ring felt through a tool: treat it as a factor of two.
LEVEL_DIFFERENCE = 1.5


def choose_energies(compared: Sequence[Prediction]) -> tuple[list[float], str]:
    """Choose the energies [J] that a person compares, by the formula or by the drag.

    Where one of them is felt by the drag, all are: a change of model between two blocks would be
    felt as a difference. An energy is NaN where nothing slips; the second value says which model
    counts.
    """
    if not any(prediction.differs for prediction in compared):
        energies = [prediction.release.vibration_energy for prediction in compared]
        return energies, Model.FORMULA.value
    energies = []
    for prediction in compared:
        if prediction.in_time is None:
            energies.append(math.nan)
        else:
            energies.append(prediction.in_time.energy)
    return energies, Model.DRAG.value
