"""A characteristic on paper: its limits on a drawing, its line on an inspection sheet."""

import math
from collections.abc import Mapping

from stepblocks.files.tables import Table
from stepblocks.parts.characteristics import FORM
from stepblocks.parts.kind import Part

_MOST_DECIMALS = 6
COLUMNS = (
    *("number", "characteristic", "kind"),
    *("nominal_mm_or_deg", "lower_limit_mm_or_deg", "upper_limit_mm_or_deg", "unit", "method"),
    *("measured_mm_or_deg", "std_mm_or_deg", "verdict"),
    *("instrument", "serial_number", "inspector", "date"),  # filled in by hand
)
# measured [m], its standard uncertainty [m] and verdict, by key
Values = Mapping[str, tuple[float, float, str]]


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
    keys = {one.key for one in stimulus.characteristics()}
    named = ", ".join(
        name.replace("_", " ")
        for name, zone in stimulus.face_demands.items()
        if zone.usual and (name != "burr" or name in keys)
    )
    return named and f"Defaults, not stated in the order: {named}."


def make_sheet_table(stimulus: Part, measured: Values | None = None) -> Table:
    """Return the lines of the sheet, as texts."""
    import pandas as pd  # a scan is inspected without it

    rows = []
    for number, one in enumerate(stimulus.characteristics(), start=1):
        sizes = (one.nominal, one.nominal + one.lower, one.nominal + one.upper)
        unit, scale = ("deg", math.degrees(1.0)) if one.quantity == "angle" else ("mm", 1e3)
        if one.quantity == "angle":
            limits = [f"{math.degrees(size):g}" for size in sizes]
        else:
            decimals = choose_decimals(one.nominal, one.lower, one.upper)
            limits = [format_millimetres(size, decimals) for size in sizes]
        if one.kind in FORM:
            limits[:2] = "", ""
        value = (measured or {}).get(one.key)
        got = (
            ("", "", "")
            if value is None
            else (*(f"{size * scale:.6f}" for size in value[:2]), value[2])
        )
        rows.append((str(number), one.label, one.kind, *limits, unit, one.method, *got, *[""] * 4))
    return pd.DataFrame(rows, columns=COLUMNS)
