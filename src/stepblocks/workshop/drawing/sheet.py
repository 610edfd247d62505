"""A sheet of drawing paper: lines, texts, true dimensions, balloons, frames and the title block.

Everything is in millimetres of paper. A dimension measures the drawn geometry and divides by the scale of its
view, so what it prints is the part; ezdxf keeps value and tolerance in the DIMENSION entity, where they can be read back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import ezdxf
from ezdxf.enums import TextEntityAlignment
from ezdxf.math import Vec2

from stepblocks.artefacts.numbers import decimals_for, limits_text, millimetres
from stepblocks.parts.characteristics import Characteristic
from stepblocks.workshop.drawing.lettering_font import FONT

Point = tuple[float, float]
WIDTH, HEIGHT = 420.0, 297.0  # A3, landscape [mm]
_TEXT = 2.5
_WIDE = 0.87  # Mean advance of a character over its height, for DejaVu Sans
_LAYERS = {
    "OUTLINE": (7, 50),
    "HIDDEN": (8, 25),
    "CENTRE": (8, 18),
    "DIMENSION": (7, 18),
    "FRAME": (7, 35),
    "TEXT": (7, 18),
}


class Sheet:
    """One sheet; `document` is the ezdxf drawing, `numbers` are those of the characteristics that stand on it in balloons."""

    def __init__(self) -> None:
        self.numbers: set[int] = set()
        self.document: Any = ezdxf.new("R2010", setup=["linetypes"], units=4)
        self.space: Any = self.document.modelspace()
        for name, (colour, weight) in _LAYERS.items():
            self.document.layers.add(name, color=colour, lineweight=weight)
        self.document.layers.get("HIDDEN").dxf.linetype = "DASHED"
        self.document.layers.get("CENTRE").dxf.linetype = "CENTER"
        self.document.header["$LTSCALE"] = 5.0
        self.document.header["$LWDISPLAY"] = 1
        self.document.appids.add("STEPBLOCKS")
        self.document.styles.add("LETTERS", font=FONT)
        style = self.document.dimstyles.add("PART")
        style.dxf.dimtxsty = "LETTERS"
        for name, value in {
            "dimtxt": _TEXT,
            "dimasz": 2.5,
            "dimexe": 1.2,
            "dimexo": 0.8,
            "dimgap": 0.8,
            "dimtad": 1,
            "dimzin": 0,
            "dimtzin": 0,
            "dimdsep": ord("."),
            "dimclrd": 7,
            "dimclre": 7,
            "dimclrt": 7,
            "dimtih": 0,
            "dimtoh": 0,
            "dimtofl": 1,
        }.items():
            style.dxf.set(name, value)

    def line(self, a: Point, b: Point, layer: str = "OUTLINE") -> None:
        """Draw a line."""
        self.space.add_line(a, b, dxfattribs={"layer": layer})

    def polyline(self, points: Sequence[Point], layer: str = "OUTLINE", closed: bool = False) -> None:
        """Draw a polyline."""
        self.space.add_lwpolyline(points, close=closed, dxfattribs={"layer": layer})

    def rectangle(self, a: Point, b: Point, layer: str = "OUTLINE") -> None:
        """Draw a rectangle by two opposite corners."""
        self.polyline([a, (b[0], a[1]), b, (a[0], b[1])], layer, closed=True)

    def circle(self, centre: Point, radius: float, layer: str = "OUTLINE") -> None:
        """Draw a circle."""
        self.space.add_circle(centre, radius, dxfattribs={"layer": layer})

    def text(self, at: Point, text: str, height: float = _TEXT, align: str = "LEFT", layer: str = "TEXT") -> None:
        """Write one line of text; `align` is a name of ezdxf's TextEntityAlignment."""
        entity = self.space.add_text(text, height=height, dxfattribs={"layer": layer, "style": "LETTERS"})
        entity.set_placement(at, align=TextEntityAlignment[align])

    def break_line(self, x: float, low: float, high: float) -> None:
        """Draw a vertical break with a zigzag in its middle."""
        middle = 0.5 * (low + high)
        self.polyline(
            [
                (x, low),
                (x, middle - 2.0),
                (x - 1.2, middle - 0.8),
                (x + 1.2, middle + 0.8),
                (x, middle + 2.0),
                (x, high),
            ],
            "DIMENSION",
        )

    def dimension(
        self, number: int, one: Characteristic, a: Point, b: Point, along: Point, scale: float, angle: float = 0.0
    ) -> None:
        """Draw a linear dimension with its tolerance and balloon."""
        decimals = decimals_for(one.nominal, one.lower, one.upper)
        override: dict[str, Any] = {"dimlfac": 1.0 / scale, "dimdec": decimals, "dimtdec": decimals}
        if one.kind == "diameter":
            override["dimpost"] = "dia. <>"
        if one.kind == "radius":
            override["dimpost"] = "R<>"
        distance = abs(b[0] - a[0]) if angle == 0.0 else abs(b[1] - a[1])
        printed = limits_text(one.nominal, one.lower, one.upper).replace(" ", "")
        needed = (
            _WIDE * _TEXT * (len(printed) + (5 if one.kind == "diameter" else 1 if one.kind == "radius" else 0)) + 2.0
        )
        dimension = self.space.add_linear_dim(
            base=along, p1=a, p2=b, angle=angle, dimstyle="PART", override=override, dxfattribs={"layer": "DIMENSION"}
        )
        dimension.set_tolerance(
            one.upper * 1e3,
            -one.lower * 1e3,
            hfactor=1.0 if abs(one.upper + one.lower) < 1e-12 else 0.7,
            dec=decimals,
            leading_zeros=True,
            trailing_zeros=True,
        )
        middle = Vec2(0.5 * (a[0] + b[0]), along[1]) if angle == 0.0 else Vec2(along[0], 0.5 * (a[1] + b[1]))
        if distance < needed + 10.0:
            # a narrow dimension carries its text beside the arrows, after its own end
            end = max(a[0], b[0]) if angle == 0.0 else max(a[1], b[1])
            reach = 0.5 * needed + 3.0
            middle = Vec2(end + reach, along[1] + 2.2) if angle == 0.0 else Vec2(along[0] - 2.2, end + reach)
            dimension.set_location(middle, leader=False)
        dimension.render()
        dimension.dimension.set_xdata("STEPBLOCKS", [(1000, one.key), (1070, number)])
        if distance < needed + 10.0:
            off = Vec2(0.5 * needed + 3.0, 0.0) if angle == 0.0 else Vec2(0.0, 0.5 * needed + 3.0)
        else:
            off = Vec2(0.5 * needed + 2.6, 3.4) if angle == 0.0 else Vec2(-3.4, 0.5 * needed + 2.6)
        self.balloon(number, (middle.x + off.x, middle.y + off.y))

    def balloon(self, number: int, at: Point) -> None:
        """Draw the number of a characteristic in a circle."""
        self.numbers.add(number)
        self.circle(at, 2.6, "DIMENSION")
        self.text(at, str(number), 2.2, "MIDDLE_CENTER")

    def leader(self, tip: Point, elbow: Point, text: str = "", number: int | None = None) -> None:
        """Draw an arrow to `tip` from a text at `elbow`, on the side away from the tip."""
        right = elbow[0] >= tip[0]
        shelf = elbow[0] + (3.0 if right else -3.0)
        self.polyline([tip, elbow, (shelf, elbow[1])], "DIMENSION")
        self.arrow(tip, elbow)
        width = _WIDE * _TEXT * len(text)
        if text:
            at = (shelf + 1.0, elbow[1]) if right else (shelf - 1.0, elbow[1])
            self.text(at, text, _TEXT, "MIDDLE_LEFT" if right else "MIDDLE_RIGHT")
        if number is not None:
            gap = 5.0 + width
            self.balloon(number, (shelf + gap if right else shelf - gap, elbow[1]))

    def arrow(self, tip: Point, tail: Point, size: float = 2.5) -> None:
        """Draw a filled arrow head at `tip`, coming from `tail`."""
        angle = math.atan2(tip[1] - tail[1], tip[0] - tail[0])
        corners = [tip]
        for turn in (-1.0, 1.0):
            side = angle + math.pi + turn * 0.165
            corners.append((tip[0] + size * math.cos(side), tip[1] + size * math.sin(side)))
        self.space.add_solid([*corners, corners[-1]], dxfattribs={"layer": "DIMENSION"})

    def frame(self, at: Point, kind: str, zone: float, number: int, datum: str = "") -> Point:
        """Draw a feature-control frame as geometry, since viewers do not render the native entity."""
        x, y = at
        high, cell = 6.0, 7.0
        value = millimetres(zone, max(decimals_for(zone), 3))
        wide = 3.0 + _WIDE * _TEXT * len(value)
        ends = [x + cell, x + cell + wide, *([x + cell + wide + cell] if datum else [])]
        self.rectangle(at, (ends[-1], y + high), "FRAME")
        for end in ends[:-1]:
            self.line((end, y), (end, y + high), "FRAME")
        if kind == "flatness":
            self.polyline(
                [(x + 1.2, y + 1.8), (x + 4.4, y + 1.8), (x + 5.8, y + 4.2), (x + 2.6, y + 4.2)], "FRAME", closed=True
            )
        else:
            for shift in (0.0, 1.8):
                self.line((x + 1.8 + shift, y + 1.4), (x + 3.4 + shift, y + 4.6), "FRAME")
        self.text((x + cell + 0.5 * wide, y + 0.5 * high), value, _TEXT, "MIDDLE_CENTER")
        if datum:
            self.text((ends[-1] - 0.5 * cell, y + 0.5 * high), datum, _TEXT, "MIDDLE_CENTER")
        self.balloon(number, (ends[-1] + 4.0, y + 0.5 * high))
        return x, y + 0.5 * high

    def datum(self, at: Point, letter: str) -> None:
        """Draw a datum triangle under a face, with its letter in a box below."""
        x, y = at
        self.space.add_solid(
            [(x, y), (x - 1.8, y - 3.0), (x + 1.8, y - 3.0), (x + 1.8, y - 3.0)], dxfattribs={"layer": "FRAME"}
        )
        self.line((x, y - 3.0), (x, y - 6.0), "FRAME")
        self.rectangle((x - 3.0, y - 12.0), (x + 3.0, y - 6.0), "FRAME")
        self.text((x, y - 9.0), letter, 3.0, "MIDDLE_CENTER")

    def border(self, rows: Sequence[tuple[str, str]], title: str) -> None:
        """Draw the frame of the sheet and the title block in its lower right corner."""
        self.rectangle((10.0, 10.0), (WIDTH - 10.0, HEIGHT - 10.0), "FRAME")
        left, high = WIDTH - 190.0, 8.0
        top = 20.0 + high * math.ceil(0.5 * len(rows))
        self.rectangle((left, 10.0), (WIDTH - 10.0, top), "FRAME")
        self.line((left, top - 10.0), (WIDTH - 10.0, top - 10.0), "FRAME")
        self.text((left + 3.0, top - 5.0), title, 4.5, "MIDDLE_LEFT")
        half = 0.5 * len(rows)
        for index, (name, value) in enumerate(rows):
            column, row = divmod(index, math.ceil(half))
            x, y = left + 90.0 * column, top - 10.0 - high * row
            self.rectangle((x, y - high), (x + 90.0, y), "FRAME")
            self.text((x + 2.0, y - 2.2), name, 1.6, "MIDDLE_LEFT")
            self.text((x + 2.0, y - 5.4), value, 2.5, "MIDDLE_LEFT")

    def notes(self, at: Point, lines: Sequence[str]) -> None:
        """Write numbered notes downwards from a point."""
        for index, line in enumerate(lines):
            self.text((at[0], at[1] - 5.0 * index), line, _TEXT, "LEFT")
