"""A characteristic on paper: its limits on a drawing, its line on an inspection sheet."""

import math
from collections.abc import Mapping

from stepblocks.files.tables import Table
from stepblocks.parts.characteristics import FORM, Characteristic
from stepblocks.parts.kind import Part

_MOST_DECIMALS = 6
_ZERO = 1e-12  # below it a deviation is zero, and two deviations are equal [m or rad]
_EXACT = 1e-9  # rounding within which decimals print a length exactly [mm]
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
    # filled in by hand
    "instrument",
    "serial_number",
    "inspector",
    "date",
)
# measured [m], its standard uncertainty [m] and verdict, by key
Values = Mapping[str, tuple[float, float, str]]


def choose_decimals(*lengths: float) -> int:
    """Choose the decimals (1 to 6) that print all lengths [m] exactly in millimetres."""
    for decimals in range(1, _MOST_DECIMALS):
        if all(_is_exact_in_decimals(length * 1e3, decimals) for length in lengths):
            return decimals
    return _MOST_DECIMALS


def _is_exact_in_decimals(value: float, decimals: int) -> bool:
    """Tell whether decimals print a value exactly."""
    return abs(round(value, decimals) - value) < _EXACT


def format_millimetres(length: float, decimals: int) -> str:
    """Write a length [m] in millimetres with trailing zeros, and zero without a sign."""
    text = f"{length * 1e3:.{decimals}f}"
    if float(text) == 0.0:
        return text.lstrip("-")
    return text


def format_size_with_deviations(
    nominal: float, lower_deviation: float, upper_deviation: float, quantity: str = "length"
) -> str:
    """Write nominal and deviations as on a drawing.

    It writes ``0.010 ±0.001``, ``0.000 +0.002/0`` or ``16° ±1°``.

    Parameters
    ----------
    nominal, lower_deviation, upper_deviation : float
        Nominal value and its signed deviations [m or rad].
    quantity : str
        ``"length"`` or ``"angle"``.

    Returns
    -------
    str
        Lengths in millimetres, angles in degrees.
    """
    is_symmetric = abs(upper_deviation + lower_deviation) < _ZERO
    if quantity == "angle":
        value = _format_degrees(nominal)
        high = _format_degrees(upper_deviation)
        if is_symmetric:
            return f"{value} ±{high}"
        return f"{value} +{high}/{_format_degrees(lower_deviation)}"
    decimals = choose_decimals(nominal, lower_deviation, upper_deviation)
    value = format_millimetres(nominal, decimals)
    if is_symmetric:
        return f"{value} ±{format_millimetres(upper_deviation, decimals)}"
    return (
        f"{value} {_format_deviation(upper_deviation, decimals)}/"
        f"{_format_deviation(lower_deviation, decimals)}"
    )


def _format_degrees(radians: float) -> str:
    """Write an angle, given in radians, in degrees."""
    return f"{math.degrees(radians):.6g}°"


def _format_deviation(deviation: float, decimals: int) -> str:
    """Write a deviation [m] in millimetres with its sign, or 0."""
    if abs(deviation) < _ZERO:
        return "0"
    return f"{deviation * 1e3:+.{decimals}f}"


def format_zone(zone: float) -> str:
    """Write the zone of a geometric tolerance [m] as in its frame: three decimals at least."""
    return format_millimetres(zone, max(choose_decimals(zone), 3))


def describe_default_demands(part: Part) -> str:
    """Say which demands on the working faces nobody has stated; empty if all are."""
    keys = {characteristic.key for characteristic in part.characteristics()}
    names = []
    for name, zone in part.face_demands.items():
        if not zone.usual or (name == "burr" and name not in keys):
            continue
        names.append(name.replace("_", " "))
    if not names:
        return ""
    return f"Defaults, not stated in the order: {', '.join(names)}."


def make_inspection_sheet_table(part: Part, measured_values: Values | None = None) -> Table:
    """Make the table of the inspection sheet, all its cells as texts.

    Parameters
    ----------
    part : Part
        What is inspected.
    measured_values : mapping, optional
        Measured values, their standard uncertainties and verdicts, by key.

    Returns
    -------
    DataFrame
        A line of each characteristic, with `COLUMNS`.
    """
    import pandas as pd  # a scan is inspected without it

    values = measured_values or {}
    rows = []
    for number, characteristic in enumerate(part.characteristics(), start=1):
        nominal, low, high = _format_nominal_and_limits(characteristic)
        unit = "deg" if characteristic.quantity == "angle" else "mm"
        mean, std, verdict = _format_measured_result(characteristic, values)
        rows.append(
            (
                str(number),
                characteristic.label,
                characteristic.kind,
                nominal,
                low,
                high,
                unit,
                characteristic.method,
                mean,
                std,
                verdict,
                *("", "", "", ""),
            )
        )
    return pd.DataFrame(rows, columns=COLUMNS)


def _format_nominal_and_limits(characteristic: Characteristic) -> tuple[str, str, str]:
    """Write nominal, lower and upper limit in mm or degrees; of a form only the upper one."""
    nominal = characteristic.nominal
    sizes = (nominal, nominal + characteristic.lower, nominal + characteristic.upper)
    if characteristic.quantity == "angle":
        value, low, high = (f"{math.degrees(size):g}" for size in sizes)
    else:
        decimals = choose_decimals(nominal, characteristic.lower, characteristic.upper)
        value, low, high = (format_millimetres(size, decimals) for size in sizes)
    if characteristic.kind in FORM:
        return "", "", high
    return value, low, high


def _format_measured_result(
    characteristic: Characteristic, measured_values: Values
) -> tuple[str, str, str]:
    """Write measured value, standard uncertainty and verdict; empty where nothing is measured."""
    measured = measured_values.get(characteristic.key)
    if measured is None:
        return "", "", ""
    mean, std, verdict = measured
    scale = math.degrees(1.0) if characteristic.quantity == "angle" else 1e3
    return f"{mean * scale:.6f}", f"{std * scale:.6f}", verdict
