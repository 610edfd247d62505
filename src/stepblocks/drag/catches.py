"""Where a tip can be caught on its track: every place where the slope of its path is greatest."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array
from stepblocks.contact.path.centre import CentrePath
from stepblocks.drag.kernels.peaks import find_prominent_peaks

Indices = NDArray[np.int64]
LEAST_ANGLE = math.radians(0.5)  # a slope that rises by less is no catch
_LEVEL = math.radians(0.02)  # slopes that differ by less are one
_EQUAL_ANGLES = 1e-7  # share by which angles may differ that count as equal
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


def find_steepest_place(
    places: CatchPlaces, contact_range: tuple[float, float] | None
) -> int | None:
    """Find the place with the greatest angle, of those whose edge lies in a range [m]."""
    angle = places.angle
    if contact_range is not None:
        low, high = contact_range
        is_inside = (places.contact >= low) & (places.contact <= high)
        angle = np.where(is_inside, angle, -np.inf)
    if not np.isfinite(angle).any():
        return None
    # of equal angles, to what a double can tell, the first counts
    is_greatest = angle >= angle.max() * (1.0 - _EQUAL_ANGLES)
    return int(np.flatnonzero(is_greatest)[0])


def find_catch_places(
    track: CentrePath, ball_radius: float, least_angle: float = LEAST_ANGLE
) -> CatchPlaces:
    """Find every place steeper than the ground on both its sides by `least_angle` [rad]."""
    # both slopes of each knot, for a kink has two
    x = np.repeat(track.x, 2)[1:-1]
    slopes = np.column_stack([track.slope_start, track.slope_end]).ravel()
    angle = np.arctan(slopes)
    peaks = find_prominent_peaks(angle, least_angle)
    first, last = _find_peak_plateaus(angle, peaks)
    # rounding makes several peaks of one slope
    is_single = np.append(True, first[1:] > last[:-1])[: peaks.size]
    peaks, first, last = peaks[is_single], first[is_single], last[is_single]
    critical = angle[peaks]
    return CatchPlaces(
        x=x[first],
        angle=critical,
        last=x[last],
        behind=_find_half_fall_positions(x, angle, peaks, first, last),
        start=_find_approach_starts(x, angle, first, last, _AHEAD * ball_radius),
        contact=x[first] + ball_radius * np.sin(critical),
    )


def _find_peak_plateaus(angles: Array, peaks: Indices) -> tuple[Indices, Indices]:
    """Find the first and the last sample about each peak that are as steep as the peak."""
    first, last = peaks.copy(), peaks.copy()
    for number, peak in enumerate(peaks):
        least = angles[peak] - _LEVEL
        while first[number] > 0 and angles[first[number] - 1] >= least:
            first[number] -= 1
        while last[number] < angles.size - 1 and angles[last[number] + 1] >= least:
            last[number] += 1
    return first, last


def _find_half_fall_positions(
    x: Array, angles: Array, peaks: Indices, first: Indices, last: Indices
) -> Array:
    """Find where the slope after each peak has fallen by half of its fall [m]."""
    ends = x[last]
    following = np.append(first[1:], angles.size - 1)[: peaks.size]
    for number, peak in enumerate(peaks):
        ahead = angles[last[number] : following[number] + 1]
        half = 0.5 * (angles[peak] + ahead.min())
        steps = int(np.argmax(ahead <= half))
        ends[number] = x[last[number] + steps]
    return ends


def _find_approach_starts(
    x: Array, angles: Array, first: Indices, last: Indices, least_lead: float
) -> Array:
    """Find where the approach to each peak begins, at least `least_lead` before its foot [m]."""
    starts = np.full(first.size, -np.inf)
    for number in range(1, first.size):
        begin = int(last[number - 1])
        between = angles[begin : int(first[number]) + 1]
        is_level = between <= between.min() + _LEVEL
        level = np.flatnonzero(is_level) + begin
        starts[number] = max(x[level[0]], x[level[-1]] - least_lead)
    return starts
