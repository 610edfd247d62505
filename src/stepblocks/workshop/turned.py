"""Views of what is turned: probe tips, tooth and crown, sheaths."""

import math
from collections.abc import Iterable, Sequence

from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.sheath import MASS_MATCH, Sheath, format_mass
from stepblocks.parts.kinds.tips import HookTip, StraightTip, Tip
from stepblocks.parts.revolution import list_outline_points
from stepblocks.workshop.sheet import (
    Point,
    Sheet,
    View,
    choose_scale,
    format_scale,
    use_decimal_comma,
)

_CHORD = 0.05e-6  # off its arc by less than a sheet at the scale of an enlarged ball shows [m]


def _draw_mirrored(
    sheet: Sheet, view: View, outline: Sequence[Point], closed: bool = False
) -> None:
    # Draw a half section on either side of its axis, which lies along the sheet
    for side in (1.0, -1.0):
        sheet.draw_polyline([view.at(z, side * r) for r, z in outline], closed=closed)


def draw_straight_tip_views(sheet: Sheet, tip: StraightTip) -> list[str]:
    """Draw a straight tip lying on its side and its ball enlarged."""
    shank, end = tip.shank_radius.nominal, tip.length.nominal
    view = _draw_side_view(sheet, tip, end, [])
    corner, foot = view.at(end, -shank), view.at(0.0, -shank)
    sheet.draw_dimension(
        "shank_diameter",
        corner,
        view.at(end, shank),
        (view.at(end, 0.0)[0] + 14.0, view.origin[1]),
        view.scale,
        upright=True,
    )
    sheet.draw_dimension(
        "length", view.origin, corner, (view.origin[0], foot[1] - 12.0), view.scale
    )
    return _draw_ball(sheet, tip, view, -shank)


def draw_hook_tip_views(sheet: Sheet, tip: HookTip) -> list[str]:
    """Draw a bent tip lying on its side and its ball enlarged."""
    top, R, r, total = (
        tip.cone_end,
        tip.bend_radius.nominal,
        tip.shank_radius.nominal,
        tip.bend_angle.nominal,
    )
    run = tip.straight_length.nominal
    bent = []
    # outer and inner line of the bent wire with the straight shank, then its end
    for offset in (-r, r):
        arc = [
            (top + (R + offset) * math.sin(t), R - (R + offset) * math.cos(t))
            for t in (total * index / 60.0 for index in range(61))
        ]
        arc.append((arc[-1][0] + run * math.cos(total), arc[-1][1] + run * math.sin(total)))
        bent.append(arc)
    bent.append([bent[0][-1], bent[1][-1]])
    view = _draw_side_view(sheet, tip, top, bent)
    start, end = bent[1][-2:]  # of the straight run of the shank
    middle = view.at(0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
    sheet.draw_leader(middle, (middle[0] + 14.0, middle[1] - 6.0), "⌀{}", "shank_diameter")
    axis = view.at(top + R * math.sin(0.5 * total), R * (1.0 - math.cos(0.5 * total)))
    sheet.draw_leader(
        axis, (axis[0] + 18.0, axis[1] - 10.0), "R {}, axis of the wire", "bend_radius"
    )
    sheet.draw_leader(axis, (axis[0] + 18.0, axis[1] - 18.0), "bent by {}", "bend_angle")
    along = view.at(0.2 * start[0] + 0.8 * end[0], 0.2 * start[1] + 0.8 * end[1])
    sheet.draw_leader(
        along,
        (along[0] + 14.0, along[1] - 6.0),
        "straight over {} from the bend",
        "straight_length",
    )
    return _draw_ball(sheet, tip, view, min(-r, *(y for line in bent for _, y in line)))


def _draw_side_view(sheet: Sheet, tip: Tip, end: float, outlines: list[list[Point]]) -> View:
    # Draw ball, cone and shank about their axis, and more lines; return the view
    half = list_outline_points(tip.outline(), _CHORD)
    lines = [*([(z, side * r) for r, z in half] for side in (1.0, -1.0)), *outlines]
    low, high = (
        [pick(point[k] for line in lines for point in line) for k in (0, 1)] for pick in (min, max)
    )
    wide, tall, shank = (
        1e3 * size for size in (high[0] - low[0], high[1] - low[1], tip.shank_radius.nominal)
    )
    s = choose_scale(min(180.0 / wide, 150.0 / tall, 40.0 / shank))
    view = View((40.0, 170.0 - 0.5e3 * s * (low[1] + high[1])), s)
    for line in lines:
        sheet.draw_polyline([view.at(*point) for point in line])
    cx, cy = view.origin
    sheet.draw_line((cx - 5.0, cy), (view.at(end, 0.0)[0] + 5.0, cy), "CENTRE")
    return view


def _draw_ball(sheet: Sheet, tip: Tip, side: View, lowest: float) -> list[str]:
    # Write the caption of the side view and draw the ball enlarged; return no notes
    sheet.write_text(
        (side.origin[0], side.at(0.0, lowest)[1] - 26.0), f"side {format_scale(side.scale)}", 2.5
    )
    cx, cy = 320.0, 215.0
    R = tip.ball_radius.nominal
    view = View((cx - 40.0, cy), choose_scale(22.0 / (R * 1e3)))
    height = 3.2 * R
    outline = [(r, z) for r, z in list_outline_points(tip.outline(), _CHORD) if z <= height]
    start = tip.cone_start
    outline.append((start[0] + (height - start[1]) * math.tan(tip.cone_angle.nominal), height))
    _draw_mirrored(sheet, view, outline)
    on_paper = R * 1e3 * view.scale
    sheet.draw_circle(view.at(R, 0.0), on_paper, "HIDDEN")
    sheet.draw_line((cx - 45.0, cy), (cx + 45.0, cy), "CENTRE")
    sheet.draw_leader(
        (cx - 40.0 + on_paper * (1.0 - math.cos(1.0)), cy + on_paper * math.sin(1.0)),
        (cx - 34.0, cy + 40.0),
        "SR {}",
        "ball_radius",
    )
    flank = view.at(2.6 * R, start[0] + (2.6 * R - start[1]) * math.tan(tip.cone_angle.nominal))
    sheet.draw_leader(flank, (flank[0] + 6.0, cy - 34.0), "{} included", "cone_angle")
    sheet.write_text(
        (cx - 20.0, cy - 48.0), f"ball {format_scale(view.scale)}", 2.5, "BOTTOM_CENTER"
    )
    return []


def draw_crown_views(sheet: Sheet, margin: CrownOnTooth) -> list[str]:
    """Draw tooth and crown in section, and the margin enlarged; return the lines of its notes."""
    root, top, R = (
        margin.root_length.nominal,
        margin.preparation_height.nominal,
        margin.margin_radius.nominal,
    )
    tall = root + top + 2.0 * margin.shell_thickness.nominal
    s = choose_scale(min(150.0 / (tall * 1e3), 90.0 / (2.2 * R * 1e3)))
    view = View((110.0, 150.0), s)
    (cx, cy), at = view.origin, view.at
    tooth, crown = (list_outline_points(outline, _CHORD) for outline in margin.outlines())
    for outline, angle, side in (  # parts that touch are distinguished
        (tooth, 0.0, 1.0),
        (tooth, 0.0, -1.0),
        (crown, 90.0, 1.0),
        (crown, 90.0, -1.0),
    ):
        points = [at(side * r, z) for r, z in outline]
        sheet.draw_polyline(points)
        sheet.draw_hatch(points, angle)
    base = at(0.0, -root)[1]
    roof = max(z for _, z in crown)
    outer = R + margin.horizontal_discrepancy.nominal
    sheet.draw_line((cx, base - 5.0), (cx, at(0.0, top)[1] + 18.0), "CENTRE")
    left, ceiling = at(-1.05 * outer, 0.0)[0] - 10.0, top + margin.internal_gap.nominal
    right = at(1.05 * outer, 0.0)[0] + 54.0  # beyond the text of the diameter above
    drawn = (  # between which points, and through which the line of the dimension leads
        ("margin_diameter", at(-R, -root), at(R, -root), (cx, base - 10.0)),
        ("crown_diameter", at(-outer, roof), at(outer, roof), (cx, at(0.0, roof)[1] + 10.0)),
        ("preparation_height", at(-R, 0.0), at(0.0, top), (left, cy)),
        ("root_length", at(-R, -root), at(-R, 0.0), (left - 12.0, cy)),
        ("tooth_length", at(-R, -root), at(0.0, top), (left - 6.0, cy)),
        ("shell_thickness", at(0.3 * R, ceiling), at(0.3 * R, roof), (right, cy)),
    )
    for key, one, other, along in drawn:
        if key in sheet.listed:
            sheet.draw_dimension(key, one, other, along, s, upright=not key.endswith("_diameter"))
    sheet.write_text((cx, base - 22.0), f"section {format_scale(s)}, seated", 2.5, "BOTTOM_CENTER")
    _draw_crown_margin(sheet, margin, (tooth, crown))
    return ["Marginal gap, internal gap and discrepancies hold with the crown seated on its tooth."]


def _draw_crown_margin(sheet: Sheet, margin: CrownOnTooth, outlines: Iterable[list[Point]]) -> None:
    import shapely

    cx, cy = 300.0, 205.0
    half = 45.0
    R = margin.margin_radius.nominal
    reach = 4.0 * max(
        margin.marginal_gap.nominal, abs(margin.horizontal_discrepancy.nominal), 50e-6
    )
    s = choose_scale(40.0 / (reach * 1e3))
    shown = half / (1e3 * s)
    window = shapely.box(R - shown, -shown, R + shown, shown)
    for outline in outlines:
        piece = shapely.LineString(outline).intersection(window)
        for part in getattr(piece, "geoms", [piece]):
            if part.geom_type == "LineString":
                sheet.draw_polyline(
                    [(cx + (r - R) * 1e3 * s, cy + z * 1e3 * s) for r, z in part.coords]
                )
    key = "vertical_discrepancy" if "vertical_discrepancy" in sheet.listed else "marginal_gap"
    _, one = sheet.listed[key]
    outer = margin.horizontal_discrepancy.nominal * 1e3 * s
    if one.kind == "distance":
        # from the cavosurface angle of the tooth to the margin of the crown
        sheet.draw_dimension(
            key,
            (cx, cy),
            (cx + outer, cy + one.nominal * 1e3 * s),
            (cx + max(outer, 0.0) + 14.0, cy),
            s,
            upright=True,
        )
    sheet.write_text((cx - half + 3.0, cy - half + 4.0), "tooth", 2.5)
    sheet.write_text((cx - half + 3.0, cy + half - 7.0), "crown", 2.5)
    sheet.draw_rectangle((cx - half, cy - half), (cx + half, cy + half), "DIMENSION")
    sheet.write_text((cx, cy - half - 7.0), f"A   margin {format_scale(s)}", 2.5, "BOTTOM_CENTER")


def draw_sheath_views(sheet: Sheet, part: Sheath) -> list[str]:
    """Draw a sheath in section and from its end; return the lines of its notes."""
    bore, outer, length, c = (
        one.nominal for one in (part.bore, part.outer_diameter, part.length, part.edge_break)
    )
    s = choose_scale(min(130.0 / (length * 1e3), 70.0 / (outer * 1e3)))
    view = View((60.0, 190.0), s)
    (left, cy), at = view.origin, view.at
    _draw_mirrored(sheet, view, part.outline(), closed=True)
    for side in (1.0, -1.0):
        sheet.draw_hatch([at(z, side * r) for r, z in part.outline()])
    if "edge_break" in sheet.listed:
        corner = at(length - 0.5 * c, 0.5 * outer - 0.5 * c)
        sheet.draw_leader(
            corner, (corner[0] - 12.0, corner[1] + 12.0), "{} x 45°, both ends", "edge_break"
        )
    for z in (0.0, length):
        sheet.draw_line(at(z, -0.5 * bore), at(z, 0.5 * bore))
    for z in (c, length - c):
        sheet.draw_line(at(z, -0.5 * outer), at(z, -0.5 * bore))
        sheet.draw_line(at(z, 0.5 * bore), at(z, 0.5 * outer))
    sheet.draw_line(at(-0.1 * length, 0.0), at(1.1 * length, 0.0), "CENTRE")
    low = -0.5 * outer
    right = at(length, 0.0)[0]
    sheet.draw_dimension(
        "length", at(0.0, low), at(length, low), at(0.0, low - 14.0 / (1e3 * s)), s
    )
    sheet.draw_dimension(
        "bore", at(length, -0.5 * bore), at(length, 0.5 * bore), (right + 12.0, cy), s, upright=True
    )
    sheet.draw_dimension(
        "outer_diameter", at(0.0, low), at(0.0, 0.5 * outer), (left - 16.0, cy), s, upright=True
    )
    sheet.write_text(
        (at(0.5 * length, 0.0)[0], at(0.0, low)[1] - 26.0),
        f"section {format_scale(s)}, clamp on the left",
        2.5,
        "BOTTOM_CENTER",
    )
    end = (right + 80.0, cy)
    reach = 0.6e3 * outer * s
    for diameter in (bore, outer - 2.0 * c, outer):
        sheet.draw_circle(end, 0.5e3 * diameter * s)
    sheet.draw_line((end[0] - reach, cy), (end[0] + reach, cy), "CENTRE")
    sheet.draw_line((end[0], cy - reach), (end[0], cy + reach), "CENTRE")
    sheet.write_text((end[0], cy - reach - 6.0), f"end {format_scale(s)}", 2.5, "BOTTOM_CENTER")
    own, lightest, heaviest = (
        use_decimal_comma(format_mass(one)) for one in (part.mass, *part.mass_limits)
    )
    return [
        f"Mass {own}, {lightest} to {heaviest} within the limits.",
        f"Weigh the made parts; a pair must agree within {MASS_MATCH:.0%}.",
    ]
