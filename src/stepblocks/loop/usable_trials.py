"""Which trials of a table of features can be analysed, and why the others cannot."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.lawsearch.forward_model import Floats
from stepblocks.loop.columns import read_numeric_column

POSITIVE = ("height_um", "load_n", "speed_mm_s")  # columns that must hold positive numbers
CENSORED = "censored"  # status of a trial whose gauge was saturated
_KEPT = ("ok", CENSORED)
# factor by which no spring and no normal force differs from what is declared
_IMPOSSIBLE = 3.0
# figures by which a copy of a trial is recognised; the first two are peak force and energy
_FIGURES = [
    "peak_force_n",
    "vibration_energy_j",
    "sliding_friction",
    "spring_constant_n_per_m",
]
_FEWEST_FIGURES = 2  # by which a copy is recognised
# how the reason begins that measuring a session gives where forces contradict the row of a trial,
# and how it names a swap of labels that would mend it
_MISLABELLED = "mislabelled"
_SWAP = "swap = [[{trial},"


class ExcludedTrial(NamedTuple):
    """A trial, or a single value of it, that takes no part, and why."""

    trial: str
    reason: str

    @property
    def is_mislabelled(self) -> bool:
        """Whether its forces contradict its row."""
        return self.reason.startswith(_MISLABELLED)

    @property
    def is_first_of_exchanged_labels(self) -> bool:
        """Whether it is the first of two trials whose labels were exchanged."""
        return _SWAP.format(trial=self.trial) in self.reason


class TrialSelection:
    """Trials that can be analysed, and the others with the first reason that holds.

    Parameters
    ----------
    features : DataFrame
        Table of features with ``trial``, ``status`` and ``reason``.

    Attributes
    ----------
    usable : array of bool
        Shape (n,).
    excluded : list[ExcludedTrial]
    """

    def __init__(self, features: pd.DataFrame) -> None:
        self._trials = features[["trial"]]
        self.usable: NDArray[np.bool_] = np.ones(len(features), dtype=bool)
        self.excluded: list[ExcludedTrial] = []

    def leave_out(self, unusable: NDArray[np.bool_], reasons: str | pd.Series) -> None:
        """Leave out trials that are still in; one reason for all, or one for each trial."""
        rows = self.usable & unusable
        table = self._trials.assign(reason=reasons)[rows]
        for trial, reason in table.itertuples(index=False, name=None):
            self.excluded.append(ExcludedTrial(trial, reason))
        self.usable[rows] = False


def select_usable_trials(
    features: pd.DataFrame, radius_um: Floats, spring_constant: float
) -> TrialSelection:
    """Select the trials that can be analysed.

    Parameters
    ----------
    features : DataFrame
    radius_um : Floats
        Shape (n,), radius of each trial's tip [um].
    spring_constant : float
        Nominal, of the probe [N/m].
    """
    selection = TrialSelection(features)
    # what a saturated gauge or a locked tip still shows is data; a record that contradicts its row
    # is held apart
    reasons = features["reason"].where(features["reason"] != "", features["status"])
    selection.leave_out(~features["status"].isin(_KEPT).to_numpy(), reasons)
    for name in POSITIVE:
        numbers = read_numeric_column(features, name)
        positive = np.isfinite(numbers) & (numbers > 0.0)
        selection.leave_out(~positive, f"{name} must be a positive number")
    _leave_out_impossible(selection, features, spring_constant)
    too_high: NDArray[np.bool_] = np.greater_equal(
        read_numeric_column(features, "height_um"), radius_um
    )
    selection.leave_out(
        too_high, "the step is as high as the ball: equation (2) has no angle for it"
    )
    figures = np.stack([read_numeric_column(features, name) for name in _FIGURES], axis=1)
    known = np.isfinite(figures)
    released = np.asarray(known[:, :2].any(axis=1))
    selection.leave_out(~released, "neither a peak force nor a vibration energy was measured")
    _leave_out_copies(selection, features, figures)
    return selection


def _leave_out_impossible(
    selection: TrialSelection, features: pd.DataFrame, spring_constant: float
) -> None:
    """Leave out trials whose spring or normal force cannot be that of the declared bench."""
    declared = {
        "spring_constant_n_per_m": np.full(len(features), spring_constant),
        "normal_load_n": read_numeric_column(features, "load_n"),
    }
    for name, expected in declared.items():
        measured = read_numeric_column(features, name)
        too_small = measured * _IMPOSSIBLE < expected
        too_large = measured > _IMPOSSIBLE * expected
        selection.leave_out(
            too_small | too_large,
            f"{name} is impossible: over {_IMPOSSIBLE:g} times off what is declared",
        )


def _leave_out_copies(selection: TrialSelection, features: pd.DataFrame, figures: Floats) -> None:
    """Leave out trials whose forces are those of an earlier trial to the last digit.

    Such a trial is a copy, which would count twice.
    """
    compared = selection.usable & (np.isfinite(figures).sum(axis=1) >= _FEWEST_FIGURES)
    forces = pd.DataFrame(figures, index=features.index)[compared]
    by_forces = [forces[column] for column in forces]
    groups = features["trial"][compared].groupby(by_forces, dropna=False)
    first = groups.transform("first")
    copied = forces.duplicated().reindex(features.index, fill_value=False)
    reasons = ("the same forces as trial " + first).reindex(features.index)
    selection.leave_out(copied.to_numpy(), reasons)
