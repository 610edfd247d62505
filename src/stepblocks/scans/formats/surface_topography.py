"""The formats of instruments that SurfaceTopography reads."""

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.formats.reader import ReadScan, ScanReader, ScanRequest, check_points
from stepblocks.scans.formats.text import TEXT_ENDINGS
from stepblocks.scans.scan import Array, HeightMap, ScannedProfile
from stepblocks.scans.text import holds_matrix
from stepblocks.scans.units import UNITS_PER_METRE

if TYPE_CHECKING:
    from SurfaceTopography.IO.Reader import ChannelInfo, ReaderBase

# A channel that the library takes for heights by its unit, and whose name says otherwise
_NO_HEIGHT = re.compile(
    r"(?i)deflection|amplitude|phase|error|friction|adhesion|current|potential|lateral|user"
)


class SurfaceTopographyReader(ScanReader):
    """A format by the name under which SurfaceTopography knows it.

    Parameters
    ----------
    form : str
        That name.
    endings, signatures
        As for `ScanReader`.
    """

    has_channels = True

    def __init__(
        self, form: str, endings: tuple[str, ...] = (), signatures: tuple[bytes, ...] = ()
    ) -> None:
        self.form = form
        self.endings = endings
        self.signatures = signatures

    def prepare(self, path: Path) -> str | io.BytesIO:
        """Return what the library is given: the path, or a file that it understands better."""
        return str(path)

    def remove_missing(self, stored: Array, channel: "ChannelInfo") -> None:
        """Set to nan, in place, what the library takes for heights and the format does not.

        Parameters
        ----------
        stored : array
            Heights in the unit of the channel.
        channel : ChannelInfo
            What the library knows of the channel.
        """

    def read(self, path: Path, request: ScanRequest) -> ReadScan:
        """Read the channel that is asked for, or the first of heights."""
        reader = self._open(path)
        channels = list(reader.channels)
        channel = _find_channel(channels, request.channel, path.name)
        _check_channel(channel, path.name)
        per_metre = UNITS_PER_METRE[channel.unit]
        surface = reader.topography(channel_index=channel.index)
        masked = np.ma.masked_invalid(surface.heights()).astype(np.float64)
        stored = np.ma.filled(masked, np.nan)
        self.remove_missing(stored, channel)
        height = stored / per_metre
        scale = f"channel {channel.name!r} in {channel.unit}"
        if len(channels) > 1 and not request.channel:
            scale += f", the first of {len(channels)} that is named as heights"
        count = _get_stored_height(channel) / per_metre
        scan: ScannedProfile | HeightMap
        if surface.dim == 1:
            position = np.asarray(surface.positions(), dtype=np.float64) / per_metre
            scan = ScannedProfile(position, height, path.name, scale, count)
        else:
            dx, dy = np.array(surface.physical_sizes) / per_metre / height.shape
            # the library keeps x first; here a row is a line along x
            scan = HeightMap(height.T, float(dx), float(dy), path.name, scale, count)
        return ReadScan(scan, str(channel.name))

    def list_channels(self, path: Path) -> list[str]:
        """List name and unit of each channel."""
        return [_name_channel(channel) for channel in self._open(path).channels]

    def _open(self, path: Path) -> "ReaderBase":
        from SurfaceTopography import open_topography

        return open_topography(self.prepare(path), format=self.form)


class TextMatrixReader(SurfaceTopographyReader):
    """A matrix of heights as text, under a head that states its size and units."""

    has_header = False

    def __init__(self) -> None:
        super().__init__("asc", TEXT_ENDINGS)

    def claims(self, path: Path) -> bool:
        """Tell whether the head states a matrix."""
        return holds_matrix(path)


def _name_channel(channel: "ChannelInfo") -> str:
    return f"{channel.name} [{channel.unit}]"


def _find_channel(channels: "list[ChannelInfo]", wanted: str | None, place: str) -> "ChannelInfo":
    """Find the channel that is asked for, or the first of heights.

    A channel is of heights where its unit is a length and its name does not deny it.
    """
    names = ", ".join(repr(str(channel.name)) for channel in channels)
    if wanted:
        found = _find_named(channels, wanted)
        if len({channel.name for channel in found}) != 1:
            raise MetrologyError(f"channel must name one of {names}, got {wanted!r} [{place}]")
        return found[0]
    for channel in channels:
        if _holds_heights(channel):
            return channel
    reason = f"none of {names} says so" if names else "the file has none"
    raise MetrologyError(f"channel must hold heights in a unit of length, and {reason} [{place}]")


def _find_named(channels: "list[ChannelInfo]", wanted: str) -> "list[ChannelInfo]":
    """Find the channels of that name, or else all whose name and unit contain it."""
    exact = [channel for channel in channels if wanted in (_name_channel(channel), channel.name)]
    if exact:
        return exact
    return [channel for channel in channels if wanted.lower() in _name_channel(channel).lower()]


def _holds_heights(channel: "ChannelInfo") -> bool:
    is_height = str(channel.data_kind).endswith("HEIGHT")
    is_length = channel.unit in UNITS_PER_METRE
    return is_height and is_length and not _NO_HEIGHT.search(str(channel.name))


def _check_channel(channel: "ChannelInfo", place: str) -> None:
    """Refuse a channel without a unit of length or lateral size, or with too many points."""
    if channel.unit not in UNITS_PER_METRE:
        raise MetrologyError(
            f"channel {channel.name!r} must say its unit of length, got {channel.unit!r} [{place}]"
        )
    if channel.physical_sizes is None:
        raise MetrologyError(
            f"channel {channel.name!r} must say its lateral size, got none [{place}]"
        )
    check_points(channel.nb_grid_pts, place)


def _get_stored_height(channel: "ChannelInfo") -> float:
    """Return the height of the stored number 1, in the unit of the channel."""
    if channel.height_scale_factor is None:
        return 1.0
    return abs(float(channel.height_scale_factor))
