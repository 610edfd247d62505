"""Views of the parts of the apparatus, and of the assembly, in first-angle projection."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.solids import Box, Cylinder, enclose_boxes
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.parts.lettering import compute_text_width
from stepblocks.workshop.free_places import Circle, DrawnLines, Rectangle
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Layer,
    Paper,
    Point,
    choose_standard_scale,
    format_scale,
    replace_decimal_points_by_commas,
)
from stepblocks.workshop.sheet import Sheet, UnwrittenNotes

_X, _Y, _Z = range(3)
_LEFT = 44.0  # of the views of a part
_FOOT = 36.0
_ROOM: Point = (178.0, 236.0)  # for the views of a part
_GAP = 26.0  # between views
_DIMENSION_OFFSET = 11.0  # of a dimension line from its view
_CAPTION_OFFSET = 2.5
_CAPTION_HEIGHT = 2.0
_LABEL_HEIGHT = 1.8
_LABEL_MARGIN = 12.0  # by which a label may stand beyond its view
_ASSEMBLY_LEFT = 30.0
_ASSEMBLY_FOOT = 22.0
_ASSEMBLY_ROOM: Point = (382.0, 240.0)
_LIST_CORNER: Point = (256.0, 285.0)
_LIST_WIDTHS = (10.0, 54.0, 88.0)
_ROW_SPACING = 6.8  # from number to number over and under the assembly
_ROW_OFFSET = 9.0  # of their rows from what is numbered
_ROW_TEXT = 1.8  # of the numbers from the ends of their leaders
_DOT = 0.4  # radius of the end of a leader
_ARC_STEPS = 24  # of a half circle
_SAME = 1e-9  # coordinates that differ by less are one [m]


@dataclass(frozen=True)
class _Direction:
    """How a view looks at the parts.

    Attributes
    ----------
    name : str
        Of the view.
    across, up : int
        Axes that lie along the paper.
    out : int
        Axis along which it looks.
    side : float
        1 where the higher coordinates along it are nearer to the eye, else -1.
    turned : bool
        Whether the axis across runs from the right to the left.
    """

    name: str
    across: int
    up: int
    out: int
    side: float
    turned: bool = False


_FRONT = _Direction("front", _X, _Z, _Y, -1.0)
_TOP = _Direction("top", _X, _Y, _Z, 1.0)
_FROM_LEFT = _Direction("left", _Y, _Z, _X, -1.0, turned=True)


@dataclass(frozen=True)
class _PlacedView:
    """A view with its lower left corner on the paper, its scale, and what it shows [m]."""

    direction: _Direction
    corner: Point
    scale: float
    extent: Box

    def map_to_paper(self, x: float, y: float) -> Point:
        """Return the place on the paper of a point by its coordinates across and up [m]."""
        direction = self.direction
        offset = x - self.extent.low[direction.across]
        if direction.turned:
            offset = self.extent.high[direction.across] - x
        corner_x, corner_y = self.corner
        rise = y - self.extent.low[direction.up]
        magnification = MILLIMETRES_PER_METRE * self.scale
        return corner_x + offset * magnification, corner_y + rise * magnification

    def scale_length(self, length: float) -> float:
        """Return a length [m] on the paper."""
        return length * MILLIMETRES_PER_METRE * self.scale


def draw_kit_part_views(sheet: Sheet, part: KitPart) -> UnwrittenNotes:
    """Draw a part of the apparatus; return the notes to be written."""
    component = part.placed_component
    views = _lay_out_views(component.bounding_box, _needs_left_view(component), _LEFT, _FOOT, _ROOM)
    for view in views:
        _draw_component(sheet, view, component)
        _label_cylinders(sheet, view, component)
        _write_view_caption(sheet, view)
    _draw_overall_dimensions(sheet, views)
    notes = ["Break all edges by 0,3 mm; no burr."]
    if component.bores:
        notes.append("B1 stands at bore 1, B2 at bore 2, and so on.")
    if component.rods:
        notes.append("R1 stands at rod 1, R2 at rod 2, and so on.")
    threads = sorted({bore.thread for bore in component.bores if bore.thread})
    if threads:
        named = replace_decimal_points_by_commas(", ".join(threads))
        notes.append(f"Threads {named}, 6H, tapped where a bore is said to be for them.")
    return notes


def draw_assembly_views(paper: Paper, components: Sequence[Component]) -> None:
    """Draw components where they stand, each by its boxes and rods, with their numbers and a list.

    What another one covers in a view is left out.
    """
    views = _lay_out_views(
        _find_common_extent(components), True, _ASSEMBLY_LEFT, _ASSEMBLY_FOOT, _ASSEMBLY_ROOM
    )
    boxes = [box for component in components for box in component.boxes]
    for view in views:
        for component in components:
            _draw_uncovered_solids(paper, view, component, boxes)
        _write_view_caption(paper, view)
    _draw_component_numbers(paper, views[0], components)
    rows = [("item", "name", "material, or what it is ordered by")]
    for number, component in enumerate(components, start=1):
        ordered = component.material.order_text  # a number such as 1.4301 has no decimals
        if component.designation:
            ordered = replace_decimal_points_by_commas(component.designation)
        rows.append((str(number), component.title, ordered))
    paper.write_table(_LIST_CORNER, rows, _LIST_WIDTHS)


def _draw_uncovered_solids(
    paper: Paper, view: _PlacedView, component: Component, boxes: Sequence[Box]
) -> None:
    """Draw the boxes and rods of a component that no box covers in a view."""
    for box in component.boxes:
        if _choose_outline_layer(view, box, boxes) is Layer.OUTLINE:
            _draw_box(paper, view, box, Layer.OUTLINE)
    for rod in component.rods:
        if _choose_outline_layer(view, rod.bounding_box, boxes) is Layer.OUTLINE:
            _draw_cylinder(paper, view, rod, Layer.OUTLINE)


def _draw_component_numbers(
    paper: Paper, view: _PlacedView, components: Sequence[Component]
) -> None:
    """Write the numbers of components in a row over a view and in one under it, with leaders."""
    places = []
    for number, component in enumerate(components, start=1):
        centre = component.bounding_box.centre
        x, y = view.map_to_paper(centre[view.direction.across], centre[view.direction.up])
        places.append((number, (x, y)))
    by_height = sorted(places, key=lambda place: place[1][1])
    half = len(by_height) // 2
    _, (_, lowest) = by_height[0]
    top = view.map_to_paper(0.0, view.extent.high[view.direction.up])[1] + _ROW_OFFSET
    middle = lowest - _ROW_OFFSET
    for row, y in ((by_height[:half], middle), (by_height[half:], top)):
        in_order = sorted(row, key=lambda place: place[1][0])
        for index, (number, place) in enumerate(in_order):
            balloon = (_ASSEMBLY_LEFT + _ROW_SPACING * index, y)
            paper.draw_line(balloon, place, Layer.DIMENSION)
            paper.draw_circle(place, _DOT, Layer.DIMENSION)
            side = 1.0 if y > place[1] else -1.0
            text_place = (balloon[0], y + side * _ROW_TEXT)
            paper.write_text(text_place, str(number), 2.0, Alignment.MIDDLE_CENTER)


def _needs_left_view(component: Component) -> bool:
    """Tell whether the view from the left shows what front and top do not."""
    along_x = any(cylinder.axis == "x" for cylinder in (*component.rods, *component.bores))
    return along_x or len(component.boxes) > 1


def _lay_out_views(
    extent: Box, has_left_view: bool, left_mm: float, foot_mm: float, room_mm: Point
) -> list[_PlacedView]:
    """Place front view, top view below it and left view to the right of it, in a room [mm]."""
    length, width, height = (MILLIMETRES_PER_METRE * size for size in extent.sizes)
    room_x, room_y = room_mm
    across = length
    free_x = room_x
    if has_left_view:
        across += width
        free_x -= _GAP
    scale = choose_standard_scale(min(free_x / across, (room_y - _GAP) / (width + height)))
    front_corner = (left_mm, foot_mm + width * scale + _GAP)
    views = [
        _PlacedView(_FRONT, front_corner, scale, extent),
        _PlacedView(_TOP, (left_mm, foot_mm), scale, extent),
    ]
    if has_left_view:
        corner = (left_mm + length * scale + _GAP, front_corner[1])
        views.append(_PlacedView(_FROM_LEFT, corner, scale, extent))
    return views


def _find_common_extent(components: Sequence[Component]) -> Box:
    """Find the box around several components."""
    return enclose_boxes([component.bounding_box for component in components])


def _draw_component(paper: Paper, view: _PlacedView, component: Component) -> None:
    """Draw boxes, rods and bores of a component; what is covered is drawn hidden."""
    for box in component.boxes:
        _draw_box(paper, view, box, _choose_outline_layer(view, box, component.boxes))
    for rod in component.rods:
        _draw_cylinder(
            paper, view, rod, _choose_outline_layer(view, rod.bounding_box, component.boxes)
        )
    for bore in component.bores:
        layer = Layer.HIDDEN
        if bore.axis_index == view.direction.out:
            layer = _choose_outline_layer(view, bore.bounding_box, component.boxes)
        _draw_cylinder(paper, view, bore, layer)


def _choose_outline_layer(view: _PlacedView, solid: Box, boxes: Sequence[Box]) -> Layer:
    """Choose how the outline of something is drawn: hidden where one of several boxes covers it."""
    direction = view.direction
    nearest = _compute_nearness_to_eye(solid, direction)
    for box in boxes:
        is_nearer = _compute_nearness_to_eye(box, direction) > nearest + _SAME
        if is_nearer and _covers_in_view(box, solid, direction):
            return Layer.HIDDEN
    return Layer.OUTLINE


def _compute_nearness_to_eye(box: Box, direction: _Direction) -> float:
    """Find how near to the eye a box reaches [m], from the origin."""
    if direction.side > 0.0:
        return box.high[direction.out]
    return -box.low[direction.out]


def _covers_in_view(box: Box, solid: Box, direction: _Direction) -> bool:
    """Tell whether a box covers all of another, seen along a direction."""
    for axis in (direction.across, direction.up):
        if box.low[axis] > solid.low[axis] + _SAME or box.high[axis] < solid.high[axis] - _SAME:
            return False
    return True


def _draw_box(paper: Paper, view: _PlacedView, box: Box, layer: Layer) -> None:
    """Draw the rectangle that a view shows of a box."""
    outline = _project_box_on_paper(view, box)
    paper.draw_rectangle(outline.low, outline.high, layer)


def _draw_cylinder(paper: Paper, view: _PlacedView, cylinder: Cylinder, layer: Layer) -> None:
    """Draw a cylinder as a circle where the view looks along it, else as a rectangle."""
    direction = view.direction
    if cylinder.axis_index != direction.out:
        _draw_box(paper, view, cylinder.inward_box, layer)
        return
    if cylinder.inward is not None:
        paper.draw_polyline(_list_half_circle(view, cylinder), layer)
        return
    circle = _project_circle_on_paper(view, cylinder)
    paper.draw_circle(circle.centre, circle.radius, layer)


def _list_half_circle(view: _PlacedView, cylinder: Cylinder) -> list[Point]:
    """List points of the half of a bore that lies in the part, on the paper."""
    direction = view.direction
    inward = cylinder.inward or (0.0, 0.0, 0.0)
    middle = math.atan2(inward[direction.up], inward[direction.across])
    radius = 0.5 * cylinder.diameter
    points = []
    for number in range(_ARC_STEPS + 1):
        angle = middle + math.pi * (number / _ARC_STEPS - 0.5)
        x = cylinder.start[direction.across] + radius * math.cos(angle)
        y = cylinder.start[direction.up] + radius * math.sin(angle)
        points.append(view.map_to_paper(x, y))
    return points


def _label_cylinders(sheet: Sheet, view: _PlacedView, component: Component) -> None:
    """Write the number of each rod and bore where the view looks along it, on no line."""
    lines = _collect_drawn_lines(view, component)
    for text, cylinder in _yield_labelled_cylinders(component):
        if cylinder.axis_index != view.direction.out:
            continue
        width = compute_text_width(text, _LABEL_HEIGHT)
        place = lines.place_text_beside_circle(
            _project_circle_on_paper(view, cylinder), width, _LABEL_HEIGHT
        )
        sheet.write_text(place, text, _LABEL_HEIGHT, Alignment.MIDDLE_CENTER)


def _collect_drawn_lines(view: _PlacedView, component: Component) -> DrawnLines:
    """Collect what a view shows of a component, which labels must not strike."""
    outline = _project_box_on_paper(view, view.extent)
    low_x, low_y = outline.low
    high_x, high_y = outline.high
    margin = _LABEL_MARGIN
    area = Rectangle((low_x - 1.0, low_y - 1.0), (high_x + margin, high_y + margin))
    left, lower = _find_caption_place(view)
    width = compute_text_width(_format_view_caption(view), _CAPTION_HEIGHT)
    caption = Rectangle((left, lower), (left + width, lower + _CAPTION_HEIGHT))
    lines = DrawnLines(area, texts=[caption])
    lines.outlines = [_project_box_on_paper(view, box) for box in component.boxes]
    for cylinder in (*component.rods, *component.bores):
        if cylinder.axis_index == view.direction.out:
            lines.circles.append(_project_circle_on_paper(view, cylinder))
        else:
            lines.outlines.append(_project_box_on_paper(view, cylinder.inward_box))
    return lines


def _project_box_on_paper(view: _PlacedView, box: Box) -> Rectangle:
    """Return the outline of a box on the paper."""
    direction = view.direction
    first = view.map_to_paper(box.low[direction.across], box.low[direction.up])
    second = view.map_to_paper(box.high[direction.across], box.high[direction.up])
    (first_x, lower), (second_x, upper) = first, second
    return Rectangle((min(first_x, second_x), lower), (max(first_x, second_x), upper))


def _project_circle_on_paper(view: _PlacedView, cylinder: Cylinder) -> Circle:
    """Return the circle of a cylinder that a view looks along."""
    direction = view.direction
    centre = view.map_to_paper(cylinder.start[direction.across], cylinder.start[direction.up])
    return Circle(centre, view.scale_length(0.5 * cylinder.diameter))


def _yield_labelled_cylinders(component: Component) -> Iterator[tuple[str, Cylinder]]:
    """Yield rods and bores with what stands at them."""
    for number, rod in enumerate(component.rods, start=1):
        yield f"R{number}", rod
    for number, bore in enumerate(component.bores, start=1):
        yield f"B{number}", bore


def _write_view_caption(paper: Paper, view: _PlacedView) -> None:
    """Write name and scale of a view over it."""
    paper.write_text(_find_caption_place(view), _format_view_caption(view), _CAPTION_HEIGHT)


def _find_caption_place(view: _PlacedView) -> Point:
    """Find where the caption of a view begins."""
    outline = _project_box_on_paper(view, view.extent)
    left, _ = outline.low
    _, upper = outline.high
    return left, upper + _CAPTION_OFFSET


def _format_view_caption(view: _PlacedView) -> str:
    """Format the caption of a view: its name and scale."""
    return f"{view.direction.name} {format_scale(view.scale)}"


def _draw_overall_dimensions(sheet: Sheet, views: Sequence[_PlacedView]) -> None:
    """Draw the sizes over all: length and width at the top view, height at the front view."""
    front, top = views[0], views[1]
    low, high = top.extent.low, top.extent.high
    corner = top.map_to_paper(low[_X], low[_Y])
    if "length" in sheet.listed:
        end = top.map_to_paper(high[_X], low[_Y])
        through = (corner[0], corner[1] - _DIMENSION_OFFSET)
        sheet.draw_dimension("length", corner, end, through, top.scale)
    through_left = (corner[0] - _DIMENSION_OFFSET, corner[1])
    if "width" in sheet.listed:
        end = top.map_to_paper(low[_X], high[_Y])
        sheet.draw_dimension("width", corner, end, through_left, top.scale, upright=True)
    if "height" in sheet.listed:
        start = front.map_to_paper(low[_X], low[_Z])
        end = front.map_to_paper(low[_X], high[_Z])
        sheet.draw_dimension("height", start, end, through_left, front.scale, upright=True)
