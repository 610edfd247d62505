"""Sliders for the sizes of a part: their entry in the form, between a fifth and the double of it.

An entry is a plain length, a table with a nominal size, or a series with its values or its ends.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from nicegui import events, ui

from stepblocks.errors import QuantityError
from stepblocks.quantities import format_units, parse_quantity
from stepblocks.window import texts
from stepblocks.window.toml_text import MalformedTomlError, parse_toml_value

_ENTRY = re.compile(r"\s*(?P<number>[0-9.]+(e-?[0-9]+)?)\s*(?P<unit>[A-Za-zµ]+)\s*")
_LOWEST, _HIGHEST = 0.2, 2.0  # ends of the slider, in the entry that it begins with [1]
_STEPS = 180  # from end to end
_DIGITS = 4  # of the value that the slider writes
_NOMINAL = "nominal"  # key of the size of a table
_ENDS, _DISTANCE = ("from", "to"), "step"  # keys of a series of equal distances
_VALUES = "values"  # key of the list of sizes of a series
MOST_SLIDERS = 12  # of a stanza


@dataclass(frozen=True)
class SizeRange:
    """The range that the slider of a size covers.

    Attributes
    ----------
    value : float
        Initial value.
    unit : str
        Unit of all values, as in the entry.
    grid : float
        Spacing of the sizes of a series, whose ends move by whole steps; 0 for other sizes.
    """

    value: float
    unit: str
    grid: float = 0.0

    @property
    def low(self) -> float:
        """The lower end."""
        if self.grid:
            steps = math.floor((1.0 - _LOWEST) * self.value / self.grid)
            return _round_to_written_digits(self.value - steps * self.grid)
        return _round_to_written_digits(_LOWEST * self.value)

    @property
    def high(self) -> float:
        """The upper end."""
        if self.grid:
            steps = math.ceil((_HIGHEST - 1.0) * self.value / self.grid)
            return _round_to_written_digits(self.value + steps * self.grid)
        return _round_to_written_digits(_HIGHEST * self.value)

    @property
    def step(self) -> float:
        """The distance of two values."""
        if self.grid:
            return self.grid
        return _round_to_written_digits((self.high - self.low) / _STEPS)

    def contains(self, size_range: "SizeRange") -> bool:
        """Tell whether a size is in this unit, and lies within the slider."""
        return size_range.unit == self.unit and self.low <= size_range.value <= self.high

    def format_value_with_unit(self, value: float) -> str:
        """Write a value of the slider as the form takes it."""
        return f"{_round_to_written_digits(value):g} {self.unit}"


@dataclass(frozen=True)
class Size:
    """A size within an entry of a form.

    Attributes
    ----------
    place : tuple
        Keys and indices that lead to it; none where it is the entry itself.
    range : SizeRange
    """

    place: tuple[str | int, ...]
    range: SizeRange

    @property
    def place_label(self) -> str:
        """Its place in words, which follow the name of the field; empty for the entry itself."""
        return " ".join(str(part + 1) if isinstance(part, int) else part for part in self.place)

    def replace_in_entry(self, entry: str, value: float) -> str:
        """Return an entry with another value of the size; unchanged where it holds it no more."""
        text = self.range.format_value_with_unit(value)
        if not self.place:
            return text
        table = _parse_toml_value(entry)
        if _find_value_at(table, self.place) is None:
            return entry
        holder = _find_value_at(table, self.place[:-1])
        holder[self.place[-1]] = text
        return str(table.as_string())


def read_size_range(entry: object) -> SizeRange | None:
    """Read what an entry of a form lets a slider go over; None where it is no plain length."""
    if not isinstance(entry, str):
        return None
    found = _ENTRY.fullmatch(entry)
    if found is None:
        return None
    try:
        length = parse_quantity(entry, "length")
    except QuantityError:
        return None
    if length <= 0.0:
        return None
    return SizeRange(float(found["number"]), found["unit"])


def list_slidable_sizes(entry: str) -> list[Size]:
    """List the lengths within an entry that sliders can change, twelve at most."""
    plain = read_size_range(entry)
    if plain is not None:
        return [Size((), plain)]
    table = _parse_toml_value(entry)
    if not isinstance(table, Mapping):
        return []
    sizes = _list_series_ends(table)
    places: list[tuple[str | int, ...]] = [(_NOMINAL,)]
    values = table.get(_VALUES)
    if isinstance(values, Sequence) and not isinstance(values, str):
        places += [(_VALUES, number) for number in range(len(values))]
    for place in places:
        size = read_size_range(_find_value_at(table, place))
        if size is not None:
            sizes.append(Size(place, size))
    return sizes[:MOST_SLIDERS]


def _list_series_ends(table: Mapping[str, Any]) -> list[Size]:
    """List the ends of a series, each of which moves by whole distances of its sizes."""
    step = read_size_range(table.get(_DISTANCE))
    if step is None:
        return []
    ends = []
    for key in _ENDS:
        end = read_size_range(table.get(key))
        if end is not None and end.unit == step.unit:
            ends.append(Size((key,), replace(end, grid=step.value)))
    return ends


def add_slider(
    field_name: str, size: Size, read_entry: Callable[[], str], write_entry: Callable[[str], object]
) -> None:
    """Add a slider that changes a size within the entry of a field.

    Parameters
    ----------
    field_name : str
        Its name.
    size : Size
    read_entry, write_entry : callable
        Return the entry as it is, and receive it as changed while the slider is moved.
    """
    given = size.range
    name = f"{field_name} {size.place_label}".strip()
    label = texts.SLIDE.format(field=name, unit=format_units(given.unit))
    ui.label(label)

    def change_size(event: events.ValueChangeEventArguments[float | None]) -> None:
        """Write the size of the slider into the entry."""
        if event.value is not None:
            write_entry(size.replace_in_entry(read_entry(), event.value))

    slider = ui.slider(
        min=given.low, max=given.high, step=given.step, value=given.value, on_change=change_size
    )
    slider.props(f'label aria-label="{label}"').classes("w-full").mark("slider")


def _parse_toml_value(entry: str) -> Any:
    """Read an entry as a value of TOML; None where it is none."""
    try:
        return parse_toml_value(entry)
    except MalformedTomlError:
        return None


def _find_value_at(table: Any, keys: tuple[str | int, ...]) -> Any:
    """Return what stands at a place of a table; None where nothing does."""
    value = table
    try:
        for part in keys:
            value = value[part]
    except (KeyError, IndexError, TypeError):
        return None
    return value


def _round_to_written_digits(value: float) -> float:
    """Round to the digits that are written."""
    return float(f"{value:.{_DIGITS}g}")
