"""Where the line, the text and the balloon of a linear dimension lie on the paper [mm]."""

from dataclasses import dataclass

from stepblocks.workshop.paper import Point

_ARROWS = 10.0  # room for both arrows beside a text between them
_STACKED_ROOM = 3.0  # for the balloon beside deviations that stand one over the other, besides
_ARROW_ROOM = 3.0  # from an end of the line to a text beside it
_BALLOON_ROOM = 6.0  # from a text before the line to its start, where the balloon stands
_TEXT_OFFSET = 2.2  # of the middle of a text from its line, as ISO 129-1 writes it
_STACKED_OFFSET = 4.4  # the same of unequal deviations, which stand one over the other


@dataclass(frozen=True)
class DimensionLine:
    """The line of a dimension; `along` runs on it, `towards_text` away from it.

    Attributes
    ----------
    start, end : float
        Coordinates of its ends on the paper, ascending.
    level : float
        Its coordinate square to itself.
    upright : bool
        Whether it runs up the paper, its text to the left of it, or level, its text over it.
    """

    start: float
    end: float
    level: float
    upright: bool

    @classmethod
    def between_points(
        cls, first: Point, second: Point, through: Point, upright: bool
    ) -> "DimensionLine":
        """Make the line of the distance between two points, through a third."""
        axis = 1 if upright else 0
        start, end = sorted((first[axis], second[axis]))
        return cls(start, end, through[1 - axis], upright)

    def compute_point(self, coordinate: float) -> Point:
        """Return the point at a coordinate along the line, also beyond its ends."""
        if self.upright:
            return self.level, coordinate
        return coordinate, self.level

    def shift_point(self, point: Point, along: float, towards_text: float) -> Point:
        """Shift a point along the line, and square to it towards the side of the text."""
        x, y = point
        if self.upright:
            return x - towards_text, y + along
        return x + along, y + towards_text

    def has_room_for_text(self, text_width: float, text_share: float, *, stacked: bool) -> bool:
        """Tell whether a text fits between the arrows, its middle at a share of the length.

        The balloon of unequal deviations, which are `stacked`, stands further out.
        """
        shorter_share = min(text_share, 1.0 - text_share)
        arrows = _ARROWS + _STACKED_ROOM if stacked else _ARROWS
        needed = max(text_width + arrows, 0.5 * text_width / shorter_share)
        return self.end - self.start >= needed


@dataclass(frozen=True)
class DimensionLayout:
    """Where text and balloon of a dimension stand."""

    text: Point  # middle of the text
    balloon: Point
    # line under a text that stands beside the arrows (ISO 129-1), from the end of the dimension
    extension: tuple[Point, Point] | None = None


def lay_out_text_inside(
    line: DimensionLine, text_width: float, text_share: float, *, stacked: bool
) -> DimensionLayout:
    """Lay the text between the arrows, its middle at a share of the length of the line.

    Unequal deviations are `stacked`.
    """
    middle = line.compute_point(line.start + text_share * (line.end - line.start))
    offset, beyond = _TEXT_OFFSET, 2.2
    if stacked:
        offset, beyond = _STACKED_OFFSET, 3.7
    balloon = line.shift_point(middle, 0.5 * text_width + beyond, 4.6)
    return DimensionLayout(line.shift_point(middle, 0.0, offset), balloon)


def lay_out_text_beside(
    line: DimensionLine, text_width: float, *, stacked: bool, before: bool, clearance: float
) -> DimensionLayout:
    """Lay the text beside the arrows: before the start of the line, or beyond its end.

    Unequal deviations are `stacked`; `clearance` is kept beyond the end.
    """
    reach = 0.5 * text_width + _ARROW_ROOM
    if before:
        middle = line.start - reach - _BALLOON_ROOM
        far = middle - 0.5 * text_width
    else:
        middle = line.end + reach + clearance
        far = middle + 0.5 * text_width
    offset = _STACKED_OFFSET if stacked else _TEXT_OFFSET
    text = line.shift_point(line.compute_point(middle), 0.0, offset)
    balloon = line.shift_point(text, reach, 0.8)
    return DimensionLayout(text, balloon, (line.compute_point(line.end), line.compute_point(far)))
