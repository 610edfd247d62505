"""Profiles and maps from plain text: CSV, TSV and XYZ, whose columns say their units or are refused.

A column is accepted with its unit in the name (``x_um``, ``z [nm]``, ``Lateral um``, ``Raw Micrometer``). A file that
does not say its unit is not guessed: the unit must then be given.
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.errors import MetrologyError

Array = NDArray[np.float64]

LENGTH_UNITS = {"pm": 1e12, "nm": 1e9, "um": 1e6, "µm": 1e6, "μm": 1e6, "mm": 1e3, "cm": 1e2, "m": 1.0}  # per metre
LENGTH_UNITS |= {"nanometer": 1e9, "micrometer": 1e6, "micron": 1e6, "microns": 1e6, "millimeter": 1e3, "meter": 1.0}

_MOST_BYTES = 256 * 2**20
_MOST_HEADER_LINES = 400
_MOST_COLUMNS = 64
_MISSING = {"", "nan", "bad", "-", "***"}  # how instruments write a point that was not measured
_UNIT_IN_NAME = re.compile(r"(?:^|[\s_\[\(/])(" + "|".join(sorted(LENGTH_UNITS, key=len, reverse=True)) + r")[\]\)]?$")


def read_text_scan(path: Path, unit: str | None = None) -> Profile | HeightMap:
    """Read a profile (two columns) or a grid of points (three columns) from text."""
    header, rows = _table(_decode(path), path)
    if len(rows[0]) not in (2, 3):
        raise MetrologyError(f"table must have 2 columns (x, z) or 3 (x, y, z), got {len(rows[0])} [{path.name}]")
    factors = _factors(header, len(rows[0]), unit, path)
    values = np.array(rows, dtype=np.float64) / factors
    said = ", ".join(header) if header else f"unit {unit} as given"
    if values.shape[1] == 2:
        x, snapped = _equal_steps(values[:, 0], _last_digit(rows) / factors[0])
        note = "; positions set to equal steps within their last digit" if snapped else ""
        return Profile(x, values[:, 1], source=path.name, scale=f"columns {said}{note}")
    return _grid(values, path, f"columns {said}")


def _decode(path: Path) -> str:
    if (size := path.stat().st_size) > _MOST_BYTES:
        raise MetrologyError(f"text must not exceed {_MOST_BYTES >> 20} MiB, got {size} bytes [{path.name}]")
    raw = path.read_bytes()
    if b"\0" in raw[:4096]:
        raise MetrologyError(f"file must be text, got zero bytes [{path.name}]")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # profilometers write the micro sign so


def _table(text: str, path: Path) -> tuple[list[str], list[list[float]]]:
    """Names of the columns, and the numbers below them; empty names where the first line already holds numbers."""
    reader = csv.reader(io.StringIO(text), delimiter=_separator(text.splitlines()), skipinitialspace=True)
    header: list[str] = []
    rows: list[list[float]] = []
    try:
        for number, record in enumerate(reader, start=1):
            fields = [field.strip() for field in record if field.strip()] if not rows else _trim(record, len(rows[0]))
            if not fields:
                continue
            values = _numbers(fields)
            if values is not None and (not rows or len(values) == len(rows[0])):
                if not rows and len(values) < 2:
                    continue
                if len(values) > _MOST_COLUMNS:
                    raise MetrologyError(f"table must have at most {_MOST_COLUMNS} columns [{path.name}, {number}]")
                rows.append(values)
            elif rows:
                raise MetrologyError(
                    f"line must hold {len(rows[0])} numbers, got {','.join(record)[:60]!r} [{path.name}, line {number}]"
                )
            elif number > _MOST_HEADER_LINES:
                raise MetrologyError(f"table must begin within {_MOST_HEADER_LINES} lines [{path.name}]")
            else:
                header = [field.lstrip("# ") for field in fields]
    except csv.Error as error:
        raise MetrologyError(f"text must be a table, got {error} [{path.name}]") from error
    if not rows:
        raise MetrologyError(f"text must hold a table of numbers, got none [{path.name}]")
    return (header if len(header) == len(rows[0]) else []), rows


def _trim(record: list[str], width: int) -> list[str]:
    """Fields without the empty ones that some instruments append; an empty field inside is a missing point."""
    fields = [field.strip() for field in record]
    while len(fields) > width and not fields[-1]:
        fields.pop()
    return [] if not any(fields) else fields


def _numbers(fields: list[str]) -> list[float] | None:
    try:
        values = [np.nan if field.lower() in _MISSING else float(field) for field in fields]
    except ValueError:
        return None
    return None if all(np.isnan(value) for value in values) else values


def _separator(lines: list[str]) -> str:
    sample = [line for line in lines[: _MOST_HEADER_LINES + 50] if line.strip()][-50:]
    counts = {mark: sum(mark in line for line in sample) for mark in (";", "\t", ",")}
    best = max(counts, key=lambda mark: counts[mark])
    return best if counts[best] > len(sample) // 2 else " "


def _factors(header: list[str], width: int, unit: str | None, path: Path) -> Array:
    if unit is not None and unit not in LENGTH_UNITS:
        raise MetrologyError(f"unit must be one of nm, um, mm, m, got {unit!r}")
    if not header:
        if unit is None:
            rule = "columns must name their unit (x_um, z [nm], ...) or a unit must be given"
            raise MetrologyError(f"{rule}, got none [{path.name}]")
        return np.full(width, LENGTH_UNITS[unit])
    factors = []
    for name in header:
        found = _UNIT_IN_NAME.search(name.lower())
        said = found.group(1) if found else unit
        if said is None:
            raise MetrologyError(f"column {name!r} must name its unit (x_um, z [nm], ...) [{path.name}]")
        factors.append(LENGTH_UNITS[said])
        if unit is not None and factors[-1] != LENGTH_UNITS[unit]:
            raise MetrologyError(f"unit given is {unit}, but column {name!r} says another [{path.name}]")
    return np.array(factors)


def _last_digit(rows: list[list[float]]) -> float:
    """Value of the last digit that positions are printed with, from the shortest decimal that gives each back."""
    decimals = max((len(repr(row[0]).partition(".")[2]) if "e" not in repr(row[0]) else 17) for row in rows[:2000])
    return float(10.0 ** -min(decimals, 17))


def _equal_steps(x: Array, digit: float) -> tuple[Array, bool]:
    if len(x) < 3 or not np.isfinite(x).all():
        return x, False
    even = np.polynomial.Polynomial.fit(np.arange(len(x)), x, 1)(np.arange(len(x)))
    off = float(np.abs(even - x).max())
    if off == 0.0 or off > 0.75 * digit:
        return x, False
    return even, off > 1e-9 * abs(float(x[-1] - x[0]))


def _grid(values: Array, path: Path, said: str) -> HeightMap:
    x, column = np.unique(values[:, 0], return_inverse=True)
    y, row = np.unique(values[:, 1], return_inverse=True)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise MetrologyError(f"positions must be finite numbers [{path.name}]")
    if len(x) < 2 or len(y) < 2 or len(x) * len(y) > 4 * len(values):
        got = f"{len(values)} points on {len(x)} columns and {len(y)} rows"
        raise MetrologyError(f"points must lie on a grid, got {got} [{path.name}]")
    for name, axis in (("x", x), ("y", y)):
        if np.ptp(np.diff(axis)) > 0.02 * np.diff(axis).mean():
            raise MetrologyError(f"grid must have equal steps along {name} [{path.name}]")
    height = np.full((len(y), len(x)), np.nan)
    height[row, column] = values[:, 2]
    return HeightMap(height, float(np.diff(x).mean()), float(np.diff(y).mean()), source=path.name, scale=said)
