"""The table of trials, row by row."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.session import Session
from stepblocks.errors import BenchError

_MOST_COLUMNS = 1000
_CONDITIONS = ("speed", "load", "block", "height")


@dataclass(frozen=True)
class Trial:
    """One row of the table of trials; not-a-number and empty where the table has no such column."""

    name: str  # as the table writes it
    row: int  # counted from 1 below the header
    cells: dict[str, str] = field(default_factory=dict)  # every cell of the row, as written
    speed: float = math.nan  # of the handle [m/s]
    load: float = math.nan  # normal load that the weights set [N]
    block: str = ""
    fault: str = ""  # why the row cannot be used; empty where it can


@dataclass(frozen=True)
class TrialTable:
    """A table of trials that was looked through once."""

    session: Session
    header: tuple[str, ...]
    key: str  # name of the column that names the trial
    count: int  # of its rows
    repeated: dict[int, str]  # rows, from 1, whose trial another row has, and what is wrong with that

    @property
    def covariates(self) -> tuple[str, ...]:
        """Columns but that of the trial, as the table names them."""
        return tuple(column for column in self.header if column != self.key)

    def __iter__(self) -> Iterator[Trial]:
        return (self._trial(number, cells) for number, cells in _rows(self.session))

    def _trial(self, number: int, cells: list[str]) -> Trial:
        named = dict(zip(self.header, cells + [""] * len(self.header), strict=False))
        name = named[self.key].strip()
        if len(cells) != len(self.header):
            fault = f"row {number} of the table has {len(cells)} cells, the header has {len(self.header)}"
            return Trial(name, number, named, fault=fault)
        fault = self.repeated.get(number, "" if name else f"row {number} of the table names no trial")
        try:
            speed, load = self._number(named, "speed", "speed"), self._number(named, "load", "force")
        except ValueError as error:
            return Trial(name, number, named, fault=fault or str(error))
        block = named.get(str(self.session.trials.columns.block.column), "").strip()
        return Trial(name, number, named, speed, load, block, fault)

    def _number(self, named: dict[str, str], part: str, dimension: str) -> float:
        channel = getattr(self.session.trials.columns, part)
        if channel.column not in named:
            return math.nan
        text = named[channel.column].strip().replace(self.session.trials.decimal, ".")
        try:
            value = float(text)
        except ValueError:
            raise ValueError(f"{channel.column} must be a number, got {text[:40]!r}") from None
        if not math.isfinite(value) or value <= 0.0:
            raise ValueError(f"{channel.column} must be positive and finite, got {text[:40]}")
        place = f"trials.columns.{part}"
        return value * float(channel.scale(dimension, place)) - float(channel.taken_off(dimension, place))


def open_trials(session: Session, reserved: frozenset[str] = frozenset()) -> TrialTable:
    """Look through the table of trials once: header, number of rows, duplicates.

    Nothing of a row is held but 24 bytes, so that a table of any length fits.
    """
    columns, header = session.trials.columns, tuple(cell.strip() for cell in next(_lines(session), []))
    if not any(header):
        raise BenchError(f"table of trials is empty [{session.table}]")
    if len(header) > _MOST_COLUMNS:
        raise BenchError(f"table of trials must have at most {_MOST_COLUMNS} columns, got {len(header)}")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise BenchError(f"table of trials names the column {twice[0]!r} twice [{session.table}]")
    key = column_name(columns.trial.column, header, "trial")
    for part in _CONDITIONS:
        if part in columns.model_fields_set:
            column_name(getattr(columns, part).column, header, part)
    taken = sorted(set(header) & reserved - {key})
    if taken:
        raise BenchError(f"column `{taken[0]}` of the table of trials has a name that features use [{session.table}]")
    count, index, noted = 0, header.index(key), array("Q")
    for number, cells in _rows(session):
        count = number
        if index < len(cells) and (name := cells[index].strip()):
            digests = (blake2b(text.encode(), digest_size=8).digest() for text in (name, "\x1f".join(cells)))
            noted.extend((*(int.from_bytes(digest, "little") for digest in digests), number))
    if count == 0:
        raise BenchError(f"table of trials has no rows [{session.table}]")
    return TrialTable(session, header, key, count, _duplicates(np.array(noted, dtype=np.uint64).reshape(-1, 3)))


def _duplicates(noted: NDArray[np.uint64]) -> dict[int, str]:
    """Rows that repeat an earlier row of their trial, and rows of one trial that contradict one another."""
    trial, whole, row = noted.T
    _, first, which = np.unique(trial, return_index=True, return_inverse=True)
    home = first[which]
    again = home != np.arange(len(row))
    same = whole == whole[home]
    other = again & ~same
    apart = [*row[other].tolist(), *row[home[other]].tolist()]
    return {
        **dict.fromkeys(
            row[again & same].tolist(), "duplicate: an earlier row has this trial with the same conditions"
        ),
        **dict.fromkeys(apart, "duplicate: another row has this trial with other conditions"),
    }


def column_name(column: str | int, header: tuple[str, ...], part: str) -> str:
    """Name of a declared column, or say which there are."""
    if isinstance(column, int) and 0 <= column < len(header):
        return header[column]
    if isinstance(column, str) and column in header:
        return column
    listed = ", ".join(header[:12])
    raise BenchError(f"table of trials must have a column {column!r} for the {part}, it has {listed}")


def _rows(session: Session) -> Iterator[tuple[int, list[str]]]:
    """Rows below the header, from 1; empty lines are none."""
    lines = _lines(session)
    next(lines, None)
    yield from enumerate((cells for cells in lines if any(cell.strip() for cell in cells)), start=1)


def _lines(session: Session) -> Iterator[list[str]]:
    with session.table.open(newline="", encoding="utf-8-sig") as file:
        try:
            yield from csv.reader(file, delimiter=session.trials.delimiter)
        except (csv.Error, UnicodeDecodeError) as error:
            raise BenchError(f"table of trials must be CSV in UTF-8: {error} [{session.table}]") from error
