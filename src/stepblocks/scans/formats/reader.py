"""What a reader of scans is: subclass `ScanReader`, and name the class in `formats.READERS`.

The shortest example is `stepblocks.scans.formats.sdf`.
"""

import zipfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.scans.height_scale import HeightScale, read_height_scale
from stepblocks.scans.scan import HeightMap, ScannedProfile

_MOST_POINTS = 64_000_000
_MOST_MEMBERS = 10_000  # of an archive
MOST_UNPACKED_BYTES = 2**30


@dataclass(frozen=True)
class ReadOptions:
    """What a user says of a file beside its name.

    Attributes
    ----------
    unit : str or None
        Units of a file that states none, as `stepblocks.scans.units.parse_units` reads them.
    channel : str or None
        Name of the channel of heights, or a part of it.
    layout : TableLayout
        How a text is written; readers of other formats are not asked with one.
    """

    unit: str | None = None
    channel: str | None = None
    layout: TableLayout = UNDECLARED


@dataclass(frozen=True)
class LoadedScan:
    """A scan, and the name of the channel that it came from where the file has several."""

    scan: ScannedProfile | HeightMap
    channel: str = ""


class ScanReader(ABC):
    """Reader of one format of files.

    Attributes
    ----------
    form : str
        Name of the format.
    endings : tuple of str
        Endings of file names, lower-case with the dot; of several readers with the same ending the
        first that claims a file reads it.
    signatures : tuple of bytes
        First four bytes of its files, where endings say little; they outweigh the ending.
    is_confined : bool
        Whether foreign code parses the bytes, in the process with a limit on memory and time.
    takes_unit : bool
        Whether the files state no units, so that the user may.
    has_channels : bool
        Whether a file may hold several channels.
    has_header : bool
        Whether heights come from counts whose scale a header states.
    """

    form: str
    endings: tuple[str, ...] = ()
    signatures: tuple[bytes, ...] = ()
    is_confined = True
    takes_unit = False
    has_channels = False
    has_header = True

    def claims(self, path: Path) -> bool:
        """Tell whether the content of a file with a fitting ending is of this format."""
        return True

    @abstractmethod
    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read a scan: heights and positions [m].

        `count` of the scan is the height of one count, or of the stored number 1 [m]: the factor
        by which stored numbers were multiplied, which is compared with the header.
        """

    def list_channels(self, path: Path) -> list[str]:
        """List name and unit of each channel, as `ReadOptions.channel` takes them."""
        return []

    def read_height_scale(self, path: Path, channel: str) -> HeightScale | None:
        """Read what the file itself says of the heights of a channel, apart from `read`."""
        return read_height_scale(path, self.form, channel)


def check_point_count(shape: Sequence[int], place: str) -> None:
    """Refuse a scan of more points than memory is meant to hold."""
    if int(np.prod(shape)) > _MOST_POINTS:
        raise MetrologyError(f"scan must have at most {_MOST_POINTS} points, got {shape} [{place}]")


def check_unpacked_size(path: Path) -> None:
    """Refuse a zip bomb by its directory, before anything is unpacked."""
    with zipfile.ZipFile(path) as archive:
        sizes = [entry.file_size for entry in archive.infolist()]
    total = sum(sizes)
    if total > MOST_UNPACKED_BYTES or len(sizes) > _MOST_MEMBERS:
        raise MetrologyError(
            f"archive must unpack to at most {MOST_UNPACKED_BYTES >> 20} MiB in {_MOST_MEMBERS} "
            f"files, got {total >> 20} MiB in {len(sizes)} [{path.name}]"
        )
