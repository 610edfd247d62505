"""Views of bench blocks and of the gauge-block variant, with enlarged details."""

import math

from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import MetrologyFeature, StepBlock
from stepblocks.workshop.body_views import TOP_VIEW, draw_body
from stepblocks.workshop.sheet import Point, Sheet, View, choose_scale, format_scale

_DETAIL: Point = (235.0, 214.0)
_SECOND: Point = (352.0, 214.0)


def draw_step_block_views(sheet: Sheet, block: StepBlock) -> list[str]:
    """Draw all views of a step block; return the lines of its notes."""
    scale = draw_body(sheet, block.body, block.id)
    k = 1e3 * scale
    tx, ty = TOP_VIEW
    hy = 0.5e3 * scale * block.body.width.nominal
    sheet.draw_line((tx, ty - hy), (tx, ty + hy))
    sheet.draw_leader(
        (tx, ty - 0.75 * hy),
        (tx + 0.5 * k * block.body.length.nominal + 10.0, ty - 17.0),
        "working edge, detail A",
    )
    _draw_step_detail(sheet, block)
    lines = [
        "Step (1): distance of two parallel planes fitted to both faces, flanks excluded;",
        "no size between two points (ISO 14405-2). Stylus of 2 µm or less, or interferometer.",
    ]
    if block.metrology is not None:
        _draw_feature(sheet, block, block.metrology, scale)
        _draw_groove_detail(sheet, block, block.metrology)
        lines.append(
            f"{block.metrology.kind.capitalize()} "
            f"({sheet.listed[_depth_key(block.metrology)][0]}): ISO 5436-1 type A1."
        )
    return [
        *lines,
        "Root of the riser: fillet or undercut up to the height of the step is allowed.",
        "Every part is accepted by ISO 14253-1, Ra by its largest value (ISO 21920-3).",
    ]


def draw_margin_block_views(sheet: Sheet, margin: MarginBlock) -> list[str]:
    """Draw all views of a margin block; return the lines of its notes."""
    k = 1e3 * draw_body(sheet, margin.body, margin.id)
    tx, ty = TOP_VIEW
    hy = 0.5 * margin.body.width.nominal * k
    for x in (0.0, margin.marginal_gap.nominal * k):
        sheet.draw_line((tx + x, ty - hy), (tx + x, ty + hy))
    sheet.draw_leader(
        (tx, ty + 0.3 * hy),
        (tx + 0.5 * margin.body.length.nominal * k + 20.0, ty + 0.4 * hy),
        "margin, detail A",
    )
    _draw_margin_detail(sheet, margin)
    return ["Edges of the margin without burr; do not break them."]


def _depth_key(feature: MetrologyFeature) -> str:
    return "groove_depth" if feature.kind == "groove" else "ridge_height"


def _draw_feature(sheet: Sheet, block: StepBlock, feature: MetrologyFeature, scale: float) -> None:
    # Draw groove or ridge in the view from above
    k = 1e3 * scale
    tx, ty = TOP_VIEW
    hy = 0.5 * block.body.width.nominal * k
    sign = 1.0 if feature.kind == "groove" else -1.0
    near = sign * feature.distance.nominal * k
    far = near + sign * feature.width.nominal * k
    low = hy - feature.lane.nominal * k
    sheet.draw_rectangle((tx + near, ty + low), (tx + far, ty + hy))
    if (key := f"{feature.kind}_distance") in sheet.listed:
        ends = sorted([(tx, ty + hy), (tx + near, ty + hy)])
        sheet.draw_dimension(key, ends[0], ends[1], (tx, ty + hy + 8.0), scale)
    # beyond the text of the distance, which stands beside its arrows
    right = tx + max(0.5 * block.body.length.nominal * k + 14.0, near + 38.0, 38.0)
    sheet.draw_dimension(
        f"{feature.kind}_length",
        (tx + far, ty + low),
        (tx + far, ty + hy),
        (right, ty),
        scale,
        upright=True,
    )
    sheet.draw_leader(
        (tx + far, ty + low + 2.0), (right + 6.0, ty + low + 6.0), f"{feature.kind}, detail B"
    )


def _draw_step_detail(sheet: Sheet, block: StepBlock) -> None:
    H, r = block.height.nominal, block.edge_radius.nominal
    xs, zs = choose_scale(10.0 / max(r * 1e3, 0.1)), choose_scale(44.0 / (H * 1e3))
    view = View(_DETAIL, xs, zs)
    cx, cz = _DETAIL
    left, right = cx - 42.0, cx + 62.0
    top = view.at(0.0, H)[1]
    turns = [index * math.pi / 40.0 for index in range(21)] if r > 0.0 else [0.5 * math.pi]
    edge = [view.at(r - r * math.cos(turn), H - r + r * math.sin(turn)) for turn in turns]
    sheet.draw_polyline([(left, cz), (cx, cz), *edge, (right, top)])
    sheet.draw_break_line(left, cz - 8.0, cz)
    sheet.draw_break_line(right, cz - 8.0, top)
    sheet.draw_dimension(
        "step_height", (cx - 24.0, cz), (cx, top), (cx - 14.0, cz), zs, upright=True
    )
    sheet.draw_leader(edge[len(edge) // 2], (cx + 10.0, top - 8.0), "R {}", "edge_radius")
    # ISO 13715: the outer edge is free of burr; the root may have a fillet or an undercut
    small, large = (f"{limit * 1e3:.3g}" for limit in block.edge_radius.limits)
    sheet.draw_edge_state(
        edge[len(edge) // 2],
        (cx + 10.0, top - 16.0),
        f"-{large}" if block.edge_radius.limits[0] <= 0.0 else f"-{small}/-{large}",
    )
    sheet.draw_edge_state(
        (cx, cz),
        (cx + 10.0, cz - 7.0),
        "±H" if "step_height" in sheet.letters else f"±{H * 1e3:.3g}",
    )
    if "riser_angle" in sheet.listed:
        half = cz + 0.35 * (top - cz)
        level = max(cz + 0.6, min(half - 4.0, top - 21.0))
        sheet.draw_leader((cx, half), (cx + 10.0, level), "{} to A", "riser_angle")
        # its arrow stands on the riser, drawn on over the faces (ISO 1101)
        sheet.draw_line((cx, top + 1.0), (cx, top + 25.0), "DIMENSION")
        start = sheet.draw_tolerance_frame("riser_straightness", (cx + 8.0, top + 21.0))
        sheet.draw_pointer(start, (cx, start[1]))
    sheet.draw_datum((cx - 32.0, cz), "A")
    sheet.point_to(
        (cx - 21.0, cz), sheet.draw_tolerance_frame("flatness_lower", (cx - 16.0, cz - 20.0))
    )
    sheet.draw_tolerance_frame("parallelism_base", (cx - 16.0, cz - 26.0), "B")
    sheet.point_to(
        (cx + 4.0, top), sheet.draw_tolerance_frame("flatness_upper", (cx + 8.0, top + 7.0))
    )
    sheet.draw_tolerance_frame("parallelism", (cx + 8.0, top + 13.0), "A")
    sheet.draw_texture((cx + 46.0, top), "roughness", " (2 x)")
    sheet.write_text(
        (cx, cz - 33.0),
        f"A   lengths {format_scale(xs)}, heights {format_scale(zs)} "
        f"(heights exaggerated {zs / xs:g} times)",
        2.5,
        "BOTTOM_CENTER",
    )


def _draw_groove_detail(sheet: Sheet, block: StepBlock, feature: MetrologyFeature) -> None:
    cx, cz = _SECOND
    kind = feature.kind
    H, W = block.height.nominal, feature.width.nominal
    zs, xs = choose_scale(44.0 / (H * 1e3)), choose_scale(30.0 / (W * 1e3))
    top, half = cz + H * 1e3 * zs, 0.5 * W * 1e3 * xs
    outside, inside = (top, cz) if kind == "groove" else (cz, top)
    sheet.draw_polyline(
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
        sheet.draw_break_line(x, cz - 8.0, outside)
    # the text of a narrow width stands on the right, so the depth stands on the left
    start = cx if kind == "groove" else cx - 30.0
    sheet.draw_dimension(
        _depth_key(feature),
        (start, cz),
        (cx - half, top),
        (cx - half - 9.0, cz),
        zs,
        upright=True,
    )
    sheet.draw_dimension(f"{kind}_width", (cx - half, top), (cx + half, top), (cx, top + 8.0), xs)
    sheet.write_text(
        (cx, cz - 33.0),
        f"B   lengths {format_scale(xs)}, heights {format_scale(zs)}",
        2.5,
        "BOTTOM_CENTER",
    )


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
    sheet.draw_polyline([(cx - 60.0, cz), (cx, cz), (cx, floor)])
    sheet.draw_polyline(
        [(wall, floor), *corner, (max(corner[-1][0], cx), corner[-1][1]), (cx + 75.0, level)]
    )
    if cz - d * 1e3 * s < floor:
        sheet.draw_break_line(cx, floor - 6.0, floor)
        sheet.draw_break_line(wall, floor - 6.0, floor)
    else:
        sheet.draw_line((cx, floor), (wall, floor))
    sheet.draw_dimension(
        "marginal_gap", (cx, floor + 8.0), (wall, floor + 8.0), (cx, floor - 12.0), s
    )
    if sheet.listed["horizontal_discrepancy"][1].nominal > 0.0:
        sheet.draw_dimension(
            "horizontal_discrepancy",
            (cx - 30.0, cz),
            (cx + 62.0, level),
            (cx - 40.0, cz),
            s,
            upright=True,
        )
    top = max(cz, level)
    beyond = max(cx + 18.0, wall + 8.0)
    if (
        "vertical_discrepancy" in sheet.listed
        and sheet.listed["vertical_discrepancy"][1].kind == "distance"
    ):
        low, high = sorted([(cx, cz), view.at(margin.opening.nominal, h)])
        sheet.draw_dimension("vertical_discrepancy", low, high, (cx, top + 8.0), s)
        beyond = high[0] + 42.0  # clear of the text, which stands beside a narrow dimension
    sheet.draw_datum((cx - 54.0, cz), "A")
    sheet.draw_tolerance_frame("flatness_lower", (cx - 58.0, cz - 28.0))
    sheet.point_to((cx - 44.0, cz), (cx - 44.0, cz - 22.0))
    sheet.draw_tolerance_frame("parallelism_base", (cx - 58.0, cz - 34.0), "B")
    sheet.point_to(
        (beyond, level), sheet.draw_tolerance_frame("flatness_upper", (beyond + 4.0, top + 18.0))
    )
    sheet.draw_tolerance_frame("parallelism", (beyond + 4.0, top + 24.0), "A")
    sheet.write_text((cx - 58.0, cz + 3.0), "tooth", 2.5)
    sheet.write_text((cx + 60.0, level - 5.0), "crown", 2.5)
    sheet.draw_texture((max(cx + 62.0, beyond + 3.0), level), "roughness", " (2 x)")
    sheet.draw_leader(
        (cx + 0.4 * g * 1e3 * s, floor + 2.0), (cx - 24.0, floor + 8.0), "depth {}", "gap_depth"
    )
    sheet.write_text((cx - 50.0, floor - 8.0), f"A   {format_scale(s)}", 2.5, "BOTTOM_CENTER")
