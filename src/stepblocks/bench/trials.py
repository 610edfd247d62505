"""The table of trials, row by row, and whether each trace belongs to its row."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.session import Session
from stepblocks.bench.signal import Array
from stepblocks.errors import BenchError

_MOST_COLUMNS = 1000
_CONDITIONS = ("speed", "load", "block")
_LOAD_FACTOR = 1.25  # measured over declared load, against the median of the session
_SLOPE_FACTOR = 1.5  # ramp over speed, against the median of the session
_WILD_FACTOR = 3.0  # the session as a whole: more than this is a matter of units
_UNIT_FACTOR = 100.0  # one trial: more than this may be a matter of units
_ANGLE_SIGMAS = 8.0
_ANGLE_SHARE = 0.12  # least relative deviation of the sine of half the angle
_FEWEST = 5  # trials of a block, to know its angle
_FEATURES = ("normal_load_n", "loading_slope_n_per_s", "peak_force_n", "sliding_friction")


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
        return value * float(channel.scale(dimension, f"trials.columns.{part}"))


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
    key = _column_name(columns.trial.column, header, "trial")
    for part in _CONDITIONS:
        if part in columns.model_fields_set:
            _column_name(getattr(columns, part).column, header, part)
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


def _column_name(column: str | int, header: tuple[str, ...], part: str) -> str:
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


@dataclass
class LabelCheck:
    """Collects 72 bytes per trial and names the trials whose trace belongs elsewhere."""

    labels: array[int] = field(default_factory=lambda: array("Q"))  # row, block and digest of each trial
    numbers: array[float] = field(default_factory=lambda: array("d"))
    names: dict[str, int] = field(default_factory=dict)

    def add(self, trial: Trial, features: dict[str, float], digest: int) -> None:
        """Take note of one measured trial; `digest` identifies the samples of its trace."""
        self.labels.extend((trial.row, self.names.setdefault(trial.block, len(self.names)), digest))
        self.numbers.extend((trial.load, trial.speed, *(features.get(name, math.nan) for name in _FEATURES)))

    def faults(self) -> dict[int, str]:
        """Reasons by row, for every trial whose trace belongs elsewhere."""
        rows, blocks, digests = np.array(self.labels, dtype=np.uint64).reshape(-1, 3).T
        load, speed, normal, slope, peak, friction = np.array(self.numbers, dtype=float).reshape(-1, 6).T
        found: dict[int, str] = {}

        def compare(ratio: Array, factor: float, told: Callable[[int, float], str]) -> float:
            finite = ratio[np.isfinite(ratio)]
            usual = float(np.median(finite)) if finite.size else math.nan
            units = _off(ratio, usual, _UNIT_FACTOR)
            for index in np.flatnonzero(_off(ratio, usual, factor)).tolist():
                wrong = "units changed or mislabelled" if units[index] else "mislabelled"
                found.setdefault(int(rows[index]), f"{wrong}: {told(index, usual)}")
            return usual

        def told_load(index: int, _: float) -> str:
            return f"the normal force is {normal[index]:.3g} N, the load of this row is {load[index]:.3g} N"

        def told_speed(index: int, usual: float) -> str:
            means = f"the ramp of {slope[index]:.3g} N/s means {slope[index] / usual * 1e3:.3g} mm/s"
            return f"{means}, the speed of this row is {speed[index] * 1e3:.3g} mm/s"

        ratio = normal / load
        usual = compare(ratio, _LOAD_FACTOR, told_load)
        if _off(np.array([usual]), 1.0, _WILD_FACTOR)[0]:
            found |= {
                int(rows[i]): f"units: {told_load(i, usual)}" for i in np.flatnonzero(np.isfinite(ratio)).tolist()
            }
        compare(slope / speed, _SLOPE_FACTOR, told_speed)
        clean = np.array([i for i in np.argsort(rows, kind="stable") if rows[i] not in found], dtype=np.intp)
        _, first, which = np.unique(digests[clean], return_index=True, return_inverse=True)
        for copy in np.flatnonzero(first[which] != np.arange(len(clean))):
            pair = int(rows[clean[copy]]), int(rows[clean[first[which[copy]]]])
            for one, other in (pair, pair[::-1]):
                found[one] = f"duplicate: the same samples stand for row {other}"
        # inverse of equation (1): a = atan(F_px / F_py) - atan(mu)
        angle = np.where(np.isin(rows, list(found)), math.nan, np.arctan(peak / normal) - np.arctan(friction))
        names = list(self.names)
        for index, other in _of_other_blocks(angle, blocks).items():
            said = f"the forces are those of block {names[other]}, the row says {names[int(blocks[index])]}"
            found.setdefault(int(rows[index]), f"mislabelled: {said}")
        return found


def _of_other_blocks(angle: Array, block: NDArray[np.uint64]) -> dict[int, int]:
    """Trials whose sin(a/2), which is sqrt(H / 2R) by equation (2), fits another block and not their own."""
    size = np.sin(0.5 * angle)
    known = np.isfinite(size)
    groups = {int(name): size[known & (block == name)] for name in np.unique(block)}
    groups = {name: sizes for name, sizes in groups.items() if sizes.size >= _FEWEST}
    if len(groups) < 2:
        return {}
    medians = {name: float(np.median(sizes)) for name, sizes in groups.items()}
    deviations = [np.abs(sizes - medians[name]) / 0.6745 for name, sizes in groups.items()]
    spread = float(np.median(np.concatenate(deviations)))
    found = {}
    for index in np.flatnonzero(known & np.isin(block, list(medians))).tolist():
        own = medians[int(block[index])]
        miss = abs(size[index] - own)
        nearest = min(medians, key=lambda name: abs(medians[name] - size[index]))
        fits = abs(size[index] - medians[nearest]) < 0.25 * miss
        if nearest != block[index] and fits and miss > max(_ANGLE_SIGMAS * spread, _ANGLE_SHARE * own):
            found[index] = nearest
    return found


def _off(ratio: Array, usual: float, factor: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.isfinite(ratio) & ((ratio > usual * factor) | (ratio < usual / factor))
