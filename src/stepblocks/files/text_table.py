"""The one reader of tables: a text or a sheet becomes named columns of cells, each with its place.

What had to be found out (encoding, separators, decimal signs, units, fill values) stands in the
notes of the table.
"""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.decode import decode_text
from stepblocks.files.dialect import (
    Dialect,
    count_cells,
    find_dialect,
    is_number_in_any_notation,
    list_first_row_lines,
    split_records,
)
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.missing import (
    DeclaredMissing,
    FillFound,
    is_missing_word,
    list_missing_words,
    replace_fill_values_by_nan,
)
from stepblocks.files.numbers import (
    NotationError,
    NumberNotation,
    find_number_notation,
    is_plain_number,
)
from stepblocks.files.paths import describe_system_error
from stepblocks.files.raw_table import RawTable, Record, name_sheet_column
from stepblocks.files.spreadsheet import read_sheet
from stepblocks.files.text import measure_file_size
from stepblocks.mistakes import Mistake, format_mistakes, shorten_value

__all__ = [
    "CellError",
    "TableShape",
    "TextTable",
    "is_table_name",
    "is_workbook",
    "parse_text_table",
    "read_column_names",
    "read_text_table",
]

_MOST_BYTES = 2_000_000_000
_MOST_COLUMNS = 10_000
_MOST_SHOWN = 60  # letters of a row that a message shows
_MOST_ROWS_NAMED = 12  # of those that have another number of cells than the header
_SHEETS = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")
TABLE_ENDINGS = (".csv", ".tsv", *_SHEETS)
_SHEET_MARKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")  # of a zip, of an old Excel
# a unit in a row of units: in brackets, or letters with powers, as "um", "N/mm", "m s^-1", "1"
_UNIT = re.compile(r"[\[(].*[\])]|[A-Za-zµμΩÅ°%‰]+[23]?([ */·^-]*-?[A-Za-zµμΩ°0-9]+)?|1|-")
_RULE = re.compile(r":?(-{3,}|={3,}):?")  # as Markdown draws it below a header
_LONGEST_UNIT = 12  # letters
_HEAD_BYTES = 10_000  # in which the first row of a table lies
_PLAIN = NumberNotation()


class CellError(ValueError):
    """A cell of a column of numbers that is no number."""

    def __init__(self, row: int, cell: str) -> None:
        super().__init__(f"must be a number, got {shorten_value(cell)}")
        self.row = row
        self.cell = cell


@dataclass(frozen=True)
class TableShape:
    """What a caller knows of the rows of a table.

    Attributes
    ----------
    skip_lines : int
        Lines above the table that are no part of it.
    has_header : bool
        Whether its first row names the columns.
    keeps_ragged : bool
        Whether a row with another number of cells than the header is kept as it is, for a caller
        who says of each row what is wrong with it.
    """

    skip_lines: int = 0
    has_header: bool = True
    keeps_ragged: bool = False


_USUAL_SHAPE = TableShape()


@dataclass(frozen=True)
class TextTable:
    """A table as its file writes it.

    Attributes
    ----------
    names : tuple of str
        Of the columns; empty where they have none.
    rows : list of list of str
        Cells without blanks around them, each row as long as the others.
    places : sequence of int
        Line of each row in a text, number of the row in a sheet.
    file : str
        For messages.
    notation : NumberNotation
        Of all its numbers.
    units : tuple of str
        Of the columns, from a row of units below the header; empty where there is none.
    sheet : str
        Name of the sheet; empty for a text.
    finds_fills : bool
        Whether numbers that stand out count as missing; those that are declared are empty cells
        already.
    notes : tuple of str
        What had to be found out about the file.
    """

    names: tuple[str, ...]
    rows: list[list[str]]
    places: Sequence[int]
    file: str
    notation: NumberNotation = field(default_factory=NumberNotation)
    units: tuple[str, ...] = ()
    sheet: str = ""
    finds_fills: bool = True
    notes: tuple[str, ...] = ()

    @property
    def column_count(self) -> int:
        """The number of columns."""
        if self.names or not self.rows:
            return len(self.names)
        return len(self.rows[0])

    @property
    def place(self) -> str:
        """The file, and the sheet of a workbook, for messages about the whole table."""
        return f"{self.file}, {self.sheet}" if self.sheet else self.file

    def name_place_of_row(self, row: int, column: int | None = None) -> str:
        """Say where a row stands, counted from 0, or one of its cells: a line, or a cell's name."""
        if not self.sheet:
            return f"line {self.places[row]}"
        if column is None:
            return f"{self.sheet}, row {self.places[row]}"
        return f"{self.sheet}, cell {name_sheet_column(column)}{self.places[row]}"

    def get_cells(self, column: int) -> list[str]:
        """Return the cells of a column; of a row that ends before it, an empty one."""
        try:
            return [row[column] for row in self.rows]
        except IndexError:
            return ["".join(row[column : column + 1]) for row in self.rows]

    def find_column_indices(self, names: Iterable[str]) -> list[int]:
        """Find the places of columns by their names; all of them must be there."""
        return [self.names.index(name) for name in names]

    def get_named_cells(self, name: str) -> list[str]:
        """Return the cells of a column by its name, as `get_cells` does."""
        return self.get_cells(self.names.index(name))

    def read_numbers(self, column: int) -> FillFound:
        """Read a column of numbers, shape (rows,); NaN where one is missing.

        Raises
        ------
        CellError
            If a cell is no number, and does not say that one is missing.
        """
        cells = self.get_cells(column)
        values = self.notation.parse_column(cells)
        words: tuple[str, ...] = ()
        if values is None:
            values = self._parse_numbers(cells)
            words = list_missing_words(cells)
        found = FillFound(values)
        if self.finds_fills:
            found = replace_fill_values_by_nan(values)
        return replace(found, words=words)

    def require_numbers(self, column: int, raises: type[StepblocksError]) -> FillFound:
        """Read a column of numbers; raise with name and place where a cell is not a number."""
        try:
            return self.read_numbers(column)
        except CellError as error:
            name = repr(self.names[column]) if self.names else f"column {column}"
            place = self.name_place_of_row(error.row, column)
            raise raises(f"{name} {error} [{self.file}, {place}]") from error

    def _parse_numbers(self, cells: Sequence[str]) -> NDArray[np.float64]:
        """Read cells one by one, words for a missing number as NaN."""
        values = np.full(len(cells), np.nan)
        has_point = self.notation.decimal == "."
        for row, cell in enumerate(cells):
            if has_point and is_plain_number(cell):
                values[row] = float(cell)
                continue
            if is_missing_word(cell):
                continue
            try:
                values[row] = self.notation.parse_number(cell)
            except ValueError:
                raise CellError(row, cell) from None
        return values

    def holds_numbers(self, column: int) -> bool:
        """Tell whether a column holds numbers and what says that one is missing, nothing else."""
        cells = self.get_cells(column)
        if cells and _PLAIN.parse_column(cells) is not None:
            return True
        has_number = False
        for cell in cells:
            if is_number_in_any_notation(cell):
                has_number = True
            elif not is_missing_word(cell):
                return False
        return has_number


def read_text_table(
    path: Path,
    layout: TableLayout = UNDECLARED,
    raises: type[StepblocksError] = PipelineError,
    most_bytes: int = _MOST_BYTES,
    shape: TableShape = _USUAL_SHAPE,
) -> TextTable:
    """Read a table from a text or from the first sheet of a workbook.

    Parameters
    ----------
    path : Path
        CSV, TSV or any text of separated cells; or a workbook of Excel or LibreOffice.
    layout : TableLayout
        What is declared of it; of a workbook, the missing values alone count.
    raises : type of StepblocksError
        Raised for everything that is wrong with the file.
    most_bytes : int
        Largest file that is read.
    shape : TableShape
        What the caller knows of its rows.

    Returns
    -------
    TextTable
        It may have no rows.
    """
    try:
        size = measure_file_size(path)
        if size > most_bytes:
            raise raises(f"table must be smaller than {most_bytes} bytes, got {size} [{path}]")
        if is_workbook(path):
            return build_text_table(read_sheet(path, raises), layout, str(path), raises, shape)
        raw = path.read_bytes()
    except OSError as error:
        reason = describe_system_error(error, path)
        raise raises(f"table cannot be read: {reason} [{path}]") from error
    decoded = decode_text(raw, path, raises, layout.encoding)
    if "\0" in decoded.text:
        raise raises(f"table must be text or a sheet of Excel or LibreOffice, got binary [{path}]")
    table = parse_text_table(decoded.text, str(path), layout, raises, shape)
    if decoded.note:
        table = replace(table, notes=(decoded.note, *table.notes))
    return table


def is_table_name(path: Path) -> bool:
    """Tell whether a file's name is that of a table: CSV, TSV or a workbook."""
    return path.suffix.lower() in TABLE_ENDINGS


def is_workbook(path: Path) -> bool:
    """Tell whether a file is a workbook, by its name and its first bytes."""
    if path.suffix.lower() not in _SHEETS:
        return False
    with path.open("rb") as file:
        return file.read(8).startswith(_SHEET_MARKS)


def read_column_names(path: Path) -> tuple[str, ...]:
    """Return the names in the first row of a table; none where the file is not a table."""
    if not is_table_name(path) or not path.is_file():
        return ()
    try:
        if is_workbook(path):
            return read_text_table(path).names
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        text = decode_text(head, path, PipelineError).text
        first = "".join(list_first_row_lines(text)[:1])
        return tuple(next(find_dialect(first).split_rows(first)).cells)
    except (StepblocksError, csv.Error, StopIteration):
        return ()


def parse_text_table(
    text: str,
    file: str,
    layout: TableLayout = UNDECLARED,
    raises: type[StepblocksError] = PipelineError,
    shape: TableShape = _USUAL_SHAPE,
) -> TextTable:
    """Read a table from a text; see `read_text_table`."""
    skipped = shape.skip_lines
    for _ in range(skipped):
        text = text.partition("\n")[2]
    dialect = find_dialect(text, layout.separator)
    try:
        records, comments = split_records(text, dialect)
    except csv.Error as error:
        line = _find_broken_line(text, dialect) + skipped
        raise raises(f"table must be a CSV: {error} [{file}, line {line}]") from error
    if skipped:
        records = [Record(record.line + skipped, record.cells) for record in records]
    notes = []
    usual = "\t" if file.lower().endswith(".tsv") else ","
    if layout.separator is None and dialect.separator != usual and records:
        notes.append(f"cells are separated by {dialect.separator_in_words}")
    raw = RawTable(records, comments, notes=tuple(notes))
    return build_text_table(raw, layout, file, raises, shape)


def _find_broken_line(text: str, dialect: Dialect) -> int:
    """Return the line in which a text stops to be a table."""
    line = 1
    try:
        for record in dialect.split_rows(text):
            line = record.line + 1
    except csv.Error:
        return line
    return line


def build_text_table(
    raw: RawTable,
    layout: TableLayout,
    file: str,
    raises: type[StepblocksError],
    shape: TableShape,
) -> TextTable:
    """Make a table of its rows: header, units, equal lengths and one notation of numbers.

    Raises
    ------
    StepblocksError
        As `raises` says, if a row has another number of cells than the header, a name stands twice,
        or its numbers contradict each other.
    """
    records = list(raw.records)
    notes = list(raw.notes)
    names: list[str] = []
    if shape.has_header:
        names = _pop_header(records, raw.comments, notes)
    place = f"{file}, {raw.sheet}" if raw.sheet else file
    width = _count_columns(records, names)
    if width > _MOST_COLUMNS:
        raise raises(f"table must have at most {_MOST_COLUMNS} columns, got {width} [{place}]")
    _drop_dash_row(records, notes)
    if not shape.keeps_ragged:
        _refuse_ragged_rows(records, width, place, raises, bool(raw.sheet))
    has_trailing = _drop_trailing_cells(records, width) or len(names) > width
    if has_trailing and not raw.sheet:
        notes.append("empty cells behind the last column are left out")
    names = _complete_column_names(names[:width], records, bool(raw.sheet), place, raises)
    units = _pop_unit_row(records, names, notes)
    table = TextTable(
        names=tuple(names),
        rows=[record.cells for record in records],
        places=[record.line for record in records],
        file=file,
        units=units,
        sheet=raw.sheet,
    )
    notation = _choose_notation(table, layout, raises)
    if notation.decimal == "," and layout.decimal is None:
        notes.append("numbers are written with decimal commas")
    table = replace(table, notation=notation, notes=tuple(notes))
    return _blank_declared_values(table, layout)


def _blank_declared_values(table: TextTable, layout: TableLayout) -> TextTable:
    """Return a table whose cells are empty where a declared missing value stands, and say so."""
    declared = layout.missing_values
    if declared is None:
        return table
    rule = DeclaredMissing(declared, table.notation)
    rows = [rule.blank_cells(row) for row in table.rows]
    notes = [*table.notes, *rule.describe_found_values()]
    return replace(table, rows=rows, notes=tuple(notes), finds_fills=False)


def _pop_header(records: list[Record], comments: Sequence[Record], notes: list[str]) -> list[str]:
    """Take the names of the columns off the rows; behind a comment's mark where no others are."""
    if not records:
        return []
    first = records[0].cells
    behind_mark = _read_comment_names(comments, count_cells(first))
    if behind_mark and _are_numbers(first):
        notes.append(f"columns are named by the comment in line {comments[-1].line}")
        return behind_mark
    return records.pop(0).cells


def _read_comment_names(comments: Sequence[Record], column_count: int) -> list[str]:
    """Return what the last comment above a table names, if it names as many columns."""
    if not comments:
        return []
    names = [cell for cell in comments[-1].cells if cell]
    if names:
        names[0] = names[0].lstrip("#%/ ")
    if names and not names[0]:
        names = names[1:]
    return names if len(names) == column_count else []


def _are_numbers(cells: Sequence[str]) -> bool:
    """Tell whether all filled cells of a row are numbers."""
    return all(is_number_in_any_notation(cell) for cell in cells if cell)


def _count_columns(records: Sequence[Record], names: Sequence[str]) -> int:
    """Count the columns: those of the header, else of the rows without trailing empty cells."""
    if names:
        return count_cells(names)
    filled = max((count_cells(record.cells) for record in records), default=0)
    shortest = min((len(record.cells) for record in records), default=0)
    return max(filled, shortest)


def _all_have_width(records: Sequence[Record], width: int) -> bool:
    """Tell whether all rows have `width` cells."""
    return {len(record.cells) for record in records} <= {width}


def _refuse_ragged_rows(
    records: Sequence[Record],
    width: int,
    place: str,
    raises: type[StepblocksError],
    is_sheet_row: bool,
) -> None:
    """Refuse rows with more filled cells than columns, or, in a text, with fewer cells."""
    if _all_have_width(records, width):
        return
    unit = "row" if is_sheet_row else "line"
    mistakes: list[Mistake] = []
    further = 0
    for record in records:
        cells = record.cells
        filled = count_cells(cells)
        is_short = len(cells) < width and not is_sheet_row
        if filled <= width and not is_short:
            continue
        if len(mistakes) == _MOST_ROWS_NAMED:
            further += 1
            continue
        shown = shorten_value(",".join(cells)[:_MOST_SHOWN])
        count = max(filled, min(len(cells), width))
        rule = f"a row must have {width} cells as the header, got {count}: {shown}"
        mistakes.append((f"{unit} {record.line}", rule))
    if further:
        mistakes.append(("", f"{further} further rows have another number of cells"))
    if mistakes:
        raise raises(format_mistakes(mistakes, place))


def _drop_trailing_cells(records: list[Record], width: int) -> bool:
    """Drop empty cells after the last column, in place; return whether there were any."""
    if _all_have_width(records, width):
        return False
    has_trailing = False
    for number, record in enumerate(records):
        cells = record.cells
        if len(cells) > width and count_cells(cells) <= width:
            has_trailing = True
            records[number] = Record(record.line, cells[:width])
    return has_trailing


def _complete_column_names(
    names: Sequence[str],
    records: Sequence[Record],
    is_sheet_row: bool,
    place: str,
    raises: type[StepblocksError],
) -> list[str]:
    """Return names that differ; a column without one is named by its number.

    Raises
    ------
    StepblocksError
        If a name stands twice, or a column of a sheet that holds anything has none.
    """
    named = []
    for number, name in enumerate(names):
        if name:
            if name in named:
                raise raises(f"table must not name a column twice, got {name!r} [{place}]")
            named.append(name)
            continue
        if is_sheet_row and any(any(record.cells[number : number + 1]) for record in records):
            raise raises(
                "each column that holds anything must have a name in the first row (merged cells "
                f"have one for all) [{place}, cell {name_sheet_column(number)}1]"
            )
        named.append(f"Unnamed: {number}")
    return named


def _drop_dash_row(records: list[Record], notes: list[str]) -> None:
    """Leave out a row of dashes that is drawn below the header."""
    if not records:
        return
    filled = [cell for cell in records[0].cells if cell]
    if all(_RULE.fullmatch(cell) for cell in filled):
        notes.append(f"line {records[0].line} is a rule and left out")
        records.pop(0)


def _pop_unit_row(records: list[Record], names: Sequence[str], notes: list[str]) -> tuple[str, ...]:
    """Take a row of units off the rows: below the header, above columns of numbers."""
    if len(records) < 2 or not names:
        return ()
    first, following = records[0].cells, records[1].cells
    is_above_number = False
    for cell, below in zip(first, following, strict=False):
        if not cell:
            continue
        is_unit = len(cell) <= _LONGEST_UNIT and _UNIT.fullmatch(cell) is not None
        if not is_unit:
            return ()
        if is_number_in_any_notation(below) and cell not in ("1", "-"):
            is_above_number = True
    if not is_above_number:
        return ()
    units = tuple(cell.strip("[]() ") for cell in first)
    notes.append(f"line {records[0].line} holds units: {', '.join(filter(None, units))}")
    records.pop(0)
    return units


def _choose_notation(
    table: TextTable, layout: TableLayout, raises: type[StepblocksError]
) -> NumberNotation:
    """Return the notation of a table's numbers, as declared or as found in its columns of numbers.

    The cells of a sheet are numbers already.
    """
    if layout.decimal is not None:
        return NumberNotation(layout.decimal)
    if table.sheet:
        return NumberNotation()
    try:
        return find_number_notation(_yield_cells_for_notation(table))
    except NotationError as error:
        row = _find_first_row_with_cell(table, error.number)
        raise raises(f"{error} [{table.file}, {table.name_place_of_row(row)}]") from error


def _find_first_row_with_cell(table: TextTable, cell: str) -> int:
    """Return the first row that holds a cell, counted from 0."""
    for row, cells in enumerate(table.rows):
        if cell in cells:
            return row
    return 0


def _yield_cells_for_notation(table: TextTable) -> Iterator[str]:
    """Yield the cells by which the notation is found: all of columns that are mostly numbers.

    None where no such column has a comma: plain numbers need no search.
    """
    columns: Iterable[int] = range(table.column_count)
    with_comma = [column for column in columns if _has_comma(table, column)]
    if not any(_is_mostly_numbers(table.get_cells(column)) for column in with_comma):
        return
    for column in columns:
        cells = table.get_cells(column)
        if _is_mostly_numbers(cells):
            yield from cells


def _has_comma(table: TextTable, column: int) -> bool:
    """Tell whether a cell of a column has a comma, or points that cannot all be decimal."""
    return any("," in cell or cell.count(".") > 1 for cell in table.get_cells(column))


def _is_mostly_numbers(cells: Sequence[str]) -> bool:
    """Tell whether more than half of the filled cells of a column are numbers."""
    filled = [cell for cell in cells if not is_missing_word(cell)]
    numbers = sum(is_number_in_any_notation(cell) for cell in filled)
    return 2 * numbers > len(filled)
