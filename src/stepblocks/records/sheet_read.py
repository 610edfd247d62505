"""A filled inspection sheet, as CSV with any separator or as a spreadsheet.

Each measured line is read in SI.
"""

import math
from pathlib import Path

from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.parts.on_paper import COLUMNS
from stepblocks.records.qif_read import QifResult

_VALUE, _STD = "measured_mm_or_deg", "std_mm_or_deg"
_MOST_BYTES = 4 * 2**20
_FACTORS = {"mm": 1e-3, "deg": math.radians(1.0)}


def is_filled_sheet(path: Path) -> bool:
    """Tell whether a file is a spreadsheet, or a text table with the columns of a sheet."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return path.suffix.lower() == ".xlsx"
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return _VALUE in file.readline(10_000)


def read_cells_confined(path: Path) -> dict[str, object]:
    """Read columns and rows of a sheet as text; called in the confined process."""
    import pandas as pd

    MetrologyError.require(
        path.stat().st_size <= _MOST_BYTES,
        f"sheet must be at most {_MOST_BYTES >> 20} MiB [{path.name}]",
    )
    table = (
        pd.read_excel(path, dtype=str, engine="openpyxl")
        if path.suffix.lower() == ".xlsx"
        else pd.read_csv(path, dtype=str, sep=None, engine="python", encoding="utf-8-sig")
    )
    return dict(table.rename(columns=str).fillna("").to_dict("split"))


def read_filled_sheet(path: Path) -> list[QifResult]:
    """Read what was filled in, line by line; all mistakes of the sheet are named at once."""
    import pandas as pd

    table = read_confined(f"{__name__}:read_cells_confined", path, raises=MetrologyError)
    absent = [name for name in (*COLUMNS[:2], "unit", _VALUE) if name not in table["columns"]]
    MetrologyError.require(
        not absent, f"sheet must keep its columns, missing {', '.join(absent)} [{path}]"
    )
    found, mistakes = [], []
    rows = (dict(zip(table["columns"], map(str.strip, row), strict=True)) for row in table["data"])
    for text in (row for row in rows if row[_VALUE]):
        factor = _FACTORS.get(text["unit"], math.nan)
        # the decimal mark is a point or a comma; nan of what is no number
        cells = (text.get(name, "").replace(",", ".") for name in (_VALUE, _STD))
        value, std = (factor * float(pd.to_numeric(cell, errors="coerce")) for cell in cells)
        place = f"line {text['number']} {text['characteristic']}"
        if not math.isfinite(value):
            mistakes.append(
                f"{place}: {text[_VALUE]!r} {text['unit']!r} must be a number of mm or deg"
            )
        elif text.get(_STD) and not std >= 0.0:
            mistakes.append(f"{place}: uncertainty {text[_STD]!r} must be a number, or left blank")
        found.append(
            QifResult(
                text["characteristic"],
                text["number"],
                "",
                value,
                std,
                "",
                math.nan,
                (math.nan,) * 2,
                text.get("serial_number", ""),
            )
        )
    MetrologyError.require(not mistakes, "\n".join(f"{one} [{path}]" for one in mistakes))
    MetrologyError.require(found, f"sheet must have at least one measured value filled in [{path}]")
    return found
