"""Compiled kernels of the exact dilation of a profile.

Nothing is checked here, see `stepblocks.contact.path.profile`.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stepblocks.contact import Array

# The surface is a row of elements, segments from (x0, z0) to (x1, z1) in order of x; a lone sample
# is one of no length
_CHUNK = 512
_JUMP = 1e6  # slope of 89.99994 deg
_SAME = 1e-6  # share by which slopes may differ along one line, from the rounding of its points


@njit(cache=True)
def _compute_height_resting_on(
    u: float, x: float, x0: float, z0: float, x1: float, z1: float, radius: float
) -> float:
    # Height at which the ball at `x` rests on a segment's point `u`, within its reach but for
    # rounding
    z = z0 + (z1 - z0) * ((u - x0) / (x1 - x0)) if x1 > x0 else max(z0, z1)
    squared = min((u - x) * (u - x), radius * radius)
    return z - squared / (radius + math.sqrt(radius * radius - squared))


@njit(cache=True)
def find_best_contact(
    x: float, first: int, last: int, elements: Array, radius: float
) -> tuple[float, float, int]:
    """Height of the tip at `x`, contact position and element among `first` to `last`, or -1."""
    low, high = x - radius, x + radius
    best, where, which = -np.inf, math.nan, -1
    for e in range(first, last + 1):
        x0, z0, x1, z1 = elements[e, 0], elements[e, 1], elements[e, 2], elements[e, 3]
        # t is never negative: an element below the best rest cannot carry the tip
        if (z0 <= best and z1 <= best) or x1 < low or x0 > high:
            continue
        # elements[e, 4] is where the ball is as steep as the element
        u = min(max(x + elements[e, 4], max(x0, low)), min(x1, high))
        rest = _compute_height_resting_on(u, x, x0, z0, x1, z1, radius)
        if rest > best:
            best, where, which = rest, u, e
    return best, where, which


@njit(cache=True)
def dilate_profile(
    positions: Array, elements: Array, radius: float
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Height of the tip, contact position and element at each of the increasing `positions`."""
    n = positions.size
    height, contact, which = np.empty(n), np.empty(n), np.empty(n, np.int64)
    # first and last element within the tip's reach at each position
    under = np.searchsorted(elements[:, 2], positions - radius)
    until = np.searchsorted(elements[:, 0], positions + radius, side="right") - 1
    stack = np.empty((128, 4), np.int64)
    # the contact moves to the right with the ball: halving the positions narrows the candidates, at
    # a cost of N log N
    for start in range(0, n, _CHUNK):  # chunks keep the candidates in the cache
        stop = min(start + _CHUNK, n) - 1
        stack[0] = (start, stop, under[start], until[stop])
        depth = 1
        while depth > 0:
            depth -= 1
            a, b, first, last = stack[depth]
            middle = (a + b) // 2
            begin, end = max(first, under[middle]), min(last, until[middle])
            rest, u, e = find_best_contact(positions[middle], begin, end, elements, radius)
            height[middle] = rest if e >= 0 else math.nan
            contact[middle], which[middle] = u, e
            if a < middle:
                stack[depth] = (a, middle - 1, first, e if e >= 0 else last)
                depth += 1
            if middle < b:
                stack[depth] = (middle + 1, b, e if e >= 0 else first, last)
                depth += 1
    return height, contact, which


@njit(cache=True)
def _compute_slope(x: float, u: float, radius: float) -> float:
    # Slope of the path just ahead of the ball that touches at `u`
    v = u - x
    if abs(v) >= radius:
        return math.copysign(np.inf, v)
    return v / math.sqrt((radius - v) * (radius + v))


@njit(cache=True)
def compute_path_slopes(positions: Array, contact: Array, which: Array, radius: float) -> Array:
    """Slope of the path at each position, from the contact found there.

    NaN where nothing is touched.
    """
    slopes = np.full(positions.size, np.nan)
    for k in range(positions.size):
        if which[k] >= 0:
            slopes[k] = _compute_slope(positions[k], contact[k], radius)
    return slopes


@njit(cache=True)
def _find_steepest_between(
    ends: tuple[float, float, float, float],
    touched: tuple[int, int],
    best: float,
    elements: Array,
    radius: float,
    tolerance: float,
) -> tuple[float, float, float]:
    # Greatest slope over `best` of the path between two `ends` (x, h, x, h), where, and the contact
    # there
    # while one element is touched the path is concave and steepest at its left end: only brackets
    # whose ends touch different elements are halved, and one of the width `tolerance` that still
    # climbs is a jump of infinite slope
    where = touch = math.nan
    stack, marks = np.empty((256, 4)), np.empty((256, 2), np.int64)
    stack[0], marks[0] = ends, touched
    depth = 1
    while depth > 0:
        depth -= 1
        x0, h0, x1, h1 = stack[depth]
        e0, e1 = marks[depth]
        if e0 == e1 or e0 < 0 or e1 < 0:
            continue
        middle = x0 + 0.5 * (x1 - x0)
        if x1 - x0 <= tolerance or middle <= x0 or middle >= x1:
            if h1 - h0 > _JUMP * (x1 - x0):
                best, where, touch = np.inf, x1, elements[e1, 0]
            continue
        h, u, e = find_best_contact(middle, e0, e1, elements, radius)
        if e >= 0:
            s = _compute_slope(middle, u, radius)
            # right brackets come first, so that among equals the leftmost stays: the break itself;
            # slopes along one line differ by their last bits
            if s >= best - _SAME * min(abs(best), 1e12):
                best, where, touch = max(s, best), middle, u
        stack[depth], marks[depth] = (x0, h0, middle, h), (e0, e)
        stack[depth + 1], marks[depth + 1] = (middle, h, x1, h1), (e, e1)
        depth += 2
    return best, where, touch


@njit(cache=True)
def find_steepest_in_each(
    positions: Array,
    height: Array,
    contact: Array,
    which: Array,
    floor: float,
    elements: Array,
    radius: float,
    tolerance: float,
) -> Array:
    """Steepest rise between neighbours, where, and the contact there, shape (n - 1, 3).

    Below `floor` the left end's alone.
    """
    n = positions.size
    found = np.full((n - 1, 3), np.nan)
    right_slope = compute_path_slopes(positions, contact, which, radius)
    for k in range(n - 1):
        a, b = which[k], which[k + 1]
        if a < 0 or b < 0:
            continue
        found[k, 0], found[k, 1], found[k, 2] = right_slope[k], positions[k], contact[k]
        # the contact of the right end, seen from the left end, is steeper than all between
        if a == b or _compute_slope(positions[k], contact[k + 1], radius) <= floor:
            continue
        best, where, touch = _find_steepest_between(
            (positions[k], height[k], positions[k + 1], height[k + 1]),
            (a, b),
            found[k, 0],
            elements,
            radius,
            tolerance,
        )
        if best > found[k, 0] + _SAME * min(abs(found[k, 0]), 1e12):
            found[k, 0], found[k, 1], found[k, 2] = best, where, touch
        if right_slope[k + 1] > found[k, 0] + _SAME * min(abs(found[k, 0]), 1e12):
            found[k, 0], found[k, 1], found[k, 2] = (
                right_slope[k + 1],
                positions[k + 1],
                contact[k + 1],
            )
    return found
