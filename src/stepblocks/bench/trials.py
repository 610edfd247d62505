"""The table of trials, row by row, with the conditions of each trial in SI."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from stepblocks.bench.faults import FaultKind, TrialFault
from stepblocks.bench.session import Session
from stepblocks.errors import BenchError
from stepblocks.files.layout import TableLayout
from stepblocks.files.missing import is_missing_word
from stepblocks.files.tables import warn_of_notes
from stepblocks.files.text_table import TableShape, TextTable, read_text_table
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes

_MOST_COLUMNS = 1000
_SHOWN_COLUMNS = 12  # that a message lists
_SHOWN_LETTERS = 40  # of a cell that a message shows
_OPTIONAL_COLUMNS = ("speed", "load", "block", "height")  # of `TrialColumns`


@dataclass(frozen=True)
class Trial:
    """One row of the table of trials; NaN and empty where the table has no such column.

    Attributes
    ----------
    name : str
        As the table writes it.
    row : int
        Counted from 1 below the header.
    cells : dict[str, str]
        Every cell of the row, as written.
    speed : float
        Of the handle [m/s].
    load : float
        Normal load that the weights set [N].
    block : str
    fault : TrialFault or None
        Why the row cannot be used; None where it can.
    record : str
        Name of the trial whose record belongs to the row: another where session.toml swaps them.
    """

    name: str
    row: int
    cells: dict[str, str] = field(default_factory=dict)
    speed: float = math.nan
    load: float = math.nan
    block: str = ""
    fault: TrialFault | None = None
    record: str = ""


class _NumberColumn(NamedTuple):
    """A column of positive numbers with factor and offset to SI."""

    name: str
    scale: float
    offset: float


@dataclass(frozen=True)
class TrialTable:
    """A table of trials that was looked through once.

    Attributes
    ----------
    session : Session
    table : TextTable
        Header and rows as the file writes them.
    key : str
        Name of the column that names the trial.
    count : int
        Number of rows.
    repeated : dict[int, TrialFault]
        Rows, from 1, whose trial another row has, and what is wrong with that.
    excluded : frozenset of str
        Trials that session.toml leaves out.
    swapped : mapping of str to str
        Trials whose records session.toml exchanges.
    """

    session: Session
    table: TextTable
    key: str
    count: int
    repeated: dict[int, TrialFault]
    excluded: frozenset[str] = frozenset()
    swapped: Mapping[str, str] = field(default_factory=dict)

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.table.names

    @property
    def covariates(self) -> tuple[str, ...]:
        """All columns except that of the trial, as the table names them."""
        return tuple(column for column in self.header if column != self.key)

    def __iter__(self) -> Iterator[Trial]:
        columns = self.session.trials.columns
        place = "trials.columns"
        speed_column = _NumberColumn(
            str(columns.speed.column),
            columns.speed.find_factor_to_si("speed", place),
            columns.speed.find_offset_in_si("speed", place),
        )
        load_column = _NumberColumn(
            str(columns.load.column),
            columns.load.find_factor_to_si("force", place),
            columns.load.find_offset_in_si("force", place),
        )
        for row, cells in enumerate(self.table.rows, start=1):
            trial = self._build_trial(row, cells)
            try:
                speed = self._read_condition(trial.cells, speed_column)
                load = self._read_condition(trial.cells, load_column)
            except ValueError as error:
                fault = trial.fault or TrialFault(FaultKind.WITHOUT_HEADING, str(error))
                yield replace(trial, fault=fault)
            else:
                yield replace(trial, speed=speed, load=load)

    def _build_trial(self, row: int, cells: list[str]) -> Trial:
        """Return a trial without its conditions in SI."""
        padded = cells + [""] * len(self.header)
        named = dict(zip(self.header, padded, strict=False))
        name = named[self.key].strip()
        block_column = str(self.session.trials.columns.block.column)
        return Trial(
            name,
            row,
            named,
            block=named.get(block_column, "").strip(),
            fault=self._find_row_fault(row, name, len(cells)),
            record=self.swapped.get(name, name),
        )

    def _find_row_fault(self, row: int, trial_name: str, cell_count: int) -> TrialFault | None:
        """Say why a row cannot be used; None where it can."""
        if trial_name in self.excluded:
            details = "left out by `trials.exclude` of session.toml"
            return TrialFault(FaultKind.WITHOUT_HEADING, details)
        if cell_count != len(self.header):
            return TrialFault(
                FaultKind.WITHOUT_HEADING,
                f"row {row} of the table ({self.table.name_place_of_row(row - 1)}) has "
                f"{cell_count} cells, the header has {len(self.header)}",
            )
        if row in self.repeated:
            return self.repeated[row]
        if not trial_name:
            details = f"row {row} of the table names no trial"
            return TrialFault(FaultKind.WITHOUT_HEADING, details)
        return None

    def _read_condition(self, cells: Mapping[str, str], column: _NumberColumn) -> float:
        """Return a condition in SI, NaN without its column; raise `ValueError` if unsound."""
        if column.name not in cells:
            return math.nan
        text = cells[column.name].strip()
        shown = text[:_SHOWN_LETTERS]
        try:
            value = math.nan
            if not text or not is_missing_word(text):
                value = self.table.notation.parse_number(text)
        except ValueError:
            raise ValueError(f"{column.name} must be a number, got {shown!r}") from None
        if not math.isfinite(value) or value <= 0.0:
            raise ValueError(f"{column.name} must be positive and finite, got {shown}")
        return value * column.scale - column.offset


def open_trials(session: Session, reserved: frozenset[str] = frozenset()) -> TrialTable:
    """Read the table of trials once: header, number of rows, duplicates.

    What had to be found out about its file is said.

    Parameters
    ----------
    session : Session
    reserved : frozenset of str
        Names that no column but that of the trial may have.

    Raises
    ------
    BenchError
        With all that is wrong with header or rows.
    """
    table = _read_trial_table(session)
    header = table.names
    key = _find_trial_column(session, table, reserved)
    rows = _scan_for_repeated_trials(table, header.index(key))
    if rows.count == 0:
        raise BenchError(f"table of trials has no rows [{session.table}]")
    declared_names = _match_declared_trials(session, rows.names)
    swapped: dict[str, str] = {}
    for first, second in session.trials.swap:
        swapped[declared_names[first]] = declared_names[second]
        swapped[declared_names[second]] = declared_names[first]
    return TrialTable(
        session,
        table,
        key,
        rows.count,
        rows.repeated,
        excluded=frozenset(declared_names[name] for name in session.trials.exclude),
        swapped=swapped,
    )


def _read_trial_table(session: Session) -> TextTable:
    """Read header and rows of the table of trials, rows of another length as they are."""
    declared = session.trials
    layout = TableLayout(declared.delimiter, declared.decimal, declared.encoding, declared.missing)
    shape = TableShape(keeps_ragged=True)
    table = read_text_table(session.table, layout, BenchError, shape=shape)
    if not table.names:
        raise BenchError(f"table of trials is empty [{session.table}]")
    if len(table.names) > _MOST_COLUMNS:
        raise BenchError(
            f"table of trials must have at most {_MOST_COLUMNS} columns, got {len(table.names)}"
        )
    warn_of_notes(table.notes, session.table)
    return table


def _find_trial_column(session: Session, table: TextTable, reserved: frozenset[str]) -> str:
    """Return the column of the trial's name; refuse a header with missing or reserved names."""
    header = table.names
    columns = session.trials.columns
    mistakes: list[Mistake] = []
    key = None
    with collect_mistakes(mistakes):
        key = find_declared_column(columns.trial.column, header, "trial")
    for part in _OPTIONAL_COLUMNS:
        if part in columns.model_fields_set:
            with collect_mistakes(mistakes):
                find_declared_column(getattr(columns, part).column, header, part)
    for name in sorted(set(header) & reserved - {key}):
        text = f"column `{name}` of the table of trials has a name that features use"
        mistakes.append(("", text))
    if mistakes or key is None:
        raise BenchError(format_mistakes(mistakes, table.place))
    return key


def find_declared_column(column: str | int, header: tuple[str, ...], part: str) -> str:
    """Return the name of a declared column.

    Parameters
    ----------
    column : str or int
        Name, or index from 0.
    header : tuple of str
    part : str
        What the column holds, for the message.

    Raises
    ------
    BenchError
        If the table has no such column; the message lists those that it has.
    """
    if isinstance(column, int) and 0 <= column < len(header):
        return header[column]
    if column not in header:
        shown = ", ".join(map(repr, header[:_SHOWN_COLUMNS]))
        raise BenchError(
            f"table of trials must have a column {column!r} for the {part}, it has {shown}"
        )
    return str(column)


@dataclass
class _RowScan:
    """What one pass over the rows shows.

    Attributes
    ----------
    names : dict
        First row of each trial, and the hash of its cells.
    repeated : dict of int to TrialFault
    count : int
        Number of rows.
    """

    names: dict[str, tuple[int, int]] = field(default_factory=dict)
    repeated: dict[int, TrialFault] = field(default_factory=dict)
    count: int = 0

    def add_row(self, row: int, name: str, cells: list[str]) -> None:
        """Note one row with a name."""
        content = hash(tuple(cells))
        first_row, first_content = self.names.setdefault(name, (row, content))
        if first_row == row:
            return
        if first_content == content:
            details = "an earlier row has this trial with the same conditions"
            self.repeated[row] = TrialFault(FaultKind.DUPLICATE, details)
            return
        details = "another row has this trial with other conditions"
        fault = TrialFault(FaultKind.DUPLICATE, details)
        self.repeated[first_row] = fault
        self.repeated[row] = fault


def _scan_for_repeated_trials(table: TextTable, trial_column_index: int) -> _RowScan:
    """Look through the rows for repeated trials, by the index of the trial's column."""
    scan = _RowScan()
    for row, cells in enumerate(table.rows, start=1):
        scan.count = row
        if trial_column_index >= len(cells):
            continue
        name = cells[trial_column_index].strip()
        if name:
            scan.add_row(row, name, cells)
    return scan


def _match_declared_trials(session: Session, trial_names: Iterable[str]) -> dict[str | int, str]:
    """Match the trials that session.toml excludes or swaps with their names in the table.

    Raises
    ------
    BenchError
        If the table has no such trial, or two pairs share one.
    """
    swap = session.trials.swap
    declared = [*session.trials.exclude]
    for pair in swap:
        declared += pair
    found: dict[str | int, str] = {}
    mistakes: list[Mistake] = []
    for number in dict.fromkeys(declared):
        name = _match_trial_name(number, trial_names)
        if name is None:
            rule = "`trials.exclude` and `trials.swap` must name trials of the table"
            mistakes.append(("", f"{rule}, got {number!r}"))
        else:
            found[number] = name
    swapped = []
    for number in itertools.chain.from_iterable(swap):
        if number in found:
            swapped.append(found[number])
    if len(set(swapped)) < len(swapped):
        rule = "`trials.swap` must be pairs of two trials, none of them in two pairs"
        mistakes.append(("", f"{rule}, got {[list(pair) for pair in swap]}"))
    if mistakes:
        raise BenchError(format_mistakes(mistakes, session.folder / "session.toml"))
    return found


def _match_trial_name(declared: str | int, trial_names: Iterable[str]) -> str | None:
    """Return the name in the table of a declared trial, or None; 73 may be written 0073."""
    text = str(declared)
    for name in trial_names:
        if name == text:
            return name
        if name.isdigit() and name.lstrip("0") == text:
            return name
    return None
