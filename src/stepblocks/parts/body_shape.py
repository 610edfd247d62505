"""What a workshop does to every bench block: edge breaks, fixing holes, the engraved identity; as bodies to cut away."""

from __future__ import annotations

import math
from collections.abc import Iterator

from stepblocks.cad import kernel
from stepblocks.cad.kernel import Line
from stepblocks.parts.body import DRILL_POINT, Body, Mounting
from stepblocks.parts.lettering import engraved_text, letters

_OVER = 1e-3  # how far a cutting body stands out of the block [m]


def section_outline(body: Body, left_top: float, right_top: float) -> tuple[list[tuple[float, float]], ...]:
    """Corners of the section across the edge, without what happens between the two working faces."""
    half, base, c = 0.5 * body.length.nominal, -body.thickness.nominal, body.edge_break.nominal
    right = [(half - c, base), (half, base + c), (half, right_top - c), (half - c, right_top)]
    left = [(-half + c, left_top), (-half, left_top - c), (-half, base + c), (-half + c, base)]
    return _distinct(right), _distinct(left)


def _distinct(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    return [point for index, point in enumerate(points) if index == 0 or point != points[index - 1]]


def body_cuts(body: Body, identity: str, left_top: float, right_top: float, edge: float = 0.0) -> list[kernel.Body]:
    """Bodies to cut from a block: edge breaks along x and z, holes, engraving."""
    cuts = list(_edge_breaks(body, left_top, right_top, edge)) if body.edge_break.nominal > 0.0 else []
    for x in (-0.5 * body.mounting.spacing.nominal, 0.5 * body.mounting.spacing.nominal):
        cuts.append(_hole(body, body.mounting, x))
    cuts.extend(_engraving(body, identity))
    return cuts


def _edge_breaks(body: Body, left_top: float, right_top: float, edge: float) -> Iterator[kernel.Body]:
    length, width, base, c = body.length.nominal, body.width.nominal, -body.thickness.nominal, body.edge_break.nominal
    long = 0.5 * length + _OVER
    for side in (-1.0, 1.0):
        y = side * 0.5 * width
        for x0, x1, top in ((-long, edge, left_top), (edge, long, right_top)):
            yield _prism_along_x(
                x0,
                x1,
                [
                    (y + side * _OVER, top - c - _OVER),
                    (y - side * (c + _OVER), top + _OVER),
                    (y + side * _OVER, top + _OVER),
                ],
            )
        yield _prism_along_x(
            -long,
            long,
            [
                (y + side * _OVER, base + c + _OVER),
                (y - side * (c + _OVER), base - _OVER),
                (y + side * _OVER, base - _OVER),
            ],
        )
        for end in (-1.0, 1.0):
            x = end * 0.5 * length
            corner = [
                (x + end * _OVER, y - side * (c + _OVER)),
                (x - end * (c + _OVER), y + side * _OVER),
                (x + end * _OVER, y + side * _OVER),
            ]
            points = [(px, py, base - _OVER) for px, py in corner]
            yield _prism(points, (0.0, 0.0, body.thickness.nominal + max(left_top, right_top) + 2.0 * _OVER))


def _prism_along_x(x0: float, x1: float, section: list[tuple[float, float]]) -> kernel.Body:
    return _prism([(x0, y, z) for y, z in section], (x1 - x0, 0.0, 0.0))


def _prism(points: list[tuple[float, float, float]], direction: tuple[float, float, float]) -> kernel.Body:
    return kernel.extruded(points[0], [Line(point) for point in (*points[1:], points[0])], direction)


def _hole(body: Body, mounting: Mounting, x: float) -> kernel.Body:
    base, drill, entry = -body.thickness.nominal, 0.5 * mounting.hole_diameter, 0.5 * mounting.entry_diameter
    depth = mounting.depth.nominal
    if mounting.kind == "tapped":
        sink = entry - drill  # 90 degree countersink
        point = drill / math.tan(0.5 * DRILL_POINT)
        outline = [(0.0, -_OVER), (entry + _OVER, -_OVER), (drill, sink), (drill, depth), (0.0, depth + point)]
        return kernel.turned(outline, (x, 0.0, base))
    outline = [
        (0.0, base - _OVER),
        (drill, base - _OVER),
        (drill, -depth),
        (entry, -depth),
        (entry, _OVER),
        (0.0, _OVER),
    ]
    return kernel.turned(outline, (x, 0.0, 0.0))


def _engraving(body: Body, identity: str) -> Iterator[kernel.Body]:
    front, middle = -0.5 * body.width.nominal, -0.5 * body.thickness.nominal
    start = front - 0.1 * _OVER
    cut = (0.0, body.engraving.depth.nominal + 0.1 * _OVER, 0.0)
    for outer, holes in letters(engraved_text(identity), body.engraving.height.nominal):
        ring = [(float(u), start, middle + float(v)) for u, v in outer]
        inner = [[(float(u), start, middle + float(v)) for u, v in hole] for hole in holes]
        yield kernel.extruded(ring[0], [Line(point) for point in (*ring[1:], ring[0])], cut, inner)
