"""Free places for short texts on a view of upright rectangles and circles [mm]."""

import math
from dataclasses import dataclass, field

from stepblocks.workshop.paper import Point

_CLEARANCES = (0.4, 1.0, 2.0, 3.5, 5.0, 7.0, 9.0, 12.0, 15.0, 20.0)  # tried in this order
_DIRECTIONS = 16  # tried at each clearance
_MARGIN = 0.3  # kept about a text


@dataclass(frozen=True)
class Rectangle:
    """An upright rectangle, by its lower left and upper right corner."""

    low: Point
    high: Point

    def add_margin(self, margin: float) -> "Rectangle":
        """Return it with a margin on every side."""
        (left, lower), (right, upper) = self.low, self.high
        return Rectangle((left - margin, lower - margin), (right + margin, upper + margin))

    def overlaps(self, area: "Rectangle") -> bool:
        """Tell whether two areas share a point."""
        for axis in range(2):
            if self.high[axis] < area.low[axis] or area.high[axis] < self.low[axis]:
                return False
        return True

    def contains(self, area: "Rectangle") -> bool:
        """Tell whether another area lies within it, off its outline."""
        for axis in range(2):
            if area.low[axis] <= self.low[axis] or area.high[axis] >= self.high[axis]:
                return False
        return True


@dataclass(frozen=True)
class Circle:
    """A circle by its centre and radius."""

    centre: Point
    radius: float

    def crosses(self, area: Rectangle) -> bool:
        """Tell whether the line of the circle crosses an area."""
        x, y = self.centre
        (left, lower), (right, upper) = area.low, area.high
        nearest = math.hypot(max(left - x, 0.0, x - right), max(lower - y, 0.0, y - upper))
        farthest = math.hypot(max(x - left, right - x), max(y - lower, upper - y))
        return nearest <= self.radius <= farthest


@dataclass
class DrawnLines:
    """What is drawn of a view so far, and the area in which its texts may stand."""

    area: Rectangle
    outlines: list[Rectangle] = field(default_factory=list)
    circles: list[Circle] = field(default_factory=list)
    texts: list[Rectangle] = field(default_factory=list)

    def is_free_for_text(self, text_area: Rectangle) -> bool:
        """Tell whether a text would strike nothing."""
        wide = text_area.add_margin(_MARGIN)
        if not self.area.contains(wide):
            return False
        if any(known.overlaps(wide) for known in self.texts):
            return False
        if any(circle.crosses(wide) for circle in self.circles):
            return False
        return not any(_is_crossed_by_outline(wide, outline) for outline in self.outlines)

    def place_text_beside_circle(self, circle: Circle, width: float, height: float) -> Point:
        """Place a text beside a circle where it crosses nothing, as near as it can be.

        Returns the middle of the text; on the circle where there is no room at all.
        """
        x, y = circle.centre
        for clearance in _CLEARANCES:
            for number in range(_DIRECTIONS):
                angle = math.tau * number / _DIRECTIONS
                reach = circle.radius + clearance
                middle_x = x + math.cos(angle) * (reach + 0.5 * width)
                middle_y = y + math.sin(angle) * (reach + 0.5 * height)
                text = _make_centred_text_area(middle_x, middle_y, width, height)
                if self.is_free_for_text(text):
                    self.texts.append(text)
                    return middle_x, middle_y
        return circle.centre


def _is_crossed_by_outline(text_area: Rectangle, outline: Rectangle) -> bool:
    """Tell whether the outline of a rectangle goes through a text."""
    return outline.overlaps(text_area) and not outline.contains(text_area)


def _make_centred_text_area(x: float, y: float, width: float, height: float) -> Rectangle:
    """Return the area of a text about its middle."""
    low = (x - 0.5 * width, y - 0.5 * height)
    return Rectangle(low, (x + 0.5 * width, y + 0.5 * height))
