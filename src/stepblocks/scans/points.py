"""Clouds of points as height maps, and the files that hold them.

These are meshes, height images in JSON, and X3P with absolute axes.
"""

import base64
import json
from pathlib import Path

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.scan import Array, HeightMap

_MOST_EMPTY = 0.75  # part of a grid that may stay without a point [1]
_EVEN = 0.02  # scatter of steps that are equal, as a part of the step [1]
_MOST_CELLS = 64_000_000


def grid_points(x: Array, y: Array, z: Array, source: str, scale: str) -> HeightMap:
    """Put points [m] on the grid that they lie on, and say which it is.

    Where they lie on none, it is the nearest grid that holds each point within half a step.
    """
    known = np.isfinite(x) & np.isfinite(y)
    MetrologyError.require(
        known.all() or not np.isfinite(z[~known]).any(),
        f"positions must be finite numbers [{source}]",
    )
    x, y, z = x[known], y[known], z[known]
    MetrologyError.require(
        len(x) >= 4, f"points must lie on a grid, got {len(x)} points [{source}]"
    )
    axes = _find_axes(x, y)
    shape = tuple(len(axis) for axis in axes)
    MetrologyError.require(
        min(shape) >= 2
        and (1.0 - _MOST_EMPTY) * shape[0] * shape[1] <= len(x)
        and max(shape) <= _MOST_CELLS / min(shape),
        f"points must lie on a grid, got {len(x)} points on {shape[0]} columns and "
        f"{shape[1]} rows [{source}]",
    )
    steps = [(axis[-1] - axis[0]) / (len(axis) - 1) for axis in axes]
    grid = zip((x, y), axes, steps, strict=True)
    column, row = (np.rint((one - axis[0]) / step).astype(int) for one, axis, step in grid)
    off = max(
        float(np.abs(x - axes[0][column]).max() / steps[0]),
        float(np.abs(y - axes[1][row]).max() / steps[1]),
    )
    height, count = np.zeros(shape[::-1]), np.zeros(shape[::-1])
    seen = np.isfinite(z)
    np.add.at(height, (row[seen], column[seen]), z[seen])
    np.add.at(count, (row[seen], column[seen]), 1.0)
    height = np.where(count > 0.0, height / np.maximum(count, 1.0), np.nan)
    if off > _EVEN:
        scale += (
            f"; points set on a grid of {steps[0] * 1e6:.4g} x {steps[1] * 1e6:.4g} um, up to "
            f"{off:.2f} of a step off"
        )
    return HeightMap(height, steps[0], steps[1], source=source, scale=scale)


def _find_axes(x: Array, y: Array) -> list[Array]:
    # Columns and rows of a grid: exact where positions repeat, else as many equal steps as the
    # points themselves take.
    exact = [_find_exact_axis(one) for one in (x, y)]
    counts = [0 if one is None else len(one) for one in exact]
    if not any(counts):
        # points come line by line: along a line they step evenly
        along = [np.abs(np.diff(one)) for one in (x, y)]
        uneven = [
            float(np.median(np.abs(step - np.median(step))) / max(np.median(step), 1e-15))
            for step in along
        ]
        fast = int(np.argmin(uneven))
        extents = [float(np.ptp(one)) for one in (x, y)]
        even = (
            np.median(along[fast])
            if uneven[fast] < _EVEN
            else np.sqrt(extents[0] * extents[1] / len(x))
        )
        MetrologyError.require(
            even > 0.0,
            "points must lie on a grid: resample a free surface, as of a tooth, on one "
            f"first, got {len(x)} points, most of them on one line",
        )
        counts[fast] = round(extents[fast] / float(even)) + 1
    counts = [count or max(round(len(x) / max(counts)), 1) for count in counts]
    return [
        np.linspace(one.min(), one.max(), count) if axis is None else axis
        for axis, count, one in zip(exact, counts, (x, y), strict=True)
    ]


def _find_exact_axis(positions: Array) -> Array | None:
    # Positions that repeat in equal steps, columns that are missing everywhere put in; None where
    # there are none.
    values = np.unique(positions)
    extent = float(values[-1] - values[0])
    steps = np.diff(values)
    real = steps > 1e-6 * extent
    if not real.any():
        return values[:1]
    merged = values[np.concatenate([[True], steps > 0.1 * float(np.median(steps[real]))])]
    gaps = np.diff(merged)
    whole = np.maximum(np.rint(gaps / np.median(gaps)), 1.0)
    step = extent / float(whole.sum())
    if (
        len(merged) > 0.5 * len(positions)
        or (np.abs(gaps - whole * step) > _EVEN * step * whole).any()
    ):
        return None
    return np.linspace(values[0], values[-1], int(whole.sum()) + 1)


def read_points(path: Path, sizes: dict[str, tuple[float, float]]) -> HeightMap:
    """Read a PLY, STL, OBJ or JSON file, whose numbers have no unit of their own.

    The size of a stored 1 is given for each axis.
    """
    missing = [axis for axis in "xyz" if axis not in sizes]
    MetrologyError.require(
        not missing,
        f"a unit must be given for a {path.suffix} file, which states none, as mm or "
        f"x=mm,y=mm,z=um [{path.name}]",
    )
    per = np.array([sizes[axis][0] / sizes[axis][1] for axis in "xyz"])
    if path.suffix.lower() == ".json":
        return _read_json_image(path, per)
    import meshio

    points = np.asarray(meshio.read(path).points, dtype=np.float64)
    MetrologyError.require(
        points.ndim == 2 and points.shape[1] == 3,
        f"points must be rows of x, y, z, got shape {points.shape}",
    )
    x, y, z = (np.unique(points, axis=0) * per).T
    return grid_points(x, y, z, path.name, "unit as given")


def _read_json_image(path: Path, per: Array) -> HeightMap:
    # Height image of a line camera: size of a pixel, and big- or little-endian counts in base64, of
    # which 0 is missing.
    # one, or lists of them
    stored = np.ravel(np.array(json.loads(path.read_text(encoding="utf-8")), dtype=object))
    found = [one["data"] for one in stored if one.get("class") == "Image"]
    image = next(one for one in found if one["Data"]["ImageType"] in ("uint16", "float32"))
    data, size, origin = image["Data"], image["PixelSize"], image["Origin"]
    kind = ("<" if data["Pixels"]["endian"] == "little" else ">") + {
        "uint16": "u2",
        "float32": "f4",
    }[data["ImageType"]]
    raw = np.frombuffer(base64.b64decode(data["Pixels"]["data"]), kind)
    counts = raw.reshape(data["Height"], data["Width"]).astype(np.float64)
    if image.get("HandleZeroPixels") == "MissingData":
        counts[counts == 0.0] = np.nan
    z = (counts * size["z"] + origin["z"]) * per[2]
    dx, dy, count = (size[axis] * one for axis, one in zip("xyz", per, strict=True))
    return HeightMap(z, dx, dy, path.name, "height image in the unit given", count)
