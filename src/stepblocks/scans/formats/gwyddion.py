"""Gwyddion (GWY), also with fields that state no unit.

SurfaceTopography leaves out fields whose unit is no length. A field that states none is given the
metre here, before the library reads it, and the user's unit afterwards. The layout is that of
https://gwyddion.net/documentation/user-guide-en/gwyfile-format.html.
"""

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from stepblocks.scans.formats.surface_topography import SurfaceTopographyReader

if TYPE_CHECKING:
    from SurfaceTopography.IO.Reader import ChannelInfo

_MARK = b"GWYP"
_FIELD = b"GwyDataField"
_UNIT_NAMES = {"xy": b"si_unit_xy", "z": b"si_unit_z"}
_AXES = {"xy": ("x", "y"), "z": ("z",)}
_ITEM_BYTES = {b"b": 1, b"c": 1, b"i": 4, b"q": 8, b"d": 8}  # of one number
_ARRAY_BYTES = {b"C": 1, b"I": 4, b"Q": 8, b"D": 8}  # of one number of an array
_METRE = b"GwySIUnit\0" + struct.pack("<I", 11) + b"unitstr\0sm\0"


class _Item(NamedTuple):
    """A named value in an object, its bytes as they stand in the file."""

    name: bytes
    kind: bytes  # one letter
    payload: bytes


@dataclass(frozen=True)
class _FilledFile:
    """A file whose fields all state a unit, and which of them did not before."""

    content: bytes
    unstated: dict[int, frozenset[str]]  # axes by the number of the field


class GwyddionReader(SurfaceTopographyReader):
    """The fields of a container."""

    def __init__(self) -> None:
        super().__init__("gwy", (".gwy",))

    def prepare_input(self, path: Path) -> str | io.BytesIO:
        """Give the metre to fields that state no unit."""
        filled = _fill_unstated_units(path)
        if not filled.unstated:
            return str(path)
        return io.BytesIO(filled.content)

    def find_unstated_axes(self, path: Path, channel: "ChannelInfo") -> frozenset[str]:
        """Find the axes of a field for which the file states no unit."""
        return _fill_unstated_units(path).unstated.get(channel.tags["index"], frozenset())


def _fill_unstated_units(path: Path) -> _FilledFile:
    """Read a file and state metres wherever a field states no unit."""
    raw = path.read_bytes()
    if not raw.startswith(_MARK):
        raise ValueError("no GWYP at its begin")
    name, body, _ = _read_object_at(raw, len(_MARK))
    items = []
    unstated: dict[int, frozenset[str]] = {}
    for item in _iterate_items(body):
        number = _parse_field_number(item)
        if number is None:
            items.append(item)
            continue
        axes, filled = _fill_units_of_field(item)
        items.append(filled)
        if axes:
            unstated[number] = axes
    return _FilledFile(_MARK + _encode_object(name, items), unstated)


def _parse_field_number(item: _Item) -> int | None:
    """Return the number of a field of heights, from a name such as ``/0/data``; else None."""
    parts = item.name.split(b"/")
    is_field = len(parts) == 3 and parts[0] == b"" and parts[2] == b"data"
    if item.kind != b"o" or not is_field or not parts[1].isdigit():
        return None
    return int(parts[1])


def _fill_units_of_field(item: _Item) -> tuple[frozenset[str], _Item]:
    """State metres in a field; return the axes for which it states no unit, and the field."""
    name, body, _ = _read_object_at(item.payload, 0)
    if name != _FIELD:
        return frozenset(), item
    items = list(_iterate_items(body))
    axes: set[str] = set()
    for which, unit_name in _UNIT_NAMES.items():
        stated = [entry for entry in items if entry.name == unit_name]
        if stated and _get_stated_unit(stated[0]):
            continue
        axes.update(_AXES[which])
        items = [entry for entry in items if entry.name != unit_name]
        items.append(_Item(unit_name, b"o", _METRE))
    return frozenset(axes), item._replace(payload=_encode_object(name, items))


def _get_stated_unit(item: _Item) -> bytes:
    """Return the unit that an object of units states, empty where it states none."""
    if item.kind != b"o":
        return b""
    _, body, _ = _read_object_at(item.payload, 0)
    for entry in _iterate_items(body):
        if entry.name == b"unitstr" and entry.kind == b"s":
            return entry.payload.rstrip(b"\0").strip()
    return b""


def _iterate_items(object_bytes: bytes) -> Iterator[_Item]:
    """Yield the items of an object."""
    begin = 0
    while begin < len(object_bytes):
        name, begin = _read_name_at(object_bytes, begin)
        kind = object_bytes[begin : begin + 1]
        end = _find_value_end(object_bytes, begin + 1, kind)
        if end > len(object_bytes):
            raise _make_truncation_error()
        yield _Item(name, kind, object_bytes[begin + 1 : end])
        begin = end


def _find_value_end(body: bytes, value_begin: int, kind: bytes) -> int:
    """Find where a value that begins at a byte ends."""
    if kind in _ITEM_BYTES:
        return value_begin + _ITEM_BYTES[kind]
    if kind == b"s":
        return _read_name_at(body, value_begin)[1]
    if kind == b"o":
        return _read_object_at(body, value_begin)[2]
    count = _read_size_at(body, value_begin)
    end = value_begin + 4
    if kind in _ARRAY_BYTES:
        return end + count * _ARRAY_BYTES[kind]
    if kind not in (b"S", b"O"):
        raise ValueError(f"a value of the kind {kind!r}")
    for _ in range(count):
        item_kind = kind.lower()
        end = _find_value_end(body, end, item_kind)
    return end


def _read_object_at(body: bytes, object_begin: int) -> tuple[bytes, bytes, int]:
    """Return name and content of an object that begins at a byte, and where it ends."""
    name, object_begin = _read_name_at(body, object_begin)
    size = _read_size_at(body, object_begin)
    end = object_begin + 4 + size
    if end > len(body):
        raise _make_truncation_error()
    return name, body[object_begin + 4 : end], end


def _read_name_at(body: bytes, name_begin: int) -> tuple[bytes, int]:
    """Return a text that ends in a zero, and where the next byte stands."""
    end = body.find(b"\0", name_begin)
    if end < 0:
        raise _make_truncation_error()
    return body[name_begin:end], end + 1


def _read_size_at(body: bytes, size_begin: int) -> int:
    """Read a 32-bit size at a byte; refuse a file that is cut short."""
    if size_begin + 4 > len(body):
        raise _make_truncation_error()
    return int(struct.unpack_from("<I", body, size_begin)[0])


def _make_truncation_error() -> ValueError:
    """Make the error of a file that is cut short."""
    return ValueError("a file that is cut short")


def _encode_object(name: bytes, items: list[_Item]) -> bytes:
    """Write an object with its items."""
    parts = [item.name + b"\0" + item.kind + item.payload for item in items]
    body = b"".join(parts)
    return name + b"\0" + struct.pack("<I", len(body)) + body
