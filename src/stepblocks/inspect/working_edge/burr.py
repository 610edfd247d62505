"""Burr at a working edge (ISO 13715): how far material stands over the upper face near the edge.

A single isolated point is a spike: it does not count, and is reported. Two neighbours that stand up
together do count. What noise alone lets stand up is known from the valleys of the same face and
from the lower face, and half of it is taken off.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.noise import Array, Estimate, Mask

ZONE = 0.2e-3  # distance from the edge within which nothing may stand over the face [m]
_LEAST_SEEN = 0.8  # share of the zone that must be measured [1]
_LEAST_POINTS = 5  # in the zone
_ALONE = (
    0.25  # of a point's height, that one of its neighbours must reach for it to be no spike [1]
)


@dataclass(frozen=True)
class Burr:
    """What stands over the upper face; lengths in m."""

    height: Estimate
    sampling: float  # by what a peak between two points may be higher, standard uncertainty
    noise: float  # half of what noise alone would show
    spikes: int  # single isolated points that were left out
    highest_spike: float


def find_burr(across: Array, height: Array, step: float, exclusion: float) -> Burr | None:
    """Return what stands over the upper face; None where less than the zone was scanned.

    `across`, shape (ny, nx), is the distance from the edge towards the upper face, and `height`, of
    the same shape, the height over the lower face, tilt removed, nan where nothing was measured.
    `step` is the height of the upper face over the lower one, `exclusion` the half width kept out
    of the faces.
    """
    known = np.isfinite(height)
    asked = (across > 0.0) & (across <= ZONE)
    reach = np.max(np.where(known, across, -np.inf))
    if reach < _LEAST_SEEN * ZONE or (known & asked).sum() < max(
        _LEAST_SEEN * asked.sum(), _LEAST_POINTS
    ):
        return None
    upper = _level_rows(height, (across > exclusion) & (across <= 2.0 * ZONE))
    lower = _level_rows(height, (across < -exclusion) & (across >= -2.0 * ZONE))
    # material that leans over the lower face is a burr as well: it is higher than the upper face
    zone = np.abs(across) <= ZONE
    leaning = np.where(across > 0.0, upper, height - step)
    peak, beside = _find_highest(leaning, zone)
    quiet = (across > exclusion) & zone, (across < -exclusion) & zone
    floors = [
        _find_highest(sign * surface, part)[0]
        for sign, surface, part in (
            (-1.0, upper, quiet[0]),
            (1.0, lower, quiet[1]),
            (-1.0, lower, quiet[1]),
        )
    ]
    usual = [floor for floor in floors if np.isfinite(floor)]
    noise = 0.5 * max(float(np.median(usual)), 0.0) if usual else 0.0
    std = float(np.std(usual, ddof=1)) / np.sqrt(len(usual)) if len(usual) > 1 else noise
    lone = zone & (leaning > max(peak + 6.0 * noise, 0.0))
    # a face that bows lies off its median there
    near = upper[quiet[0] & known]
    std = float(np.hypot(std, np.median(near) if near.size else 0.0))
    # between two points the sides of a peak may go on rising as they do beside it
    rise = 0.25 * max(peak - beside, 0.0)
    return Burr(
        Estimate(max(peak + rise - noise, 0.0), std),
        rise / np.sqrt(3.0),
        noise,
        int(lone.sum()),
        float(np.max(leaning[lone], initial=0.0)),
    )


def _level_rows(height: Array, face: Mask) -> Array:
    # Return heights over the median of a face, row by row; its median over all rows where a row
    # shows none.
    own = np.where(face & np.isfinite(height), height, np.nan)
    counts = np.isfinite(own).sum(axis=1)
    if not counts.any():
        return np.full_like(height, np.nan)
    level = np.full(len(height), float(np.nanmedian(own)))
    level[counts > 0] = np.nanmedian(own[counts > 0], axis=1)
    return np.asarray(height - level[:, np.newaxis])


def _find_highest(surface: Array, part: Mask) -> tuple[float, float]:
    # Return the highest point that does not stand alone, and the lesser of its neighbours in a row
    # [m].
    seen = np.pad(
        np.where(part & np.isfinite(surface), surface, -np.inf), 1, constant_values=-np.inf
    )
    own, before, behind = seen[1:-1, 1:-1], seen[1:-1, :-2], seen[1:-1, 2:]
    beside = np.maximum.reduce([before, behind, seen[2:, 1:-1], seen[:-2, 1:-1]])
    held = np.where(beside > _ALONE * own, own, np.minimum(own, beside))
    at = np.unravel_index(int(np.argmax(held)), held.shape)
    lesser = float(np.minimum(before, behind)[at])
    return float(held[at]), lesser if np.isfinite(lesser) else float(held[at])
