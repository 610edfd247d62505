"""TrueMap (TMD)."""

import io
from pathlib import Path

from stepblocks.scans.formats.surface_topography import SurfaceTopographyReader

_HEAD_BYTES = 32
_COMMENT_BYTES = 24  # that SurfaceTopography expects, with the zero at its end


class TrueMapReader(SurfaceTopographyReader):
    """A map behind a comment of any length."""

    def __init__(self) -> None:
        super().__init__("tmd", (".tmd",))

    def prepare_input(self, path: Path) -> str | io.BytesIO:
        """Make the comment as long as SurfaceTopography takes it to be."""
        raw = path.read_bytes()
        comment, _, content = raw[_HEAD_BYTES:].partition(b"\0")
        padded = comment[: _COMMENT_BYTES - 1].ljust(_COMMENT_BYTES, b"\0")
        return io.BytesIO(raw[:_HEAD_BYTES] + padded + content)
