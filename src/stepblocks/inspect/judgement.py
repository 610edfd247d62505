"""A characteristic with its decision, or with the reason why it was not measured."""

from collections.abc import Iterable
from typing import NamedTuple

from stepblocks.inspect.conformity import Decision
from stepblocks.parts.characteristics import Characteristic


class Judgement(NamedTuple):
    """A characteristic and how its value was judged."""

    characteristic: Characteristic
    decision: Decision


class NotMeasured(NamedTuple):
    """A characteristic that was not measured, and what would measure it."""

    characteristic: Characteristic
    reason: str


def number_characteristics(characteristics: Iterable[Characteristic]) -> dict[str, int]:
    """Return the numbers of characteristics on the drawing, from 1, by key."""
    numbers = {}
    for number, characteristic in enumerate(characteristics, start=1):
        numbers[characteristic.key] = number
    return numbers


def is_angle(key: str) -> bool:
    """Tell whether a key is that of an angle; all other characteristics are lengths."""
    return key.endswith("_angle")
