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


def refuse_wrong_height_unit(
    declared: Characteristic, measured_size: float, scale_description: str, file_name: str
) -> None:
    """Refuse heights that are off what is declared by a power of 1000.

    Parameters
    ----------
    declared : Characteristic
        What the part or the standard declares.
    measured_size : float
        What the scan shows [m].
    scale_description : str
        How the reader read the heights.
    file_name : str
        Name of the file.

    Raises
    ------
    MetrologyError
        With the unit that is likely.
    """
    power = _compute_power_of_1000_off(declared, measured_size)
    if not power:
        return
    raise MetrologyError(
        f"{declared.label} must be near {declared.nominal * 1e6:.4g} um, got "
        f"{measured_size * 1e6:.4g} um, about "
        f"{1000.0**power:g} times as much: the unit of the heights is likely "
        f"{_describe_likely_unit(scale_description, power)} [{file_name}]"
    )


def refuse_long_scan(sizes: Iterable[Characteristic], scan_length: float, file_name: str) -> None:
    """Refuse a scan of a length [m] that is far beyond the largest size of its part."""
    largest = 0.0
    for size in sizes:
        if size.kind == "distance":
            largest = max(largest, size.nominal)
    if scan_length <= _TOO_LONG * largest or not largest:
        return
    raise MetrologyError(
        f"positions must lie on the part, of at most {largest * 1e3:.4g} mm, got a scan of "
        f"{scan_length * 1e3:.4g} mm: make sure of the unit of the positions [{file_name}]"
    )


def note_other_parts_of_measured_size(
    declared: Characteristic, measured_size: float, other_parts: Iterable[Part]
) -> list[Note]:
    """Note that another part of the set is of the size that was measured.

    Parameters
    ----------
    declared : Characteristic
        What the part declares.
    measured_size : float
        What the scan shows [m].
    other_parts : iterable of Part
        Other parts of the set.

    Returns
    -------
    list of Note
        One, or none where nothing is in doubt.
    """
    twins = _list_ids_of_parts_of_size(declared.key, measured_size, other_parts)
    if not twins:
        return []
    kind = NoteKind.PART_LIKELY_WRONG
    if declared.lower <= measured_size - declared.nominal <= declared.upper:
        kind = NoteKind.PART_IN_DOUBT
    return [kind.make_note(label=declared.label, value=measured_size * 1e6, twins=", ".join(twins))]


def _compute_power_of_1000_off(declared: Characteristic, measured_size: float) -> int:
    """Return the power of 1000 by which a value [m] is off what is declared; 0 where by none."""
    if not declared.nominal:
        return 0
    ratio = measured_size / declared.nominal
    if not ratio > 0.0:
        return 0
    power = round(math.log10(ratio) / 3.0)
    if abs(math.log10(ratio) - 3.0 * power) < _NEAR_POWER:
        return power
    return 0


def _describe_likely_unit(scale_description: str, power: int) -> str:
    """Say which unit explains heights that are off by a power of 1000, and which was read."""
    units = _UNIT_READ.findall(scale_description.split(";")[0].replace("µ", "u"))
    if not units:
        return "another one"
    read = units[-1]
    index = _UNITS.index(read) - power
    if 0 <= index < len(_UNITS):
        return f"{_UNITS[index]}, not {read}"
    return "another one"


def _list_ids_of_parts_of_size(
    characteristic_key: str, measured_size: float, parts: Iterable[Part]
) -> list[str]:
    """Return the identities of the parts whose characteristic of a key holds a value [m]."""
    twins = []
    for part in parts:
        for size in part.characteristics():
            if size.key != characteristic_key:
                continue
            if size.nominal + size.lower <= measured_size <= size.nominal + size.upper:
                twins.append(part.id)
    return twins
