"""ISO 25178-72 (X3P)."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.scans.formats.reader import LoadedScan, ReadOptions, ScanReader, check_point_count
from stepblocks.scans.points import make_map_from_points
from stepblocks.scans.scan import Array, HeightMap, ScannedProfile

if TYPE_CHECKING:
    from x3pio import Layer, ProfileLayer

_SCALE = "ISO 25178-72: heights in metres, checksums verified"


class X3pReader(ScanReader):
    """The first layer of an archive; `x3pio` reads it."""

    form = "x3p"
    endings = (".x3p",)

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read a profile, a map, or a cloud of points on the grid that they lie on."""
        import x3pio

        check_point_count(x3pio.info(str(path)).shape, path.name)
        layer = x3pio.read(str(path)).layers[0]
        if layer.z.ndim == 1 and isinstance(layer, x3pio.ProfileLayer):
            return LoadedScan(_make_profile_of_layer(layer, path.name))
        return LoadedScan(_make_map_of_layer(layer, path.name))


def _make_profile_of_layer(layer: "ProfileLayer", source: str) -> ScannedProfile:
    """Make a profile of a layer."""
    position = layer.x
    if position is None:
        position = np.arange(len(layer.z), dtype=np.float64) * layer.header.x.increment
    return ScannedProfile(position, layer.z, source, _SCALE, _get_count_height(layer))


def _make_map_of_layer(layer: "Layer", source: str) -> HeightMap:
    """Make a map of a layer, of a cloud of points by the grid that they lie on."""
    dx = layer.header.x.increment
    dy = layer.header.y.increment
    count = _get_count_height(layer)
    if layer.x is None and dx is not None and dy is not None:
        return HeightMap(layer.z, dx, dy, source, _SCALE, count)
    # a cloud of points, or absolute axes
    x, y, z = map(_flatten_to_floats, (layer.x, layer.y, layer.z))
    return replace(make_map_from_points(x, y, z, source, _SCALE), count=count)


def _flatten_to_floats(values: object) -> Array:
    """Return values as one row of float64, shape (n,)."""
    return np.ravel(np.asarray(values, dtype=np.float64))


def _get_count_height(layer: "Layer") -> float:
    """Return the height of one count [m]; an axis without an increment stores metres."""
    return abs(layer.header.z.increment or 1.0)
