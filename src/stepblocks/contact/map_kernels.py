"""Compiled kernels of the dilation of a height map by a tip of revolution; nothing is checked here.

The dilation is the greatest, over the rows under the tip, of one-dimensional dilations by the tip's cut in that row.
In each cut the contact moves with the tip, so one row costs W log W instead of W R, and the map N R log R instead of
N R^2. Blocks of a row that lie too low to matter for a block of the result are left out, which is most of them on a
surface that is flat over the tip's radius but for its step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

__all__ = ["BLOCK", "block_maxima", "dilate_rows"]

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
    row: Array,
    offset: int,
    drop: Array,
    half: int,
    first: int,
    final: int,
    left: int,
    right: int,
    stack: Array,
) -> None:
    """Raise columns `first` to `final` of a row of the result by the 1-D dilation of columns `left` to `right`."""
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = first, final, left, right
    depth = 1
    while depth > 0:
        depth -= 1
        a, b, lo, hi = stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3]
        x = (a + b) // 2
        best, where = -np.inf, -1
        for u in range(max(lo, x - half), min(hi, x + half) + 1):
            rest = row[u] - drop[u - x + half]
            if rest > best:
                best, where = rest, u
        if where >= 0 and best > out[x]:
            out[x], touched[x] = best, offset + where
        if a < x:
            stack[depth, 0], stack[depth, 1], stack[depth, 2] = a, x - 1, lo
            stack[depth, 3] = where if where >= 0 else hi
            depth += 1
        if x < b:
            stack[depth, 0], stack[depth, 1], stack[depth, 3] = x + 1, b, hi
            stack[depth, 2] = where if where >= 0 else lo
            depth += 1


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


@njit(cache=True)
def dilate_rows(heights: Array, top: Array, start: int, stop: int, drops: Array, halves: Array) -> tuple[Array, Array]:
    """Rest of the tip over rows `start` to `stop - 1` of `heights` and the flat index of each contact.

    Parameters
    ----------
    heights, top
        Rows with what lies under the tip around them, and their block maxima.
    drops : shape (2 h + 1, 2 w + 1)
        Height of the tip over its lowest point; row `h`, column `w` is the axis. Infinite beyond its reach.
    halves : shape (2 h + 1,)
        Columns to either side of the axis that each cut of the tip reaches; -1 for none.
    """
    rows, columns = heights.shape
    depth, width = (drops.shape[0] - 1) // 2, (drops.shape[1] - 1) // 2
    out = np.full((stop - start, columns), -np.inf)
    touched = np.full((stop - start, columns), -1, np.int64)
    stack = np.empty((128, 4), np.int64)
    blocks = top.shape[1]
    for y in range(start, stop):
        result, where = out[y - start], touched[y - start]
        for step in range(2 * depth + 1):  # 0, -1, +1, -2, ...: the nearest rows give the best bound first
            shift = (step + 1) // 2 if step % 2 == 0 else -((step + 1) // 2)
            if not 0 <= y + shift < rows or halves[depth + shift] < 0:
                continue
            half = halves[depth + shift]
            drop = drops[depth + shift, width - half : width + half + 1]
            begin = final = left = right = -1
            for block in range(blocks + 1):
                lo, hi = -1, -1
                if block < blocks:
                    low = np.inf
                    for x in range(block * BLOCK, min(block * BLOCK + BLOCK, columns)):
                        low = min(low, result[x])
                    lo, hi = _candidates(top[y + shift], low, block, drop, half, columns)
                if lo >= 0:  # neighbouring blocks that need this row are done together
                    if begin < 0:
                        begin, left, right = block * BLOCK, lo, hi
                    left, right = min(left, lo), max(right, hi)
                    final = min(block * BLOCK + BLOCK, columns) - 1
                elif begin >= 0:
                    _cut(
                        result,
                        where,
                        heights[y + shift],
                        (y + shift) * columns,
                        drop,
                        half,
                        begin,
                        final,
                        left,
                        right,
                        stack,
                    )
                    begin = -1
        for x in range(columns):
            if where[x] < 0:
                result[x] = math.nan
    return out, touched
