"""Points as meshes and as JSON."""

from pathlib import Path

from stepblocks.scans.formats.reader import LoadedScan, ReadOptions, ScanReader
from stepblocks.scans.points import read_points_as_map
from stepblocks.scans.units import parse_units


class PointReader(ScanReader):
    """Numbers without a unit, which the user states."""

    form = "points"
    endings = (".ply", ".stl", ".obj", ".pcd", ".json")
    takes_unit = True
    has_header = False

    def read(self, path: Path, request: ReadOptions) -> LoadedScan:
        """Read points as a map on the grid that they lie on."""
        return LoadedScan(read_points_as_map(path, parse_units(request.unit)))
