"""The height scale of a scan, checked against what the file's own header says, read by us and not by its reader.

Readers of instrument files disagree by factors. Formats that store counts state how long a count is and how far the
range goes; heights that are no multiples of it, or lie outside the range, are refused. Formats that store floating numbers
state the unit of one; a reader that took another is refused.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.scans.text import LENGTH_UNITS
from stepblocks.errors import MetrologyError


@dataclass(frozen=True)
class HeightScale:
    """What a header states of the heights."""

    count: float  # Height of one count, or of the stored number 1 [m]
    lowest: float  # Range of heights that can occur [m]
    highest: float
    field: str  # Where the header says so
    integral: bool = True  # Whether counts are stored, so that heights come in steps of one


def stated_height_scale(path: Path) -> HeightScale | None:
    """Read the height scale from the header of a NID, SUR, SDF, OPDX or GWY file; None for another format."""
    reader = {".nid": _nid, ".sur": _sur, ".sdf": _sdf, ".opdx": _opdx, ".gwy": _gwy}.get(path.suffix.lower())
    if reader is None:
        return None
    with path.open("rb") as file:
        head = file.read(65536)
        if path.suffix.lower() == ".gwy":  # units may stand behind the data
            file.seek(max(path.stat().st_size - 65536, 65536))
            head += file.read(65536)
    try:
        scale = reader(head)
    except (struct.error, KeyError, ValueError, IndexError) as error:
        raise MetrologyError(f"header must state the height scale, got {error} [{path.name}]") from error
    if scale is not None and not (np.isfinite(scale.count) and scale.count > 0.0):
        raise MetrologyError(f"{scale.field} must be positive and finite, got {scale.count:g} m [{path.name}]")
    return scale


def check_height_scale(height: NDArray[np.float64], scale: HeightScale, place: str, used: float | None = None) -> str:
    """Compare heights with the scale of the header."""
    if used is not None and abs(abs(used) / scale.count - 1.0) > 1e-6:
        raise MetrologyError(f"reader must use {scale.count:g} m per count ({scale.field}), got {used:g} m [{place}]")
    if not scale.integral and used is None:
        raise MetrologyError(f"reader must say what it took for {scale.field}, got nothing [{place}]")
    finite = height[np.isfinite(height)]
    ends = [abs(end) for end in (scale.lowest, scale.highest) if np.isfinite(end)]
    slack = 2.0 * scale.count if scale.integral else 1e-6 * max(ends, default=0.0)
    if finite.size and (finite.min() < scale.lowest - slack or finite.max() > scale.highest + slack):
        raise MetrologyError(
            f"heights must lie within {scale.lowest:g} to {scale.highest:g} m ({scale.field}), got {finite.min():g} to "
            f"{finite.max():g} m [{place}]"
        )
    if not scale.integral:
        return f"{scale.field}: {scale.count:.6g} m, checked"
    counts = (finite[:20000] - finite[0]) / scale.count
    # float32 counts above 2^24 and offsets cost digits; a wrong factor misses by far more
    if np.max(np.abs(counts - np.rint(counts))) > 0.02 + 1e-6 * float(np.max(np.abs(counts))):
        raise MetrologyError(f"heights must be multiples of {scale.count:g} m ({scale.field}) [{place}]")
    return f"{scale.field}: {scale.count:.6g} m per count, checked"


def _nid(head: bytes) -> HeightScale | None:
    """Nanosurf: the sections of channels state Dim2Unit, Dim2Range, Dim2Min and SaveBits."""
    for section in head.decode("latin-1").split("\r\n["):
        fields = dict(line.split("=", 1) for line in section.splitlines() if "=" in line)
        if "Dim2Range" in fields and fields["Dim2Unit"].strip() in LENGTH_UNITS:
            per_metre = LENGTH_UNITS[fields["Dim2Unit"].strip()]
            span, lowest = float(fields["Dim2Range"]) / per_metre, float(fields["Dim2Min"]) / per_metre
            count = span / 2 ** int(fields["SaveBits"])
            # readers keep or drop the offset of the range, which a step height does not see
            reach = max(abs(lowest), abs(lowest + span))
            return HeightScale(count, -reach, reach, "Dim2Range / 2^SaveBits")
    raise ValueError("no channel in units of length")


def _sur(head: bytes) -> HeightScale | None:
    """Digital Surf: Z spacing as float32 at byte 128, its unit as text at byte 212, limits in counts at byte 100."""
    if head[:12] != b"DIGITAL SURF":
        return None
    lowest, highest = struct.unpack_from("<ii", head, 100)
    (spacing,) = struct.unpack_from("<f", head, 128)
    unit = head[212:228].split(b"\0")[0].decode("latin-1").strip()
    count = float(spacing) / LENGTH_UNITS[unit]
    reach = (max(abs(lowest), abs(highest)) + 2) * count
    return HeightScale(count, -reach, reach, "Z spacing of the header")


def _sdf(head: bytes) -> HeightScale | None:
    """ISO 25178-71: Zscale in metres per count; floating types have no counts."""
    if head[:8] == b"bISO-1.0":
        count, kind = struct.unpack_from("<d", head, 62)[0], head[79]
    elif head[:8] == b"aISO-1.0":
        text = head.split(b"*", 1)[0].decode("latin-1")
        fields = {key.strip(): value.strip() for key, value in (x.split("=", 1) for x in text.splitlines() if "=" in x)}
        count, kind = float(fields["Zscale"]), int(fields["DataType"])
    else:
        return None
    if kind in (3, 7):
        return None
    return HeightScale(float(count), -(2**32) * count, 2**32 * count, "Zscale of the header")


def _opdx(head: bytes) -> HeightScale | None:
    """Dektak: the quantity DataScale of a channel, value as float64, then name and symbol of its unit, each with its length."""
    mark = struct.pack("<I", 9) + b"DataScale\x13"
    at = head.find(mark)
    if at < 0:
        raise ValueError("no DataScale")
    at += len(mark)
    at += 1 + head[at]  # length of the item, in as many bytes as its first says
    (value,) = struct.unpack_from("<d", head, at)
    at += 8
    texts = []
    for _ in range(2):
        (size,) = struct.unpack_from("<I", head, at)
        texts.append(head[at + 4 : at + 4 + min(size, 64)].decode("utf-8"))
        at += 4 + size
    per_metre = LENGTH_UNITS[texts[1].strip()]
    return HeightScale(float(value) / per_metre, -np.inf, np.inf, "DataScale of the channel", integral=False)


def _gwy(head: bytes) -> HeightScale | None:
    """Gwyddion: heights are float64 in the unit that the object si_unit_z spells out; an empty one is none."""
    at = head.find(b"si_unit_z\0o")
    text = head.find(b"unitstr\0s", at)
    if at < 0 or text < 0:
        raise ValueError("no si_unit_z")
    unit = head[text + 9 : text + 41].split(b"\0")[0].decode("utf-8").strip()
    return HeightScale(1.0 / LENGTH_UNITS[unit], -np.inf, np.inf, f"si_unit_z {unit!r}", integral=False)
