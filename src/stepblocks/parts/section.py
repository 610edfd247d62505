"""Half sections of the bodies of revolution, as outlines in radius and height: what the solids turn and the checks integrate.

An outline is a list of points (radius, height) [m]; an arc is a pair (middle point, end point). It closes by itself.
"""

from __future__ import annotations

import math

from stepblocks.parts.margins.declaration import CrownOnTooth
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.tips.declaration import HookTip, StraightTip

Point = tuple[float, float]
Outline = list[Point | tuple[Point, Point]]


def tooth_outline(margin: CrownOnTooth) -> Outline:
    """Half section of the prepared tooth; the finish line lies at height 0."""
    R, w, top = margin.margin_radius.nominal, margin.finish_line.width.nominal, margin.preparation_height.nominal
    outline: Outline = [(0.0, -margin.root_length.nominal), (R, -margin.root_length.nominal), (R, 0.0)]
    if margin.finish_line.kind == "chamfer":
        outline.append(((R - w * math.sqrt(0.5), w * (1.0 - math.sqrt(0.5))), (R - w, w)))
        start = w
    else:
        if margin.finish_line.kind == "shoulder":
            outline.append((R - w, 0.0))
        start = 0.0
    outline += [(R - w - (top - start) * math.tan(margin.taper.nominal), top), (0.0, top)]
    return outline


def crown_outline(margin: CrownOnTooth) -> Outline:
    """Half section of the crown, seated with its gaps."""
    R, w, g = margin.margin_radius.nominal, margin.finish_line.width.nominal, margin.marginal_gap.nominal
    slope, inner = math.tan(margin.taper.nominal), margin.internal_gap.nominal
    across = inner / math.cos(margin.taper.nominal)
    ceiling = margin.preparation_height.nominal + inner
    outer, roof = R + margin.horizontal_discrepancy.nominal, ceiling + margin.shell_thickness.nominal
    kind = margin.finish_line.kind
    start = w if kind == "chamfer" else 0.0

    def wall(height: float) -> float:
        return R - w - (height - start) * slope + across

    outline: Outline = [(0.0, ceiling), (wall(ceiling), ceiling)]
    if kind == "feather-edge":
        v = margin.opening.nominal
        outline += [(R - v * slope + g / math.cos(margin.taper.nominal), v), (outer, v)]
    else:
        foot = g + w if kind == "chamfer" else g
        outline.append((wall(foot), foot))
        corner = [(R + z, x) for x, z in margin.corner]
        if kind == "chamfer":
            outline.append(_fitting_arc((wall(foot), foot), (R, g), w))
        outline += corner
        if corner[-1][0] != outer:
            outline.append((outer, corner[-1][1]))
    outline += [(outer, roof), (0.0, roof)]
    return outline


def _fitting_arc(start: Point, end: Point, radius: float) -> tuple[Point, Point]:
    """Arc of the finish line's radius between two points, bulging towards the axis's foot as the tooth's does."""
    half_x, half_z = 0.5 * (end[0] - start[0]), 0.5 * (end[1] - start[1])
    half = math.hypot(half_x, half_z)
    sagitta = radius - math.sqrt(radius * radius - half * half)
    middle = (start[0] + half_x + sagitta * half_z / half, start[1] + half_z - sagitta * half_x / half)
    return middle, end


def tip_outline(tip: StraightTip | HookTip) -> Outline:
    """Half section of ball and cone, and of the shank where it is straight; the contact point is the origin."""
    R, half, shank = tip.ball_radius.nominal, tip.cone_angle.nominal, tip.shank_radius.nominal
    middle = 0.5 * (0.5 * math.pi - half)  # polar angle from the contact point to halfway up the ball
    outline: Outline = [
        (0.0, 0.0),
        ((R * math.sin(middle), R * (1.0 - math.cos(middle))), tip.cone_start),
        (shank, tip.cone_end),
    ]
    end = tip.length.nominal if isinstance(tip, StraightTip) else tip.cone_end
    if isinstance(tip, StraightTip):
        outline.append((shank, end))
    outline.append((0.0, end))
    return outline


def sheath_outline(sheath: Sheath) -> Outline:
    """Half section of a sheath; its near end lies at height 0."""
    bore, outer = 0.5 * sheath.bore.nominal, 0.5 * sheath.outer_diameter.nominal
    length, c = sheath.length.nominal, sheath.edge_break.nominal
    if c == 0.0:
        return [(bore, 0.0), (outer, 0.0), (outer, length), (bore, length)]
    return [(bore, 0.0), (outer - c, 0.0), (outer, c), (outer, length - c), (outer - c, length), (bore, length)]
