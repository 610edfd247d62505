"""Clouds of points as height maps, and the files that hold them.

These are meshes, height images in JSON, and X3P with absolute axes.
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.files.stl import read_stl
from stepblocks.files.wavefront import read_obj
from stepblocks.scans.pcd import read_pcd_points
from stepblocks.scans.scan import Array, HeightMap
from stepblocks.scans.units import StoredLength

_MOST_EMPTY = 0.75  # part of a grid that may stay without a point [1]
_EVEN = 0.02  # scatter of steps that are equal, as a part of the step [1]
_MOST_CELLS = 64_000_000
_LEAST_POINTS = 4
# Positions closer than this part of the extent are the same position [1]
_SAME_POSITION = 1e-6
# Steps below this part of the median step are scatter within one column [1]
_SCATTER = 0.1
_MOST_DISTINCT = 0.5  # distinct positions of a grid, as a part of its points [1]
_SMALLEST_STEP = 1e-15  # keeps the scatter of steps finite [m]
_PIXEL_TYPES = {"uint16": "u2", "float32": "f4"}


def make_map_from_points(x: Array, y: Array, z: Array, source: str, scale: str) -> HeightMap:
    """Put points on the grid that they lie on.

    Where they lie on none, it is the nearest grid that holds each point within half a step.

    Parameters
    ----------
    x, y, z : array, shape (n,)
        Positions and heights [m]; a point whose height is missing may miss its position.
    source : str
        Name of the file.
    scale : str
        What is known of the units; the grid is added where it is not exact.

    Returns
    -------
    HeightMap
        Mean height in each cell, nan where no point lies.

    Raises
    ------
    MetrologyError
        If the points lie on no grid.
    """
    placed = np.isfinite(x) & np.isfinite(y)
    if np.isfinite(z[~placed]).any():
        raise MetrologyError(f"positions must be finite numbers [{source}]")
    x, y, z = x[placed], y[placed], z[placed]
    if len(x) < _LEAST_POINTS:
        raise MetrologyError(f"points must lie on a grid, got {len(x)} points [{source}]")
    along_x, along_y = _find_grid_axes(x, y)
    _refuse_unfit_grid(len(x), len(along_x), len(along_y), source)
    dx = _compute_mean_step(along_x)
    dy = _compute_mean_step(along_y)
    column = np.rint((x - along_x[0]) / dx).astype(int)
    row = np.rint((y - along_y[0]) / dy).astype(int)
    shape = (len(along_y), len(along_x))
    height = _average_in_cells(shape, row, column, z)
    off_x = float(np.abs(x - along_x[column]).max() / dx)
    off_y = float(np.abs(y - along_y[row]).max() / dy)
    off = max(off_x, off_y)
    if off > _EVEN:
        scale += (
            f"; points set on a grid of {dx * 1e6:.4g} x {dy * 1e6:.4g} um, up to "
            f"{off:.2f} of a step off"
        )
    return HeightMap(height, dx, dy, source=source, scale=scale)


def _refuse_unfit_grid(point_count: int, column_count: int, row_count: int, source: str) -> None:
    """Refuse a grid that is a line, has too many cells, or leaves too many of them empty."""
    shortest = min(column_count, row_count)
    is_line = shortest < 2
    is_too_large = max(column_count, row_count) > _MOST_CELLS / shortest
    is_empty = (1.0 - _MOST_EMPTY) * column_count * row_count > point_count
    if is_line or is_too_large or is_empty:
        raise MetrologyError(
            f"points must lie on a grid, got {point_count} points on {column_count} columns and "
            f"{row_count} rows [{source}]"
        )


def _compute_mean_step(ascending_positions: Array) -> float:
    """Return the mean step of ascending positions [m]."""
    return float(
        (ascending_positions[-1] - ascending_positions[0]) / (len(ascending_positions) - 1)
    )


def _average_in_cells(
    grid_shape: tuple[int, int],
    row_indices: NDArray[np.int64],
    column_indices: NDArray[np.int64],
    z: Array,
) -> Array:
    """Average the heights of the points of each cell, nan where there are none."""
    height = np.zeros(grid_shape)
    count = np.zeros(grid_shape)
    measured = np.isfinite(z)
    cells = (row_indices[measured], column_indices[measured])
    np.add.at(height, cells, z[measured])
    np.add.at(count, cells, 1.0)
    return np.where(count > 0.0, height / np.maximum(count, 1.0), np.nan)


def _find_grid_axes(x: Array, y: Array) -> tuple[Array, Array]:
    """Find the columns and the rows of the grid on which points lie.

    They are exact where positions repeat; otherwise as many equal steps as the points need.
    """
    exact_x = _find_exact_axis_positions(x)
    exact_y = _find_exact_axis_positions(y)
    if exact_x is not None and exact_y is not None:
        return exact_x, exact_y
    columns = 0 if exact_x is None else len(exact_x)
    rows = 0 if exact_y is None else len(exact_y)
    if exact_x is None and exact_y is None:
        columns, rows = _count_columns_or_rows(x, y)
    longest = max(columns, rows)
    quotient = max(round(len(x) / longest), 1)
    along_x = exact_x
    if along_x is None:
        along_x = np.linspace(x.min(), x.max(), columns or quotient)
    along_y = exact_y
    if along_y is None:
        along_y = np.linspace(y.min(), y.max(), rows or quotient)
    return along_x, along_y


def _count_columns_or_rows(x: Array, y: Array) -> tuple[int, int]:
    """Count the columns, or the rows, of points that come line by line.

    Along a line they step evenly. Where they do so in neither direction, the cells are square.
    The result is columns and rows, 0 for the direction that is still open.
    """
    scatter_x, step_x = _compute_step_scatter_and_median(x)
    scatter_y, step_y = _compute_step_scatter_and_median(y)
    extent_x = float(np.ptp(x))
    extent_y = float(np.ptp(y))
    x_is_fast = scatter_x <= scatter_y
    if min(scatter_x, scatter_y) < _EVEN:
        step = step_x if x_is_fast else step_y
    else:
        step = float(np.sqrt(extent_x * extent_y / len(x)))
    if not step > 0.0:
        raise MetrologyError(
            "points must lie on a grid: resample a free surface, as of a tooth, on one "
            f"first, got {len(x)} points, most of them on one line"
        )
    if x_is_fast:
        return round(extent_x / step) + 1, 0
    return 0, round(extent_y / step) + 1


def _compute_step_scatter_and_median(positions: Array) -> tuple[float, float]:
    """Compute the scatter of the steps between neighbours [1] and the median step [m]."""
    steps = np.abs(np.diff(positions))
    median = np.median(steps)
    scatter = np.median(np.abs(steps - median)) / max(median, _SMALLEST_STEP)
    return float(scatter), float(median)


def _find_exact_axis_positions(positions: Array) -> Array | None:
    """Find positions that repeat in equal steps, those that are missing everywhere put in.

    The result is None where there are none.
    """
    values = np.unique(positions)
    extent = float(values[-1] - values[0])
    steps = np.diff(values)
    is_real = steps > _SAME_POSITION * extent
    if not is_real.any():
        return values[:1]
    least = _SCATTER * float(np.median(steps[is_real]))
    merged = values[np.concatenate([[True], steps > least])]
    if len(merged) > _MOST_DISTINCT * len(positions):
        return None
    gaps = np.diff(merged)
    whole_steps = np.maximum(np.rint(gaps / np.median(gaps)), 1.0)
    step = extent / float(whole_steps.sum())
    if (np.abs(gaps - whole_steps * step) > _EVEN * step * whole_steps).any():
        return None
    return np.linspace(values[0], values[-1], int(whole_steps.sum()) + 1)


def read_points_as_map(path: Path, units_by_axis: Mapping[str, StoredLength]) -> HeightMap:
    """Read points whose numbers have no unit of their own.

    Parameters
    ----------
    path : Path
        A PLY, STL, OBJ, PCD or JSON file.
    units_by_axis : mapping of str to StoredLength
        Length of a stored 1 for each axis.

    Raises
    ------
    MetrologyError
        If a unit is missing, or the points lie on no grid.
    """
    if not {"x", "y", "z"} <= set(units_by_axis):
        raise MetrologyError(
            f"a unit must be given for a {path.suffix} file, which states none, as mm or "
            f"x=mm,y=mm,z=um [{path.name}]"
        )
    metres = np.array([units_by_axis[axis].metres for axis in "xyz"])
    if path.suffix.lower() == ".json":
        return _read_json_height_image(path, metres)
    points = _read_vertices(path)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MetrologyError(f"points must be rows of x, y, z, got shape {points.shape}")
    x, y, z = (np.unique(points, axis=0) * metres).T
    return make_map_from_points(x, y, z, path.name, "unit as given")


def _read_vertices(path: Path) -> Array:
    """Read vertices of a mesh or points of a cloud, in the unit of the file, shape (n, 3)."""
    ending = path.suffix.lower()
    if ending == ".stl":
        return read_stl(path).vertices
    if ending == ".obj":
        return read_obj(path).vertices
    if ending == ".pcd":
        return read_pcd_points(path)
    import meshio

    return np.asarray(meshio.read(path, file_format="ply").points, dtype=np.float64)


@dataclass(frozen=True)
class _HeightImage:
    """Height image of a line camera: counts in base64, and the size of a count along each axis."""

    pixel_type: str
    is_little_endian: bool
    pixels: str  # base64
    rows: int
    columns: int
    size: Mapping[str, float]  # of a pixel, and of a count in z
    height_of_zero: float
    zero_is_missing: bool

    def decode_heights(self) -> Array:
        """Decode the heights in the units of the file, shape (rows, columns)."""
        order = "<" if self.is_little_endian else ">"
        kind = order + _PIXEL_TYPES[self.pixel_type]
        raw = np.frombuffer(base64.b64decode(self.pixels), kind)
        counts = raw.reshape(self.rows, self.columns).astype(np.float64)
        if self.zero_is_missing:
            counts[counts == 0.0] = np.nan
        return counts * self.size["z"] + self.height_of_zero


def _read_json_height_image(path: Path, metres_per_stored_1: Array) -> HeightMap:
    """Read the first height image of a JSON file; `metres_per_stored_1` has the shape (3,)."""
    image = _find_first_height_image(json.loads(path.read_text(encoding="utf-8")))
    x, y, z = metres_per_stored_1
    return HeightMap(
        image.decode_heights() * z,
        image.size["x"] * x,
        image.size["y"] * y,
        path.name,
        "height image in the unit given",
    )


def _find_first_height_image(json_value: Any) -> _HeightImage:
    """Find the first height image in an object, or in lists of objects."""
    for entry in np.ravel(np.array(json_value, dtype=object)):
        if entry.get("class") != "Image":
            continue
        image = entry["data"]
        data = image["Data"]
        if data["ImageType"] not in _PIXEL_TYPES:
            continue
        return _HeightImage(
            pixel_type=data["ImageType"],
            is_little_endian=data["Pixels"]["endian"] == "little",
            pixels=data["Pixels"]["data"],
            rows=data["Height"],
            columns=data["Width"],
            size=image["PixelSize"],
            height_of_zero=image["Origin"]["z"],
            zero_is_missing=image.get("HandleZeroPixels") == "MissingData",
        )
    raise MetrologyError("file must hold a height image of uint16 or float32, got none")
