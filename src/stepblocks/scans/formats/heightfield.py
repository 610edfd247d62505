"""Height fields: TIFF, and the sidecar in JSON that this package writes beside its own.

A TIFF says nothing of its spacing. Of one that this package wrote the sidecar does; of any other
the user does.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.formats.reader import (
    MOST_UNPACKED_BYTES,
    LoadedScan,
    ReadOptions,
    ScanReader,
    check_point_count,
)
from stepblocks.scans.scan import Array, HeightMap
from stepblocks.scans.units import UNITS_PER_METRE, parse_units

_MOST_SIDECAR_BYTES = 1_000_000
_SIDECAR_FIELDS = {"files", "shape_rows_columns", "spacing_x_m", "spacing_y_m"}
_SCALE = "height field, spacing and unit by its sidecar"


class HeightFieldReader(ScanReader):
    """The sidecar of a height field, with the file of numbers that it names."""

    form = "heightfield"
    endings = (".json",)
    has_header = False

    def claims(self, path: Path) -> bool:
        """Tell whether a JSON file is the sidecar of a height field."""
        return _read_sidecar_or_none(path) is not None

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read the first of its files that lies beside it, the exact numbers first."""
        sidecar = _read_sidecar_or_none(path)
        if sidecar is None:
            raise ValueError("no sidecar of a height field")
        for name in sorted(sidecar["files"]):  # npz before tiff
            beside = path.with_name(Path(name).name)
            if beside.is_file():
                return LoadedScan(_read_height_field(beside, sidecar, path.name))
        raise MetrologyError(
            f"one of {', '.join(sidecar['files'])} must lie beside the sidecar [{path.name}]"
        )


class TiffReader(ScanReader):
    """A TIFF of one channel, by its sidecar or by the spacing and unit that the user states."""

    form = "tiff"
    endings = (".tif", ".tiff")
    takes_unit = True
    has_header = False

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read the heights; row 0 lies at y = 0."""
        sidecar = _read_sidecar_or_none(path.with_suffix(".json"))
        if sidecar is not None and path.name in sidecar["files"]:
            if request.unit is not None:
                raise MetrologyError(
                    f"unit must not be given for a height field whose sidecar says its own "
                    f"[{path.name}]"
                )
            return LoadedScan(_read_height_field(path, sidecar, path.name))
        units = parse_units(request.unit)
        if "z" not in units or not all(axis in units and units[axis].is_step for axis in "xy"):
            raise MetrologyError(
                "a TIFF states neither spacing nor unit: give them as x=0.5um,y=0.5um,z=nm "
                f"(--unit) [{path.name}]"
            )
        height = _read_tiff_heights(path) * units["z"].metres
        scale = "spacing and unit as given"
        return LoadedScan(HeightMap(height, units["x"].metres, units["y"].metres, path.name, scale))


def _read_sidecar_or_none(path: Path) -> dict[str, Any] | None:
    """Read a sidecar; None where a file is none."""
    try:
        if path.stat().st_size > _MOST_SIDECAR_BYTES:
            return None
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or not set(content) >= _SIDECAR_FIELDS:
        return None
    return content


def _read_height_field(path: Path, sidecar: Mapping[str, Any], place: str) -> HeightMap:
    """Read the numbers of a height field by its sidecar."""
    unit = sidecar["files"][path.name]["unit"]
    height = _read_npz_heights(path) if path.suffix.lower() == ".npz" else _read_tiff_heights(path)
    if list(height.shape) != sidecar["shape_rows_columns"]:
        raise MetrologyError(
            f"height field must have the {sidecar['shape_rows_columns']} points of its sidecar, "
            f"got {list(height.shape)} [{place}]"
        )
    spacing_x = float(sidecar["spacing_x_m"])
    spacing_y = float(sidecar["spacing_y_m"])
    return HeightMap(height / UNITS_PER_METRE[unit], spacing_x, spacing_y, place, _SCALE)


def _read_npz_heights(path: Path) -> Array:
    """Read the array of heights of an archive of numpy."""
    with np.load(path, allow_pickle=False) as archive:
        return np.asarray(archive["height_m"], dtype=np.float64)


def _read_tiff_heights(path: Path) -> Array:
    """Read a page of one channel, shape (rows, columns)."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        check_point_count(page.shape, path.name)
        if len(file.pages) != 1 or len(page.shape) != 2 or page.nbytes > MOST_UNPACKED_BYTES:
            raise MetrologyError(
                "a TIFF of heights must hold one page of one channel, got "
                f"{len(file.pages)} of shape {page.shape} [{path.name}]"
            )
        return np.asarray(page.asarray(), dtype=np.float64)
