"""A sheet of paper as a DXF drawing [mm]: layers, lines, circles, hatches, arrows and texts."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import ezdxf
from ezdxf.entities import Text
from ezdxf.enums import TextEntityAlignment

Alignment: TypeAlias = TextEntityAlignment
Point = tuple[float, float]
PaperX: TypeAlias = float  # across the paper, from its left edge [mm]

WIDTH = 420.0  # A3, landscape [mm]
HEIGHT = 297.0
FONT = "DejaVuSans.ttf"  # as the DXF names it
TEXT_HEIGHT = 2.5
ARROW_LENGTH = 2.5
ARROW_HALF_ANGLE = 0.165  # [rad]
MILLIMETRES_PER_METRE = 1e3


class Layer(StrEnum):
    """Layers of the drawing, by what their lines mean."""

    OUTLINE = "OUTLINE"
    HIDDEN = "HIDDEN"
    CENTRE = "CENTRE"
    DIMENSION = "DIMENSION"
    FRAME = "FRAME"
    TEXT = "TEXT"


@dataclass(frozen=True)
class Pen:
    """How the lines of a layer are drawn."""

    colour: int  # of the AutoCAD colour index
    weight: int  # [0.01 mm]
    linetype: str = "Continuous"


_BLACK = 7
_GREY = 8
_PENS = {
    Layer.OUTLINE: Pen(_BLACK, 50),
    Layer.HIDDEN: Pen(_GREY, 25, "DASHED"),
    Layer.CENTRE: Pen(_GREY, 25, "CENTER"),
    Layer.DIMENSION: Pen(_BLACK, 25),
    Layer.FRAME: Pen(_BLACK, 35),
    Layer.TEXT: Pen(_BLACK, 25),
}
_DIMENSION_STYLE = {
    "dimtxsty": "LETTERS",
    "dimdsep": ord(","),  # decimal comma of ISO 129-1
    "dimtxt": TEXT_HEIGHT,
    "dimasz": ARROW_LENGTH,
    "dimexe": 1.2,
    "dimexo": 0.8,
    "dimgap": 0.8,
    "dimclrd": _BLACK,
    "dimclre": _BLACK,
    "dimclrt": _BLACK,
    "dimtad": 1,  # text over the line
    "dimtofl": 1,  # a line between the arrows even where the text stands outside
    "dimzin": 0,
    "dimtzin": 0,
    "dimtih": 0,
    "dimtoh": 0,
}


def choose_standard_scale(largest_scale: float) -> float:
    """Choose the largest scale of ISO 5455 (1, 2 or 5 times a power of ten) up to a limit."""
    decade = 10.0 ** math.floor(math.log10(largest_scale))
    limit = largest_scale * (1.0 + 1e-9)  # a scale that fits exactly is not lost by rounding
    chosen = decade
    for step in (2.0, 5.0):
        if step * decade <= limit:
            chosen = step * decade
    return chosen


def replace_decimal_points_by_commas(text: str) -> str:
    """Write the decimal signs of a text as ISO 129-1 does."""
    return text.replace(".", ",")


def format_scale(scale: float) -> str:
    """Write a scale as ISO 5455 does: 5:1 or 1:2."""
    if scale >= 1.0:
        return f"{scale:g}:1"
    return f"1:{1.0 / scale:g}"


@dataclass(frozen=True)
class View:
    """Origin of a view on the paper and its scale, which may differ for heights."""

    origin: Point
    scale: float
    height_scale: float | None = None  # the scale of lengths where None

    def map_to_paper(self, x: float, z: float) -> Point:
        """Return the place on the paper [mm] of a point of the part [m]."""
        origin_x, origin_z = self.origin
        height_scale = self.height_scale or self.scale
        across = origin_x + x * MILLIMETRES_PER_METRE * self.scale
        up = origin_z + z * MILLIMETRES_PER_METRE * height_scale
        return across, up

    def map_line_to_paper(self, points: Iterable[Point]) -> list[Point]:
        """Return the places on the paper [mm] of the points of a line on the part [m]."""
        return [self.map_to_paper(x, z) for x, z in points]


def shift_points(points: Iterable[Point], offset: Point) -> list[Point]:
    """Return points on the paper, moved by an offset [mm]."""
    across, up = offset
    return [(x + across, y + up) for x, y in points]


class Paper:
    """A blank sheet to draw on.

    Attributes
    ----------
    document : ezdxf.document.Drawing
        The drawing, to be saved or rendered.
    space : ezdxf.layouts.Modelspace
        Its model space, which holds all entities in the order in which they are drawn.
    """

    def __init__(self) -> None:
        self.document = ezdxf.new("R2010", setup=["linetypes"], units=4)
        self.space = self.document.modelspace()
        for layer, pen in _PENS.items():
            self.document.layers.add(
                layer.value, color=pen.colour, lineweight=pen.weight, linetype=pen.linetype
            )
        self.document.header["$LTSCALE"] = 5.0
        self.document.header["$LWDISPLAY"] = 1
        self.document.appids.add("STEPBLOCKS")
        self.document.styles.add("LETTERS", font=FONT)
        self.document.dimstyles.add("PART", dxfattribs=_DIMENSION_STYLE)

    def draw_line(self, start: Point, end: Point, layer: Layer = Layer.OUTLINE) -> None:
        """Draw a line."""
        self.space.add_line(start, end, dxfattribs={"layer": layer.value})

    def draw_polyline(
        self, points: Sequence[Point], layer: Layer = Layer.OUTLINE, closed: bool = False
    ) -> None:
        """Draw a polyline."""
        self.space.add_lwpolyline(points, close=closed, dxfattribs={"layer": layer.value})

    def draw_rectangle(self, corner: Point, opposite: Point, layer: Layer = Layer.OUTLINE) -> None:
        """Draw a rectangle by two opposite corners."""
        x0, y0 = corner
        x1, y1 = opposite
        self.draw_polyline([corner, (x1, y0), opposite, (x0, y1)], layer, closed=True)

    def draw_circle(self, centre: Point, radius: float, layer: Layer = Layer.OUTLINE) -> None:
        """Draw a circle."""
        self.space.add_circle(centre, radius, dxfattribs={"layer": layer.value})

    def draw_hatch(self, points: Sequence[Point], degrees: float = 0.0) -> None:
        """Hatch the cut area within an outline (ISO 128-50).

        The lines lie at 45 degrees, and are turned by further `degrees`.
        """
        area = self.space.add_hatch(dxfattribs={"layer": Layer.DIMENSION.value})
        area.set_pattern_fill("ANSI31", scale=0.8, angle=degrees)
        area.paths.add_polyline_path(points)

    def draw_break_line(self, x: float, low: float, high: float) -> None:
        """Draw a vertical break with a zigzag in its middle."""
        middle = 0.5 * (low + high)
        zigzag = [
            (x, low),
            (x, middle - 2.0),
            (x - 1.2, middle - 0.8),
            (x + 1.2, middle + 0.8),
            (x, middle + 2.0),
            (x, high),
        ]
        self.draw_polyline(zigzag, Layer.DIMENSION)

    def draw_arrow_head(self, tip: Point, tail: Point) -> None:
        """Draw a filled arrow head at `tip`, coming from `tail`."""
        direction = math.atan2(tip[1] - tail[1], tip[0] - tail[0])
        left = _compute_barb_end(tip, direction - ARROW_HALF_ANGLE)
        right = _compute_barb_end(tip, direction + ARROW_HALF_ANGLE)
        self.space.add_solid([tip, left, right, right], dxfattribs={"layer": Layer.DIMENSION.value})

    def draw_pointer(self, *points: Point) -> None:
        """Draw a line through points, with an arrow head at the last."""
        self.draw_polyline(points, Layer.DIMENSION)
        self.draw_arrow_head(points[-1], points[-2])

    def write_text(
        self,
        anchor: Point,
        text: str,
        height: float = TEXT_HEIGHT,
        alignment: Alignment = Alignment.LEFT,
    ) -> Text:
        """Write one line of text, aligned to the point `anchor` [mm]; return its entity."""
        attributes = {"layer": Layer.TEXT.value, "style": "LETTERS"}
        entity = self.space.add_text(text, height=height, dxfattribs=attributes)
        entity.set_placement(anchor, align=alignment)
        return entity

    def write_table(
        self, upper_left: Point, rows: Sequence[Sequence[str]], widths: Sequence[float]
    ) -> None:
        """Draw a table downwards from a corner, its first row the headings."""
        row_height = 6.0
        start, upper = upper_left
        for index, row in enumerate(rows):
            left = start
            top = upper - row_height * index
            for text, width in zip(row, widths, strict=True):
                self.draw_rectangle((left, top - row_height), (left + width, top), Layer.FRAME)
                middle = top - 0.5 * row_height
                self.write_text((left + 2.0, middle), text, alignment=Alignment.MIDDLE_LEFT)
                left += width


def _compute_barb_end(tip: Point, direction: float) -> Point:
    """Return the end of an arrow head's side that comes in a direction [rad]."""
    x = tip[0] - ARROW_LENGTH * math.cos(direction)
    y = tip[1] - ARROW_LENGTH * math.sin(direction)
    return x, y
