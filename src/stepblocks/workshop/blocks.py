"""Views of bench blocks, with enlarged details of step, groove and margin."""

import math
from dataclasses import dataclass

from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import MetrologyFeature, StepBlock
from stepblocks.parts.relief import Relief
from stepblocks.parts.second_step import SECOND, SecondStep
from stepblocks.workshop.body_views import TOP_VIEW, BodyOnPaper, draw_body_views
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Layer,
    PaperX,
    Point,
    View,
    choose_standard_scale,
    format_scale,
)
from stepblocks.workshop.sheet import Sheet, UnwrittenNotes

_DETAIL: Point = (235.0, 214.0)  # origin of detail D on the paper
_GROOVE_DETAIL: Point = (352.0, 214.0)  # of detail E
_RELIEF_DETAIL: Point = (74.0, 46.0)  # of detail F
_RELIEF_ROOM = (24.0, 12.0)  # of a relief in its detail, at most
_RELIEF_IN_STEP = (7.0, 4.0)  # of the relief where it is shown to no scale
_SECOND_DETAIL: Point = (346.0, 214.0)  # of detail E of a block with two steps
_MARGIN_DETAIL: Point = (280.0, 214.0)
_DETAIL_HEIGHT = 44.0  # of a step in its detail, at most
# by which a caption stands left of its detail, below whose right half a hole is shown
_CLEAR_OF_HOLE = 12.0
_EDGE_LENGTH = 10.0  # of the edge radius in the detail, at most
_SMALLEST_EDGE = 0.1  # edge radius that chooses the scale of the detail, at least [mm of the part]
_GROOVE_LENGTH = 30.0
_MARGIN_LENGTH = 36.0
_DEEPEST_GAP = 46.0  # of a gap in its detail; a deeper one is broken off
_ARC_STEPS = 20
_ROOTS_OF_BOTH_STEPS = "Roots: fillet or undercut up to the height of the step."


def draw_step_block_views(sheet: Sheet, block: StepBlock) -> UnwrittenNotes:
    """Draw all views of a step block; return the notes to be written."""
    sizes = draw_body_views(sheet, block.body, block.id)
    x, y = TOP_VIEW
    half_width = sizes.half_width
    sheet.draw_line((x, y - half_width), (x, y + half_width))
    sheet.draw_leader(
        (x, y - 0.75 * half_width),
        (x + sizes.half_length + 10.0, y - 17.0),
        "working edge, detail D",
    )
    first, *further = _list_felt_edge_details(block)
    _draw_step_detail(sheet, first)
    second = block.second_step
    if second is not None:
        _draw_second_edge_from_above(sheet, second, sizes)
        for edge in further:
            _draw_step_detail(sheet, edge)
    relief = block.relief
    if relief is not None:
        relief_x = x - sizes.scale_length(relief.width.nominal)
        sheet.draw_line((relief_x, y - half_width), (relief_x, y + half_width))
        _draw_relief_detail(sheet, relief)
    step = "Step (1)"
    if second is not None:
        step = f"Steps (1, {sheet.listed['second_step_height'].number})"
    lines = [
        f"{step}: distance of two parallel planes fitted to both faces, flanks excluded;",
        "no size between two points (ISO 14405-2). Stylus of 2 µm or less, or interferometer.",
    ]
    feature = block.metrology
    if feature is not None:
        _draw_feature_from_above(sheet, feature, sizes)
        _draw_feature_detail(sheet, block, feature)
        number = sheet.listed[feature.depth_key].number
        measured = f"{feature.kind.capitalize()} ({number}): ISO 5436-1 type A1."
        lines.append(f"{measured} {_describe_sharp_edges(block)}")
        lines.append(_describe_inner_corners(relief))
    elif second is not None:
        lines.append(f"{_describe_sharp_edges(block)} {_ROOTS_OF_BOTH_STEPS}")
    else:
        lines.append(_describe_sharp_edges(block))
        lines.append(_describe_inner_corners(relief))
    lines.append("Every part is accepted by ISO 14253-1, Ra by its largest value (ISO 21920-3).")
    return lines


def _describe_inner_corners(relief: Relief | None) -> str:
    """Describe what is allowed in the corner under the riser, or in the corners of a relief."""
    if relief is None:
        return "Root of the riser: fillet or undercut up to the height of the step is allowed."
    return "Inner corners of the relief (F): fillet up to half its depth is allowed."


def draw_margin_block_views(sheet: Sheet, margin: MarginBlock) -> UnwrittenNotes:
    """Draw all views of a margin block; return the notes to be written."""
    sizes = draw_body_views(sheet, margin.body, margin.id)
    x, y = TOP_VIEW
    half_width = sizes.half_width
    crown_x = x + sizes.scale_length(margin.marginal_gap.nominal)
    for line_x in (x, crown_x):
        sheet.draw_line((line_x, y - half_width), (line_x, y + half_width))
    sheet.draw_leader(
        (x, y + 0.3 * half_width),
        (x + sizes.half_length + 20.0, y + 0.4 * half_width),
        "margin, detail D",
    )
    _draw_margin_detail(sheet, margin)
    return ["Edges of the margin and letters: do not break them."]


def _describe_sharp_edges(block: StepBlock) -> str:
    """Say which edges the edge break leaves alone."""
    kept = ["working edge"]
    if block.second_step is not None:
        kept = ["both working edges"]
    if block.metrology is not None:
        kept.append(block.metrology.kind)
    if block.body.engraving is not None:
        kept.append("letters")
    return f"Not broken: {', '.join(kept)}."


def _draw_feature_from_above(sheet: Sheet, feature: MetrologyFeature, sizes: BodyOnPaper) -> None:
    """Draw groove or ridge in the view from above, with distance and length."""
    x, y = TOP_VIEW
    upper = y + sizes.half_width
    side = 1.0 if feature.kind == "groove" else -1.0
    near = side * sizes.scale_length(feature.distance.nominal)
    far = near + side * sizes.scale_length(feature.width.nominal)
    low = sizes.half_width - sizes.scale_length(feature.lane.nominal)
    sheet.draw_rectangle((x + near, y + low), (x + far, upper))
    distance_key = f"{feature.kind}_distance"
    if distance_key in sheet.listed:
        start, end = sorted([(x, upper), (x + near, upper)])
        sheet.draw_dimension(distance_key, start, end, (x, upper + 8.0), sizes.scale)
    # beyond the text of the distance, which stands beside its arrows
    right = x + max(sizes.half_length + 14.0, near + 38.0, 38.0)
    sheet.draw_dimension(
        f"{feature.kind}_length",
        (x + far, y + low),
        (x + far, upper),
        (right, y),
        sizes.scale,
        upright=True,
    )
    tip = (x + far, y + low + 2.0)
    sheet.draw_leader(tip, (right + 6.0, y + low + 6.0), f"{feature.kind}, detail E")


def _write_detail_caption(sheet: Sheet, bottom_centre: Point, caption: str) -> None:
    """Write the caption of a detail, its bottom centre at a point of the paper [mm]."""
    sheet.write_text(bottom_centre, caption, alignment=Alignment.BOTTOM_CENTER)


@dataclass(frozen=True)
class _EdgeDetail:
    """The enlarged view of an edge of a block: where it stands, and what it shows."""

    block: StepBlock  # that has this edge alone
    origin: Point  # of the root of its riser on the paper
    letter: str  # of its detail
    left: float  # reach of the detail from the riser [mm]
    right: float
    prefix: str = ""  # of the keys of its characteristics
    falls: bool = False  # whether the face behind it is the lower one
    face_count: int = 2  # faces of which its roughness is asked; 0 where another detail states it

    @property
    def radius_text_level(self) -> float:
        """Where its radius stands, from the upper face [mm]; above it where the edge falls."""
        return 10.0 if self.falls else -8.0

    @property
    def state_symbol_level(self) -> float:
        """Where the state of the edge stands, from the upper face [mm]."""
        return 2.0 if self.falls else -16.0


def _list_felt_edge_details(block: StepBlock) -> list[_EdgeDetail]:
    """List the enlarged views of the edges that are felt, that of the working edge first."""
    first_edge, *further = block.list_felt_edges()
    second = block.second_step
    if second is None:
        return [_EdgeDetail(first_edge, _DETAIL, "D", 42.0, 62.0)]
    drawn = [_EdgeDetail(first_edge, _DETAIL, "D", 42.0, 56.0, face_count=3)]
    for edge in further:
        falls = second.direction == "down"
        drawn.append(
            _EdgeDetail(edge, _SECOND_DETAIL, "E", 28.0, 60.0, SECOND, falls, face_count=0)
        )
    return drawn


def _draw_second_edge_from_above(sheet: Sheet, second: SecondStep, sizes: BodyOnPaper) -> None:
    """Draw the second edge in the view from above, with its distance from the first."""
    x, y = TOP_VIEW
    upper = y + sizes.half_width
    edge_x = x + sizes.scale_length(second.distance.nominal)
    sheet.draw_line((edge_x, y - sizes.half_width), (edge_x, upper))
    if "second_step_distance" in sheet.listed:
        sheet.draw_dimension(
            "second_step_distance", (x, upper), (edge_x, upper), (x, upper + 8.0), sizes.scale
        )
    sheet.draw_leader(
        (edge_x, y + 0.6 * sizes.half_width),
        (x + sizes.half_length + 10.0, y + 0.6 * sizes.half_width + 6.0),
        f"second edge ({second.direction}), detail E",
    )


@dataclass(frozen=True)
class _StepOnPaper:
    """The step of an edge, enlarged on the paper [mm]."""

    view: View
    top: float  # y of the upper face
    outline: list[Point]  # from the lower face over the rounding to the upper face

    @property
    def edge_middle(self) -> Point:
        """The point of the rounding that its leaders lead to."""
        return self.outline[len(self.outline) // 2]

    @classmethod
    def from_edge(cls, edge: _EdgeDetail) -> "_StepOnPaper":
        """Choose the scales of lengths and heights, and place step and rounding."""
        height = edge.block.height.nominal
        radius = edge.block.edge_radius.nominal
        view = View(
            edge.origin,
            choose_standard_scale(
                _EDGE_LENGTH / max(radius * MILLIMETRES_PER_METRE, _SMALLEST_EDGE)
            ),
            choose_standard_scale(_DETAIL_HEIGHT / (height * MILLIMETRES_PER_METRE)),
        )
        _, top = view.map_to_paper(0.0, height)
        turns = [0.5 * math.pi]
        if radius > 0.0:
            turns = [index * math.pi / (2.0 * _ARC_STEPS) for index in range(_ARC_STEPS + 1)]
        side = -1.0 if edge.falls else 1.0
        outline = []
        for turn in turns:
            x = radius - radius * math.cos(turn)
            z = height - radius + radius * math.sin(turn)
            outline.append(view.map_to_paper(side * x, z))
        return cls(view, top, outline)


def _draw_step_detail(sheet: Sheet, edge: _EdgeDetail) -> None:
    """Draw the detail of an edge, heights exaggerated, with all that is asked of it."""
    step = _StepOnPaper.from_edge(edge)
    x, lower = edge.origin
    top = step.top
    _draw_step_outline(sheet, edge, step)
    length_scale = step.view.scale
    height_scale = step.view.height_scale or length_scale
    low, high = (x - 24.0, lower), (x, top)
    if edge.falls:
        low, high = (x, lower), (x - 24.0, top)
    sheet.draw_dimension(
        f"{edge.prefix}step_height", low, high, (x - 14.0, lower), height_scale, upright=True
    )
    elbow = (x + 10.0, top + edge.radius_text_level)
    sheet.draw_characteristic_leader(f"{edge.prefix}edge_radius", step.edge_middle, elbow, "R {}")
    _draw_edge_states(sheet, edge, step)
    if f"{edge.prefix}riser_angle" in sheet.listed:
        _draw_riser_angle_and_straightness(sheet, edge, top)
    if edge.prefix:
        _draw_demands_behind_second_edge(sheet, edge, top)
    else:
        _draw_face_demands(sheet, top, edge.face_count)
    caption = f"{edge.letter}   {_format_detail_scales(sheet, length_scale, height_scale)}"
    if edge.prefix:  # a section of a hole stands below its right half
        _write_detail_caption(sheet, (x - _CLEAR_OF_HOLE, lower - 33.0), caption)
        return
    if not sheet.letters:
        caption += f" (heights exaggerated {height_scale / length_scale:g} times)"
    _write_detail_caption(sheet, (x, lower - 33.0), caption)


def _draw_step_outline(sheet: Sheet, edge: _EdgeDetail, step: _StepOnPaper) -> None:
    """Draw lower face, riser and upper face between two breaks, and a relief to no scale."""
    x, lower = edge.origin
    top = step.top
    left = x - edge.left
    right = x + edge.right
    root = [(x, lower)]
    if edge.block.relief is not None:
        wide, deep = _RELIEF_IN_STEP
        root = [(x - wide, lower), (x - wide, lower - deep), (x, lower - deep)]
        sheet.draw_leader((x, lower - deep), (x + 10.0, lower - 9.0), "relief, detail F")
    left_level, right_level = lower, top
    if edge.falls:
        left_level, right_level = top, lower
        outline = [(left, top), *reversed(step.outline), *root, (right, lower)]
    else:
        outline = [(left, lower), *root, *step.outline, (right, top)]
    sheet.draw_polyline(outline)
    sheet.draw_break_line(left, lower - 8.0, left_level)
    sheet.draw_break_line(right, lower - 8.0, right_level)


def _format_detail_scales(sheet: Sheet, length_scale: float, height_scale: float) -> str:
    """Write the scales of a detail; the heights of a series are drawn to none."""
    lengths = f"lengths {format_scale(length_scale)}"
    if sheet.letters:
        return f"{lengths}, heights H not to scale"
    return f"{lengths}, heights {format_scale(height_scale)}"


def _draw_edge_states(sheet: Sheet, edge: _EdgeDetail, step: _StepOnPaper) -> None:
    """Draw the states of both edges (ISO 13715).

    The outer edge is free of burr; a root without a relief may have a fillet or an undercut.
    """
    x, lower = edge.origin
    least_radius, largest_radius = edge.block.edge_radius.limits
    state = f"-{sheet.format_largest(largest_radius)}"
    if least_radius > 0.0:
        least = sheet.format_least(least_radius)
        state = f"-{least}/-{sheet.format_largest(largest_radius)}"
    corner = (x + 10.0, step.top + edge.state_symbol_level)
    sheet.draw_edge_state(step.edge_middle, corner, state)
    if edge.block.relief is not None:
        return
    root_state = f"±{sheet.format_largest(edge.block.height.nominal)}"
    if "step_height" in sheet.letters:
        root_state = "±H"
    sheet.draw_edge_state((x, lower), (x + 10.0, lower - 7.0), root_state)


def _draw_riser_angle_and_straightness(
    sheet: Sheet, edge: _EdgeDetail, upper_face_y: float
) -> None:
    """Draw angle and straightness of the riser."""
    x, lower = edge.origin
    middle = lower + 0.35 * (upper_face_y - lower)
    level = max(lower + 0.6, min(middle - 4.0, upper_face_y - 21.0))
    if edge.falls:  # over the lower face
        level = max(lower + 2.5, middle - 4.0)
    angle_key = f"{edge.prefix}riser_angle"
    reference = "{} to the faces" if edge.prefix else "{} to A"
    sheet.draw_characteristic_leader(angle_key, (x, middle), (x + 10.0, level), reference)
    # its arrow stands on the riser, drawn on over the faces (ISO 1101)
    sheet.draw_line((x, upper_face_y + 1.0), (x, upper_face_y + 25.0), Layer.DIMENSION)
    frame = (x + 8.0, upper_face_y + 21.0)
    start = sheet.draw_tolerance_frame(f"{edge.prefix}riser_straightness", frame)
    _, frame_level = start
    sheet.draw_pointer(start, (x, frame_level))


def _draw_face_demands(sheet: Sheet, upper_face_y: float, face_count: int) -> None:
    """Draw datum A, flatness, parallelism and roughness of the working faces."""
    x, lower = _DETAIL
    sheet.draw_datum((x - 32.0, lower), "A")
    frame = sheet.draw_tolerance_frame("flatness_lower", (x - 16.0, lower - 20.0))
    sheet.draw_pointer_to_face((x - 21.0, lower), frame)
    sheet.draw_tolerance_frame("parallelism_base", (x - 16.0, lower - 26.0), "B")
    frame = sheet.draw_tolerance_frame("flatness_upper", (x + 8.0, upper_face_y + 7.0))
    sheet.draw_pointer_to_face((x + 4.0, upper_face_y), frame)
    sheet.draw_tolerance_frame("parallelism", (x + 8.0, upper_face_y + 13.0), "A")
    sheet.draw_surface_texture((x + 46.0, upper_face_y), "roughness", f" ({face_count} x)")


def _draw_demands_behind_second_edge(sheet: Sheet, edge: _EdgeDetail, upper_face_y: float) -> None:
    """Draw flatness and parallelism of the face behind a second edge."""
    x, lower = edge.origin
    flatness = f"{edge.prefix}flatness_upper"
    parallelism = f"{edge.prefix}parallelism"
    if not edge.falls:
        frame = sheet.draw_tolerance_frame(flatness, (x + 8.0, upper_face_y + 7.0))
        sheet.draw_pointer_to_face((x + 4.0, upper_face_y), frame)
        sheet.draw_tolerance_frame(parallelism, (x + 8.0, upper_face_y + 13.0), "A")
        return
    # right of the state of the root
    frame = sheet.draw_tolerance_frame(flatness, (x + 12.0, lower - 20.0))
    sheet.draw_pointer_to_face((x + 8.0, lower), frame)
    sheet.draw_tolerance_frame(parallelism, (x + 12.0, lower - 26.0), "A")


def _draw_feature_detail(sheet: Sheet, block: StepBlock, feature: MetrologyFeature) -> None:
    """Draw detail E: groove or ridge in section, heights exaggerated."""
    x, low = _GROOVE_DETAIL
    height = block.height.nominal
    width = feature.width.nominal
    height_scale = choose_standard_scale(_DETAIL_HEIGHT / (height * MILLIMETRES_PER_METRE))
    length_scale = choose_standard_scale(_GROOVE_LENGTH / (width * MILLIMETRES_PER_METRE))
    top = low + height * MILLIMETRES_PER_METRE * height_scale
    half = 0.5 * width * MILLIMETRES_PER_METRE * length_scale
    if feature.kind == "groove":
        outside, inside = top, low
        # the text of a narrow width stands on the right, so the depth stands on the left
        depth_start = x
    else:
        outside, inside = low, top
        depth_start = x - 30.0
    outline = [
        (x - 40.0, outside),
        (x - half, outside),
        (x - half, inside),
        (x + half, inside),
        (x + half, outside),
        (x + 40.0, outside),
    ]
    sheet.draw_polyline(outline)
    for break_x in (x - 40.0, x + 40.0):
        sheet.draw_break_line(break_x, low - 8.0, outside)
    sheet.draw_dimension(
        feature.depth_key,
        (depth_start, low),
        (x - half, top),
        (x - half - 9.0, low),
        height_scale,
        upright=True,
    )
    sheet.draw_dimension(
        f"{feature.kind}_width", (x - half, top), (x + half, top), (x, top + 8.0), length_scale
    )
    caption = f"E   {_format_detail_scales(sheet, length_scale, height_scale)}"
    _write_detail_caption(sheet, (x - _CLEAR_OF_HOLE, low - 33.0), caption)


def _draw_relief_detail(sheet: Sheet, relief: Relief) -> None:
    """Draw detail F: the relief between lower face and riser, to one scale."""
    x, lower = _RELIEF_DETAIL
    wide, deep = _RELIEF_ROOM
    width = relief.width.nominal * MILLIMETRES_PER_METRE
    depth = relief.depth.nominal * MILLIMETRES_PER_METRE
    scale = choose_standard_scale(min(wide / width, deep / depth))
    wall = x - width * scale
    floor = lower - depth * scale
    left = wall - 16.0
    up = lower + 12.0
    sheet.draw_polyline([(left, lower), (wall, lower), (wall, floor), (x, floor), (x, up)])
    sheet.draw_break_line(left, floor - 4.0, lower)
    sheet.draw_break_line(x + 12.0, floor - 4.0, up)
    sheet.draw_line((x, up), (x + 12.0, up))
    sheet.draw_dimension("relief_width", (wall, floor), (x, floor), (x, floor - 9.0), scale)
    sheet.draw_dimension(
        "relief_depth", (wall, floor), (wall, lower), (wall - 9.0, floor), scale, upright=True
    )
    _write_detail_caption(sheet, (x - 6.0, floor - 18.0), f"F   {format_scale(scale)}")


@dataclass(frozen=True)
class _MarginOnPaper:
    """The margin of a block, enlarged on the paper [mm]."""

    view: View
    wall: float  # x of the crown's wall
    level: float  # y of the crown's upper face
    floor: float  # y of the floor of the gap, or of the break above it
    is_broken: bool  # whether the gap is deeper than shown
    corner: list[Point]  # of the crown

    @property
    def upper_face_y(self) -> float:
        """Coordinate y of the higher of both faces on the paper [mm]."""
        _, tooth = self.view.origin
        return max(tooth, self.level)

    @classmethod
    def from_margin(cls, margin: MarginBlock) -> "_MarginOnPaper":
        """Choose the scale, and place crown, gap and floor."""
        gap = margin.marginal_gap.nominal
        rise = margin.horizontal_discrepancy.nominal
        depth = margin.gap_depth.nominal
        largest = max(gap, abs(rise), abs(margin.opening.nominal))
        scale = choose_standard_scale(_MARGIN_LENGTH / (largest * MILLIMETRES_PER_METRE))
        view = View(_MARGIN_DETAIL, scale)
        _, tooth = view.origin
        wall, level = view.map_to_paper(gap, rise)
        depth_on_paper = depth * MILLIMETRES_PER_METRE * scale
        floor = tooth + max(-depth_on_paper, -_DEEPEST_GAP)
        corner = view.map_line_to_paper(margin.corner)
        return cls(view, wall, level, floor, tooth - depth_on_paper < floor, corner)


def _draw_margin_detail(sheet: Sheet, margin: MarginBlock) -> None:
    """Draw detail D: tooth, gap and crown in section, with all that is asked of them."""
    detail = _MarginOnPaper.from_margin(margin)
    x, tooth = detail.view.origin
    scale = detail.view.scale
    _draw_margin_outline(sheet, detail)
    sheet.draw_dimension(
        "marginal_gap",
        (x, detail.floor + 8.0),
        (detail.wall, detail.floor + 8.0),
        (x, detail.floor - 12.0),
        scale,
    )
    if sheet.listed["horizontal_discrepancy"].characteristic.nominal > 0.0:
        sheet.draw_dimension(
            "horizontal_discrepancy",
            (x - 30.0, tooth),
            (x + 62.0, detail.level),
            (x - 40.0, tooth),
            scale,
            upright=True,
        )
    beyond = _draw_vertical_discrepancy(sheet, margin, detail)
    _draw_margin_demands(sheet, detail, beyond)
    gap_middle = x + 0.4 * margin.marginal_gap.nominal * MILLIMETRES_PER_METRE * scale
    sheet.draw_characteristic_leader(
        "gap_depth",
        (gap_middle, detail.floor + 2.0),
        (x - 24.0, detail.floor + 8.0),
        "depth {}",
    )
    _write_detail_caption(sheet, (x - 50.0, detail.floor - 8.0), f"D   {format_scale(scale)}")


def _draw_margin_outline(sheet: Sheet, detail: _MarginOnPaper) -> None:
    """Draw tooth and crown on either side of the gap, and its floor or the break over it."""
    x, tooth = detail.view.origin
    floor = detail.floor
    sheet.draw_polyline([(x - 60.0, tooth), (x, tooth), (x, floor)])
    end_x, end_y = detail.corner[-1]
    upper_start = (max(end_x, x), end_y)
    crown = [(detail.wall, floor), *detail.corner, upper_start, (x + 75.0, detail.level)]
    sheet.draw_polyline(crown)
    if detail.is_broken:
        sheet.draw_break_line(x, floor - 6.0, floor)
        sheet.draw_break_line(detail.wall, floor - 6.0, floor)
    else:
        sheet.draw_line((x, floor), (detail.wall, floor))


def _draw_vertical_discrepancy(sheet: Sheet, margin: MarginBlock, detail: _MarginOnPaper) -> PaperX:
    """Draw the vertical discrepancy, if a face carries it; return x right of it."""
    x, tooth = detail.view.origin
    listed = sheet.listed.get("vertical_discrepancy")
    if listed is None or listed.characteristic.kind != "distance":
        return max(x + 18.0, detail.wall + 8.0)
    crown = detail.view.map_to_paper(margin.opening.nominal, margin.horizontal_discrepancy.nominal)
    start, end = sorted([(x, tooth), crown])
    through = (x, detail.upper_face_y + 8.0)
    sheet.draw_dimension("vertical_discrepancy", start, end, through, detail.view.scale)
    end_x, _ = end
    return end_x + 42.0  # clear of the text, which stands beside a narrow dimension


def _draw_margin_demands(sheet: Sheet, detail: _MarginOnPaper, crown_frame_x: PaperX) -> None:
    """Draw datum, flatness, parallelism and roughness of both faces of a margin."""
    x, tooth = detail.view.origin
    level = detail.level
    upper = detail.upper_face_y
    sheet.draw_datum((x - 54.0, tooth), "A")
    sheet.draw_tolerance_frame("flatness_lower", (x - 58.0, tooth - 28.0))
    sheet.draw_pointer_to_face((x - 44.0, tooth), (x - 44.0, tooth - 22.0))
    sheet.draw_tolerance_frame("parallelism_base", (x - 58.0, tooth - 34.0), "B")
    frame = sheet.draw_tolerance_frame("flatness_upper", (crown_frame_x + 4.0, upper + 18.0))
    sheet.draw_pointer_to_face((crown_frame_x, level), frame)
    sheet.draw_tolerance_frame("parallelism", (crown_frame_x + 4.0, upper + 24.0), "A")
    sheet.write_text((x - 58.0, tooth + 3.0), "tooth")
    sheet.write_text((x + 60.0, level - 5.0), "crown")
    sheet.draw_surface_texture((max(x + 62.0, crown_frame_x + 3.0), level), "roughness", " (2 x)")
