"""Doubts about a scan: the unit of its heights, or the part that it shows."""

import math
import re
from collections.abc import Iterable

from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kind import Part

_UNITS = ("pm", "nm", "um", "mm", "m")  # each 1000 of the one before
_UNIT_READ = re.compile(r"(?<![a-z])(pm|nm|um|mm|m)(?![a-z])")
# of the logarithm of a size over the declared one, about a power of 1000 [1]: a factor of two
_NEAR_POWER = 0.3


def describe_doubts(
    size: Characteristic, value: float, scale: str, parts: Iterable[Part]
) -> list[Note]:
    """Say that a size is off by a power of 1000, or that another part of the set is of this size.

    Parameters
    ----------
    size : Characteristic
        What the part declares.
    value : float
        What the scan shows [m].
    scale : str
        How the reader read the heights.
    parts : iterable of Part
        Other parts of the set.

    Returns
    -------
    list of Note
        One, or none where nothing is in doubt.
    """
    power = _find_power_of_1000(size, value)
    if power:
        doubt = NoteKind.UNIT_IN_DOUBT.describe(
            label=size.label,
            value=value * 1e6,
            factor=1000.0**power,
            nominal=size.nominal * 1e6,
            likely=_suggest_unit(scale, power),
        )
        return [doubt]
    twins = _find_parts_of_size(size.key, value, parts)
    if not twins:
        return []
    kind = NoteKind.PART_LIKELY_WRONG
    if size.lower <= value - size.nominal <= size.upper:
        kind = NoteKind.PART_IN_DOUBT
    return [kind.describe(label=size.label, value=value * 1e6, twins=", ".join(twins))]


def _find_power_of_1000(size: Characteristic, value: float) -> int:
    """Return the power of 1000 by which a value [m] is off what is declared; 0 where by none."""
    if not size.nominal:
        return 0
    ratio = value / size.nominal
    if not ratio > 0.0:
        return 0
    power = round(math.log10(ratio) / 3.0)
    if abs(math.log10(ratio) - 3.0 * power) < _NEAR_POWER:
        return power
    return 0


def _suggest_unit(scale: str, power: int) -> str:
    """Say which unit explains heights that are off by a power of 1000, and which was read."""
    units = _UNIT_READ.findall(scale.split(";")[0].replace("µ", "u"))
    if not units:
        return "another one"
    read = units[-1]
    index = _UNITS.index(read) - power
    if 0 <= index < len(_UNITS):
        return f"{_UNITS[index]}, not {read}"
    return "another one"


def _find_parts_of_size(key: str, value: float, parts: Iterable[Part]) -> list[str]:
    """Return the identities of the parts whose characteristic of a key holds a value [m]."""
    twins = []
    for part in parts:
        for size in part.characteristics():
            if size.key != key:
                continue
            if size.nominal + size.lower <= value <= size.nominal + size.upper:
                twins.append(part.id)
    return twins
