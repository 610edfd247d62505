"""Training by difficulty with `study run`: sittings over days, and what a person has learnt."""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from stepblocks.errors import StudyError
from stepblocks.files.atomic import lock_folder, replace_text, resolve_inside
from stepblocks.files.tables import format_csv
from stepblocks.study.columns import Row, group_rows_by_participant, read_number_or_nan
from stepblocks.study.conduct.clock import SteadyClock, format_timestamp
from stepblocks.study.design.read import SheetRow, read_design, read_sheet_rows
from stepblocks.study.design.sheet import make_blinded_row
from stepblocks.study.design.training import Staircase, TrainingTrial
from stepblocks.study.experiments.registry import EXPERIMENTS

TRIALS = 40  # of a sitting
_MOST_TRIALS = 10_000  # of a sitting
_FOLDER = "training"
_COLUMNS = (
    *("participant", "trial", "setting", "first_code", "second_code", "second_is_higher"),
    *("level", "right", "answered_utc", "reaction_s"),
)
_READ = ("participant", "trial", "first_code", "second_code", "second_is_higher", "answered_utc")
_DAY_DIGITS = 10  # of a date in ISO 8601
_SEARCHING = 4  # a share of 1 / 4 of a day's trials still looks for the level


@dataclass(frozen=True)
class TrainingDay:
    """What a participant reached in a day of training; it tells no block.

    Attributes
    ----------
    participant : str
        Who was trained.
    date : str
        Day in UTC, ISO 8601.
    trials, right : int
        Answered pairs, and how many rightly.
    right_low, right_high : float
        95 % interval of the share that is right (Wilson's) [1].
    level, levels : float, int
        Median difficulty after the first quarter of the day, of so many [1].
    difference : float
        Geometric mean of the differences of height after that quarter, over the standard [1]; of
        these differences three of four are told apart.
    reaction : float
        Median time of an answer [s]; not-a-number where none was taken.
    """

    participant: str
    date: str
    trials: int
    right: int
    right_low: float
    right_high: float
    level: float
    levels: int
    difference: float
    reaction: float

    def __repr__(self) -> str:
        return (
            f"<TrainingDay {self.date} of {self.participant}: {self.right} of {self.trials} right, "
            f"level {self.level:g} of {self.levels}>"
        )

    def describe(self) -> dict[str, str]:
        """Write the day as a row of progress.csv."""
        right_share = self.right / self.trials
        reaction = ""
        if not math.isnan(self.reaction):
            reaction = f"{self.reaction:.3f}"
        return {
            "participant": self.participant,
            "date_utc": self.date,
            "trials": str(self.trials),
            "right": str(self.right),
            "right_ratio": f"{right_share:.4f}",
            "right_low_95_ratio": f"{self.right_low:.4f}",
            "right_high_95_ratio": f"{self.right_high:.4f}",
            "level": f"{self.level:g}",
            "levels": str(self.levels),
            "difference_ratio": f"{self.difference:.4f}",
            "reaction_s": reaction,
        }


class _Answered(NamedTuple):
    """A pair that was answered, and whether rightly."""

    trial: TrainingTrial
    answer: Row
    right: bool


class Training:
    """The training of a participant: pairs of the difficulty of which three of four are right.

    Parameters
    ----------
    folder : Path
        Of the study.
    participant : str
        Who is trained.
    trials : int
        Of today's sitting; what was answered today counts.

    Attributes
    ----------
    path : Path
        Of the answers, of all days.
    feedback : str
        Whether the last answer was right.

    Raises
    ------
    StudyError
        If the design does not compare blocks with a standard, has no such participant, or the
        answers so far do not belong to it.
    """

    virtual = False
    reach = 0.0

    def __init__(self, folder: Path, participant: str, trials: int = TRIALS) -> None:
        if not 1 <= trials <= _MOST_TRIALS:
            raise StudyError(f"train must be from 1 to {_MOST_TRIALS} trials, got {trials}")
        self.folder = folder
        self.participant = participant
        planned = _list_planned_pairs(folder, participant)
        path = resolve_inside(folder / _FOLDER, f"participant-{participant}.csv")
        if path is None:
            raise StudyError(f"participant must be a plain name, got {participant!r}")
        self.path = path
        self.feedback = ""
        self._guard = threading.RLock()
        self._clock = SteadyClock()
        self._shown = self._clock.read_time()
        self._staircase = Staircase(planned)
        with ExitStack() as stack:
            stack.enter_context(lock_folder(path.with_suffix("")))
            self._answered = list(_replay_answers(self._staircase, _read_answers(path)))
            self._next = self._staircase.choose_next_pair()
            self._lock = stack.pop_all()
        today = format_timestamp(self._shown)[:_DAY_DIGITS]
        done = sum(_get_answer_day(answered.answer) == today for answered in self._answered)
        self._left = max(trials - done, 0)
        self._trials = trials

    @property
    def answered(self) -> int:
        """How many pairs were answered, on all days."""
        return len(self._answered)

    @property
    def now(self) -> Row | None:
        """The pair that is next, with all that it hides; None when the sitting is done."""
        if self._left:
            return self._next.row
        return None

    def state(self) -> dict[str, object]:
        """Return what a page may show: codes, and how hard it is, but no height."""
        state: dict[str, object] = {
            "participant": self.participant,
            "of": self._trials,
            "answers": list(EXPERIMENTS[self._next.row["experiment"]].answers),
            "virtual": False,
            "ratings": [],
            "done": self.now is None,
            "running": False,
            "practice": self._left,
            "training": f"level {self._next.level} of {self._staircase.level_count}",
            "feedback": self.feedback,
            "answered": self._trials - self._left,
        }
        if self.now is not None:
            shown = make_blinded_row(self.now)
            for name in ("trial", "setting", "first_code", "second_code"):
                if name in shown:
                    state[name] = shown[name]
        return state

    def answer(
        self, trial: str, texts: Mapping[str, str], reaction: float = math.nan, comment: str = ""
    ) -> None:
        """Write the answer to the next pair to the disk, and choose the pair after it.

        Parameters
        ----------
        trial : str
            Number of the pair, over all days.
        texts : mapping of str
            ``second_is_higher``: y or n.
        reaction : float
            Time of the answer [s]; by default since the pair was shown.
        comment : str
            Not kept.

        Raises
        ------
        StudyError
            If the pair is not the next, or the answer cannot be read.
        """
        with self._guard:
            row = self.now
            moment = self._clock.read_time()
            if row is None or trial != row["trial"]:
                raise StudyError(f"trial must be the one that is next, got {trial!r}")
            if math.isnan(reaction):
                reaction = moment - self._shown
            if not reaction >= 0.0:
                raise StudyError(f"reaction_s must not be negative, got {reaction:g}")
            answer = {
                **make_blinded_row(row),
                "second_is_higher": texts.get("second_is_higher", "").strip(),
                "answered_utc": format_timestamp(moment),
                "reaction_s": f"{reaction:.3f}",
            }
            shown = self._next
            right = self._staircase.update_with_answer(shown, answer)
            self._answered.append(_Answered(shown, answer, right))
            self._write_answers()
            self.feedback = "right" if right else "wrong"
            self._left -= 1
            self._next = self._staircase.choose_next_pair()
            self._shown = moment

    def _write_answers(self) -> None:
        """Write all answers."""
        rows = []
        for answered in self._answered:
            cells = {**answered.answer, "level": str(answered.trial.level)}
            cells["right"] = "y" if answered.right else "n"
            rows.append({name: cells.get(name, "") for name in _COLUMNS})
        replace_text(self.path, format_csv(rows, _COLUMNS))

    def begin(self) -> None:
        """Do nothing: blocks are real."""

    def move(self, x: float, held: bool) -> None:
        """Do nothing: blocks are real."""

    def report_probe_state(self) -> dict[str, object]:
        """Return a probe at rest."""
        return {"x": 0.0, "events": 0, "loudness": 0.0}

    def undo(self) -> None:
        """Refuse: who has read what was right cannot answer anew."""
        raise StudyError("an answer of training cannot be taken back: the page said what was right")

    def summarise(self) -> list[TrainingDay]:
        """Return what was reached on each day."""
        return list(
            _iterate_training_days(self.participant, self._answered, self._staircase.level_count)
        )

    def close(self) -> None:
        """Release the training, and write progress.csv of everybody."""
        self._lock.close()
        if self._answered:
            write_progress(self.folder)


def open_training(folder: str | Path, participant: str, trials: int = TRIALS) -> Training:
    """Open the training of a participant with the blocks of a design, where it was left.

    Pairs grow one level harder after a right answer and three easier after a wrong one, so that
    three of four are right (Kaernbach 1991, doi:10.3758/BF03214307); each answer is followed by
    what was right. Levels are the differences of height from the standard.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv of ``"adaptive"`` or ``"constant"``; answers go to
        ``training/participant-N.csv``, and what everybody reached to ``training/progress.csv``.
    participant : str
        Who is trained, as in the design.
    trials : int
        Of today (UTC); those that were answered today count.

    Returns
    -------
    Training
        To be asked for its `state`, answered, and closed.

    Raises
    ------
    StepblocksError
        If there is no such participant, no standard, or the training is open already.

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 30e-6, 40e-6], folder, seed=1, participants=1,
    ...                                  experiment="adaptive", standard="step-020", trials=8)
    >>> training = stepblocks.open_training(folder, "1", trials=10)
    >>> training.answer("1", {"second_is_higher": "y"})
    >>> training.feedback in ("right", "wrong")
    True
    >>> training.close()
    """
    return Training(Path(folder), participant, trials)


def read_training(folder: str | Path) -> list[TrainingDay]:
    """Read what each participant reached on each day of training.

    Parameters
    ----------
    folder : str or Path
        Of the study.

    Returns
    -------
    list of TrainingDay
        By participant as in the design, then by day; empty where nobody was trained.

    Raises
    ------
    StepblocksError
        If answers do not belong to the design.

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 30e-6, 40e-6], folder, seed=1, participants=1,
    ...                                  experiment="adaptive", standard="step-020", trials=8)
    >>> stepblocks.read_training(folder)
    []
    """
    folder = Path(folder)
    days = list[TrainingDay]()
    for participant, planned in group_rows_by_participant(
        read_design(folder / "design.csv")
    ).items():
        path = folder / _FOLDER / f"participant-{participant}.csv"
        answers = _read_answers(path)
        if answers:
            staircase = Staircase(planned)
            answered = list(_replay_answers(staircase, answers))
            days += _iterate_training_days(participant, answered, staircase.level_count)
    return days


def write_progress(folder: Path) -> None:
    """Write what everybody reached on each day to progress.csv, for other programs."""
    rows = [day.describe() for day in read_training(folder)]
    replace_text(folder / _FOLDER / "progress.csv", format_csv(rows))


def _list_planned_pairs(folder: Path, participant: str) -> list[Row]:
    """Return the rows of a participant of a design that compares blocks with a standard."""
    by_participant = group_rows_by_participant(read_design(folder / "design.csv"))
    if participant not in by_participant:
        people = ", ".join(by_participant)
        raise StudyError(f"participant must be one of {people}, got {participant!r}")
    planned = by_participant[participant]
    experiment = planned[0]["experiment"]
    if not EXPERIMENTS[experiment].paired:
        paired = [name for name, kind in EXPERIMENTS.items() if kind.paired]
        raise StudyError(f"train is an option of {', '.join(paired)}, not of {experiment}")
    return list(planned)


def _read_answers(path: Path) -> list[SheetRow]:
    """Read the answers of a training; none where there is no file."""
    if not path.exists():
        return []
    return read_sheet_rows(path, _READ, may_be_empty=True)


def _replay_answers(staircase: Staircase, answers: Sequence[SheetRow]) -> Iterator[_Answered]:
    """Yield the pairs that a staircase showed, with their answers.

    Raises
    ------
    StudyError
        If another pair was answered than was shown.
    """
    for answer in answers:
        shown = staircase.choose_next_pair()
        blinded = make_blinded_row(shown.row)
        for name in ("participant", "trial", "first_code", "second_code"):
            if answer.cells[name] != blinded[name]:
                raise StudyError(
                    f"{name} must be {blinded[name]} here, as the answers before lead to, got "
                    f"{answer.cells[name]} [{answer.place}]"
                )
        yield _Answered(shown, answer.cells, staircase.update_with_answer(shown, answer.cells))


def _get_answer_day(answer: Row) -> str:
    """Return the day on which an answer was given, in UTC."""
    return answer["answered_utc"][:_DAY_DIGITS]


def _iterate_training_days(
    participant: str, answered: Sequence[_Answered], level_count: int
) -> Iterator[TrainingDay]:
    """Yield what a participant reached on each day, at `level_count` difficulties."""
    import numpy as np
    from statsmodels.stats.proportion import proportion_confint

    by_day = dict[str, list[_Answered]]()
    for item in answered:
        by_day.setdefault(_get_answer_day(item.answer), []).append(item)
    for day, items in by_day.items():
        right = 0
        reactions = []
        for item in items:
            right += item.right
            seconds = read_number_or_nan(item.answer.get("reaction_s", ""))
            if not math.isnan(seconds):
                reactions.append(seconds)
        low, high = proportion_confint(right, len(items), method="wilson")
        levels_settled, differences = [], []
        for item in items[len(items) // _SEARCHING :]:
            levels_settled.append(item.trial.level)
            differences.append(item.trial.difference)
        reaction = math.nan
        if reactions:
            reaction = float(np.median(reactions))
        yield TrainingDay(
            participant=participant,
            date=day,
            trials=len(items),
            right=right,
            right_low=float(low),
            right_high=float(high),
            level=float(np.median(levels_settled)),
            levels=level_count,
            difference=math.expm1(float(np.mean(differences))),
            reaction=reaction,
        )
