"""Units at the border; inside, values are floats in SI.

A stimulus file says ``"25 um"``; everything behind this module holds ``2.5e-05``. Pint knows the
units; this module knows the dimension of each field and says where a value does not fit it.
"""

import math
import numbers
import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from functools import cache, lru_cache, partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar

from stepblocks.errors import QuantityError

if TYPE_CHECKING:
    import numpy as np
    import pint
    from numpy.typing import NDArray

Number = TypeVar("Number", float, "NDArray[np.float64]")  # one number or an array of them

Magnitude = TypeVar("Magnitude", covariant=True)


class PintQuantity(Protocol[Magnitude]):
    """A number or an array with its unit: a Pint quantity of any registry."""

    @property
    def magnitude(self) -> Magnitude:
        """The number or the array without its unit."""

    @property
    def units(self) -> Any:
        """The unit."""

    def to(self, other: Any = ..., /) -> Any:
        """Return it in another unit."""


# What any public function takes for one quantity: a number in SI, a text such as "25 um", or a
# quantity of Pint
Measure: TypeAlias = "float | np.integer[Any] | np.floating[Any] | str | PintQuantity[float]"

# Name of each dimension a field can have, the SI unit that its floats are in, and an example
_KNOWN = {
    "length": ("m", "25 um"),
    "force": ("N", "0.5 N"),
    "angle": ("rad", "6 deg"),
    "stiffness": ("N/m", "9.81 N/mm"),
    "energy": ("J", "10 uJ"),
    "power": ("W", "0.08 uW"),
    "time": ("s", "16 ms"),
    "frequency": ("Hz", "300 Hz"),
    "speed": ("m/s", "5 mm/s"),
    "acceleration": ("m/s**2", "9.81 m/s^2"),
    "mass": ("kg", "3 g"),
    "density": ("kg/m**3", "7850 kg/m^3"),
    "pressure": ("Pa", "210 GPa"),
    "temperature": ("K", "293 K"),
    "ratio": ("", "0.15"),
}
DIMENSIONS = {dimension: unit for dimension, (unit, _) in _KNOWN.items()}

# Sizes of the units that most files use, by the SI unit; Pint, which knows all others, takes a
# second to start
COMMON_SIZES: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9},
    "N": {"N": 1.0, "mN": 1e-3},
    "rad": {"rad": 1.0, "deg": math.pi / 180.0},
    "N/m": {"N/m": 1.0, "N/mm": 1e3},
    "J": {"J": 1.0, "mJ": 1e-3, "uJ": 1e-6},
    "W": {"W": 1.0, "mW": 1e-3, "uW": 1e-6},
    "s": {"s": 1.0, "ms": 1e-3},
    "Hz": {"Hz": 1.0, "kHz": 1e3},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3},
    "m/s**2": {"m/s^2": 1.0},
    "kg": {"kg": 1.0, "g": 1e-3},
    "kg/m**3": {"kg/m^3": 1.0},
    "Pa": {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9},
    "": {"": 1.0, "%": 1e-2},
}

_SMALLEST_INVERTED = 1e-300  # below it the inverse of a factor is near the largest double
_ROUNDING = 1e-12  # by which the inverse of a unit's size may miss a whole number
_MAX_TEXT = 64  # longer text is no quantity and must not reach the library
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
# a unit with a small power: no expression is ever evaluated
_ATOM = r"[A-Za-zµμΩ°%]+(?:\s*(?:\^|\*\*)\s*-?[1-4]|[23])?"
_QUANTITY = re.compile(
    rf"\s*({_NUMBER})\s*((?:(?:1\s*/\s*)?{_ATOM}(?:\s*[*/ ]\s*{_ATOM}){{0,3}})?)\s*"
)


@cache
def _build_registry() -> "pint.UnitRegistry[float]":
    """Build the registry of units, once for each process."""
    import pint

    return pint.UnitRegistry(
        autoconvert_offset_to_baseunit=True,
        cache_folder=None,
        # "kg/m3" for "kg/m^3", as sheets and standards print it
        preprocessors=[partial(re.sub, r"([a-z])([23])\b", r"\1^\2")],
    )


def parse_quantity(text: object, dimension: str) -> float:
    """Read a quantity with its unit and return it in SI.

    Parameters
    ----------
    text : str or pint.Quantity
        A number and a unit, such as ``"25 um"`` or ``"0.5 N"``. A ratio may be a bare number or a
        percentage.
    dimension : str
        One of `DIMENSIONS`.

    Returns
    -------
    float
        The value in the SI unit of `dimension`.

    Raises
    ------
    QuantityError
        If the text has no number or no unit, if the unit has another dimension, or if the value is
        not finite.

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
    _check_dimension(dimension)
    unit, example = _KNOWN[dimension]
    wanted = f"{_format_dimension_rule(dimension)} such as {example!r}"
    if is_quantity(text):
        value = _convert_pint_quantity(text, unit, wanted)
    elif isinstance(text, str):
        value = _parse_text_with_unit(text, unit, wanted)
    elif isinstance(text, int | float) and dimension == "ratio" and not isinstance(text, bool):
        value = _convert_ratio_to_float(text, wanted)
    else:
        hint = ""
        if isinstance(text, int | float):
            hint = " (a number needs its unit, in quotes)"
        raise QuantityError(f"{wanted}, got {' '.join(repr(text).split())}{hint}")
    if not math.isfinite(value):
        raise QuantityError(f"{wanted} and finite, got {text!r}")
    return value


def is_quantity(value: object) -> bool:
    """Tell whether a value is a quantity of Pint, of any registry: a number or an array."""
    return hasattr(value, "magnitude") and hasattr(value, "units") and hasattr(value, "to")


def unwrap_array_scalar(value: Any) -> Any:
    """Return the number of a zero-dimensional array; a text with unit where xarray states one.

    Anything else is returned as it is.
    """
    if isinstance(value, str | bytes):  # those of numpy have a shape, too
        return value
    if getattr(value, "shape", None) != () or not hasattr(value, "dtype") or is_quantity(value):
        return value
    if getattr(value, "mask", False):
        return value
    unit = getattr(value, "attrs", {}).get("units")
    if unit is not None:
        return f"{float(value)!r} {unit}"
    return getattr(value, "values", value)[()]


def read_array(values: object, dimension: str) -> "NDArray[np.float64]":
    """Read numbers that Python hands in as an array in SI.

    Parameters
    ----------
    values : array_like
        Numbers in SI; a masked array, or a nullable column of pandas; a quantity of Pint; an array
        of xarray whose attribute ``units`` says its unit; texts with units.
    dimension : str
        One of `DIMENSIONS`.

    Returns
    -------
    array of float64, of the shape of `values`
        NaN where a number is masked or missing.

    Raises
    ------
    QuantityError
        If a value is no number, or its unit has another dimension.

    Examples
    --------
    >>> import numpy as np
    >>> read_array(np.ma.masked_equal([25e-6, -1.0], -1.0), "length").tolist()
    [2.5e-05, nan]
    >>> read_array(["25 um", "0.1 mm"], "length").tolist()
    [2.5e-05, 0.0001]
    """
    import numpy as np

    _check_dimension(dimension)
    given: Any = values
    if is_quantity(given):
        plain = read_array(given.magnitude, "ratio")
        factor = _compute_unit_size(given.units, dimension)
        return np.asarray(multiply_by_unit(plain, factor))
    attributes = getattr(given, "attrs", None)
    if isinstance(attributes, dict) and isinstance(attributes.get("units"), str):
        factor = parse_quantity(f"1 {attributes['units']}", dimension)
        return np.asarray(
            multiply_by_unit(_convert_numbers_or_texts(given.values, dimension), factor)
        )
    return _convert_numbers_or_texts(given, dimension)


def _format_dimension_rule(dimension: str) -> str:
    """Format the rule that a value must have a dimension, as in ``must be a length``."""
    article = "a"
    if dimension[0] in "ae":
        article = "an"
    return f"must be {article} {dimension}"


def _compute_unit_size(unit: Any, dimension: str) -> float:
    """Return how many SI units a unit of Pint has; refuse one of another dimension."""
    wanted = _format_dimension_rule(dimension)
    try:
        return _convert_pint_quantity(1.0 * unit, DIMENSIONS[dimension], wanted)
    except QuantityError as error:
        raise QuantityError(f"{wanted}, got the unit {unit!s:.60}") from error


def _convert_numbers_or_texts(values: Any, dimension: str) -> "NDArray[np.float64]":
    """Return numbers, or texts with units, as an array in SI, NaN where one is missing."""
    import numpy as np

    if getattr(getattr(values, "dtype", None), "kind", "") == "b" or isinstance(values, bool):
        raise QuantityError(
            f"must be numbers [{DIMENSIONS[dimension] or '1'}], got truth values (bool)"
        )
    if isinstance(values, np.ma.MaskedArray):
        return np.ma.filled(values.astype(np.float64), np.nan)
    if hasattr(values, "to_numpy") and hasattr(values, "isna"):
        is_missing = np.asarray(values.isna())
        values = np.where(is_missing, math.nan, np.asarray(values.astype(object)))
    if isinstance(values, list | tuple) and any(map(is_quantity, values)):
        objects = np.empty(len(values), dtype=object)
        for place, value in enumerate(values):  # all at once, Pint would be asked for numbers
            objects[place] = value
        return _read_object_array(objects, dimension)
    array = np.asarray(values)
    if array.dtype.kind == "b" and array.size:
        return _convert_numbers_or_texts(array, dimension)
    if array.dtype.kind in "biuf":
        return np.asarray(array, dtype=np.float64)
    return _read_object_array(np.asarray(values, dtype=object), dimension)


def _read_object_array(array: "NDArray[np.object_]", dimension: str) -> "NDArray[np.float64]":
    """Read an array of texts, quantities or numbers one by one."""
    import numpy as np

    read = np.empty(array.shape)
    for place, value in np.ndenumerate(array):
        if isinstance(value, str) or is_quantity(value):
            read[place] = parse_quantity(value, dimension)
            continue
        if type(value).__name__ in ("NAType", "NoneType", "MaskedConstant"):
            read[place] = math.nan
            continue
        try:
            read[place] = float(value)
        except (TypeError, ValueError, OverflowError) as error:
            shown = " ".join(repr(value).split())
            raise QuantityError(
                f"must be numbers [{DIMENSIONS[dimension] or '1'}], got {shown:.60}"
            ) from error
    return read


def _convert_pint_quantity(quantity: Any, unit: str, message_start: str) -> float:
    """Return a quantity of Pint in a unit; `message_start` begins the message of a refusal."""
    try:
        magnitude = float(quantity.magnitude)
        if unit == "K":  # a scale of temperature has an offset beside the size of its degree
            return float(quantity.to("kelvin").magnitude)
        factor = float((1.0 * quantity.units).to(unit or "dimensionless").magnitude)
    except _list_unit_errors() as error:
        shown = " ".join(str(quantity).split())
        raise QuantityError(f"{message_start}, got {shown:.60}") from error
    return multiply_by_unit(magnitude, factor)


def _check_dimension(dimension: object) -> None:
    """Refuse a dimension that has no unit here."""
    if not isinstance(dimension, str) or dimension not in _KNOWN:
        known = ", ".join(_KNOWN)
        shown = " ".join(repr(dimension).split())
        raise QuantityError(f"dimension must be one of {known}, got {shown:.60}")


def _convert_ratio_to_float(number: float, message_start: str) -> float:
    """Return a ratio that was given as a number; a whole one may be beyond the largest double."""
    try:
        return float(number)
    except OverflowError as error:
        raise QuantityError(
            f"{message_start} and finite, got a whole number of many digits"
        ) from error


@lru_cache(maxsize=4096)  # the stanzas of a series share all but a few of their texts
def _parse_text_with_unit(text: str, unit: str, message_start: str) -> float:
    """Parse a text with a unit, and return its number in `unit`.

    `message_start` begins the message of a refusal.
    """
    if len(text) > _MAX_TEXT:
        raise QuantityError(f"{message_start}, got {text[: _MAX_TEXT - 3] + '...'!r}")
    parsed = _QUANTITY.fullmatch(text)
    if parsed is None or (unit and not parsed[2]):
        hint = ""
        if "," in text and _QUANTITY.fullmatch(text.replace(",", ".", 1)):
            hint = " (the decimal sign is a point)"
        raise QuantityError(f"{message_start}, got {text!r}{hint}")
    number = float(parsed[1])
    size = COMMON_SIZES.get(unit, {}).get(parsed[2])
    if size is not None:
        return float(multiply_by_unit(number, size))
    try:
        return _convert_number_between_units(
            number, parsed[2] or "dimensionless", unit or "dimensionless"
        )
    except _list_unit_errors() as error:
        raise QuantityError(f"{message_start}, got {text!r}") from error


def _convert_number_between_units(number: float, written: str, unit: str) -> float:
    """Return a number, written with a unit, in another unit of the same dimension."""
    registry = _build_registry()
    units = registry.Quantity(1.0, written).units
    factor = float(registry.Quantity(1.0, units).to(unit).magnitude)
    if not units.is_compatible_with(unit):
        raise ValueError(f"{written} is no {unit}")
    if unit == "K":  # a scale of temperature has an offset beside the size of its degree
        return float(registry.Quantity(number, units).to(unit).magnitude)
    return float(multiply_by_unit(number, factor))


@cache
def _list_unit_errors() -> tuple[type[Exception], ...]:
    """List the errors that Pint raises for a text that is not a unit."""
    import pint

    return (
        pint.PintError,
        ValueError,
        AttributeError,
        TypeError,
        KeyError,
        SyntaxError,
        OverflowError,
    )


def multiply_by_unit(number: Number, factor: float) -> Number:
    """Multiply by the size of a unit: 25 / 1e6 is the double nearest to 25e-6, 25 * 1e-6 not."""
    # a foreign file may state a factor of any size
    if _SMALLEST_INVERTED < factor < 1.0:
        inverse = round(1.0 / factor)
        if abs(factor * inverse - 1.0) < _ROUNDING:
            return number / inverse
    return number * factor


def make_quantity_parser(dimension: str) -> Callable[[object], float]:
    """Return a function that reads quantities of one dimension, for use as a validator."""
    return partial(parse_quantity, dimension=dimension)


def _check_digits(digits: object) -> None:
    """Refuse a number of digits that is not a whole number within limits."""
    if not isinstance(digits, numbers.Integral) or not 1 <= int(digits) <= _MOST_DIGITS:
        raise QuantityError(
            f"digits must be a whole number from 1 to {_MOST_DIGITS}, got {digits!r:.60}"
        )


def check_seed(seed: object) -> None:
    """Raise a `QuantityError` unless a seed is a whole number from 0 on.

    NumPy ends the interpreter over a matrix as seed.
    """
    if not isinstance(seed, numbers.Integral):
        raise QuantityError(f"seed must be a whole number, got {type(seed).__name__}")
    if int(seed) < 0:
        raise QuantityError(f"seed must not be negative, got {seed}")


_MOST_DIGITS = 50  # any double is written exactly enough with 17
_ALMOST_ONE = 0.9999995  # of a unit: what rounds to one of it is written in it
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

    Raises
    ------
    QuantityError
        If the dimension is unknown, or the number of digits out of range.

    Examples
    --------
    >>> format_quantity(2.5e-05, "length")
    '25 um'
    >>> format_quantity(3.86e-6, "energy", 3)
    '3.86 uJ'
    """
    _check_dimension(dimension)
    _check_digits(digits)
    factor, symbol = _choose_display_unit_size_and_symbol(abs(value), dimension)
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
    **{name: name for name in ("nm", "mm", "m", "ms", "s", "kg", "g", "h", "rad")},
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
    "deg": "°",
    "pct": "%",
    "c": "°C",
    "pa": "Pa",
    "db": "dB",
}


def format_column_label(name: str) -> str:
    """Say a column's name as people do, its unit at the end.

    >>> [format_column_label(name) for name in ("energy_95_low_uj", "ln_peak_force", "status")]
    ['energy 95 low, µJ', 'ln peak force', 'status']
    """
    for ending, unit in _ENDINGS.items():
        if name.endswith(f"_{ending}"):
            return f"{name.removesuffix(f'_{ending}').replace('_', ' ')}, {unit}"
    return name.replace("_", " ")


def format_number(value: float) -> str:
    """Write a number as people read it: three digits, an exponent only below 1e-4 or from 1e6.

    >>> [format_number(number) for number in (29612.3, 0.00012345, -0.0, 1234567.0, 1.5e-9)]
    ['29600', '0.000123', '0', '1.23e6', '1.5e-9']
    >>> format_number(float("nan"))
    '-'
    """
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    text = f"{value:.3g}"
    if 1e-4 <= abs(float(text)) < 1e6:
        return f"{Decimal(text):f}"
    mantissa, _, power = text.partition("e")
    if not power:
        return "0"
    return f"{mantissa}e{int(power)}"


def format_column(values: Sequence[object], *, exact: bool = False) -> list[str]:
    """Write the cells of a column: fractions to three digits, all if `exact`, text with units."""
    texts = ["-" if value is None else str(value) for value in values]
    try:
        numbers = [_parse_cell_number(text) for text in texts]
    except ValueError:
        return [format_units(text) for text in texts]
    is_whole = all(number.is_integer() or math.isnan(number) for number in numbers)
    cells = []
    for text, number in zip(texts, numbers, strict=True):
        if math.isnan(number):
            cells.append("-")
        elif is_whole:
            cells.append(text.removesuffix(".0"))
        elif exact:
            cells.append(text)
        else:
            cells.append(format_number(number))
    return cells


def _parse_cell_number(text: str) -> float:
    """Return the number in a cell, NaN in an empty one; a text is a ValueError."""
    if text in ("", "-"):
        return math.nan
    return float(text)


_SIGNS = {"um": "µm", "uJ": "µJ", "uW": "µW", "us": "µs", "uN": "µN", "deg": "°"}
# what a user typed stands in quotes and stays, and so do names and paths; else a unit behind its
# number, or by itself
_WRITTEN = re.compile(
    r"(?<!\w)'[^']*'"
    r"|(?<![\w-])(?P<number>[-+±]?\d[\d.]*(?:e[-+]?\d+)?)(?P<space> "
    r"?)(?P<behind>um|uJ|uW|us|uN|deg)\b(?!\.\w|[/-][A-Za-z_]|=)"
    r"|(?<![\w=./-])(?P<alone>um|uJ|uW|uN)\b(?!\.\w|[/=-])"
)


def format_units(text: object) -> str:
    """Write the units in a text as people do, on pages, in pictures and in a terminal.

    Files for machines keep theirs.

    >>> [format_units(text) for text in ("25 um ±1 um at 6 deg", "+2 um/0 um", "height [um]")]
    ['25 µm ±1 µm at 6°', '+2 µm/0 µm', 'height [µm]']
    >>> format_units("such as '25 um', got '25um' [um/step-25um.toml, block step-25um]")
    "such as '25 um', got '25um' [um/step-25um.toml, block step-25um]"
    """
    return _WRITTEN.sub(_replace_unit, str(text))


def _replace_unit(written: re.Match[str]) -> str:
    """Return a match of `_WRITTEN` with its unit as people write it; quoted text stays."""
    if written["alone"]:
        return _SIGNS[written["alone"]]
    unit = written["behind"]
    if not unit:
        return written[0]
    space = "" if unit == "deg" else written["space"]
    return written["number"] + space + _SIGNS[unit]


def format_span(low: float, high: float, dimension: str) -> str:
    """Write a range in one unit, or a single figure where its ends read alike.

    >>> format_span(0.23, 1.853, "force"), format_span(1.241e-6, 1.239e-6, "energy")
    ('0.23 to 1.85 N', '1.24 µJ')
    >>> format_span(18.5e-6, 2.08e-3, "energy")
    '18.5 µJ to 2.08 mJ'
    """
    factor, symbol = _choose_display_unit_size_and_symbol(max(abs(low), abs(high)), dimension)
    if 0.0 < low < 0.1 * factor:
        return f"{format_span(low, low, dimension)} to {format_span(high, high, dimension)}"
    ends = dict.fromkeys((format_number(low / factor), format_number(high / factor)))
    return f"{' to '.join(ends)} {_SIGNS.get(symbol, symbol)}".strip()


def _choose_display_unit_size_and_symbol(value: float, dimension: str) -> tuple[float, str]:
    """Return the size in SI and the symbol of the unit in which people write a value."""
    if dimension not in _SCALES:
        return 1.0, DIMENSIONS[dimension]
    scales = _SCALES[dimension]
    if value == 0.0:
        return scales[min(1, len(scales) - 1)]
    chosen = scales[0]
    for scale in scales:
        size, _ = scale
        if value >= size * _ALMOST_ONE:
            chosen = scale
    return chosen


def format_exactly(value: float, quantity: str) -> str:
    """Write a quantity so that it reads back as the same float, in a unit that people use."""
    text = format_quantity(value, quantity, 12)
    if parse_quantity(text, quantity) == value:
        return text
    return f"{value!r} {DIMENSIONS[quantity]}".strip()
