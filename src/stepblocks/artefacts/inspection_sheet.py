"""The inspection sheet: every characteristic with its number on the drawing, limits, method, and room for the value.

In the manner of first-article inspection (form 3 of AS9102): one line per characteristic; filled in where an as-built record
is given.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path

from stepblocks.artefacts.numbers import decimals_for, millimetres
from stepblocks.atomic import beside, replace_text
from stepblocks.parts.characteristics import Characteristic, characteristics_of
from stepblocks.parts.kind import Part

COLUMNS = (
    "number",
    "characteristic",
    "kind",
    "nominal_mm_or_deg",
    "lower_limit_mm_or_deg",
    "upper_limit_mm_or_deg",
    "unit",
    "method",
    "measured_mm_or_deg",
    "std_mm_or_deg",
    "verdict",
)
Values = Mapping[str, tuple[float, float, str]]


def sheet_rows(stimulus: Part, measured: Values | None = None) -> list[tuple[str, ...]]:
    """Return the lines of the sheet."""
    known = measured or {}
    return [_row(number, one, known.get(one.key)) for number, one in enumerate(characteristics_of(stimulus), start=1)]


def _row(number: int, one: Characteristic, value: tuple[float, float, str] | None) -> tuple[str, ...]:
    if one.quantity == "angle":
        nominal, lower, upper = (
            f"{math.degrees(v):g}" for v in (one.nominal, one.nominal + one.lower, one.nominal + one.upper)
        )
        unit = "deg"
    else:
        decimals = decimals_for(one.nominal, one.lower, one.upper)
        nominal, lower, upper = (
            millimetres(v, decimals) for v in (one.nominal, one.nominal + one.lower, one.nominal + one.upper)
        )
        unit = "mm"
    if one.kind in ("flatness", "parallelism"):
        nominal, lower = "", ""
    got = ("", "", "") if value is None else (f"{value[0] * 1e3:.6f}", f"{value[1] * 1e3:.6f}", value[2])
    return (str(number), one.label, one.kind, nominal, lower, upper, unit, one.method, *got)


def write_sheet_csv(path: Path, stimulus: Part, measured: Values | None = None) -> None:
    """Write the sheet as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(sheet_rows(stimulus, measured))
    replace_text(path, text.getvalue())


def write_sheet_pdf(path: Path, stimulus: Part, measured: Values | None = None) -> None:
    """Write the sheet as one landscape A4 page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = sheet_rows(stimulus, measured)
    figure = Figure(figsize=(11.69, 8.27))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.04, 0.05, 0.92, 0.80))
    axes.set_axis_off()
    figure.text(0.04, 0.93, f"Inspection sheet   {stimulus.id.upper()}", fontsize=15, weight="bold")
    figure.text(
        0.04,
        0.89,
        f"material {stimulus.material.designation}     lengths at 20 deg C     decision ISO 14253-1, guard band 1.65 u",
        fontsize=9,
    )
    figure.text(
        0.04,
        0.03,
        "inspector                                   instrument                                   date"
        "                                   signature",
        fontsize=9,
    )
    shown = (
        "no.",
        "characteristic",
        "nominal",
        "lower limit",
        "upper limit",
        "unit",
        "method",
        "measured",
        "u",
        "verdict",
    )
    cells = [[row[i] for i in (0, 1, 3, 4, 5, 6, 7, 8, 9, 10)] for row in rows]
    table = axes.table(
        cellText=cells,
        colLabels=shown,
        loc="upper center",
        cellLoc="left",
        colWidths=[0.035, 0.185, 0.07, 0.075, 0.075, 0.035, 0.265, 0.08, 0.07, 0.11],
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    table.scale(1.0, 1.5)
    for (row, _), cell in table.get_celld().items():
        cell.set_linewidth(0.5)
        cell.PAD = 0.03
        if row == 0:
            cell.set_facecolor("#e6edf2")
    with beside(path) as draft:
        figure.savefig(draft, format="pdf", metadata={"CreationDate": None, "ModDate": None})
