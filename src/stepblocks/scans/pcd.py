"""Points of PCD files, the format of the Point Cloud Library, version 0.7.

A header of lines, then rows in text, in binary, or compressed by LZF field by field
(https://pointclouds.org/documentation/tutorials/pcd_file_format.html).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.scan import Array

_MOST_POINTS = 64_000_000
_MOST_HEADER_BYTES = 65536
_MOST_FIELDS = 100
_LENGTHS_BYTES = 8  # of both sizes that stand before compressed rows
_TYPES = {"I": "i", "U": "u", "F": "f"}
_SIZES = {"I": (1, 2, 4, 8), "U": (1, 2, 4, 8), "F": (4, 8)}
_AXES = ("x", "y", "z")
_SHORTEST_COPY = 2  # bytes that a reference of LZF copies at least, less the stated count
_LONG_COPY = 7  # count that says that a byte with more follows
_LITERALS = 32  # control bytes below begin so many literal bytes, less one


@dataclass(frozen=True)
class _Header:
    """What the header of a file says.

    Attributes
    ----------
    record : numpy.dtype
        Of one point; fields that are no position have names of their own.
    points : int
        How many.
    form : str
        ``"ascii"``, ``"binary"`` or ``"binary_compressed"``.
    end : int
        Where the rows begin [bytes].
    """

    record: np.dtype[np.void]
    points: int
    form: str
    end: int


def read_pcd_points(path: Path) -> Array:
    """Read the positions of the points of a file, in its unit, shape (n, 3).

    Points that were not measured (NaN) are left out.

    Raises
    ------
    MetrologyError
        If the header says something impossible, or the rows are not what it says.
    """
    content = path.read_bytes()
    header = _read_header(content, path.name)
    if header.form == "ascii":
        rows = _read_text_rows(content[header.end :], header, path.name)
    elif header.form == "binary":
        rows = _read_binary_rows(content[header.end :], header, path.name)
    else:
        rows = _unpack_compressed_rows(content[header.end :], header, path.name)
    points = np.stack([rows[axis].astype(np.float64) for axis in _AXES], axis=1)
    return points[np.isfinite(points).all(axis=1)]


def _read_header(content: bytes, file_name: str) -> _Header:
    """Read the lines up to that of DATA."""
    entries: dict[str, list[str]] = {}
    end = 0
    while "DATA" not in entries:
        line_end = content.find(b"\n", end, _MOST_HEADER_BYTES)
        if line_end < 0:
            raise MetrologyError(
                f"a PCD file must have a line DATA in its header, got none [{file_name}]"
            )
        words = content[end:line_end].decode("ascii", errors="replace").split()
        end = line_end + 1
        if words and not words[0].startswith("#"):
            entries[words[0]] = words[1:]
    form = " ".join(entries["DATA"])
    if form not in ("ascii", "binary", "binary_compressed"):
        raise MetrologyError(
            f"DATA must be ascii, binary or binary_compressed, got {form!r} [{file_name}]"
        )
    record = _make_point_dtype(entries, file_name)
    points = _read_point_count(entries, file_name)
    return _Header(record, points, form, end)


def _make_point_dtype(entries: Mapping[str, list[str]], file_name: str) -> np.dtype[np.void]:
    """Make the type of a point of the lines FIELDS, SIZE, TYPE and COUNT."""
    fields = entries.get("FIELDS", [])
    sizes = entries.get("SIZE", [])
    types = entries.get("TYPE", [])
    counts = entries.get("COUNT", ["1"] * len(fields))
    lengths = {len(fields), len(sizes), len(types), len(counts)}
    if len(lengths) != 1 or not 0 < len(fields) <= _MOST_FIELDS:
        raise MetrologyError(
            f"FIELDS, SIZE, TYPE and COUNT must have 1 to {_MOST_FIELDS} entries each, got "
            f"{len(fields)}, {len(sizes)}, {len(types)} and {len(counts)} [{file_name}]"
        )
    for axis in _AXES:
        if fields.count(axis) != 1:
            raise MetrologyError(
                f"FIELDS must have {axis} once, got {' '.join(fields)} [{file_name}]"
            )
    members: list[tuple[str, str, tuple[int, ...]]] = []
    for number, field in enumerate(fields):
        kind, size, count = types[number], sizes[number], counts[number]
        is_known = kind in _TYPES and size.isdecimal() and int(size) in _SIZES[kind]
        if not is_known or not count.isdecimal() or not 0 < int(count) <= 65536:
            raise MetrologyError(
                f"field {field} must be I, U or F of 1 to 8 bytes, got {kind} {size} {count} "
                f"[{file_name}]"
            )
        if field in _AXES:
            if count != "1":
                raise MetrologyError(f"field {field} must have COUNT 1, got {count} [{file_name}]")
            members.append((field, f"<{_TYPES[kind]}{size}", ()))
        else:
            members.append((f"field {number}", f"<{_TYPES[kind]}{size}", (int(count),)))
    return np.dtype(members)


def _read_point_count(entries: Mapping[str, list[str]], file_name: str) -> int:
    """Read how many points there are, which WIDTH, HEIGHT and POINTS say alike."""
    numbers = {}
    for key in ("WIDTH", "HEIGHT", "POINTS"):
        text = " ".join(entries.get(key, []))
        if key == "POINTS" and not text:
            continue
        if not text.isdecimal() or len(text) > 9:
            raise MetrologyError(f"{key} must be a whole number, got {text!r} [{file_name}]")
        numbers[key] = int(text)
    points = numbers["WIDTH"] * numbers["HEIGHT"]
    if numbers.get("POINTS", points) != points or points > _MOST_POINTS:
        raise MetrologyError(
            f"POINTS must be WIDTH times HEIGHT and at most {_MOST_POINTS}, got "
            f"{numbers.get('POINTS', points)} and {points} [{file_name}]"
        )
    return points


def _read_text_rows(content: bytes, header: _Header, file_name: str) -> dict[str, Array]:
    """Read rows of text, a point in each line."""
    columns = {}
    place = 0
    for field in header.record.names or ():
        columns[field] = place
        place += int(np.prod(header.record[field].shape, dtype=int))
    lines = []
    for line in content.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words:
            lines.append(words)
    if len(lines) != header.points:
        raise MetrologyError(
            f"rows must be as many as the {header.points} POINTS, got {len(lines)} [{file_name}]"
        )
    positions: dict[str, list[float]] = {axis: [] for axis in _AXES}
    for number, words in enumerate(lines, start=1):
        if len(words) != place:
            raise MetrologyError(
                f"a row must have {place} numbers, got {len(words)} [{file_name}, point {number}]"
            )
        for axis in _AXES:
            text = words[columns[axis]]
            try:
                positions[axis].append(float(text))
            except ValueError as error:
                raise MetrologyError(
                    f"{axis} must be a number, got {text!r:.40} [{file_name}, point {number}]"
                ) from error
    return {axis: np.array(values) for axis, values in positions.items()}


def _read_binary_rows(content: bytes, header: _Header, file_name: str) -> dict[str, Array]:
    """Take rows of binary, one point after the other."""
    wanted = header.points * header.record.itemsize
    if len(content) != wanted:
        raise MetrologyError(
            f"rows must have {wanted} bytes as the header says, got {len(content)} [{file_name}]"
        )
    rows = np.frombuffer(content, header.record)
    return {axis: rows[axis] for axis in _AXES}


def _unpack_compressed_rows(content: bytes, header: _Header, file_name: str) -> dict[str, Array]:
    """Unpack compressed rows: both sizes, then each field of all points after the other."""
    wanted = header.points * header.record.itemsize
    sizes = np.frombuffer(content[:_LENGTHS_BYTES], "<u4")
    packed = content[_LENGTHS_BYTES:]
    if len(sizes) != 2 or int(sizes[1]) != wanted or int(sizes[0]) > len(packed):
        raise MetrologyError(
            f"compressed rows must have {wanted} bytes as the header says, got sizes "
            f"{sizes.tolist()} and {len(packed)} bytes [{file_name}]"
        )
    raw = unpack_lzf(packed[: int(sizes[0])], wanted, file_name)
    columns = {}
    start = 0
    for field in header.record.names or ():
        kind = header.record[field]
        end = start + header.points * kind.itemsize
        if field in _AXES:
            columns[field] = np.frombuffer(raw[start:end], kind)
        start = end
    return columns


def unpack_lzf(packed: bytes, unpacked_size: int, file_name: str) -> bytes:
    """Unpack the LZF of Marc Lehmann's liblzf to so many bytes.

    Raises
    ------
    MetrologyError
        If it is broken, or unpacks to another size.
    """
    unpacked = bytearray()
    place = 0
    try:
        while place < len(packed) and len(unpacked) <= unpacked_size:
            control = packed[place]
            place += 1
            if control < _LITERALS:
                unpacked += packed[place : place + control + 1]
                place += control + 1
                continue
            length = control >> 5
            if length == _LONG_COPY:
                length += packed[place]
                place += 1
            distance = ((control & 0x1F) << 8 | packed[place]) + 1
            place += 1
            _append_earlier_bytes(unpacked, distance, length + _SHORTEST_COPY)
    except IndexError as error:
        raise MetrologyError(f"compressed rows are broken [{file_name}]") from error
    if len(unpacked) != unpacked_size:
        raise MetrologyError(
            f"compressed rows must unpack to {unpacked_size} bytes, got {len(unpacked)} "
            f"[{file_name}]"
        )
    return bytes(unpacked)


def _append_earlier_bytes(unpacked: bytearray, distance: int, byte_count: int) -> None:
    """Append bytes that stand a distance before the end; where they overlap it they repeat."""
    start = len(unpacked) - distance
    if start < 0:
        raise IndexError
    pattern = unpacked[start:]
    while len(pattern) < byte_count:
        pattern *= 2
    unpacked += pattern[:byte_count]
