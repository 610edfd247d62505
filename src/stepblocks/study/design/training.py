"""Training by difficulty: pairs grow harder while a participant is right."""

# One level harder after a right answer, three easier after a wrong one: three of four answers are
# right then. Kaernbach, C. (1991), Perception & Psychophysics 49, 227-229,
# doi:10.3758/BF03214307. A training is played again from its answers alone.

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study.columns import RATINGS, Row, format_setting_name, read_number_or_nan
from stepblocks.study.experiments.comparisons import read_comparison

_HARDER = 1  # levels after a right answer
_EASIER = 3  # levels after a wrong one
_FEWEST_LEVELS = 2


@dataclass(frozen=True)
class TrainingTrial:
    """A pair that is felt for training.

    Attributes
    ----------
    row : mapping of str
        The trial of the design whose pair it is, with the codes of practice.
    level : int
        Its difficulty, from 1.
    difference : float
        |ln(height / standard)| [1].
    """

    row: Row
    level: int
    difference: float


class Staircase:
    """The difficulty of one participant's pairs, in every setting of its own.

    Parameters
    ----------
    planned : sequence of mapping
        Rows of design.csv of the participant, of comparisons with a standard.

    Raises
    ------
    StudyError
        If fewer than two differences of height can be trained.
    """

    def __init__(self, planned: Sequence[Row]) -> None:
        self._pairs = dict[tuple[str, int], list[Row]]()
        differences = sorted(
            {_compute_log_height_difference(row) for row in planned} - {0.0}, reverse=True
        )
        if len(differences) < _FEWEST_LEVELS:
            raise StudyError(
                f"training needs at least {_FEWEST_LEVELS} differences of height from the "
                f"standard, got {len(differences)}"
            )
        self._differences = differences
        for row in planned:
            difference = _compute_log_height_difference(row)
            if difference:
                key = (format_setting_name(row), differences.index(difference))
                self._pairs.setdefault(key, []).append(row)
        self._rungs = dict.fromkeys((format_setting_name(row) for row in planned), 0)
        self._counts = dict.fromkeys(self._rungs, 0)

    @property
    def level_count(self) -> int:
        """Number of difficulties."""
        return len(self._differences)

    def choose_next_pair(self) -> TrainingTrial:
        """Choose the next pair: settings take turns; chance, the same each time, picks a pair."""
        setting = min(self._counts, key=lambda name: self._counts[name])
        rung = self._rungs[setting]
        pairs = self._pairs[setting, rung]
        number = sum(self._counts.values())
        person = [*pairs[0]["participant"].encode()]
        row = pairs[int(np.random.default_rng([*person, number]).integers(len(pairs)))]
        # the codes of the trials must not be learnt from what training says of them
        shown = {"trial": str(number + 1)}
        if row.get("practice_code"):
            shown["code"] = row["practice_code"]
            shown["standard_code"] = row["practice_standard_code"]
        return TrainingTrial({**row, **shown}, rung + 1, self._differences[rung])

    def update_with_answer(self, trial: TrainingTrial, answer: Row) -> bool:
        """Take an answer to the next pair, and return whether it was right."""
        right = is_answer_right(trial.row, answer)
        setting = format_setting_name(trial.row)
        step = -_EASIER
        if right:
            step = _HARDER
        self._rungs[setting] = min(max(self._rungs[setting] + step, 0), self.level_count - 1)
        self._counts[setting] += 1
        return right


def is_answer_right(row: Row, answer: Row) -> bool:
    """Return whether an answer to a pair is right."""
    called_higher = bool(read_comparison(row, answer, RATINGS)["higher"])
    is_higher = read_number_or_nan(row["height_um"]) > read_number_or_nan(row["standard_height_um"])
    return called_higher == is_higher


def _compute_log_height_difference(row: Row) -> float:
    """Return |ln(height / standard)| of a pair, rounded so that equal ratios are one level."""
    ratio = read_number_or_nan(row["height_um"]) / read_number_or_nan(row["standard_height_um"])
    return round(abs(math.log(ratio)), 6)
