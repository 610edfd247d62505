"""Tables of numbers as text."""

from pathlib import Path

from stepblocks.scans.formats.reader import LoadedScan, ReadOptions, ScanReader
from stepblocks.scans.text import read_text_scan

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".xyz", ".asc", ".dat")


class TextReader(ScanReader):
    """Columns of positions and heights."""

    form = "text"
    endings = TEXT_ENDINGS
    is_confined = False  # nobody else's code parses them
    takes_unit = True
    has_header = False

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read a profile, a grid of points or a matrix."""
        return LoadedScan(read_text_scan(path, request.unit, request.channel, request.layout))
