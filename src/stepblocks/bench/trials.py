"""The table of trials, row by row, and whether each trace belongs to its row."""

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
        for number, cells in _rows(self.session):
            yield self._trial(number, cells)

    def _trial(self, number: int, cells: list[str]) -> Trial:
        named = dict(zip(self.header, cells + [""] * len(self.header), strict=False))
        name = named[self.key].strip()
        if len(cells) != len(self.header):
            fault = f"row {number} of the table has {len(cells)} cells, the header has {len(self.header)}"
            return Trial(name, number, named, fault=fault)
        fault = self.repeated.get(number, "" if name else f"row {number} of the table names no trial")
        try:
            speed = self._number(named, "speed", "speed")
            load = self._number(named, "load", "force")
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
    header, columns = _header(session), session.trials.columns
    key = _column_name(columns.trial.column, header, "trial")
    for part in _CONDITIONS:
        if part in columns.model_fields_set:
            _column_name(getattr(columns, part).column, header, part)
    taken = sorted(set(header) & reserved - {key})
    if taken:
        raise BenchError(f"column `{taken[0]}` of the table of trials has a name that features use [{session.table}]")
    count, index = 0, header.index(key)
    trials, wholes, numbers = array("Q"), array("Q"), array("q")
    for number, cells in _rows(session):
        count = number
        name = cells[index].strip() if index < len(cells) else ""
        if name:
            trials.append(_digest(name))
            wholes.append(_digest("\x1f".join(cells)))
            numbers.append(number)
    if count == 0:
        raise BenchError(f"table of trials has no rows [{session.table}]")
    return TrialTable(session, header, key, count, _duplicates(trials, wholes, numbers))


def _digest(text: str) -> int:
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest(), "little")


def _duplicates(trials: array[int], wholes: array[int], numbers: array[int]) -> dict[int, str]:
    """Rows that repeat an earlier row of their trial, and rows of one trial that contradict one another."""
    _, first, which = np.unique(np.array(trials, dtype=np.uint64), return_index=True, return_inverse=True)
    row, whole, home = np.array(numbers), np.array(wholes, dtype=np.uint64), first[which]
    again = home != np.arange(len(row))
    same = whole == whole[home]
    other = again & ~same
    repeat = dict.fromkeys(
        row[again & same].tolist(), "duplicate: an earlier row has this trial with the same conditions"
    )
    apart = [*row[other].tolist(), *row[home[other]].tolist()]
    return repeat | dict.fromkeys(apart, "duplicate: another row has this trial with other conditions")


def _column_name(column: str | int, header: tuple[str, ...], part: str) -> str:
    if isinstance(column, int) and 0 <= column < len(header):
        return header[column]
    if isinstance(column, str) and column in header:
        return column
    listed = ", ".join(header[:12])
    raise BenchError(f"table of trials must have a column {column!r} for the {part}, it has {listed}")


def _header(session: Session) -> tuple[str, ...]:
    header = tuple(cell.strip() for cell in next(_lines(session), []))
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

    rows: array[int] = field(default_factory=lambda: array("q"))
    blocks: array[int] = field(default_factory=lambda: array("q"))
    digests: array[int] = field(default_factory=lambda: array("Q"))
    numbers: array[float] = field(default_factory=lambda: array("d"))
    names: dict[str, int] = field(default_factory=dict)

    def add(self, trial: Trial, features: dict[str, float], digest: int) -> None:
        """Take note of one measured trial; `digest` identifies the samples of its trace."""
        self.rows.append(trial.row)
        self.blocks.append(self.names.setdefault(trial.block, len(self.names)))
        self.digests.append(digest)
        self.numbers.extend((trial.load, trial.speed, *(features.get(name, math.nan) for name in _FEATURES)))

    def faults(self) -> dict[int, str]:
        """Reasons by row, for every trial whose trace belongs elsewhere."""
        if not self.rows:
            return {}
        load, speed, normal, slope, peak, friction = np.array(self.numbers, dtype=float).reshape(-1, 6).T
        found: dict[int, str] = {}
        self._loads(load, normal, found)
        self._speeds(speed, slope, found)
        self._copies(found)
        # inverse of equation (1): a = atan(F_px / F_py) - atan(mu)
        self._angles(np.arctan(peak / normal) - np.arctan(friction), found)
        return found

    def _loads(self, load: Array, normal: Array, found: dict[int, str]) -> None:
        def told(index: int) -> str:
            return f"the normal force is {normal[index]:.3g} N, the load of this row is {load[index]:.3g} N"

        ratio = normal / load
        usual = _median(ratio)
        for index, wrong in _outliers(ratio, usual, _LOAD_FACTOR):
            found.setdefault(self.rows[index], f"{wrong}: {told(index)}")
        if _off(np.array([usual]), 1.0, _WILD_FACTOR)[0]:
            found |= {
                self.rows[index]: f"units: {told(index)}" for index in np.flatnonzero(np.isfinite(ratio)).tolist()
            }

    def _speeds(self, speed: Array, slope: Array, found: dict[int, str]) -> None:
        ratio = slope / speed
        usual = _median(ratio)
        for index, wrong in _outliers(ratio, usual, _SLOPE_FACTOR):
            found.setdefault(
                self.rows[index],
                f"{wrong}: the ramp of {slope[index]:.3g} N/s means {slope[index] / usual * 1e3:.3g} mm/s, "
                f"the speed of this row is {speed[index] * 1e3:.3g} mm/s",
            )

    def _copies(self, found: dict[int, str]) -> None:
        clean = np.array([i for i in np.argsort(self.rows, kind="stable") if self.rows[i] not in found], dtype=np.intp)
        digests = np.array(self.digests, dtype=np.uint64)[clean]
        _, first, which = np.unique(digests, return_index=True, return_inverse=True)
        for copy in np.flatnonzero(first[which] != np.arange(len(clean))):
            index, earlier = clean[copy], clean[first[which[copy]]]
            for one, other in ((index, earlier), (earlier, index)):
                found[self.rows[one]] = f"duplicate: the same samples stand for row {self.rows[other]}"

    def _angles(self, angle: Array, found: dict[int, str]) -> None:
        """Compare sin(a/2), which is sqrt(H / 2R) by equation (2), of each trial with the blocks.

        Only a trace that fits another block goes.
        """
        size, block = np.sin(0.5 * angle), np.array(self.blocks)
        known = np.isfinite(size) & ~np.isin(self.rows, list(found))
        groups = {int(name): size[known & (block == name)] for name in np.unique(block)}
        groups = {name: sizes for name, sizes in groups.items() if sizes.size >= _FEWEST}
        if len(groups) < 2:
            return
        medians = {name: float(np.median(sizes)) for name, sizes in groups.items()}
        deviations = [np.abs(sizes - medians[name]) / 0.6745 for name, sizes in groups.items()]
        spread = float(np.median(np.concatenate(deviations)))
        labels = {number: name for name, number in self.names.items()}
        for index in np.flatnonzero(known):
            own = int(block[index])
            if own not in medians:
                continue
            miss = abs(size[index] - medians[own])
            nearest = min(medians, key=lambda name: abs(medians[name] - size[index]))
            fits = abs(size[index] - medians[nearest]) < 0.25 * miss
            if nearest != own and fits and miss > max(_ANGLE_SIGMAS * spread, _ANGLE_SHARE * medians[own]):
                found.setdefault(
                    self.rows[index],
                    f"mislabelled: the forces are those of block {labels[nearest]}, the row says {labels[own]}",
                )


def _median(ratio: Array) -> float:
    finite = ratio[np.isfinite(ratio)]
    return float(np.median(finite)) if finite.size else math.nan


def _outliers(ratio: Array, usual: float, factor: float) -> list[tuple[int, str]]:
    """Trials whose ratio is not the usual one, each with what may be wrong."""
    units = _off(ratio, usual, _UNIT_FACTOR)
    wrong = np.flatnonzero(_off(ratio, usual, factor)).tolist()
    return [(index, "units changed or mislabelled" if units[index] else "mislabelled") for index in wrong]


def _off(ratio: Array, usual: float, factor: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.isfinite(ratio) & ((ratio > usual * factor) | (ratio < usual / factor))
