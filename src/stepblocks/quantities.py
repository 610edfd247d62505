"""Units at the border, SI floats inside.

A stimulus file says ``"25 um"``; everything behind this module holds ``2.5e-05``. Pint knows the units; this
module knows which dimension each field must have and says so when it does not fit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from stepblocks.errors import QuantityError

if TYPE_CHECKING:
    import pint

# Name of each dimension a field can have, and the SI unit that its floats are in
DIMENSIONS: dict[str, str] = {
    "length": "m",
    "force": "N",
    "angle": "rad",
    "stiffness": "N/m",
    "energy": "J",
    "power": "W",
    "time": "s",
    "frequency": "Hz",
    "speed": "m/s",
    "acceleration": "m/s**2",
    "mass": "kg",
    "density": "kg/m**3",
    "pressure": "Pa",
    "temperature": "K",
    "ratio": "",
}

_MAX_TEXT = 64  # longer text is no quantity and must not reach the library
_ATOM = r"[A-Za-zµμΩ°%]+(?:\s*(?:\^|\*\*)\s*-?[1-4])?"  # a unit with a small power: no expression is ever evaluated
_UNITS = re.compile(rf"(?:(?:1\s*/\s*)?{_ATOM}(?:\s*[*/ ]\s*{_ATOM}){{0,3}})?")


@cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
    return registry


def parse_quantity(text: object, dimension: str) -> float:
    """Read a quantity with its unit and return it in SI.

    Parameters
    ----------
    text : str
        A number and a unit, such as ``"25 um"`` or ``"0.5 N"``. A ratio may be a bare number or a percentage.
    dimension : str
        One of `DIMENSIONS`.

    Returns
    -------
    float
        The value in the SI unit of `dimension`.

    Raises
    ------
    QuantityError
        If the text has no number or no unit, if the unit has another dimension, or if the value is not finite.

    Examples
    --------
    >>> parse_quantity("25 um", "length")
    2.5e-05
    >>> parse_quantity("9.81 N/mm", "stiffness")
    9810.0
    >>> parse_quantity("25 N", "length")
    Traceback (most recent call last):
    ...
    stepblocks.errors.QuantityError: must be a length such as '25 um', got '25 N'
    """
    unit = DIMENSIONS[dimension]
    wanted = f"must be a {dimension} such as {_EXAMPLE[dimension]!r}"
    if dimension == "ratio" and isinstance(text, int | float) and not isinstance(text, bool):
        value = float(text)
    elif not isinstance(text, str):
        hint = " (a number needs its unit, in quotes)" if isinstance(text, int | float) else ""
        raise QuantityError(f"{wanted}, got {text!r}{hint}")
    else:
        value = _magnitude(text, unit, wanted)
    if not math.isfinite(value):
        raise QuantityError(f"{wanted} and finite, got {text!r}")
    return value


_EXAMPLE = {
    "length": "25 um",
    "force": "0.5 N",
    "angle": "6 deg",
    "stiffness": "9.81 N/mm",
    "energy": "10 uJ",
    "power": "0.08 uW",
    "time": "16 ms",
    "frequency": "300 Hz",
    "speed": "5 mm/s",
    "acceleration": "9.81 m/s^2",
    "mass": "3 g",
    "density": "7850 kg/m^3",
    "pressure": "210 GPa",
    "temperature": "293 K",
    "ratio": "0.15",
}


def _magnitude(text: str, unit: str, wanted: str) -> float:
    number, symbol = _split_number(text) if len(text) <= _MAX_TEXT else ("", "")
    if not number or not _UNITS.fullmatch(symbol):
        raise QuantityError(f"{wanted}, got {_shorten(text)!r}")
    import pint

    try:
        quantity = _registry().Quantity(float(number), symbol or "dimensionless")
        factor = float(_registry().Quantity(1.0, quantity.units).to(unit or "dimensionless").magnitude)
        offset_free = quantity.units.is_compatible_with(unit or "dimensionless")
    except (pint.PintError, ValueError, AttributeError, TypeError, KeyError, SyntaxError, OverflowError) as error:
        raise QuantityError(f"{wanted}, got {_shorten(text)!r}") from error
    if not offset_free or (unit and not symbol):
        raise QuantityError(f"{wanted}, got {_shorten(text)!r}")
    # 25 / 1e6 is the double nearest to 25e-6; 25 * 1e-6 is not.
    inverse = round(1.0 / factor) if factor < 1.0 else 0
    if inverse and abs(factor * inverse - 1.0) < 1e-12:
        return float(number) / inverse
    return float(number) * factor


def _split_number(text: str) -> tuple[str, str]:
    stripped = text.strip()
    end = 0
    while end < len(stripped) and (stripped[end] in "+-.0123456789" or _is_exponent(stripped, end)):
        end += 1
    return stripped[:end], stripped[end:].strip()


def _is_exponent(text: str, index: int) -> bool:
    return text[index] in "eE" and index > 0 and index + 1 < len(text) and text[index + 1] in "+-0123456789"


def _shorten(text: str) -> str:
    return text if len(text) <= _MAX_TEXT else text[: _MAX_TEXT - 3] + "..."


def quantity_parser(dimension: str) -> Callable[[object], float]:
    """Return a function of one argument that reads quantities of one dimension, for use as a validator.

    Parameters
    ----------
    dimension : str
        One of `DIMENSIONS`.

    Returns
    -------
    callable
        ``parse_quantity`` with its dimension fixed.

    Examples
    --------
    >>> quantity_parser("force")("500 mN")
    0.5
    """

    def parse(text: object) -> float:
        return parse_quantity(text, dimension)

    return parse


_SCALES: dict[str, tuple[tuple[float, str], ...]] = {
    "length": ((1e-9, "nm"), (1e-6, "um"), (1e-3, "mm"), (1.0, "m")),
    "energy": ((1e-9, "nJ"), (1e-6, "uJ"), (1e-3, "mJ"), (1.0, "J")),
    "power": ((1e-9, "nW"), (1e-6, "uW"), (1e-3, "mW"), (1.0, "W")),
    "time": ((1e-6, "us"), (1e-3, "ms"), (1.0, "s")),
    "force": ((1e-3, "mN"), (1.0, "N")),
    "angle": ((math.pi / 180.0, "deg"),),
    "ratio": ((1.0, ""),),
}


def format_quantity(value: float, dimension: str, digits: int = 4) -> str:
    """Write an SI float in the unit that people use for it.

    Parameters
    ----------
    value : float
        In the SI unit of `dimension`.
    dimension : str
        One of `DIMENSIONS`.
    digits : int
        Significant digits.

    Returns
    -------
    str
        Number and unit.

    Examples
    --------
    >>> format_quantity(2.5e-05, "length")
    '25 um'
    >>> format_quantity(3.86e-6, "energy", 3)
    '3.86 uJ'
    """
    factor, symbol = _scale(abs(value), dimension)
    return f"{value / factor:.{digits}g} {symbol}".strip()


# endings of column names, the longest first, and the unit as people write it
_ENDINGS = {
    "n_per_mm": "N/mm",
    "n_per_m": "N/m",
    "kg_m3": "kg/m³",
    "n_mm": "N/mm",
    "n_m": "N/m",
    "mm_s": "mm/s",
    "m_s": "m/s",
    **{name: name for name in ("nm", "mm", "m", "ms", "s", "kg", "g", "h")},
    **{
        "um": "µm",
        "uj": "µJ",
        "uw": "µW",
        "us": "µs",
        "mn": "mN",
        "n": "N",
        "j": "J",
        "w": "W",
        "hz": "Hz",
        "khz": "kHz",
    },
    **{"deg": "°", "rad": "rad", "pct": "%", "c": "°C", "pa": "Pa", "db": "dB"},
}


def column_label(name: str) -> str:
    """Say a column's name as people do, its unit at the end.

    Examples
    --------
    >>> column_label("vibration_energy_95_low_uj"), column_label("ln_peak_force"), column_label("status")
    ('vibration energy 95 low, µJ', 'ln peak force', 'status')
    """
    for ending, unit in _ENDINGS.items():
        if name.endswith(f"_{ending}"):
            return f"{name.removesuffix(f'_{ending}').replace('_', ' ')}, {unit}"
    return name.replace("_", " ")


def figure(value: float, digits: int = 3) -> str:
    """Write a number as people read it: significant digits, no exponent between a thousandth and a million.

    Examples
    --------
    >>> figure(29612.3), figure(0.00012345), figure(-0.0), figure(1234567.0), figure(1.5e-9), figure(float("nan"))
    ('29600', '0.000123', '0', '1.23e6', '1.5e-9', '-')
    """
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    text = f"{value:.{digits}g}"
    number = float(text)
    if number == 0.0:
        return "0"
    if 1e-4 <= abs(number) < 1e6:
        places = max(digits - 1 - math.floor(math.log10(abs(number))), 0)
        text = f"{number:.{places}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, _, power = f"{number:.{digits - 1}e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}e{int(power)}"


def column_of_figures(values: Sequence[object]) -> list[str]:
    """Write the cells of a column, its fractions to three digits; text and whole numbers stay as they are."""
    texts = ["-" if value is None else str(value) for value in values]
    try:
        numbers = [math.nan if text in ("", "-") else float(text) for text in texts]
    except ValueError:
        return texts
    if all(number.is_integer() or math.isnan(number) for number in numbers):
        return [
            text.removesuffix(".0") if number == number else "-" for text, number in zip(texts, numbers, strict=True)
        ]
    return [figure(number) for number in numbers]


_SIGNS = {"um": "µm", "uJ": "µJ", "uW": "µW", "us": "µs", "uN": "µN", "deg": "°"}
_WRITTEN = re.compile(r"(?:(?<=\d)( ?)|^(?=\w+$))(um|uJ|uW|us|uN|deg)\b")  # after a number, or alone


def readable(text: object) -> str:
    """Write the units in a text as people do.

    Examples
    --------
    >>> readable("25 um ±1 um at 6 deg"), readable("E_v 3.86 uJ"), readable("um")
    ('25 µm ±1 µm at 6°', 'E_v 3.86 µJ', 'µm')
    """
    return _WRITTEN.sub(lambda found: ("" if found[2] == "deg" else found[1] or "") + _SIGNS[found[2]], str(text))


def format_span(low: float, high: float, dimension: str) -> str:
    """Write a range in one unit, or a single figure where its ends read alike.

    Examples
    --------
    >>> format_span(0.23, 1.853, "force"), format_span(1.241e-6, 1.239e-6, "energy")
    ('0.23 to 1.85 N', '1.24 µJ')
    >>> format_span(18.5e-6, 2.08e-3, "energy")
    '18.5 µJ to 2.08 mJ'
    """
    factor, symbol = _scale(max(abs(low), abs(high)), dimension)
    if 0.0 < low < 0.1 * factor:
        return f"{format_span(low, low, dimension)} to {format_span(high, high, dimension)}"
    ends = dict.fromkeys((figure(low / factor), figure(high / factor)))
    return f"{' to '.join(ends)} {_SIGNS.get(symbol, symbol)}".strip()


def _scale(value: float, dimension: str) -> tuple[float, str]:
    """Find the unit in which people write a value, and its size in SI."""
    scales = _SCALES.get(dimension, ((1.0, DIMENSIONS[dimension]),))
    fitting = [scale for scale in scales if value >= scale[0] * 0.9999995]
    return fitting[-1] if fitting else scales[min(1, len(scales) - 1) if value == 0.0 else 0]
