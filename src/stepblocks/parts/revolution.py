"""Bodies of revolution by their half sections."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np

from stepblocks import cad
from stepblocks.parts.kind import CONTACT_DEFLECTION, Manifold, Part
from stepblocks.parts.shapes import make_hull

Point = tuple[float, float]
Point3 = tuple[float, float, float]
# (radius, height) [m], for an arc (middle point, end point); closes itself
Outline = list[Point | tuple[Point, Point]]

SECTORS = 96  # of a shell of revolution; the chords of a 4 mm crown sag 2 um
PIECE_DEFLECTION = 5e-6  # chordal error of convex pieces where nothing touches [m]


class Turned(Part):
    """A part whose bodies are turned about z."""

    is_turned: ClassVar[bool] = True

    @abstractmethod
    def outlines(self) -> list[Outline]:
        """Half section of each body."""

    def solids(self) -> list[cad.door.Body]:
        """Turn them."""
        return [
            cad.kernel.revolve_about_vertical(outline, (0.0, 0.0, 0.0))
            for outline in self.outlines()
        ]

    def volumes(self) -> tuple[float, ...]:
        """By Pappus and Guldin."""
        return tuple(compute_revolution_volume(outline) for outline in self.outlines())


@dataclass(frozen=True)
class _Segment:
    """A line of an outline, or an arc through a middle point."""

    start: Point
    end: Point
    middle: Point | None = None  # of an arc


def _yield_segments(outline: Outline) -> Iterator[_Segment]:
    """Yield the segments of an outline, that which closes it not among them."""
    start = cast(Point, outline[0])
    for item in outline[1:]:
        if isinstance(item[0], tuple):
            middle, end = item
            yield _Segment(start, end, middle)
        else:
            end = item
            yield _Segment(start, end)
        start = end


def compute_revolution_volume(outline: Outline) -> float:
    """Compute the volume of a turned outline [m^3]: contour integral of pi r^2 dz."""
    total = 0.0
    closed = [*outline, outline[0]]
    for segment in _yield_segments(closed):
        if segment.middle is not None:
            total += _integrate_squared_radius_over_arc(segment.start, segment.middle, segment.end)
        else:
            r0, z0 = segment.start
            r1, z1 = segment.end
            total += (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1) / 3.0
    return math.pi * abs(total)


@dataclass(frozen=True)
class _Arc:
    """An arc of a circle, by its angles at the centre [rad]."""

    centre: Point
    radius: float
    first: float
    last: float


def _integrate_squared_radius_over_arc(start: Point, middle: Point, end: Point) -> float:
    """Integrate r^2 dz along an arc, with r = c + rho cos t and dz = rho cos t dt."""
    start_r, start_z = start
    middle_r, middle_z = middle
    end_r, end_z = end
    arc = _find_arc_through_points(
        start,
        middle,
        end,
        middle_r**2 + middle_z**2 - start_r**2 - start_z**2,
        end_r**2 + end_z**2 - start_r**2 - start_z**2,
    )
    c, _ = arc.centre
    rho = arc.radius

    def antiderivative(angle: float) -> float:
        """Return the integral of rho cos t (c + rho cos t)^2 up to an angle t."""
        sin = math.sin(angle)
        cos = math.cos(angle)
        linear = c * rho * (angle + sin * cos)
        quadratic = rho * rho * (sin - sin**3 / 3.0)
        return rho * (c * c * sin + linear + quadratic)

    return antiderivative(arc.last) - antiderivative(arc.first)


def _find_arc_through_points(
    start: Point, middle: Point, end: Point, middle_square_excess: float, end_square_excess: float
) -> _Arc:
    """Find the circle through three points.

    `middle_square_excess` and `end_square_excess` say by how much the squares of their distances
    from the origin exceed that of the start [m^2].
    """
    start_r, start_z = start
    # by Cramer's rule: a library's solver gives other last bits on another processor
    a, b = 2.0 * (middle[0] - start_r), 2.0 * (middle[1] - start_z)
    c, d = 2.0 * (end[0] - start_r), 2.0 * (end[1] - start_z)
    determinant = a * d - b * c
    x = (middle_square_excess * d - b * end_square_excess) / determinant
    z = (a * end_square_excess - middle_square_excess * c) / determinant
    first = math.atan2(start_z - z, start_r - x)
    half = math.atan2(middle[1] - z, middle[0] - x)
    last = math.atan2(end[1] - z, end[0] - x)
    # the way that leads through the middle
    half = first + math.remainder(half - first, math.tau)
    last = half + math.remainder(last - half, math.tau)
    return _Arc((x, z), math.hypot(start_r - x, start_z - z), first, last)


def list_outline_points(outline: Outline, chordal_error: float) -> list[Point]:
    """List an outline as points (radius, height) [m].

    Parameters
    ----------
    outline : list
        Points, and pairs of middle and end of arcs.
    chordal_error : float
        Chordal error of its arcs, at most [m].

    Returns
    -------
    list of tuple of float
        Points in the order of the outline, the first not repeated.
    """
    points = [cast(Point, outline[0])]
    for segment in _yield_segments(outline):
        if segment.middle is not None:
            points += _list_inner_arc_points(
                segment.start, segment.middle, segment.end, chordal_error
            )
        points.append(segment.end)
    return points


def _list_inner_arc_points(
    start: Point, middle: Point, end: Point, chordal_error: float
) -> list[Point]:
    """List the points between both ends of an arc, off it by `chordal_error` at most [m]."""
    start_square = math.hypot(*start) ** 2
    middle_excess = math.hypot(*middle) ** 2 - start_square
    end_excess = math.hypot(*end) ** 2 - start_square
    arc = _find_arc_through_points(start, middle, end, middle_excess, end_excess)
    largest_step = 2.0 * math.acos(max(1.0 - chordal_error / arc.radius, -1.0))
    count = max(1, math.ceil(abs(arc.last - arc.first) / largest_step))
    x, z = arc.centre
    points = []
    for angle in np.linspace(arc.first, arc.last, count + 1)[1:-1]:
        points.append((x + arc.radius * math.cos(angle), z + arc.radius * math.sin(angle)))
    return points


def list_ring_points(radius: float, height: float) -> list[Point3]:
    """List the points of a ring about the axis; a ring of radius 0 is one point."""
    if radius == 0.0:
        return [(0.0, 0.0, height)]
    angles = np.arange(SECTORS) * (2.0 * math.pi / SECTORS)
    return [(radius * math.cos(a), radius * math.sin(a), height) for a in angles]


def make_turned_hull(outline: Outline) -> Manifold:
    """Turn a convex outline."""
    points: list[Point3] = []
    for radius, height in list_outline_points(outline, CONTACT_DEFLECTION):
        points += list_ring_points(radius, height)
    return make_hull(points)


def make_frusta(outline: Outline) -> list[Manifold]:
    """Cut a solid of revolution, whose radius is a function of height, into frusta."""
    rings = []
    for radius, height in list_outline_points(outline, PIECE_DEFLECTION):
        if radius > 0.0:
            rings.append((radius, height))
    frusta = []
    for (r0, z0), (r1, z1) in itertools.pairwise(rings):
        if z1 > z0:
            frusta.append(make_hull([*list_ring_points(r0, z0), *list_ring_points(r1, z1)]))
    return frusta


def turn_cell_into_sectors(cell_corners: Sequence[Point]) -> list[Manifold]:
    """Turn a convex cell of the half section into sectors."""
    turns = [2.0 * math.pi * sector / SECTORS for sector in range(SECTORS + 1)]
    sectors = []
    for angles in itertools.pairwise(turns):
        corners = []
        for radius, height in cell_corners:
            for angle in angles:
                corners.append((radius * math.cos(angle), radius * math.sin(angle), height))
        sectors.append(make_hull(corners))
    return sectors
