"""Records of other programs become judgements in our columns, without anybody naming a column."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stepblocks.errors import StudyError
from stepblocks.files.decode import decode_text
from stepblocks.files.layout import TableLayout
from stepblocks.files.paths import describe_system_error
from stepblocks.files.text import measure_file_size
from stepblocks.files.text_table import TableShape, TextTable, read_column_names, read_text_table
from stepblocks.study.columns import COMPARED, NO, YES, NamedColumns, read_number_or_nan
from stepblocks.study.programs.gorilla import GORILLA
from stepblocks.study.programs.jspsych import JSPSYCH, parse_json_records
from stepblocks.study.programs.opensesame import OPENSESAME
from stepblocks.study.programs.program import (
    PREFIX,
    Channel,
    Program,
    Records,
    keep_rows,
    pick_by_indices,
)
from stepblocks.study.programs.psychopy import PSYCHOPY
from stepblocks.study.programs.qualtrics import QUALTRICS

PROGRAMS = (PSYCHOPY, JSPSYCH, OPENSESAME, QUALTRICS, GORILLA)
_NOTHING = ("None", "null", "NA", "NaN", "nan", "undefined")  # where nobody answered
_LISTED = re.compile(r"\[\s*(['\"])(.*)\1\s*\]")  # a list of one text, as Python writes it
_TRIAL = f"{PREFIX}trial"
_REACTION = "reaction_s"
_HEIGHTS = ("height_um", "height_mm", "height_m")


@dataclass(frozen=True)
class AnswerSearch:
    """What a study looks for in the records of another program.

    Attributes
    ----------
    answers : tuple of str
        Columns of answers, as `Experiment.answers` has them.
    columns : NamedColumns
        What the user says of the columns.
    """

    answers: tuple[str, ...]
    columns: NamedColumns


def recognise_program(column_names: Sequence[str]) -> Program | None:
    """Return the program whose records have such columns; None for any other table."""
    for program in PROGRAMS:
        if program.recognises_columns(column_names):
            return program
    return None


def has_json_suffix(path: Path) -> bool:
    """Return whether a file is called a JSON document."""
    return path.suffix.lower() == ".json"


def read_program_table(path: Path, layout: TableLayout, most_bytes: int) -> TextTable:
    """Read a table, or the JSON of jsPsych.

    Parameters
    ----------
    path : Path
        The file.
    layout : TableLayout
        What is declared of a table.
    most_bytes : int
        Largest file that is read.

    Raises
    ------
    StudyError
        If it cannot be read.
    """
    if not has_json_suffix(path):
        program = recognise_program(read_column_names(path))
        shape = TableShape(keeps_ragged=program is GORILLA)  # its last row may be short
        return read_text_table(path, layout, StudyError, most_bytes, shape)
    try:
        size = measure_file_size(path)
        if size > most_bytes:
            raise StudyError(f"records must be below {most_bytes} bytes, got {size} [{path}]")
        raw = path.read_bytes()
    except OSError as error:
        reason = describe_system_error(error, path)
        raise StudyError(f"records cannot be read: {reason} [{path}]") from error
    return parse_json_records(decode_text(raw, path, StudyError).text, str(path))


def convert_records(table: TextTable, search: AnswerSearch) -> TextTable:
    """Write the records of another program in our columns; any other table stays as it is.

    Rows that are no trials are left out, and so is what the program writes for itself.

    Parameters
    ----------
    table : TextTable
        As the program wrote it.
    search : AnswerSearch
        What is looked for.

    Raises
    ------
    StudyError
        If it is not clear which column holds an answer.
    """
    program = recognise_program(table.names)
    if program is None:
        return table
    records = _keep_trial_rows(program.unfold(table), search)
    chosen = _choose_answer_channels(records, search)
    columns = _collect_kept_columns(program, records, search)
    is_planned = _TRIAL in records.table.names
    if is_planned:
        columns = _strip_planned_prefix(columns)
    elif "participant" not in search.columns.named:
        columns.update(_make_participant_column(program, records.table))
    if chosen and not search.columns.find_stated_name(_REACTION):
        columns.update(_read_reaction_column(program, records.table, next(iter(chosen.values()))))
    answers = []
    for answer, channel in chosen.items():
        name = search.columns.get_table_name(answer)
        columns.pop(channel.column, None)
        columns[name] = _clean_answer_column(records.table, channel.column)
        answers.append(name)
    adopted = _build_table_of_columns(records.table, columns)
    if program.has_events:
        adopted = _drop_unanswered_rows(adopted, answers)
    if is_planned:
        adopted = _join_answers_of_trial(adopted, answers, ("participant", "trial"))
    elif len(answers) > 1:
        adopted = _join_answers_of_trial(adopted, answers, ())
    notes = [*adopted.notes]
    for answer, channel in chosen.items():
        if channel.column != search.columns.get_table_name(answer) and channel.question != answer:
            notes.append(f"{answer} is read from {channel.column!r} of {program.title}")
    return replace(adopted, notes=tuple(notes))


def _strip_planned_prefix(cells_by_column: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Return columns of planned trials by their names in a run sheet, without our prefix."""
    named = {}
    for name, cells in cells_by_column.items():
        if not name.startswith(PREFIX):
            named[name] = cells
    for name, cells in cells_by_column.items():
        if name.startswith(PREFIX):
            named[name.removeprefix(PREFIX)] = cells
    named["trial"] = list(map(_format_whole_number, named["trial"]))
    return named


def _keep_trial_rows(records: Records, search: AnswerSearch) -> Records:
    """Leave out the rows of instructions and breaks: those that name no trial or no height."""
    table = records.table
    stated_height = search.columns.find_stated_name("height_um")
    mark = _find_first_known_column(table, (_TRIAL, stated_height, *_HEIGHTS))
    if mark is None:
        return records
    kept = []
    for row, cell in enumerate(table.get_named_cells(mark)):
        if cell and cell not in _NOTHING:
            kept.append(row)
    return Records(keep_rows(table, kept), records.channels)


def _find_first_known_column(table: TextTable, names: Sequence[str]) -> str | None:
    """Return the first of some names that a column has; None where no column has any of them."""
    for name in names:
        if name in table.names:
            return name
    return None


def _choose_answer_channels(records: Records, search: AnswerSearch) -> dict[str, Channel]:
    """Return where each answer stands; an answer is left out where nothing holds it.

    Raises
    ------
    StudyError
        If several columns may hold an answer, or one holds positions of buttons.
    """
    names = records.table.names
    by_column = records.by_column
    by_question = {channel.question: channel for channel in records.channels}
    chosen = dict[str, Channel]()
    for answer in search.answers:
        named = search.columns.find_stated_name(answer)
        if named in by_question:
            raise StudyError(
                f"{answer} must be named by a column, such as {by_question[named].column!r}, got "
                f"{named!r} [{records.table.file}]"
            )
        if named:
            if named in names:
                chosen[answer] = by_column.get(named, Channel(named, named))
        elif answer in names:
            chosen[answer] = Channel(answer, answer)
        elif answer in by_question:
            chosen[answer] = by_question[answer]
    if len(search.answers) > 1 or chosen:
        return chosen
    (answer,) = search.answers
    only_filled = _choose_filled_channel(records, answer, search)
    if only_filled is not None:
        chosen[answer] = only_filled
    return chosen


def _choose_filled_channel(records: Records, answer: str, search: AnswerSearch) -> Channel | None:
    """Return the only channel that may hold an answer; None where none is filled.

    Raises
    ------
    StudyError
        If several are filled, or the one holds positions of buttons.
    """
    filled = _find_filled_channels(records, answer, search)
    if not filled:
        return None
    if len(filled) > 1:
        columns = [channel.column for channel in filled]
        raise StudyError(
            f"which of {', '.join(columns)} holds {answer} must be said, such as "
            f"--columns {answer}={filled[0].column!r} [{records.table.file}]"
        )
    if filled[0].is_position:
        raise StudyError(
            f"{answer} must be an answer, got positions of buttons in {filled[0].column!r}; if 0 "
            f"and 1 mean no and yes, name it by --columns {answer}={filled[0].column!r} "
            f"[{records.table.file}]"
        )
    return filled[0]


def _find_filled_channels(records: Records, answer: str, search: AnswerSearch) -> list[Channel]:
    """Return the channels that may hold an answer; those that hold anything where none may."""
    taken = set(search.columns.named.values())
    filled, fitting = [], []
    for channel in records.channels:
        if channel.column in taken:
            continue
        texts = list(filter(None, _clean_answer_column(records.table, channel.column)))
        if not texts:
            continue
        filled.append(channel)
        if all(_is_possible_answer(answer, text) for text in texts):
            fitting.append(channel)
    return fitting or filled


def _is_possible_answer(answer_column: str, text: str) -> bool:
    """Return whether a text may be an answer: a number, or of comparisons yes or no."""
    if answer_column in COMPARED:
        return text.lower() in (*YES, *NO)
    return not math.isnan(read_number_or_nan(text.replace(",", ".")))


def _collect_kept_columns(
    program: Program, records: Records, search: AnswerSearch
) -> dict[str, list[str]]:
    """Return the cells of every column that the program does not write for itself."""
    table = records.table
    taken = set(search.columns.named.values())
    channels = records.by_column
    columns = {}
    for number, name in enumerate(table.names):
        is_own = name in channels or program.is_administrative(name)
        if name in taken or not is_own:
            columns[name] = table.get_cells(number)
    return columns


def _make_participant_column(program: Program, table: TextTable) -> dict[str, list[str]]:
    """Return the column of participants by our name; nothing where there is none."""
    for name in program.people:
        if name not in table.names:
            continue
        cells = table.get_named_cells(name)
        if any(cells):
            return {"participant": cells}
    return {}


def _read_reaction_column(
    program: Program, table: TextTable, channel: Channel
) -> dict[str, list[str]]:
    """Return the reaction times of an answer [s] by our name; nothing where there are none."""
    if channel.reaction not in table.names:
        return {}
    seconds = []
    for cell in table.get_named_cells(channel.reaction):
        value = read_number_or_nan(_clean_answer(cell))
        text = ""
        if not math.isnan(value):
            text = f"{value * program.seconds:.9g}"
        seconds.append(text)
    return {_REACTION: seconds}


def _clean_answer_column(table: TextTable, column: str) -> list[str]:
    """Return the answers of a column; empty where nobody answered."""
    return list(map(_clean_answer, table.get_named_cells(column)))


def _clean_answer(cell: str) -> str:
    """Return an answer, taken out of a list of one; empty for a word that means no answer."""
    listed = _LISTED.fullmatch(cell)
    text = cell
    if listed:
        text = listed[2]
    if text in _NOTHING:
        return ""
    return text


def _format_whole_number(text: str) -> str:
    """Write the number of a trial without a decimal point, which some programs add."""
    value = read_number_or_nan(text)
    if math.isnan(value) or value != int(value):
        return text
    return str(int(value))


def _build_table_of_columns(table: TextTable, columns: Mapping[str, Sequence[str]]) -> TextTable:
    """Return a table of other columns in the same rows."""
    rows = list(map(list, zip(*columns.values(), strict=True)))
    return replace(table, names=tuple(columns), rows=rows, units=())


def _drop_unanswered_rows(table: TextTable, answers: Sequence[str]) -> TextTable:
    """Leave out events without an answer, such as a fixation: a missed trial has no row then."""
    if not answers:
        return table
    columns = table.find_column_indices(answers)
    kept = []
    for number, cells in enumerate(table.rows):
        if any(pick_by_indices(cells, columns)):
            kept.append(number)
    return keep_rows(table, kept)


def _join_answers_of_trial(
    table: TextTable, answers: Sequence[str], key_columns: Sequence[str]
) -> TextTable:
    """Join the answers to one trial that stand in several rows.

    Rows belong together that agree in `key_columns`, or without keys in everything but the
    answers. An answer that stands in both begins another trial.
    """
    columns = table.find_column_indices(answers)
    varying = [*columns]
    if _REACTION in table.names:
        varying.append(table.names.index(_REACTION))
    compared = _list_compared_columns(table, varying, key_columns)
    open_rows = dict[tuple[str, ...], list[str]]()
    kept = []
    for number, cells in enumerate(table.rows):
        key = tuple(pick_by_indices(cells, compared))
        joined = open_rows.get(key)
        if joined is None or _both_answer_one_column(joined, cells, columns):
            open_rows[key] = cells
            kept.append(number)
            continue
        for column in varying:
            joined[column] = joined[column] or cells[column]
    return keep_rows(table, kept)


def _both_answer_one_column(
    first: Sequence[str], second: Sequence[str], columns: Sequence[int]
) -> bool:
    """Return whether two rows hold an answer in the same one of some columns."""
    return any(first[column] and second[column] for column in columns)


def _list_compared_columns(
    table: TextTable, varying: Sequence[int], keys: Sequence[str]
) -> list[int]:
    """List the places of the columns in which rows of one trial agree."""
    if not keys:
        return sorted(set(range(len(table.names))).difference(varying))
    known_keys = []
    for key in keys:
        if key in table.names:
            known_keys.append(key)
    return table.find_column_indices(known_keys)
