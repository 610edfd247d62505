"""Compiled kernels of the dilation of a height map by a tip of revolution; nothing is checked here.

The dilation is the greatest, over the rows under the tip, of one-dimensional dilations by the tip's cut in that row.
In each cut the contact moves with the tip, so one row costs W log W instead of W R, and the map N R log R instead of
N R^2. The tip's cuts before and behind its axis are alike: of two such rows the higher one is dilated. Blocks of a row that
lie too low to matter for a block of the result are left out, which is most of them on a surface that is flat over the
tip's radius but for its step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

Array = Any
BLOCK = 32  # columns judged together


@njit(cache=True)
def block_maxima(heights: Array) -> Array:
    """Greatest height of each block of columns in each row; -inf where nothing was measured."""
    rows, columns = heights.shape
    top = np.full((rows, (columns + BLOCK - 1) // BLOCK), -np.inf)
    for y in range(rows):
        for x in range(columns):
            top[y, x // BLOCK] = max(top[y, x // BLOCK], heights[y, x])
    return top


@njit(cache=True)
def _cut(
    out: Array,
    touched: Array,
    offset: int,
    row: Array,
    drop: Array,
    half: int,
    first: int,
    final: int,
    left: int,
    right: int,
    marks: Array,
) -> None:
    """Raise columns `first` to `final` of a row of the result by the 1-D dilation of columns `left` to `right`.

    Every other column of a stride is judged between the contacts of its neighbours, then the stride is halved.
    `marks` holds the contact of each column judged; without one, the bounds that it was judged between.
    """
    count = final - first + 1
    low, high = marks[0], marks[1]
    low[0] = left
    stride = 1
    while 2 * stride <= count:
        stride *= 2
    one = np.uint64(1)
    while stride > 0:
        for k in range(stride, count + 1, 2 * stride):
            lo = low[k - stride]
            hi = high[k + stride] if k + stride <= count else right
            x = first + k - 1
            best: Any = -np.inf
            where: Any = -1
            # unsigned indices: a signed one costs a test for counting from the end, half as much again as the whole loop
            u, end, shift = np.uint64(max(lo, x - half)), np.uint64(max(min(hi, x + half) + 1, 0)), np.uint64(half - x)
            while u < end:
                rest = row[u] - drop[u + shift]
                if rest > best:
                    best, where = rest, np.int64(u)
                u += one
            if where >= 0:
                lo = hi = where
                if best > out[x]:
                    out[x], touched[x] = best, offset + where
            low[k], high[k] = lo, hi
        stride //= 2


@njit(cache=True)
def _candidates(top: Array, low: float, block: int, drop: Array, half: int, columns: int) -> tuple[int, int]:
    """Columns of one input row that could carry the tip over one block of the result; an empty range if none."""
    a, b = block * BLOCK, min(block * BLOCK + BLOCK, columns) - 1
    begin = end = -1
    for k in range(max(a - half, 0) // BLOCK, min(b + half, columns - 1) // BLOCK + 1):
        near, far = k * BLOCK, k * BLOCK + BLOCK - 1
        distance = max(max(near - b, a - far), 0)
        if distance <= half and top[k] - drop[half + distance] > low:
            if begin < 0:
                begin = max(near, a - half)
            end = min(far, b + half, columns - 1)
    return begin, end


@njit(cache=True, fastmath={"nnan", "nsz"})  # no NaN comes here; promising it lets both loops use vector registers
def _higher(out: Array, above: Array, below: Array) -> None:
    """Take the higher of two rows, sample by sample."""
    for x in range(out.size):
        out[x] = above[x] if above[x] > below[x] else below[x]


@njit(cache=True, fastmath={"nnan", "nsz"})
def _least(values: Array) -> float:
    least = np.inf
    for value in values:
        least = value if value < least else least
    return least


@njit(cache=True)
def dilate_rows(heights: Array, top: Array, start: int, stop: int, drops: Array, halves: Array) -> tuple[Array, Array]:
    """Rest of the tip over rows `start` to `stop - 1` of `heights` and the flat index of each contact."""
    rows, columns = heights.shape
    depth, width = (drops.shape[0] - 1) // 2, (drops.shape[1] - 1) // 2
    out = np.full((stop - start, columns), -np.inf)
    touched = np.full((stop - start, columns), -1, np.int64)
    marks = np.empty((2, columns + 1), np.int64)
    blocks = top.shape[1]
    lowest = np.empty(blocks)  # of the result in each block, so far
    bound, higher = np.empty(blocks), np.empty(columns)
    for y in range(start, stop):
        result, where = out[y - start], touched[y - start]
        lowest[:] = -np.inf
        for shift in range(depth + 1):  # the nearest rows give the best bound first
            half = halves[depth + shift]
            above, below = y - shift, y + shift
            if half < 0 or (above < 0 and below >= rows):
                continue
            # the rows as far above as below meet the same cut of the tip: the higher of both is dilated, once
            above, below = above if above >= 0 else below, below if below < rows else above
            for k in range(blocks):
                bound[k] = max(top[above, k], top[below, k])
            drop = drops[depth + shift, width - half : width + half + 1]
            begin = final = left = right = -1
            joined = False
            for block in range(blocks + 1):
                lo, hi = -1, -1
                if block < blocks:
                    lo, hi = _candidates(bound, lowest[block], block, drop, half, columns)
                if lo >= 0:  # neighbouring blocks that need these rows are done together
                    if begin < 0:
                        begin, left, right = block * BLOCK, lo, hi
                    left, right = min(left, lo), max(right, hi)
                    final = min(block * BLOCK + BLOCK, columns) - 1
                elif begin >= 0:
                    if not joined:
                        _higher(higher, heights[above], heights[below])
                        joined = True
                    _cut(result, where, shift * columns, higher, drop, half, begin, final, left, right, marks)
                    for done in range(begin // BLOCK, block):
                        lowest[done] = _least(result[done * BLOCK : min(done * BLOCK + BLOCK, columns)])
                    begin = -1
        for x in range(columns):
            if where[x] < 0:
                result[x] = math.nan
                continue
            shift, u = divmod(where[x], columns)
            above, below = y - shift, y + shift
            higher_above = above >= 0 and (below >= rows or heights[above, u] >= heights[below, u])
            where[x] = (above if higher_above else below) * columns + u
    return out, touched
