"""Height fields against the closed form of the profile."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.parts.body import Block
from stepblocks.parts.kind import NANOMETRE, Part
from stepblocks.parts.verdict import Finding, Verdict

Heights = NDArray[np.float64]
_ARRAYS = ("height_m", "x_m", "y_m")
_BITS = 32.0  # of a height in a TIFF
# columns at either end of a field that are averaged, at most: further on lies a first edge
_MOST_OUTER = 400
_MICROMETRE = 1e-6  # unit of the heights in a TIFF [m]


@dataclass(frozen=True)
class _Axis:
    """Where the samples of a height field lie along x or y [m]."""

    origin: float
    spacing: float

    def list_positions(self, sample_count: int) -> Heights:
        """List the positions of so many samples [m]."""
        return np.asarray(self.origin + self.spacing * np.arange(sample_count), dtype=np.float64)


@dataclass(frozen=True)
class _Sidecar:
    """What stands beside a height field: its shape (rows, columns) and where its samples lie."""

    shape: Any
    x: _Axis
    y: _Axis


def judge_tiff_height_field(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge the depth and the heights of a TIFF."""
    content = read_confined(f"{__name__}:read_tiff_in_worker", path, raises=MetrologyError)
    heights = content["pixels"]
    bits = 8.0 * heights.dtype.itemsize
    is_floating = heights.dtype.kind == "f"
    yield Finding("bits per height, floating point", _BITS, bits * is_floating, 0.0, "count")
    yield from _judge_heights(
        path, part, heights.astype(np.float64) * _MICROMETRE, _read_sidecar(path)
    )


def read_tiff_in_worker(path: Path) -> dict[str, object]:
    """Read the heights of a TIFF as they are stored; runs in the confined process."""
    from PIL import Image

    with Image.open(path) as image:
        return {"pixels": np.asarray(image)}


def judge_npz_height_field(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge the heights and the positions of an npz."""
    content = read_confined(f"{__name__}:read_npz_in_worker", path, raises=MetrologyError)
    sidecar = _read_sidecar(path)
    yield from _judge_heights(path, part, content["height_m"], sidecar)
    # heights that are equal along y cannot tell swapped rows; the positions that the archive gives
    # them can
    yield _judge_positions("x", content["x_m"], sidecar.x)
    yield _judge_positions("y", content["y_m"], sidecar.y)


def read_npz_in_worker(path: Path) -> dict[str, object]:
    """Read the heights and positions of an npz; runs in the confined process."""
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return {name: np.asarray(archive[name], dtype=np.float64) for name in _ARRAYS}


def _read_sidecar(path: Path) -> _Sidecar:
    """Read where the samples of a height field lie."""
    try:
        side = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        return _Sidecar(
            side["shape_rows_columns"],
            _Axis(float(side["origin_x_m"]), float(side["spacing_x_m"])),
            _Axis(float(side["origin_y_m"]), float(side["spacing_y_m"])),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MetrologyError(
            f"needs its sidecar {path.stem}.json with shape, origin and spacing [{path}]"
        ) from error


def _judge_heights(
    path: Path, part: Part, heights: Heights, sidecar: _Sidecar
) -> Iterator[Verdict]:
    """Compare heights [m] with the closed form of the profile.

    The step is measured between the outer thirds.
    """
    if not isinstance(part, Block):
        raise MetrologyError(f"a height field belongs to a block, got {part.id} [{path}]")
    if heights.ndim != 2 or list(heights.shape) != sidecar.shape:
        raise MetrologyError(
            f"must have the rows and columns of its sidecar, {sidecar.shape}, got "
            f"{list(heights.shape)} [{path}]"
        )
    columns = heights.shape[1]
    positions = sidecar.x.list_positions(columns).tolist()
    expected = list(map(part.top, positions))
    worst = float(np.abs(heights - expected).max())
    yield Finding("largest error of a height", 0.0, worst, NANOMETRE)
    outer = min(columns // 3, _MOST_OUTER)
    lower = math.fsum(heights[:, :outer].mean(axis=0)) / outer
    upper = math.fsum(heights[:, -outer:].mean(axis=0)) / outer
    yield Finding("step between the outer thirds", part.rise, upper - lower, NANOMETRE)


def _judge_positions(axis_name: str, positions: Heights, axis: _Axis) -> Verdict:
    """Compare the positions [m] in an archive with those of its sidecar."""
    worst = math.inf
    if positions.ndim == 1 and positions.size:
        worst = float(np.abs(positions - axis.list_positions(positions.size)).max())
    return Finding(f"positions along {axis_name}", 0.0, worst, NANOMETRE)
