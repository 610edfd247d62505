"""A slider for the size of a part: its entry in the form, between a fifth and the double of it."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from nicegui import events, ui

from stepblocks.errors import QuantityError
from stepblocks.quantities import format_units, parse_quantity
from stepblocks.window import texts

_ENTRY = re.compile(r"\s*(?P<number>[0-9.]+(e-?[0-9]+)?)\s*(?P<unit>[A-Za-zµ]+)\s*")
_LOWEST, _HIGHEST = 0.2, 2.0  # ends of the slider, in the entry that it begins with [1]
_STEPS = 180  # from end to end
_DIGITS = 4  # of the value that the slider writes


@dataclass(frozen=True)
class SizeRange:
    """What a slider of a size goes over.

    Attributes
    ----------
    value : float
        Where it begins.
    unit : str
        Of all values, as the entry has it.
    """

    value: float
    unit: str

    @property
    def low(self) -> float:
        """The lower end."""
        return _round(_LOWEST * self.value)

    @property
    def high(self) -> float:
        """The upper end."""
        return _round(_HIGHEST * self.value)

    @property
    def step(self) -> float:
        """The distance of two values."""
        return _round((self.high - self.low) / _STEPS)

    def format_entry(self, value: float) -> str:
        """Write a value of the slider as the form takes it."""
        return f"{_round(value):g} {self.unit}"


def read_range(entry: str) -> SizeRange | None:
    """Read what an entry of a form lets a slider go over; None where it is no plain length."""
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


def add_slider(name: str, given: SizeRange, write: Callable[[str], object]) -> ui.slider:
    """Add a slider that writes its value as the entry of a field.

    Parameters
    ----------
    name : str
        Of the field.
    given : SizeRange
    write : callable
        Receives the entry while the slider is moved.
    """
    label = texts.SLIDE.format(field=name, unit=format_units(given.unit))
    ui.label(label)

    def follow(event: events.ValueChangeEventArguments[float | None]) -> None:
        if event.value is not None:
            write(given.format_entry(event.value))

    slider = ui.slider(
        min=given.low, max=given.high, step=given.step, value=given.value, on_change=follow
    )
    return slider.props(f'label aria-label="{label}"').classes("w-full").mark("slider")


def _round(value: float) -> float:
    """Round to the digits that are written."""
    return float(f"{value:.{_DIGITS}g}")
