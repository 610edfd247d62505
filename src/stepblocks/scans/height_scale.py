"""The height scale of a scan, read from the file itself.

It is the check on readers of instrument files, which disagree by factors.
"""

import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.scans.text import LENGTH_UNITS

_MOST_HEAD = 1 << 16  # bytes of a header that are read
_MOST_INDEX = 1 << 24  # bytes of the index of an archive
_CHUNK = 1 << 22
_X3P_TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
_BROKEN = (
    struct.error,
    zipfile.BadZipFile,
    ElementTree.ParseError,
    LookupError,
    ValueError,
    OSError,
    EOFError,
)
_MICROMETRE = 1e-6  # height of the stored number 1 in a PLUX file [m]


@dataclass(frozen=True)
class HeightScale:
    """What a file states of its heights."""

    count: float  # height of one count, or of the stored number 1 [m]
    lowest: float  # end of the range of heights that can occur [m]
    highest: float  # likewise [m]
    field: str  # where the file says so
    integral: bool = True  # whether counts are stored, so that heights come in steps of one


def read_height_scale(path: Path, form: str, channel: str) -> HeightScale | None:
    """Read the height scale of a channel from the file itself.

    The result is None for a format that states none that is read here.
    """
    try:
        if form in _PACKED:
            with zipfile.ZipFile(path) as archive:
                scale: HeightScale | None = _PACKED[form](archive)
        else:
            with path.open("rb") as file:
                scale = _HEADERS[form](file.read(_MOST_HEAD), channel) if form in _HEADERS else None
    except _BROKEN as error:
        raise MetrologyError(
            f"{'index' if form in _PACKED else 'header'} must state the height scale, got "
            f"{getattr(error, 'strerror', None) or error} [{path.name}]"
        ) from error
    if scale is not None and not (np.isfinite(scale.count) and scale.count > 0.0):
        raise MetrologyError(
            f"{scale.field} must be positive and finite, got {scale.count:g} m [{path.name}]"
        )
    return scale


def check_height_scale(
    height: NDArray[np.float64], scale: HeightScale, place: str, used: float | None = None
) -> str:
    """Compare heights with the scale of the header."""
    if used is not None and abs(abs(used) / scale.count - 1.0) > 1e-6:
        raise MetrologyError(
            f"reader must use {scale.count:g} m per count ({scale.field}), got {used:g} m [{place}]"
        )
    MetrologyError.require(
        scale.integral or used is not None,
        f"reader must say what it took for {scale.field}, got nothing [{place}]",
    )
    finite = height[np.isfinite(height)]
    ends = [abs(end) for end in (scale.lowest, scale.highest) if np.isfinite(end)]
    slack = 2.0 * scale.count if scale.integral else 1e-6 * max(ends, default=0.0)
    if finite.size and (
        finite.min() < scale.lowest - slack or finite.max() > scale.highest + slack
    ):
        raise MetrologyError(
            f"heights must lie within {scale.lowest:g} to {scale.highest:g} m ({scale.field}), "
            f"got {finite.min():g} to {finite.max():g} m [{place}]"
        )
    if not scale.integral:
        return f"{scale.field}: {scale.count:.6g} m, checked"
    counts = (finite[:20000] - finite[0]) / scale.count
    # float32 counts above 2^24 and offsets cost digits; a wrong factor misses by far more
    MetrologyError.require(
        np.max(np.abs(counts - np.rint(counts))) <= 0.02 + 1e-6 * float(np.max(np.abs(counts))),
        f"heights must be multiples of {scale.count:g} m ({scale.field}) [{place}]",
    )
    return f"{scale.field}: {scale.count:.6g} m per count, checked"


def _read_nid_scale(head: bytes, channel: str) -> HeightScale | None:
    # Nanosurf: the sections of channels state Frame, Dim2Name, Dim2Unit, Dim2Range, Dim2Min and
    # SaveBits.
    for section in head.decode("latin-1").split("\r\n["):
        fields = dict(line.split("=", 1) for line in section.splitlines() if "=" in line)
        named = (
            not channel
            or f"{fields.get('Frame', '').strip()} ({fields.get('Dim2Name', '').strip()})"
            == channel
        )
        if "Dim2Range" in fields and named and fields["Dim2Unit"].strip() in LENGTH_UNITS:
            per_metre = LENGTH_UNITS[fields["Dim2Unit"].strip()]
            span, lowest = (
                float(fields["Dim2Range"]) / per_metre,
                float(fields["Dim2Min"]) / per_metre,
            )
            # readers keep or drop the offset of the range, which a step height does not see
            reach = max(abs(lowest), abs(lowest + span))
            return HeightScale(
                span / 2 ** int(fields["SaveBits"]), -reach, reach, "Dim2Range / 2^SaveBits"
            )
    raise ValueError("no channel in units of length")


def _read_sur_scale(head: bytes, channel: str) -> HeightScale | None:
    # Digital Surf: Z spacing as float32 at byte 128, its unit as text at byte 212, limits in counts
    # at byte 100.
    if head[:12] not in (b"DIGITAL SURF", b"DSCOMPRESSED"):
        return None
    lowest, highest = struct.unpack_from("<ii", head, 100)
    (spacing,) = struct.unpack_from("<f", head, 128)
    unit = head[212:228].split(b"\0")[0].decode("latin-1").strip()
    count = float(spacing) / LENGTH_UNITS[unit]
    reach = (max(abs(lowest), abs(highest)) + 2) * count
    return HeightScale(count, -reach, reach, "Z spacing of the header")


def _read_sdf_scale(head: bytes, channel: str) -> HeightScale | None:
    # ISO 25178-71: Zscale in metres per count; floating types have no counts.
    if head[:8] == b"bISO-1.0":
        count, kind = struct.unpack_from("<d", head, 62)[0], head[79]
    elif head[:8] == b"aISO-1.0":
        text = head.split(b"*", 1)[0].decode("latin-1")
        fields = {
            key.strip(): value.strip()
            for key, value in (x.split("=", 1) for x in text.splitlines() if "=" in x)
        }
        count, kind = float(fields["Zscale"]), int(fields["DataType"])
    else:
        return None
    return (
        None
        if kind in (3, 7)
        else HeightScale(count, -(2**32) * count, 2**32 * count, "Zscale of the header")
    )


def _read_opdx_scale(head: bytes, channel: str) -> HeightScale | None:
    # Dektak: the quantity DataScale of a channel, value as float64, then name and symbol of its
    # unit, each with its length.
    mark = struct.pack("<I", 9) + b"DataScale\x13"
    at = head.find(mark) + len(mark)
    if at < len(mark):
        raise ValueError("no DataScale")
    at += 1 + head[at]  # length of the item, in as many bytes as its first says
    value, size = struct.unpack_from("<dI", head, at)
    (length,) = struct.unpack_from("<I", head, at + 12 + size)
    symbol = head[at + 16 + size : at + 16 + size + min(length, 64)].decode("utf-8")
    return HeightScale(
        value / LENGTH_UNITS[symbol.strip()],
        -np.inf,
        np.inf,
        "DataScale of the channel",
        integral=False,
    )


def _read_x3p_scale(archive: zipfile.ZipFile) -> HeightScale:
    # ISO 25178-72: ``Axes/CZ`` states type and increment; heights in metres are the stored number
    # times the increment.
    index = _read_index(archive, "main.xml")
    axis = index.find("Record1/Axes/CZ")
    if axis is None:
        raise ValueError("no Record1/Axes/CZ")
    stated = {child.tag: (child.text or "").strip() for child in axis}
    increment, offset = float(stated.get("Increment") or 1.0), float(stated.get("Offset") or 0.0)
    kind = _X3P_TYPES[stated["DataType"]]
    lowest, highest = -np.inf, np.inf
    link = index.find("Record3/DataLink/PointDataLink")
    grid = index.find("Record3/MatrixDimension")
    # else the points stand in the index as text
    if link is not None and link.text and grid is not None:
        lowest, highest = sorted(
            increment * end for end in _read_range(archive, link.text.strip(), kind)
        )
        # readers keep or drop the offset of the axis, which a step height does not see
        lowest, highest = lowest + min(offset, 0.0), highest + max(offset, 0.0)
    return HeightScale(abs(increment), lowest, highest, "Increment of CZ", integral="i" in kind)


def _read_plux_scale(archive: zipfile.ZipFile) -> HeightScale:
    # Sensofar: float32 of every layer in micrometres, as many as the index states.
    index = _read_index(archive, "index.xml")
    name = _read_text(index, "LAYER_0/FILENAME_Z")
    points = int(_read_text(index, "GENERAL/IMAGE_SIZE_X")) * int(
        _read_text(index, "GENERAL/IMAGE_SIZE_Y")
    )
    if archive.getinfo(name).file_size != 4 * points:
        raise ValueError(f"{archive.getinfo(name).file_size} bytes in {name} for {points} points")
    lowest, highest = (end * _MICROMETRE for end in _read_range(archive, name, "<f4"))
    return HeightScale(
        _MICROMETRE, lowest, highest, f"numbers of {name}, um by the format", integral=False
    )


def _read_index(archive: zipfile.ZipFile, name: str) -> ElementTree.Element:
    if archive.getinfo(name).file_size > _MOST_INDEX:
        raise ValueError(f"{name} of more than {_MOST_INDEX >> 20} MiB")
    text = archive.read(name)
    # entities may grow without bound
    if b"<!" in text.replace(b"<!--", b"").replace(b"<![CDATA[", b""):
        raise ValueError(f"a document type in {name}")
    return ElementTree.fromstring(text)


def _read_text(index: ElementTree.Element, path: str) -> str:
    if (text := index.findtext(path)) is None:
        raise ValueError(f"no {path}")
    return text.strip()


def _read_range(archive: zipfile.ZipFile, name: str, kind: str) -> tuple[float, float]:
    # Least and largest stored number, read piece by piece since a member may be large.
    lowest, highest = np.inf, -np.inf
    with archive.open(name) as file:
        while piece := file.read(_CHUNK):
            values = np.frombuffer(piece, dtype=kind)
            known = values[np.isfinite(values)]
            if known.size:
                lowest, highest = min(lowest, float(known.min())), max(highest, float(known.max()))
    if not lowest <= highest:
        raise ValueError(f"no number in {name}")
    return lowest, highest


_HEADERS = {
    "ezd": _read_nid_scale,
    "sur": _read_sur_scale,
    "sdf": _read_sdf_scale,
    "opdx": _read_opdx_scale,
}
_PACKED = {"x3p": _read_x3p_scale, "plux": _read_plux_scale}
