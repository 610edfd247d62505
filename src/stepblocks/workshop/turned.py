"""Views of probe tips and sheaths, which are turned."""

import itertools
import math
from collections.abc import Iterator, Sequence
from textwrap import wrap

from stepblocks.parts.kinds.sheath import MASS_MATCH, Sheath, format_mass
from stepblocks.parts.kinds.tips import HookTip, StraightTip, Tip
from stepblocks.parts.revolution import list_outline_points
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Layer,
    Point,
    View,
    choose_standard_scale,
    format_scale,
    replace_decimal_points_by_commas,
)
from stepblocks.workshop.sheet import Sheet, UnwrittenNotes

_SHANKS = "ISO 1797"  # standard of the shanks of rotary instruments
_NO_LATCH = (
    f"It is a plain cylinder; a shank of type 1 of {_SHANKS} has a latch, which is not drawn."
)
_NOTE_WIDTH = 88  # of a line of notes [letters]
CHORD = 0.05e-6  # off its arc by less than a sheet at the scale of an enlarged ball shows [m]
_SIDE_X = 40.0  # of the contact point in the side view of a tip
_SIDE_Y = 170.0  # of the middle of that view
_SIDE_WIDTH = 180.0  # of a tip on the paper, at most
_SIDE_HEIGHT = 150.0
_SHANK_RADIUS = 40.0  # of a shank on the paper, at most
_BEND_STEPS = 60
_BALL_VIEW: Point = (320.0, 215.0)  # middle of the enlarged ball
_BALL_RADIUS = 22.0  # on the paper, at most
_BALL_HEIGHT = 3.2  # of what is drawn of ball and cone, in radii of the ball
_FLANK_HEIGHT = 2.6  # at which the leader of the cone ends, in radii of the ball
_SHEATH_ORIGIN: Point = (60.0, 190.0)
_SHEATH_LENGTH = 130.0
_SHEATH_DIAMETER = 70.0


def _draw_mirrored_half_section(
    sheet: Sheet, view: View, outline: Sequence[Point], closed: bool = False
) -> None:
    """Draw a half section (radius, height) on either side of its axis, which lies level."""
    for half in _yield_mirrored_halves(view, outline):
        sheet.draw_polyline(half, closed=closed)


def _yield_mirrored_halves(view: View, outline: Sequence[Point]) -> Iterator[list[Point]]:
    """Yield the upper, then the lower half of a section (radius, height) on the paper."""
    for side in (1.0, -1.0):
        yield [view.map_to_paper(height, side * radius) for radius, height in outline]


def _describe_shank(sheet: Sheet, tip: StraightTip) -> list[str]:
    """Say which shank a tip has, where its declaration names a source of it."""
    source = tip.shank_radius.source
    if not source:
        return []
    number = sheet.listed["shank_diameter"].number
    lines = wrap(
        f"Shank ({number}): {replace_decimal_points_by_commas(source.rstrip('.'))}.", _NOTE_WIDTH
    )
    if _SHANKS in source:
        lines.append(_NO_LATCH)
    return lines


def draw_straight_tip_views(sheet: Sheet, tip: StraightTip) -> UnwrittenNotes:
    """Draw a straight tip on its side, and its ball enlarged; return the notes to be written."""
    shank = tip.shank_radius.nominal
    end = tip.length.nominal
    view = _draw_side_view(sheet, tip, end, [])
    origin_x, origin_y = view.origin
    corner = view.map_to_paper(end, -shank)
    axis_end, _ = view.map_to_paper(end, 0.0)
    _, lower = view.map_to_paper(0.0, -shank)
    sheet.draw_dimension(
        "shank_diameter",
        corner,
        view.map_to_paper(end, shank),
        (axis_end + 14.0, origin_y),
        view.scale,
        upright=True,
    )
    sheet.draw_dimension("length", view.origin, corner, (origin_x, lower - 12.0), view.scale)
    datum_x, upper = view.map_to_paper(0.75 * end, shank)
    sheet.draw_datum_above((datum_x, upper), "A")
    _write_side_view_caption(sheet, view, -shank)
    _draw_ball_detail(sheet, tip)
    _draw_runout_frame(sheet, tip)
    return _describe_shank(sheet, tip)


def draw_hook_tip_views(sheet: Sheet, tip: HookTip) -> UnwrittenNotes:
    """Draw a bent tip lying on its side and its ball enlarged; it needs no notes."""
    wire = tip.shank_radius.nominal
    inner = _list_wire_side(tip, -wire)
    outer = _list_wire_side(tip, wire)
    end_face = [inner[-1], outer[-1]]
    view = _draw_side_view(sheet, tip, tip.cone_end, [inner, outer, end_face])
    _draw_bend_leaders(sheet, tip, view, outer)
    _, heights = zip(*inner, *outer, strict=True)
    lowest = min(-wire, *heights)
    _write_side_view_caption(sheet, view, lowest)
    _draw_ball_detail(sheet, tip)
    return []


def _list_wire_side(tip: HookTip, offset: float) -> list[Point]:
    """List one side of the bent wire (x along the tip, y) [m], its straight shank last.

    `offset` is the distance of that side from the axis of the wire, away from the middle of the
    bend.
    """
    start = tip.cone_end
    bend = tip.bend_radius.nominal
    angle = tip.bend_angle.nominal
    radius = bend + offset
    points = []
    for index in range(_BEND_STEPS + 1):
        turn = angle * index / float(_BEND_STEPS)
        points.append((start + radius * math.sin(turn), bend - radius * math.cos(turn)))
    bend_end_x, bend_end_y = points[-1]
    straight = tip.straight_length.nominal
    shank_end = (bend_end_x + straight * math.cos(angle), bend_end_y + straight * math.sin(angle))
    points.append(shank_end)
    return points


def _draw_bend_leaders(sheet: Sheet, tip: HookTip, view: View, outer: list[Point]) -> None:
    """Draw the leaders of wire, bend and straight shank."""
    start_x, start_y = outer[-2]  # of the straight run of the shank
    end_x, end_y = outer[-1]
    middle = view.map_to_paper(0.5 * (start_x + end_x), 0.5 * (start_y + end_y))
    x, y = middle
    sheet.draw_characteristic_leader("shank_diameter", middle, (x + 14.0, y - 6.0), "⌀{}")
    bend = tip.bend_radius.nominal
    half_angle = 0.5 * tip.bend_angle.nominal
    axis = view.map_to_paper(
        tip.cone_end + bend * math.sin(half_angle), bend * (1.0 - math.cos(half_angle))
    )
    x, y = axis
    sheet.draw_characteristic_leader(
        "bend_radius", axis, (x + 18.0, y - 10.0), "R {}, axis of the wire"
    )
    sheet.draw_characteristic_leader("bend_angle", axis, (x + 18.0, y - 18.0), "bent by {}")
    near_end = view.map_to_paper(0.2 * start_x + 0.8 * end_x, 0.2 * start_y + 0.8 * end_y)
    x, y = near_end
    sheet.draw_characteristic_leader(
        "straight_length", near_end, (x + 14.0, y - 6.0), "straight over {} from the bend"
    )


def _draw_side_view(
    sheet: Sheet, tip: Tip, axis_end: float, further_lines: list[list[Point]]
) -> View:
    """Draw ball, cone and shank about their axis, then more lines (x, y) [m].

    The axis is drawn up to `axis_end` [m]. Returns the view, whose origin is the contact point.
    """
    half_section = list_outline_points(tip.outline(), CHORD)
    upper, lower = [], []
    for radius, height in half_section:
        upper.append((height, radius))
        lower.append((height, -radius))
    lines = [upper, lower, *further_lines]
    along, across = zip(*itertools.chain(*lines), strict=True)
    width = MILLIMETRES_PER_METRE * (max(along) - min(along))
    height = MILLIMETRES_PER_METRE * (max(across) - min(across))
    shank = MILLIMETRES_PER_METRE * tip.shank_radius.nominal
    scale = choose_standard_scale(
        min(_SIDE_WIDTH / width, _SIDE_HEIGHT / height, _SHANK_RADIUS / shank)
    )
    half_magnification = 0.5 * MILLIMETRES_PER_METRE * scale
    axis_y = _SIDE_Y - half_magnification * (min(across) + max(across))
    view = View((_SIDE_X, axis_y), scale)
    for line in lines:
        sheet.draw_polyline(view.map_line_to_paper(line))
    end_x, _ = view.map_to_paper(axis_end, 0.0)
    sheet.draw_line((_SIDE_X - 5.0, axis_y), (end_x + 5.0, axis_y), Layer.CENTRE)
    return view


def _write_side_view_caption(sheet: Sheet, view: View, lowest: float) -> None:
    """Write the scale of the side view under its lowest point [m]."""
    origin_x, _ = view.origin
    _, lower = view.map_to_paper(0.0, lowest)
    sheet.write_text((origin_x, lower - 26.0), f"side {format_scale(view.scale)}")


def _draw_ball_detail(sheet: Sheet, tip: Tip) -> None:
    """Draw the ball with the start of its cone, enlarged."""
    x, y = _BALL_VIEW
    ball = tip.ball_radius.nominal
    slope = math.tan(tip.cone_angle.nominal)
    start_radius, start_height = tip.cone_start
    view = View((x - 40.0, y), choose_standard_scale(_BALL_RADIUS / (ball * MILLIMETRES_PER_METRE)))
    height = _BALL_HEIGHT * ball
    outline = []
    for point in list_outline_points(tip.outline(), CHORD):
        _, point_height = point
        if point_height <= height:
            outline.append(point)
    outline.append((start_radius + (height - start_height) * slope, height))
    _draw_mirrored_half_section(sheet, view, outline)
    ball_on_paper = ball * MILLIMETRES_PER_METRE * view.scale
    sheet.draw_circle(view.map_to_paper(ball, 0.0), ball_on_paper, Layer.HIDDEN)
    sheet.draw_line((x - 45.0, y), (x + 45.0, y), Layer.CENTRE)
    on_ball = (
        x - 40.0 + ball_on_paper * (1.0 - math.cos(1.0)),
        y + ball_on_paper * math.sin(1.0),
    )
    sheet.draw_characteristic_leader("ball_radius", on_ball, (x - 34.0, y + 40.0), "SR {}")
    flank_height = _FLANK_HEIGHT * ball
    flank = view.map_to_paper(flank_height, start_radius + (flank_height - start_height) * slope)
    flank_x, _ = flank
    sheet.draw_characteristic_leader("cone_angle", flank, (flank_x + 6.0, y - 34.0), "{} included")
    caption = f"ball {format_scale(view.scale)}"
    sheet.write_text((x - 34.0, y - 50.0), caption, alignment=Alignment.BOTTOM_RIGHT)


def _draw_runout_frame(sheet: Sheet, tip: StraightTip) -> None:
    """Draw the frame of the run-out below the enlarged ball, its arrow on the side of the ball."""
    x, y = _BALL_VIEW
    ball = tip.ball_radius.nominal * MILLIMETRES_PER_METRE
    ball_on_paper = ball * choose_standard_scale(_BALL_RADIUS / ball)
    frame = sheet.draw_tolerance_frame("runout", (x - 12.0, y - 54.0), "A")
    sheet.draw_pointer_to_face((x - 40.0 + ball_on_paper, y - ball_on_paper), frame)


def draw_sheath_views(sheet: Sheet, sheath: Sheath) -> UnwrittenNotes:
    """Draw a sheath in section and from its end; return the notes to be written."""
    length = sheath.length.nominal
    outer = sheath.outer_diameter.nominal
    scale = choose_standard_scale(
        min(
            _SHEATH_LENGTH / (length * MILLIMETRES_PER_METRE),
            _SHEATH_DIAMETER / (outer * MILLIMETRES_PER_METRE),
        )
    )
    view = View(_SHEATH_ORIGIN, scale)
    _draw_sheath_section(sheet, sheath, view)
    _draw_sheath_dimensions(sheet, sheath, view)
    _draw_sheath_end(sheet, sheath, view)
    lightest, heaviest = sheath.mass_limits
    mass = replace_decimal_points_by_commas(format_mass(sheath.mass))
    least = replace_decimal_points_by_commas(format_mass(lightest))
    largest = replace_decimal_points_by_commas(format_mass(heaviest))
    return [
        f"Mass {mass}, {least} to {largest} within the limits.",
        f"Weigh the made parts; a pair must agree within {MASS_MATCH:.0%}.",
    ]


def _draw_sheath_section(sheet: Sheet, sheath: Sheath, view: View) -> None:
    """Draw both cut walls of a sheath, and the edges of bore and chamfers between them."""
    length = sheath.length.nominal
    half_bore = 0.5 * sheath.bore.nominal
    half_outer = 0.5 * sheath.outer_diameter.nominal
    chamfer = sheath.edge_break.nominal
    outline = sheath.outline()
    _draw_mirrored_half_section(sheet, view, outline, closed=True)
    for wall in _yield_mirrored_halves(view, outline):
        sheet.draw_hatch(wall)
    if "edge_break" in sheet.listed:
        corner = view.map_to_paper(length - 0.5 * chamfer, half_outer - 0.5 * chamfer)
        x, y = corner
        sheet.draw_characteristic_leader(
            "edge_break", corner, (x - 12.0, y + 12.0), "{} x 45°, both ends"
        )
    for end in (0.0, length):
        sheet.draw_line(view.map_to_paper(end, -half_bore), view.map_to_paper(end, half_bore))
    for chamfer_end in (chamfer, length - chamfer):
        sheet.draw_line(
            view.map_to_paper(chamfer_end, -half_outer), view.map_to_paper(chamfer_end, -half_bore)
        )
        sheet.draw_line(
            view.map_to_paper(chamfer_end, half_bore), view.map_to_paper(chamfer_end, half_outer)
        )
    sheet.draw_line(
        view.map_to_paper(-0.1 * length, 0.0), view.map_to_paper(1.1 * length, 0.0), Layer.CENTRE
    )


def _draw_sheath_dimensions(sheet: Sheet, sheath: Sheath, view: View) -> None:
    """Draw length, bore and outer diameter at the section, and its caption."""
    length = sheath.length.nominal
    half_bore = 0.5 * sheath.bore.nominal
    half_outer = 0.5 * sheath.outer_diameter.nominal
    left, axis_y = view.origin
    right, _ = view.map_to_paper(length, 0.0)
    lower_left = view.map_to_paper(0.0, -half_outer)
    below = view.map_to_paper(0.0, -half_outer - 14.0 / (MILLIMETRES_PER_METRE * view.scale))
    sheet.draw_dimension(
        "length", lower_left, view.map_to_paper(length, -half_outer), below, view.scale
    )
    sheet.draw_dimension(
        "bore",
        view.map_to_paper(length, -half_bore),
        view.map_to_paper(length, half_bore),
        (right + 12.0, axis_y),
        view.scale,
        upright=True,
    )
    sheet.draw_dimension(
        "outer_diameter",
        lower_left,
        view.map_to_paper(0.0, half_outer),
        (left - 16.0, axis_y),
        view.scale,
        upright=True,
    )
    middle_x, _ = view.map_to_paper(0.5 * length, 0.0)
    _, lower_y = lower_left
    caption = f"section {format_scale(view.scale)}, clamp on the left"
    sheet.write_text((middle_x, lower_y - 26.0), caption, alignment=Alignment.BOTTOM_CENTER)


def _draw_sheath_end(sheet: Sheet, sheath: Sheath, view: View) -> None:
    """Draw a sheath from its end, right of the section."""
    bore = sheath.bore.nominal
    outer = sheath.outer_diameter.nominal
    chamfer = sheath.edge_break.nominal
    half_magnification = 0.5 * MILLIMETRES_PER_METRE
    right, _ = view.map_to_paper(sheath.length.nominal, 0.0)
    _, y = view.origin
    x = right + 80.0
    for diameter in (bore, outer - 2.0 * chamfer, outer):
        sheet.draw_circle((x, y), half_magnification * diameter * view.scale)
    reach = 0.6 * MILLIMETRES_PER_METRE * outer * view.scale
    sheet.draw_line((x - reach, y), (x + reach, y), Layer.CENTRE)
    sheet.draw_line((x, y - reach), (x, y + reach), Layer.CENTRE)
    caption = f"end {format_scale(view.scale)}"
    sheet.write_text((x, y - reach - 6.0), caption, alignment=Alignment.BOTTOM_CENTER)
