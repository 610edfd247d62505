"""Tables of lengths and angles: a column for each unit, and rows as text."""

import math
from collections.abc import Mapping

import numpy as np

from stepblocks.files.table_rows import list_rows_by_column_name
from stepblocks.files.tables import Table
from stepblocks.inspect.judgement import is_angle

# columns that are sizes, with the digits that a page shows of them
_DIGITS = {"value": 5, "u": 3, "u95": 3, "lower": 7, "upper": 7, "std": 3, "std_within": 3}
_LIMIT_DECIMALS = 9  # to which sizes are rounded, so that a limit reads as it was declared
_ANGLE, _LENGTH = "deg", "um"


def split_sizes_by_unit(table: Table) -> Table:
    """Give each size [m or rad] a column for lengths and one for angles.

    A row has it in that of its unit, which a column ``unit`` names. The table itself is changed.
    """
    sizes = [name for name in table if name in _DIGITS]
    has_angle = table["characteristic"].map(is_angle).to_numpy(dtype=bool)
    units = np.where(has_angle, _ANGLE, _LENGTH)
    table.insert(list(table.columns).index(sizes[0]), "unit", units)
    for name in sizes:
        place = list(table.columns).index(name)
        size = table.pop(name).astype(float)
        table.insert(place, f"{name}_{_ANGLE}", np.where(has_angle, np.degrees(size), np.nan))
        table.insert(place, f"{name}_{_LENGTH}", 1e6 * size.mask(has_angle))
    return table


def format_table_rows(table: Table) -> list[Mapping[str, object]]:
    """Return the rows of a table of `split_sizes_by_unit` as text, each in its unit."""
    return list(map(_format_row, list_rows_by_column_name(table)))


def _format_row(row: Mapping[str, object]) -> dict[str, object]:
    """Return a row with its sizes under their names alone."""
    shown: dict[str, object] = {}
    ending = f"_{row['unit']}"
    for column, cell in row.items():
        name = column.rpartition("_")[0]
        if name not in _DIGITS:
            shown[column] = cell
        elif column.endswith(ending):
            shown[name] = _format_size(cell, _DIGITS[name])
    return shown


def _format_size(cell: object, digits: int) -> object:
    """Write a size to some digits; None of one that is infinite or does not exist."""
    if not isinstance(cell, float):
        return cell
    if not math.isfinite(cell):
        return None
    return f"{round(cell, _LIMIT_DECIMALS):.{digits}g}"
