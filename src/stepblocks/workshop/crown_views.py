"""Views of tooth and crown: both in section, and their margin enlarged."""

from collections.abc import Iterable
from typing import NamedTuple

from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.revolution import list_outline_points
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Layer,
    Point,
    View,
    choose_standard_scale,
    format_scale,
)
from stepblocks.workshop.sheet import Sheet, UnwrittenNotes
from stepblocks.workshop.turned import CHORD

_SECTION_ORIGIN: Point = (110.0, 150.0)  # where the axis crosses the finish line
_SECTION_HEIGHT = 150.0  # of the section on the paper, at most
_SECTION_WIDTH = 90.0
_HATCH_ANGLES = {"tooth": 0.0, "crown": 90.0}  # [deg]; parts that touch are distinguished
_MARGIN_VIEW: Point = (300.0, 205.0)  # of the cavosurface angle, enlarged
_WINDOW = 45.0  # half side of the enlarged window
_MARGIN_REACH = 40.0  # of the largest gap or discrepancy, in fours, on the paper
_SMALLEST_REACH = 50e-6  # gap that chooses the scale of the margin, at least [m]


def draw_crown_views(sheet: Sheet, crown: CrownOnTooth) -> UnwrittenNotes:
    """Draw tooth and crown in section, and the margin enlarged; return the notes to be written."""
    root = crown.root_length.nominal
    preparation = crown.preparation_height.nominal
    margin_radius = crown.margin_radius.nominal
    height = root + preparation + 2.0 * crown.shell_thickness.nominal
    scale = choose_standard_scale(
        min(
            _SECTION_HEIGHT / (height * MILLIMETRES_PER_METRE),
            _SECTION_WIDTH / (2.2 * margin_radius * MILLIMETRES_PER_METRE),
        )
    )
    view = View(_SECTION_ORIGIN, scale)
    tooth_section, crown_section = (
        list_outline_points(outline, CHORD) for outline in crown.outlines()
    )
    _draw_hatched_half_sections(sheet, view, tooth_section, _HATCH_ANGLES["tooth"])
    _draw_hatched_half_sections(sheet, view, crown_section, _HATCH_ANGLES["crown"])
    x, _ = view.origin
    _, base = view.map_to_paper(0.0, -root)
    _, preparation_top = view.map_to_paper(0.0, preparation)
    sheet.draw_line((x, base - 5.0), (x, preparation_top + 18.0), Layer.CENTRE)
    roof = max(z for _, z in crown_section)
    _draw_crown_dimensions(sheet, crown, view, roof)
    margin_x, margin_y = view.map_to_paper(margin_radius, 0.0)
    sheet.draw_leader((margin_x, margin_y), (margin_x + 14.0, margin_y - 8.0), "margin, detail D")
    caption = f"section {format_scale(scale)}, seated"
    sheet.write_text((x, base - 22.0), caption, alignment=Alignment.BOTTOM_CENTER)
    _draw_margin_detail(sheet, crown, (tooth_section, crown_section))
    return ["Marginal gap, internal gap and discrepancies hold with the crown seated on its tooth."]


def _draw_hatched_half_sections(
    sheet: Sheet, view: View, half_section: list[Point], hatch_degrees: float
) -> None:
    """Draw both halves of a half section (radius, height) and hatch them."""
    for side in (1.0, -1.0):
        points = [view.map_to_paper(side * radius, z) for radius, z in half_section]
        sheet.draw_polyline(points)
        sheet.draw_hatch(points, hatch_degrees)


class _Span(NamedTuple):
    """What a dimension measures on the paper [mm]."""

    start: Point
    end: Point
    level: float  # of its line, square to itself


def _draw_crown_dimensions(
    sheet: Sheet, crown: CrownOnTooth, view: View, roof_height: float
) -> None:
    """Draw the dimensions of tooth and crown that are characteristics."""
    root = crown.root_length.nominal
    preparation = crown.preparation_height.nominal
    radius = crown.margin_radius.nominal
    outer = radius + crown.horizontal_discrepancy.nominal
    ceiling = preparation + crown.internal_gap.nominal
    map_to_paper = view.map_to_paper
    x, y = view.origin
    _, base = map_to_paper(0.0, -root)
    _, roof_y = map_to_paper(0.0, roof_height)
    widths = {
        "margin_diameter": _Span(
            map_to_paper(-radius, -root), map_to_paper(radius, -root), base - 10.0
        ),
        "crown_diameter": _Span(
            map_to_paper(-outer, roof_height), map_to_paper(outer, roof_height), roof_y + 10.0
        ),
    }
    for key, span in widths.items():
        if key in sheet.listed:
            sheet.draw_dimension(key, span.start, span.end, (x, span.level), view.scale)
    left_side, _ = map_to_paper(-1.05 * outer, 0.0)
    right_side, _ = map_to_paper(1.05 * outer, 0.0)
    left = left_side - 10.0
    right = right_side + 54.0  # beyond the text of the diameter above
    margin = map_to_paper(-radius, 0.0)
    foot = map_to_paper(-radius, -root)
    top = map_to_paper(0.0, preparation)
    heights = {
        "preparation_height": _Span(margin, top, left),
        "root_length": _Span(foot, margin, left - 12.0),
        "tooth_length": _Span(foot, top, left - 6.0),
        "shell_thickness": _Span(
            map_to_paper(0.3 * radius, ceiling), map_to_paper(0.3 * radius, roof_height), right
        ),
    }
    for key, span in heights.items():
        if key in sheet.listed:
            through = (span.level, y)
            sheet.draw_dimension(key, span.start, span.end, through, view.scale, upright=True)


def _draw_margin_detail(
    sheet: Sheet, crown: CrownOnTooth, half_sections: Iterable[list[Point]]
) -> None:
    """Draw the margin enlarged, with the distance from the tooth to the margin of the crown."""
    x, y = _MARGIN_VIEW
    discrepancy = crown.horizontal_discrepancy.nominal
    reach = 4.0 * max(crown.marginal_gap.nominal, abs(discrepancy), _SMALLEST_REACH)
    scale = choose_standard_scale(_MARGIN_REACH / (reach * MILLIMETRES_PER_METRE))
    for section in half_sections:
        _draw_section_in_window(sheet, section, crown.margin_radius.nominal, scale)
    key = "marginal_gap"
    if "vertical_discrepancy" in sheet.listed:
        key = "vertical_discrepancy"
    opening = sheet.listed[key].characteristic
    outer = discrepancy * MILLIMETRES_PER_METRE * scale
    if opening.kind == "distance":
        # from the cavosurface angle of the tooth to the margin of the crown
        sheet.draw_dimension(
            key,
            (x, y),
            (x + outer, y + opening.nominal * MILLIMETRES_PER_METRE * scale),
            (x + max(outer, 0.0) + 14.0, y),
            scale,
            upright=True,
        )
    sheet.write_text((x - _WINDOW + 3.0, y - _WINDOW + 4.0), "tooth")
    sheet.write_text((x - _WINDOW + 3.0, y + _WINDOW - 7.0), "crown")
    corner = (x - _WINDOW, y - _WINDOW)
    sheet.draw_rectangle(corner, (x + _WINDOW, y + _WINDOW), Layer.DIMENSION)
    caption = f"D   margin {format_scale(scale)}"
    sheet.write_text((x, y - _WINDOW - 7.0), caption, alignment=Alignment.BOTTOM_CENTER)


def _draw_section_in_window(
    sheet: Sheet, half_section: list[Point], margin_radius: float, scale: float
) -> None:
    """Draw what a window about the margin shows of a half section (radius, height)."""
    import shapely

    view = View(_MARGIN_VIEW, scale)
    shown = _WINDOW / (MILLIMETRES_PER_METRE * scale)
    window = shapely.box(margin_radius - shown, -shown, margin_radius + shown, shown)
    inside = shapely.LineString(half_section).intersection(window)
    for piece in getattr(inside, "geoms", [inside]):
        if piece.geom_type != "LineString":
            continue
        line = [view.map_to_paper(r - margin_radius, z) for r, z in piece.coords]
        sheet.draw_polyline(line)
