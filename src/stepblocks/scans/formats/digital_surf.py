"""Digital Surf (SUR), plain and compressed."""

import io
import struct
import zlib
from pathlib import Path

from stepblocks.errors import MetrologyError
from stepblocks.scans.formats.reader import MOST_UNPACKED_BYTES
from stepblocks.scans.formats.surface_topography import SurfaceTopographyReader

_PLAIN = b"DIGITAL SURF"
_COMPRESSED = b"DSCOMPRESSED"
_HEADER_BYTES = 512
_MOST_PIECES = 4096
_UNITS = slice(132 + 3 * 16, 132 + 9 * 16)  # six names of units in the header, 16 bytes each
_UNIT_BYTES = 16


class DigitalSurfReader(SurfaceTopographyReader):
    """SurfaceTopography reads plain files with units in Latin-1; others are rewritten for it."""

    def __init__(self) -> None:
        super().__init__("sur", (".sur",))

    def prepare_input(self, path: Path) -> str | io.BytesIO:
        """Unpack a compressed file, and write its units as the format has them."""
        raw = path.read_bytes()
        if raw.startswith(_COMPRESSED):
            raw = _decompress_file(raw, path.name)
        return io.BytesIO(_rewrite_units_in_latin1(raw))


def _rewrite_units_in_latin1(file_bytes: bytes) -> bytes:
    """Write units in UTF-8, as some programs do, in the Latin-1 of the format."""
    units = file_bytes[_UNITS]
    rewritten = b""
    for begin in range(0, len(units), _UNIT_BYTES):
        name = units[begin : begin + _UNIT_BYTES].split(b"\0")[0]
        rewritten += _encode_unit_in_latin1(name).ljust(_UNIT_BYTES, b"\0")
    return file_bytes[: _UNITS.start] + rewritten + file_bytes[_UNITS.stop :]


def _encode_unit_in_latin1(unit_name: bytes) -> bytes:
    """Return the name of a unit in Latin-1, whichever micro sign and encoding it has."""
    try:
        text = unit_name.decode("utf-8")
    except UnicodeDecodeError:
        return unit_name
    return text.replace("μ", "µ").encode("latin-1", "replace")


def _decompress_file(file_bytes: bytes, place: str) -> bytes:
    """Decompress a file into one of the plain form.

    Behind 512 bytes of header and the comments stands a directory of deflated pieces: their number,
    then size and packed size of each.
    """
    comment_bytes = sum(struct.unpack_from("<HH", file_bytes, 334))
    directory = _HEADER_BYTES + comment_bytes
    (pieces,) = struct.unpack_from("<I", file_bytes, directory)
    sizes = []
    for piece in range(min(pieces, _MOST_PIECES)):
        size, packed_size = struct.unpack_from("<II", file_bytes, directory + 4 + 8 * piece)
        sizes.append((size, packed_size))
    if sum(size for size, _ in sizes) > MOST_UNPACKED_BYTES:
        raise MetrologyError(
            f"file must unpack to at most {MOST_UNPACKED_BYTES >> 20} MiB [{place}]"
        )
    parts = [_PLAIN, file_bytes[len(_PLAIN) : directory]]
    begin = directory + 4 + 8 * len(sizes)
    for size, packed_size in sizes:
        end = begin + packed_size
        heights = zlib.decompressobj().decompress(file_bytes[begin:end], size)
        if len(heights) != size:
            raise MetrologyError(
                f"piece of compressed heights must unpack to {size} bytes, got {len(heights)} "
                f"[{place}]"
            )
        parts.append(heights)
        begin = end
    return b"".join(parts)
