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


class DigitalSurfReader(SurfaceTopographyReader):
    """SurfaceTopography reads the plain files; compressed ones are unpacked for it."""

    def __init__(self) -> None:
        super().__init__("sur", (".sur",))

    def prepare(self, path: Path) -> str | io.BytesIO:
        """Unpack a compressed file."""
        raw = path.read_bytes()
        if not raw.startswith(_COMPRESSED):
            return str(path)
        return io.BytesIO(_unpack(raw, path.name))


def _unpack(raw: bytes, place: str) -> bytes:
    """Make a plain file of a compressed one.

    Behind 512 bytes of header and the comments stands a directory of deflated pieces: their number,
    then size and packed size of each.
    """
    comment_bytes = sum(struct.unpack_from("<HH", raw, 334))
    directory = _HEADER_BYTES + comment_bytes
    (pieces,) = struct.unpack_from("<I", raw, directory)
    sizes = []
    for piece in range(min(pieces, _MOST_PIECES)):
        size, packed_size = struct.unpack_from("<II", raw, directory + 4 + 8 * piece)
        sizes.append((size, packed_size))
    if sum(size for size, _ in sizes) > MOST_UNPACKED_BYTES:
        raise MetrologyError(
            f"file must unpack to at most {MOST_UNPACKED_BYTES >> 20} MiB [{place}]"
        )
    parts = [_PLAIN, raw[len(_PLAIN) : directory]]
    begin = directory + 4 + 8 * len(sizes)
    for size, packed_size in sizes:
        end = begin + packed_size
        heights = zlib.decompressobj().decompress(raw[begin:end], size)
        if len(heights) != size:
            raise MetrologyError(
                f"piece of compressed heights must unpack to {size} bytes, got {len(heights)} "
                f"[{place}]"
            )
        parts.append(heights)
        begin = end
    return b"".join(parts)
