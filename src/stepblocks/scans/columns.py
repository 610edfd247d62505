"""Which column of a table holds the positions, and which the heights."""

import re
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.text_table import NumberTable
from stepblocks.scans.units import UNIT_PATTERN, UNITS_PER_METRE, StoredLength

_UNIT_IN_NAME = re.compile(rf"(?:^|[\s_\[\(/,]){UNIT_PATTERN}[\]\)]?$")
_UNKNOWN_UNIT = re.compile(r"[\[(][^\[\]()]+[\])]$")
# Names of a column that only counts the points
_COUNTERS = {"index", "#", "no", "no.", "nr", "n", "point", "points", "sample"}
# How instruments begin the name of a column of an axis
_X_NAMES = ("x", "lateral", "pos", "length", "distance", "scan", "travel")
_Y_NAMES = ("y",)
_Z_NAMES = ("z", "height", "raw", "profile", "total", "depth", "level", "deviation")
# Extent of a column as a part of the others [1], below which it says where a profile was taken
_CONSTANT = 1e-3
_MOST_REPEATED = 0.5  # part of the points of a profile that may share a position [1]


@dataclass(frozen=True)
class Columns:
    """Columns of a table by what they hold; a profile has no `y`."""

    x: int
    z: int
    y: int | None = None

    def get_columns_by_axis(self) -> dict[str, int]:
        """Return the indices of the columns by the letters of their axes."""
        if self.y is None:
            return {"x": self.x, "z": self.z}
        return {"x": self.x, "y": self.y, "z": self.z}


def choose_position_and_height_columns(table: NumberTable, channel: str | None) -> Columns:
    """Choose the columns of a profile or a map.

    Parameters
    ----------
    table : NumberTable
        Two columns are x and z, three are x, y and z; more must have names.
    channel : str or None
        Name of the column of heights, or a part of it.

    Returns
    -------
    Columns
        What holds positions and heights; a column that counts the points is neither.

    Raises
    ------
    MetrologyError
        If the columns are ambiguous.
    """
    candidates = []
    for column in range(table.values.shape[1]):
        name = table.get_column_name(column)
        if name is None or name.lower() not in _COUNTERS:
            candidates.append(column)
    if len(candidates) > 3 or channel is not None:
        return _choose_columns_by_names(table, candidates, channel)
    named = _choose_columns_by_clear_names(table, candidates)
    if named is not None:
        return named
    if len(candidates) == 3:
        return _choose_columns_by_extent(table, candidates)
    if len(candidates) == 2:
        x, z = candidates
        return Columns(x, z)
    raise MetrologyError(
        f"table must have 2 columns (x, z) or 3 (x, y, z), got {len(candidates)} [{table.source}]"
    )


def _choose_columns_by_clear_names(
    table: NumberTable, candidate_columns: list[int]
) -> Columns | None:
    """Choose two or three columns by their names; None where these do not tell.

    Where x is not among them, y says where a profile runs.

    Raises
    ------
    MetrologyError
        If two columns have the name of heights.
    """
    if not table.names:
        return None
    names = _get_lower_names_by_column(table, candidate_columns)
    heights = _find_columns_beginning_with(names, _Z_NAMES)
    along = _find_columns_beginning_with(names, _X_NAMES)
    across = _find_columns_beginning_with(names, _Y_NAMES)
    if len(heights) > 1 and (along or across):
        raise MetrologyError(
            "channel must name the column of heights, one of "
            f"{', '.join(table.names[column] for column in heights)} [{table.source}]"
        )
    if len(heights) != 1 or len(along) > 1 or len(across) > 1:
        return None
    if along and across:
        return _drop_constant_position_column(table, Columns(along[0], heights[0], across[0]))
    if along or across:
        return Columns((along or across)[0], heights[0])
    return None


def _drop_constant_position_column(table: NumberTable, columns: Columns) -> Columns:
    """Turn a map into a profile where one of its positions is constant."""
    if columns.y is None:
        return columns
    x, y = (table.values[:, column] for column in (columns.x, columns.y))
    extent_x = float(np.nanmax(x) - np.nanmin(x))
    extent_y = float(np.nanmax(y) - np.nanmin(y))
    if extent_y < _CONSTANT * extent_x:
        return Columns(columns.x, columns.z)
    if extent_x < _CONSTANT * extent_y:
        return Columns(columns.y, columns.z)
    return columns


def _get_lower_names_by_column(table: NumberTable, columns: list[int]) -> dict[int, str]:
    """Return the names of columns in lower case, by the places of the columns."""
    return {column: table.names[column].lower() for column in columns}


def _choose_columns_by_names(
    table: NumberTable, candidate_columns: list[int], channel: str | None
) -> Columns:
    """Choose columns by what instruments call them, heights by the channel where one is named."""
    names = {}
    if table.names:
        names = _get_lower_names_by_column(table, candidate_columns)
    if channel is None:
        heights = _find_columns_beginning_with(names, _Z_NAMES)
    else:
        heights = _find_channel_columns(names, channel.lower())
    if len(heights) != 1:
        raise MetrologyError(
            "channel must be a part of the name of one column, that of the heights, got "
            f"{channel or 'none'} for {', '.join(table.names) or 'no names'} [{table.source}]"
        )
    along = _find_columns_beginning_with(names, _X_NAMES)
    across = _find_columns_beginning_with(names, _Y_NAMES)
    if len(along) != 1 or len(across) > 1:
        raise MetrologyError(
            "table of more than 3 columns must name one x, and one y if it is a map, got "
            f"{', '.join(table.names)} [{table.source}]"
        )
    return Columns(along[0], heights[0], across[0] if across else None)


def _find_columns_beginning_with(
    names_by_column: dict[int, str], beginnings: tuple[str, ...]
) -> list[int]:
    """Find the columns whose names begin with one of some beginnings."""
    return [column for column, name in names_by_column.items() if name.startswith(beginnings)]


def _find_channel_columns(names_by_column: dict[int, str], channel: str) -> list[int]:
    """Find the column of that name, or else all whose names contain it, all in lower case."""
    exact = [column for column, name in names_by_column.items() if name == channel]
    if exact:
        return exact
    return [column for column, name in names_by_column.items() if channel in name]


def _choose_columns_by_extent(table: NumberTable, candidate_columns: list[int]) -> Columns:
    """Take three columns for a map, unless one is constant: they are then a profile.

    A column is constant where its extent is far below that of the others; it says where the
    profile was taken. One of the others must then hold positions, each once.
    """
    values = table.values[:, candidate_columns]
    # fmax and fmin: a column may miss points, and is not a number where all are missing
    extent = np.fmax.reduce(values) - np.fmin.reduce(values)
    first_constant, second_constant, third_constant = extent < _CONSTANT * np.sort(extent)[1]
    first_holds_positions = _holds_positions(table, candidate_columns[0])
    second_holds_positions = _holds_positions(table, candidate_columns[1])
    first, second, third = candidate_columns
    if third_constant and first_holds_positions and second_holds_positions:
        return Columns(first, second)
    if second_constant and first_holds_positions:
        return Columns(first, third)
    if first_constant and second_holds_positions:
        return Columns(second, third)
    return Columns(first, third, second)


def _holds_positions(table: NumberTable, column: int) -> bool:
    """Tell whether the values of a column repeat as little as positions do."""
    values = table.values[:, column]
    return len(np.unique(values)) > _MOST_REPEATED * len(values)


def find_column_unit(
    table: NumberTable, column: int, axis: str, stated_units: dict[str, StoredLength]
) -> StoredLength:
    """Find the unit of a column: its name says it, or else the user or the head of the table.

    Parameters
    ----------
    table : NumberTable
        The table, with what its head says.
    column : int
        Index of the column.
    axis : {"x", "y", "z"}
        What it holds.
    stated_units : dict of str to StoredLength
        What the user states, by axis.

    Raises
    ------
    MetrologyError
        If nobody says it, or the user contradicts the name of the column.
    """
    name = table.get_column_name(column)
    stated = stated_units.get(axis)
    found = None if name is None else _UNIT_IN_NAME.search(name.lower())
    if found is not None:
        of_name = StoredLength(1.0, UNITS_PER_METRE[found[1]])
        if stated is not None and stated != of_name:
            raise MetrologyError(
                f"unit given for {axis} must agree with its column {name!r} [{table.source}]"
            )
        return of_name
    if stated is not None:
        return stated
    if table.unit is not None:
        return table.unit
    if name is not None and _UNKNOWN_UNIT.search(name):
        raise MetrologyError(
            f"unit of column {name!r} must be one of nm, um, mm, m, in, mil, uin, or a unit must "
            f"be given (--units um) [{table.source}]"
        )
    rule = f"column {name!r} must name its unit" if name else "columns must name their unit"
    raise MetrologyError(
        f"{rule} (x_um, z [nm], ...) or a unit must be given (--units um) [{table.source}]"
    )
