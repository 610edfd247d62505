"""Burr at a working edge (ISO 13715): how far material stands over the upper face near the edge.

A single isolated point is a spike: it does not count, and is reported. Two neighbours that stand up
together do count. What noise alone lets stand up is known from the valleys of the same face and
from the lower face, and half of it is taken off a peak as broad as a face; of a sharp one, of which
noise lifts few points, it takes less.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.noise import Array, Estimate, Mask

ZONE = 0.2e-3  # distance from the edge within which nothing may stand over the face [m]
_LEAST_SEEN = 0.8  # share of the zone that must be measured [1]
_LEAST_POINTS = 5  # in the zone
_FACE = 2.0  # widths of the zone, over which a face is levelled
# of a point's height, that one of its neighbours must reach for it to be no spike [1]
_ALONE = 0.25
_STANDS_OUT = 6.0  # noises over the burr, from which a point is a spike [1]
_GOES_ON = 0.25  # of the rise beside a peak, by which it may go on rising between two points [1]


@dataclass(frozen=True)
class Burr:
    """What stands over the upper face; lengths in m."""

    height: Estimate
    sampling: float  # by what a peak between two points may be higher, standard uncertainty
    noise: float  # half of what noise alone would show
    spikes: int  # single isolated points that were left out
    highest_spike: float


@dataclass(frozen=True)
class _Peak:
    """The highest point that does not stand alone [m]; minus infinity where there is none."""

    height: float
    beside: float  # the lesser of its neighbours in a row


def measure_burr(across: Array, height: Array, step: float, exclusion: float) -> Burr | None:
    """Find what stands over the upper face.

    Parameters
    ----------
    across : array, shape (ny, nx)
        Distance from the edge towards the upper face [m].
    height : array, shape (ny, nx)
        Height over the lower face, tilt removed [m]; nan where nothing was measured.
    step, exclusion : float
        Height of the upper face over the lower one, and half width kept out of the faces [m].

    Returns
    -------
    Burr or None
        None where less than the zone was scanned.
    """
    known = np.isfinite(height)
    if not _is_zone_scanned(across, known):
        return None
    upper = _level_rows_on_face(height, (across > exclusion) & (across <= _FACE * ZONE))
    lower = _level_rows_on_face(height, (across < -exclusion) & (across >= -_FACE * ZONE))
    zone = np.abs(across) <= ZONE
    quiet_upper = (across > exclusion) & zone
    quiet_lower = (across < -exclusion) & zone
    # material that leans over the lower face is a burr as well: it is higher than the upper face
    leaning = np.where(across > 0.0, upper, height - step)
    peak = _find_highest_supported_point(leaning, zone)
    floors = np.array(
        [
            _find_highest_supported_point(-upper, quiet_upper).height,
            _find_highest_supported_point(lower, quiet_lower).height,
            _find_highest_supported_point(-lower, quiet_lower).height,
        ]
    )
    usual = floors[np.isfinite(floors)]
    noise = 0.0
    if len(usual) > 0:
        noise = 0.5 * max(float(np.median(usual)), 0.0)
    std = noise
    if len(usual) > 1:
        std = float(np.std(usual, ddof=1)) / np.sqrt(len(usual))
    # a face that bows lies off its median there
    near = upper[quiet_upper & known]
    bow = 0.0
    if near.size:
        bow = float(np.median(near))
    # between two points the sides of a peak may go on rising as they do beside it; what lies below
    # the face is no side of a burr but the riser
    rise = _GOES_ON * max(peak.height - max(peak.beside, 0.0), 0.0)
    spikes = zone & (leaning > max(peak.height + _STANDS_OUT * noise, 0.0))
    excess = noise * _estimate_noise_share(leaning[zone & known], peak.height - 2.0 * noise)
    return Burr(
        height=Estimate(max(peak.height + rise - excess, 0.0), float(np.hypot(std, bow))),
        sampling=rise / np.sqrt(3.0),
        noise=noise,
        spikes=int(spikes.sum()),
        highest_spike=float(np.max(leaning[spikes], initial=0.0)),
    )


def _estimate_noise_share(heights: Array, height_threshold: float) -> float:
    """Return the share of what noise alone shows in a face that it adds to a peak [1].

    The highest of n points of noise is about the square root of ln n high. A peak has as many as
    `heights` [m] that lie within the noise of it, above `height_threshold`: of a sharp one few, of
    a face half of all.
    """
    near = max(int((heights > height_threshold).sum()), 1)
    of_face = max(0.5 * heights.size, 2.0)
    return float(min(np.sqrt(np.log(near) / np.log(of_face)), 1.0))


def _is_zone_scanned(across: Array, known: Mask) -> bool:
    """Tell whether enough of the zone on the upper face was measured."""
    reach = np.max(np.where(known, across, -np.inf))
    if reach < _LEAST_SEEN * ZONE:
        return False
    asked = (across > 0.0) & (across <= ZONE)
    least = max(_LEAST_SEEN * asked.sum(), _LEAST_POINTS)
    return bool((known & asked).sum() >= least)


def _level_rows_on_face(height: Array, face: Mask) -> Array:
    """Return heights over the median of a face, row by row, shape (ny, nx) [m].

    Where a row shows none of it, they are over its median over all rows.
    """
    on_face = np.where(face & np.isfinite(height), height, np.nan)
    counts = np.isfinite(on_face).sum(axis=1)
    if not counts.any():
        return np.full_like(height, np.nan)
    level = np.full(len(height), float(np.nanmedian(on_face)))
    level[counts > 0] = np.nanmedian(on_face[counts > 0], axis=1)
    return np.asarray(height - level[:, np.newaxis])


def _find_highest_supported_point(surface: Array, region: Mask) -> _Peak:
    """Find the highest point of a part of a surface, shape (ny, nx) [m], that is not alone."""
    seen = np.where(region & np.isfinite(surface), surface, -np.inf)
    padded = np.pad(seen, 1, constant_values=-np.inf)
    before = padded[1:-1, :-2]
    behind = padded[1:-1, 2:]
    highest_beside = np.maximum.reduce([before, behind, padded[2:, 1:-1], padded[:-2, 1:-1]])
    # one that stands alone counts as high as the highest beside it
    is_held = highest_beside > _ALONE * seen
    held = np.where(is_held, seen, np.minimum(seen, highest_beside))
    place = np.unravel_index(int(np.argmax(held)), held.shape)
    height = float(held[place])
    lesser = float(np.minimum(before, behind)[place])
    if not np.isfinite(lesser):
        lesser = height
    return _Peak(height, lesser)
