"""Tables with a column for each trial become tables with a row for each trial."""

import re
from collections.abc import Mapping
from dataclasses import replace

from stepblocks.errors import StudyError
from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import list_cells_in_order, pick_by_indices
from stepblocks.study.programs.records import AnswerSearch

_FIELD = re.compile(r"\{(\w*)\}")
_NUMBER = r"\d+(?:[.,]\d+)?"
_WHOLE = ("trial", "repetition")  # fields that count
_ANSWER = "answer"  # field of the name of an answer, where a trial has several


def melt_table(table: TextTable, pattern: str, search: AnswerSearch) -> TextTable:
    """Give each trial a row of its own.

    Parameters
    ----------
    table : TextTable
        With a row for each participant and a column for each trial.
    pattern : str
        How such a column is called, with our names in braces: ``{condition}_{height_um}_{trial}``;
        ``{answer}`` is the name of an answer.
    search : AnswerSearch
        What is looked for.

    Returns
    -------
    TextTable
        The columns in braces, those of answers, and all that the pattern does not fit.

    Raises
    ------
    StudyError
        If no column is called so, or the pattern does not say which answer a column holds.
    """
    known = _parse_column_names(table, pattern)
    fields = list(next(iter(known.values())))
    answers = list(map(search.columns.get_table_name, search.answers))
    if _ANSWER in fields:
        fields.remove(_ANSWER)
    elif len(answers) > 1:
        raise StudyError(
            f"wide must say which of {', '.join(answers)} a column holds, by {{{_ANSWER}}}, got "
            f"{pattern!r} [{table.file}]"
        )
    kept = sorted(set(range(len(table.names))).difference(known))
    rows, places = [], []
    for cells, place in zip(table.rows, table.places, strict=True):
        kept_cells = pick_by_indices(cells, kept)
        trials = dict[tuple[str, ...], dict[str, str]]()
        for column, found in known.items():
            levels = tuple(list_cells_in_order(found, fields))
            trial = trials.setdefault(levels, {})
            answer = found.get(_ANSWER, answers[0])
            trial[answer] = cells[column]
        for levels, trial in trials.items():
            rows.append([*kept_cells, *levels, *list_cells_in_order(trial, answers)])
            places.append(place)
    names = (*pick_by_indices(table.names, kept), *fields, *answers)
    return replace(table, names=names, rows=rows, places=places, units=())


def _parse_column_names(table: TextTable, pattern: str) -> dict[int, Mapping[str, str]]:
    """Parse the names of columns by a pattern; return the texts of its fields by column."""
    expression = _compile_column_pattern(pattern)
    found = dict[int, Mapping[str, str]]()
    for column, name in enumerate(table.names):
        fitted = expression.fullmatch(name)
        if fitted is not None:
            texts = fitted.groupdict()
            for field, text in texts.items():
                if _is_length_field(field):
                    texts[field] = text.replace(",", ".")
            found[column] = texts
    if not found:
        shown = ", ".join(table.names[:6])
        raise StudyError(
            f"wide must fit the names of some columns, got {pattern!r} for {shown}, ... "
            f"[{table.file}]"
        )
    return found


def _compile_column_pattern(pattern: str) -> re.Pattern[str]:
    """Return the regular expression of a pattern.

    What separates fields stands in no text, so that a pattern with fewer fields than the columns
    have parts does not fit them.

    Raises
    ------
    StudyError
        If it has no field, or one that is no name or stands twice.
    """
    fields = _FIELD.findall(pattern)
    stand_once = len(set(fields)) == len(fields)
    if not fields or not stand_once or not all(map(str.isidentifier, fields)):
        raise StudyError(
            "wide must name columns in braces, each once, such as "
            f"{{condition}}_{{height_um}}_{{repetition}}, got {pattern!r:.80}"
        )
    expression = ""
    parts = _FIELD.split(pattern)
    ends = ""
    for between in parts[::2]:
        ends += re.escape(between[:1])
    letter = "."
    if ends:
        letter = f"[^{ends}]"
    for number, part in enumerate(parts):
        is_field = number % 2 == 1
        if not is_field:
            expression += re.escape(part)
        elif part in _WHOLE:
            expression += rf"(?P<{part}>\d+)"
        elif _is_length_field(part):
            expression += f"(?P<{part}>{_NUMBER})"
        else:
            expression += f"(?P<{part}>{letter}+)"
    return re.compile(expression)


def _is_length_field(field: str) -> bool:
    """Return whether a field of a pattern is a length."""
    return field.endswith(("_um", "_mm", "_m"))
