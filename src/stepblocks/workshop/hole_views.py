"""Views of the fixing holes of a block: both from above, and one in section."""

import math
from dataclasses import dataclass

from stepblocks.parts.body import DRILL_POINT, Body, Mounting
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Layer,
    Point,
    choose_standard_scale,
    format_scale,
    replace_decimal_points_by_commas,
)
from stepblocks.workshop.sheet import Sheet

_DEPTH_BESIDE = 8.0  # of the section of a hole, the line of its depth
_UNEVEN_DEPTH_BESIDE = 12.0  # the same of unequal deviations
_SECTION_VIEW: Point = (360.0, 131.0)  # middle of the base in the section through a hole
_SECTION_HEIGHT = 36.0  # of the section on the paper, at most
_SECTION_WIDTH = 34.0
_CENTRE_LINE = 3.0  # length of a centre line beyond the hole
_THREAD_ARC_STEP = 10.0  # [deg]; the outer line of a hidden thread is three quarters of a circle
_THREAD_ARC_POINTS = 28


def draw_holes_from_above(
    sheet: Sheet, body: Body, mounting: Mounting, middle: Point, scale: float
) -> None:
    """Draw both fixing holes in the view from above, with their places, and one in section.

    Parameters
    ----------
    sheet : Sheet
        What is drawn on.
    body, mounting : Body, Mounting
        The body and its holes.
    middle : tuple of float
        Middle of the view on the paper [mm].
    scale : float
        Scale of the view.
    """
    x, y = middle
    magnification = MILLIMETRES_PER_METRE * scale
    half_length = body.half_length * magnification
    half_width = body.half_width * magnification
    edge_break = body.edge_break.nominal * magnification
    hole = 0.5 * mounting.hole_diameter * magnification
    entry = 0.5 * mounting.entry_diameter * magnification
    half_spacing = 0.5 * mounting.spacing.nominal * magnification
    for hole_x in (x - half_spacing, x + half_spacing):
        _draw_hole_circles(sheet, mounting, (hole_x, y), hole, entry)
    left = x - half_length
    lower = y - half_width
    # the text of the spacing stands beyond the line that leads the length out
    sheet.draw_dimension(
        "hole_spacing",
        (x - half_spacing, y - hole),
        (x + half_spacing, y - hole),
        (x, lower - 19.0),
        scale,
        clearance=half_length - half_spacing,
    )
    sheet.draw_dimension(
        "hole_position",
        (left, lower + edge_break),
        (x - half_spacing, y - hole),
        (x, lower - 10.0),
        scale,
        before=True,
    )
    sheet.draw_dimension(
        "hole_row",
        (left + edge_break, lower),
        (x - half_spacing, y),
        (left - 24.0, y),
        scale,
        upright=True,
    )
    thread = f"for {mounting.thread}"
    if mounting.kind == "tapped":
        thread = f"{mounting.thread}-6H"
    sheet.draw_leader(
        (x + half_spacing + 0.7 * hole, y - 0.7 * hole),
        (x + half_length + 10.0, y - 11.0),
        replace_decimal_points_by_commas(f"2 x {thread}, section C"),
    )
    sheet.draw_cutting_line((x - half_length - 3.0, y), (x + half_length + 3.0, y), "C")
    _draw_hole_section(sheet, body, mounting)


def _draw_hole_circles(
    sheet: Sheet, mounting: Mounting, centre: Point, hole_radius_mm: float, entry_radius_mm: float
) -> None:
    """Draw one hole from above by the radii of hole and entry on the paper, with centre lines."""
    x, y = centre
    if mounting.kind == "clearance":
        sheet.draw_circle(centre, entry_radius_mm)
        sheet.draw_circle(centre, hole_radius_mm)
    else:  # tapped from below, and so hidden
        sheet.draw_circle(centre, hole_radius_mm, Layer.HIDDEN)
        thread = []
        for index in range(_THREAD_ARC_POINTS):
            turn = math.radians(_THREAD_ARC_STEP * (index + 1))
            thread.append(
                (x + entry_radius_mm * math.cos(turn), y + entry_radius_mm * math.sin(turn))
            )
        sheet.draw_polyline(thread, Layer.HIDDEN)
    sheet.draw_line(
        (x - hole_radius_mm - _CENTRE_LINE, y), (x + hole_radius_mm + _CENTRE_LINE, y), Layer.CENTRE
    )
    sheet.draw_line(
        (x, y - hole_radius_mm - _CENTRE_LINE), (x, y + hole_radius_mm + _CENTRE_LINE), Layer.CENTRE
    )


@dataclass(frozen=True)
class _HoleSection:
    """Sizes of a hole in section, on the paper [mm]."""

    scale: float
    x: float  # of the axis
    base: float  # y of the base of the block
    top: float  # y of its upper side, or of the break below it
    half: float  # half width of the section
    drill: float  # radius
    entry: float  # radius of the countersink or counterbore
    depth: float
    is_whole: bool  # whether the section reaches the upper side

    @classmethod
    def from_body(cls, body: Body, mounting: Mounting) -> "_HoleSection":
        """Choose what a section shows, and its scale."""
        thickness = body.thickness.nominal
        shown = thickness
        if mounting.kind == "tapped":
            shown = min(thickness, 1.2 * mounting.depth.nominal)
        width = 1.6 * mounting.entry_diameter
        scale = choose_standard_scale(
            min(
                _SECTION_HEIGHT / (shown * MILLIMETRES_PER_METRE),
                _SECTION_WIDTH / (width * MILLIMETRES_PER_METRE),
            )
        )
        magnification = MILLIMETRES_PER_METRE * scale
        x, base = _SECTION_VIEW
        return cls(
            scale,
            x,
            base,
            base + shown * magnification,
            0.5 * width * magnification,
            0.5 * mounting.hole_diameter * magnification,
            0.5 * mounting.entry_diameter * magnification,
            mounting.depth.nominal * magnification,
            shown == thickness,
        )

    @property
    def magnification(self) -> float:
        """Millimetres on the paper for a metre of the block."""
        return MILLIMETRES_PER_METRE * self.scale

    @property
    def text_start(self) -> Point:
        """Where texts beside the section begin: left of it, half way up [mm]."""
        return self.x - self.half - 5.0, self.base + 0.5 * (self.top - self.base)


def _draw_hole_section(sheet: Sheet, body: Body, mounting: Mounting) -> None:
    """Draw a hole in section; a thread as in ISO 6410-1, crests thick and roots thin."""
    section = _HoleSection.from_body(body, mounting)
    x, base, top, half = section.x, section.base, section.top, section.half
    sheet.draw_line((x - half, base), (x + half, base))
    upper_layer = Layer.OUTLINE if section.is_whole else Layer.DIMENSION
    sheet.draw_line((x - half, top), (x + half, top), upper_layer)
    for side in (-1.0, 1.0):
        sheet.draw_break_line(x + side * half, base, top)
        if mounting.kind == "tapped":
            _draw_thread_lines(sheet, section, mounting, side)
            outline = _list_tapped_outline(section)
        else:
            outline = _list_counterbored_outline(section)
        sheet.draw_polyline([(x + side * radius, z) for radius, z in outline])
        end_radius, _ = outline[-1]
        cut_area = [*outline, (end_radius, top), (half, top), (half, base)]
        sheet.draw_hatch([(x + side * radius, z) for radius, z in cut_area])
    sheet.draw_line((x, base - _CENTRE_LINE), (x, top + _CENTRE_LINE), Layer.CENTRE)
    if mounting.kind == "tapped":
        low, high = base, base + section.depth
        floor = high
    else:
        low, high = top - section.depth, top
        floor = low
    drill = section.drill
    beside = _DEPTH_BESIDE
    depth = sheet.listed["hole_depth"].characteristic
    if depth.upper != -depth.lower:  # which stand one over the other
        beside = _UNEVEN_DEPTH_BESIDE
    sheet.draw_line((x - drill, floor), (x + drill, floor))
    sheet.draw_dimension(
        "hole_depth",
        (x + drill, low),
        (x + drill, high),
        (x + half + beside, base),
        section.scale,
        upright=True,
    )
    caption = f"C-C   {format_scale(section.scale)}"
    sheet.write_text((x, base - 8.0), caption, alignment=Alignment.BOTTOM_CENTER)
    if mounting.kind == "tapped":
        _label_thread(sheet, section, mounting)
    else:
        _label_counterbored_hole(sheet, section)


def _list_tapped_outline(section: _HoleSection) -> list[Point]:
    """List countersink, core hole and drill point as (radius, y), from the base up."""
    base, drill, entry = section.base, section.drill, section.entry
    floor = base + section.depth
    return [
        (entry, base),
        (drill, base + entry - drill),  # a countersink of 90 degrees
        (drill, floor),
        (0.0, floor + drill / math.tan(0.5 * DRILL_POINT)),
    ]


def _list_counterbored_outline(section: _HoleSection) -> list[Point]:
    """List through hole and counterbore as (radius, y), from the base up."""
    shoulder = section.top - section.depth
    return [
        (section.drill, section.base),
        (section.drill, shoulder),
        (section.entry, shoulder),
        (section.entry, section.top),
    ]


def _draw_thread_lines(
    sheet: Sheet, section: _HoleSection, mounting: Mounting, side: float
) -> None:
    """Draw root and end of the thread on one side of the axis."""
    x, base = section.x, section.base
    thread_end = base + mounting.thread_depth * section.magnification
    root = x + side * section.entry
    sheet.draw_line((root, base), (root, thread_end), Layer.DIMENSION)
    sheet.draw_line((x, thread_end), (root, thread_end))


def _label_thread(sheet: Sheet, section: _HoleSection, mounting: Mounting) -> None:
    """Write thread, depth and core hole beside the section."""
    tip_height = 0.4 * mounting.thread_depth * section.magnification
    tip = (section.x - section.entry, section.base + tip_height)
    elbow_x, elbow_y = section.text_start
    sheet.draw_characteristic_leader(
        "thread",
        tip,
        section.text_start,
        replace_decimal_points_by_commas(f"{mounting.thread}-6H, thread {{}} deep"),
    )
    core = f"core {sheet.format_tool_diameter(mounting.hole_diameter)}"
    sheet.write_text(
        (elbow_x - 5.0, elbow_y - 6.0), f"{core}, 6H of ISO 965-1", alignment=Alignment.RIGHT
    )


def _label_counterbored_hole(sheet: Sheet, section: _HoleSection) -> None:
    """Write the diameters of through hole and counterbore beside the section."""
    hole = sheet.format_tool_diameter(2.0 * section.drill / section.magnification)
    entry = sheet.format_tool_diameter(2.0 * section.entry / section.magnification)
    sheet.draw_leader(
        (section.x - section.drill, section.base + 3.0),
        section.text_start,
        f"{hole} through, counterbored {entry}",
    )
