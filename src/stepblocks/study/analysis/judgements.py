"""Judgements of a study: answers put to their trials, checked, as one tidy table."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from stepblocks.errors import StepblocksError, StudyError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.table_rows import list_column_names
from stepblocks.files.tables import Table
from stepblocks.mistakes import format_mistakes
from stepblocks.study.analysis.people import describe_unusual_participants
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.columns import (
    ORDER,
    RATINGS,
    WHEN,
    PairOrder,
    Row,
    list_factor_columns,
    read_number_or_nan,
)
from stepblocks.study.design.read import SheetRow, TrialKey, index_by_trial, read_sheet_rows
from stepblocks.study.design.sheet import make_blinded_row
from stepblocks.study.experiments.kind import Experiment
from stepblocks.study.experiments.registry import EXPERIMENTS

STAMPS = ("shown_utc", "answered_utc", "reaction_s")  # that `study run` writes beside answers
_SHOWN = 20  # missing judgements that a note lists
_TRIALS_OF_SLOPE = 10.0  # over which a change with the order is stated
_FEW = 5  # participants that a message names

Values = dict[str, float | str]  # columns of the tidy table


class Judgement(NamedTuple):
    """A planned trial and its answer."""

    planned: Row
    answer: SheetRow


class Mistake(NamedTuple):
    """What is wrong with a row."""

    row: SheetRow
    text: str


@dataclass(frozen=True)
class Judgements:
    """A checked table of judgements.

    Attributes
    ----------
    experiment : str
        Its kind.
    frame : DataFrame
        One row per answered trial: participant, trial, condition, repetition, stimulus (texts),
        height [m]; and by experiment estimate and error [m], rating [1], higher (whether the
        comparison was called higher than the standard), standard [m], magnitude [1].
    missing : tuple of TrialKey
        Every missing answer of participants who stay in the table.
    left : tuple of str
        Participants without any answer in a condition of their design: not in the table.
    remarks : tuple of str
        On what the tables hold beside the judgements.
    """

    experiment: str
    frame: Table
    missing: tuple[TrialKey, ...]
    left: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    def list_notes(self) -> list[str]:
        """Describe what is missing, and how it was treated."""
        people = self.frame["participant"].nunique()
        lines = [f"{len(self.frame)} judgements of {people} participants."]
        if self.left:
            lines.append(
                "Left out entirely, for a condition without any answer: participant "
                f"{', '.join(self.left)}."
            )
        if self.missing:
            lines.append(self._describe_missing())
        lines += self.remarks
        lines += self._describe_lacking_conditions()
        value = EXPERIMENTS[self.experiment].value
        return lines + describe_unusual_participants(self.frame, value)

    def _describe_missing(self) -> str:
        """Name the missing judgements."""
        names = [f"{key.participant}/{key.trial}" for key in self.missing[:_SHOWN]]
        shown = ", ".join(names)
        ending = ""
        if len(self.missing) > _SHOWN:
            ending = " and more"
        return (
            f"{len(self.missing)} missing judgements (participant/trial {shown}{ending}); the "
            "models are fitted to the others, which is right if they are missing at random."
        )

    def _describe_lacking_conditions(self) -> Iterator[str]:
        """Name participants who lack a condition, unless each condition has its own group."""
        met = self.frame.groupby("participant", sort=False)["condition"].unique()
        if not met.map(len).max() > 1:
            return
        conditions = set(self.frame["condition"])
        for name, known in met.items():
            lacking = sorted(conditions - set(known))
            if lacking:
                yield f"Participant {name} has no judgement with {', '.join(lacking)}."

    def assign_groups(
        self, path: str | Path | None, layout: TableLayout = UNDECLARED
    ) -> "Judgements":
        """Assign a group to each participant, by a table of participants and groups.

        Raises
        ------
        StudyError
            If a participant has no group.
        """
        if path is None:
            return self
        group = {}
        for row in read_sheet_rows(Path(path), ("participant", "group"), layout=layout):
            group[row.cells["participant"]] = row.cells["group"]
        lacking = sorted(set(self.frame["participant"]) - set(group))
        if lacking:
            raise StudyError(
                "every participant must have a group, got none for "
                f"{', '.join(lacking[:_FEW])} [{path}]"
            )
        grouped = self.frame.assign(group=self.frame["participant"].map(group))
        return replace(self, frame=convert_between_factors_to_group(grouped))

    def analyse(
        self,
        margin: float = math.nan,
        primary: str = "",
        reference: str = "",
        covariate: str = "",
    ) -> StudyResult:
        """Analyse the study.

        Parameters
        ----------
        margin : float
            Conditions that differ by less are equivalent [m].
        primary, reference : str
            Primary outcome, and the condition that others are compared with.
        covariate : str
            ``"order"`` for the order of trials in the mixed models; none by default.

        Raises
        ------
        StudyError
            If the primary outcome or the reference is unknown, or the judgements cannot carry the
            analysis.
        """
        known = sorted(self.frame["condition"].unique())
        if reference and reference not in known:
            raise StudyError(f"reference must be one of {', '.join(known)}, got {reference!r}")
        notes = tuple(self.list_notes())
        frame = self.frame
        if covariate:
            frame = frame.assign(**{ORDER: _read_trial_numbers(frame) / _TRIALS_OF_SLOPE})
        analysis = EXPERIMENTS[self.experiment].analyse(frame, margin)
        tests = [finding.name for finding in analysis.summarise_findings()]
        if primary and primary not in tests:
            raise StudyError(f"primary must be one of {'; '.join(tests)}, got {primary!r}")
        return StudyResult.from_analysis(analysis, self.experiment, notes, primary, reference)


def _read_trial_numbers(frame: Table) -> pd.Series:
    """Read the trial column as numbers.

    Raises
    ------
    StudyError
        If a trial has another name than a number.
    """
    numbers = pd.to_numeric(frame["trial"], errors="coerce")
    if numbers.isna().any():
        name = frame["trial"][numbers.isna()].iloc[0]
        raise StudyError(f"trial must be a number where order is a covariate, got {name!r}")
    return numbers.astype(float)


def join_answers(
    design: Sequence[Row], answers: Sequence[SheetRow], ratings: tuple[int, int] = RATINGS
) -> Judgements:
    """Assign the answers to their trials, and check them.

    Parameters
    ----------
    design : sequence of mapping
        Rows of design.csv.
    answers : sequence of SheetRow
        Rows of filled-in run sheets.
    ratings : tuple of int
        Lowest and highest rating.

    Raises
    ------
    StudyError
        If an answer is of no trial of the design, stands twice, or cannot be read; all such
        mistakes are listed.
    """
    planned = {TrialKey(row["participant"], row["trial"]): row for row in design}
    pairs = list[Judgement]()
    mistakes = list[Mistake]()
    for key, answer in index_by_trial(answers).items():
        try:
            _check_answer_matches_trial(planned.get(key), answer)
        except StepblocksError as error:
            mistakes.append(Mistake(answer, str(error)))
        else:
            pairs.append(Judgement(planned[key], answer))
    experiment = design[0]["experiment"]
    asked = planned
    if EXPERIMENTS[experiment].adaptive:  # not all trials are run
        asked = {}
    return make_judgements(experiment, pairs, ratings, asked, mistakes)


def _check_answer_matches_trial(planned: Row | None, answer: SheetRow) -> None:
    """Reject an answer of no trial, or to another block or condition than was planned."""
    if planned is None:
        raise StudyError(
            f"participant and trial must be in the design, got {answer.key.participant!r} and "
            f"{answer.key.trial!r}"
        )
    shown = make_blinded_row(planned)
    for name in ("first_code", "second_code", "code", "condition"):
        if name in shown and answer.cells[name] != shown[name]:
            raise StudyError(
                f"{name} must be {shown[name]!r} in this trial, as planned, got "
                f"{answer.cells[name]!r}"
            )


def make_judgements(
    experiment: str,
    pairs: Sequence[Judgement],
    ratings: tuple[int, int],
    expected_trials: Mapping[TrialKey, Row],
    mistakes: Sequence[Mistake] = (),
) -> Judgements:
    """Make the judgements of a study from trials with their answers, or refuse all mistakes.

    Parameters
    ----------
    experiment : str
        Its kind.
    pairs : sequence of Judgement
        Planned trials with their answers.
    ratings : tuple of int
        Lowest and highest rating.
    expected_trials : mapping
        Planned trials of which a missing answer counts as missing; empty where only what was
        answered was asked.
    mistakes : sequence of Mistake
        Already found.

    Raises
    ------
    StudyError
        If there are mistakes, or a condition or block has no answer at all.
    """
    kind = EXPERIMENTS[experiment]
    planned = expected_trials or _index_planned_trials(pairs)
    answered = _read_all_answers(kind, pairs, ratings, mistakes)
    left = _find_incomplete_participants(planned, answered)
    columns = _list_kept_columns(planned)
    missing = list[TrialKey]()
    rows = list[Values]()
    for key, row in planned.items():
        if key.participant in left:
            continue
        if key not in answered:
            missing.append(key)
            continue
        trial = {name: row[name] for name in columns}
        height = read_number_or_nan(row["height_um"]) / 1e6
        rows.append({**trial, "height": height, **answered[key]})
    frame = pd.DataFrame(rows)
    if frame.empty:
        raise StudyError("at least one participant must have answered in every condition, got none")
    _refuse_unanswered_cells(planned, frame)
    frame = convert_between_factors_to_group(frame)
    return Judgements(experiment, frame, tuple(missing), tuple(left))


def _index_planned_trials(pairs: Sequence[Judgement]) -> dict[TrialKey, Row]:
    """Return the planned trials of judgements; refuse one that stands twice."""
    trials = []
    for pair in pairs:
        trials.append(SheetRow(pair.planned, pair.answer.file, pair.answer.line))
    return {key: row.cells for key, row in index_by_trial(trials).items()}


def _read_all_answers(
    kind: Experiment,
    pairs: Sequence[Judgement],
    ratings: tuple[int, int],
    mistakes: Sequence[Mistake],
) -> dict[TrialKey, Values]:
    """Read all complete answers; refuse them with all mistakes, those already found among them."""
    answered = dict[TrialKey, Values]()
    found = list(mistakes)
    for pair in pairs:
        try:
            values = _read_answer_values(kind, pair, ratings)
        except StepblocksError as error:
            found.append(Mistake(pair.answer, str(error)))
            continue
        if values:
            key = TrialKey(pair.planned["participant"], pair.planned["trial"])
            answered[key] = values
    if found:
        raise StudyError(_format_mistakes(found))
    return answered


def _read_answer_values(kind: Experiment, pair: Judgement, ratings: tuple[int, int]) -> Values:
    """Read an answer and its stamps; nothing where it is not complete."""
    cells = pair.answer.cells
    if not all(cells[name] for name in kind.answers):
        return {}
    values: Values = {**kind.read(pair.planned, cells, ratings)}
    for name in STAMPS:
        if not cells.get(name):
            continue
        if name == "reaction_s":
            values[name] = read_number_or_nan(cells[name])
        else:
            values[name] = cells[name]
    return values


def _format_mistakes(mistakes: Sequence[Mistake]) -> str:
    """Write all mistakes as a text, with the file of each where there are several."""
    files = list(dict.fromkeys(mistake.row.file for mistake in mistakes))
    placed = []
    for row, text in mistakes:
        place = row.place
        if len(files) == 1:
            place = f"{row.unit} {row.line}"
        placed.append((place, text))
    return format_mistakes(placed, ", ".join(files))


def _find_incomplete_participants(
    planned: Mapping[TrialKey, Row], answered: Mapping[TrialKey, Values]
) -> list[str]:
    """Return the participants without any answer in a condition of their design.

    A condition that a participant has no row of counts as one without an answer, where others who
    share conditions with the participant met it: a trial that was never run may have an empty row
    or none.
    """
    asked = dict[str, set[str]]()
    met = dict[str, set[str]]()
    for key, row in planned.items():
        asked.setdefault(key.participant, set()).add(row["condition"])
        if key in answered:
            met.setdefault(key.participant, set()).add(row["condition"])
    left = []
    for participant, conditions in _find_expected_conditions(asked).items():
        if not conditions <= met.get(participant, set()):
            left.append(participant)
    return left


def _find_expected_conditions(asked: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return the conditions that each participant should have met.

    They are all that participants who share a condition met, directly or by others between them:
    groups that meet conditions of their own stay apart. Where fewer than half of such participants
    met all of them, nobody was meant to, and what each was asked counts.
    """
    families: list[tuple[list[str], set[str]]] = []
    for participant, conditions in asked.items():
        people, met = [participant], set(conditions)
        apart = []
        for family in families:
            if family[1] & met:
                people, met = [*family[0], *people], met | family[1]
            else:
                apart.append(family)
        families = [*apart, (people, met)]
    expected = dict[str, set[str]]()
    for people, met in families:
        complete = [participant for participant in people if asked[participant] == met]
        is_incomplete_design = 2 * len(complete) < len(people)
        for participant in people:
            expected[participant] = met
            if is_incomplete_design:
                expected[participant] = asked[participant]
    return {participant: expected[participant] for participant in asked}


def _list_kept_columns(planned: Mapping[TrialKey, Row]) -> list[str]:
    """Return the columns of planned trials that the tidy table keeps."""
    known = next(iter(planned.values()), {})
    columns = [name for name in (*WHEN, "stimulus", "group") if name in known]
    columns += list_factor_columns(known)
    return columns


def _refuse_unanswered_cells(planned: Mapping[TrialKey, Row], frame: Table) -> None:
    """Reject judgements without any answer to a block in a condition."""
    cells = {(row["condition"], row["stimulus"]) for row in planned.values()}
    judged = set(zip(frame["condition"], frame["stimulus"], strict=True))
    for condition, stimulus in sorted(cells - judged):
        raise StudyError(
            f"every block must be judged in every condition, got no answer for {stimulus} with "
            f"{condition}"
        )


def convert_between_factors_to_group(frame: Table) -> Table:
    """Drop factors of one level; those that vary between participants only are their group.

    Where nothing else varies, a group is the condition of its participants.
    """
    names = list_factor_columns(list_column_names(frame))
    by_participant = frame.groupby("participant")
    between, dropped = [], []
    for name in names:
        most_levels = by_participant[name].nunique().max()
        if most_levels == 1 and frame[name].nunique() > 1:
            between.append(name)
        if most_levels == 1 or frame[name].equals(frame["condition"]):
            dropped.append(name)
    if between and "group" not in frame:
        frame = frame.assign(group=frame[between].agg("/".join, axis=1))
    frame = frame.drop(columns=dropped)
    if "group" not in frame or frame["condition"].nunique() != 1:
        return frame
    # the orders of a pair are no conditions that anybody compares
    if frame["condition"].iloc[0] in PairOrder.list_names():
        return frame
    return frame.assign(condition=frame["group"]).drop(columns="group")
