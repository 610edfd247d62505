"""How the text of a table is laid out: what separates its cells, what quotes them, its comments.

One layout is found for the whole file, from its first rows.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stepblocks.files.missing import is_missing_word
from stepblocks.files.numbers import NumberNotation, is_plain_number
from stepblocks.files.raw_table import Record

__all__ = [
    "BLANKS",
    "Dialect",
    "count_cells",
    "find_dialect",
    "find_quotation_mark",
    "is_number_in_any_notation",
    "list_first_row_lines",
    "split_records",
]

BLANKS = " "  # any run of blanks between two cells
_SEPARATORS = (",", ";", "\t", "|", BLANKS)  # in the order of preference
_SAMPLED_LINES = 200
# behind a mark; what a spreadsheet writes for an error, as #N/A or #VALUE!, is a cell
_COMMENT = re.compile(r"\s*(#(?!\d|N/A|NA\b|[A-Z]+[!?]|DIV/0!)|//|%(?=\s))")
_COMMENT_STARTS = ("#", "/", "%")
_DECLARED_SEPARATOR = re.compile(r"sep=(.)\s*", re.IGNORECASE)  # the first line of an Excel's CSV
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", BLANKS: "blanks"}
_NOTATIONS = (NumberNotation("."), NumberNotation(","))


@dataclass(frozen=True)
class Dialect:
    """What separates and quotes the cells of a table.

    Attributes
    ----------
    separator : str
        One letter; `BLANKS` for any run of blanks.
    quote : str
        Around a cell that holds a separator or a line's end.
    """

    separator: str = ","
    quote: str = '"'

    @property
    def separator_in_words(self) -> str:
        """What separates the cells, in words."""
        return _NAMES.get(self.separator, repr(self.separator))

    def split_rows(self, text: str) -> Iterator[Record]:
        """Yield the rows of a text.

        Raises
        ------
        csv.Error
            If a quote is not closed, or a cell is beyond the bounds of a table.
        """
        is_blank = self.separator == BLANKS
        if self.quote not in text and not is_blank:
            yield from self._split_plain_lines(text)
            return
        if is_blank:
            text = text.replace("\t", BLANKS)
        reader = csv.reader(
            io.StringIO(text, newline=None),
            delimiter=self.separator,
            quotechar=self.quote,
            skipinitialspace=not is_blank,  # Python takes only one of them
            strict=True,
        )
        line = 1
        for cells in reader:
            yield Record(line, self._clean_cells(cells))
            line = reader.line_num + 1

    def _split_plain_lines(self, text: str) -> Iterator[Record]:
        """Yield the rows of a text without a quotation mark, as `split` does."""
        has_blanks = " " in text or "\t" in text or "\u00a0" in text
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        for number, line in enumerate(lines, start=1):
            cells = line.split(self.separator)
            if has_blanks:
                cells = list(map(str.strip, cells))
            yield Record(number, cells)

    def _clean_cells(self, cells: list[str]) -> list[str]:
        """Return cells without the blanks around them; of a run of blanks, one separates."""
        cleaned = list(map(str.strip, cells))
        if self.separator != BLANKS:
            return cleaned
        return list(filter(None, cleaned))


def find_dialect(text: str, separator: str | None = None) -> Dialect:
    """Find what separates and quotes the cells of a table.

    Parameters
    ----------
    text : str
        The table, its header first.
    separator : str, optional
        What is declared; by default it is found.

    Returns
    -------
    Dialect
        The one in which most rows have as many cells as the first, and most cells are numbers.
    """
    lines = list_first_row_lines(text)
    quote = find_quotation_mark(lines)
    if separator is not None:
        return Dialect(separator, quote)
    declared = _DECLARED_SEPARATOR.fullmatch(text.partition("\n")[0])
    if declared:
        return Dialect(declared[1], quote)
    sample = "\n".join(lines)
    best = Dialect(quote=quote)
    best_score = _UNRATED
    for candidate in _SEPARATORS:
        dialect = Dialect(candidate, quote)
        score = _rate_dialect(dialect, sample)
        if score > best_score:
            best, best_score = dialect, score
    return best


def split_records(text: str, dialect: Dialect) -> tuple[list[Record], list[Record]]:
    """Split a text into its rows and the comments before the first of them.

    Lines without a cell that holds anything, comments further down and the line ``sep=;`` are left
    out.

    Raises
    ------
    csv.Error
        If the text is no table in the dialect.
    """
    records: list[Record] = []
    comments: list[Record] = []
    for record in dialect.split_rows(text):
        if record.is_empty:
            continue
        first = record.cells[0]
        if record.line == 1 and _is_separator_line(record, dialect):
            continue
        if first[:1] in _COMMENT_STARTS and _COMMENT.match(first):
            if not records:
                comments.append(record)
            continue
        records.append(record)
    return records, comments


def is_number_in_any_notation(cell: str) -> bool:
    """Tell whether a cell is a number with a decimal point or a decimal comma."""
    if is_plain_number(cell):
        return True
    for notation in _NOTATIONS:
        try:
            notation.parse_number(cell)
        except ValueError:
            continue
        return True
    return False


def _is_separator_line(record: Record, dialect: Dialect) -> bool:
    """Tell whether a row is ``sep=;``, which its own separator cuts into ``sep=`` and nothing."""
    written = record.cells[0].lower()
    return written == "sep=" or written == f"sep={dialect.separator}"


def list_first_row_lines(text: str) -> list[str]:
    """Return the first lines of a text that hold a row."""
    lines = []
    for line in io.StringIO(text, newline=None):
        if not line.strip() or _COMMENT.match(line) or _DECLARED_SEPARATOR.fullmatch(line):
            continue
        lines.append(line.rstrip("\n"))
        if len(lines) == _SAMPLED_LINES:
            break
    return lines


def find_quotation_mark(lines: Sequence[str]) -> str:
    """Return the quotation mark of lines: single ones only where they begin most of them."""
    if not lines:
        return '"'
    single = [line for line in lines if line.startswith("'") and line.rstrip(",;\t|").endswith("'")]
    return "'" if len(single) > len(lines) / 2 else '"'


class _DialectScore(NamedTuple):
    """How well a dialect fits a sample; of two scores the larger one is the better."""

    fitting_share: float  # of the rows that have as many cells as the first
    number_share: float  # of the filled cells below it
    column_count: int


_UNRATED = _DialectScore(0.0, 0.0, 0)


def _rate_dialect(dialect: Dialect, sample: str) -> _DialectScore:
    """Rate how well a dialect fits a sample; only a table of two columns or more is rated."""
    try:
        records = [record for record in dialect.split_rows(sample) if not record.is_empty]
    except csv.Error:
        records = _split_without_last_lines(dialect, sample)
    if not records:
        return _UNRATED
    widths = Counter(count_cells(record.cells) for record in records)
    columns = count_cells(records[0].cells)
    usual, _ = widths.most_common(1)[0]
    if columns < 2 and usual < 2:
        return _UNRATED
    fitting = 0  # of a line of text above the table
    if columns >= 2:
        fitting = _count_fitting_rows(records, columns)
    below = records[1:] or records
    return _DialectScore(fitting / len(records), _compute_number_share(below), columns)


def _count_fitting_rows(records: Sequence[Record], column_count: int) -> int:
    """Count the rows with as many cells as the first, with or without the empty ones at the end."""
    width = len(records[0].cells)
    fitting = 0
    for record in records:
        if count_cells(record.cells) == column_count or len(record.cells) == width:
            fitting += 1
    return fitting


def _split_without_last_lines(dialect: Dialect, sample: str) -> list[Record]:
    """Split a sample that ends within a quoted cell, up to the row before that cell."""
    records = []
    try:
        for record in dialect.split_rows(sample):
            if not record.is_empty:
                records.append(record)
    except csv.Error:
        return records
    return records


def count_cells(cells: Sequence[str]) -> int:
    """Count the cells of a row without the empty ones at its end."""
    count = len(cells)
    while count and not cells[count - 1]:
        count -= 1
    return count


def _compute_number_share(records: Iterable[Record]) -> float:
    """Compute the share of the filled cells that are numbers or stand for a missing one."""
    numbers = 0
    filled = 0
    for record in records:
        for cell in record.cells:
            if not cell:
                continue
            filled += 1
            if is_number_in_any_notation(cell) or is_missing_word(cell):
                numbers += 1
    return numbers / filled if filled else 0.0
