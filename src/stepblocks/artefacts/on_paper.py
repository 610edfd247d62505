"""A characteristic on paper: its limits on a drawing, its line on an inspection sheet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.atomic import write_atomically
from stepblocks.parts.characteristics import FORM
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import GUARD_FACTOR

if TYPE_CHECKING:
    import pandas as pd

_MOST_DECIMALS = 6
# columns of the CSV; where the page shows one, its heading and its share of the width
_COLUMNS = {
    "number": ("no.", 0.035),
    "characteristic": ("characteristic", 0.185),
    "kind": None,
    "nominal_mm_or_deg": ("nominal", 0.07),
    "lower_limit_mm_or_deg": ("lower limit", 0.075),
    "upper_limit_mm_or_deg": ("upper limit", 0.075),
    "unit": ("unit", 0.035),
    "method": ("method", 0.265),
    "measured_mm_or_deg": ("measured", 0.08),
    "std_mm_or_deg": ("u", 0.07),
    "verdict": ("verdict", 0.11),
}
COLUMNS = tuple(_COLUMNS)
Values = Mapping[
    str, tuple[float, float, str]
]  # measured [m], its standard uncertainty [m] and verdict, by key


def choose_decimals(*lengths: float) -> int:
    """Choose the decimals (1 to 6) that print all lengths [m] exactly in millimetres."""
    for decimals in range(1, _MOST_DECIMALS):
        if all(abs(round(length * 1e3, decimals) - length * 1e3) < 1e-9 for length in lengths):
            return decimals
    return _MOST_DECIMALS


def format_millimetres(length: float, decimals: int) -> str:
    """Return a length [m] in millimetres with trailing zeros, and zero without a sign."""
    text = f"{length * 1e3:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def format_limits(nominal: float, lower: float, upper: float, quantity: str = "length") -> str:
    """Format nominal and deviations as on a drawing.

    It writes ``0.010 ±0.001``, ``0.000 +0.002/0`` or ``16° ±1°``.
    """
    if quantity == "angle":
        value, low, high = (f"{math.degrees(one):.6g}°" for one in (nominal, lower, upper))
        return f"{value} ±{high}" if abs(upper + lower) < 1e-12 else f"{value} +{high}/{low}"
    decimals = choose_decimals(nominal, lower, upper)
    value = format_millimetres(nominal, decimals)
    if abs(upper + lower) < 1e-12:
        return f"{value} ±{format_millimetres(upper, decimals)}"
    high, low = (
        "0" if abs(one) < 1e-12 else f"{one * 1e3:+.{decimals}f}" for one in (upper, lower)
    )
    return f"{value} {high}/{low}"


def format_zone(zone: float) -> str:
    """Return the zone of a geometric tolerance as in its frame: three decimals at least."""
    return format_millimetres(zone, max(choose_decimals(zone), 3))


def describe_default_demands(stimulus: Part) -> str:
    """Say which demands on the working faces nobody has stated, if any."""
    named = ", ".join(name for name, zone in stimulus.face_demands.items() if zone.usual)
    field = stimulus.governing_field.replace("_", " ")
    return (
        named
        and f"Not stated in the order, so by default from the tolerance of the {field}: {named}."
    )


def make_sheet_table(stimulus: Part, measured: Values | None = None) -> pd.DataFrame:
    """Return the lines of the sheet, as texts."""
    import pandas as pd

    rows = []
    for number, one in enumerate(stimulus.characteristics(), start=1):
        sizes = (one.nominal, one.nominal + one.lower, one.nominal + one.upper)
        scale = math.degrees(1.0) if one.quantity == "angle" else 1e3
        if one.quantity == "angle":
            unit, limits = "deg", [f"{math.degrees(size):g}" for size in sizes]
        else:
            decimals = choose_decimals(one.nominal, one.lower, one.upper)
            unit, limits = "mm", [format_millimetres(size, decimals) for size in sizes]
        if one.kind in FORM:
            limits[:2] = "", ""
        value = (measured or {}).get(one.key)
        got = (
            ("", "", "")
            if value is None
            else (*(f"{size * scale:.6f}" for size in value[:2]), value[2])
        )
        rows.append((str(number), one.label, one.kind, *limits, unit, one.method, *got))
    return pd.DataFrame(rows, columns=COLUMNS)


def write_sheet_pdf(path: Path, stimulus: Part, measured: Values | None = None) -> None:
    """Write the sheet as one landscape A4 page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.69, 8.27))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.04, 0.05, 0.92, 0.80))
    axes.set_axis_off()
    figure.text(0.04, 0.93, f"Inspection sheet   {stimulus.id.upper()}", fontsize=15, weight="bold")
    figure.text(
        0.04,
        0.89,
        (
            f"material {stimulus.material.designation}     lengths at 20 deg C     decision ISO "
            f"14253-1, guard band {GUARD_FACTOR} u"
        ),
        fontsize=9,
    )
    figure.text(
        0.04, 0.03, (" " * 35).join(("inspector", "instrument", "date", "signature")), fontsize=9
    )
    shown = {name: heading for name, heading in _COLUMNS.items() if heading is not None}
    table = axes.table(
        cellText=make_sheet_table(stimulus, measured)[list(shown)].to_numpy().tolist(),
        colLabels=[heading for heading, _ in shown.values()],
        loc="upper center",
        cellLoc="left",
        colWidths=[width for _, width in shown.values()],
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    table.scale(1.0, 1.5)
    for (row, _), cell in table.get_celld().items():
        cell.set_linewidth(0.5)
        cell.PAD = 0.03
        if row == 0:
            cell.set_facecolor("#e6edf2")
    with write_atomically(path) as draft:
        figure.savefig(draft, format="pdf", metadata={"CreationDate": None, "ModDate": None})
