"""Series: one stanza that stands for many, with values from, to and by step, or listed."""

import copy
import itertools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard

from stepblocks.errors import QuantityError
from stepblocks.quantities import parse_quantity

_BESIDE_NOMINAL = ("tolerance", "source")  # what a dimension has besides its nominal
_NAMES_OF_SERIES = {"from", "to", "step", "values", *_BESIDE_NOMINAL}
_NAMES_OF_DIMENSION = {"nominal", "from", "values"}  # one of which every dimension has
MAX_SERIES = 20_000  # most stimuli that one stanza may stand for
_WHOLE_STEP = 1e-6  # of a step, by which the last value may miss a whole number of them

_PLACEHOLDER = re.compile(
    r"\{(?P<field>[a-z_]+?)(?:_(?P<unit>um|nm|mm|deg))?(?::0(?P<digits>[1-9]))?\}"
)
_UNITS = {"um": 1e6, "nm": 1e9, "mm": 1e3, "deg": 57.29577951308232}

Keys = tuple[str, ...]  # keys of the tables down to a dimension


def merge_tables(defaults: Mapping[str, object], stanza: Mapping[str, object]) -> dict[str, object]:
    """Lay a stanza over the defaults of its kind, table by table."""
    merged: dict[str, object] = copy.deepcopy(dict(defaults))
    for key, value in stanza.items():
        default = merged.get(key)
        if _is_table_of_fields(default) and _is_table_of_fields(value):
            merged[key] = merge_tables(default, value)
        else:
            merged[key] = copy.deepcopy(value)
    return merged


def _is_table_of_fields(value: object) -> TypeGuard[dict[str, object]]:
    """Tell whether a value is a table of fields, and no dimension."""
    return isinstance(value, dict) and not _NAMES_OF_DIMENSION & set(value)


def expand_series(stanza: Mapping[str, object]) -> Iterator[dict[str, object]]:
    """Expand the series in a stanza, every combination of them.

    Parameters
    ----------
    stanza : mapping
        A stanza as a file holds it.

    Yields
    ------
    dict
        A stanza without series, with its identity filled in.

    Raises
    ------
    QuantityError
        If a series is malformed or too long.
    """
    values_by_path: dict[Keys, list[str]] = {}
    for path, table in _yield_series(stanza, ()):
        values_by_path[path] = _list_series_values(path, table)
    count = math.prod(map(len, values_by_path.values()))
    if count > MAX_SERIES:
        raise QuantityError(f"a series must have at most {MAX_SERIES} members, got {count}")
    for combination in itertools.product(*values_by_path.values()):
        member = copy.deepcopy(dict(stanza))
        for path, nominal in zip(values_by_path, combination, strict=True):
            _set_nominal(member, path, nominal)
        if "id" in member:
            member["id"] = _fill_identity_placeholders(member)
        yield member


def _set_nominal(stanza: dict[str, Any], path: Keys, nominal: str) -> None:
    """Put one value of a series in its place, with the tolerance and source of the series."""
    *outer_keys, key = path
    table = stanza
    for outer_key in outer_keys:
        table = table[outer_key]
    series = table[key]
    table[key] = {"nominal": nominal}
    for name, value in series.items():
        if name in _BESIDE_NOMINAL:
            table[key][name] = value


def _yield_series(
    table: Mapping[str, object], path: Keys
) -> Iterator[tuple[Keys, dict[str, object]]]:
    """Yield the series in a table and the tables in it, each with its path."""
    for key, value in table.items():
        if not isinstance(value, dict):
            continue
        if "from" in value or "values" in value:
            yield (*path, key), value
        else:
            yield from _yield_series(value, (*path, key))


def _list_series_values(path: Keys, table: Mapping[str, object]) -> list[str]:
    """Read the values of a series: those listed, or from one to another by steps."""
    name = ".".join(path)
    unknown = set(table) - _NAMES_OF_SERIES
    if unknown:
        raise QuantityError(
            f"{name}: a series has from, to and step, or values; got also "
            f"{', '.join(sorted(unknown))}"
        )
    if "values" in table:
        return _read_listed_values(name, table)
    missing = {"to", "step"} - set(table)
    if missing:
        absent = " and no ".join(sorted(missing))
        raise QuantityError(f"{name}: a series needs from, to and step, got no {absent}")
    return _list_stepped_values(name, table)


def _read_listed_values(name: str, table: Mapping[str, object]) -> list[str]:
    """Read the values that a series lists."""
    values = table["values"]
    if "from" in table or not _is_list_of_texts(values):
        raise ValueError(
            f"{name}: values must be a list of quantities such as ['25 um', '50 um'], got "
            f"{values!r:.60}"
        )
    return list(values)


def _is_list_of_texts(value: object) -> TypeGuard[list[str]]:
    """Tell whether a value is a list of texts, and not empty."""
    if not isinstance(value, list) or not value:
        return False
    return all(isinstance(text, str) for text in value)


def _list_stepped_values(name: str, table: Mapping[str, object]) -> list[str]:
    """Read the values from one to another by steps, in the unit of the first."""
    first = table["from"]
    last = table["to"]
    step = table["step"]
    quantity = _guess_length_or_angle(first)
    try:
        start = parse_quantity(first, quantity)
        stop = parse_quantity(last, quantity)
        stride = parse_quantity(step, quantity)
    except QuantityError as error:
        raise ValueError(f"{name}: {error}") from error
    series = f"got from {first} to {last} step {step}"
    if not (stride > 0.0 and stop >= start):
        raise QuantityError(f"{name}: a series must ascend with a positive step, {series}")
    steps = (stop - start) / stride
    if steps > MAX_SERIES:
        raise QuantityError(
            f"{name}: a series must have at most {MAX_SERIES} members, got {steps:.0f}"
        )
    count = round(steps)
    if abs(steps - count) > _WHOLE_STEP:
        raise QuantityError(f"{name}: to must be a whole number of steps from from, {series}")
    unit = str(first).lstrip("+-.0123456789eE ").strip()
    scale = parse_quantity(f"1 {unit}", quantity)
    values = []
    for index in range(count + 1):
        values.append(f"{(start + index * stride) / scale:.12g} {unit}")
    return values


def _guess_length_or_angle(text: object) -> str:
    """Return ``"angle"`` for a quantity with a unit of angle, else ``"length"``."""
    if not _has_dimension(text, "length") and _has_dimension(text, "angle"):
        return "angle"
    return "length"


def _has_dimension(text: object, dimension: str) -> bool:
    """Tell whether a text is a quantity of a dimension."""
    try:
        parse_quantity(text, dimension)
    except QuantityError:
        return False
    return True


def _fill_identity_placeholders(stanza: Mapping[str, object]) -> object:
    """Fill the placeholders of an identity, such as ``{height_um:03}``, from its stanza."""
    template = stanza.get("id")
    if not isinstance(template, str):
        return template

    def fill_placeholder(match: re.Match[str]) -> str:
        """Return the nominal value of the field that a placeholder names, in its unit."""
        dimension = stanza.get(match["field"])
        nominal = dimension.get("nominal") if isinstance(dimension, dict) else dimension
        if match["unit"] is None or nominal is None:
            raise ValueError(
                f"id: {match[0]} must name a dimension of the stanza with its unit, such as "
                "{height_um:03}"
            )
        value = parse_quantity(nominal, _guess_length_or_angle(nominal)) * _UNITS[match["unit"]]
        return _format_placeholder_value(value, int(match["digits"] or 1))

    return _PLACEHOLDER.sub(fill_placeholder, template)


def _format_placeholder_value(value: float, digits: int) -> str:
    """Write a number as an identity may hold it: ``m`` for minus, ``p`` for the decimal point."""
    text = f"{value:.9g}"
    sign = ""
    if text.startswith("-"):
        sign = "m"
        text = text[1:]
    return sign + text.zfill(digits).replace(".", "p")
