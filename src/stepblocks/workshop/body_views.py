"""Views of the body of a bench block: from the front and from above."""

from dataclasses import dataclass

from stepblocks.parts.body import Body, Engraving
from stepblocks.parts.lettering import compute_text_width
from stepblocks.workshop.hole_views import draw_holes_from_above
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Layer,
    Point,
    choose_standard_scale,
    format_scale,
    shift_points,
)
from stepblocks.workshop.sheet import Sheet

FRONT_VIEW: Point = (100.0, 240.0)  # middle of the view on the paper
TOP_VIEW: Point = (100.0, 130.0)
_VIEW_LENGTH = 80.0  # of the longest side, at most
_VIEW_HEIGHT = 40.0  # of the thickness, at most
_SMALLEST_LETTERS = 2.5


@dataclass(frozen=True)
class BodyOnPaper:
    """Sizes of a body on the paper [mm], at the scale of its front and top views."""

    scale: float
    half_length: float
    half_width: float
    thickness: float
    edge_break: float

    @classmethod
    def from_body(cls, body: Body, scale: float) -> "BodyOnPaper":
        """Measure a body at a scale."""
        magnification = MILLIMETRES_PER_METRE * scale
        return cls(
            scale,
            body.half_length * magnification,
            body.half_width * magnification,
            body.thickness.nominal * magnification,
            body.edge_break.nominal * magnification,
        )

    def scale_length(self, length: float) -> float:
        """Return a length of the body [m] on the paper."""
        return length * (MILLIMETRES_PER_METRE * self.scale)


def draw_body_views(sheet: Sheet, body: Body, identity: str) -> BodyOnPaper:
    """Draw a body from the front and from above, and its holes; return its sizes on the paper."""
    thickness_as_length = _VIEW_LENGTH / _VIEW_HEIGHT * body.thickness.nominal
    longest = max(body.length.nominal, body.width.nominal, thickness_as_length)
    scale = choose_standard_scale(_VIEW_LENGTH / (MILLIMETRES_PER_METRE * longest))
    sizes = BodyOnPaper.from_body(body, scale)
    _draw_front_view(sheet, body, sizes, identity)
    _draw_top_view(sheet, sizes)
    if body.mounting is not None:
        draw_holes_from_above(sheet, body, body.mounting, TOP_VIEW, scale)
    return sizes


def _draw_front_view(sheet: Sheet, body: Body, sizes: BodyOnPaper, identity: str) -> None:
    """Draw the front with thickness, engraving, edge breaks and the datum of the base."""
    x, middle = FRONT_VIEW
    half = sizes.half_length
    edge_break = sizes.edge_break
    upper = middle + 0.5 * sizes.thickness
    base = upper - sizes.thickness
    left = x - half
    right = x + half
    octagon = _list_octagon_corners((-half, -sizes.thickness), (half, 0.0), edge_break)
    sheet.draw_polyline(shift_points(octagon, (x, upper)), closed=True)
    sheet.draw_dimension(
        "thickness",
        (left + edge_break, base),
        (left + edge_break, upper),
        (left - 12.0, upper),
        sizes.scale,
        upright=True,
    )
    if body.engraving is not None:
        along, up = (sizes.scale_length(offset) for offset in body.engraving.offset)
        letters_middle = (x + along, upper - 0.5 * sizes.thickness + up)
        _draw_engraved_letters(
            sheet, body.engraving, identity, letters_middle, (right, upper), sizes
        )
    sheet.draw_characteristic_leader(
        "edge_break",
        (left + 0.5 * edge_break, upper - 0.5 * edge_break),
        (left + 6.0, upper + 7.0),
        "{} x 45°, outer edges",
    )
    sheet.draw_datum((right - 14.0, base), "B")
    frame = sheet.draw_tolerance_frame("flatness_base", (right + 6.0, base - 12.0))
    sheet.draw_pointer_to_face((right - 5.0, base), frame)
    caption = f"front {format_scale(sizes.scale)}"
    sheet.write_text((right - 19.0, base - 10.0), caption, alignment=Alignment.BOTTOM_RIGHT)


def _draw_engraved_letters(
    sheet: Sheet,
    engraving: Engraving,
    identity: str,
    letters_middle: Point,
    front_corner: Point,
    sizes: BodyOnPaper,
) -> None:
    """Draw the engraved text about a point, and lead its sizes past a corner of the front."""
    text = engraving.choose_text(identity)
    letter_height = max(sizes.scale_length(0.8 * engraving.height.nominal), _SMALLEST_LETTERS)
    sheet.write_text(letters_middle, text, letter_height, Alignment.MIDDLE_CENTER)
    x, y = letters_middle
    end = (x + 0.5 * compute_text_width(text, letter_height) + 1.5, y)
    # below the note of the edges, which stands 7 mm over the body
    elbow_x = front_corner[0] + 12.0
    elbow_y = min(y + 9.0, front_corner[1] + 0.5)
    sheet.draw_characteristic_leader("engraving_height", end, (elbow_x, elbow_y), "letters {} high")
    offset = _format_letters_offset(sheet, engraving)
    if offset:
        sheet.write_text((elbow_x + 4.0, elbow_y - 12.8), offset)
    sheet.draw_characteristic_leader(
        "engraving_depth", end, (elbow_x, elbow_y - 6.0), "engraved {} deep"
    )


def _format_letters_offset(sheet: Sheet, engraving: Engraving) -> str:
    """Format how far the middle of the letters lies from that of the front; empty if not at all."""
    along, up = engraving.offset
    parts = []
    if along != 0.0:
        side = "right" if along > 0.0 else "left"
        parts.append(f"{sheet.format_distance(abs(along))} {side}")
    if up != 0.0:
        side = "over" if up > 0.0 else "under"
        parts.append(f"{sheet.format_distance(abs(up))} {side}")
    if not parts:
        return ""
    return f"middle {', '.join(parts)} that of the front"


def _draw_top_view(sheet: Sheet, sizes: BodyOnPaper) -> None:
    """Draw the view from above with length, width and the place of the edge."""
    x, y = TOP_VIEW
    edge_break = sizes.edge_break
    left = x - sizes.half_length
    right = x + sizes.half_length
    lower = y - sizes.half_width
    upper = y + sizes.half_width
    octagon = _list_octagon_corners(
        (-sizes.half_length, -sizes.half_width), (sizes.half_length, sizes.half_width), edge_break
    )
    sheet.draw_polyline(shift_points(octagon, TOP_VIEW), closed=True)
    sheet.draw_rectangle(
        (left + edge_break, lower + edge_break),
        (right - edge_break, upper - edge_break),
        Layer.DIMENSION,
    )
    sheet.draw_dimension(
        "length",
        (left, lower + edge_break),
        (right, lower + edge_break),
        (x, lower - 28.0),
        sizes.scale,
    )
    sheet.draw_dimension(
        "width",
        (left + edge_break, lower),
        (left + edge_break, upper),
        (left - 12.0, y),
        sizes.scale,
        upright=True,
        text_share=0.78,  # above the middle, where the place of the holes is led out
    )
    if "edge_position" in sheet.listed:
        sheet.draw_dimension(
            "edge_position", (left, upper - edge_break), (x, upper), (x, upper + 16.0), sizes.scale
        )
    caption = f"top {format_scale(sizes.scale)}"
    sheet.write_text((x, lower - 35.0), caption, alignment=Alignment.BOTTOM_CENTER)


def _list_octagon_corners(low: Point, high: Point, edge_break: float) -> list[Point]:
    """List the corners of a rectangle with broken edges, from the left end of its lower side."""
    x0, y0 = low
    x1, y1 = high
    lower = [(x0 + edge_break, y0), (x1 - edge_break, y0)]
    right = [(x1, y0 + edge_break), (x1, y1 - edge_break)]
    upper = [(x1 - edge_break, y1), (x0 + edge_break, y1)]
    left = [(x0, y1 - edge_break), (x0, y0 + edge_break)]
    return lower + right + upper + left
