"""A stimulus set as the text of a stimulus file, which reads back as the same set."""

from collections.abc import Iterable
from typing import get_args

import tomli_w

from stepblocks.errors import StimulusError
from stepblocks.parts.declared import MATERIALS, QuantityValidator, Sourced, Table, WorkingFaces
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension
from stepblocks.quantities import format_exactly


def format_set(stimuli: Table, name: str, parts: Iterable[Part]) -> str:
    """Write a set as TOML, every value in full."""
    stanzas: dict[str, list[dict[str, object]]] = {}
    for part in parts:
        stanzas.setdefault(part.stanza, []).append(_list_fields(part))
    return tomli_w.dumps(
        {
            "schema": 1,
            "set": name,
            **_list_fields(stimuli, leave_out={"name", "stimuli"}),
            **stanzas,
        }
    )


def _list_fields(table: Table, leave_out: Iterable[str] = ()) -> dict[str, object]:
    written: dict[str, object] = {}
    for name, field in type(table).model_fields.items():
        value = getattr(table, name)
        if name in leave_out or (value is None and field.default is None):
            continue
        quantity = next(
            (
                one.dimension
                for one in _find_quantity_validators((field.annotation, *field.metadata))
            ),
            "ratio",
        )
        written[name] = _write_value(value, quantity, isinstance(table, WorkingFaces))
    return written


def _find_quantity_validators(annotations: Iterable[object]) -> Iterable[QuantityValidator]:
    # Find the validators of quantities in annotations, however deep
    for one in annotations:
        if isinstance(one, QuantityValidator):
            yield one
        yield from _find_quantity_validators((*get_args(one), *getattr(one, "__metadata__", ())))


def _write_value(value: object, quantity: str, is_zone: bool) -> object:
    match value:
        case None:
            return "none"
        case Dimension() if is_zone:
            return format_exactly(value.upper, value.quantity)
        case Dimension():
            return _write_dimension(value)
        case Sourced():
            return {"value": format_exactly(value.value, value.quantity), "source": value.source}
        case Table():
            known = (key for key, material in MATERIALS.items() if material == value)
            return next(known, None) or _list_fields(value)
        case tuple():
            return [_write_value(one, quantity, is_zone) for one in value]
        case float() if quantity != "ratio":
            return format_exactly(value, quantity)
        case str() | int() | float() | dict():
            return value
    raise StimulusError(f"a set must hold values that a file can state, got {value!r:.60}")


def _write_dimension(dimension: Dimension) -> object:
    # Write a dimension; what the standard or a default states is left to it
    nominal = format_exactly(dimension.nominal, dimension.quantity)
    source = {"source": dimension.source} if dimension.source else {}
    if dimension.general or dimension.usual:
        return {"nominal": nominal, **source} if source else nominal
    upper, lower = (
        format_exactly(end, dimension.quantity) for end in (dimension.upper, dimension.lower)
    )
    tolerance = upper if dimension.upper == -dimension.lower else f"{upper} / {lower}"
    return {"nominal": nominal, "tolerance": tolerance, **source}
