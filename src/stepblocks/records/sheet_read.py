"""A filled inspection sheet, as CSV with any separator or as a spreadsheet.

Each measured line is read in SI.
"""

import math
from collections.abc import Mapping
from pathlib import Path

from stepblocks.errors import MetrologyError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.numbers import NumberNotation
from stepblocks.files.text_table import read_column_names, read_text_table
from stepblocks.parts.on_paper import COLUMNS
from stepblocks.records.qif_read import QifResult

_NUMBER, _CHARACTERISTIC, _UNIT = "number", "characteristic", "unit"
_VALUE, _STD = "measured_mm_or_deg", "std_mm_or_deg"
_NEEDED = (*COLUMNS[:2], _UNIT, _VALUE)
_MOST_BYTES = 4 * 2**20
_FACTORS = {"mm": 1e-3, "deg": math.radians(1.0)}


def is_filled_sheet(path: Path) -> bool:
    """Tell whether a file is a workbook of Excel, or a table with the columns of a sheet."""
    return path.suffix.lower() == ".xlsx" or _VALUE in read_column_names(path)


def read_filled_sheet(path: Path, layout: TableLayout = UNDECLARED) -> list[QifResult]:
    """Read what was filled in, line by line.

    Raises
    ------
    MetrologyError
        With all mistakes of the sheet at once; or if a column is missing or nothing is filled in.
    """
    table = read_text_table(path, layout, raises=MetrologyError, most_bytes=_MOST_BYTES)
    columns = table.names
    absent = [name for name in _NEEDED if name not in columns]
    if absent:
        raise MetrologyError(f"sheet must keep its columns, missing {', '.join(absent)} [{path}]")
    results = []
    mistakes = []
    for row in table.rows:
        cells = dict(zip(columns, row, strict=True))
        if not cells[_VALUE]:
            continue
        result = _make_result_of_line(cells, table.notation)
        mistake = _describe_line_mistake(cells, result)
        if mistake:
            mistakes.append(f"{mistake} [{path}]")
        results.append(result)
    if mistakes:
        raise MetrologyError("\n".join(mistakes))
    if not results:
        raise MetrologyError(f"sheet must have at least one measured value filled in [{path}]")
    return results


def _make_result_of_line(cells_by_column: Mapping[str, str], notation: NumberNotation) -> QifResult:
    """Return what a line states, by column; nan where a size is no number or its unit unknown."""
    factor = _FACTORS.get(cells_by_column[_UNIT], math.nan)
    value = factor * _parse_cell_number_or_nan(cells_by_column[_VALUE], notation)
    std = factor * _parse_cell_number_or_nan(cells_by_column.get(_STD, ""), notation)
    return QifResult(
        name=cells_by_column[_CHARACTERISTIC],
        designator=cells_by_column[_NUMBER],
        kind="",
        value=value,
        std=std,
        status="",
        nominal=math.nan,
        limits=(math.nan, math.nan),
        serial=cells_by_column.get("serial_number", ""),
    )


def _describe_line_mistake(cells_by_column: Mapping[str, str], result: QifResult) -> str:
    """Return what is wrong with a line, by column; empty where nothing is."""
    place = f"line {cells_by_column[_NUMBER]} {cells_by_column[_CHARACTERISTIC]}"
    if not math.isfinite(result.value):
        value, unit = cells_by_column[_VALUE], cells_by_column[_UNIT]
        return f"{place}: {value!r} {unit!r} must be a number of mm or deg"
    if cells_by_column.get(_STD) and not result.std >= 0.0:
        return f"{place}: uncertainty {cells_by_column[_STD]!r} must be a number, or left blank"
    return ""


def _parse_cell_number_or_nan(cell: str, notation: NumberNotation) -> float:
    """Return the number in a cell; NaN where it holds no number."""
    try:
        return notation.parse_number(cell)
    except ValueError:
        return math.nan
