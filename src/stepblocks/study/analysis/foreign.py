"""Judgements of studies that were not designed here, from their tables or a BIDS dataset."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from stepblocks.errors import StudyError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.study.analysis.judgements import Judgement, Judgements, make_judgements
from stepblocks.study.columns import (
    FACTOR,
    MICROMETRES,
    RATINGS,
    NamedColumns,
    Row,
    format_setting_name,
    list_factor_columns,
    read_number_or_nan,
)
from stepblocks.study.design.read import SheetRow, find_answer_tables, read_sheet_rows
from stepblocks.study.experiments.registry import ALIASES, EXPERIMENTS
from stepblocks.study.programs.records import AnswerSearch

DESCRIPTIONS = {
    "participant": "participant",
    "trial": "number of the trial in the participant's session",
    "condition": "probe, vibration, or which block of a pair came first",
    "repetition": "set of blocks within the condition",
    "stimulus": "identity of the block",
    "height_um": "height of its step, micrometres",
    "standard_height_um": "height of the block that it was compared with, micrometres",
    "estimate_um": "height that the participant estimated, micrometres",
    "realism_rating": "rating of realism",
    "second_is_higher": "whether the second block of the pair was called higher, y or n",
    "magnitude_ratio": "number given to the felt magnitude",
    "group": "group of the participant",
    "shown_utc": "when the trial was shown, UTC",
    "answered_utc": "when it was answered, UTC",
    "reaction_s": "time from the question to the answer, seconds",
}
PROBE = "probe"  # the factor that has a column of its own name
_LOWEST, _HIGHEST = 0.1, 5000.0  # of the steps of blocks; beyond, it is another unit [um]
_MOST_LEVELS = 12  # of a column that splits the judgements
_FEWEST_COPIED = 6  # rows of a participant of which the second half may be a copy


def read_foreign_judgements(
    tables: Sequence[str | Path],
    columns: Mapping[str, str],
    experiment: str,
    ratings: tuple[int, int] = RATINGS,
    wide: str = "",
    layout: TableLayout = UNDECLARED,
) -> Judgements:
    """Read judgements from tables or a dataset of a study that was not designed here.

    What is not there is numbered (trial, repetition) or found by the height (stimulus). Records of
    PsychoPy, jsPsych, OpenSesame, Qualtrics and Gorilla are recognised by their columns.

    Parameters
    ----------
    tables : sequence of str or Path
        Files, or folders of them.
    columns : mapping of str
        Their names for ours, as in `analyse_study`.
    experiment : str
        Kind of the judgements.
    ratings : tuple of int
        Lowest and highest rating.
    wide : str
        How columns of trials are called, of tables with a row for each participant.
    layout : TableLayout
        What is declared of the tables.

    Raises
    ------
    StudyError
        If a column is unknown or missing, rows stand twice, or an answer cannot be read.
    """
    experiment = ALIASES.get(experiment, experiment)
    if experiment not in EXPERIMENTS:
        raise StudyError(f"experiment must be one of {', '.join(EXPERIMENTS)}, got {experiment!r}")
    for name in columns:
        _check_column_name(name)
    names = NamedColumns(columns)
    participant = names.get_table_name("participant")
    called = (participant, names.get_table_name("condition"))
    search = AnswerSearch(EXPERIMENTS[experiment].answers, names)
    rows = list[SheetRow]()
    for path in find_answer_tables(tables):
        rows += read_sheet_rows(
            path,
            [participant],
            name_columns=called,
            search=search,
            wide_pattern=wide,
            layout=layout,
        )
    _refuse_copied_rows(rows, {names.get_table_name("trial"), "repetition", "time"})
    _refuse_copied_tables(rows, participant)
    translated = [_translate_to_our_columns(row, names) for row in rows]
    _refuse_partial_columns(translated)
    crossed = _cross_condition_with_factors(translated, names, experiment)
    pairs = [Judgement(row.cells, row) for row in _iterate_numbered_rows(crossed, experiment)]
    judgements = make_judgements(experiment, pairs, ratings, {})
    return replace(judgements, remarks=tuple(_describe_unused_columns(rows, names)))


def _check_column_name(column: str) -> None:
    """Reject a name of a column that no kind of judgements has."""
    if column == PROBE or column.startswith(FACTOR):
        return
    if re.sub("_(mm|m)$", "_um", column) not in DESCRIPTIONS:
        known = ", ".join((*DESCRIPTIONS, PROBE, f"{FACTOR}..."))
        raise StudyError(f"columns must be named for {known}, got {column!r}")


def _iterate_numbered_rows(rows: Sequence[SheetRow], experiment: str) -> Iterator[SheetRow]:
    """Yield translated rows with the trial, repetition and block of each."""
    trials = Counter[str]()
    repetitions = Counter[tuple[str, str, str]]()
    for row in rows:
        cells = {"condition": EXPERIMENTS[experiment].default_condition, **row.cells}
        _check_foreign_row(cells, row.place, experiment)
        cells.setdefault("stimulus", f"step-{read_number_or_nan(cells['height_um']):03.6g}")
        trials[cells["participant"]] += 1
        setting = format_setting_name(cells)
        cell = (cells["participant"], f"{cells['condition']} {setting}", cells["stimulus"])
        repetitions[cell] += 1
        numbered = {
            "standard_height_um": cells["height_um"],
            "trial": str(trials[cells["participant"]]),
            "repetition": str(repetitions[cell]),
            **cells,
        }
        yield SheetRow(numbered, row.file, row.line)


def _translate_to_our_columns(row: SheetRow, names: NamedColumns) -> SheetRow:
    """Return a foreign row in our columns, declared factors last."""
    cells = dict[str, str]()
    for column in DESCRIPTIONS:
        text = names.read_cell(row.cells, column)
        if text is not None:
            cells[column] = text
    cells |= _read_factor_levels(row.cells, names)
    return SheetRow(cells, row.file, row.line)


def _read_factor_levels(row: Row, names: NamedColumns) -> dict[str, str]:
    """Read the levels of declared factors: of columns named so, and of those that are mapped."""
    levels = {name: row[name] for name in list_factor_columns(row)}
    taken = set(names.named.values())
    if PROBE in row and PROBE not in taken:
        levels[FACTOR + PROBE] = row[PROBE]
    for name, column in names.named.items():
        if column not in row:
            continue
        if name == PROBE:
            levels[FACTOR + PROBE] = row[column]
        elif name.startswith(FACTOR):
            levels[name] = row[column]
    return levels


def _refuse_partial_columns(rows: Sequence[SheetRow]) -> None:
    """Reject tables of which only some have a column of groups, factors or conditions."""
    shared = dict[str, SheetRow]()
    for row in rows:
        for name in row.cells:
            if name in ("group", "condition", "stimulus") or name.startswith(FACTOR):
                shared.setdefault(name, row)
    for row in rows:
        for name, first in shared.items():
            if name not in row.cells:
                raise StudyError(
                    f"{name} must be a column of every table, as of {first.file}, got none "
                    f"[{row.place}]"
                )


def _cross_condition_with_factors(
    rows: Sequence[SheetRow], names: NamedColumns, experiment: str
) -> Sequence[SheetRow]:
    """Cross the condition with every factor within participants that it does not hold.

    The condition becomes a declared factor of its own, called as their column. Without a column of
    conditions they are the crossed levels of the factors. Of comparisons the condition is the order
    of a pair, and every factor is a setting anyway.
    """
    if EXPERIMENTS[experiment].paired or not rows:
        return rows
    within = _list_factors_within_participants(rows)
    if not within:
        return rows
    if "condition" not in rows[0].cells:
        return [_join_factors_to_condition(row, within) for row in rows]
    beside = [name for name in within if not _is_fixed_by_condition(rows, name)]
    if not beside:
        return rows
    own = FACTOR + names.get_table_name("condition").removeprefix(FACTOR)
    if own not in within:
        rows = [_copy_condition_to_factor(row, own) for row in rows]
    return [_join_factors_to_condition(row, ["condition", *beside]) for row in rows]


def _copy_condition_to_factor(row: SheetRow, factor: str) -> SheetRow:
    """Give a row its condition as a factor, too."""
    return SheetRow({**row.cells, factor: row.cells["condition"]}, row.file, row.line)


def _join_factors_to_condition(row: SheetRow, factors: Sequence[str]) -> SheetRow:
    """Give a row the crossed levels of some factors as its condition."""
    condition = "/".join(row.cells[name] for name in factors)
    return SheetRow({**row.cells, "condition": condition}, row.file, row.line)


def _list_factors_within_participants(rows: Sequence[SheetRow]) -> list[str]:
    """List the factors of which some participant meets several levels."""
    return [
        name
        for name in list_factor_columns(rows[0].cells)
        if _varies_within_participant(rows, name)
    ]


def _varies_within_participant(rows: Sequence[SheetRow], factor: str) -> bool:
    """Return whether a participant meets several levels of a factor."""
    levels = dict[str, set[str]]()
    for row in rows:
        levels.setdefault(row.cells.get("participant", ""), set()).add(row.cells[factor])
    return any(len(met) > 1 for met in levels.values())


def _is_fixed_by_condition(rows: Sequence[SheetRow], factor: str) -> bool:
    """Return whether the level of a factor follows from the condition in all rows."""
    levels = dict[str, set[str]]()
    for row in rows:
        levels.setdefault(row.cells["condition"], set()).add(row.cells[factor])
    return all(len(met) == 1 for met in levels.values())


def _describe_unused_columns(rows: Sequence[SheetRow], names: NamedColumns) -> Iterator[str]:
    """Name columns that split the judgements and are in no model."""
    used = {PROBE, *names.named.values()}
    for name in DESCRIPTIONS:
        used.add(names.get_table_name(name))
        stem = name.removesuffix("_um")
        for unit in MICROMETRES:
            used.add(names.get_table_name(f"{stem}_{unit}"))
    levels = dict[str, dict[str, int]]()
    for row in rows:
        for name, text in row.cells.items():
            if name not in used and not name.startswith(FACTOR):
                counts = levels.setdefault(name, {})
                counts[text] = counts.get(text, 0) + 1
    for name, counts in levels.items():
        if 2 <= len(counts) <= _MOST_LEVELS and min(counts.values()) > 1:
            shown = ", ".join(text or "nothing" for text in counts)
            word = re.sub(r"\W", "_", name)
            yield (
                f"Left out of every model: the column {name!r} ({shown}). Name it "
                f"--columns {FACTOR}{word}={name} to test it."
            )


def _check_foreign_row(cells: Row, place: str, experiment: str) -> None:
    """Reject a row that lacks what every judgement has, or has a height in another unit.

    An answer may be empty, but its column must be there.
    """
    answers = EXPERIMENTS[experiment].answers
    needed = ["participant", "condition", "height_um", *answers]
    lacking = []
    for name in ("participant", "condition", "height_um"):
        if not cells.get(name):
            lacking.append(name)
    lacking += [name for name in answers if name not in cells]
    if lacking:
        raise StudyError(
            f"a table must have {', '.join(needed)} (name yours by --columns), got no "
            f"{', '.join(lacking)}{_format_melt_advice(lacking)} [{place}]"
        )
    for name in ("height_um", "standard_height_um"):
        height = read_number_or_nan(cells.get(name, cells["height_um"]))
        if not _LOWEST <= height <= _HIGHEST:
            raise StudyError(
                f"{name} must be a number from {_LOWEST:g} to {_HIGHEST:g} um, got "
                f"{cells.get(name)!r}; is the unit of its column right? [{place}]"
            )


def _format_melt_advice(lacking: Sequence[str]) -> str:
    """Say how a table with a column for each condition gets a row for each judgement."""
    if "height_um" not in lacking or len(lacking) < 2:
        return ""
    return (
        "; one row per judgement is needed: of a table with a column for each, say how they are "
        "called by --wide, such as --wide '{condition}_{height_um}_{repetition}'"
    )


def _refuse_copied_rows(rows: Sequence[SheetRow], numbering_columns: set[str]) -> None:
    """Reject numbered rows that stand twice; `numbering_columns` are columns that number them.

    Without numbers, rows of one participant that are alike may be judgements that agree.
    """
    first = dict[tuple[str, ...], SheetRow]()
    for row in rows:
        texts = tuple(row.cells.values())
        if texts in first and numbering_columns & set(row.cells):
            raise StudyError(
                f"a row must not stand twice [{row.place}; first {first[texts].place}]"
            )
        first.setdefault(texts, row)


def _refuse_copied_tables(rows: Sequence[SheetRow], participant_column: str) -> None:
    """Reject tables in which everybody's rows follow twice, found by `participant_column`."""
    by_participant = dict[str, list[tuple[str, ...]]]()
    for row in rows:
        texts = tuple(row.cells.values())
        by_participant.setdefault(row.cells[participant_column], []).append(texts)
    if all(_repeats_first_half(texts) for texts in by_participant.values()):
        raise StudyError(f"the {len(rows) // 2} rows of a table must not stand twice")


def _repeats_first_half(rows: Sequence[tuple[str, ...]]) -> bool:
    """Return whether the second half of a participant's rows repeats the first."""
    half = len(rows) // 2
    if len(rows) < _FEWEST_COPIED or len(rows) % 2:
        return False
    return list(rows[:half]) == list(rows[half:])
