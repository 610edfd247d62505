"""One door for every scan: text, and the files of instruments, read by SurfaceTopography and x3pio in a process of their own.

Their readers are made for honest files. Here they run with a limit on memory and time, so that a file that lies about its
size ends in one line and not in a full machine. ``python -m`` on this module is that process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.artefacts.scans.height_scale import check_height_scale, stated_height_scale
from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.artefacts.scans.text import LENGTH_UNITS, read_text_scan
from stepblocks.errors import MetrologyError

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".xyz", ".asc", ".dat")
_NAMED = ["x3p", "sdf", "sur", "plux", "gwy", "opdx", "nid", "opd", "datx", "al3d", "plu", "zon", "vk4", "ezd"]
FORMATS = {f".{name}": name for name in _NAMED} | {".nid": "ezd", ".vk4": "vk"}  # what the reader calls each ending

_MOST_POINTS = 64_000_000
_MOST_UNPACKED = 2**30
_MEMORY = 2 * 2**30
_SECONDS = 20


def read_scan(path: str | Path, unit: str | None = None) -> Profile | HeightMap:
    """Read what an instrument measured.

    Parameters
    ----------
    path : str or Path
        A text table (``.csv``, ``.txt``, ``.tsv``, ``.xyz``, ``.asc``, ``.dat``) of x, z or of x, y, z, or a file of an
        instrument (``.x3p``, ``.sdf``, ``.sur``, ``.plux``, ``.gwy``, ``.opdx``, ``.nid`` and others).
    unit : str, optional
        Unit of a text table whose columns do not say theirs.

    Returns
    -------
    Profile or HeightMap
        Heights in metres, nan where nothing was measured; the height scale of a file of an instrument has been checked
        against its own header.

    Raises
    ------
    MetrologyError
        If the file is missing, broken, hostile, ambiguous in its units, or read with another scale than it states.
    """
    path = Path(path)
    if not path.is_file():
        raise MetrologyError(f"scan must be a file, got {str(path)!r}")
    if path.stat().st_size == 0:
        raise MetrologyError(f"scan must not be empty [{path.name}]")
    ending = path.suffix.lower()
    if ending in TEXT_ENDINGS:
        return read_text_scan(path, unit)
    if ending not in FORMATS:
        known = ", ".join([*TEXT_ENDINGS, *FORMATS])
        raise MetrologyError(f"ending of a scan must be one of {known}, got {ending!r} [{path.name}]")
    if unit is not None:
        raise MetrologyError(f"unit must not be given for a {ending} file, which says its own [{path.name}]")
    scan = read_foreign(path)
    stated = stated_height_scale(path)
    if stated is None:
        return replace(scan, count=None)
    checked = check_height_scale(scan.height, stated, path.name, scan.count)
    # a stored floating number has no steps, so its unit is no resolution
    return replace(scan, scale=f"{scan.scale}; {checked}", count=scan.count if stated.integral else None)


def read_foreign(path: Path) -> Profile | HeightMap:
    """Read a file of an instrument in a process with bounded memory and time."""
    _check_archive(path)
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "scan.npz"
        command = [sys.executable, "-m", __name__, str(path), str(answer)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        try:
            done = subprocess.run(command, capture_output=True, timeout=_SECONDS, env=environment, check=False)
        except subprocess.TimeoutExpired as error:
            raise MetrologyError(f"file must be readable within {_SECONDS} s [{path.name}]") from error
        if done.returncode != 0 or not answer.exists():
            lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
            reason = lines[-1][:200] if lines else f"reader ended with {done.returncode}"
            raise MetrologyError(f"file must be a sound {path.suffix[1:].upper()} file, got: {reason} [{path.name}]")
        with np.load(answer, allow_pickle=False) as data:
            height, scale = data["height"], str(data["scale"])
            count = float(data["count"]) if "count" in data else None
            if height.ndim == 1:
                return Profile(data["position"], height, path.name, scale, count)
            return HeightMap(height, float(data["dx"]), float(data["dy"]), path.name, scale, count)


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


def _load(path: Path) -> dict[str, Any]:
    """Read in this process; only the confined child calls it."""
    return _load_x3p(path) if path.suffix.lower() == ".x3p" else _load_by_surfacetopography(path)


def _check_size(shape: Any) -> None:
    if int(np.prod(shape)) > _MOST_POINTS:
        raise MetrologyError(f"scan must have at most {_MOST_POINTS} points, got {shape}")


def _load_x3p(path: Path) -> dict[str, Any]:
    import x3pio

    _check_size(x3pio.info(str(path)).shape)
    layer: Any = x3pio.read(str(path)).layers[0]
    header = layer.header
    if not isinstance(layer, x3pio.ProfileLayer | x3pio.SurfaceLayer):
        raise MetrologyError("file must hold a profile or a surface, got a point cloud")
    scale, count = "ISO 25178-72: heights in metres, checksums verified", abs(header.z.increment or 1.0)
    if layer.z.ndim == 1:
        position = layer.x if layer.x is not None else np.arange(len(layer.z)) * header.x.increment
        return {"height": layer.z, "position": position, "scale": scale, "count": count}
    if header.x.increment is None or header.y.increment is None:
        raise MetrologyError("surface must lie on a regular grid")
    return {"height": layer.z, "dx": header.x.increment, "dy": header.y.increment, "scale": scale, "count": count}


def _load_by_surfacetopography(path: Path) -> dict[str, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it misses MPI, which nothing here needs
        from SurfaceTopography import open_topography

    reader = open_topography(str(path), format=FORMATS[path.suffix.lower()])
    channel = next((one for one in reader.channels if str(one.data_kind).endswith("HEIGHT")), None)
    if channel is None:
        raise MetrologyError("file must hold a channel of heights, got none")
    unit = channel.unit
    if unit not in LENGTH_UNITS:
        raise MetrologyError(f"channel {channel.name!r} must say its unit of length, got {unit!r}")
    if channel.physical_sizes is None:
        raise MetrologyError(f"channel {channel.name!r} must say its lateral size, got none")
    _check_size(channel.nb_grid_pts)
    surface = reader.topography(channel_index=channel.index)
    per_metre = LENGTH_UNITS[unit]
    raw = np.ma.filled(np.ma.masked_invalid(surface.heights()).astype(np.float64), np.nan) / per_metre
    content: dict[str, Any] = {"height": raw, "scale": f"channel {channel.name!r} in {unit}"}
    factor = 1.0 if channel.height_scale_factor is None else abs(float(channel.height_scale_factor))
    content["count"] = factor / per_metre  # metres per stored number
    if surface.dim == 1:
        return content | {"position": np.asarray(surface.positions(), dtype=np.float64) / per_metre}
    size_x, size_y = (float(size) / per_metre for size in surface.physical_sizes)
    # SurfaceTopography keeps x first; here a row is a line along x
    return content | {"height": raw.T, "dx": size_x / raw.shape[0], "dy": size_y / raw.shape[1]}


def _confined(path: Path, answer: Path) -> str | None:
    """Read with bounded memory; return what was wrong, as one line."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    try:
        np.savez(answer, **_load(path))
    except MemoryError:
        return f"it needs more than {_MEMORY >> 30} GiB of memory"
    except Exception as error:  # a foreign reader may raise anything; whatever it is becomes one line
        return " ".join(str(error).split())[:200] or type(error).__name__
    return None


if __name__ == "__main__":
    sys.exit(_confined(Path(sys.argv[1]), Path(sys.argv[2])))
