"""Files of instruments, read by SurfaceTopography and x3pio in a process of their own.

Their readers are made for honest files. Here they run with a limit on memory and time (`read_foreign`), so that a file
that lies about its size ends in one line and not in a full machine. ``python -m`` on this module is that process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.artefacts.scans.text import LENGTH_UNITS
from stepblocks.errors import MetrologyError

FORMATS: dict[str, str] = {
    ".x3p": "x3p",
    ".sdf": "sdf",
    ".sur": "sur",
    ".plux": "plux",
    ".gwy": "gwy",
    ".opdx": "opdx",
    ".nid": "ezd",
    ".opd": "opd",
    ".datx": "datx",
    ".al3d": "al3d",
    ".plu": "plu",
    ".zon": "zon",
    ".vk4": "vk",
    ".ezd": "ezd",
}

_MOST_POINTS = 64_000_000
_MOST_UNPACKED = 2**30
_MEMORY = 4 * 2**30
_SECONDS = 120


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
            unpacked = sum(entry.file_size for entry in archive.infolist())
            entries = len(archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise MetrologyError(f"archive must be sound, got {error} [{path.name}]") from error
    if unpacked > _MOST_UNPACKED or entries > 10_000:
        raise MetrologyError(
            f"archive must unpack to at most {_MOST_UNPACKED >> 20} MiB in 10000 files, got {unpacked >> 20} MiB in "
            f"{entries} [{path.name}]"
        )


def _load(path: Path) -> dict[str, Any]:
    """Read in this process; only the confined child calls it."""
    if path.suffix.lower() == ".x3p":
        return _load_x3p(path)
    return _load_by_surfacetopography(path)


def _load_x3p(path: Path) -> dict[str, Any]:
    import x3pio

    summary = x3pio.info(str(path))
    if int(np.prod(summary.shape)) > _MOST_POINTS:
        raise MetrologyError(f"scan must have at most {_MOST_POINTS} points, got {summary.shape}")
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
    channels = [channel for channel in reader.channels if str(channel.data_kind).endswith("HEIGHT")]
    if not channels:
        raise MetrologyError("file must hold a channel of heights, got none")
    channel = channels[0]
    unit = channel.unit
    if unit not in LENGTH_UNITS:
        raise MetrologyError(f"channel {channel.name!r} must say its unit of length, got {unit!r}")
    if channel.physical_sizes is None:
        raise MetrologyError(f"channel {channel.name!r} must say its lateral size, got none")
    if int(np.prod(channel.nb_grid_pts)) > _MOST_POINTS:
        raise MetrologyError(f"scan must have at most {_MOST_POINTS} points, got {channel.nb_grid_pts}")
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


def _confined(path: Path, answer: Path) -> int:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    try:
        content = _load(path)
        np.savez(answer, **content)
    except MemoryError:
        print(f"it needs more than {_MEMORY >> 30} GiB of memory", file=sys.stderr)
        return 3
    except Exception as error:  # a foreign reader may raise anything; whatever it is becomes one line
        text = " ".join(str(error).split()) or type(error).__name__
        print(text[:200], file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(_confined(Path(sys.argv[1]), Path(sys.argv[2])))
