"""Height field of the working surface: float32 TIFF and npz, with a sidecar.

16 bits would quantise heights to 3 nm.
"""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import HapticsError
from stepblocks.parts.kind import Part

SPACING = 2e-6  # distance of neighbouring samples in x and y [m]
_HALF_X = 1e-3
_HALF_Y = 0.1e-3


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
    """
    return np.tile(
        part.counterface().heights(_choose_positions(part)), (len(_list_positions(_HALF_Y)), 1)
    )


def _choose_positions(part: Part) -> NDArray[np.float64]:
    # Choose positions across the edge so that none lies on a corner of the profile
    corners = np.array(part.counterface().breakpoints)
    for shift in (0.0, 0.25, -0.25, 0.125, -0.125):
        x = _list_positions(_HALF_X) + shift * SPACING
        if np.abs(x[:, None] - corners).min() > 0.05 * SPACING:
            return x
    raise HapticsError(
        f"a height field of {SPACING:g} m spacing cannot keep clear of the corners of {part.id}"
    )


def _list_positions(half: float) -> NDArray[np.float64]:
    count = round(half / SPACING)
    return np.asarray((np.arange(-count, count) + 0.5) * SPACING, dtype=np.float64)


def write_height_field(stem: Path, part: Part) -> list[Path]:
    """Write TIFF, npz and sidecar."""
    import tifffile

    heights = sample_height_field(part)
    tiff, npz, sidecar = (
        stem.with_name(stem.name + suffix) for suffix in (".tiff", ".npz", ".json")
    )
    tifffile.imwrite(
        tiff,
        (heights * 1e6).astype(np.float32),
        compression="zlib",
        description="heights in um",
        software="stepblocks",
    )
    np.savez_compressed(
        npz, height_m=heights, x_m=_choose_positions(part), y_m=_list_positions(_HALF_Y)
    )
    described: dict[str, object] = {
        "schema": 1,
        "stimulus": part.id,
        "files": {
            tiff.name: {"unit": "um", "dtype": "float32"},
            npz.name: {"unit": "m", "dtype": "float64", "arrays": ["height_m", "x_m", "y_m"]},
        },
        "shape_rows_columns": list(heights.shape),
        "spacing_x_m": SPACING,
        "spacing_y_m": SPACING,
        "origin_x_m": float(_choose_positions(part)[0]),
        "origin_y_m": float(_list_positions(_HALF_Y)[0]),
        "origin": "position of row 0, column 0 in the frame of the part; its z = 0 is the lower "
        "working face",
        "row_order": "row 0 lies at the smallest y, rows ascend in y",
        "column_order": "column 0 lies at the smallest x, columns ascend in x",
        "axes": "x across the edge, y along it, z up",
        "handedness": "right-handed",
        "sampling": "point values; no sample lies on an edge",
    }
    sidecar.write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8", newline="\n")
    return [tiff, npz, sidecar]
