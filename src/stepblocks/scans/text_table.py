"""The table of numbers in a text: its notation, the names of its columns, and its rows.

Instruments separate fields by semicolons, tabs, commas or blanks, write decimal points or commas,
and put a head above the table and a footer below it.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.files.dialect import find_quotation_mark, is_number_in_any_notation
from stepblocks.files.layout import UNDECLARED, MissingValues, TableLayout
from stepblocks.files.missing import describe_missing, is_missing_word
from stepblocks.files.numbers import NotationError, NumberNotation, find_number_notation
from stepblocks.scans.scan import Array
from stepblocks.scans.units import UNIT_PATTERN, UNITS_PER_METRE, StoredLength

MOST_COLUMNS = 64
_MOST_HEADER_LINES = 400
# Lines at the end of the longest head and below it, by which the notation is found
_SAMPLED_LINES = 50
_SHOWN_CHARACTERS = 60  # of a wrong line, in a message
_MOST_DOUBTFUL = 4000  # lines in which the decimal sign is looked for, evenly over the text
_POINT = NumberNotation(".")
_COMMA = NumberNotation(",")
# Between thousands a blank would also separate two fields
_INNER_BLANK = re.compile(r"\s")
# what a spreadsheet writes for an error, as #N/A, is a cell
_COMMENT = re.compile(r"\s*#(?!\s*[-+.\d]|N/A|NA\b|[A-Z]+[!?]|DIV/0!)")
_AXIS_NAME = re.compile(r"(?i)[xyz]([\s_\[(/]|$)")  # of a column, as most programs write it
_STEP_NAME = re.compile(r"(?i)x[- _]?(resolution|spacing|step)")
_UNIT_ALONE = re.compile(rf"[\[(]?{UNIT_PATTERN}[\])]?")


@dataclass(frozen=True)
class NumberTable:
    """Columns of numbers, with what their head says.

    Attributes
    ----------
    names : tuple of str
        Name of each column, with its unit where the head states one; empty where there are none.
    values : array, shape (rows, columns)
        Stored numbers, nan where nothing was measured.
    unit : StoredLength or None
        Unit that the head states for the whole table.
    source : str
        Name of the file, for messages.
    missing : MissingValues, optional
        What is declared as missing; by default numbers that stand out.
    places : sequence of int
        Line of each row; empty of a table in memory.
    notes : tuple of str
        What had to be found out about the text.
    """

    names: tuple[str, ...]
    values: Array
    unit: StoredLength | None
    source: str
    missing: MissingValues | None = None
    places: Sequence[int] = ()
    notes: tuple[str, ...] = ()

    def format_row_place(self, row_index: int) -> str:
        """Say where a row stands in its source; `row_index` counts from 0."""
        if not self.places:
            return f"{self.source}, row {row_index + 1}"
        return f"{self.source}, line {self.places[row_index]}"

    def get_column_name(self, column: int) -> str | None:
        """Return the name of a column, None where columns have no names."""
        if not self.names:
            return None
        return self.names[column]


@dataclass(frozen=True)
class Notation:
    """How a text separates fields and writes numbers.

    Attributes
    ----------
    separator : str or None
        One letter; None for any run of blanks.
    numbers : NumberNotation
        How its numbers are written.
    words : frozenset of str
        Words for a missing point, beside the usual ones.
    quote : str
        Around a field.
    """

    separator: str | None
    numbers: NumberNotation = _POINT
    words: frozenset[str] = frozenset()
    quote: str = '"'

    def list_notation_notes(self) -> list[str]:
        """Say what had to be found out; nothing of commas, points and blanks."""
        notes = []
        if self.separator in _SEPARATOR_NAMES:
            notes.append(f"cells are separated by {_SEPARATOR_NAMES[self.separator]}")
        if self.numbers.decimal == ",":
            notes.append("numbers are written with decimal commas")
        return notes

    def split_line(self, line: str) -> list[str]:
        """Split a line into fields, without the empty ones that some instruments append."""
        fields = self._split_into_cells(line)
        while fields and not fields[-1]:
            fields.pop()
        return fields

    def _split_into_cells(self, line: str) -> list[str]:
        """Split a line into all its fields; a field in quotation marks may hold the separator."""
        if self.quote in line and self.separator is not None:
            reader = csv.reader(
                [line], delimiter=self.separator, quotechar=self.quote, skipinitialspace=True
            )
            return list(map(str.strip, next(reader)))
        return list(map(str.strip, line.split(self.separator)))

    def count_cells(self, line: str) -> int:
        """Count the fields of a line, empty ones included."""
        return len(self._split_into_cells(line))

    def is_missing(self, field: str) -> bool:
        """Tell whether a field is empty, or a word for a missing point."""
        return is_missing_word(field) or field in self.words

    def list_missing_words(self, fields: Iterable[str]) -> list[str]:
        """List the fields that hold a word for a missing point."""
        return [field for field in fields if field and self.is_missing(field)]

    def parse_number_or_nan(self, field: str) -> float:
        """Read a field as a number, nan for a word that stands for a missing point.

        Raises
        ------
        ValueError
            If it is neither.
        """
        if self.is_missing(field):
            return math.nan
        if self.separator in (",", None) and _INNER_BLANK.search(field.strip()):
            raise ValueError(f"{field!r} is two numbers")
        return self.numbers.parse_number(field)

    def parse_numbers_or_none(self, fields: Iterable[str]) -> list[float] | None:
        """Read fields as numbers, nan for a missing point.

        The result is None if a field is no number, or if all points are missing.
        """
        try:
            numbers = [self.parse_number_or_nan(field) for field in fields]
        except ValueError:
            return None
        if np.isnan(numbers).all():
            return None
        return numbers

    def is_number(self, field: str) -> bool:
        """Tell whether a field is a number, and no word for a missing one."""
        numbers = self.parse_numbers_or_none([field])
        return numbers is not None

    def count_numbers_in_row(self, line: str) -> int:
        """Count the numbers of a line; 0 if it is no row of a table of two columns or more."""
        try:
            fields = self.split_line(line)
        except csv.Error:
            return 0
        if len(fields) < 2 or self.parse_numbers_or_none(fields) is None:
            return 0
        return len(fields)


_BLANKS = Notation(separator=None)  # numbers with decimal points
# In the order of preference where several fit equally well
_SEPARATORS = (";", "\t", ",", "|", None)
_SEPARATOR_NAMES = {";": "semicolons", "\t": "tabs", "|": "bars"}


def parse_decimal_point_number(field: str) -> float:
    """Read a field with a decimal point, nan for a word that stands for a missing point.

    Raises
    ------
    ValueError
        If it is neither.
    """
    return Notation(";").parse_number_or_nan(field)


@dataclass(frozen=True)
class _Layout:
    """Where the table stands in a text."""

    notation: Notation
    first_line: int  # counted from zero
    columns: int


def parse_number_table(text: str, source: str, declared: TableLayout = UNDECLARED) -> NumberTable:
    """Find the table of numbers in a text and read it.

    Parameters
    ----------
    text : str
        The whole text: a head of any kind, the table, a footer that does not begin with numbers.
    source : str
        Name of the file, for messages.
    declared : TableLayout
        What is known of the text beforehand.

    Returns
    -------
    NumberTable
        Names, units and numbers.

    Raises
    ------
    MetrologyError
        If there is no table of at least two columns, or one of its lines is broken.
    """
    lines = text.splitlines()
    layout = _find_table_layout(lines, source, declared)
    _refuse_row_in_head(lines, layout, source)
    head = [_split_head_line(line, layout.notation) for line in lines[: layout.first_line]]
    if layout.columns > MOST_COLUMNS and any(len(fields) == layout.columns for fields in head):
        raise MetrologyError(
            f"table must have at most {MOST_COLUMNS} columns [{source}, {layout.first_line + 1}]"
        )
    notes = layout.notation.list_notation_notes()
    values = _read_faultless_rows_or_none(lines, layout)
    places: Sequence[int] = range(layout.first_line + 1, len(lines) + 1)
    if values is None:
        rows = _read_rows_line_by_line(lines, layout, source)
        values, places = rows.values, rows.places
        if rows.words:
            notes.append(describe_missing(list(dict.fromkeys(rows.words)), len(rows.words), ""))
    table = _make_named_table(head, values, source)
    return replace(table, missing=declared.missing_values, places=places, notes=tuple(notes))


def _find_table_layout(lines: Sequence[str], source: str, declared: TableLayout) -> _Layout:
    """Find the notation of a text, and the first line that is a row of numbers in it."""
    notation = _find_best_notation(lines, source, declared)
    if notation is not None:
        for number, line in enumerate(lines[: _MOST_HEADER_LINES + 1]):
            columns = notation.count_numbers_in_row(line)
            if columns:
                first_line = _find_first_row_above(lines, number, notation, columns)
                return _Layout(notation, first_line, columns)
    if len(lines) > _MOST_HEADER_LINES:
        raise MetrologyError(f"table must begin within {_MOST_HEADER_LINES} lines [{source}]")
    raise MetrologyError(
        f"text must hold a table of numbers in two columns or more, got none [{source}]"
    )


def _find_first_row_above(
    lines: Sequence[str], first_complete_line: int, notation: Notation, column_count: int
) -> int:
    """Return the first line of a table, from the first that is complete.

    The rows above it may end in missing points.
    """
    first = first_complete_line
    while first > 0 and _ends_in_missing_points(lines[first - 1], notation, column_count):
        first -= 1
    return first


def _ends_in_missing_points(line: str, notation: Notation, column_count: int) -> bool:
    """Tell whether a line is a row of a table that has empty fields at its end."""
    if notation.separator is None:
        return False
    try:
        fields = notation.split_line(line)
        cells = notation.count_cells(line)
    except csv.Error:
        return False
    return (
        bool(fields)
        and cells == column_count
        and notation.parse_numbers_or_none(fields) is not None
    )


def _find_best_notation(
    lines: Sequence[str], source: str, declared: TableLayout
) -> Notation | None:
    """Find the notation in which most of the sampled lines are rows of numbers."""
    begin = [line for line in lines[: _MOST_HEADER_LINES + _SAMPLED_LINES] if line.strip()]
    sample = begin[-_SAMPLED_LINES:]
    words = _get_declared_missing_words(declared)
    quote = find_quotation_mark(sample)
    best: Notation | None = None
    most_rows = 0
    for separator in _list_possible_separators(declared):
        for numbers in _list_possible_notations(declared):
            notation = Notation(separator, numbers, words, quote)
            rows = sum(notation.count_numbers_in_row(line) > 0 for line in sample)
            if rows > most_rows:
                best = notation
                most_rows = rows
    if best is None or declared.decimal is not None:
        return best
    return replace(best, numbers=_determine_number_notation(lines, best, source))


def _list_possible_separators(declared: TableLayout) -> Sequence[str | None]:
    """List what may separate the fields of a text: what is declared, else all."""
    if declared.separator is None:
        return _SEPARATORS
    if declared.separator.isspace() and declared.separator != "\t":
        return (None,)
    return (declared.separator,)


def _list_possible_notations(declared: TableLayout) -> Sequence[NumberNotation]:
    """List how the numbers of a text may be written: as declared, else with either sign."""
    if declared.decimal is None:
        return (_POINT, _COMMA)
    return (NumberNotation(declared.decimal),)


def _get_declared_missing_words(declared: TableLayout) -> frozenset[str]:
    """Return the declared words for a missing point."""
    values = declared.missing_values
    if values is None:
        return frozenset()
    return frozenset(values.words)


def _determine_number_notation(
    lines: Sequence[str], notation: Notation, source: str
) -> NumberNotation:
    """Find the decimal sign that the numbers of a text share; that of `notation` without commas."""
    cells: list[str] = []
    for line in lines[:: max(len(lines) // _MOST_DOUBTFUL, 1)]:
        if "," in line:
            try:
                cells += notation.split_line(line)
            except csv.Error:
                continue
    commas = [cell for cell in cells if "," in cell]
    if not commas:
        return notation.numbers
    try:
        return find_number_notation(cells)
    except NotationError as error:
        raise MetrologyError(f"{error} [{source}]") from error


def _split_head_line(head_line: str, notation: Notation) -> list[str]:
    """Split a line of the head into fields without comment marks and quotes."""
    try:
        fields = notation.split_line(head_line)
    except csv.Error:
        fields = head_line.split(notation.separator)
    return [field.lstrip("# ").strip("\"'") for field in fields]


def _refuse_row_in_head(lines: Sequence[str], layout: _Layout, source: str) -> None:
    """Refuse a row with a fault right above the table, which would be taken for its head."""
    above = layout.first_line - 1
    if layout.notation.separator is None or above < 0:
        return
    fields = _split_head_line(lines[above], layout.notation)
    are_numbers = [is_number_in_any_notation(field) for field in fields]
    if len(fields) != layout.columns or not any(are_numbers):
        return
    is_below_names = False
    if above > 0:
        names = _split_head_line(lines[above - 1], layout.notation)
        is_below_names = len(names) == layout.columns and _AXIS_NAME.match(names[0]) is not None
    if are_numbers[0] or is_below_names:
        raise _make_line_error(lines[above], above + 1, layout, source)


def _read_faultless_rows_or_none(lines: Sequence[str], layout: _Layout) -> Array | None:
    """Read a table without missing points, footer or fault; None where it has one of them."""
    body = "\n".join(lines[layout.first_line :])
    if layout.notation.numbers.decimal == ",":
        if "." in body:
            return None  # between thousands
        body = body.replace(",", ".")
    try:
        values = np.loadtxt(
            io.StringIO(body), delimiter=layout.notation.separator, comments=None, ndmin=2
        )
    except ValueError:
        return None
    if values.shape[1] != layout.columns:
        return None
    return np.asarray(values, dtype=np.float64)


@dataclass(frozen=True)
class _Rows:
    """Rows of a table, shape (rows, columns), their lines, and the words for what is missing."""

    values: Array
    places: list[int]
    words: list[str]


def _read_rows_line_by_line(lines: Sequence[str], layout: _Layout, source: str) -> _Rows:
    """Read a table line by line, with its missing points and up to its footer."""
    notation = layout.notation
    rows: list[list[float]] = []
    places: list[int] = []
    words: list[str] = []
    end: int | None = None  # the first line that is no row of the table
    for index in range(layout.first_line, len(lines)):
        line = lines[index]
        if _COMMENT.match(line):
            continue
        try:
            fields = notation.split_line(line)
        except csv.Error:
            raise _make_line_error(line, index + 1, layout, source) from None
        if not fields:
            continue
        row = _parse_row_or_none(fields, layout)
        is_short = row is not None and notation.count_cells(line) < layout.columns
        if row is not None and not is_short and end is None:
            rows.append(row)
            places.append(index + 1)
            words += notation.list_missing_words(fields)
            continue
        if end is None:
            end = index
        if is_short or _is_table_row(fields, layout):
            raise _make_line_error(lines[end], end + 1, layout, source)
    return _Rows(np.array(rows, dtype=np.float64), places, words)


def _is_table_row(fields: Sequence[str], layout: _Layout) -> bool:
    """Tell whether a line belongs to the table, and not to its footer, which holds words.

    It begins with a number, or has as many fields as the table and a number among them.
    """
    notation = layout.notation
    if notation.is_number(fields[0]):
        return True
    is_as_long = len(fields) == layout.columns and notation.separator is not None
    return is_as_long and any(notation.is_number(field) for field in fields)


def _parse_row_or_none(fields: Sequence[str], layout: _Layout) -> list[float] | None:
    """Read a row of the table, the fields that it lacks at its end as missing points."""
    lacking = layout.columns - len(fields)
    if lacking < 0:
        return None
    return layout.notation.parse_numbers_or_none([*fields, *[""] * lacking])


def _make_line_error(line: str, line_number: int, layout: _Layout, source: str) -> MetrologyError:
    """Make the error of a broken line, with the field that is not a number."""
    notation = layout.notation
    try:
        fields = notation.split_line(line)
    except csv.Error:
        fields = [line]
    wrong = [field for field in fields if notation.parse_numbers_or_none([field, "0"]) is None]
    if wrong and len(fields) == layout.columns and all(map(_AXIS_NAME.match, fields)):
        return MetrologyError(
            f"a file must hold one table, got a second one with the columns {', '.join(fields)} "
            f"[{source}, line {line_number}]"
        )
    shown = ",".join(fields)[:_SHOWN_CHARACTERS]
    reason = ""
    if wrong:
        reason = f", since {wrong[0][:_SHOWN_CHARACTERS]!r} is none"
        if not is_number_in_any_notation(wrong[0]):
            reason += "; a word for a missing value may be declared (--missing)"
    return MetrologyError(
        f"line must hold {layout.columns} numbers, got {shown!r}{reason} [{source}, line "
        f"{line_number}]"
    )


def _make_named_table(
    head_lines: Sequence[Sequence[str]], values: Array, source: str
) -> NumberTable:
    """Name the columns by the last line of the head, or by the last two, names above units."""
    lines = []
    for fields in head_lines:
        filled = [field for field in fields if field]
        if filled:
            lines.append(filled)
    unit = _find_unit_line(lines)
    columns = values.shape[1]
    if not lines:
        return NumberTable((), values, unit, source)
    title = lines[-1]
    if columns > 2 and len(title) == columns - 1 and _is_first_column_counter(title, values):
        return _convert_counts_to_positions(lines, values, unit, source)
    if len(title) != columns:
        _refuse_lacking_names(title, columns, source)
        return NumberTable((), values, unit, source)
    are_units = all(_UNIT_ALONE.fullmatch(field.lower()) for field in title)
    if are_units and len(lines) > 1 and len(lines[-2]) == columns:
        title = [f"{name} {of_name}" for name, of_name in zip(lines[-2], title, strict=True)]
    return NumberTable(tuple(title), values, unit, source)


def _refuse_lacking_names(title: Sequence[str], column_count: int, source: str) -> None:
    """Refuse a head that names two columns or more, but not as many as the rows have."""
    are_names = all(_AXIS_NAME.match(field) for field in title)
    if len(title) >= 2 and are_names:
        raise MetrologyError(
            f"rows must have as many numbers as the head has names, {', '.join(title)}, got "
            f"{column_count}; decimal commas need another separator than commas [{source}]"
        )


def _find_unit_line(head_lines: Sequence[Sequence[str]]) -> StoredLength | None:
    """Find the last line of a head that is a unit and nothing else."""
    unit = None
    for fields in head_lines:
        word = fields[0].lower()
        if len(fields) == 1 and word in UNITS_PER_METRE:
            unit = StoredLength(1.0, UNITS_PER_METRE[word])
    return unit


def _is_first_column_counter(title: Sequence[str], values: Array) -> bool:
    """Tell whether the first column, which the title leaves out, only counts the points."""
    for field in title:
        if _BLANKS.is_number(field):
            return False
    return bool((np.diff(values[:, 0]) == 1.0).all())


def _convert_counts_to_positions(
    head_lines: Sequence[Sequence[str]], values: Array, unit: StoredLength | None, source: str
) -> NumberTable:
    """Turn numbers of points into positions by the step that the head states.

    Without a step, the first column stays a count, named ``#``.
    """
    title = head_lines[-1]
    for fields in head_lines:
        if len(fields) != 2 or not _STEP_NAME.match(fields[0]):
            continue
        step = _BLANKS.parse_numbers_or_none(fields[1:])
        if step is None:
            continue
        positions = values.copy()
        positions[:, 0] *= step[0]
        # what follows the words of the step is its unit
        name = "x" + _STEP_NAME.sub("", fields[0])
        return NumberTable((name, *title), positions, unit, source)
    return NumberTable(("#", *title), values, unit, source)
