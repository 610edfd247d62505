"""Arcs of an outline as chords."""

from __future__ import annotations

import math

import numpy as np

Point = tuple[float, float]


def arc_points(start: Point, middle: Point, end: Point, chord: float) -> list[Point]:
    """Replace an arc by points on it.

    Examples
    --------
    >>> points = arc_points((1.0, 0.0), (0.7071067811865476, 0.7071067811865475), (0.0, 1.0), 0.05)
    >>> len(points), points[-1]
    (3, (0.0, 1.0))
    """
    matrix = 2.0 * np.array([[middle[0] - start[0], middle[1] - start[1]], [end[0] - start[0], end[1] - start[1]]])
    squares = np.array([math.hypot(*p) ** 2 - math.hypot(*start) ** 2 for p in (middle, end)])
    x, z = (float(value) for value in np.linalg.solve(matrix, squares))
    radius = math.hypot(start[0] - x, start[1] - z)
    first, half, last = (math.atan2(p[1] - z, p[0] - x) for p in (start, middle, end))
    half = first + math.remainder(half - first, math.tau)
    last = half + math.remainder(last - half, math.tau)
    count = max(1, math.ceil(abs(last - first) / (2.0 * math.acos(max(1.0 - chord / radius, -1.0)))))
    angles = np.linspace(first, last, count + 1)[1:-1]
    return [*((x + radius * math.cos(a), z + radius * math.sin(a)) for a in angles), end]
