"""One door for every scan: text, and the files of instruments, read by SurfaceTopography and x3pio in a process of their own.

Their readers are made for honest files. Here they run with a limit on memory and time, so that a file that lies about its
size ends in one line and not in a full machine. ``python -m`` on this module is that process.
"""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
import tempfile
import warnings
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.artefacts.scans.height_scale import check_height_scale, stated_height_scale
from stepblocks.artefacts.scans.points import gridded, read_points
from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.artefacts.scans.text import LENGTH_UNITS, given_units, holds_matrix, read_text_scan
from stepblocks.errors import MetrologyError

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".xyz", ".asc", ".dat")
POINT_ENDINGS = (".ply", ".stl", ".obj", ".pcd", ".json")  # numbers without a unit, which must be given
_NAMED = [
    "x3p",
    "sdf",
    "sur",
    "plux",
    "gwy",
    "opdx",
    "nid",
    "opd",
    "datx",
    "al3d",
    "plu",
    "zon",
    "vk4",
    "ezd",
    "ibw",
    "mi",
]
_NAMED += ["mnt", "tmd", "stp", "top", "frt", "spm", "di"]
# what the reader calls each ending
FORMATS = {f".{name}": name for name in _NAMED}
FORMATS |= {".nid": "ezd", ".vk4": "vk", ".stp": "wsxm", ".top": "wsxm", ".spm": "di"}
# beginnings of files whose ending says little, such as .dat or .001
_MAGIC = {
    b"\x88\x1b\x03\x6f": "metropro",
    b"\x88\x1b\x03\x70": "metropro",
    b"\x88\x1b\x03\x71": "metropro",
    b"\\*Fi": "di",
}
# a channel that a reader takes for heights by its unit, and whose name says otherwise
_NO_HEIGHT = re.compile(
    r"deflection|amplitude|phase|error|friction|adhesion|current|potential|lateral|user", re.IGNORECASE
)

_LIST = "--list--"  # asked for as a channel, its answer is the names of all
_MOST_POINTS = 64_000_000
_MOST_UNPACKED = 2**30
_MEMORY = 2 * 2**30
_SECONDS = 20


def read_scan(path: str | Path, unit: str | None = None, channel: str | None = None) -> Profile | HeightMap:
    """Read what an instrument measured.

    Parameters
    ----------
    path : str or Path
        A text table (``.csv``, ``.txt``, ``.tsv``, ``.xyz``, ``.asc``, ``.dat``) of x, z or of x, y, z, or a matrix of
        heights; points (``.ply``, ``.stl``, ``.obj``, ``.pcd``, ``.json``); or a file of an instrument (``.x3p``, ``.sdf``,
        ``.sur``, ``.plux``, ``.gwy``, ``.opdx``, ``.nid``, ``.ibw``, ``.mi``, ``.mnt``, ``.stp``, ``.frt`` and others).
    unit : str, optional
        Unit of what does not say its own: ``um``, or by axis ``x=mm,z=um``; a number before it is the size of a stored 1.
    channel : str, optional
        Name of the channel of heights, or a part of it that no other has; the first that is named as heights by default.

    Returns
    -------
    Profile or HeightMap
        Heights in metres, nan where nothing was measured; the height scale of a file of an instrument has been checked
        against its own header.

    Raises
    ------
    MetrologyError
        If the file is missing, broken, hostile, ambiguous in its units or channels, or read with another scale than it states.
    """
    path, form = _known_form(Path(path))
    if form == "text":
        if channel is not None:
            raise MetrologyError(f"channel must not be given for a text table [{path.name}]")
        return read_text_scan(path, unit)
    if unit is not None and form != "points":
        raise MetrologyError(
            f"unit must not be given for a {path.suffix.lower()} file, which says its own [{path.name}]"
        )
    scan, taken = read_foreign(path, unit, channel)
    stated = stated_height_scale(path, form, taken)
    if stated is None:
        said = "" if form in ("points", "asc") else "; its height scale was read once, not checked against its header"
        return replace(scan, count=None, scale=scan.scale + said)
    checked = check_height_scale(scan.height, stated, path.name, scan.count)
    # a stored floating number has no steps, so its unit is no resolution
    return replace(scan, scale=f"{scan.scale}; {checked}", count=scan.count if stated.integral else None)


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
    path, form = _known_form(Path(path))
    return [] if form in ("text", "points", "x3p", "sdf") else _confined_answer(path, None, _LIST)["channels"].tolist()


def _known_form(path: Path) -> tuple[Path, str]:
    """Return by which reader a file is read: by its first bytes where its ending says little."""
    if not path.is_file():
        raise MetrologyError(f"scan must be a file, got {str(path)!r}")
    if path.stat().st_size == 0:
        raise MetrologyError(f"scan must not be empty [{path.name}]")
    ending = path.suffix.lower()
    with path.open("rb") as file:
        magic = _MAGIC.get(file.read(4))
    if magic is not None:
        return path, magic
    if ending in TEXT_ENDINGS:
        return path, "asc" if holds_matrix(path) else "text"
    if ending in POINT_ENDINGS:
        return path, "points"
    if ending not in FORMATS:
        known = ", ".join([*TEXT_ENDINGS, *POINT_ENDINGS, *FORMATS])
        raise MetrologyError(f"ending of a scan must be one of {known}, got {ending!r} [{path.name}]")
    return path, FORMATS[ending]


def read_foreign(path: Path, unit: str | None = None, channel: str | None = None) -> tuple[Profile | HeightMap, str]:
    """Read a file of an instrument in a process with bounded memory and time; return also the name of the channel taken."""
    data = _confined_answer(path, unit, channel)
    height, scale = data["height"], str(data["scale"])
    count = float(data["count"]) if "count" in data else None
    taken = str(data["channel"]) if "channel" in data else ""
    if height.ndim == 1:
        return Profile(data["position"], height, path.name, scale, count), taken
    return HeightMap(height, float(data["dx"]), float(data["dy"]), path.name, scale, count), taken


def _confined_answer(path: Path, unit: str | None, channel: str | None) -> dict[str, Any]:
    _check_archive(path)
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "scan.npz"
        command = [sys.executable, "-m", __name__, str(path), str(answer), unit or "", channel or ""]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        try:
            done = subprocess.run(command, capture_output=True, timeout=_SECONDS, env=environment, check=False)
        except subprocess.TimeoutExpired as error:
            raise MetrologyError(f"file must be readable within {_SECONDS} s [{path.name}]") from error
        if done.returncode != 0 or not answer.exists():
            lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
            reason = lines[-1][:300] if lines else f"reader ended with {done.returncode}"
            if reason.startswith(("channel must", "a unit must")):
                raise MetrologyError(f"{reason} [{path.name}]")
            raise MetrologyError(f"file must be a sound {path.suffix[1:].upper()} file, got: {reason} [{path.name}]")
        with np.load(answer, allow_pickle=False) as data:
            return dict(data)


def _check_archive(path: Path) -> None:
    """Refuse a zip bomb by its directory, before anything is unpacked."""
    if not zipfile.is_zipfile(path):
        return
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = [entry.file_size for entry in archive.infolist()]
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise MetrologyError(f"archive must be sound, got {error} [{path.name}]") from error
    if sum(sizes) > _MOST_UNPACKED or len(sizes) > 10_000:
        raise MetrologyError(
            f"archive must unpack to at most {_MOST_UNPACKED >> 20} MiB in 10000 files, got {sum(sizes) >> 20} MiB in "
            f"{len(sizes)} [{path.name}]"
        )


def _load(path: Path, unit: str = "", channel: str = "") -> dict[str, Any]:
    """Read in this process; only the confined child calls it."""
    path, form = _known_form(path)
    if form == "points":
        found = read_points(path, given_units(unit))
        return {"height": found.height, "dx": found.dx, "dy": found.dy, "scale": found.scale}
    if form == "x3p":
        return _load_x3p(path)
    if form == "sdf":
        return _load_sdf(path)
    if form == "sur" and path.read_bytes()[:12] == b"DSCOMPRESSED":
        with tempfile.NamedTemporaryFile(suffix=".sur") as plain:
            plain.write(_unpacked_sur(path.read_bytes()))
            plain.flush()
            return _load_by_surfacetopography(Path(plain.name), form, channel)
    return _load_by_surfacetopography(path, form, channel)


def _check_size(shape: Any) -> None:
    if int(np.prod(shape)) > _MOST_POINTS:
        raise MetrologyError(f"scan must have at most {_MOST_POINTS} points, got {shape}")


def _unpacked_sur(raw: bytes) -> bytes:
    """Compressed Digital Surf file as a plain one: 512 bytes of header, comments, then a directory of deflated pieces."""
    begin = 512 + sum(struct.unpack_from("<HH", raw, 334))
    (pieces,) = struct.unpack_from("<I", raw, begin)
    sizes = [struct.unpack_from("<II", raw, begin + 4 + 8 * piece) for piece in range(min(pieces, 4096))]
    if sum(size for size, _ in sizes) > _MOST_UNPACKED:
        raise MetrologyError(f"file must unpack to at most {_MOST_UNPACKED >> 20} MiB")
    at, plain = begin + 4 + 8 * len(sizes), [b"DIGITAL SURF" + raw[12:begin]]
    for size, packed in sizes:
        plain.append(zlib.decompressobj().decompress(raw[at : at + packed], size))
        if len(plain[-1]) != size:
            raise MetrologyError(f"piece of compressed heights must unpack to {size} bytes, got {len(plain[-1])}")
        at += packed
    return b"".join(plain)


def _load_sdf(path: Path) -> dict[str, Any]:
    import sdfio

    stated = stated_height_scale(path, "sdf", "")
    read = sdfio.read(str(path))
    _check_size(read.data.shape)
    header, scale = read.header, "ISO 25178-71: heights in metres"
    height, count = np.atleast_2d(read.data), abs(header.z_scale) if stated else 1.0
    if len(height) == 1:
        position = np.arange(height.size) * header.x_scale
        return {"height": height[0], "position": position, "scale": scale, "count": count}
    return {"height": height, "dx": header.x_scale, "dy": header.y_scale, "scale": scale, "count": count}


def _load_x3p(path: Path) -> dict[str, Any]:
    import x3pio

    _check_size(x3pio.info(str(path)).shape)
    layer: Any = x3pio.read(str(path)).layers[0]
    header = layer.header
    scale, count = "ISO 25178-72: heights in metres, checksums verified", abs(header.z.increment or 1.0)
    if layer.z.ndim == 1 and isinstance(layer, x3pio.ProfileLayer):
        position = layer.x if layer.x is not None else np.arange(len(layer.z)) * header.x.increment
        return {"height": layer.z, "position": position, "scale": scale, "count": count}
    steps = header.x.increment, header.y.increment
    if layer.x is not None or None in steps:  # a point cloud, or absolute axes
        x, y, z = (np.ravel(np.asarray(one, dtype=np.float64)) for one in (layer.x, layer.y, layer.z))
        found = gridded(x, y, z, path.name, scale)
        return {"height": found.height, "dx": found.dx, "dy": found.dy, "scale": found.scale, "count": count}
    return {"height": layer.z, "dx": steps[0], "dy": steps[1], "scale": scale, "count": count}


def _named_channel(channels: list[Any], wanted: str) -> Any:
    """Return the channel that the user names, or the first whose name does not deny that it holds heights."""
    names = [f"{one.name} [{one.unit}]" for one in channels]
    said = ", ".join(repr(str(one.name)) for one in channels)
    if wanted:
        exact = [one for one, name in zip(channels, names, strict=True) if wanted in (name, one.name)]
        found = exact or [one for one, name in zip(channels, names, strict=True) if wanted.lower() in name.lower()]
        if len({one.name for one in found}) != 1:
            raise MetrologyError(f"channel must name one of {said}, got {wanted!r}")
        return found[0]
    heights = [one for one in channels if str(one.data_kind).endswith("HEIGHT") and one.unit in LENGTH_UNITS]
    found = [one for one in heights if not _NO_HEIGHT.search(str(one.name))]
    if not found:
        raise MetrologyError(f"channel must hold heights in a unit of length, and none of {said or 'none'} says so")
    return found[0]


def _load_by_surfacetopography(path: Path, form: str, wanted: str) -> dict[str, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it misses MPI, which nothing here needs
        from SurfaceTopography import open_topography

    reader = open_topography(str(path), format=form)
    if wanted == _LIST:
        return {"channels": np.array([f"{one.name} [{one.unit}]" for one in reader.channels])}
    channel = _named_channel(list(reader.channels), wanted)
    unit = channel.unit
    if unit not in LENGTH_UNITS:
        raise MetrologyError(f"channel {channel.name!r} must say its unit of length, got {unit!r}")
    if channel.physical_sizes is None:
        raise MetrologyError(f"channel {channel.name!r} must say its lateral size, got none")
    _check_size(channel.nb_grid_pts)
    surface = reader.topography(channel_index=channel.index)
    per_metre = LENGTH_UNITS[unit]
    raw = np.ma.filled(np.ma.masked_invalid(surface.heights()).astype(np.float64), np.nan) / per_metre
    others = (
        f", the first of {len(reader.channels)} that is named as heights"
        if len(reader.channels) > 1 and not wanted
        else ""
    )
    content: dict[str, Any] = {
        "height": raw,
        "scale": f"channel {channel.name!r} in {unit}{others}",
        "channel": str(channel.name),
    }
    factor = 1.0 if channel.height_scale_factor is None else abs(float(channel.height_scale_factor))
    content["count"] = factor / per_metre  # metres per stored number
    if surface.dim == 1:
        return content | {"position": np.asarray(surface.positions(), dtype=np.float64) / per_metre}
    size_x, size_y = (float(size) / per_metre for size in surface.physical_sizes)
    # SurfaceTopography keeps x first; here a row is a line along x
    return content | {"height": raw.T, "dx": size_x / raw.shape[0], "dy": size_y / raw.shape[1]}


def _confined(path: Path, answer: Path, unit: str, channel: str) -> str | None:
    """Read with bounded memory; return what was wrong, as one line."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    try:
        np.savez(answer, **_load(path, unit, channel))
    except MemoryError:
        return f"it needs more than {_MEMORY >> 30} GiB of memory"
    except Exception as error:  # a foreign reader may raise anything; whatever it is becomes one line
        return " ".join(str(error).split())[:300] or type(error).__name__
    return None


if __name__ == "__main__":
    sys.exit(_confined(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], sys.argv[4]))
