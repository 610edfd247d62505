"""The path of a probe tip over a height map: exact dilation of its samples, in bounded memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.path import map_kernels
from stepblocks.contact.path.tip import Ball, Tip
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]
_BAND = 128  # rows worked on at a time
_LARGEST_REACH = 4096  # samples to either side; a larger tip is a wrong unit


@dataclass(frozen=True)
class TipMap:
    """Where the tip's lowest point lies over each sample of a height map."""

    height: Floats  # shape (rows, columns); Height of the tip's lowest point [m]; NaN where nothing lies under the tip
    contact: NDArray[np.int64] | None  # shape (rows, columns); Flat index of the sample that is touched; -1 for none
    # shape (rows, columns); False where missing samples or the edge of the map lie within the square around the tip
    # that could touch
    supported: NDArray[np.bool_]
    spacing: tuple[float, float]  # Distance of the samples along rows' axis (y) and columns' axis (x) [m]
    tip: Tip  # The tip

    def slope(self, axis: int = 1) -> Floats:
        """Slope of the tip's path along an axis [1], exact for the contact at each sample."""
        if self.contact is None:
            raise ContactError("slope needs the contacts: call map_path with contacts=True")
        if not isinstance(self.tip, Ball):
            raise ContactError("slope of a map is exact for a ball only")
        row, column = np.indices(self.height.shape)
        dy = (self.contact // self.height.shape[1] - row) * self.spacing[0]
        dx = (self.contact % self.height.shape[1] - column) * self.spacing[1]
        rise = np.sqrt(np.maximum(self.tip.radius**2 - dx * dx - dy * dy, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = (dx if axis == 1 else dy) / rise
        return np.where(self.contact >= 0, slope, np.nan)


def map_path(
    heights: ArrayLike,
    spacing: float | tuple[float, float],
    tip: Tip,
    *,
    contacts: bool = True,
    out: Floats | None = None,
) -> TipMap:
    """Dilate a height map by a tip of revolution.

    Parameters
    ----------
    heights : array_like, shape (rows, columns)
        Heights z [m]; NaN where nothing was measured. A memory map is read in bands.
    spacing : float or (float, float)
        Distance of the samples [m], of rows and of columns where they differ.
    tip : Ball or TipProfile
        Tip; a profile must be convex and symmetric, and is revolved about its axis.
    contacts : bool
        Whether to keep which sample is touched (8 bytes per sample).
    out : ndarray, shape (rows, columns), optional
        Where to put the result, for example a memory map.

    Returns
    -------
    TipMap
        Exact for the samples, as a non-flat grey dilation is.

    Raises
    ------
    ContactError
        If the map is not two-dimensional, empty, infinite or all missing, the spacing is not positive, or the tip is
        not one of revolution, reaches over too many samples, or is larger than the map.

    Notes
    -----
    Work grows like N R log R at worst, for N samples and R of them in the radius; memory beyond input and result is
    a band of ``128 + 2 R`` rows.

    Examples
    --------
    >>> flat = map_path(np.zeros((9, 9)), 10e-6, Ball(30e-6))
    >>> float(np.abs(flat.height).max())
    0.0
    """
    z = np.asarray(heights) if not isinstance(heights, np.ndarray) else heights
    dy, dx = spacing if isinstance(spacing, tuple) else (spacing, spacing)
    _check(z, dy, dx, tip)
    span = _span(z)
    drops, halves = _table(tip, dy, dx, span)
    rows, columns = z.shape
    depth = (len(halves) - 1) // 2
    if len(halves) > rows or drops.shape[1] > columns:
        raise ContactError(
            f"tip covers {len(halves)} x {drops.shape[1]} samples and must not be larger than the map, "
            f"{rows} x {columns}"
        )
    result = np.empty(z.shape) if out is None else out
    if result.shape != z.shape:
        raise ContactError(f"out must have the shape of the map, {z.shape}, got {result.shape}")
    touched = np.empty(z.shape, np.int64) if contacts else None
    supported = np.empty(z.shape, np.bool_)
    for start in range(0, rows, _BAND):
        stop = min(start + _BAND, rows)
        first, last = max(start - depth, 0), min(stop + depth, rows)
        band = np.array(z[first:last], dtype=np.float64)
        missing = np.isnan(band)
        band[missing] = -np.inf
        top = map_kernels.block_maxima(band)
        height, index = map_kernels.dilate_rows(band, top, start - first, stop - first, drops, halves)
        result[start:stop] = height
        if touched is not None:
            touched[start:stop] = np.where(index >= 0, index + first * columns, -1)
        supported[start:stop] = ~_near_missing(missing, depth, (drops.shape[1] - 1) // 2)[start - first : stop - first]
    width = (drops.shape[1] - 1) // 2
    supported[:depth] = supported[rows - depth :] = False
    supported[:, :width] = supported[:, columns - width :] = False
    return TipMap(result, touched, supported, (dy, dx), tip)


def _check(z: NDArray[np.float64], dy: float, dx: float, tip: Tip) -> None:
    if z.ndim != 2 or z.size == 0:
        raise ContactError(f"height map must be two-dimensional and not empty, got shape {z.shape}")
    for name, step in (("row spacing", dy), ("column spacing", dx)):
        if not (math.isfinite(step) and step > 0.0):
            raise ContactError(f"{name} must be positive and finite, got {step:g} m")
    if isinstance(tip, Ball):
        return
    mirrored = -tip.distance[::-1]
    if not tip.convex or not np.allclose(mirrored, tip.distance, rtol=1e-9, atol=0.0):
        raise ContactError("tip profile must be convex and symmetric about its axis to be revolved over a map")
    if not np.allclose(tip.elevation, tip.elevation[::-1], rtol=1e-9, atol=1e-12 * float(tip.elevation.max())):
        raise ContactError("tip profile must be convex and symmetric about its axis to be revolved over a map")


def _span(z: NDArray[np.float64]) -> float:
    """Height range of the map; infinite with missing samples, beside which the tip may rest on any of its parts."""
    low, high, whole = math.inf, -math.inf, True
    for start in range(0, z.shape[0], _BAND):
        band = z[start : start + _BAND]
        if np.isinf(band).any():
            raise ContactError("map heights must be finite or NaN for missing, got an infinity")
        finite = band[~np.isnan(band)]
        whole = whole and finite.size == band.size
        if finite.size:
            low, high = min(low, float(finite.min())), max(high, float(finite.max()))
    if low > high:
        raise ContactError("map has no height that is not NaN")
    return high - low if whole else math.inf


def _table(tip: Tip, dy: float, dx: float, span: float) -> tuple[Floats, NDArray[np.int64]]:
    """Height of the tip over its lowest point, cut to what a surface of this height range can touch."""
    reach = tip.reach[1]
    count = [math.floor(reach / step * (1.0 + 1e-12)) for step in (dy, dx)]
    if max(count) > _LARGEST_REACH:
        raise ContactError(
            f"tip reaches over {max(count)} samples, more than {_LARGEST_REACH}: check the units of spacing and tip"
        )
    y = np.arange(-count[0], count[0] + 1)[:, None] * dy
    x = np.arange(-count[1], count[1] + 1)[None, :] * dx
    distance = np.hypot(y, x)
    drops = tip.height(np.where(distance <= reach * (1.0 + 1e-12), np.minimum(distance, reach), np.inf))
    drops[drops > span * (1.0 + 1e-9)] = np.inf
    used = np.isfinite(drops)
    depth = int(used.any(axis=1).sum() - 1) // 2
    width = int(used.any(axis=0).sum() - 1) // 2
    drops = drops[count[0] - depth : count[0] + depth + 1, count[1] - width : count[1] + width + 1]
    halves = (np.isfinite(drops).sum(axis=1) - 1) // 2
    return np.ascontiguousarray(drops), halves.astype(np.int64)


def _near_missing(missing: NDArray[np.bool_], depth: int, width: int) -> NDArray[np.bool_]:
    from scipy.ndimage import maximum_filter1d

    if not missing.any():
        return missing
    near = maximum_filter1d(missing, 2 * depth + 1, axis=0, mode="constant")
    return np.asarray(maximum_filter1d(near, 2 * width + 1, axis=1, mode="constant"))
