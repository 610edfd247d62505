"""A filled inspection sheet, as CSV with any separator or as a spreadsheet.

Each measured line is read in SI.
"""

import math
import zipfile
from pathlib import Path

from stepblocks.artefacts.on_paper import COLUMNS
from stepblocks.artefacts.qif_read import QifResult
from stepblocks.errors import MetrologyError

_VALUE, _STD = "measured_mm_or_deg", "std_mm_or_deg"
_MOST_BYTES = 4 * 2**20
_FACTORS = {"mm": 1e-3, "deg": math.radians(1.0)}


def is_filled_sheet(path: Path) -> bool:
    """Tell whether a file is a spreadsheet, or a text table with the columns of a sheet."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return path.suffix.lower() == ".xlsx"
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return _VALUE in file.readline(10_000)


def read_filled_sheet(path: Path) -> list[QifResult]:
    """Read what was filled in, line by line; all mistakes of the sheet are named at once."""
    import pandas as pd

    try:
        if path.stat().st_size > _MOST_BYTES:
            raise MetrologyError(f"sheet must be at most {_MOST_BYTES >> 20} MiB [{path}]")
        if path.suffix.lower() == ".xlsx":
            table = pd.read_excel(path, dtype=str, engine="openpyxl")
        else:
            table = pd.read_csv(path, dtype=str, sep=None, engine="python", encoding="utf-8-sig")
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise MetrologyError(f"sheet must be a readable table: {error} [{path}]") from error
    absent = [name for name in (*COLUMNS[:2], "unit", _VALUE) if name not in table.columns]
    if absent:
        raise MetrologyError(f"sheet must keep its columns, missing {', '.join(absent)} [{path}]")
    found, mistakes = [], []
    for row in table.fillna("").to_dict("records"):
        text = {name: str(cell).strip() for name, cell in row.items()}
        if not text[_VALUE]:
            continue
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
    if mistakes:
        raise MetrologyError("\n".join(f"{one} [{path}]" for one in mistakes))
    MetrologyError.require(found, f"sheet must have at least one measured value filled in [{path}]")
    return found
