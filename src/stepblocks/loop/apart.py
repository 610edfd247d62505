"""What a trial that went wrong looks like, by its errors beside the model."""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from stepblocks.lawsearch.findings import Explanation
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.loop.channels import ENERGY, FRICTION, JUDGED, PEAK_FORCE

# what trials scatter by, of the logarithm of the peak force and of friction; of the energy, which
# goes with the square of the force, twice as much
_SCATTER = 0.06
_ENERGY_SCATTER = 2.0 * _SCATTER
# share of the error of the energy within which it follows from the error of the peak force
_ENERGY_TOLERANCE = 0.35
_CAUGHT = -0.3  # error of ln E_v from which energy is missing though the peak force is right


class TrialFault(Enum):
    """What may have gone wrong with a trial."""

    RELEASED_EARLY = "let go early, at {percent:.0f} % of the peak force"
    RELEASED_EARLY_OR_WRONG_BLOCK = (
        "let go early, at {percent:.0f} % of the peak force, or the block {twin}"
    )
    WRONG_BLOCK = "the block {twin} instead of {declared}"
    CAUGHT_AGAIN = "caught again: {percent:.0f} % of the energy of its peak force"
    FRICTION_DIFFERS = "friction differs by {difference:+.2g}"
    UNKNOWN = "unlike all other trials"

    def describe(self, **figures: object) -> str:
        """Say what the trial looks like, with the figures that the fault names."""
        return self.value.format(**figures)


@dataclass(frozen=True)
class TrialError:
    """Measured less predicted values of one trial.

    Attributes
    ----------
    energy : float
        Of the logarithm of the vibration energy.
    force : float
        Of the logarithm of the peak force.
    friction : float
    """

    energy: float
    force: float
    friction: float


def describe_trial_fault(explanation: Explanation, measured_channels: Floats, row: int) -> str:
    """Say what one trial looks like.

    Parameters
    ----------
    explanation : Explanation
        With the fit beside which the trial errs.
    measured_channels : array of shape (n, 7)
        Channels as measured, those of trials held apart included.
    row : int
        Of the trial.
    """
    difference = measured_channels[row] - explanation.extended.predicted[row]
    error = TrialError(
        energy=float(difference[ENERGY]),
        force=float(difference[PEAK_FORCE]),
        friction=float(difference[FRICTION]),
    )
    twin = _find_block_with_same_forces(explanation, measured_channels, row)
    energy_follows_force = abs(error.energy - 2.0 * error.force) < _ENERGY_TOLERANCE * abs(
        error.energy
    )
    if error.force < -_SCATTER and energy_follows_force:
        percent = 100.0 * math.exp(error.force)
        if twin is not None:
            return TrialFault.RELEASED_EARLY_OR_WRONG_BLOCK.describe(percent=percent, twin=twin)
        return TrialFault.RELEASED_EARLY.describe(percent=percent)
    if twin is not None:
        declared = explanation.problem.trials.block[row]
        return TrialFault.WRONG_BLOCK.describe(twin=twin, declared=declared)
    if error.energy < _CAUGHT and abs(error.force) < _SCATTER:
        return TrialFault.CAUGHT_AGAIN.describe(percent=100.0 * math.exp(error.energy))
    if abs(error.friction) > _SCATTER:
        return TrialFault.FRICTION_DIFFERS.describe(difference=error.friction)
    return TrialFault.UNKNOWN.describe()


def _find_block_with_same_forces(
    explanation: Explanation, measured_channels: Floats, row: int
) -> str | None:
    """Find another block that is predicted to show what a trial showed, at its load and speed."""
    trials = explanation.problem.trials
    distance = np.abs(explanation.extended.predicted[:, JUDGED] - measured_channels[row, JUDGED])
    same_forces = (distance < (_ENERGY_SCATTER, _SCATTER)).all(axis=1)
    alike = same_forces & (trials.block != trials.block[row])
    for name in ("load_n", "speed_mm_s"):
        alike &= trials.covariates[name] == trials.covariates[name][row]
    if not alike.any():
        return None
    return str(trials.block[alike][0])
