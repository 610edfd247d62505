"""One stanza that stands for many: values from, to and by step, or listed, in any of its dimensions."""

from __future__ import annotations

import copy
import itertools
import re
from collections.abc import Iterator, Mapping
from typing import Any

from stepblocks.errors import QuantityError
from stepblocks.quantities import parse_quantity

MAX_SERIES = 20_000  # most stimuli that one stanza may stand for

_PLACEHOLDER = re.compile(r"\{(?P<field>[a-z_]+?)(?:_(?P<unit>um|nm|mm|deg))?(?::0(?P<digits>[1-9]))?\}")
_UNITS = {"um": 1e6, "nm": 1e9, "mm": 1e3, "deg": 57.29577951308232}


def merged(defaults: Mapping[str, Any], stanza: Mapping[str, Any]) -> dict[str, Any]:
    """Lay a stanza over the defaults of its kind, table by table.

    Examples
    --------
    >>> merged({"body": {"length": "20 mm"}}, {"id": "a", "body": {"width": "5 mm"}})
    {'body': {'length': '20 mm', 'width': '5 mm'}, 'id': 'a'}
    """
    result: dict[str, Any] = copy.deepcopy(dict(defaults))
    for key, value in stanza.items():
        below = result.get(key)
        both = (
            isinstance(below, dict)
            and isinstance(value, dict)
            and not _is_dimension(below)
            and not _is_dimension(value)
        )
        result[key] = merged(below, value) if both and isinstance(below, dict) else copy.deepcopy(value)
    return result


def _is_dimension(table: Mapping[str, Any]) -> bool:
    return bool({"nominal", "from", "values"} & set(table))


def expand(stanza: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Expand the series in a stanza, every combination of them.

    Examples
    --------
    >>> stanza = {"id": "s-{height_um:03}", "height": {"from": "10 um", "to": "30 um", "step": "10 um", "tolerance": "1 um"}}
    >>> [(one["id"], one["height"]["nominal"]) for one in expand(stanza)]
    [('s-010', '10 um'), ('s-020', '20 um'), ('s-030', '30 um')]
    """
    series = {path: _values(path, table) for path, table in _series_tables(stanza, ())}
    count = 1
    for values in series.values():
        count *= len(values)
    if count > MAX_SERIES:
        raise ValueError(f"a series must have at most {MAX_SERIES} members, got {count}")
    for combination in itertools.product(*series.values()):
        one: dict[str, Any] = copy.deepcopy(dict(stanza))
        for path, nominal in zip(series, combination, strict=True):
            table = one
            for key in path[:-1]:
                table = table[key]
            kept = {key: value for key, value in table[path[-1]].items() if key in ("tolerance", "source")}
            table[path[-1]] = {"nominal": nominal, **kept}
        one["id"] = _named(one)
        yield one


def _series_tables(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    for key, value in table.items():
        if isinstance(value, dict):
            if "from" in value or "values" in value:
                yield (*path, key), value
            else:
                yield from _series_tables(value, (*path, key))


def _values(path: tuple[str, ...], table: Mapping[str, Any]) -> list[str]:
    name = ".".join(path)
    unknown = set(table) - {"from", "to", "step", "values", "tolerance", "source"}
    if unknown:
        raise ValueError(f"{name}: a series has from, to and step, or values; got also {', '.join(sorted(unknown))}")
    if "values" in table:
        values = table["values"]
        if not isinstance(values, list) or not values or "from" in table or not all(isinstance(v, str) for v in values):
            raise ValueError(
                f"{name}: values must be a list of quantities such as ['25 um', '50 um'], got {values!r:.60}"
            )
        return list(values)
    missing = {"to", "step"} - set(table)
    if missing:
        raise ValueError(f"{name}: a series needs from, to and step, got no {' and no '.join(sorted(missing))}")
    return _range(name, table["from"], table["to"], table["step"])


def _range(name: str, first: object, last: object, step: object) -> list[str]:
    dimension = _dimension_of(first)
    try:
        start, stop, stride = (parse_quantity(value, dimension) for value in (first, last, step))
    except QuantityError as error:
        raise ValueError(f"{name}: {error}") from error
    if stride <= 0.0 or stop < start:
        raise ValueError(f"{name}: a series must ascend with a positive step, got from {first} to {last} step {step}")
    steps = (stop - start) / stride
    count = round(steps)
    if steps > MAX_SERIES:
        raise ValueError(f"{name}: a series must have at most {MAX_SERIES} members, got {steps:.0f}")
    if abs(steps - count) > 1e-6:
        raise ValueError(
            f"{name}: to must be a whole number of steps from from, got from {first} to {last} step {step}"
        )
    unit = str(first).lstrip("+-.0123456789eE ").strip()
    scale = parse_quantity(f"1 {unit}", dimension)
    return [f"{(start + index * stride) / scale:.12g} {unit}" for index in range(count + 1)]


def _dimension_of(text: object) -> str:
    try:
        parse_quantity(text, "angle")
    except QuantityError:
        return "length"
    return "angle"


def _named(stanza: Mapping[str, Any]) -> object:
    template = stanza.get("id")
    if not isinstance(template, str):
        return template

    def fill(match: re.Match[str]) -> str:
        table = stanza.get(match["field"])
        if match["unit"] is None or not isinstance(table, dict) or "nominal" not in table:
            raise ValueError(
                f"id: {match[0]} must name a dimension of the stanza with its unit, such as {{height_um:03}}"
            )
        value = parse_quantity(table["nominal"], _dimension_of(table["nominal"])) * _UNITS[match["unit"]]
        text = f"{value:.9g}"
        sign, digits = ("m", text[1:]) if text.startswith("-") else ("", text)
        return sign + digits.zfill(int(match["digits"] or 1)).replace(".", "p")

    return _PLACEHOLDER.sub(fill, template)
