"""Volumes of all parts in closed form, derived without the CAD kernel.

A block is two chamfered halves, integrated in horizontal slices; a body of revolution follows from Pappus and Guldin on its half
section, ``V = pi * contour integral of r^2 dz``; the hook adds a torus. No number here comes from the kernel that is checked.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from stepblocks.parts.body import DRILL_POINT, Body
from stepblocks.parts.lettering import engraved_text, letters
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.section import Outline, crown_outline, sheath_outline, tip_outline, tooth_outline
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip


def solid_volumes(stimulus: Stimulus) -> tuple[float, ...]:
    """Volumes of the solids of a stimulus.

    Parameters
    ----------
    stimulus : Stimulus
        What is asked for.

    Returns
    -------
    tuple of float
        Volume of each solid [m^3], in the order in which they are built.
    """
    match stimulus:
        case StepBlock():
            return (_step_block(stimulus),)
        case MarginBlock():
            return (_margin_block(stimulus),)
        case CrownOnTooth():
            return _of_revolution(tooth_outline(stimulus)), _of_revolution(crown_outline(stimulus))
        case StraightTip():
            return (_of_revolution(tip_outline(stimulus)),)
        case HookTip():
            wire = math.pi * stimulus.shank_radius.nominal**2
            bend = wire * stimulus.bend_radius.nominal * stimulus.bend_angle.nominal
            return (_of_revolution(tip_outline(stimulus)) + bend + wire * stimulus.straight_length.nominal,)
        case Sheath():
            return (_of_revolution(sheath_outline(stimulus)),)


def unpierced_volume(stimulus: Stimulus) -> float:
    """Volume of a stimulus with its fixing holes and engraving filled, as its convex pieces describe it."""
    total = math.fsum(solid_volumes(stimulus))
    match stimulus:
        case StepBlock():
            return total + _common_cuts(stimulus.body, stimulus.id, (0.0, stimulus.height.nominal))
        case MarginBlock():
            return total + _common_cuts(stimulus.body, stimulus.id, (0.0, stimulus.horizontal_discrepancy.nominal))
        case _:
            return total


def _of_revolution(outline: Outline) -> float:
    """Contour integral of pi r^2 dz over a closed outline of lines and arcs."""
    total, here = 0.0, outline[0]
    for item in (*outline[1:], outline[0]):
        if isinstance(item[0], tuple):
            middle, end = item
            total += _along_arc(here, middle, end)  # type: ignore[arg-type]
        else:
            end = item
            total += _along_line(here, end)  # type: ignore[arg-type]
        here = end
    return math.pi * abs(total)


def _along_line(start: tuple[float, float], end: tuple[float, float]) -> float:
    (r0, z0), (r1, z1) = start, end
    return (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1) / 3.0


def _along_arc(start: tuple[float, float], middle: tuple[float, float], end: tuple[float, float]) -> float:
    """Integrate r^2 dz with r = c + rho cos t, z = d + rho sin t from one end of the arc to the other."""
    c, d, rho = _circle(start, middle, end)
    first, half, last = (math.atan2(z - d, r - c) for r, z in (start, middle, end))
    half = first + math.remainder(half - first, math.tau)
    last = half + math.remainder(last - half, math.tau)

    def antiderivative(t: float) -> float:
        # rho cos t (c + rho cos t)^2, integrated
        sin, cos = math.sin(t), math.cos(t)
        return rho * (c * c * sin + c * rho * (t + sin * cos) + rho * rho * (sin - sin**3 / 3.0))

    return antiderivative(last) - antiderivative(first)


def _circle(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> tuple[float, float, float]:
    """Centre and radius of the circle through three points."""
    matrix = 2.0 * np.array([[b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]])
    squares = np.array([b[0] ** 2 + b[1] ** 2 - a[0] ** 2 - a[1] ** 2, c[0] ** 2 + c[1] ** 2 - a[0] ** 2 - a[1] ** 2])
    x, z = np.linalg.solve(matrix, squares)
    return float(x), float(z), math.hypot(a[0] - x, a[1] - z)


def _half_block(body: Body, extent: float, top: float) -> float:
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


def _common_cuts(body: Body, identity: str, tops: tuple[float, float]) -> float:
    """Holes and engraving."""
    mounting = body.mounting
    drill, entry, depth = 0.5 * mounting.hole_diameter, 0.5 * mounting.entry_diameter, mounting.depth.nominal
    if mounting.kind == "tapped":
        sink = entry - drill
        frustum = math.pi * sink * (entry * entry + entry * drill + drill * drill) / 3.0
        point = math.pi * drill**3 / (3.0 * math.tan(0.5 * DRILL_POINT))
        holes = 2.0 * (frustum + math.pi * drill * drill * (depth - sink) + point)
    else:
        bore = body.thickness.nominal - depth
        holes = sum(math.pi * (drill * drill * bore + entry * entry * (depth + top)) for top in tops)
    area = 0.0
    for outer, inner in letters(engraved_text(identity), body.engraving.height.nominal):
        area += _shoelace(outer) - sum(_shoelace(hole) for hole in inner)
    return holes + area * body.engraving.depth.nominal


def _shoelace(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    x, y = points[:, 0], points[:, 1]
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def _step_block(block: StepBlock) -> float:
    body, H, r, feature = block.body, block.height.nominal, block.edge_radius.nominal, block.metrology
    half, c = 0.5 * body.length.nominal, body.edge_break.nominal
    volume = _half_block(body, half, 0.0) + _half_block(body, half, H)
    # the rounding takes u(z) = r - sqrt(r^2 - zeta^2) off a face that is W - 2 (c - r) - 2 zeta wide
    volume -= (body.width.nominal - 2.0 * max(c - r, 0.0)) * r * r * (1.0 - 0.25 * math.pi) - (
        r**3 / 3.0 if c > 0.0 else 0.0
    )
    lane, w = feature.lane.nominal, feature.width.nominal
    if feature.kind == "groove":  # from the lane's boundary to the chamfered side, z from 0 to H
        volume -= w * (lane * H - (c * H - 0.5 * H * H if c > 0.0 else 0.0))
    else:  # the side's edge break runs on through the ridge, from c inside at z = 0
        volume += w * (lane * H - (c * H + 0.5 * H * H if c > 0.0 else 0.0))
    return volume - _common_cuts(body, block.id, (0.0, H))


def _margin_block(margin: MarginBlock) -> float:
    """Halves on either side of x = 0 at their own heights, less the gap, corrected at the crown's corner.

    Every cut of the section lies at heights where the chamfers of the sides narrow the block; strips are integrated exactly.
    """
    body, half = margin.body, 0.5 * margin.body.length.nominal
    g, v, h = margin.marginal_gap.nominal, margin.opening.nominal, margin.horizontal_discrepancy.nominal
    volume = _half_block(body, half, 0.0) + _half_block(body, half, h)
    volume -= _strip(
        body,
        h,
        [(0.0, -margin.gap_depth.nominal), (g, -margin.gap_depth.nominal), *margin.corner, (0.0, h)]
        if v >= 0.0
        else [(0.0, -margin.gap_depth.nominal), (g, -margin.gap_depth.nominal), (g, g), (0.0, g)],
    )
    if v < 0.0:  # the lip stands over the tooth, on the tooth's side, where the left half's chamfer applies
        c = body.edge_break.nominal
        narrowed = 2.0 * c * (h - g) + h * h - g * g if c > 0.0 else 0.0
        volume += -v * (body.width.nominal * (h - g) - narrowed)
    return volume - _common_cuts(body, margin.id, (0.0, h))


def _strip(body: Body, top: float, polygon: list[tuple[float, float]]) -> float:
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
