"""The table of trials, row by row: conditions of each trial, and what is wrong with a row."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np

from stepblocks.bench.session import Session
from stepblocks.bench.trace import Trial
from stepblocks.errors import BenchError

_MOST_COLUMNS = 1000


@dataclass(frozen=True)
class TrialTable:
    """A table of trials that was looked through once."""

    session: Session  # Where it belongs
    header: tuple[str, ...]  # Names of its columns
    count: int  # Number of rows
    repeated: frozenset[int]  # Rows, from 1, whose trial an earlier row has with the same conditions
    contradicted: frozenset[int]  # Rows whose trial another row has with other conditions

    @property
    def covariates(self) -> tuple[str, ...]:
        """Columns but that of the trial, as the table names them."""
        name = _column_name(self.session.columns.trial.column, self.header, "trial")
        return tuple(column for column in self.header if column != name)

    def __iter__(self) -> Iterator[Trial]:
        columns = self.session.columns
        index = _column_name(columns.trial.column, self.header, "trial")
        for number, cells in _rows(self.session):
            yield self._trial(number, cells, index)

    def _trial(self, number: int, cells: list[str], key: str) -> Trial:
        if len(cells) != len(self.header):
            padded = dict(zip(self.header, cells + [""] * len(self.header), strict=False))
            fault = f"row {number} of the table has {len(cells)} cells, the header has {len(self.header)}"
            return Trial(padded[key].strip(), number, padded, fault=fault)
        named = dict(zip(self.header, cells, strict=True))
        name = named[key].strip()
        fault = "" if name else f"row {number} of the table names no trial"
        if number in self.repeated:
            fault = "duplicate: an earlier row has this trial with the same conditions"
        if number in self.contradicted:
            fault = "duplicate: another row has this trial with other conditions"
        try:
            speed = self._number(named, "speed", "speed")
            load = self._number(named, "load", "force")
        except ValueError as error:
            return Trial(name, number, named, fault=fault or str(error))
        block = named.get(str(self.session.columns.block.column), "").strip()
        return Trial(name, number, named, speed, load, block, fault)

    def _number(self, named: dict[str, str], part: str, dimension: str) -> float:
        channel = getattr(self.session.columns, part)
        if channel.column not in named:
            return math.nan
        text = named[channel.column].strip().replace(self.session.decimal, ".")
        try:
            value = float(text)
        except ValueError:
            raise ValueError(f"{channel.column} must be a number, got {text[:40]!r}") from None
        if not math.isfinite(value) or value <= 0.0:
            raise ValueError(f"{channel.column} must be positive and finite, got {text[:40]}")
        return value * float(channel.scale(dimension, f"trials.columns.{part}"))


def open_trials(session: Session, reserved: frozenset[str] = frozenset()) -> TrialTable:
    """Look through the table of trials once: header, number of rows, duplicates."""
    header = _header(session)
    key = header.index(_column_name(session.columns.trial.column, header, "trial"))
    for part in ("speed", "load", "block"):
        if part in session.columns.model_fields_set:
            _column_name(getattr(session.columns, part).column, header, part)
    taken = sorted(set(header) & reserved - {header[key]})
    if taken:
        raise BenchError(f"column `{taken[0]}` of the table of trials has a name that features use [{session.table}]")
    count, marks, digests, numbers = 0, array("Q"), array("Q"), array("q")
    for number, cells in _rows(session):
        count += 1
        name = cells[key].strip() if key < len(cells) else ""
        if name:
            marks.append(_digest(name))
            digests.append(_digest("\x1f".join(cells)))
            numbers.append(number)
    if count == 0:
        raise BenchError(f"table of trials has no rows [{session.table}]")
    return TrialTable(session, header, count, *_duplicates(marks, digests, numbers))


def _digest(text: str) -> int:
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest(), "little")


def _duplicates(marks: array[int], digests: array[int], numbers: array[int]) -> tuple[frozenset[int], frozenset[int]]:
    """Rows that repeat an earlier row of their trial, and rows of one trial that contradict one another."""
    _, first, which = np.unique(np.array(marks, dtype=np.uint64), return_index=True, return_inverse=True)
    row, whole, home = np.array(numbers), np.array(digests, dtype=np.uint64), first[which]
    again = home != np.arange(len(row))
    same = whole == whole[home]
    contradicted = again & ~same
    return frozenset(row[again & same].tolist()), frozenset(
        [*row[contradicted].tolist(), *row[home[contradicted]].tolist()]
    )


def _column_name(column: str | int, header: tuple[str, ...], part: str) -> str:
    if isinstance(column, int):
        if 0 <= column < len(header):
            return header[column]
    elif column in header:
        return column
    listed = ", ".join(header[:12])
    raise BenchError(f"table of trials must have a column {column!r} for the {part}, it has {listed}")


def _header(session: Session) -> tuple[str, ...]:
    with session.table.open(newline="", encoding="utf-8-sig") as file:
        try:
            cells = next(csv.reader(file, delimiter=session.delimiter), [])
        except (csv.Error, UnicodeDecodeError) as error:
            raise BenchError(f"table of trials must be CSV in UTF-8: {error} [{session.table}]") from error
    header = tuple(cell.strip() for cell in cells)
    if not any(header):
        raise BenchError(f"table of trials is empty [{session.table}]")
    if len(header) > _MOST_COLUMNS:
        raise BenchError(f"table of trials must have at most {_MOST_COLUMNS} columns, got {len(header)}")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise BenchError(f"table of trials names the column {twice[0]!r} twice [{session.table}]")
    return header


def _rows(session: Session) -> Iterator[tuple[int, list[str]]]:
    """Rows below the header, from 1; empty lines are none."""
    with session.table.open(newline="", encoding="utf-8-sig") as file:
        number = 0
        try:
            for index, cells in enumerate(csv.reader(file, delimiter=session.delimiter)):
                if index == 0 or not any(cell.strip() for cell in cells):
                    continue
                number += 1
                yield number, cells
        except (csv.Error, UnicodeDecodeError) as error:
            raise BenchError(f"table of trials must be CSV in UTF-8: {error} [{session.table}]") from error
