"""Read a scan from any file: text, or the file of an instrument.

SurfaceTopography and x3pio read the files of instruments, in the confined process.
"""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepblocks.contact.counterface import Profile
from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.text import is_file
from stepblocks.mistakes import shorten_value
from stepblocks.scans.height_scale import check_height_scale, read_height_scale
from stepblocks.scans.points import grid_points, read_points
from stepblocks.scans.scan import HeightMap, ScannedProfile
from stepblocks.scans.text import (
    LENGTH_UNITS,
    holds_matrix,
    parse_given_units,
    read_table_scan,
    read_text_scan,
)

if TYPE_CHECKING:
    import pandas as pd
    from SurfaceTopography.IO.Reader import ChannelInfo

# what is scanned: a file, the table of one, a scan in memory, or positions and heights [m]
Scan: TypeAlias = (
    "str | Path | pd.DataFrame | ScannedProfile | HeightMap | Profile | tuple[ArrayLike, ArrayLike]"
)

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".xyz", ".asc", ".dat")
# numbers without a unit, which must be given
POINT_ENDINGS = (
    ".ply",
    ".stl",
    ".obj",
    ".json",
)
_NAMED = (
    "x3p sdf sur plux gwy opdx nid opd datx al3d plu zon vk4 ezd ibw mi mnt tmd nms stp top frt "
    "spm di"
)
# what the reader calls each ending
FORMATS = {f".{name}": name for name in _NAMED.split()} | {
    ".nid": "ezd",
    ".vk4": "vk",
    ".stp": "wsxm",
    ".top": "wsxm",
    ".spm": "di",
}
# beginnings of files whose ending says little, such as .dat or .001
_MAGIC = {
    b"\x88\x1b\x03\x6f": "metropro",
    b"\x88\x1b\x03\x70": "metropro",
    b"\x88\x1b\x03\x71": "metropro",
    b"\\*Fi": "di",
}
# a channel that a reader takes for heights by its unit, and whose name says otherwise
_NO_HEIGHT = re.compile(
    r"(?i)deflection|amplitude|phase|error|friction|adhesion|current|potential|lateral|user"
)

_LIST = "--list--"  # asked for as a channel, its answer is the names of all
_MOST_POINTS = 64_000_000
_MOST_UNPACKED = 2**30


def load_scan(
    scan: Scan, unit: str | None = None, channel: str | None = None
) -> ScannedProfile | HeightMap:
    """Return a scan as an object: read from its file or table, taken as it is, or made of arrays.

    Arrays are two, one of two rows, or a series over its positions [m].
    """
    if isinstance(scan, ScannedProfile | HeightMap):
        return scan
    if isinstance(scan, str | Path):
        return read_scan(scan, unit, channel)
    if hasattr(scan, "to_pandas"):  # of polars, Arrow or xarray
        scan = scan.to_pandas()
    if hasattr(scan, "columns"):  # a table; pandas is not loaded to find out
        return read_table_scan(scan, unit, channel)
    arrays = (scan.x, scan.z) if isinstance(scan, Profile) else scan
    if hasattr(arrays, "to_csv"):  # a row of heights over positions
        arrays = arrays.index, arrays
    if not hasattr(arrays, "__len__") or len(arrays) != 2:
        # only here: to write a list of a million numbers takes longer than to read it
        raise MetrologyError(
            "scan must be a file, a table, or two rows, x and z, got "
            + (f"shape {np.shape(arrays)}" if hasattr(arrays, "shape") else shorten_value(arrays))
        )
    position, height = (np.asarray(one, dtype=np.float64) for one in arrays)
    return ScannedProfile(position, height, "arrays")


def read_scan(
    path: str | Path, unit: str | None = None, channel: str | None = None
) -> ScannedProfile | HeightMap:
    """Read what an instrument measured.

    Parameters
    ----------
    path : str or Path
        A text table (``.csv``, ``.txt``, ``.tsv``, ``.xyz``, ``.asc``, ``.dat``) of x, z or of x,
        y, z, or a matrix of heights; points (``.ply``, ``.stl``, ``.obj``, ``.json``); or
        a file of an instrument (``.x3p``, ``.sdf``, ``.sur``, ``.plux``, ``.gwy``, ``.opdx``,
        ``.nid``, ``.ibw``, ``.mi``, ``.mnt``, ``.stp``, ``.frt`` and others).
    unit : str, optional
        Unit of what does not say its own: ``um``, or by axis ``x=mm,z=um``; a number before it is
        the size of a stored 1.
    channel : str, optional
        Name of the channel (of text, the column) of heights, or a part that no other has; the first
        so named by default.

    Returns
    -------
    ScannedProfile or HeightMap
        Heights in metres, nan where nothing was measured; the height scale of a file of an
        instrument has been checked against its own header.

    Raises
    ------
    MetrologyError
        If the file is missing, broken, hostile, ambiguous in its units or channels, or read with
        another scale than it states.
    """
    path, form = _find_form(Path(path))
    if form == "text":
        return read_text_scan(path, unit, channel)
    MetrologyError.require(
        unit is None or form == "points",
        f"unit must not be given for a {path.suffix.lower()} file, which says its own "
        f"[{path.name}]",
    )
    found = read_confined(
        f"{__name__}:read_scan_confined", path, unit or "", channel or "", raises=MetrologyError
    )
    stated = read_height_scale(path, form, found.pop("channel", ""))
    scan = ScannedProfile(**found) if "position" in found else HeightMap(**found)
    if stated is None:
        note = (
            ""
            if form in ("points", "asc")
            else "; its height scale was read once, not checked against its header"
        )
        return replace(scan, count=None, scale=scan.scale + note)
    checked = check_height_scale(scan.height, stated, path.name, scan.count)
    # a stored floating number has no steps, so its unit is no resolution
    return replace(
        scan, scale=f"{scan.scale}; {checked}", count=scan.count if stated.integral else None
    )


def list_channels(path: str | Path) -> list[str]:
    """List the channels of a file.

    Parameters
    ----------
    path : str or Path
        A file of an instrument; one of text, or with one layer only, has none.

    Returns
    -------
    list of str
        Name and unit of each, as ``read_scan`` takes them.

    Raises
    ------
    MetrologyError
        If the file cannot be read.
    """
    path, form = _find_form(Path(path))
    if form in ("text", "points", "x3p", "sdf"):
        return []
    return list(
        read_confined(f"{__name__}:read_scan_confined", path, "", _LIST, raises=MetrologyError)[
            "channels"
        ]
    )


def _find_form(path: Path) -> tuple[Path, str]:
    # Return by which reader a file is read: by its first bytes where its ending says little.
    MetrologyError.require(is_file(path), f"scan must be a file, got {str(path)!r}")
    try:
        with path.open("rb") as file:
            begin = file.read(4)
    except OSError as error:
        raise MetrologyError(f"scan cannot be read: {error.strerror} [{path.name}]") from error
    MetrologyError.require(begin, f"scan must not be empty [{path.name}]")
    ending = path.suffix.lower()
    if begin in _MAGIC:
        return path, _MAGIC[begin]
    if ending in TEXT_ENDINGS:
        return path, "asc" if holds_matrix(path) else "text"
    if ending in POINT_ENDINGS:
        return path, "points"
    if ending not in FORMATS:
        known = ", ".join([*TEXT_ENDINGS, *POINT_ENDINGS, *FORMATS])
        raise MetrologyError(
            f"ending of a scan must be one of {known}, got {ending!r} [{path.name}]"
        )
    return path, FORMATS[ending]


def _check_archive(path: Path) -> None:
    # Refuse a zip bomb by its directory, before anything is unpacked.
    with zipfile.ZipFile(path) as archive:
        sizes = [entry.file_size for entry in archive.infolist()]
    MetrologyError.require(
        sum(sizes) <= _MOST_UNPACKED and len(sizes) <= 10_000,
        f"archive must unpack to at most {_MOST_UNPACKED >> 20} MiB in 10000 files, got "
        f"{sum(sizes) >> 20} MiB in {len(sizes)} [{path.name}]",
    )


def read_scan_confined(path: Path, unit: str = "", channel: str = "") -> dict[str, object]:
    """Read a file of points or of an instrument; called in the confined process."""
    if zipfile.is_zipfile(path):
        _check_archive(path)
    _, form = _find_form(path)
    if form == "points":
        return vars(replace(read_points(path, parse_given_units(unit)), count=None))
    if form in ("x3p", "sdf"):
        return vars(_read_x3p(path) if form == "x3p" else _read_sdf(path))
    file: str | io.BytesIO = str(path)
    if form == "tmd":
        file = _pad_tmd_comment(path)
    if form == "sur" and path.read_bytes()[:12] == b"DSCOMPRESSED":
        file = _unpack_sur(path)
    return _read_by_surfacetopography(file, form, channel, path.name)


def _check_size(shape: Sequence[int], place: str) -> None:
    MetrologyError.require(
        int(np.prod(shape)) <= _MOST_POINTS,
        f"scan must have at most {_MOST_POINTS} points, got {shape} [{place}]",
    )


def _unpack_sur(path: Path) -> io.BytesIO:
    # Compressed Digital Surf file as a plain one: 512 bytes of header, comments, then a directory
    # of deflated pieces.
    raw = path.read_bytes()
    begin = 512 + sum(struct.unpack_from("<HH", raw, 334))
    (pieces,) = struct.unpack_from("<I", raw, begin)
    sizes = [
        struct.unpack_from("<II", raw, begin + 4 + 8 * piece) for piece in range(min(pieces, 4096))
    ]
    MetrologyError.require(
        sum(size for size, _ in sizes) <= _MOST_UNPACKED,
        f"file must unpack to at most {_MOST_UNPACKED >> 20} MiB [{path.name}]",
    )
    at = begin + 4 + 8 * len(sizes)
    plain = [b"DIGITAL SURF" + raw[12:begin]]
    for size, packed in sizes:
        plain.append(zlib.decompressobj().decompress(raw[at : at + packed], size))
        MetrologyError.require(
            len(plain[-1]) == size,
            f"piece of compressed heights must unpack to {size} bytes, got "
            f"{len(plain[-1])} [{path.name}]",
        )
        at += packed
    return io.BytesIO(b"".join(plain))


def _pad_tmd_comment(path: Path) -> io.BytesIO:
    # TrueMap file whose comment is as long as the reader takes it to be: 24 bytes with its end.
    raw = path.read_bytes()
    comment, _, rest = raw[32:].partition(b"\0")
    return io.BytesIO(raw[:32] + comment[:23].ljust(24, b"\0") + rest)


def _read_sdf(path: Path) -> ScannedProfile | HeightMap:
    import sdfio

    stated = read_height_scale(path, "sdf", "")
    read = sdfio.read(str(path))
    _check_size(read.data.shape, path.name)
    header = read.header
    scale = "ISO 25178-71: heights in metres"
    height = np.atleast_2d(read.data)
    count = abs(header.z_scale) if stated else 1.0
    if len(height) == 1:
        return ScannedProfile(
            np.arange(height.size, dtype=np.float64) * header.x_scale,
            height[0],
            path.name,
            scale,
            count,
        )
    return HeightMap(height, header.x_scale, header.y_scale, path.name, scale, count)


def _read_x3p(path: Path) -> ScannedProfile | HeightMap:
    import x3pio

    _check_size(x3pio.info(str(path)).shape, path.name)
    layer = x3pio.read(str(path)).layers[0]
    header = layer.header
    scale = "ISO 25178-72: heights in metres, checksums verified"
    count = abs(header.z.increment or 1.0)
    if layer.z.ndim == 1 and isinstance(layer, x3pio.ProfileLayer):
        return ScannedProfile(
            np.arange(len(layer.z), dtype=np.float64) * header.x.increment
            if layer.x is None
            else layer.x,
            layer.z,
            path.name,
            scale,
            count,
        )
    steps = header.x.increment, header.y.increment
    if layer.x is not None or None in steps:  # a point cloud, or absolute axes
        x, y, z = (
            np.ravel(np.asarray(one, dtype=np.float64)) for one in (layer.x, layer.y, layer.z)
        )
        return replace(grid_points(x, y, z, path.name, scale), count=count)
    return HeightMap(layer.z, *steps, path.name, scale, count)


def _find_channel(channels: "list[ChannelInfo]", wanted: str, place: str) -> "ChannelInfo":
    # Return the channel that the user names, or the first whose name does not deny that it holds
    # heights.
    names = [f"{one.name} [{one.unit}]" for one in channels]
    listed = ", ".join(repr(str(one.name)) for one in channels)
    if wanted:
        exact = [
            one for one, name in zip(channels, names, strict=True) if wanted in (name, one.name)
        ]
        found = exact or [
            one for one, name in zip(channels, names, strict=True) if wanted.lower() in name.lower()
        ]
        MetrologyError.require(
            len({one.name for one in found}) == 1,
            f"channel must name one of {listed}, got {wanted!r} [{place}]",
        )
        return found[0]
    heights = [
        one
        for one in channels
        if str(one.data_kind).endswith("HEIGHT") and one.unit in LENGTH_UNITS
    ]
    found = [one for one in heights if not _NO_HEIGHT.search(str(one.name))]
    MetrologyError.require(
        found,
        "channel must hold heights in a unit of length, and "
        f"{f'none of {listed} says so' if listed else 'the file has none'} [{place}]",
    )
    return found[0]


def _read_by_surfacetopography(
    file: str | io.BytesIO, form: str, wanted: str, place: str
) -> dict[str, object]:
    from SurfaceTopography import open_topography

    reader = open_topography(file, format=form)
    if wanted == _LIST:
        return {"channels": [f"{one.name} [{one.unit}]" for one in reader.channels]}
    channel = _find_channel(list(reader.channels), wanted, place)
    MetrologyError.require(
        channel.unit in LENGTH_UNITS,
        f"channel {channel.name!r} must say its unit of length, got {channel.unit!r} [{place}]",
    )
    MetrologyError.require(
        channel.physical_sizes is not None,
        f"channel {channel.name!r} must say its lateral size, got none [{place}]",
    )
    _check_size(channel.nb_grid_pts, place)
    surface = reader.topography(channel_index=channel.index)
    per_metre = LENGTH_UNITS[channel.unit]
    raw = (
        np.ma.filled(np.ma.masked_invalid(surface.heights()).astype(np.float64), np.nan) / per_metre
    )
    if form == "nms":
        # heights are numbers from 0 to 65534 between two ends; the one above is no height
        low, high = (channel.info["raw_metadata"][end] for end in ("zmin", "zmax"))
        raw[raw > ((high - low) * (1.0 + 0.5 / 65534.0) + low) / per_metre] = np.nan
    others = (
        f", the first of {len(reader.channels)} that is named as heights"
        if len(reader.channels) > 1 and not wanted
        else ""
    )
    factor = 1.0 if channel.height_scale_factor is None else abs(float(channel.height_scale_factor))
    content: dict[str, object] = {
        "height": raw.T,  # SurfaceTopography keeps x first; here a row is a line along x
        "source": place,
        "scale": f"channel {channel.name!r} in {channel.unit}{others}",
        "channel": str(channel.name),
        "count": factor / per_metre,  # metres per stored number
    }
    if surface.dim == 1:
        return content | {"position": np.asarray(surface.positions(), dtype=np.float64) / per_metre}
    steps = np.array(surface.physical_sizes) / per_metre / raw.shape
    return content | {"dx": float(steps[0]), "dy": float(steps[1])}
