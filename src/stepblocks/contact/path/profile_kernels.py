"""Compiled kernels of the exact dilation of a profile.

Nothing is checked here, see `stepblocks.contact.path.profile`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array

# The surface is a row of elements, segments from (x0, z0) to (x1, z1) in order of x; a lone sample
# is one of no length. Columns: x0, z0, x1, z1, and how far from the tip's axis the ball is as steep
# as the element.
_CHUNK = 512  # positions whose elements stay in the cache of the processor
_DEPTH = 128  # of the halving of a chunk
_BRACKETS = 256  # that are halved at once
_JUMP = 1e6  # slope of 89.99994 deg
_SAME = 1e-6  # share by which slopes may differ along one line, from the rounding of its points
_GREATEST = 1e12  # slope from which that share is not taken


@njit(cache=True)
def _compute_resting_height(
    u: float, x: float, x0: float, z0: float, x1: float, z1: float, radius: float
) -> float:
    """Return the height at which the ball at `x` rests on a segment's point `u` [m].

    The point is within its reach but for rounding.
    """
    if x1 > x0:
        share = (u - x0) / (x1 - x0)
        z = z0 + (z1 - z0) * share
    else:  # a riser or a lone point
        z = max(z0, z1)
    run = u - x
    square = min(run * run, radius * radius)
    below_centre = math.sqrt(radius * radius - square)
    sagitta = square / (radius + below_centre)
    return z - sagitta


@njit(cache=True)
def find_best_contact(
    x: float, first: int, last: int, elements: Array, radius: float
) -> tuple[float, float, int]:
    """Find height of the tip at `x`, contact and element of `first` to `last`; -1 without one."""
    low, high = x - radius, x + radius
    best, contact, touched = -np.inf, math.nan, -1
    for element in range(first, last + 1):
        x0, z0 = elements[element, 0], elements[element, 1]
        x1, z1 = elements[element, 2], elements[element, 3]
        if x1 < low or x0 > high:
            continue
        # an element below the best rest cannot carry the tip
        if z0 <= best and z1 <= best:
            continue
        as_steep = x + elements[element, 4]
        leftmost, rightmost = max(x0, low), min(x1, high)
        u = min(max(as_steep, leftmost), rightmost)
        height = _compute_resting_height(u, x, x0, z0, x1, z1, radius)
        if height > best:
            best, contact, touched = height, u, element
    return best, contact, touched


@njit(cache=True)
def dilate_profile(
    positions: Array, elements: Array, radius: float
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Height of the tip, contact position and element at each of the increasing `positions`.

    The contact moves to the right with the ball: halving the positions narrows the candidates, at a
    cost of N log N.
    """
    count = positions.size
    height = np.empty(count)
    contact = np.empty(count)
    touched = np.empty(count, np.int64)
    # first and last element within the tip's reach at each position
    under = np.searchsorted(elements[:, 2], positions - radius)
    until = np.searchsorted(elements[:, 0], positions + radius, side="right") - 1
    stack = np.empty((_DEPTH, 4), np.int64)
    for start in range(0, count, _CHUNK):
        stop = min(start + _CHUNK, count) - 1
        stack[0] = (start, stop, under[start], until[stop])
        depth = 1
        while depth > 0:
            depth -= 1
            begin, end, first, last = stack[depth]
            middle = (begin + end) // 2
            nearest_first = max(first, under[middle])
            nearest_last = min(last, until[middle])
            resting, u, element = find_best_contact(
                positions[middle], nearest_first, nearest_last, elements, radius
            )
            last_before, first_behind = last, first
            if element >= 0:
                last_before = element
                first_behind = element
            else:  # no surface under the ball
                resting = math.nan
            height[middle] = resting
            contact[middle] = u
            touched[middle] = element
            if begin < middle:
                stack[depth] = (begin, middle - 1, first, last_before)
                depth += 1
            if middle < end:
                stack[depth] = (middle + 1, end, first_behind, last)
                depth += 1
    return height, contact, touched


@njit(cache=True)
def _compute_slope_ahead(tip_position: float, contact_position: float, radius: float) -> float:
    """Return the slope of the path just ahead of a ball, from where it touches [1]."""
    ahead = contact_position - tip_position
    if abs(ahead) >= radius:
        return math.copysign(np.inf, ahead)
    return ahead / math.sqrt((radius - ahead) * (radius + ahead))


@njit(cache=True)
def compute_path_slopes(
    positions: Array, contact_positions: Array, touched_elements: Array, radius: float
) -> Array:
    """Return the slope of the path at each position, from the contact found there [1].

    NaN where nothing is touched.
    """
    slopes = np.full(positions.size, np.nan)
    for number in range(positions.size):
        if touched_elements[number] >= 0:
            slopes[number] = _compute_slope_ahead(
                positions[number], contact_positions[number], radius
            )
    return slopes


@njit(cache=True)
def _compute_rounding_allowance(slope: float) -> float:
    """Return by how much two slopes along one line may differ by rounding [1]."""
    return _SAME * min(abs(slope), _GREATEST)


@njit(cache=True)
def _find_steepest_between(
    ends: tuple[float, float, float, float],
    touched: tuple[int, int],
    best: float,
    elements: Array,
    radius: float,
    tolerance: float,
) -> tuple[float, float, float]:
    """Find the greatest slope above `best` between two `ends`, its place, and the contact there.

    Ends are (x, h, x, h) [m]. While one element is touched the path is concave and steepest at its
    left end: only brackets whose ends touch different elements are halved, and one of the width
    `tolerance` that still climbs is a jump of infinite slope.
    """
    where = contact = math.nan
    stack = np.empty((_BRACKETS, 4))
    marks = np.empty((_BRACKETS, 2), np.int64)
    stack[0] = ends
    marks[0] = touched
    depth = 1
    while depth > 0:
        depth -= 1
        x0, h0, x1, h1 = stack[depth]
        left, right = marks[depth]
        if left == right or left < 0 or right < 0:
            continue
        width = x1 - x0
        middle = x0 + 0.5 * width
        if width <= tolerance or middle <= x0 or middle >= x1:
            if h1 - h0 > _JUMP * width:
                best, where, contact = np.inf, x1, elements[right, 0]
            continue
        h, u, element = find_best_contact(middle, left, right, elements, radius)
        if element >= 0:
            slope = _compute_slope_ahead(middle, u, radius)
            # right brackets come first, so that among equals the leftmost stays: the break itself
            if slope >= best - _compute_rounding_allowance(best):
                best, where, contact = max(slope, best), middle, u
        stack[depth] = (x0, h0, middle, h)
        marks[depth] = (left, element)
        stack[depth + 1] = (middle, h, x1, h1)
        marks[depth + 1] = (element, right)
        depth += 2
    return best, where, contact


@njit(cache=True)
def find_steepest_in_intervals(
    positions: Array,
    height: Array,
    contact: Array,
    touched: Array,
    floor: float,
    elements: Array,
    radius: float,
    tolerance: float,
) -> Array:
    """Find the steepest rise in each interval, its place, and the contact there, (n - 1, 3).

    Of intervals that rise by less than `floor` [1] it is that of the left end.
    """
    count = positions.size
    steepest = np.full((count - 1, 3), np.nan)
    slopes = compute_path_slopes(positions, contact, touched, radius)
    for left in range(count - 1):
        right = left + 1
        if touched[left] < 0 or touched[right] < 0:
            continue
        slope, where, u = slopes[left], positions[left], contact[left]
        # the contact of the right end, seen from the left end, is steeper than all between
        bound = _compute_slope_ahead(positions[left], contact[right], radius)
        if touched[left] != touched[right] and not bound <= floor:
            ends = (positions[left], height[left], positions[right], height[right])
            touched_at_ends = (touched[left], touched[right])
            best, best_where, best_u = _find_steepest_between(
                ends, touched_at_ends, slope, elements, radius, tolerance
            )
            if best > slope + _compute_rounding_allowance(slope):
                slope, where, u = best, best_where, best_u
            if slopes[right] > slope + _compute_rounding_allowance(slope):
                slope, where, u = slopes[right], positions[right], contact[right]
        steepest[left] = (slope, where, u)
    return steepest
