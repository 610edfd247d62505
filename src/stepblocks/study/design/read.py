"""Read designs and filled-in run sheets, each row with its place in the file."""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TextIO

from stepblocks.errors import StudyError
from stepblocks.files.text import measure_file_size
from stepblocks.study.columns import Row, read_number
from stepblocks.study.design.sheet import list_answer_columns
from stepblocks.study.design.trials import DESIGN_COLUMNS
from stepblocks.study.experiments.registry import EXPERIMENTS

_MISSING = ("NA", "N/A", "n/a", "#N/A", "<NA>")  # as R, BIDS, spreadsheets and pandas write it
_MAX_BYTES = 100_000_000
_SEPARATORS = ",;\t"
# a decimal comma, as spreadsheets of half of Europe write it
_DECIMAL_COMMA = re.compile(r"^(-?\d+),(\d+)$")


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
    """

    cells: Row
    file: str
    line: int

    @property
    def place(self) -> str:
        """Where the row stands."""
        return f"{self.file}, line {self.line}"

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
    rows = read_rows(path, DESIGN_COLUMNS)
    experiments = sorted({row.cells["experiment"] for row in rows})
    if len(experiments) != 1 or experiments[0] not in EXPERIMENTS:
        raise StudyError(
            f"experiment must be one of {', '.join(EXPERIMENTS)}, the same in all rows, got "
            f"{experiments} [{path}]"
        )
    index_by_trial(rows)
    for row in rows:
        _check_heights(row)
    return [dict(row.cells) for row in rows]


def _check_heights(row: SheetRow) -> None:
    """Reject a block or standard without a height."""
    columns = ["height_um"]
    if row.cells["standard"]:
        columns.append("standard_height_um")
    for name in columns:
        if not read_number(row.cells[name]) > 0.0:
            raise StudyError(
                f"{name} must be a positive number, got {row.cells[name]!r} [{row.place}]"
            )


def read_answers(path: Path, experiment: str) -> list[SheetRow]:
    """Read filled-in run sheets; one in which no trial is answered yet has no rows."""
    return read_rows(path, list_answer_columns(experiment), empty=True)


def read_all_answers(paths: Sequence[str | Path], experiment: str) -> list[SheetRow]:
    """Read all filled-in run sheets of files and folders."""
    rows = []
    for path in find_sheets(paths):
        rows += read_answers(path, experiment)
    return rows


def find_sheets(paths: Sequence[str | Path]) -> list[Path]:
    """Find the CSV files in folders.

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
            sheets += sorted(path.glob("*.csv"))
        else:
            sheets.append(path)
    if not sheets:
        raise StudyError(
            f"a folder of sheets must hold CSV files, got none [{', '.join(map(str, paths))}]"
        )
    return sheets


def read_rows(path: Path, columns: Sequence[str], empty: bool = False) -> list[SheetRow]:
    """Read a table of texts whose cells are separated by commas, semicolons or tabs.

    Parameters
    ----------
    path : Path
        CSV with a header, in UTF-8.
    columns : sequence of str
        That the table must have.
    empty : bool
        Whether it may have no rows.

    Returns
    -------
    list of SheetRow
        Missing values are empty texts; decimal commas are points where cells are not separated by
        commas.

    Raises
    ------
    StudyError
        If the file cannot be read, or is no such table.
    """
    # a general reader of tables would not know the lines
    try:
        size = measure_file_size(path)
        if size > _MAX_BYTES:
            raise StudyError(
                f"a table must be below {_MAX_BYTES // 1_000_000} MB, got {size} bytes [{path}]"
            )
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(_parse_rows(stream, path, columns))
    except OSError as error:
        raise StudyError(f"a table cannot be read: {error.strerror} [{path}]") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise StudyError(f"a table must be CSV in UTF-8: {error} [{path}]") from error
    if not rows and not empty:
        raise StudyError(f"a table must have rows, got none [{path}]")
    return rows


def _parse_rows(stream: TextIO, path: Path, columns: Sequence[str]) -> Iterator[SheetRow]:
    """Yield the rows of a table; `path` is for messages."""
    header = stream.readline()
    stream.seek(0)
    separator = max(_SEPARATORS, key=header.count)
    reader = csv.DictReader(stream, strict=True, delimiter=separator)
    names = [name.strip() for name in reader.fieldnames or []]
    reader.fieldnames = names
    _check_header(names, columns, path)
    for row in reader:
        if None in row or None in row.values():  # too many cells, or too few
            raise StudyError(
                f"a row must have {len(names)} cells, as the header "
                f"[{path}, line {reader.line_num}]"
            )
        cells = {name: _clean_cell(row[name], separator) for name in names}
        yield SheetRow(cells, str(path), reader.line_num)


def _check_header(names: Sequence[str], columns: Sequence[str], path: Path) -> None:
    """Reject a table that lacks a column or names one twice."""
    lacking = [name for name in columns if name not in names]
    if lacking:
        raise StudyError(
            f"columns must include {', '.join(columns)}; got no {', '.join(lacking)} [{path}]"
        )
    if len(set(names)) != len(names):
        raise StudyError(f"columns must differ from each other, got one twice [{path}, line 1]")


def _clean_cell(text: str, separator: str) -> str:
    """Return a cell without outer spaces; missing values are empty."""
    text = text.strip()
    if text in _MISSING:
        return ""
    if separator == ",":
        return text
    return _DECIMAL_COMMA.sub(r"\1.\2", text)


def index_by_trial(rows: Sequence[SheetRow]) -> dict[TrialKey, SheetRow]:
    """Return rows by their trials; refuse a trial that stands twice."""
    by_trial: dict[TrialKey, SheetRow] = {}
    for row in rows:
        first = by_trial.get(row.key)
        if first is not None:
            raise StudyError(
                f"participant and trial must occur once, got {row.key.participant!r} and "
                f"{row.key.trial!r} twice [{row.place}; first {first.place}]"
            )
        by_trial[row.key] = row
    return by_trial
