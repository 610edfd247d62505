"""Series: one stanza that stands for many, with values from, to and by step, or listed."""

import copy
import itertools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from stepblocks.errors import QuantityError
from stepblocks.quantities import parse_quantity

_BESIDE = ("tolerance", "source")  # what a dimension has besides its nominal
_OF_DIMENSION = {"nominal", "from", "values"}
MAX_SERIES = 20_000  # most stimuli that one stanza may stand for

_PLACEHOLDER = re.compile(
    r"\{(?P<field>[a-z_]+?)(?:_(?P<unit>um|nm|mm|deg))?(?::0(?P<digits>[1-9]))?\}"
)
_UNITS = {"um": 1e6, "nm": 1e9, "mm": 1e3, "deg": 57.29577951308232}


def merge_tables(defaults: Mapping[str, object], stanza: Mapping[str, object]) -> dict[str, object]:
    """Lay a stanza over the defaults of its kind, table by table."""
    result: dict[str, object] = copy.deepcopy(dict(defaults))
    for key, value in stanza.items():
        # both must be tables, and neither of them a dimension
        tables = [
            one
            for one in (result.get(key), value)
            if isinstance(one, dict) and not _OF_DIMENSION & set(one)
        ]
        result[key] = merge_tables(*tables) if len(tables) == 2 else copy.deepcopy(value)
    return result


def expand_series(stanza: Mapping[str, object]) -> Iterator[dict[str, object]]:
    """Expand the series in a stanza, every combination of them."""
    series = {path: _read_values(path, table) for path, table in _find_series(stanza, ())}
    count = math.prod(map(len, series.values()))
    QuantityError.require(
        count <= MAX_SERIES, f"a series must have at most {MAX_SERIES} members, got {count}"
    )
    for combination in itertools.product(*series.values()):
        one = copy.deepcopy(dict(stanza))
        for path, nominal in zip(series, combination, strict=True):
            table: dict[str, Any] = one
            for key in path[:-1]:
                table = table[key]
            table[path[-1]] = {"nominal": nominal} | {
                key: value for key, value in table[path[-1]].items() if key in _BESIDE
            }
        one["id"] = _fill_identity(one)
        yield one


def _find_series(
    table: Mapping[str, object], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], dict[str, object]]]:
    for key, value in table.items():
        if isinstance(value, dict):
            if "from" in value or "values" in value:
                yield (*path, key), value
            else:
                yield from _find_series(value, (*path, key))


def _read_values(path: tuple[str, ...], table: Mapping[str, object]) -> list[str]:
    name = ".".join(path)
    unknown = set(table) - {"from", "to", "step", "values", *_BESIDE}
    QuantityError.require(
        not unknown,
        f"{name}: a series has from, to and step, or values; got also {', '.join(sorted(unknown))}",
    )
    if "values" in table:
        values = table["values"]
        if (
            not isinstance(values, list)
            or not values
            or "from" in table
            or not all(isinstance(v, str) for v in values)
        ):
            raise ValueError(
                f"{name}: values must be a list of quantities such as ['25 um', '50 um'], got "
                f"{values!r:.60}"
            )
        return list(values)
    missing = {"to", "step"} - set(table)
    QuantityError.require(
        not missing,
        f"{name}: a series needs from, to and step, got no {' and no '.join(sorted(missing))}",
    )
    first, last, step = (table[key] for key in ("from", "to", "step"))
    dimension = _find_quantity(first)
    try:
        start, stop, stride = (parse_quantity(value, dimension) for value in (first, last, step))
    except QuantityError as error:
        raise ValueError(f"{name}: {error}") from error
    got = f"got from {first} to {last} step {step}"
    QuantityError.require(
        stride > 0.0 and stop >= start,
        f"{name}: a series must ascend with a positive step, {got}",
    )
    steps = (stop - start) / stride
    count = round(steps)
    QuantityError.require(
        steps <= MAX_SERIES,
        f"{name}: a series must have at most {MAX_SERIES} members, got {steps:.0f}",
    )
    QuantityError.require(
        abs(steps - count) <= 1e-6,
        f"{name}: to must be a whole number of steps from from, {got}",
    )
    unit = str(first).lstrip("+-.0123456789eE ").strip()
    scale = parse_quantity(f"1 {unit}", dimension)
    return [f"{(start + index * stride) / scale:.12g} {unit}" for index in range(count + 1)]


def _find_quantity(text: object) -> str:
    try:
        parse_quantity(text, "angle")
    except QuantityError:
        return "length"
    return "angle"


def _fill_identity(stanza: Mapping[str, object]) -> object:
    template = stanza.get("id")
    if not isinstance(template, str):
        return template

    def fill(match: re.Match[str]) -> str:
        found = stanza.get(match["field"])
        nominal = found.get("nominal") if isinstance(found, dict) else found
        if match["unit"] is None or nominal is None:
            raise ValueError(
                f"id: {match[0]} must name a dimension of the stanza with its unit, such as "
                "{height_um:03}"
            )
        text = f"{parse_quantity(nominal, _find_quantity(nominal)) * _UNITS[match['unit']]:.9g}"
        sign, digits = ("m", text[1:]) if text.startswith("-") else ("", text)
        return sign + digits.zfill(int(match["digits"] or 1)).replace(".", "p")

    return _PLACEHOLDER.sub(fill, template)
