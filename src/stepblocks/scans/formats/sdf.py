"""ISO 25178-71 (SDF)."""

from pathlib import Path

import numpy as np

from stepblocks.scans.formats.reader import LoadedScan, ReadOptions, ScanReader, check_point_count
from stepblocks.scans.scan import HeightMap, ScannedProfile

_SCALE = "ISO 25178-71: heights in metres"


class SdfReader(ScanReader):
    """One profile or map, binary or as text; `sdfio` reads it."""

    form = "sdf"
    endings = (".sdf",)

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read the map, or the profile if it has one row."""
        import sdfio

        found = sdfio.read(str(path))
        check_point_count(found.data.shape, path.name)
        header = found.header
        height = np.atleast_2d(found.data)
        count = abs(header.z_scale)
        if len(height) > 1:
            return LoadedScan(
                HeightMap(height, header.x_scale, header.y_scale, path.name, _SCALE, count)
            )
        position = np.arange(height.size, dtype=np.float64) * header.x_scale
        return LoadedScan(ScannedProfile(position, height[0], path.name, _SCALE, count))
