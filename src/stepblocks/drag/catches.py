"""Where a tip can be caught on its track.

Every place at which the slope of its path has a maximum.
"""

import math
from typing import NamedTuple

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.path.centre import CentrePath

LEAST_ANGLE = math.radians(0.5)  # a slope that rises by less is no catch
_LEVEL = math.radians(0.02)  # slopes that differ by less are one
_AHEAD = 0.05  # the approach to a place begins at least so many radii before its foot


class CatchPlaces(NamedTuple):
    """The places in the order of the drag, as arrays of shape (n,); x is that of the tip's axis.

    Attributes
    ----------
    x : ndarray
        Where the slope reaches its maximum [m].
    angle : ndarray
        Slope there, the critical angle [rad].
    last : ndarray
        Where the slope begins to fall again [m]; behind it the tip slips.
    behind : ndarray
        Where the slope has fallen by half of its fall to the lowest ground that follows [m]; a
        contact that gives way does not carry the tip so far.
    start : ndarray
        Where the approach begins [m], behind the place before; minus infinity for the first.
    contact : ndarray
        Position of the edge that is touched there [m].
    """

    x: Array
    angle: Array
    last: Array
    behind: Array
    start: Array
    contact: Array


def find_asked_place(places: CatchPlaces, within: tuple[float, float] | None) -> int | None:
    """Find the place with the greatest angle, of those whose edge lies `within` a range [m]."""
    low, high = within or (-np.inf, np.inf)
    angle = np.where((places.contact >= low) & (places.contact <= high), places.angle, -np.inf)
    if not np.isfinite(angle).any():
        return None
    # of equal angles, to what a double can tell, the first counts
    return int(np.flatnonzero(angle >= angle.max() * (1.0 - 1e-7))[0])


def find_catch_places(
    track: CentrePath, ball_radius: float, least: float = LEAST_ANGLE
) -> CatchPlaces:
    """Find every place steeper than the ground on both its sides by `least` [rad]."""
    from scipy.signal import find_peaks

    # both slopes of each knot, for a kink has two
    x = np.repeat(track.x, 2)[1:-1]
    angle = np.arctan(np.column_stack([track.slope_start, track.slope_end]).ravel())
    peaks, _ = find_peaks(angle, prominence=least, height=least)
    first, last = peaks.copy(), peaks.copy()
    for n, peak in enumerate(peaks):
        while first[n] > 0 and angle[first[n] - 1] >= angle[peak] - _LEVEL:
            first[n] -= 1
        while last[n] < angle.size - 1 and angle[last[n] + 1] >= angle[peak] - _LEVEL:
            last[n] += 1
    # rounding makes several peaks of one slope
    single = np.append(True, first[1:] > last[:-1])[: peaks.size]
    peaks, first, last = peaks[single], first[single], last[single]
    start = np.full(peaks.size, -np.inf)
    behind = x[last]
    for n in range(peaks.size):
        following = first[n + 1] if n + 1 < peaks.size else angle.size - 1
        ahead = angle[last[n] : following + 1]
        behind[n] = x[last[n] + int(np.argmax(ahead <= 0.5 * (angle[peaks[n]] + ahead.min())))]
        if n > 0:
            between = slice(int(last[n - 1]), int(first[n]) + 1)
            low = np.flatnonzero(angle[between] <= angle[between].min() + _LEVEL) + last[n - 1]
            start[n] = max(x[low[0]], x[low[-1]] - _AHEAD * ball_radius)
    return CatchPlaces(
        x[first],
        angle[peaks],
        x[last],
        behind,
        start,
        x[first] + ball_radius * np.sin(angle[peaks]),
    )
