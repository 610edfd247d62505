"""Views of what is turned: probe tips, prepared tooth and crown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from stepblocks.artefacts.numbers import limits_text
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.revolution import Turned
from stepblocks.workshop.drawing.block_views import round_scale
from stepblocks.workshop.drawing.sheet import Point, Sheet

Numbered = Mapping[str, tuple[int, Characteristic]]


def _flattened(outline: Sequence[Any]) -> Iterator[Point]:
    """Points of an outline, arcs as ninety-six chords."""
    here: Point = outline[0]
    yield here
    for item in outline[1:]:
        if isinstance(item[0], tuple):
            yield from _arc(here, item[0], item[1])
            here = item[1]
        else:
            here = item
            yield here


def _arc(a: Point, b: Point, c: Point) -> Iterator[Point]:
    d = 2.0 * (a[0] * (b[1] - c[1]) + b[0] * (c[1] - a[1]) + c[0] * (a[1] - b[1]))
    sa, sb, sc = (p[0] ** 2 + p[1] ** 2 for p in (a, b, c))
    x = (sa * (b[1] - c[1]) + sb * (c[1] - a[1]) + sc * (a[1] - b[1])) / d
    y = (sa * (c[0] - b[0]) + sb * (a[0] - c[0]) + sc * (b[0] - a[0])) / d
    start, middle, end = (math.atan2(p[1] - y, p[0] - x) for p in (a, b, c))
    radius = math.hypot(a[0] - x, a[1] - y)
    turn = (end - start) % math.tau
    if (middle - start) % math.tau > turn:
        turn -= math.tau
    for step in range(1, 97):
        angle = start + turn * step / 96.0
        yield x + radius * math.cos(angle), y + radius * math.sin(angle)


def tip_views(sheet: Sheet, tip: StraightTip | HookTip, numbered: Numbered) -> list[str]:
    """Draw a tip lying on its side and its ball enlarged; return the lines of its notes."""
    shank, end = tip.shank_radius.nominal, tip.length.nominal if isinstance(tip, StraightTip) else tip.cone_end
    lines = [[(z, side * r) for r, z in _flattened(tip.outline())] for side in (1.0, -1.0)]
    if isinstance(tip, HookTip):
        lines += _bend(tip)
    low = [min(point[k] for line in lines for point in line) for k in (0, 1)]
    high = [max(point[k] for line in lines for point in line) for k in (0, 1)]
    s = round_scale(min(180.0 / (1e3 * (high[0] - low[0])), 150.0 / (1e3 * (high[1] - low[1])), 40.0 / (shank * 1e3)))
    cx, cy = 40.0, 170.0 - 0.5e3 * s * (low[1] + high[1])

    def at(height: float, radius: float) -> Point:
        return cx + height * 1e3 * s, cy + radius * 1e3 * s

    for line in lines:
        sheet.polyline([at(*point) for point in line])
    sheet.line((cx - 5.0, cy), (at(end, 0.0)[0] + 5.0, cy), "CENTRE")
    number, one = numbered["shank_diameter"]
    if isinstance(tip, StraightTip):
        sheet.dimension(number, one, at(end, -shank), at(end, shank), (at(end, 0.0)[0] + 14.0, cy), s, 90.0)
        number, one = numbered["length"]
        sheet.dimension(number, one, at(0.0, 0.0), at(end, -shank), (cx, at(0.0, -shank)[1] - 12.0), s, 0.0)
    else:
        outer, inner = lines[-2][-2], lines[-2][-1]
        middle = at(0.5 * (outer[0] + inner[0]), 0.5 * (outer[1] + inner[1]))
        text = f"dia. {limits_text(one.nominal, one.lower, one.upper)}"
        sheet.leader(middle, (middle[0] + 14.0, middle[1] - 6.0), text, number)
        number, one = numbered["bend_radius"]
        half = 0.5 * tip.bend_angle.nominal
        wire = tip.bend_radius.nominal
        bent = at(tip.cone_end + wire * math.sin(half), wire * (1.0 - math.cos(half)))
        text = f"R {limits_text(one.nominal, one.lower, one.upper)}, axis of the wire"
        sheet.leader(bent, (bent[0] + 18.0, bent[1] - 10.0), text, number)
    sheet.text((cx, at(0.0, low[1])[1] - 26.0), f"side {s:g}:1", 2.5)
    _ball(sheet, tip, numbered)
    return []


def _bend(tip: HookTip) -> list[list[Point]]:
    """Outer and inner line of the bent wire with the straight shank, then its end."""
    top, R, r, total = tip.cone_end, tip.bend_radius.nominal, tip.shank_radius.nominal, tip.bend_angle.nominal
    run = tip.straight_length.nominal
    lines = []
    for offset in (-r, r):
        turns = [total * index / 60.0 for index in range(61)]
        arc = [(top + (R + offset) * math.sin(t), R - (R + offset) * math.cos(t)) for t in turns]
        arc.append((arc[-1][0] + run * math.cos(total), arc[-1][1] + run * math.sin(total)))
        lines.append(arc)
    return [*lines, [lines[0][-1], lines[1][-1]]]


def _ball(sheet: Sheet, tip: StraightTip | HookTip, numbered: Numbered) -> None:
    cx, cy = 320.0, 215.0
    R = tip.ball_radius.nominal
    s = round_scale(22.0 / (R * 1e3))
    height = 3.2 * R
    outline = [(r, z) for r, z in _flattened(tip.outline()) if z <= height]
    slope = math.tan(tip.cone_angle.nominal)
    start = tip.cone_start
    outline.append((start[0] + (height - start[1]) * slope, height))
    for side in (1.0, -1.0):
        sheet.polyline([(cx - 40.0 + z * 1e3 * s, cy + side * r * 1e3 * s) for r, z in outline])
    sheet.circle((cx - 40.0 + R * 1e3 * s, cy), R * 1e3 * s, "HIDDEN")
    sheet.line((cx - 45.0, cy), (cx + 45.0, cy), "CENTRE")
    number, one = numbered["ball_radius"]
    tipped = (cx - 40.0 + R * 1e3 * s * (1.0 - math.cos(1.0)), cy + R * 1e3 * s * math.sin(1.0))
    sheet.leader(tipped, (cx - 34.0, cy + 40.0), f"SR {limits_text(one.nominal, one.lower, one.upper)}", number)
    sheet.text((cx - 20.0, cy - 40.0), f"ball {s:g}:1", 2.5, "BOTTOM_CENTER")


def turned_views(sheet: Sheet, part: Turned, numbered: Numbered) -> list[str]:
    """Draw the half sections of any turned part, mirrored, its axis along the sheet; return the lines of its notes."""
    outlines = [list(_flattened(outline)) for outline in part.outlines()]
    low, high = (chosen(z for outline in outlines for _, z in outline) for chosen in (min, max))
    widest = max(r for outline in outlines for r, _ in outline)
    s = round_scale(min(150.0 / (1e3 * (high - low)), 45.0 / (1e3 * widest)))
    left, cy = 50.0, 190.0

    def at(height: float, radius: float) -> Point:
        return left + (height - low) * 1e3 * s, cy + radius * 1e3 * s

    for outline in outlines:
        for side in (1.0, -1.0):
            sheet.polyline([at(z, side * r) for r, z in outline])
    sheet.line((left - 5.0, cy), (at(high, 0.0)[0] + 5.0, cy), "CENTRE")
    base = at(low, -widest)[1] - 14.0
    if "length" in numbered:
        number, one = numbered["length"]
        sheet.dimension(number, one, at(low, -widest), at(low + one.nominal, -widest), (left, base), s)
    if "diameter" in numbered:
        number, one = numbered["diameter"]
        half = 0.5 * one.nominal
        sheet.dimension(number, one, at(low, -half), at(low, half), (left - 14.0, cy), s, 90.0)
    sheet.text((left, base - 12.0), f"section {s:g}:1", 2.5)
    if part.crossed:
        _surface(sheet, part)
    return []


def _surface(sheet: Sheet, part: Part) -> None:
    """Draw what a tip meets, enlarged."""
    edges = part.counterface().breakpoints
    span = max(edges[-1] - edges[0], 10e-6)
    x, z = part.counterface().section(span)
    s = round_scale(30.0 / (span * 1e3))
    sheet.polyline([(290.0 + (u - edges[0]) * 1e3 * s, 225.0 + v * 1e3 * s) for u, v in zip(x, z, strict=True)])
    sheet.text((310.0, 180.0), f"along the drag {s:g}:1", 2.5, "BOTTOM_CENTER")


def crown_views(sheet: Sheet, margin: CrownOnTooth, numbered: Numbered) -> list[str]:
    """Draw tooth and crown in section, and the margin enlarged; return the lines of its notes."""
    tall = margin.root_length.nominal + margin.preparation_height.nominal + 2.0 * margin.shell_thickness.nominal
    s = round_scale(min(150.0 / (tall * 1e3), 90.0 / (2.2 * margin.margin_radius.nominal * 1e3)))
    cx, cy = 110.0, 150.0

    def at(radius: float, height: float) -> Point:
        return cx + radius * 1e3 * s, cy + height * 1e3 * s

    tooth, crown = list(_flattened(margin.tooth_outline())), list(_flattened(margin.crown_outline()))
    for outline in (tooth, crown):
        for side in (1.0, -1.0):
            sheet.polyline([at(side * r, z) for r, z in outline])
    root, R = margin.root_length.nominal, margin.margin_radius.nominal
    top = margin.preparation_height.nominal
    sheet.line((cx, at(0.0, -root)[1] - 5.0), (cx, at(0.0, top)[1] + 18.0), "CENTRE")
    number, one = numbered["margin_diameter"]
    base = at(0.0, -root)[1]
    sheet.dimension(number, one, at(-R, -root), at(R, -root), (cx, base - 10.0), s)
    number, one = numbered["crown_diameter"]
    roof = max(z for _, z in crown)
    outer = R + margin.horizontal_discrepancy.nominal
    sheet.dimension(number, one, at(-outer, roof), at(outer, roof), (cx, at(0.0, roof)[1] + 10.0), s)
    left = at(-1.05 * outer, 0.0)[0] - 10.0
    if "preparation_height" in numbered:
        number, one = numbered["preparation_height"]
        sheet.dimension(number, one, at(-R, 0.0), at(0.0, top), (left, cy), s, 90.0)
        number, one = numbered["root_length"]
        sheet.dimension(number, one, at(-R, -root), at(-R, 0.0), (left - 12.0, cy), s, 90.0)
    else:
        number, one = numbered["tooth_length"]
        sheet.dimension(number, one, at(-R, -root), at(0.0, top), (left - 6.0, cy), s, 90.0)
    number, one = numbered["shell_thickness"]
    ceiling = top + margin.internal_gap.nominal
    right = at(1.05 * outer, 0.0)[0] + 54.0  # beyond the text of the diameter above
    sheet.dimension(number, one, at(0.3 * R, ceiling), at(0.3 * R, roof), (right, cy), s, 90.0)
    sheet.text((cx, base - 22.0), f"section {s:g}:1, seated", 2.5, "BOTTOM_CENTER")
    _crown_margin(sheet, margin, numbered, tooth, crown)
    return ["Marginal gap, internal gap and discrepancies hold with the crown seated on its tooth."]


def _crown_margin(
    sheet: Sheet, margin: CrownOnTooth, numbered: Numbered, tooth: list[Point], crown: list[Point]
) -> None:
    cx, cy = 300.0, 205.0
    R = margin.margin_radius.nominal
    reach = 4.0 * max(margin.marginal_gap.nominal, abs(margin.horizontal_discrepancy.nominal), 50e-6)
    s = round_scale(40.0 / (reach * 1e3))
    half = 45.0
    import shapely

    window = shapely.box(R - half / (1e3 * s), -half / (1e3 * s), R + half / (1e3 * s), half / (1e3 * s))
    for outline in (tooth, crown):
        piece = shapely.LineString(outline).intersection(window)
        for part in getattr(piece, "geoms", [piece]):
            if part.geom_type == "LineString":
                sheet.polyline([(cx + (r - R) * 1e3 * s, cy + z * 1e3 * s) for r, z in part.coords])
    number, one = numbered["vertical_discrepancy" if "vertical_discrepancy" in numbered else "marginal_gap"]
    outer = margin.horizontal_discrepancy.nominal * 1e3 * s
    if one.kind == "distance":
        # from the cavosurface angle of the tooth to the margin of the crown
        margin_of_crown = (cx + outer, cy + one.nominal * 1e3 * s)
        sheet.dimension(number, one, (cx, cy), margin_of_crown, (cx + max(outer, 0.0) + 14.0, cy), s, 90.0)
    sheet.text((cx - half + 3.0, cy - half + 4.0), "tooth", 2.5)
    sheet.text((cx - half + 3.0, cy + half - 7.0), "crown", 2.5)
    sheet.rectangle((cx - half, cy - half), (cx + half, cy + half), "DIMENSION")
    sheet.text((cx, cy - half - 7.0), f"A   margin {s:g}:1", 2.5, "BOTTOM_CENTER")
