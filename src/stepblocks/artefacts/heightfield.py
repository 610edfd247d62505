"""Height field of the working surface: float32 TIFF and npz, with a sidecar.

16 bits would quantise heights to 3 nm.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import HapticsError
from stepblocks.parts.kind import Part

Positions = NDArray[np.float64]

SPACING = 2e-6  # distance of neighbouring samples in x and y [m]
_HALF_X = 1e-3
_HALF_Y = 0.1e-3
_SHIFTS = (0.0, 0.25, -0.25, 0.125, -0.125)  # of the samples, tried in this order [spacings]
_LEAST_CLEARANCE = 0.05  # of a sample from a corner of the profile [spacings]


@dataclass(frozen=True)
class _HeightField:
    """Heights over a grid.

    Attributes
    ----------
    heights : array, shape (rows, columns)
        Rows ascend in y, columns in x [m].
    x, y : array
        Positions of the columns and of the rows [m].
    """

    heights: NDArray[np.float64]
    x: Positions
    y: Positions


def sample_height_field(part: Part) -> NDArray[np.float64]:
    """Sample the working surface around the edge.

    Parameters
    ----------
    part : Part
        A part whose surface is straight along y.

    Returns
    -------
    ndarray, shape (rows, columns)
        Heights [m]; rows ascend in y, columns in x, the samples lie between the edges rather than
        on them.

    Raises
    ------
    HapticsError
        If no shift of the samples keeps clear of all corners of the profile.
    """
    return _sample_heights_on_grid(part).heights


def _sample_heights_on_grid(part: Part) -> _HeightField:
    """Sample the heights of the working surface on a grid around the edge [m]."""
    x = _choose_positions_across_edges(part)
    y = _list_cell_middles(-_HALF_Y, _HALF_Y)
    return _HeightField(np.tile(part.sample_surface(x), (len(y), 1)), x, y)


def _choose_positions_across_edges(part: Part) -> Positions:
    """Choose positions across all edges so that none lies on a corner of the profile [m]."""
    corners = np.array(part.surface_corners)
    unshifted = _list_cell_middles(-_HALF_X, part.last_edge + _HALF_X)
    for shift in _SHIFTS:
        x = unshifted + shift * SPACING
        if np.abs(x[:, None] - corners).min() > _LEAST_CLEARANCE * SPACING:
            return x
    raise HapticsError(
        f"a height field of {SPACING:g} m spacing cannot keep clear of the corners of {part.id}"
    )


def _list_cell_middles(low: float, high: float) -> Positions:
    """List positions between two ends, in the middles of cells of `SPACING` [m]."""
    first = round(low / SPACING)
    last = round(high / SPACING)
    return np.asarray((np.arange(first, last) + 0.5) * SPACING, dtype=np.float64)


def write_height_field(stem: Path, part: Part) -> list[Path]:
    """Write TIFF, npz and sidecar.

    Parameters
    ----------
    stem : Path
        The files without their endings.
    part : Part
        A part whose surface is straight along y.

    Returns
    -------
    list of Path
        The files.
    """
    import tifffile

    field = _sample_heights_on_grid(part)
    tiff = stem.with_name(f"{stem.name}.tiff")
    npz = stem.with_name(f"{stem.name}.npz")
    sidecar = stem.with_name(f"{stem.name}.json")
    tifffile.imwrite(
        tiff,
        (field.heights * 1e6).astype(np.float32),
        compression="zlib",
        description="heights in um",
        software="stepblocks",
    )
    np.savez_compressed(npz, height_m=field.heights, x_m=field.x, y_m=field.y)
    description = _make_sidecar_content(field, part.id, tiff.name, npz.name)
    sidecar.write_text(json.dumps(description, indent=2) + "\n", encoding="utf-8", newline="\n")
    return [tiff, npz, sidecar]


def _make_sidecar_content(
    field: _HeightField, identity: str, tiff: str, npz: str
) -> dict[str, object]:
    """Describe the files, where their samples lie, and how their axes run, as JSON holds it."""
    return {
        "schema": 1,
        "stimulus": identity,
        "files": {
            tiff: {"unit": "um", "dtype": "float32"},
            npz: {"unit": "m", "dtype": "float64", "arrays": ["height_m", "x_m", "y_m"]},
        },
        "shape_rows_columns": list(field.heights.shape),
        "spacing_x_m": SPACING,
        "spacing_y_m": SPACING,
        "origin_x_m": float(field.x[0]),
        "origin_y_m": float(field.y[0]),
        "origin": "position of row 0, column 0 in the frame of the part; its z = 0 is the lower "
        "working face",
        "row_order": "row 0 lies at the smallest y, rows ascend in y",
        "column_order": "column 0 lies at the smallest x, columns ascend in x",
        "axes": "x across the edge, y along it, z up",
        "handedness": "right-handed",
        "sampling": "point values; no sample lies on an edge",
    }
