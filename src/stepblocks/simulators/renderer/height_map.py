"""A height map prepared for rendering: which sample the ball touches over every node, computed once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.artefacts.heightfield import relief
from stepblocks.contact.path.map import map_path
from stepblocks.contact.path.tip import Ball
from stepblocks.errors import HapticsError
from stepblocks.parts.margins.declaration import CrownOnTooth
from stepblocks.parts.set import Surface

_PLANE = 1e-13  # second difference of a path that is plane, up to rounding [m]
_MARGIN = 60e-6  # of a crown's map on either side of what the ball covers [m]


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights on a regular grid, the ball that feels them, and where it touches."""

    # shape (rows, columns); z [m]; rows ascend in y, columns in x; NaN where nothing was measured
    heights: NDArray[np.float64]
    # shape (rows, columns); Flat index of the sample under the ball over each node; -1 for none
    touched: NDArray[np.int64]
    # shape (rows, columns); How far the ball's path is plane around each node [m]: so far the proxy may go in one
    # step
    clear: NDArray[np.float64]
    origin: tuple[float, float]  # Position of the first sample and distance of neighbours, in x and y [m]
    spacing: tuple[float, float]
    ball_radius: float  # R [m]


def height_map(
    heights: ArrayLike, spacing: tuple[float, float], ball_radius: float, origin: tuple[float, float] = (0.0, 0.0)
) -> HeightMap:
    """Prepare any height map, nominal or scanned."""
    if not all(math.isfinite(value) for value in origin):
        raise HapticsError(f"origin must be finite, got {origin}")
    z = np.ascontiguousarray(heights, dtype=np.float64)
    path = map_path(z, (spacing[1], spacing[0]), Ball(ball_radius))
    assert path.contact is not None
    clear = _clear(path.height, spacing)
    return HeightMap(z, np.ascontiguousarray(path.contact), clear, origin, spacing, ball_radius)


def _clear(path: NDArray[np.float64], spacing: tuple[float, float]) -> NDArray[np.float64]:
    """Distance from each node to the nearest at which the path bends, or is missing [m]."""
    from scipy.ndimage import distance_transform_edt

    bends = ~np.isfinite(path)
    for axis in (0, 1):
        if path.shape[axis] > 2:
            turn = np.abs(np.diff(path, 2, axis=axis))
            inner = [slice(None), slice(None)]
            inner[axis] = slice(1, -1)
            bends[tuple(inner)] |= ~(turn <= _PLANE)
    if not bends.any():
        return np.full(path.shape, max(size * step for size, step in zip(path.shape[::-1], spacing, strict=True)))
    return np.asarray(distance_transform_edt(~bends, sampling=spacing[::-1]))


def map_of(stimulus: Surface, ball_radius: float) -> HeightMap:
    """Prepare the surface of a stimulus around its working edge."""
    half = ball_radius + _MARGIN if isinstance(stimulus, CrownOnTooth) else None
    field = relief(stimulus, ball_radius, half)
    origin = (float(field.x[0]), float(field.y[0]))
    spacing = (float(field.x[-1] - field.x[0]) / (len(field.x) - 1), float(field.y[1] - field.y[0]))
    return height_map(field.heights, spacing, ball_radius, origin)
