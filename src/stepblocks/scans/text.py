"""Profiles and maps from plain text (CSV, TSV, XYZ) and from tables in memory.

The columns or the user say the units (``x_um``, ``Raw (Å)``); a table without units is refused.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.files.decode import decode_text
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.missing import FillFound, replace_fill_values_by_nan
from stepblocks.files.tables import Table
from stepblocks.scans.columns import Columns, choose_position_and_height_columns, find_column_unit
from stepblocks.scans.points import make_map_from_points
from stepblocks.scans.scan import Array, HeightMap, ScannedProfile
from stepblocks.scans.text_table import (
    MOST_COLUMNS,
    NumberTable,
    parse_decimal_point_number,
    parse_number_table,
)
from stepblocks.scans.units import StoredLength, parse_units

if TYPE_CHECKING:
    import pandas as pd

_MOST_BYTES = 256 * 2**20
_HEAD_BYTES = 4000  # in which a matrix of heights says that it is one
_PROBED_CHARACTERS = 4096  # in which binary data show themselves by a zero
# What the head of a matrix of heights says, as SPIP, Gwyddion and others write it
_MATRIX_HEAD = re.compile(
    r"pixel size|value units|x-pixels|^#?\s*(width|breite|kanal|channel|h=\d+)",
    re.IGNORECASE | re.MULTILINE,
)
_MOST_BACKWARD = 0.1  # part of the points of a profile that may lie behind one before them [1]
_SAMPLED_NUMBERS = 2000  # in which the last printed digit is looked for
# Distance from equal steps, in last digits of the positions, that rounding explains [1]
_ROUNDING = 0.75
_LEAST_WITH_POSITIONS = 5  # rows and columns of a matrix that may hold positions, too
_UNEQUAL = 0.05  # between steps of positions, over their mean [1]
_SOURCE_OF_TABLE = "table.csv"


def has_matrix_head(path: Path) -> bool:
    """Tell whether the head of a text states the size of a matrix of heights."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES).decode("latin-1").replace("\0", "")
    return _MATRIX_HEAD.search(head) is not None


def read_text_scan(
    path: Path,
    unit: str | None = None,
    channel: str | None = None,
    layout: TableLayout = UNDECLARED,
) -> ScannedProfile | HeightMap:
    """Read a profile or a map of heights from text.

    Parameters
    ----------
    path : Path
        A table of two columns (a profile), of three or of columns with names (a profile or a grid
        of points), or a matrix of heights.
    unit : str, optional
        Unit of what does not say its own, as `parse_units` reads it.
    channel : str, optional
        Name of the column of heights, or a part of it.
    layout : TableLayout
        What is declared of the text.

    Returns
    -------
    ScannedProfile or HeightMap
        Heights and positions [m].

    Raises
    ------
    MetrologyError
        If the text holds no table, or its units or columns are ambiguous.
    """
    size = path.stat().st_size
    if size > _MOST_BYTES:
        raise MetrologyError(
            f"text must not exceed {_MOST_BYTES >> 20} MiB, got {size} bytes [{path.name}]"
        )
    decoded = decode_text(path.read_bytes(), path.name, MetrologyError, layout.encoding)
    if "\0" in decoded.text[:_PROBED_CHARACTERS]:
        raise MetrologyError(f"file must be text, got binary data [{path.name}]")
    scan = _make_scan_from_table(parse_number_table(decoded.text, path.name, layout), unit, channel)
    if decoded.note:
        scan = replace(scan, scale=f"{scan.scale}; {decoded.note}")
    return scan


def read_table_scan(
    table: Table, unit: str | None = None, channel: str | None = None
) -> ScannedProfile | HeightMap:
    """Read a profile or a map of heights from a table in memory.

    Parameters
    ----------
    table : pandas.DataFrame
        The columns that a text would hold; a missing number is a point that was not measured.
    unit, channel : str, optional
        As for `read_text_scan`.

    Returns
    -------
    ScannedProfile or HeightMap
        The scan that the text of the same columns gives.

    Raises
    ------
    MetrologyError
        If a column holds no numbers, or units or columns are ambiguous.
    """
    columns = len(table.columns)
    if len(table) == 0 or not 2 <= columns <= MOST_COLUMNS:
        raise MetrologyError(
            f"table must have rows and 2 to {MOST_COLUMNS} columns, got {len(table)} rows and "
            f"{columns} columns [{_SOURCE_OF_TABLE}]"
        )
    names = tuple(name for name in table.columns if isinstance(name, str) and name)
    if len(names) < columns:  # numbered columns have no names
        names = ()
    values = np.column_stack(
        [_read_column_numbers(table.iloc[:, index]) for index in range(columns)]
    )
    return _make_scan_from_table(NumberTable(names, values, None, _SOURCE_OF_TABLE), unit, channel)


def _read_column_numbers(column: "pd.Series") -> Array:
    """Read a column of a table as float64, shape (n,), as a text of it would be read.

    Single precision counts as its shortest decimal, a word as one of the words for a missing point.
    """
    kind = column.dtype.kind
    try:
        if kind == "O":
            filled = column.where(column.notna(), "nan")
            return np.array(
                [parse_decimal_point_number(str(entry)) for entry in filled], dtype=np.float64
            )
        if kind == "f" and np.dtype(column.to_numpy().dtype).itemsize < 8:
            return np.asarray(column.to_numpy().astype(str), dtype=np.float64)
        if kind in "iuf":
            return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan))
    except ValueError as error:
        raise MetrologyError(
            f"column {column.name!r} must hold numbers: {error} [{_SOURCE_OF_TABLE}]"
        ) from error
    raise MetrologyError(
        f"column {column.name!r} must hold numbers, got {column.dtype} [{_SOURCE_OF_TABLE}]"
    )


@dataclass(frozen=True)
class _Axis:
    """One column of a scan."""

    name: str | None
    stored: Array  # numbers as they stand in the table
    unit: StoredLength

    @property
    def values(self) -> Array:
        """Positions or heights [m]."""
        return self.unit.to_metres(self.stored)

    def compute_last_digit(self, least_decimals: int = 0) -> float:
        """Compute the last digit that the numbers are printed with [m].

        It is taken from the shortest decimals that give the numbers back.
        """
        decimals = least_decimals
        sample = self.stored[:: max(len(self.stored) // _SAMPLED_NUMBERS, 1)]
        for number in sample.tolist():
            mantissa, _, exponent = repr(number).partition("e")
            fraction = mantissa.partition(".")[2].rstrip("0")
            decimals = max(decimals, len(fraction) - int(exponent or 0))
        return self.unit.to_metres(float(10.0**-decimals))


def _make_scan_from_table(
    table: NumberTable, unit: str | None, channel: str | None
) -> ScannedProfile | HeightMap:
    """Make a profile or a map of a table; a table without names may be a matrix of heights."""
    units = parse_units(unit)
    if table.values.shape[1] > 3 and not table.names and channel is None:
        return _make_map_of_matrix(table, units)
    columns = choose_position_and_height_columns(table, channel)
    found = _blank_missing_heights(table, table.values[:, columns.z])
    if found.count:
        values = table.values.copy()
        values[:, columns.z] = found.values
        table = replace(table, values=values)
    axes = _build_axes(table, columns, units)
    _refuse_missing_or_infinite(table, columns)
    notes = [_describe_unit_origin(axes, unit), *table.notes]
    if found.count:
        notes.append(
            found.describe_missing_values(table.get_column_name(columns.z) or "the heights")
        )
    scale = "; ".join(notes)
    if "y" in axes:
        return _make_map_of_points(axes, scale, table.source)
    return _make_forward_profile(axes, scale, table.source)


def _refuse_missing_or_infinite(table: NumberTable, columns: Columns) -> None:
    """Refuse a position that is missing or infinite, and a height that is infinite, by its line."""
    for axis, column in columns.get_columns_by_axis().items():
        numbers = table.values[:, column]
        is_wrong = np.isinf(numbers)
        if axis != "z":
            is_wrong |= np.isnan(numbers)
        is_known = bool(np.isfinite(numbers).any())  # else the whole column is refused
        if is_wrong.any() and is_known:
            row = int(np.flatnonzero(is_wrong)[0])
            raise MetrologyError(
                f"{table.get_column_name(column) or axis} must be a finite number, got "
                f"{numbers[row]:g} [{table.format_row_place(row)}]"
            )


def _blank_missing_heights(table: NumberTable, heights: Array) -> FillFound:
    """Find the heights that stand for a missing one: as declared, or those that stand out."""
    if table.missing is None:
        return replace_fill_values_by_nan(heights)
    return replace_fill_values_by_nan(heights, table.missing.numbers)


def _make_map_of_points(columns_by_axis: Mapping[str, _Axis], scale: str, source: str) -> HeightMap:
    """Make a map of points that lie on a grid."""
    x, y, z = (columns_by_axis[name].values for name in "xyz")
    return replace(
        make_map_from_points(x, y, z, source, scale),
        count=columns_by_axis["z"].compute_last_digit(),
    )


def _make_forward_profile(
    columns_by_axis: Mapping[str, _Axis], scale: str, source: str
) -> ScannedProfile:
    """Make a profile that runs forward, and note in its scale what was changed."""
    notes = [scale]
    x = columns_by_axis["x"].values
    z = columns_by_axis["z"].values
    if x[-1] < x[0]:
        x, z = x[::-1], z[::-1]
    forward = _find_forward_points(x, source)
    if not forward.all():
        x, z = x[forward], z[forward]
        notes.append(f"{len(forward) - len(x)} points left out where the profile goes back")
    even = _fit_equal_steps_or_none(x, columns_by_axis["x"].compute_last_digit(least_decimals=1))
    if even is not None:
        if _is_any_point_moved(x, even):
            notes.append("positions set to equal steps within their last digit")
        x = even
    count = columns_by_axis["z"].compute_last_digit()
    return ScannedProfile(x, z, source=source, scale="; ".join(notes), count=count)


def _build_axes(
    table: NumberTable, columns: Columns, stated_units: dict[str, StoredLength]
) -> dict[str, _Axis]:
    """Find name, numbers and unit of the column of each axis."""
    axes = {}
    for axis, column in columns.get_columns_by_axis().items():
        unit = find_column_unit(table, column, axis, stated_units)
        axes[axis] = _Axis(table.get_column_name(column), table.values[:, column], unit)
    return axes


def _describe_unit_origin(columns_by_axis: Mapping[str, _Axis], unit: str | None) -> str:
    """Say where the units of the columns come from."""
    names = [axis.name for axis in columns_by_axis.values() if axis.name]
    if names:
        return f"columns {', '.join(names)}"
    return f"columns unit {unit or 'of the head'} as given"


def _find_forward_points(x: Array, source: str) -> NDArray[np.bool_]:
    """Find the points of a profile that lie ahead of all before them.

    Parameters
    ----------
    x : array, shape (n,)
        Positions [m]; where one is missing, all points are taken, and the profile refuses them.
    source : str
        For the message.

    Returns
    -------
    array of bool, shape (n,)
        Which points to keep.
    """
    forward = np.concatenate([[True], x[1:] > np.maximum.accumulate(x)[:-1]])
    if not np.isfinite(x).all():
        return np.ones(len(x), dtype=bool)
    backward = int((~forward).sum())
    if backward > _MOST_BACKWARD * len(x):
        reason = ""
        if int((np.diff(x) < 0.0).sum()) == 1:
            reason = "; a second profile needs a file of its own"
        share = backward / len(x)
        raise MetrologyError(
            f"positions must increase along the profile at all but {_MOST_BACKWARD:.0%} of its "
            f"points, got {share:.0%} that lie behind one before them{reason} [{source}]"
        )
    return forward


def _fit_equal_steps_or_none(x: Array, last_digit: float) -> Array | None:
    """Fit equal steps to positions [m] that were rounded to a last digit [m].

    The result is None where rounding does not explain the distances, or where they are equal.
    """
    if len(x) < 3 or not np.isfinite(x).all():
        return None
    index = np.arange(len(x))
    even = np.polynomial.Polynomial.fit(index, x, 1)(index)
    farthest = float(np.abs(even - x).max())
    if farthest == 0.0 or farthest > _ROUNDING * last_digit:
        return None
    return np.asarray(even, dtype=np.float64)


def _is_any_point_moved(x: Array, even_positions: Array) -> bool:
    """Tell whether equal steps move any point by more than rounding explains."""
    length = abs(float(x[-1] - x[0]))
    return float(np.abs(even_positions - x).max()) > 1e-9 * length


def _refuse_positions_beside_heights(table: NumberTable) -> None:
    """Refuse a matrix whose first row and first column are positions, unlike those beside them."""
    values = table.values
    if min(values.shape) < _LEAST_WITH_POSITIONS:
        return
    is_column_of_positions = _rises_by_equal_steps(values[1:, 0])
    is_row_of_positions = _rises_by_equal_steps(values[0, 1:])
    are_next_alike = _rises_by_equal_steps(values[1, 1:]) or _rises_by_equal_steps(values[1:, 1])
    if is_column_of_positions and is_row_of_positions and not are_next_alike:
        raise MetrologyError(
            "a matrix must hold heights alone, got a first row and a first column that rise by "
            f"equal steps, as positions do [{table.source}]"
        )


def _rises_by_equal_steps(numbers: Array) -> bool:
    """Tell whether numbers, shape (n,), rise or fall by steps that are equal within rounding."""
    steps = np.diff(numbers)
    mean = float(steps.mean())
    return bool(mean != 0.0 and np.abs(steps - mean).max() < _UNEQUAL * abs(mean))


def _make_map_of_matrix(table: NumberTable, stated_units: Mapping[str, StoredLength]) -> HeightMap:
    """Make a map of heights without a head, whose step and unit the user states."""
    steps_are_stated = all(axis in stated_units and stated_units[axis].is_step for axis in "xy")
    if not steps_are_stated or "z" not in stated_units:
        raise MetrologyError(
            "the spacing of a matrix of heights must be given for x and y, with the unit of the "
            "heights, as x=0.5um,y=0.5um,z=nm (a table has 2 columns, x, z, or 3, x, y, z), got "
            f"{table.values.shape[1]} columns [{table.source}]"
        )
    _refuse_positions_beside_heights(table)
    found = _blank_missing_heights(table, table.values)
    heights = _Axis(None, found.values.ravel(), stated_units["z"])
    notes = ["matrix with the spacing and unit given", *table.notes]
    if found.count:
        notes.append(found.describe_missing_values("the heights"))
    return HeightMap(
        found.values * stated_units["z"].metres,
        stated_units["x"].metres,
        stated_units["y"].metres,
        source=table.source,
        scale="; ".join(notes),
        count=heights.compute_last_digit(),
    )
