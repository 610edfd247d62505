"""The formats of instruments that SurfaceTopography reads."""

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.formats.reader import LoadedScan, ReadOptions, ScanReader, check_point_count
from stepblocks.scans.formats.text import TEXT_ENDINGS
from stepblocks.scans.scan import Array, HeightMap, ScannedProfile
from stepblocks.scans.text import has_matrix_head
from stepblocks.scans.units import UNITS_PER_METRE, StoredLength, parse_units

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
    takes_unit = True  # of a channel that states none

    def __init__(
        self, form: str, endings: tuple[str, ...] = (), signatures: tuple[bytes, ...] = ()
    ) -> None:
        self.form = form
        self.endings = endings
        self.signatures = signatures

    def prepare_input(self, path: Path) -> str | io.BytesIO:
        """Return what the library is given: the path, or a file that it understands better."""
        return str(path)

    def blank_missing_heights(self, stored: Array, channel: "ChannelInfo") -> None:
        """Set to nan, in place, what the library takes for heights and the format does not.

        Parameters
        ----------
        stored : array
            Heights in the unit of the channel.
        channel : ChannelInfo
            What the library knows of the channel.
        """

    def correct_spacing(self, spacing: Array, place: str) -> Array:
        """Return the spacing along x and y [m] by the format, where the library errs."""
        return spacing

    def find_unstated_axes(self, path: Path, channel: "ChannelInfo") -> frozenset[str]:
        """Find the axes of a channel, of x, y and z, for which the file states no unit."""
        if channel.unit:
            return frozenset()
        return frozenset("xyz")

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read the channel that is asked for, or the first one that holds heights."""
        reader = self._open_with_library(path)
        channels = list(reader.channels)
        channel = _choose_channel(channels, request.channel, path.name)
        unstated = self.find_unstated_axes(path, channel)
        lengths = _find_stored_lengths(channel, unstated, request.unit, path)
        _check_channel_size(channel, path.name)
        surface = reader.topography(channel_index=channel.index)
        masked = np.ma.masked_invalid(surface.heights()).astype(np.float64)
        stored = np.ma.filled(masked, np.nan)
        self.blank_missing_heights(stored, channel)
        height = lengths["z"].to_metres(stored)
        scale = _describe_unit_origin(channel, unstated, request.unit)
        if len(channels) > 1 and not request.channel:
            scale += f", the first of {len(channels)} that is named as heights"
        count = _get_stored_height(channel) * lengths["z"].metres
        scan: ScannedProfile | HeightMap
        if surface.dim == 1:
            position = np.asarray(surface.positions(), dtype=np.float64)
            scan = ScannedProfile(lengths["x"].to_metres(position), height, path.name, scale, count)
        else:
            sizes = np.array(surface.physical_sizes) / height.shape
            spacing = np.array([lengths["x"].to_metres(sizes)[0], lengths["y"].to_metres(sizes)[1]])
            dx, dy = self.correct_spacing(spacing, path.name)
            # the library keeps x first; here a row is a line along x
            scan = HeightMap(height.T, float(dx), float(dy), path.name, scale, count)
        return LoadedScan(scan, str(channel.name))

    def list_channels(self, path: Path) -> list[str]:
        """List name and unit of each channel."""
        return list(map(_format_channel_name, self._open_with_library(path).channels))

    def _open_with_library(self, path: Path) -> "ReaderBase":
        """Open a file by its format of SurfaceTopography."""
        from SurfaceTopography import open_topography

        return open_topography(self.prepare_input(path), format=self.form)


class TextMatrixReader(SurfaceTopographyReader):
    """A matrix of heights as text, under a head that states its size and units."""

    has_header = False

    def __init__(self) -> None:
        super().__init__("asc", TEXT_ENDINGS)

    def claims(self, path: Path) -> bool:
        """Tell whether the head states a matrix."""
        return has_matrix_head(path)


def _format_channel_name(channel: "ChannelInfo") -> str:
    """Return name and unit of a channel, as ``height [um]``."""
    return f"{channel.name} [{channel.unit}]"


def _choose_channel(
    channels: "list[ChannelInfo]", wanted_channel: str | None, place: str
) -> "ChannelInfo":
    """Choose the channel that is asked for, or the first of heights.

    A channel is of heights where its unit is a length and its name does not deny it.
    """
    names = ", ".join(repr(str(channel.name)) for channel in channels)
    if wanted_channel:
        found = _find_channels_by_name(channels, wanted_channel)
        if len({channel.name for channel in found}) != 1:
            raise MetrologyError(
                f"channel must name one of {names}, got {wanted_channel!r} [{place}]"
            )
        return found[0]
    for channel in channels:
        if _is_height_channel(channel):
            return channel
    reason = f"none of {names} says so" if names else "the file has none"
    raise MetrologyError(f"channel must hold heights in a unit of length, and {reason} [{place}]")


def _find_channels_by_name(
    channels: "list[ChannelInfo]", wanted_channel: str
) -> "list[ChannelInfo]":
    """Find the channels of that name, or else all whose name and unit contain it."""
    exact = [
        channel
        for channel in channels
        if wanted_channel in (_format_channel_name(channel), channel.name)
    ]
    if exact:
        return exact
    return [
        channel
        for channel in channels
        if wanted_channel.lower() in _format_channel_name(channel).lower()
    ]


def _is_height_channel(channel: "ChannelInfo") -> bool:
    """Tell whether a channel holds heights in a unit of length, or in none."""
    is_height = str(channel.data_kind).endswith("HEIGHT")
    may_be_length = not channel.unit or channel.unit in UNITS_PER_METRE
    return is_height and may_be_length and not _NO_HEIGHT.search(str(channel.name))


def _find_stored_lengths(
    channel: "ChannelInfo", unstated_axes: frozenset[str], unit: str | None, path: Path
) -> dict[str, StoredLength]:
    """Find the length of a stored 1 for each axis: by the file, or else by the user's unit."""
    if not unstated_axes and unit is not None:
        raise MetrologyError(
            f"unit must not be given for a {path.suffix.lower()} file, which says its own "
            f"[{path.name}]"
        )
    given = parse_units(unit)
    lengths = {}
    for axis in "xyz":
        if axis not in unstated_axes:
            lengths[axis] = _get_stated_length(channel, path.name)
        elif axis in given:
            lengths[axis] = given[axis]
        else:
            raise MetrologyError(
                f"channel {channel.name!r} states no unit for {axis}, so one must be given, as um "
                f"or x=um,y=um,z=nm (--unit) [{path.name}]"
            )
    return lengths


def _get_stated_length(channel: "ChannelInfo", place: str) -> StoredLength:
    """Return the length of a stored 1 of a channel that states its unit."""
    if channel.unit not in UNITS_PER_METRE:
        raise MetrologyError(
            f"channel {channel.name!r} must say its unit of length, got {channel.unit!r} [{place}]"
        )
    return StoredLength(1.0, UNITS_PER_METRE[channel.unit])


def _describe_unit_origin(
    channel: "ChannelInfo", unstated_axes: frozenset[str], unit: str | None
) -> str:
    """Say where the units of a channel come from."""
    if unstated_axes:
        axes = ", ".join(sorted(unstated_axes))
        return f"channel {channel.name!r}, unit {unit} as given for {axes}"
    return f"channel {channel.name!r} in {channel.unit}"


def _check_channel_size(channel: "ChannelInfo", place: str) -> None:
    """Refuse a channel without a lateral size, or with too many points."""
    if channel.physical_sizes is None:
        raise MetrologyError(
            f"channel {channel.name!r} must say its lateral size, got none [{place}]"
        )
    check_point_count(channel.nb_grid_pts, place)


def _get_stored_height(channel: "ChannelInfo") -> float:
    """Return the height of the stored number 1, in the unit of the channel."""
    if channel.height_scale_factor is None:
        return 1.0
    return abs(float(channel.height_scale_factor))
