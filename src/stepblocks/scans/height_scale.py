"""The height scale of a scan, read from the file itself.

It is the check on readers of instrument files, which disagree by factors.
"""

import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.scans.units import UNITS_PER_METRE

_HEADER_BYTES = 1 << 16  # of a header that are read
_MOST_INDEX_BYTES = 1 << 24  # of the index of an archive
_CHUNK_BYTES = 1 << 22
_X3P_TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
_SDF_FLOATING_TYPES = (3, 7)
_SDF_MOST_COUNT = 2**32
_OPDX_MOST_UNIT_BYTES = 64
# What the parsers of a damaged or hostile file raise
_DAMAGED = (
    struct.error,
    zipfile.BadZipFile,
    ElementTree.ParseError,
    LookupError,
    ValueError,
    OSError,
    EOFError,
)
_MICROMETRE = 1e-6  # height of the stored number 1 in a PLUX file [m]
_SAME_SCALE = 1e-6  # difference of two scales that are the same, relative [1]
_SLACK_COUNTS = 2.0  # that heights may lie outside of their range
_CHECKED_HEIGHTS = 20_000  # that are compared with whole counts
# Distance from a whole count that rounding explains: at least, and for each count [1]
_WHOLE_COUNT = 0.02
_FLOAT32_COUNT = 1e-6


@dataclass(frozen=True)
class HeightScale:
    """What a file states of its heights.

    Attributes
    ----------
    count : float
        Height of one count, or of the stored number 1 [m].
    lowest, highest : float
        Range of heights that can occur [m].
    field : str
        Where the file says so.
    integral : bool
        Whether counts are stored, so that heights come in steps of one.
    """

    count: float
    lowest: float
    highest: float
    field: str
    integral: bool = True


def read_height_scale(path: Path, format_name: str, channel: str) -> HeightScale | None:
    """Read the height scale of a channel from the file itself.

    Parameters
    ----------
    path : Path
        File of an instrument.
    format_name : str
        Its format, as a reader of scans names it.
    channel : str
        Name of the channel; empty for the first.

    Returns
    -------
    HeightScale or None
        None for a format that states no scale that is read here.

    Raises
    ------
    MetrologyError
        If the file must state a scale and does not, or states one that is not positive.
    """
    if format_name in _ARCHIVES:
        scale = _read_archive_scale(path, _ARCHIVES[format_name])
    elif format_name in _HEADERS:
        scale = _read_header_scale(path, _HEADERS[format_name], channel)
    else:
        return None
    if scale is None:
        return None
    if not np.isfinite(scale.count) or scale.count <= 0.0:
        raise MetrologyError(
            f"{scale.field} must be positive and finite, got {scale.count:g} m [{path.name}]"
        )
    return scale


def _read_archive_scale(
    path: Path, read_scale: Callable[[zipfile.ZipFile], HeightScale]
) -> HeightScale | None:
    """Read the height scale from an archive by a reader; damage is an error of ours."""
    try:
        with zipfile.ZipFile(path) as archive:
            return read_scale(archive)
    except _DAMAGED as error:
        raise _make_missing_scale_error("index", error, path) from error


def _read_header_scale(
    path: Path, read_scale: Callable[[bytes, str], HeightScale | None], channel: str
) -> HeightScale | None:
    """Read the height scale from the header of a file; damage is an error of ours."""
    try:
        with path.open("rb") as file:
            return read_scale(file.read(_HEADER_BYTES), channel)
    except _DAMAGED as error:
        raise _make_missing_scale_error("header", error, path) from error


def _make_missing_scale_error(part_name: str, cause: Exception, path: Path) -> MetrologyError:
    """Make the error of a part of a file that does not state its height scale."""
    reason = getattr(cause, "strerror", None) or cause
    return MetrologyError(f"{part_name} must state the height scale, got {reason} [{path.name}]")


def check_heights_against_scale(
    heights: NDArray[np.float64],
    stated_scale: HeightScale,
    place: str,
    used_count_height: float | None = None,
) -> str:
    """Compare heights with the scale that their file states.

    Parameters
    ----------
    heights : array
        Heights as a reader gives them, nan where nothing was measured [m].
    stated_scale : HeightScale
        What the file states.
    place : str
        Name of the file, for messages.
    used_count_height : float, optional
        Height of one count, or of the stored number 1, by which the reader multiplied [m].

    Returns
    -------
    str
        What was checked.

    Raises
    ------
    MetrologyError
        If the reader used another scale, or the heights cannot come from this one.
    """
    _check_used_scale(stated_scale, place, used_count_height)
    measured = heights[np.isfinite(heights)]
    _check_height_range(measured, stated_scale, place)
    if not stated_scale.integral:
        return f"{stated_scale.field}: {stated_scale.count:.6g} m, checked"
    counts = (measured[:_CHECKED_HEIGHTS] - measured[0]) / stated_scale.count
    off = np.max(np.abs(counts - np.rint(counts)))
    # float32 counts above 2^24 and offsets cost digits; a wrong factor misses by far more
    allowed = _WHOLE_COUNT + _FLOAT32_COUNT * float(np.max(np.abs(counts)))
    if not off <= allowed:
        raise MetrologyError(
            f"heights must be multiples of {stated_scale.count:g} m ({stated_scale.field}) "
            f"[{place}]"
        )
    return f"{stated_scale.field}: {stated_scale.count:.6g} m per count, checked"


def _check_used_scale(
    stated_scale: HeightScale, place: str, used_count_height: float | None
) -> None:
    """Refuse a reader that used another scale [m] than its file states."""
    if used_count_height is None:
        if stated_scale.integral:
            return
        raise MetrologyError(
            f"reader must state its scale for {stated_scale.field}, got nothing [{place}]"
        )
    if abs(abs(used_count_height) / stated_scale.count - 1.0) > _SAME_SCALE:
        raise MetrologyError(
            f"reader must use {stated_scale.count:g} m per count ({stated_scale.field}), got "
            f"{used_count_height:g} m [{place}]"
        )


def _check_height_range(
    measured_heights: NDArray[np.float64], stated_scale: HeightScale, place: str
) -> None:
    """Refuse heights [m] outside of the range that the file can hold."""
    if not measured_heights.size:
        return
    if stated_scale.integral:
        slack = _SLACK_COUNTS * stated_scale.count
    else:
        ends = [abs(end) for end in (stated_scale.lowest, stated_scale.highest) if np.isfinite(end)]
        slack = _SAME_SCALE * max(ends, default=0.0)
    lowest = measured_heights.min()
    highest = measured_heights.max()
    if lowest < stated_scale.lowest - slack or highest > stated_scale.highest + slack:
        raise MetrologyError(
            f"heights must lie within {stated_scale.lowest:g} to {stated_scale.highest:g} m "
            f"({stated_scale.field}), "
            f"got {lowest:g} to {highest:g} m [{place}]"
        )


def _read_nid_scale(head: bytes, channel: str) -> HeightScale:
    """Read the header of Nanosurf, where each channel has a section.

    A section states Frame, Dim2Name, Dim2Unit, Dim2Range, Dim2Min and SaveBits.
    """
    for section in head.decode("latin-1").split("\r\n["):
        fields = _parse_equals_lines(section)
        if "Dim2Range" not in fields:
            continue
        if channel and _format_nid_channel_name(fields) != channel:
            continue
        unit = fields["Dim2Unit"].strip()
        if unit not in UNITS_PER_METRE:
            continue
        span = float(fields["Dim2Range"]) / UNITS_PER_METRE[unit]
        lowest = float(fields["Dim2Min"]) / UNITS_PER_METRE[unit]
        count = span / 2 ** int(fields["SaveBits"])
        # readers keep or drop the offset of the range, which a step height does not see
        reach = max(abs(lowest), abs(lowest + span))
        return HeightScale(count, -reach, reach, "Dim2Range / 2^SaveBits")
    raise ValueError("no channel in units of length")


def _format_nid_channel_name(fields: dict[str, str]) -> str:
    """Return the name of a channel of Nanosurf, such as ``Scan forward (Z-Axis)``."""
    return f"{fields.get('Frame', '').strip()} ({fields.get('Dim2Name', '').strip()})"


def _parse_equals_lines(text: str) -> dict[str, str]:
    """Read lines of the form ``name=value``."""
    fields = {}
    for line in text.splitlines():
        name, equals, value = line.partition("=")
        if equals:
            fields[name] = value
    return fields


def _read_sur_scale(head: bytes, channel: str) -> HeightScale | None:
    """Read the header of Digital Surf.

    Limits in counts stand at byte 100, the Z spacing as float32 at 128, its unit as text at 212.
    """
    if head[:12] not in (b"DIGITAL SURF", b"DSCOMPRESSED"):
        return None
    lowest, highest = struct.unpack_from("<ii", head, 100)
    (spacing,) = struct.unpack_from("<f", head, 128)
    unit = _decode_unit_name(head[212:228].split(b"\0")[0])
    count = float(spacing) / UNITS_PER_METRE[unit]
    reach = (max(abs(lowest), abs(highest)) + _SLACK_COUNTS) * count
    return HeightScale(count, -reach, reach, "Z spacing of the header")


def _decode_unit_name(encoded_name: bytes) -> str:
    """Decode the name of a unit, with a micro sign in UTF-8, Latin-1 or code page 850."""
    try:
        return encoded_name.decode("utf-8").strip()
    except UnicodeDecodeError:
        return encoded_name.decode("latin-1").strip().replace("æ", "µ")


def _read_sdf_scale(head: bytes, channel: str) -> HeightScale | None:
    """Read the header of ISO 25178-71, binary or text: Zscale is metres per count.

    Floating types have no counts.
    """
    if head[:8] == b"bISO-1.0":
        (count,) = struct.unpack_from("<d", head, 62)
        data_type = head[79]
    elif head[:8] == b"aISO-1.0":
        text = head.split(b"*", 1)[0].decode("latin-1")
        fields = {name.strip(): value.strip() for name, value in _parse_equals_lines(text).items()}
        count = float(fields["Zscale"])
        data_type = int(fields["DataType"])
    else:
        return None
    if data_type in _SDF_FLOATING_TYPES:
        return None
    reach = _SDF_MOST_COUNT * count
    return HeightScale(count, -reach, reach, "Zscale of the header")


def _read_opdx_scale(head: bytes, channel: str) -> HeightScale:
    """Read the quantity DataScale of Dektak.

    Its value stands as float64, then name and symbol of its unit, each behind its length.
    """
    mark = struct.pack("<I", 9) + b"DataScale\x13"
    found = head.find(mark)
    if found < 0:
        raise ValueError("no DataScale")
    position = found + len(mark)
    position += 1 + head[position]  # the length of the item, in as many bytes as its first says
    value, name_length = struct.unpack_from("<dI", head, position)
    position += 12 + name_length
    (symbol_length,) = struct.unpack_from("<I", head, position)
    position += 4
    end = position + min(symbol_length, _OPDX_MOST_UNIT_BYTES)
    unit = head[position:end].decode("utf-8").strip()
    count = value / UNITS_PER_METRE[unit]
    return HeightScale(count, -np.inf, np.inf, "DataScale of the channel", integral=False)


def _read_x3p_scale(archive: zipfile.ZipFile) -> HeightScale:
    """Read ``Axes/CZ`` of ISO 25178-72, which states type and increment.

    Heights in metres are the stored number times the increment.
    """
    index = _parse_xml_member(archive, "main.xml")
    axis = index.find("Record1/Axes/CZ")
    if axis is None:
        raise ValueError("no Record1/Axes/CZ")
    fields = {child.tag: (child.text or "").strip() for child in axis}
    increment = float(fields.get("Increment") or 1.0)
    offset = float(fields.get("Offset") or 0.0)
    number_type = _X3P_TYPES[fields["DataType"]]
    lowest = -np.inf
    highest = np.inf
    link = index.find("Record3/DataLink/PointDataLink")
    grid = index.find("Record3/MatrixDimension")
    # without a link, the points stand in the index as text
    if link is not None and link.text and grid is not None:
        stored = _compute_stored_range(archive, link.text.strip(), number_type)
        lowest, highest = sorted(increment * end for end in stored)
        # readers keep or drop the offset of the axis, which a step height does not see
        lowest += min(offset, 0.0)
        highest += max(offset, 0.0)
    is_integral = "i" in number_type
    return HeightScale(abs(increment), lowest, highest, "Increment of CZ", integral=is_integral)


def _read_plux_scale(archive: zipfile.ZipFile) -> HeightScale:
    """Read the index of Sensofar: a layer is float32 in micrometres, of so many points."""
    index = _parse_xml_member(archive, "index.xml")
    name = _get_required_text(index, "LAYER_0/FILENAME_Z")
    columns = int(_get_required_text(index, "GENERAL/IMAGE_SIZE_X"))
    rows = int(_get_required_text(index, "GENERAL/IMAGE_SIZE_Y"))
    points = columns * rows
    size = archive.getinfo(name).file_size
    if size != 4 * points:
        raise ValueError(f"{size} bytes in {name} for {points} points")
    lowest, highest = _compute_stored_range(archive, name, "<f4")
    return HeightScale(
        _MICROMETRE,
        lowest * _MICROMETRE,
        highest * _MICROMETRE,
        f"numbers of {name}, um by the format",
        integral=False,
    )


def _parse_xml_member(archive: zipfile.ZipFile, member_name: str) -> ElementTree.Element:
    """Parse an XML file of an archive; refuse a large one and one with a document type."""
    if archive.getinfo(member_name).file_size > _MOST_INDEX_BYTES:
        raise ValueError(f"{member_name} of more than {_MOST_INDEX_BYTES >> 20} MiB")
    text = archive.read(member_name)
    # entities may grow without bound
    if b"<!" in text.replace(b"<!--", b"").replace(b"<![CDATA[", b""):
        raise ValueError(f"a document type in {member_name}")
    return ElementTree.fromstring(text)


def _get_required_text(index_root: ElementTree.Element, element_path: str) -> str:
    """Return the text of an element; refuse an index without it."""
    text = index_root.findtext(element_path)
    if text is None:
        raise ValueError(f"no {element_path}")
    return text.strip()


def _compute_stored_range(
    archive: zipfile.ZipFile, member_name: str, number_type: str
) -> tuple[float, float]:
    """Return the least and the greatest stored number of an archive member, read in chunks."""
    lowest = np.inf
    highest = -np.inf
    with archive.open(member_name) as file:
        while chunk := file.read(_CHUNK_BYTES):
            values = np.frombuffer(chunk, dtype=number_type)
            finite = values[np.isfinite(values)]
            if finite.size:
                lowest = min(lowest, float(finite.min()))
                highest = max(highest, float(finite.max()))
    if lowest > highest:
        raise ValueError(f"no number in {member_name}")
    return lowest, highest


_HEADERS: dict[str, Callable[[bytes, str], HeightScale | None]] = {
    "ezd": _read_nid_scale,
    "sur": _read_sur_scale,
    "sdf": _read_sdf_scale,
    "opdx": _read_opdx_scale,
}
_ARCHIVES = {"x3p": _read_x3p_scale, "plux": _read_plux_scale}
