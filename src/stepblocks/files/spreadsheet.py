"""Tables in workbooks of Excel and LibreOffice: the first sheet that holds anything.

The file is read in a confined process. Merged cells are refused by name: to the reader they are one
value and empty cells, and which row or column the value belongs to is not said.
"""

import datetime
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.confined import read_confined
from stepblocks.files.raw_table import RawTable, Record, name_sheet_column

__all__ = ["read_sheet"]

_MOST_CELLS = 20_000_000
_TABLE = "{urn:oasis:names:tc:opendocument:xmlns:table:1.0}"


def read_sheet(path: Path, raises: type[StepblocksError]) -> RawTable:
    """Read the rows of the first sheet of a workbook that holds anything.

    Parameters
    ----------
    path : Path
        A workbook: xlsx, xlsm, xlsb, xls or ods.
    raises : type of StepblocksError
        Raised where it cannot be read, or has merged cells.

    Returns
    -------
    RawTable
        Cells as texts: numbers with a decimal point, dates as ISO 8601 writes them.
    """
    found = read_confined(f"{__name__}:read_cells_in_worker", path, raises=raises)
    if found["merged"]:
        raise raises(
            f"cells must not be merged, got {found['merged']}: split them, and write a value into "
            f"each cell [{path}, {found['sheet']}]"
        )
    records = []
    for number, cells in enumerate(found["rows"], start=1):
        record = Record(number, cells)
        if not record.is_empty:
            records.append(record)
    notes = []
    if found["others"]:
        notes.append(f"sheet {found['sheet']!r} is read, not {', '.join(found['others'])}")
    return RawTable(records, sheet=found["sheet"], notes=tuple(notes))


def read_cells_in_worker(path: Path) -> dict[str, object]:
    """Read the cells of a sheet as texts; called in the confined process.

    Returns
    -------
    dict
        ``sheet``, its name; ``rows``, lists of texts; ``merged``, the first merged cells, or an
        empty text; ``others``, the names of further sheets that hold anything.
    """
    try:
        from python_calamine import CalamineWorkbook
    except ImportError as error:
        raise PipelineError(
            f"a workbook needs python-calamine: install it, or save the sheet as CSV [{path.name}]"
        ) from error
    workbook = CalamineWorkbook.from_path(str(path))
    filled = []
    for name in workbook.sheet_names:
        sheet = workbook.get_sheet_by_name(name)
        if sheet.total_height * sheet.total_width > _MOST_CELLS:
            raise PipelineError(f"a sheet must have at most {_MOST_CELLS} cells [{path.name}]")
        if sheet.total_height:
            filled.append(name)
    if not filled:
        return {"sheet": workbook.sheet_names[0], "rows": [], "merged": "", "others": []}
    sheet = workbook.get_sheet_by_name(filled[0])
    rows = []
    for row in sheet.to_python(skip_empty_area=False):
        rows.append(list(map(_format_cell, row)))
    if path.suffix.lower() == ".ods":
        merged = next(_yield_merged_ranges_of_ods(path, filled[0]), "")
    else:
        merged = _name_first_merged_range(sheet.merged_cell_ranges)
    return {"sheet": filled[0], "rows": rows, "merged": merged, "others": filled[1:]}


def _format_cell(cell: object) -> str:
    """Write a cell as a text would hold it."""
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, float):
        return repr(cell).removesuffix(".0")
    if isinstance(cell, datetime.datetime):
        return cell.isoformat(sep=" ")
    if isinstance(cell, datetime.date | datetime.time):
        return cell.isoformat()
    return str(cell).strip()


def _name_first_merged_range(ranges: list[tuple[tuple[int, int], tuple[int, int]]] | None) -> str:
    """Name the first of some merged cells, as ``A1:C1``."""
    if not ranges:
        return ""
    (first_row, first_column), (last_row, last_column) = min(ranges)
    first = f"{name_sheet_column(first_column)}{first_row + 1}"
    last = f"{name_sheet_column(last_column)}{last_row + 1}"
    return f"{first}:{last}"


def _yield_merged_ranges_of_ods(path: Path, sheet: str) -> Iterator[str]:
    """Yield the merged cells of a sheet of LibreOffice, which calamine does not report."""
    from lxml import etree

    with zipfile.ZipFile(path) as archive, archive.open("content.xml") as content:
        tree = etree.parse(content, etree.XMLParser(resolve_entities=False, no_network=True))
    for table in tree.iter(f"{_TABLE}table"):
        if table.get(f"{_TABLE}name") == sheet:
            yield from _yield_merged_ranges_of_table(table)


def _yield_merged_ranges_of_table(table: Any) -> Iterator[str]:
    """Yield the merged cells of one table of a document."""
    row_number = 1
    for row in table.iter(f"{_TABLE}table-row"):
        column = 0
        for cell in row:
            columns = _read_repetition_or_span(cell.attrib, "number-columns-spanned")
            rows = _read_repetition_or_span(cell.attrib, "number-rows-spanned")
            if columns > 1 or rows > 1:
                first = f"{name_sheet_column(column)}{row_number}"
                last = f"{name_sheet_column(column + columns - 1)}{row_number + rows - 1}"
                yield f"{first}:{last}"
            column += _read_repetition_or_span(cell.attrib, "number-columns-repeated")
        row_number += _read_repetition_or_span(row.attrib, "number-rows-repeated")


def _read_repetition_or_span(attributes: Mapping[str, str], name: str) -> int:
    """Return how often a cell is repeated or how far it spans; 1 where it is not stated."""
    return int(attributes.get(f"{_TABLE}{name}", "1"))
