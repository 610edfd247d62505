"""The one rule of what is missing: empty cells, words for it, and values that fill a gap.

Words count in columns of numbers alone: in a column of texts only the empty cell is missing, and a
participant may be called NA. A fill value counts where it stands far off everything else in its
column, or where it was declared.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.files.layout import MissingValues
from stepblocks.files.numbers import NumberNotation

__all__ = [
    "FILL_VALUES",
    "DeclaredMissing",
    "FillFound",
    "describe_missing",
    "is_missing_word",
    "list_missing_words",
    "replace_fill_values_by_nan",
]

# as R, BIDS, pandas, spreadsheets, SAS and instruments write it; in small letters
_WORDS = frozenset(
    {
        *("", "na", "n/a", "#n/a", "#na", "<na>", "n.a.", "nan", "-nan", "+nan", "1.#qnan"),
        *("-1.#ind", "null", "none", "nil", "missing", "bad", "invalid", "void"),
        *("-", "--", "---", "***", ".", "?", "nd", "n.d."),
    }
)
# what loggers, grids and rasters write where nothing was measured: signed and unsigned limits of 16
# and 32 bits, round numbers, and the fill values of NetCDF, GMT, Surfer and single precision
FILL_VALUES = (
    *(-999.0, -9999.0, -99999.0, -999999.0, -999.25, 9999.0, 99999.0, 999999.0),
    *(-32768.0, -32767.0, 32767.0, 65535.0, -2147483648.0, 2147483647.0),
    *(1e30, -1e30, 1e20, 1.70141e38, 9.96921e36, 3.4028235e38, -3.4028235e38),
)
_STANDS_OUT = 3.0  # times the largest of the others, from which on a fill value is none of them
_HUGE = 1e15  # from which on a fill value may be rounded, as 1.70141e38 is
_ROUNDING = 1e-5  # share by which it may be


@dataclass(frozen=True)
class FillFound:
    """A column of numbers without the values that fill its gaps.

    Attributes
    ----------
    values : array, shape (n,)
        NaN where a value fills a gap.
    fills : tuple of float
        The fill values that were found.
    count : int
        How many numbers they replaced.
    words : tuple of str
        Cells that hold a word for a missing value, as the file writes them.
    """

    values: NDArray[np.float64]
    fills: tuple[float, ...] = ()
    count: int = 0
    words: tuple[str, ...] = ()

    def describe_missing_values(self, column: str) -> str:
        """Say what was taken as missing; empty where nothing was, or only empty cells."""
        found = [f"{fill:.10g}" for fill in self.fills]
        found += dict.fromkeys(self.words)
        return describe_missing(found, self.count + len(self.words), f" in {column!r}")


class DeclaredMissing:
    """The missing values that a user names, in the cells of one table.

    Parameters
    ----------
    declared : MissingValues
        Numbers and words.
    notation : NumberNotation
        Of the numbers in the table.
    """

    def __init__(self, declared: MissingValues, notation: NumberNotation) -> None:
        self._numbers = declared.numbers
        self._words = frozenset(declared.words)
        self._notation = notation
        self._decided: dict[str, bool] = {"": False}
        self._counts: dict[str, int] = {}

    def blank_cells(self, cells: Sequence[str]) -> list[str]:
        """Return cells, empty ones in place of those that stand for a missing value."""
        blanked = []
        for cell in cells:
            is_missing = self._decided.get(cell)
            if is_missing is None:
                is_missing = self._decided[cell] = self._is_declared_missing(cell)
            if is_missing:
                self._counts[cell] = self._counts.get(cell, 0) + 1
                cell = ""
            blanked.append(cell)
        return blanked

    def describe_found_values(self) -> list[str]:
        """Say which declared values were found."""
        note = describe_missing(list(self._counts), sum(self._counts.values()), "")
        return [note] if note else []

    def _is_declared_missing(self, cell: str) -> bool:
        """Tell whether a cell is a declared word, or a declared number in any form."""
        if cell in self._words:
            return True
        try:
            value = np.float64(self._notation.parse_number(cell))
        except ValueError:
            return False
        return any(bool(_mask_fill_value(value, number)) for number in self._numbers)


def describe_missing(missing_texts: Sequence[str], cell_count: int, column_clause: str) -> str:
    """Say that what was found stands for a missing value; empty where nothing was found.

    Parameters
    ----------
    missing_texts : sequence of str
        As the file writes it.
    cell_count : int
        Number of cells.
    column_clause : str
        Behind a blank, or empty.
    """
    if not missing_texts:
        return ""
    cells = "cell" if cell_count == 1 else "cells"
    verb = "stands" if len(missing_texts) == 1 else "stand"
    return (
        f"{' and '.join(missing_texts)}{column_clause} ({cell_count} {cells}) {verb} for a "
        "missing value"
    )


def list_missing_words(cells: Sequence[str]) -> tuple[str, ...]:
    """List the cells that say by a word that nothing is there.

    An empty cell needs no word, and ``nan`` is what a program writes for no number.
    """
    return tuple(cell for cell in cells if is_missing_word(cell) and not _is_empty_or_nan(cell))


def _is_empty_or_nan(cell: str) -> bool:
    """Tell whether a cell is empty or ``nan``, and so needs no note."""
    return cell.strip().lower().lstrip("+-") in ("", "nan")


def is_missing_word(text: str) -> bool:
    """Tell whether a cell of a column of numbers says that nothing is there."""
    return text.strip().strip('"').strip().lower() in _WORDS


def replace_fill_values_by_nan(
    values: NDArray[np.float64], declared: Sequence[float] | None = None
) -> FillFound:
    """Put NaN in place of the values that fill the gaps of a column.

    Parameters
    ----------
    values : array, shape (n,) or (rows, columns)
        Numbers as they stand in the file.
    declared : sequence of float, optional
        Values that the user names: each counts wherever it stands, and no other does. By default
        those of `FILL_VALUES` count that are three times as large as every other number.

    Returns
    -------
    FillFound
        The numbers, and which values were taken as missing.
    """
    candidates = FILL_VALUES if declared is None else tuple(declared)
    present = []
    is_fill = np.zeros(values.shape, dtype=bool)
    for candidate in candidates:
        found = _mask_fill_value(values, candidate)
        if found.any():
            present.append(candidate)
            is_fill |= found
    if present and declared is None:
        present = _choose_outlying_fills(values[~is_fill], present)
        is_fill = _mask_fill_values(values, present)
    if not present:
        return FillFound(values)
    blanked = np.where(is_fill, np.nan, values)
    return FillFound(blanked, tuple(present), count=int(is_fill.sum()))


def _choose_outlying_fills(
    other_values: NDArray[np.float64], present_fills: Sequence[float]
) -> list[float]:
    """Return the fill values that are far larger than all other numbers of their column."""
    finite = np.abs(other_values[np.isfinite(other_values)])
    if not finite.size:
        return []
    largest = float(finite.max())
    return [fill for fill in present_fills if abs(fill) > _STANDS_OUT * largest]


def _mask_fill_values(values: NDArray[np.float64], fills: Sequence[float]) -> NDArray[np.bool_]:
    """Return a mask of the numbers that equal one of some fill values."""
    is_fill = np.zeros(values.shape, dtype=bool)
    for fill in fills:
        is_fill |= _mask_fill_value(values, fill)
    return is_fill


def _mask_fill_value(values: NDArray[np.float64] | np.float64, fill: float) -> NDArray[np.bool_]:
    """Return a mask of the numbers that equal a fill value; a huge one may be rounded."""
    if abs(fill) < _HUGE:
        return np.asarray(values == fill)
    return np.asarray(np.abs(values - fill) <= _ROUNDING * abs(fill))
