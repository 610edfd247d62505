"""Views of bench blocks and of the gauge-block variant, with enlarged details."""

import math

from stepblocks.artefacts.on_paper import format_millimetres
from stepblocks.parts.body import DRILL_POINT, Body
from stepblocks.parts.characteristics import make_characteristic
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.lettering import compute_text_width
from stepblocks.workshop.gauge_route import GRADES, SECTION, WRINGING, GaugePair
from stepblocks.workshop.sheet import HEIGHT, TOP_OF_TITLE, Point, Sheet, View, choose_scale

_FRONT: Point = (95.0, 242.0)
_TOP: Point = (95.0, 137.0)
_DETAIL: Point = (235.0, 215.0)
_SECOND: Point = (352.0, 215.0)
_SCALES = (10.0, 5.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0, 0.5, 0.25, 0.1)


def draw_step_block_views(sheet: Sheet, block: StepBlock) -> list[str]:
    """Draw all views of a step block; return the lines of its notes."""
    scale = _draw_body(sheet, block.body, block.id)
    _draw_edge(sheet, block, scale)
    _draw_step_detail(sheet, block)
    _draw_groove_detail(sheet, block)
    return ["Working edge without burr; do not break it. All other edges broken as noted."]


def draw_margin_block_views(sheet: Sheet, margin: MarginBlock) -> list[str]:
    """Draw all views of a margin block; return the lines of its notes."""
    scale = _draw_body(sheet, margin.body, margin.id)
    k, (tx, ty) = 1e3 * scale, _TOP
    hy = 0.5 * margin.body.width.nominal * k
    for x in (0.0, margin.marginal_gap.nominal * k):
        sheet.line((tx + x, ty - hy), (tx + x, ty + hy))
    text_at = (tx + 0.5 * margin.body.length.nominal * k + 20.0, ty + 0.4 * hy)
    sheet.leader((tx, ty + 0.3 * hy), text_at, "margin, detail A")
    _draw_margin_detail(sheet, margin)
    return ["Edges of the margin without burr; do not break them."]


def _list_octagon(low: Point, high: Point, cut: float) -> list[Point]:
    # Corners of a rectangle with broken edges, from the left end of its lower side
    (x0, z0), (x1, z1) = low, high
    sides = [(x0 + cut, z0), (x1 - cut, z0), (x1, z0 + cut), (x1, z1 - cut)]
    return [*sides, (x1 - cut, z1), (x0 + cut, z1), (x0, z1 - cut), (x0, z0 + cut)]


def _draw_body(sheet: Sheet, body: Body, identity: str) -> float:
    # Draw the body from the front and from above; return the scale of both views
    largest = 1e3 * max(
        body.length.nominal, body.width.nominal, 75.0 / 45.0 * body.thickness.nominal
    )
    scale = max(s for s in _SCALES if s * largest <= 75.0 or s == _SCALES[-1])
    k = 1e3 * scale
    hx, hy = 0.5 * body.length.nominal * k, 0.5 * body.width.nominal * k
    t, c = body.thickness.nominal * k, body.edge_break.nominal * k
    (tx, ty), fx, fz = _TOP, _FRONT[0], _FRONT[1] + 0.5 * t
    sheet.polyline(
        [(fx + x, fz + z) for x, z in _list_octagon((-hx, -t), (hx, 0.0), c)], closed=True
    )
    letter = max(0.8 * body.engraving.height.nominal * k, 2.5)
    sheet.text((fx, fz - 0.5 * t), identity.upper(), letter, "MIDDLE_CENTER")
    sheet.polyline(
        [(tx + x, ty + y) for x, y in _list_octagon((-hx, -hy), (hx, hy), c)], closed=True
    )
    sheet.rectangle((tx - hx + c, ty - hy + c), (tx + hx - c, ty + hy - c), "DIMENSION")
    mounting = body.mounting
    hole, half = 0.5 * mounting.hole_diameter * k, 0.5 * mounting.spacing.nominal * k
    for x in (-half, half):
        sheet.circle((tx + x, ty), hole, "HIDDEN" if mounting.kind == "tapped" else "OUTLINE")
        sheet.line((tx + x - hole - 3.0, ty), (tx + x + hole + 3.0, ty), "CENTRE")
        sheet.line((tx + x, ty - hole - 3.0), (tx + x, ty + hole + 3.0), "CENTRE")
    left, front, below = tx - hx, fx - hx, ty - hy
    sheet.dimension("length", (left, below + c), (tx + hx, below + c), (tx, below - 19.0), scale)
    sheet.dimension(
        "width", (left + c, below), (left + c, ty + hy), (left - 12.0, ty), scale, upright=True
    )
    sheet.dimension(
        "thickness", (front + c, fz - t), (front + c, fz), (front - 12.0, fz), scale, upright=True
    )
    sheet.dimension(
        "hole_spacing", (tx - half, ty - hole), (tx + half, ty - hole), (tx, below - 10.0), scale
    )
    sheet.dimension(
        "hole_position", (left, below + c), (tx - half, ty - hole), (tx, below - 28.0), scale
    )
    sheet.dimension(
        "hole_row", (left + c, below), (tx - half, ty), (left - 24.0, ty), scale, upright=True
    )
    if "edge_position" in sheet.listed:
        sheet.dimension(
            "edge_position", (left, ty + hy - c), (tx, ty + hy), (tx, ty + hy + 16.0), scale
        )
    bored = (
        f"⌀{mounting.hole_diameter * 1e3:g} through, counterbored "
        f"⌀{mounting.entry_diameter * 1e3:g}"
    )
    made = mounting.thread if mounting.kind == "tapped" else bored
    sheet.leader(
        (tx + half + 0.7 * hole, ty - 0.7 * hole), (tx + hx + 20.0, ty - 0.5 * hy), f"2 x {made}"
    )
    _draw_holes(sheet, body, (fx, fz), scale)
    end = fx + 0.5 * compute_text_width(identity.upper(), letter) + 0.5, fz - 0.5 * t
    sheet.leader(end, (fx + hx + 17.0, fz - 2.0), "letters {} high", "engraving_height")
    sheet.leader(end, (fx + hx + 17.0, fz - 8.0), "engraved {} deep", "engraving_depth")
    corner = (fx - hx + 0.5 * c, fz - t + 0.5 * c)
    sheet.leader(
        corner,
        (fx - hx + 8.0, fz - t - 8.0),
        "{} x 45°, all edges but the working ones",
        "edge_break",
    )
    sheet.text((fx, fz - t - 18.0), f"front {scale:g}:1", 2.5, "BOTTOM_CENTER")
    sheet.text((tx + hx + 4.0, ty - hy), f"top {scale:g}:1", 2.5, "BOTTOM_LEFT")
    return scale


def _draw_holes(sheet: Sheet, body: Body, at: Point, scale: float) -> None:
    # Draw the fixing holes as hidden lines, with their depth beside the view
    (fx, fz), k, holes = at, 1e3 * scale, body.mounting
    drill, entry, depth = (
        0.5 * holes.hole_diameter * k,
        0.5 * holes.entry_diameter * k,
        holes.depth.nominal * k,
    )
    base, half = fz - body.thickness.nominal * k, 0.5 * holes.spacing.nominal * k
    for x in (fx - half, fx + half):
        if holes.kind == "tapped":
            sink, tip = base + entry - drill, base + depth + drill / math.tan(0.5 * DRILL_POINT)
            outline = [(entry, base), (drill, sink), (drill, base + depth), (0.0, tip)]
        else:
            outline = [(drill, base), (drill, fz - depth), (entry, fz - depth), (entry, fz)]
        for side in (-1.0, 1.0):
            sheet.polyline([(x + side * r, z) for r, z in outline], "HIDDEN")
        floor = base + depth if holes.kind == "tapped" else fz - depth
        sheet.line((x - drill, floor), (x + drill, floor), "HIDDEN")
        sheet.line((x, base - 2.0), (x, fz + 2.0), "CENTRE")
    right = fx + 0.5 * body.length.nominal * k
    ends = sorted([floor, base if holes.kind == "tapped" else fz])
    sheet.dimension(
        "hole_depth",
        (x + drill, ends[0]),
        (x + drill, ends[1]),
        (right + 10.0, fz),
        scale,
        upright=True,
    )


def _draw_edge(sheet: Sheet, block: StepBlock, scale: float) -> None:
    k, (tx, ty) = 1e3 * scale, _TOP
    hy, feature = 0.5 * block.body.width.nominal * k, block.metrology
    sheet.line((tx, ty - hy), (tx, ty + hy))
    sign = 1.0 if feature.kind == "groove" else -1.0
    near, far = (
        sign * feature.distance.nominal * k,
        sign * (feature.distance.nominal + feature.width.nominal) * k,
    )
    low = hy - feature.lane.nominal * k
    sheet.rectangle((tx + near, ty + low), (tx + far, ty + hy))
    if (key := f"{feature.kind}_distance") in sheet.listed:
        ends = sorted([(tx, ty + hy), (tx + near, ty + hy)])
        sheet.dimension(key, ends[0], ends[1], (tx, ty + hy + 8.0), scale)
    right = tx + 0.5 * block.body.length.nominal * k
    long, beyond = f"{feature.kind}_length", right + 20.0
    sheet.dimension(
        long, (tx + far, ty + low), (tx + far, ty + hy), (right + 10.0, ty), scale, upright=True
    )
    sheet.leader((tx, ty - 0.3 * hy), (beyond, ty - 0.15 * hy), "working edge, detail A")
    sheet.leader((tx + far, ty + low + 2.0), (beyond, ty + low + 6.0), f"{feature.kind}, detail B")


def _draw_step_detail(sheet: Sheet, block: StepBlock) -> None:
    H, r = block.height.nominal, block.edge_radius.nominal
    xs, zs, (cx, cz) = (
        choose_scale(10.0 / max(r * 1e3, 0.1)),
        choose_scale(40.0 / (H * 1e3)),
        _DETAIL,
    )
    view = View(_DETAIL, xs, zs)
    top, left, right = view.at(0.0, H)[1], cx - 42.0, cx + 62.0
    turns = [index * math.pi / 40.0 for index in range(21)] if r > 0.0 else [0.5 * math.pi]
    edge = [view.at(r - r * math.cos(turn), H - r + r * math.sin(turn)) for turn in turns]
    sheet.polyline([(left, cz), (cx, cz), *edge, (right, top)])
    sheet.break_line(left, cz - 8.0, cz)
    sheet.break_line(right, cz - 8.0, top)
    sheet.dimension("step_height", (cx - 24.0, cz), (cx, top), (cx - 14.0, cz), zs, upright=True)
    sheet.leader(edge[len(edge) // 2], (cx + 10.0, top - 12.0), "R {}", "edge_radius")
    sheet.datum((cx - 32.0, cz), "A")
    sheet.point_to((cx - 21.0, cz), sheet.frame("flatness_lower", (cx - 16.0, cz - 17.0)))
    sheet.point_to((cx + 4.0, top), sheet.frame("flatness_upper", (cx + 8.0, top + 7.0)))
    sheet.frame("parallelism", (cx + 8.0, top + 13.0), "A")
    sheet.texture((cx + 46.0, top), "roughness", " (2 x)")
    said = f"A   lengths {xs:g}:1, heights {zs:g}:1 (heights exaggerated {zs / xs:g} times)"
    sheet.text((cx, cz - 27.0), said, 2.5, "BOTTOM_CENTER")


def _draw_groove_detail(sheet: Sheet, block: StepBlock) -> None:
    (cx, cz), kind = _SECOND, block.metrology.kind
    H, W = block.height.nominal, block.metrology.width.nominal
    zs, xs = choose_scale(40.0 / (H * 1e3)), choose_scale(30.0 / (W * 1e3))
    top, half = cz + H * 1e3 * zs, 0.5 * W * 1e3 * xs
    outside, inside = (top, cz) if kind == "groove" else (cz, top)
    across = [(cx - 40.0, outside), (cx - half, outside), (cx - half, inside)]
    sheet.polyline([*across, (cx + half, inside), (cx + half, outside), (cx + 40.0, outside)])
    for x in (cx - 40.0, cx + 40.0):
        sheet.break_line(x, cz - 8.0, outside)
    # the text of a narrow width stands on the right, so the depth stands on the left
    key, start = ("groove_depth", cx) if kind == "groove" else ("ridge_height", cx - 30.0)
    sheet.dimension(key, (start, cz), (cx - half, top), (cx - half - 9.0, cz), zs, upright=True)
    sheet.dimension(f"{kind}_width", (cx - half, top), (cx + half, top), (cx, top + 8.0), xs)
    sheet.text((cx, cz - 27.0), f"B   lengths {xs:g}:1, heights {zs:g}:1", 2.5, "BOTTOM_CENTER")
    sheet.text((cx, cz - 31.5), "evaluate by ISO 5436-1 type A1", 2.5, "BOTTOM_CENTER")


def _draw_margin_detail(sheet: Sheet, margin: MarginBlock) -> None:
    g, h, d = (
        margin.marginal_gap.nominal,
        margin.horizontal_discrepancy.nominal,
        margin.gap_depth.nominal,
    )
    s = choose_scale(36.0 / (max(g, abs(h), abs(margin.opening.nominal)) * 1e3))
    view = View((_DETAIL[0] + 45.0, _DETAIL[1]), s)
    cx, cz = view.origin
    wall, level = view.at(g, h)  # of the crown, on the paper
    floor = cz + max(-d * 1e3 * s, -46.0)
    corner = [view.at(x, z) for x, z in margin.corner]
    sheet.polyline([(cx - 60.0, cz), (cx, cz), (cx, floor)])
    edge = (max(corner[-1][0], cx), corner[-1][1])
    sheet.polyline([(wall, floor), *corner, edge, (cx + 75.0, level)])
    if cz - d * 1e3 * s < floor:
        sheet.break_line(cx, floor - 6.0, floor)
        sheet.break_line(wall, floor - 6.0, floor)
    else:
        sheet.line((cx, floor), (wall, floor))
    sheet.dimension("marginal_gap", (cx, floor + 8.0), (wall, floor + 8.0), (cx, floor - 12.0), s)
    if sheet.listed["horizontal_discrepancy"][1].nominal > 0.0:
        ends = (cx - 30.0, cz), (cx + 62.0, level)
        sheet.dimension("horizontal_discrepancy", *ends, (cx - 40.0, cz), s, upright=True)
    top = max(cz, level)
    beyond = max(cx + 18.0, wall + 8.0)
    if (
        "vertical_discrepancy" in sheet.listed
        and sheet.listed["vertical_discrepancy"][1].kind == "distance"
    ):
        low, high = sorted([(cx, cz), view.at(margin.opening.nominal, h)])
        sheet.dimension("vertical_discrepancy", low, high, (cx, top + 8.0), s)
        beyond = high[0] + 42.0  # clear of the text, which stands beside a narrow dimension
    sheet.datum((cx - 54.0, cz), "A")
    sheet.frame("flatness_lower", (cx - 58.0, cz - 28.0))
    sheet.polyline([(cx - 44.0, cz - 28.0 + 6.0), (cx - 44.0, cz)], "DIMENSION")
    sheet.arrow((cx - 44.0, cz), (cx - 44.0, cz - 28.0))
    sheet.point_to((beyond, level), sheet.frame("flatness_upper", (beyond + 4.0, top + 18.0)))
    sheet.frame("parallelism", (beyond + 4.0, top + 24.0), "A")
    sheet.text((cx - 58.0, cz + 3.0), "tooth", 2.5)
    sheet.text((cx + 60.0, level - 5.0), "crown", 2.5)
    sheet.texture((max(cx + 62.0, beyond + 3.0), level), "roughness", " (2 x)")
    sheet.leader(
        (cx + 0.4 * g * 1e3 * s, floor + 2.0), (cx - 24.0, floor + 8.0), "depth {}", "gap_depth"
    )
    sheet.text((cx, floor - 30.0), f"A   {s:g}:1", 2.5, "BOTTOM_CENTER")


def draw_gauge_sheet(block: StepBlock, pair: GaugePair, ordered: dict[str, str]) -> Sheet:
    """Draw the gauge-block variant: base, two gauge blocks, and the step between them."""
    height = block.height
    sheet = Sheet([make_characteristic("step_height", "distance", height)])
    deviation, variation = GRADES[pair.grade]
    size = f"ISO 3650 grade {pair.grade}, {SECTION[0] * 1e3:g} x {SECTION[1] * 1e3:g} mm"
    text = f"""Parts
1  base, {block.material.designation}, top lapped flat within 0.1 um where blocks are wrung
2  gauge block {format_millimetres(pair.lower, 4)} mm, {size}
3  gauge block {format_millimetres(pair.upper, 4)} mm, {size}

Stack-up of the step
lengths of two blocks: ±{deviation * 1e6:g} um each
variation of length, half of it at the edge: ±{0.5 * variation * 1e6:g} um each
wringing: ±{WRINGING * 1e6:g} um each
worst case ±{pair.worst * 1e6:.2f} um, 95 % within ±{pair.expected * 1e6:.2f} um
permitted: {sheet.limits("step_height")} mm

Wring parts 2 and 3 side by side, long sides together, edges of the upper one not broken.
A gauge block has a chamfer (0.1 to 0.3 mm) at the working edge:
order part 3 without it, or lap it off."""
    lines = text.splitlines()
    rows = {
        "identity": f"{block.id.upper()}-GAUGE",
        "material": "base as noted, gauge blocks steel",
    }
    sheet.border("Step block from gauge blocks", rows | ordered)
    foot = 20.0 + 5.0 * (len(lines) - 1)
    sheet.notes((20.0, foot), ((line, "") for line in lines))
    # whatever their sizes, the views stand over what was written, beside one another, each by what
    # it covers
    left, low, high = 20.0, max(foot, TOP_OF_TITLE) + 10.0, HEIGHT - 16.0
    for draw in (_draw_gauge_section, _draw_gauge_edge):
        start = len(sheet.space)
        draw(sheet, block, pair, high - low)
        x0, y0, x1, y1 = sheet.extents(start)
        sheet.shift(start, (left - x0, 0.5 * (low + high - y0 - y1)))
        left += x1 - x0 + 12.0
    return sheet


def _draw_gauge_edge(sheet: Sheet, block: StepBlock, pair: GaugePair, room: float) -> None:
    # Draw the edge with its heights enlarged
    zs = choose_scale(40.0 / (block.height.nominal * 1e3))
    top = block.height.nominal * 1e3 * zs
    sheet.polyline([(-50.0, 0.0), (0.0, 0.0), (0.0, top), (50.0, top)])
    sheet.line((0.0, 0.0), (0.0, -10.0))
    sheet.break_line(-50.0, -10.0, 0.0)
    sheet.break_line(50.0, -10.0, top)
    sheet.dimension("step_height", (-26.0, 0.0), (0.0, top), (-14.0, 0.0), zs, upright=True)
    sheet.text(
        (0.0, -20.0), f"A   edge, heights {zs:g}:1, lengths not to scale", 2.5, "BOTTOM_CENTER"
    )


def _draw_gauge_section(sheet: Sheet, block: StepBlock, pair: GaugePair, room: float) -> None:
    # Draw base and blocks as large as they fit, with labels on the left
    thick = block.body.thickness.nominal * 1e3
    across, tall = 2e3 * SECTION[1] + 10.0, thick + pair.upper * 1e3
    s = max(
        one
        for one in _SCALES
        if (one * tall <= room - 12.0 and one * across <= 120.0) or one == _SCALES[-1]
    )
    wide, rim = 1e3 * SECTION[1] * s, 5.0 * s
    low, high = pair.lower * 1e3 * s, pair.upper * 1e3 * s
    sheet.rectangle((-wide - rim, -thick * s), (wide + rim, 0.0))
    sheet.rectangle((-wide, 0.0), (0.0, low))
    sheet.rectangle((0.0, 0.0), (wide, high))
    shelf, at = -wide - rim - 10.0, max(high, 12.0)
    for tip, said in (
        ((0.5 * wide, 0.8 * high), "part 3, upper"),
        ((-0.7 * wide, 0.4 * low), "part 2, lower"),
        ((-wide - 0.5 * rim, -0.3 * thick * s), "part 1, base"),
    ):
        sheet.leader(tip, (shelf, at), said)
        at = min(at - 8.0, -0.3 * thick * s) if said.startswith("part 2") else at - 8.0
    sheet.text((0.0, -thick * s - 8.0), f"section {s:g}:1", 2.5, "BOTTOM_CENTER")
