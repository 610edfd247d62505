"""Depth of many small features in one map: rows levelled on a masked reference, floors against it.

Holes of a grating are too short for the windows of type A1. Here each row gets its own slope and offset (the drift of a
scanning instrument), from points that keep a stated distance to every edge; the feature never takes part in levelling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.scans.scan import HeightMap
from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import two_levels
from stepblocks.inspect.noise import Array, Mask, NoiseUncertainty, noise_uncertainty

_LEAST_FLOOR = 5  # points of a row in the features
_LEAST_REFERENCE = 20  # points of a row beside them
_SETTLED = 0.005  # deviation from the plateau that is no edge, as a part of the depth [1]
_LEAST_BANDS = 4  # of rows, over which a scatter is taken


@dataclass(frozen=True)
class MaskedStep:
    """Depth of the features of a map."""

    depth: float  # weighted mean over rows [m]; negative for ridges
    noise: NoiseUncertainty  # of the depth, from their scatter [m]
    exclusion: float  # distance that was kept to every edge [m]
    rows: int  # that took part
    features: int  # separate ones in the map
    profile: tuple[Array, Array]  # positions and levelled heights of the row with most floor [m], to be shown


def masked_step(scan: HeightMap, exclusion: float | None = None) -> MaskedStep:
    """Depth of holes, or height of bumps, over a map without missing points.

    `exclusion` is the distance to keep to every edge [m]; by default that at which both sides have settled.
    """
    from scipy import ndimage

    z = scan.height
    if not np.isfinite(z).all():
        raise MetrologyError(f"map must have no missing points for a masked evaluation [{scan.source}]")
    inside = _features(z)
    pitch = min(scan.dx, scan.dy)
    within, outside = (ndimage.distance_transform_edt(x, sampling=(scan.dy, scan.dx)) for x in (inside, ~inside))
    if exclusion is None:
        exclusion = _settling_distance(_plane_levelled(z, outside > 3.0 * pitch), within, outside, pitch)
    floor, reference = within > exclusion, outside > exclusion
    depths, weights = _row_depths(scan.x, z, floor, reference)
    known = np.isfinite(depths)
    if known.sum() < 3:
        rule = f"map must keep at least 3 rows with floor and reference beyond {exclusion * 1e6:.3g} um"
        raise MetrologyError(f"{rule}, got {int(known.sum())} [{scan.source}]")
    share = np.where(known, weights, 0.0)
    share /= share.sum()
    depth = float(np.sum(share[known] * depths[known]))
    noise = _by_bands(depths, share, depth, known)
    shown = int(np.argmax(np.where(known, weights, -1.0)))
    line = np.polynomial.Polynomial.fit(scan.x[reference[shown]], z[shown, reference[shown]], 1)
    profile = scan.x, z[shown] - line(scan.x)
    features = int(ndimage.label(inside)[1])
    return MaskedStep(depth, noise, exclusion, int(known.sum()), features, profile)


def _by_bands(depths: Array, share: Array, depth: float, known: Mask) -> NoiseUncertainty:
    """Scatter over bands of rows that cross the same features; rows within a band are not independent of one another.

    Bands whose variance goes as one over their share give ``sum(share deviation^2) / (bands - 1)`` without bias and with
    exactly one degree of freedom less than bands; a band that the map cuts to a sliver counts with its neighbour.
    """
    rows = np.flatnonzero(known)
    bands = _without_slivers(np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1), share)
    if len(bands) < _LEAST_BANDS:
        return noise_uncertainty(share, depths - depth, known, [np.ones(len(depths))])
    parts = [np.sum(share[band] * (depths[band] - depth)) ** 2 / np.sum(share[band]) for band in bands]
    return NoiseUncertainty(float(np.sqrt(np.sum(parts) / (len(bands) - 1))), len(bands) - 1.0)


def _without_slivers(bands: list[NDArray[np.intp]], share: Array) -> list[NDArray[np.intp]]:
    """Join bands at either end that hold less than half of the usual share to their neighbours."""
    least = 0.5 * float(np.median([share[band].sum() for band in bands]))
    if len(bands) > 1 and share[bands[0]].sum() < least:
        bands = [np.concatenate(bands[:2]), *bands[2:]]
    if len(bands) > 1 and share[bands[-1]].sum() < least:
        bands = [*bands[:-2], np.concatenate(bands[-2:])]
    return bands


def _plane_levelled(z: Array, reference: Mask) -> Array:
    rows, columns = np.mgrid[: z.shape[0], : z.shape[1]].astype(np.float64)
    design = np.stack([columns[reference], rows[reference], np.ones(int(reference.sum()))], axis=1)
    across, along, offset = np.linalg.lstsq(design, z[reference], rcond=None)[0]
    return np.asarray(z - across * columns - along * rows - offset)


def _features(z: Array) -> Mask:
    """Mask of the level that covers less of the map; the plane is refitted without it until it stays."""
    from scipy import ndimage

    inside = np.zeros(z.shape, dtype=bool)
    for _ in range(12):
        reference = ~ndimage.binary_dilation(inside, iterations=3)
        level = _plane_levelled(z, reference)
        lower, upper = two_levels(level.ravel())
        below = level < 0.5 * (lower + upper)
        following = below if below.mean() <= 0.5 else ~below
        if (following == inside).all():
            break
        inside = following
    return inside


def _settling_distance(level: Array, within: Array, outside: Array, pitch: float) -> float:
    # both sides are judged within the half width of the features, since bows of the scan show beyond it
    reach = float(within.max())
    near = [(distance > 0.5 * reach) & (distance <= reach) for distance in (within, outside)]
    plateau = [float(np.median(level[mask])) for mask in near]
    limit = _SETTLED * abs(plateau[0] - plateau[1])
    settled = 1
    for distance, target in zip((within, outside), plateau, strict=True):
        for ring in range(1, int(0.5 * reach / pitch) + 1):
            points = level[(distance > (ring - 0.5) * pitch) & (distance <= (ring + 0.5) * pitch)]
            if points.size and abs(np.median(points) - target) > limit:
                settled = max(settled, ring)
    # one ring more, since a ring is judged by its median and half of its points lie nearer to the edge
    return (settled + 1.5) * pitch


def _row_depths(x: Array, z: Array, floor: Mask, reference: Mask) -> tuple[Array, Array]:
    depths, weights = np.full(len(z), np.nan), np.zeros(len(z))
    for row in range(len(z)):
        low, high = floor[row], reference[row]
        if low.sum() < _LEAST_FLOOR or high.sum() < _LEAST_REFERENCE:
            continue
        used = low | high
        design = np.stack([x[used] / x[-1], np.ones(int(used.sum())), -low[used].astype(float)], axis=1)
        depths[row] = np.linalg.lstsq(design, z[row, used], rcond=None)[0][2]
        weights[row] = low.sum()
    return depths, weights
