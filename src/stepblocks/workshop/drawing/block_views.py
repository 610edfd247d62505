"""Views of the bench blocks: front, top, and the details in which microns can be seen."""

from __future__ import annotations

import math
from collections.abc import Mapping

from stepblocks.artefacts.numbers import limits_text
from stepblocks.parts.body import Body
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kinds.margin_block import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing.sheet import Point, Sheet

Numbered = Mapping[str, tuple[int, Characteristic]]
_FRONT: Point = (95.0, 240.0)
_TOP: Point = (95.0, 140.0)
_DETAIL: Point = (235.0, 215.0)
_SECOND: Point = (352.0, 215.0)


def round_scale(wanted: float) -> float:
    """Return the largest of 1, 2, 2.5, 4, 5 times a power of ten that does not exceed `wanted`."""
    decade = 10.0 ** math.floor(math.log10(wanted))
    return max(step * decade for step in (1.0, 2.0, 2.5, 4.0, 5.0) if step * decade <= wanted * (1.0 + 1e-9))


def body_scale(body: Body) -> float:
    """Return the scale of front and top view."""
    largest = max(body.length.nominal, body.width.nominal) * 1e3
    return max(s for s in (10.0, 5.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0, 0.5, 0.25, 0.1) if s * largest <= 75.0 or s == 0.1)


def step_block_views(sheet: Sheet, block: StepBlock, numbered: Numbered) -> list[str]:
    """Draw all views of a step block; return the lines of its notes."""
    scale = _body_views(sheet, block.body, numbered, block.id)
    _edge_in_top_view(sheet, block, numbered, scale)
    _step_detail(sheet, block, numbered)
    _groove_detail(sheet, block, numbered)
    return ["Working edge without burr; do not break it. All other edges broken as noted."]


def _body_views(sheet: Sheet, body: Body, numbered: Numbered, identity: str) -> float:
    scale = body_scale(body)
    k = 1e3 * scale
    hx, hy, t, c = (
        0.5 * body.length.nominal * k,
        0.5 * body.width.nominal * k,
        body.thickness.nominal * k,
        body.edge_break.nominal * k,
    )
    fx, fz = _FRONT[0], _FRONT[1] + 0.5 * t
    corners = [(-hx + c, -t), (hx - c, -t), (hx, -t + c), (hx, -c), (hx - c, 0), (-hx + c, 0), (-hx, -c), (-hx, -t + c)]
    sheet.polyline([(fx + x, fz + z) for x, z in corners], closed=True)
    sheet.text((fx, fz - 0.5 * t), identity.upper(), max(body.engraving.height.nominal * k * 0.8, 2.5), "MIDDLE_CENTER")
    tx, ty = _TOP
    sheet.polyline(
        [
            (tx + x, ty + y)
            for x, y in (
                (-hx + c, -hy),
                (hx - c, -hy),
                (hx, -hy + c),
                (hx, hy - c),
                (hx - c, hy),
                (-hx + c, hy),
                (-hx, hy - c),
                (-hx, -hy + c),
            )
        ],
        closed=True,
    )
    sheet.rectangle((tx - hx + c, ty - hy + c), (tx + hx - c, ty + hy - c), "DIMENSION")
    hole, half = 0.5 * body.mounting.hole_diameter * k, 0.5 * body.mounting.spacing.nominal * k
    for x in (-half, half):
        layer = "HIDDEN" if body.mounting.kind == "tapped" else "OUTLINE"
        sheet.circle((tx + x, ty), hole, layer)
        sheet.line((tx + x - hole - 3.0, ty), (tx + x + hole + 3.0, ty), "CENTRE")
        sheet.line((tx + x, ty - hole - 3.0), (tx + x, ty + hole + 3.0), "CENTRE")
    dims = (
        ("length", (tx - hx, ty - hy + c), (tx + hx, ty - hy + c), (tx, ty - hy - 19.0), 0.0),
        ("width", (tx - hx + c, ty - hy), (tx - hx + c, ty + hy), (tx - hx - 12.0, ty), 90.0),
        ("thickness", (fx - hx + c, fz - t), (fx - hx + c, fz), (fx - hx - 12.0, fz), 90.0),
        ("hole_spacing", (tx - half, ty - hole), (tx + half, ty - hole), (tx, ty - hy - 10.0), 0.0),
    )
    for key, a, b, along, angle in dims:
        number, one = numbered[key]
        sheet.dimension(number, one, a, b, along, scale, angle)
    kind = (
        f"2 x {body.mounting.thread}, {body.mounting.depth.nominal * 1e3:g} deep"
        if body.mounting.kind == "tapped"
        else (f"2 x {body.mounting.thread} clearance, counterbore {body.mounting.depth.nominal * 1e3:g} deep")
    )
    sheet.leader((tx + half + 0.7 * hole, ty - 0.7 * hole), (tx + hx + 6.0, ty - 0.5 * hy), kind)
    sheet.text((_FRONT[0], fz + 8.0), f"front {scale:g}:1", 2.5, "BOTTOM_CENTER")
    sheet.text((tx + hx + 4.0, ty - hy), f"top {scale:g}:1", 2.5, "BOTTOM_LEFT")
    return scale


def _edge_in_top_view(sheet: Sheet, block: StepBlock, numbered: Numbered, scale: float) -> None:
    k, (tx, ty) = 1e3 * scale, _TOP
    hy, feature = 0.5 * block.body.width.nominal * k, block.metrology
    sheet.line((tx, ty - hy), (tx, ty + hy))
    sign = 1.0 if feature.kind == "groove" else -1.0
    near, far = sign * feature.distance.nominal * k, sign * (feature.distance.nominal + feature.width.nominal) * k
    low = hy - feature.lane.nominal * k
    sheet.rectangle((tx + near, ty + low), (tx + far, ty + hy))
    key = f"{feature.kind}_distance"
    if key in numbered:
        number, one = numbered[key]
        ends = sorted([(tx, ty + hy), (tx + near, ty + hy)])
        sheet.dimension(number, one, ends[0], ends[1], (tx, ty + hy + 8.0), scale)
    sheet.leader(
        (tx, ty - 0.3 * hy), (tx + 0.5 * block.body.length.nominal * k + 6.0, ty - 0.15 * hy), "working edge, detail A"
    )
    sheet.leader(
        (tx + far, ty + low + 2.0),
        (tx + 0.5 * block.body.length.nominal * k + 6.0, ty + low + 6.0),
        f"{feature.kind}, detail B",
    )


def _step_detail(sheet: Sheet, block: StepBlock, numbered: Numbered) -> None:
    cx, cz = _DETAIL
    H, r = block.height.nominal, block.edge_radius.nominal
    zs = round_scale(40.0 / (H * 1e3))
    xs = round_scale(10.0 / max(r * 1e3, 0.1))
    top, left, right = cz + H * 1e3 * zs, cx - 42.0, cx + 62.0
    turns = [index * math.pi / 40.0 for index in range(21)] if r > 0.0 else [0.5 * math.pi]
    rounded = [(r - r * math.cos(turn), H - r + r * math.sin(turn)) for turn in turns]
    edge = [(cx + x * 1e3 * xs, cz + z * 1e3 * zs) for x, z in rounded]
    sheet.polyline([(left, cz), (cx, cz), *edge, (right, top)])
    sheet.break_line(left, cz - 8.0, cz)
    sheet.break_line(right, cz - 8.0, top)
    number, one = numbered["step_height"]
    sheet.dimension(number, one, (cx - 24.0, cz), (cx, top), (cx - 14.0, cz), zs, 90.0)
    number, one = numbered["edge_radius"]
    sheet.leader(
        edge[len(edge) // 2], (cx + 10.0, top - 12.0), f"R {limits_text(one.nominal, one.lower, one.upper)}", number
    )
    sheet.datum((cx - 32.0, cz), "A")
    for key, kind, at, face, datum in (
        ("flatness_lower", "flatness", (cx - 16.0, cz - 17.0), (cx - 21.0, cz), ""),
        ("flatness_upper", "flatness", (cx + 8.0, top + 7.0), (cx + 4.0, top), ""),
        ("parallelism", "parallelism", (cx + 8.0, top + 13.0), (cx + 4.0, top), "A"),
    ):
        number, one = numbered[key]
        start = sheet.frame(at, kind, one.upper, number, datum)
        if key != "parallelism":
            sheet.polyline([start, (face[0], start[1]), face], "DIMENSION")
            sheet.arrow(face, (face[0], start[1]))
    sheet.text(
        (cx, cz - 27.0),
        f"A   lengths {xs:g}:1, heights {zs:g}:1 (heights exaggerated {zs / xs:g} times)",
        2.5,
        "BOTTOM_CENTER",
    )


def _groove_detail(sheet: Sheet, block: StepBlock, numbered: Numbered) -> None:
    cx, cz = _SECOND
    H, W = block.height.nominal, block.metrology.width.nominal
    zs, xs = round_scale(40.0 / (H * 1e3)), round_scale(30.0 / (W * 1e3))
    top, half = cz + H * 1e3 * zs, 0.5 * W * 1e3 * xs
    groove = block.metrology.kind == "groove"
    outside, inside = (top, cz) if groove else (cz, top)
    sheet.polyline(
        [
            (cx - 40.0, outside),
            (cx - half, outside),
            (cx - half, inside),
            (cx + half, inside),
            (cx + half, outside),
            (cx + 40.0, outside),
        ]
    )
    for x in (cx - 40.0, cx + 40.0):
        sheet.break_line(x, cz - 8.0, outside)
    key = "groove_depth" if groove else "ridge_height"
    number, one = numbered[key]
    # the text of a narrow width stands on the right, so the depth stands on the left
    start = (cx if groove else cx - 30.0, cz)
    sheet.dimension(number, one, start, (cx - half, top), (cx - half - 9.0, cz), zs, 90.0)
    number, one = numbered[f"{block.metrology.kind}_width"]
    sheet.dimension(number, one, (cx - half, top), (cx + half, top), (cx, top + 8.0), xs)
    sheet.text((cx, cz - 27.0), f"B   lengths {xs:g}:1, heights {zs:g}:1", 2.5, "BOTTOM_CENTER")
    sheet.text((cx, cz - 31.5), "evaluate by ISO 5436-1 type A1", 2.5, "BOTTOM_CENTER")


def margin_block_views(sheet: Sheet, margin: MarginBlock, numbered: Numbered) -> list[str]:
    """Draw all views of a margin block; return the lines of its notes."""
    scale = _body_views(sheet, margin.body, numbered, margin.id)
    k, (tx, ty) = 1e3 * scale, _TOP
    hy = 0.5 * margin.body.width.nominal * k
    for x in (0.0, margin.marginal_gap.nominal * k):
        sheet.line((tx + x, ty - hy), (tx + x, ty + hy))
    sheet.leader(
        (tx, ty + 0.3 * hy), (tx + 0.5 * margin.body.length.nominal * k + 6.0, ty + 0.4 * hy), "margin, detail A"
    )
    _margin_detail(sheet, margin, numbered)
    return ["Edges of the margin without burr; do not break them."]


def _margin_detail(sheet: Sheet, margin: MarginBlock, numbered: Numbered) -> None:
    cx, cz = _DETAIL[0] + 45.0, _DETAIL[1]
    g, h, d = margin.marginal_gap.nominal, margin.horizontal_discrepancy.nominal, margin.gap_depth.nominal
    largest = max(g, abs(h), abs(margin.opening.nominal)) * 1e3
    s = round_scale(36.0 / largest)

    def at(x: float, z: float) -> Point:
        return cx + x * 1e3 * s, cz + z * 1e3 * s

    floor = max(-d * 1e3 * s, -46.0)
    corner = [at(x, z) for x, z in margin.corner]
    sheet.polyline([(cx - 60.0, cz), (cx, cz), (cx, cz + floor)])
    sheet.polyline(
        [
            (at(g, 0.0)[0], cz + floor),
            *corner,
            (corner[-1][0] if corner[-1][0] > cx else cx, corner[-1][1]),
            (cx + 75.0, at(0.0, h)[1]),
        ]
    )
    if -d * 1e3 * s < floor:
        sheet.break_line(cx, cz + floor - 6.0, cz + floor)
        sheet.break_line(at(g, 0.0)[0], cz + floor - 6.0, cz + floor)
    else:
        sheet.line((cx, cz + floor), (at(g, 0.0)[0], cz + floor))
    number, one = numbered["marginal_gap"]
    low = cz + floor + 8.0
    sheet.dimension(number, one, (cx, low), (at(g, 0.0)[0], low), (cx, cz + floor - 12.0), s)
    number, one = numbered["horizontal_discrepancy"]
    if one.nominal > 0.0:
        sheet.dimension(number, one, (cx - 30.0, cz), (cx + 62.0, at(0.0, h)[1]), (cx - 40.0, cz), s, 90.0)
    top = max(cz, at(0.0, h)[1])
    v = margin.opening.nominal
    if "vertical_discrepancy" in numbered and numbered["vertical_discrepancy"][1].kind == "distance":
        number, one = numbered["vertical_discrepancy"]
        ends = sorted([(cx, cz), at(v, h)])
        sheet.dimension(number, one, ends[0], ends[1], (cx, top + 8.0), s)
        beyond = ends[1][0] + 42.0  # clear of the text, which stands beside a narrow dimension
    else:
        beyond = max(cx + 18.0, at(g, h)[0] + 8.0)
    sheet.datum((cx - 54.0, cz), "A")
    for key, kind, place, face, datum in (
        ("flatness_lower", "flatness", (cx - 58.0, cz - 28.0), (cx - 44.0, cz), ""),
        ("flatness_upper", "flatness", (beyond + 4.0, top + 18.0), (beyond, at(0.0, h)[1]), ""),
        ("parallelism", "parallelism", (beyond + 4.0, top + 24.0), (beyond, at(0.0, h)[1]), "A"),
    ):
        number, one = numbered[key]
        start = sheet.frame(place, kind, one.upper, number, datum)
        if key == "flatness_lower":
            sheet.polyline([(face[0], place[1] + 6.0), face], "DIMENSION")
            sheet.arrow(face, (face[0], place[1]))
        elif key == "flatness_upper":
            sheet.polyline([start, (face[0], start[1]), face], "DIMENSION")
            sheet.arrow(face, (face[0], start[1]))
    number, one = numbered["gap_depth"]
    sheet.text((cx + 4.0 + g * 1e3 * s, cz + floor - 4.0), "", 2.5)
    sheet.text((cx - 58.0, cz + 3.0), "tooth", 2.5)
    sheet.text((cx + 60.0, at(0.0, h)[1] + 3.0), "crown", 2.5)
    sheet.leader(
        (cx + 0.4 * g * 1e3 * s, cz + floor + 2.0),
        (cx - 24.0, cz + floor + 8.0),
        f"depth {limits_text(one.nominal, one.lower, one.upper)}",
        number,
    )
    sheet.text((cx, cz + floor - 30.0), f"A   {s:g}:1", 2.5, "BOTTOM_CENTER")
