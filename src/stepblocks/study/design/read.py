"""Read designs and filled-in run sheets, each row with its place in the file."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from stepblocks.errors import StudyError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.numbers import NumberNotation, is_plain_number
from stepblocks.files.tables import warn_of_notes
from stepblocks.files.text_table import TextTable, is_table_name
from stepblocks.study.columns import NamedColumns, Row, read_number_or_nan
from stepblocks.study.design.sheet import list_sheet_columns
from stepblocks.study.design.trials import DESIGN_COLUMNS
from stepblocks.study.experiments.registry import EXPERIMENTS
from stepblocks.study.programs.melt import melt_table
from stepblocks.study.programs.records import (
    AnswerSearch,
    convert_records,
    has_json_suffix,
    read_program_table,
)

_MISSING = ("NA", "N/A", "n/a", "#N/A", "<NA>")  # as R, BIDS, spreadsheets and pandas write it
_MAX_BYTES = 100_000_000
_HEAD_BYTES = 64  # that tell a list from another JSON document
_NAMES = ("participant", "condition", "group")  # columns in which NA is a name


class TrialKey(NamedTuple):
    """Which trial of a study."""

    participant: str
    trial: str


@dataclass(frozen=True)
class SheetRow:
    """A row of a table that people write.

    Attributes
    ----------
    cells : mapping of str
        Texts by column.
    file : str
        Path of the table.
    line : int
        Number of the line, from 1.
    unit : str
        What is numbered: ``"line"`` of a table, ``"record"`` of a JSON document.
    """

    cells: Row
    file: str
    line: int
    unit: str = "line"

    @property
    def place(self) -> str:
        """Where the row stands."""
        return f"{self.file}, {self.unit} {self.line}"

    @property
    def key(self) -> TrialKey:
        """Which trial the row is of."""
        return TrialKey(self.cells["participant"], self.cells["trial"])


def read_design(path: Path) -> list[dict[str, str]]:
    """Read the rows of design.csv.

    Raises
    ------
    StudyError
        If there is none, its experiment is unknown, a trial stands twice, or a height is no
        positive number.
    """
    if not path.exists():
        raise StudyError(
            f"a study must be a folder that 'stepblocks study design' wrote, got no {path.name} "
            f"[{path}]"
        )
    rows = read_sheet_rows(path, DESIGN_COLUMNS)
    experiments = sorted({row.cells["experiment"] for row in rows})
    if len(experiments) != 1 or experiments[0] not in EXPERIMENTS:
        raise StudyError(
            f"experiment must be one of {', '.join(EXPERIMENTS)}, the same in all rows, got "
            f"{experiments} [{path}]"
        )
    index_by_trial(rows)
    for row in rows:
        _refuse_missing_heights(row)
    return [dict(row.cells) for row in rows]


def _refuse_missing_heights(row: SheetRow) -> None:
    """Reject a block or standard without a height."""
    columns = ["height_um"]
    if row.cells["standard"]:
        columns.append("standard_height_um")
    for name in columns:
        if not read_number_or_nan(row.cells[name]) > 0.0:
            raise StudyError(
                f"{name} must be a positive number, got {row.cells[name]!r} [{row.place}]"
            )


def read_answers(
    path: Path,
    experiment: str,
    columns: Mapping[str, str] = MappingProxyType({}),
    layout: TableLayout = UNDECLARED,
) -> list[SheetRow]:
    """Read filled-in run sheets, or the records of a program that ran the trials of a design.

    A sheet in which no trial is answered yet has no rows. `columns` are theirs by ours, of records
    in which it is not clear where an answer stands.
    """
    named = NamedColumns(columns)
    search = AnswerSearch(EXPERIMENTS[experiment].answers, named)
    columns_of_answers = list_sheet_columns(experiment)
    wanted = list(map(named.get_table_name, columns_of_answers))
    names = list(map(named.get_table_name, _NAMES))
    rows = read_sheet_rows(
        path, wanted, may_be_empty=True, name_columns=names, search=search, layout=layout
    )
    return [_add_our_columns(row, columns_of_answers, named) for row in rows]


def _add_our_columns(
    row: SheetRow, our_columns: Sequence[str], named_columns: NamedColumns
) -> SheetRow:
    """Give a row some of our columns, as the user says what they are called."""
    cells = {**row.cells}
    for name in our_columns:
        text = named_columns.read_cell(row.cells, name)
        if text is not None:
            cells[name] = text
    return replace(row, cells=cells)


def read_all_answers(
    paths: Sequence[str | Path],
    experiment: str,
    columns: Mapping[str, str] = MappingProxyType({}),
    layout: TableLayout = UNDECLARED,
) -> list[SheetRow]:
    """Read all filled-in run sheets of files and folders; see `read_answers`."""
    rows = []
    for path in find_answer_tables(paths):
        rows += read_answers(path, experiment, columns, layout)
    return rows


def find_answer_tables(paths: Sequence[str | Path]) -> list[Path]:
    """Find the tables in folders.

    Datasets as `share_study` writes them lead to their tables.

    Raises
    ------
    StudyError
        If there are none.
    """
    sheets = list[Path]()
    for path in map(Path, paths):
        shared = sorted([*path.glob("sub-*/beh/*_beh.tsv"), *path.glob("data/**/*_data.csv")])
        if shared:
            sheets += shared
        elif path.is_dir():
            sheets += sorted(filter(_is_judgement_file, path.iterdir()))
        else:
            sheets.append(path)
    if not sheets:
        raise StudyError(
            f"a folder of sheets must hold CSV files, got none [{', '.join(map(str, paths))}]"
        )
    return sheets


def _is_judgement_file(path: Path) -> bool:
    """Tell whether a file in a folder is a table, or the list of records that jsPsych writes."""
    if not has_json_suffix(path):
        return is_table_name(path)
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"[")


def read_sheet_rows(
    path: Path,
    columns: Sequence[str],
    may_be_empty: bool = False,
    name_columns: Collection[str] = _NAMES,
    *,
    search: AnswerSearch | None = None,
    wide_pattern: str = "",
    layout: TableLayout = UNDECLARED,
) -> list[SheetRow]:
    """Read a table that people write: CSV in any dialect, or a sheet of a workbook.

    Parameters
    ----------
    path : Path
        Table with a header.
    columns : sequence of str
        That the table must have.
    may_be_empty : bool
        Whether it may have no rows; a table without rows is refused otherwise.
    name_columns : collection of str
        Columns of names, in which a person may be called NA.
    search : AnswerSearch, optional
        What to look for in the records of another program; without it they are read as they stand.
    wide_pattern : str
        How a table calls its columns that has a column for each trial, as `melt_table` takes it.
    layout : TableLayout
        What is declared of it.

    Returns
    -------
    list of SheetRow
        Missing values are empty texts; numbers have a decimal point.

    Raises
    ------
    StudyError
        If the file cannot be read, or is no such table.
    """
    table = read_program_table(path, layout, _MAX_BYTES)
    if search is not None:
        table = convert_records(table, search)
    if search is not None and wide_pattern:
        table = melt_table(table, wide_pattern, search)
    lacking = [name for name in columns if name not in table.names]
    if lacking:
        raise StudyError(
            f"columns must include {', '.join(columns)}; got no {', '.join(lacking)}, but "
            f"{', '.join(table.names):.200} [{path}]"
        )
    if not table.rows and not may_be_empty:
        raise StudyError(f"a table must have rows, got none [{path}]")
    warn_of_notes(table.notes, path)
    cleaned = {}
    for number, name in enumerate(table.names):
        cells = table.get_cells(number)
        if name not in name_columns:
            cells = _clean_column_cells(table, number)
        cleaned[name] = cells
    file = str(path)
    if table.sheet:
        file = f"{path}, {table.sheet}"
    unit = "line"
    if has_json_suffix(path):
        unit = "record"
    rows = []
    for row, line in enumerate(table.places):
        cells_of_row = {name: cells[row] for name, cells in cleaned.items()}
        rows.append(SheetRow(cells_of_row, file, line, unit))
    return rows


def _blank_missing_cell(cell: str) -> str:
    """Return a cell, empty where it says that a value is missing."""
    if cell in _MISSING:
        return ""
    return cell


def _clean_column_cells(table: TextTable, column_index: int) -> list[str]:
    """Return the cells of a column: numbers with a decimal point, missing values empty.

    In text columns, too, ``n/a`` and the like mean a missing answer, as in BIDS.
    """
    cells = table.get_cells(column_index)
    if not table.holds_numbers(column_index):
        return list(map(_blank_missing_cell, cells))
    found = table.require_numbers(column_index, StudyError)
    found = replace(found, words=())  # the notes of a study count the missing answers
    warn_of_notes(
        filter(None, [found.describe_missing_values(table.names[column_index])]), table.file
    )
    cleaned = []
    for cell, value in zip(cells, found.values.tolist(), strict=True):
        cleaned.append(_format_plain_number(cell, value, table.notation))
    return cleaned


def _format_plain_number(cell: str, value: float, notation: NumberNotation) -> str:
    """Return a number with a decimal point, as it is written where that is plain."""
    if math.isnan(value):
        return ""
    if is_plain_number(cell) and (notation.decimal == "." or "." not in cell):
        return cell
    return f"{value:.15g}"


def index_by_trial(rows: Sequence[SheetRow]) -> dict[TrialKey, SheetRow]:
    """Return rows by their trials; refuse a trial that stands twice."""
    by_trial: dict[TrialKey, SheetRow] = {}
    repeated = []
    for row in rows:
        if row.key in by_trial:
            repeated.append(row)
        else:
            by_trial[row.key] = row
    if repeated:
        row = repeated[0]
        others = ""
        if len(repeated) > 1:
            others = f", and {len(repeated) - 1} more"
        raise StudyError(
            f"participant and trial must occur once, got {row.key.participant!r} and "
            f"{row.key.trial!r} twice{others} [{row.place}; first {by_trial[row.key].place}]"
        )
    return by_trial
