"""Doubts about a scan: the unit of its heights or positions, or the part that it shows.

A unit that cannot be right refuses the scan; of a part that is likely another one, a note says so.
"""

import math
import re
from collections.abc import Iterable

from stepblocks.errors import MetrologyError
from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kind import Part

_UNITS = ("pm", "nm", "um", "mm", "m")  # each 1000 of the one before
_UNIT_READ = re.compile(r"(?<![a-z])(pm|nm|um|mm|m)(?![a-z])")
# of the logarithm of a size over the declared one, about a power of 1000 [1]: a factor of two
_NEAR_POWER = 0.3
# of the largest size of a part, which no scan of it is as long as [1]
_TOO_LONG = 10.0


def refuse_wrong_unit(size: Characteristic, value: float, scale: str, place: str) -> None:
    """Refuse heights that are off what is declared by a power of 1000.

    Parameters
    ----------
    size : Characteristic
        What the part or the standard declares.
    value : float
        What the scan shows [m].
    scale : str
        How the reader read the heights.
    place : str
        Name of the file.

    Raises
    ------
    MetrologyError
        With the unit that is likely.
    """
    power = _find_power_of_1000(size, value)
    if not power:
        return
    raise MetrologyError(
        f"{size.label} must be near {size.nominal * 1e6:.4g} um, got {value * 1e6:.4g} um, about "
        f"{1000.0**power:g} times as much: the unit of the heights is likely "
        f"{_suggest_unit(scale, power)} [{place}]"
    )


def refuse_long_scan(sizes: Iterable[Characteristic], length: float, place: str) -> None:
    """Refuse a scan of a length [m] that is far beyond the largest size of its part."""
    largest = 0.0
    for size in sizes:
        if size.kind == "distance":
            largest = max(largest, size.nominal)
    if length <= _TOO_LONG * largest or not largest:
        return
    raise MetrologyError(
        f"positions must lie on the part, of at most {largest * 1e3:.4g} mm, got a scan of "
        f"{length * 1e3:.4g} mm: make sure of the unit of the positions [{place}]"
    )


def note_other_parts_of_size(
    size: Characteristic, value: float, parts: Iterable[Part]
) -> list[Note]:
    """Note that another part of the set is of the size that was measured.

    Parameters
    ----------
    size : Characteristic
        What the part declares.
    value : float
        What the scan shows [m].
    parts : iterable of Part
        Other parts of the set.

    Returns
    -------
    list of Note
        One, or none where nothing is in doubt.
    """
    twins = _find_parts_of_size(size.key, value, parts)
    if not twins:
        return []
    kind = NoteKind.PART_LIKELY_WRONG
    if size.lower <= value - size.nominal <= size.upper:
        kind = NoteKind.PART_IN_DOUBT
    return [kind.make_note(label=size.label, value=value * 1e6, twins=", ".join(twins))]


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
