"""What every bench block is made of: two chamfered halves, edge breaks, fixing holes, letters; as bodies, pieces, volumes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

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


def half_points(
    body: Body, side: float, top: float, start: float, crest: Sequence[tuple[float, float]]
) -> list[tuple[float, float, float]]:
    """Corners of one chamfered half: from the section at `start` outwards, with a crest of (x, z) points at the section."""
    out, half = side * 0.5 * body.length.nominal, 0.5 * body.width.nominal
    base, c = -body.thickness.nominal, body.edge_break.nominal
    points: list[tuple[float, float, float]] = []
    for y in (-1.0, 1.0):
        for z, inset in ((base, c), (base + c, 0.0), (top - c, 0.0), (top, c)):
            corner = max(c - 2.0 * inset, 0.0)
            x, w = out - side * inset, half - inset
            points += [(x - side * corner, y * w, z), (x, y * (w - corner), z), (start, y * w, z)]
        for x, z in crest:
            points.append((x, y * (half - max(0.0, z - (top - c))), z))
        # where a chamfer's corner triangle closes, half way up
        for z in (base + 0.5 * c, top - 0.5 * c):
            points.append((out - side * 0.5 * c, y * (half - 0.5 * c), z))
    return points


def half_volume(body: Body, extent: float, top: float) -> float:
    """Volume of the part of a block on one side of its edge: a box with every edge broken but the four at the section.

    The horizontal slice at an inset s from the chamfers is ``(extent - s)(width - 2 s)`` less two corner triangles of leg ``c - 2 s``.
    """
    width, c = body.width.nominal, body.edge_break.nominal
    height = top + body.thickness.nominal

    def rectangle(s: float) -> float:  # antiderivative of (extent - s)(width - 2 s)
        return extent * width * s - (2.0 * extent + width) * s * s / 2.0 + 2.0 * s**3 / 3.0

    # two corner triangles, leg^2 / 2 each; the leg vanishes at s = c / 2
    corners_at_chamfer = c**3 / 6.0
    straight = height - 2.0 * c
    return straight * (extent * width - c * c) + 2.0 * (rectangle(c) - corners_at_chamfer)


def cut_volume(body: Body, identity: str, rise: float) -> float:
    """Volume of holes and engraving [m^3]."""
    mounting = body.mounting
    drill, entry, depth = 0.5 * mounting.hole_diameter, 0.5 * mounting.entry_diameter, mounting.depth.nominal
    if mounting.kind == "tapped":
        sink = entry - drill
        frustum = math.pi * sink * (entry * entry + entry * drill + drill * drill) / 3.0
        point = math.pi * drill**3 / (3.0 * math.tan(0.5 * DRILL_POINT))
        holes = 2.0 * (frustum + math.pi * drill * drill * (depth - sink) + point)
    else:
        bore = body.thickness.nominal - depth
        holes = sum(math.pi * (drill * drill * bore + entry * entry * (depth + top)) for top in (0.0, rise))
    area = 0.0
    for outer, inner in letters(engraved_text(identity), body.engraving.height.nominal):
        area += _shoelace(outer) - sum(_shoelace(hole) for hole in inner)
    return holes + area * body.engraving.depth.nominal


def _shoelace(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    x, y = points[:, 0], points[:, 1]
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def strip_volume(body: Body, top: float, polygon: list[tuple[float, float]]) -> float:
    """Volume that a section polygon (x, z) takes out of a half with chamfered sides: contour integral of W(z) x dz."""
    width, c = body.width.nominal, body.edge_break.nominal
    total = 0.0
    knee = top - c
    for (x0, z0), (x1, z1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        cuts = sorted(
            {0.0, 1.0, *([(knee - z0) / (z1 - z0)] if z1 != z0 and 0.0 < (knee - z0) / (z1 - z0) < 1.0 else [])}
        )
        for a, b in itertools.pairwise(cuts):
            (xa, za), (xb, zb) = ((x0 + t * (x1 - x0), z0 + t * (z1 - z0)) for t in (a, b))
            mid = 0.5 * (za + zb)
            values = [(width - 2.0 * max(z - knee, 0.0)) * x for x, z in ((xa, za), (0.5 * (xa + xb), mid), (xb, zb))]
            total += (zb - za) * (values[0] + 4.0 * values[1] + values[2]) / 6.0  # Simpson, exact for a quadratic
    return abs(total)
