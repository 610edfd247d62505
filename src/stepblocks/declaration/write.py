"""A stimulus set as the text of a stimulus file, which reads back as the same set."""

from collections.abc import Container, Iterable, Iterator
from typing import get_args

import tomli_w

from stepblocks.errors import StimulusError
from stepblocks.parts.declared import QuantityValidator, Sourced, Table, WorkingFaces
from stepblocks.parts.kind import Part
from stepblocks.parts.material import MATERIALS
from stepblocks.parts.tolerance import Dimension
from stepblocks.quantities import format_exactly

SCHEMA = 1  # version of the stimulus file format


def format_set_as_toml(stimuli: Table, name: str, parts: Iterable[Part]) -> str:
    """Write a set as TOML, every value in full.

    Parameters
    ----------
    stimuli : Table
        The set.
    name : str
        Name of the set.
    parts : iterable of Part
        Its parts, which become stanzas by kind.

    Returns
    -------
    str
        The text of a stimulus file.

    Raises
    ------
    StimulusError
        If a value cannot be stated in a file.
    """
    document: dict[str, object] = {"schema": SCHEMA, "set": name}
    document.update(_convert_fields_to_toml(stimuli, left_out=("name", "stimuli")))
    stanzas: dict[str, list[dict[str, object]]] = {}
    for part in parts:
        stanzas.setdefault(part.stanza, []).append(_convert_fields_to_toml(part))
    document.update(stanzas)
    return tomli_w.dumps(document)


def _convert_fields_to_toml(table: Table, left_out: Container[str] = ()) -> dict[str, object]:
    """Return the fields of a table as TOML holds them; what is absent by default is left out."""
    fields: dict[str, object] = {}
    for name, field in type(table).model_fields.items():
        value = getattr(table, name)
        is_left_out = name in left_out or field.exclude
        if is_left_out or (value is None and field.default is None):
            continue
        quantity = _find_validated_dimension((field.annotation, *field.metadata))
        if isinstance(table, WorkingFaces) and isinstance(value, Dimension):
            fields[name] = format_exactly(value.upper, value.quantity)
        else:
            fields[name] = _convert_value_to_toml(value, quantity)
    return fields


def _find_validated_dimension(annotations: Iterable[object]) -> str:
    """Find the dimension that a field's validator reads; ``"ratio"`` for a plain number."""
    for validator in _yield_quantity_validators(annotations):
        return validator.dimension
    return "ratio"


def _yield_quantity_validators(annotations: Iterable[object]) -> Iterator[QuantityValidator]:
    """Yield the validators of quantities in annotations, however deep."""
    for annotation in annotations:
        if isinstance(annotation, QuantityValidator):
            yield annotation
        metadata = getattr(annotation, "__metadata__", ())
        yield from _yield_quantity_validators((*get_args(annotation), *metadata))


def _convert_value_to_toml(value: object, quantity: str) -> object:
    """Return a value as TOML holds it; numbers are of the quantity that their field reads."""
    if value is None:
        return "none"
    if isinstance(value, Dimension):
        return _convert_dimension_to_toml(value)
    if isinstance(value, Sourced):
        return {"value": format_exactly(value.value, value.quantity), "source": value.source}
    if isinstance(value, Table):
        return _convert_table_to_toml(value)
    if isinstance(value, tuple):
        return [_convert_value_to_toml(item, quantity) for item in value]
    if isinstance(value, float) and quantity != "ratio":
        return format_exactly(value, quantity)
    if isinstance(value, str | int | float | dict):
        return value
    raise StimulusError(f"a set must hold values that a file can state, got {value!r:.60}")


def _convert_table_to_toml(table: Table) -> object:
    """Return a table as TOML holds it; a known material is its key."""
    for key, material in MATERIALS.items():
        if material == table:
            return key
    return _convert_fields_to_toml(table)


def _convert_dimension_to_toml(dimension: Dimension) -> object:
    """Return a dimension as TOML holds it; what the standard or a default states is left to it."""
    nominal = format_exactly(dimension.nominal, dimension.quantity)
    fields = {"nominal": nominal}
    is_stated = not (dimension.general or dimension.usual or dimension.by_feel)
    if is_stated:
        fields["tolerance"] = _format_tolerance(dimension)
    if dimension.source:
        fields["source"] = dimension.source
    if len(fields) == 1:
        return nominal
    return fields


def _format_tolerance(dimension: Dimension) -> str:
    """Write the deviations of a dimension: one to either side, or both."""
    upper = format_exactly(dimension.upper, dimension.quantity)
    if dimension.upper == -dimension.lower:
        return upper
    lower = format_exactly(dimension.lower, dimension.quantity)
    return f"{upper} / {lower}"
