"""Bodies of revolution by their half sections."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from stepblocks import cad
from stepblocks.parts.kind import CONTACT_DEFLECTION, Manifold, Part
from stepblocks.parts.shapes import make_hull

Point = tuple[float, float]
Point3 = tuple[float, float, float]
# (radius, height) [m], for an arc (middle point, end point); closes itself
Outline = list[Point | tuple[Point, Point]]

SECTORS = 96  # of a shell of revolution; the chords of a 4 mm crown sag 2 um


class Turned(Part):
    """A part whose bodies are turned about z."""

    is_turned: ClassVar[bool] = True

    @abstractmethod
    def outlines(self) -> list[Outline]:
        """Half section of each body."""

    def solids(self) -> list[cad.door.Body]:
        """Turn them."""
        return [cad.kernel.turn(outline, (0.0, 0.0, 0.0)) for outline in self.outlines()]

    def volumes(self) -> tuple[float, ...]:
        """By Pappus and Guldin."""
        return tuple(compute_revolution_volume(outline) for outline in self.outlines())


def compute_revolution_volume(outline: Outline) -> float:
    """Compute the volume of a turned outline [m^3]: contour integral of pi r^2 dz."""
    total = 0.0
    around = list[Any]([*outline, outline[0]])
    here = around[0]
    for item in around[1:]:
        if isinstance(item[0], tuple):
            total += _integrate_arc(here, *item)
            here = item[1]
        else:
            (r0, z0), (r1, z1) = here, item
            total += (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1) / 3.0
            here = item
    return math.pi * abs(total)


def _integrate_arc(start: Point, middle: Point, end: Point) -> float:
    # Integrate r^2 dz along an arc, with r = c + rho cos t and dz = rho cos t dt
    (c, _), rho, first, last = _find_circle(
        start,
        middle,
        end,
        [p[0] ** 2 + p[1] ** 2 - start[0] ** 2 - start[1] ** 2 for p in (middle, end)],
    )

    def antiderivative(t: float) -> float:
        # rho cos t (c + rho cos t)^2, integrated
        sin, cos = math.sin(t), math.cos(t)
        return rho * (c * c * sin + c * rho * (t + sin * cos) + rho * rho * (sin - sin**3 / 3.0))

    return antiderivative(last) - antiderivative(first)


def _find_circle(
    start: Point, middle: Point, end: Point, squares: list[float]
) -> tuple[Point, float, float, float]:
    # Find centre, radius, first and last angle of an arc. `squares`: by how much middle and end lie
    # further from the origin [m^2].
    # by Cramer's rule: a library's solver gives other last bits on another processor
    (a, b), (c, d) = ((2.0 * (p[0] - start[0]), 2.0 * (p[1] - start[1])) for p in (middle, end))
    double = a * d - b * c
    x, z = (squares[0] * d - b * squares[1]) / double, (a * squares[1] - squares[0] * c) / double
    first, half, last = (math.atan2(p[1] - z, p[0] - x) for p in (start, middle, end))
    half = first + math.remainder(half - first, math.tau)
    return (
        (x, z),
        math.hypot(start[0] - x, start[1] - z),
        first,
        half + math.remainder(last - half, math.tau),
    )


def list_outline_points(outline: Outline, chord: float) -> list[Point]:
    """Outline as points, its arcs with a chordal error of at most `chord` [m]."""
    points: list[Point] = [outline[0]]  # type: ignore[list-item]
    for item in outline[1:]:
        if isinstance(item[0], tuple):
            start = points[-1]
            middle, end = item
            (x, z), radius, first, last = _find_circle(
                start,
                middle,
                end,
                [math.hypot(*p) ** 2 - math.hypot(*start) ** 2 for p in (middle, end)],
            )
            count = max(
                1, math.ceil(abs(last - first) / (2.0 * math.acos(max(1.0 - chord / radius, -1.0))))
            )
            angles = np.linspace(first, last, count + 1)[1:-1]
            points += [*((x + radius * math.cos(a), z + radius * math.sin(a)) for a in angles), end]
        else:
            points.append(item)
    return points


def list_ring_points(radius: float, height: float) -> list[Point3]:
    """Points round the axis."""
    if radius == 0.0:
        return [(0.0, 0.0, height)]
    angles = np.arange(SECTORS) * (2.0 * math.pi / SECTORS)
    return [(radius * math.cos(a), radius * math.sin(a), height) for a in angles]


def make_turned_hull(outline: Outline) -> Manifold:
    """Turn a convex outline."""
    return make_hull(
        point
        for r, z in list_outline_points(outline, CONTACT_DEFLECTION)
        for point in list_ring_points(r, z)
    )


def make_frusta(outline: Outline) -> list[Manifold]:
    """Frusta of a solid of revolution whose radius is a function of height."""
    points = [(r, z) for r, z in list_outline_points(outline, 5e-6) if r > 0.0]
    return [
        make_hull([*list_ring_points(r0, z0), *list_ring_points(r1, z1)])
        for (r0, z0), (r1, z1) in itertools.pairwise(points)
        if z1 > z0
    ]


def make_sectors(cell: Sequence[Point]) -> list[Manifold]:
    """Turn a convex cell of the half section into sectors."""
    turns = itertools.pairwise(2.0 * math.pi * sector / SECTORS for sector in range(SECTORS + 1))
    return [
        make_hull((r * math.cos(a), r * math.sin(a), z) for r, z in cell for a in angles)
        for angles in turns
    ]
