"""A drawing sheet [mm]: lines, texts, dimensions, symbols, title block."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import ezdxf
from ezdxf.entities import DXFEntity
from ezdxf.enums import TextEntityAlignment
from ezdxf.math import Vec2

from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.lettering import compute_text_width
from stepblocks.parts.on_paper import choose_decimals, format_limits, format_zone

Point = tuple[float, float]
WIDTH, HEIGHT = 420.0, 297.0  # A3, landscape [mm]
FONT = "DejaVuSans.ttf"  # as the DXF names it
_TEXT = 2.5
_LAYERS = {  # colour, weight of the lines [0.01 mm] and their type
    "OUTLINE": (7, 50, "Continuous"),
    "HIDDEN": (8, 25, "DASHED"),
    "CENTRE": (8, 25, "CENTER"),
    "DIMENSION": (7, 25, "Continuous"),
    "FRAME": (7, 35, "Continuous"),
    "TEXT": (7, 25, "Continuous"),
}
_STYLE = {
    "dimtxsty": "LETTERS",
    "dimdsep": ord(","),  # as ISO 129-1 has it
    "dimtxt": _TEXT,
    "dimasz": 2.5,
    "dimexe": 1.2,
    "dimexo": 0.8,
    "dimgap": 0.8,
    **dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), 7),
    **dict.fromkeys(("dimtad", "dimtofl"), 1),
    **dict.fromkeys(("dimzin", "dimtzin", "dimtih", "dimtoh"), 0),
}
# strokes of the symbols in tolerance frames (ISO 1101), from the lower left corner of their cell
# [mm]; the only note in a frame is the straightness of a line
_SYMBOLS = {
    "flatness": [[(1.2, 1.8), (4.4, 1.8), (5.8, 4.2), (2.6, 4.2), (1.2, 1.8)]],
    "parallelism": [[(1.8, 1.4), (3.4, 4.6)], [(3.6, 1.4), (5.2, 4.6)]],
    "note": [[(1.4, 3.0), (5.6, 3.0)]],
}
_PREFIX = {"diameter": "⌀<>", "radius": "R<>"}  # of a dimension's text, by kind
ELSEWHERE = 1.6e-6  # largest Ra of surfaces that no tip touches [m]
TOP_OF_TITLE = 82.0  # y of the upper side of the title block [mm]


def choose_scale(largest: float) -> float:
    """Return the largest scale of ISO 5455 (1, 2, 5 times a power of ten) up to `largest`."""
    decade = 10.0 ** math.floor(math.log10(largest))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= largest * (1.0 + 1e-9))


def use_decimal_comma(text: str) -> str:
    """Write the decimal signs of a text as ISO 129-1 does."""
    return text.replace(".", ",")


def format_scale(scale: float) -> str:
    """Write a scale as ISO 5455 does: 5:1 or 1:2."""
    return f"{scale:g}:1" if scale >= 1.0 else f"1:{1.0 / scale:g}"


@dataclass(frozen=True)
class View:
    """Origin of a view on the paper and its scale, which may differ for heights."""

    origin: Point
    scale: float
    heights: float | None = None  # that of lengths where None

    def at(self, x: float, z: float) -> Point:
        """Return the place on the paper of a point of the part [m]."""
        cx, cz = self.origin
        return cx + x * 1e3 * self.scale, cz + z * 1e3 * (self.heights or self.scale)


class Sheet:
    """One sheet with the characteristics that it states; `document` is the ezdxf drawing."""

    def __init__(self, listed: Iterable[Characteristic]) -> None:
        self.listed = {one.key: (number, one) for number, one in enumerate(listed, start=1)}
        self.numbers: set[int] = set()  # of those that stand on it in balloons
        self.letters: dict[str, str] = {}  # in place of values that a table of the sheet states
        self.document = ezdxf.new("R2010", setup=["linetypes"], units=4)
        self.space = self.document.modelspace()
        for name, (colour, weight, dashes) in _LAYERS.items():
            self.document.layers.add(name, color=colour, lineweight=weight, linetype=dashes)
        self.document.header["$LTSCALE"] = 5.0
        self.document.header["$LWDISPLAY"] = 1
        self.document.appids.add("STEPBLOCKS")
        self.document.styles.add("LETTERS", font=FONT)
        self.document.dimstyles.add("PART", dxfattribs=_STYLE)

    def draw_line(self, a: Point, b: Point, layer: str = "OUTLINE") -> None:
        """Draw a line."""
        self.space.add_line(a, b, dxfattribs={"layer": layer})

    def draw_polyline(
        self, points: Sequence[Point], layer: str = "OUTLINE", closed: bool = False
    ) -> None:
        """Draw a polyline."""
        self.space.add_lwpolyline(points, close=closed, dxfattribs={"layer": layer})

    def draw_rectangle(self, a: Point, b: Point, layer: str = "OUTLINE") -> None:
        """Draw a rectangle by two opposite corners."""
        self.draw_polyline([a, (b[0], a[1]), b, (a[0], b[1])], layer, closed=True)

    def draw_circle(self, centre: Point, radius: float, layer: str = "OUTLINE") -> None:
        """Draw a circle."""
        self.space.add_circle(centre, radius, dxfattribs={"layer": layer})

    def write_text(
        self, at: Point, text: str, height: float = _TEXT, align: str = "LEFT", key: str = ""
    ) -> None:
        """Write one line of text; `key` says which characteristic it states.

        `align` is a name of ezdxf's TextEntityAlignment.
        """
        entity = self.space.add_text(
            text, height=height, dxfattribs={"layer": "TEXT", "style": "LETTERS"}
        )
        entity.set_placement(at, align=TextEntityAlignment[align])
        if key:
            self._mark_characteristic(entity, key)

    def _mark_characteristic(self, entity: DXFEntity, key: str) -> None:
        # Mark what states a characteristic on paper, for whoever checks that all are there
        number, _ = self.listed[key]
        self.numbers.add(number)
        entity.set_xdata("STEPBLOCKS", [(1000, key), (1070, number)])

    def format_limits(self, key: str) -> str:
        """Return nominal and deviations of a characteristic."""
        _, one = self.listed[key]
        return use_decimal_comma(format_limits(one.nominal, one.lower, one.upper, one.quantity))

    def draw_break_line(self, x: float, low: float, high: float) -> None:
        """Draw a vertical break with a zigzag in its middle."""
        middle = 0.5 * (low + high)
        self.draw_polyline(
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

    def draw_dimension(
        self,
        key: str,
        a: Point,
        b: Point,
        along: Point,
        scale: float,
        *,
        upright: bool = False,
        before: bool = False,
        text_at: float = 0.5,
        clear: float = 0.0,
    ) -> None:
        """Draw a linear dimension with its tolerance and balloon, its line through `along`.

        The text stands at a share `text_at` of the line; where that is too short, `clear` beyond
        its end, and beside its start with `before`.
        """
        _, one = self.listed[key]
        decimals = choose_decimals(one.nominal, one.lower, one.upper)
        override: dict[str, object] = {
            "dimlfac": 1.0 / scale,
            "dimdec": decimals,
            "dimtdec": decimals,
        }
        if prefix := _PREFIX.get(one.kind, ""):
            override["dimpost"] = prefix
        dimension = self.space.add_linear_dim(
            base=along,
            p1=a,
            p2=b,
            angle=90.0 if upright else 0.0,
            text=self.letters.get(key, "<>"),
            dimstyle="PART",
            override=override,
            dxfattribs={"layer": "DIMENSION"},
        )
        if key not in self.letters:
            dimension.set_tolerance(
                one.upper * 1e3,
                -one.lower * 1e3,
                hfactor=1.0,  # as high as the size itself (ISO 129-1)
                dec=decimals,
                leading_zeros=True,
                trailing_zeros=True,
            )
        # along the line of the dimension: its ends, and the length of its text; `side` leads away
        # from it
        axis, side = (1, -1.0) if upright else (0, 1.0)
        start, end = sorted((a[axis], b[axis]))
        size = prefix.replace("<>", "") + self.format_limits(key).replace(" ", "")
        needed = compute_text_width(self.letters.get(key, size), _TEXT) + 2.0
        narrow = end - start < max(needed + 10.0, 0.5 * needed / min(text_at, 1.0 - text_at))
        reach = 0.5 * needed + 3.0
        middle = list(along)
        if narrow:  # the text stands beside the arrows; before them with room for the balloon
            middle[axis] = start - reach - 6.0 if before else end + reach + clear
            # under which the line goes on (ISO 129-1)
            far = middle[axis] - 0.5 * needed if before else middle[axis] + 0.5 * needed
            under = (along[0], far) if upright else (far, along[1])
            self.draw_line((along[0], end) if upright else (end, along[1]), under, "DIMENSION")
            # unequal deviations stand one over the other
            middle[1 - axis] += side * (2.2 if one.upper == -one.lower else 4.4)
            dimension.set_location(Vec2(middle), leader=False)
        else:
            middle[axis] = start + text_at * (end - start)
            if text_at != 0.5:
                dimension.set_location(Vec2(middle[0] - 2.2, middle[1]), leader=False)
        dimension.render()
        self._mark_characteristic(dimension.dimension, key)
        after, beside = (reach, 0.8) if narrow else (0.5 * needed + 2.2, 4.6)
        middle[axis] += after
        middle[1 - axis] += side * beside
        self.draw_balloon(key, (middle[0], middle[1]))

    def draw_hatch(self, points: Sequence[Point], angle: float = 0.0) -> None:
        """Hatch the cut area within an outline, at 45 degrees and a further angle (ISO 128-50)."""
        area = self.space.add_hatch(dxfattribs={"layer": "DIMENSION"})
        area.set_pattern_fill("ANSI31", scale=0.8, angle=angle)
        area.paths.add_polyline_path(points)

    def draw_cutting_line(self, left: Point, right: Point, letter: str) -> None:
        """Draw where a section is cut (ISO 128-44), as seen from below on the paper."""
        self.draw_line(left, right, "CENTRE")
        for (x, y), inwards in ((left, 1.0), (right, -1.0)):
            self.draw_line((x, y), (x + 3.0 * inwards, y))
            self.draw_pointer((x, y - 6.0), (x, y))
            self.write_text((x - 2.6 * inwards, y - 3.0), letter, 3.0, "MIDDLE_CENTER")

    def draw_edge_state(self, tip: Point, corner: Point, limits: str) -> None:
        """Draw the symbol of the state of an edge (ISO 13715) with its limits in millimetres."""
        x, y = corner
        wide = 3.0 + compute_text_width(limits, _TEXT)
        self.draw_pointer(corner, tip)
        self.draw_polyline([(x, y + 4.5), corner, (x + wide, y)], "FRAME")
        self.write_text((x + 1.5, y + 2.4), use_decimal_comma(limits), _TEXT, "MIDDLE_LEFT")

    def draw_balloon(self, key: str, at: Point) -> None:
        """Draw the number of a characteristic in a circle."""
        self.draw_circle(at, 2.8, "DIMENSION")
        self.write_text(at, str(self.listed[key][0]), _TEXT, "MIDDLE_CENTER")

    def draw_leader(self, tip: Point, elbow: Point, text: str, key: str = "") -> None:
        """Draw an arrow to `tip` from a text at `elbow`; ``{}`` are the limits of `key`."""
        if key:
            text = text.format(self.format_limits(key))
        side = 1.0 if elbow[0] >= tip[0] else -1.0
        shelf = elbow[0] + side * 3.0
        self.draw_pointer((shelf, elbow[1]), elbow, tip)
        self.write_text(
            (shelf + side, elbow[1]),
            text,
            _TEXT,
            "MIDDLE_LEFT" if side > 0.0 else "MIDDLE_RIGHT",
            key,
        )
        if key:
            self.draw_balloon(
                key, (shelf + side * (5.0 + compute_text_width(text, _TEXT)), elbow[1])
            )

    def draw_arrow(self, tip: Point, tail: Point, size: float = 2.5) -> None:
        """Draw a filled arrow head at `tip`, coming from `tail`."""
        angle = math.atan2(tip[1] - tail[1], tip[0] - tail[0])
        left, right = (
            (tip[0] - size * math.cos(side), tip[1] - size * math.sin(side))
            for side in (angle - 0.165, angle + 0.165)
        )
        self.space.add_solid([tip, left, right, right], dxfattribs={"layer": "DIMENSION"})

    def draw_pointer(self, *points: Point) -> None:
        """Draw a line through points, with an arrow head at the last."""
        self.draw_polyline(points, "DIMENSION")
        self.draw_arrow(points[-1], points[-2])

    def draw_tolerance_frame(self, key: str, at: Point, datum: str = "") -> Point:
        """Draw a tolerance frame as lines; return its left end.

        Viewers do not render the native entity.
        """
        _, one = self.listed[key]
        x, y = at
        high, cell = 6.0, 7.0
        value = use_decimal_comma(format_zone(one.upper))
        wide = 4.0 + compute_text_width(value, _TEXT)
        # of the cells
        ends = [
            x + cell,
            x + cell + wide,
            *([x + cell + wide + cell] if datum else []),
        ]
        self.draw_rectangle(at, (ends[-1], y + high), "FRAME")
        for end in ends[:-1]:
            self.draw_line((end, y), (end, y + high), "FRAME")
        for stroke in _SYMBOLS[one.kind]:
            self.draw_polyline([(x + right, y + up) for right, up in stroke], "FRAME")
        self.write_text((x + cell + 0.5 * wide, y + 0.5 * high), value, _TEXT, "MIDDLE_CENTER", key)
        if datum:
            self.write_text((ends[-1] - 0.5 * cell, y + 0.5 * high), datum, _TEXT, "MIDDLE_CENTER")
        self.draw_balloon(key, (ends[-1] + 4.0, y + 0.5 * high))
        return x, y + 0.5 * high

    def point_to(self, face: Point, start: Point) -> None:
        """Lead from the left end of a frame straight to a face."""
        self.draw_pointer(start, (face[0], start[1]), face)

    def draw_datum(self, at: Point, letter: str) -> None:
        """Draw a datum triangle under a face, with its letter in a box below."""
        x, y = at
        foot = (x + 1.8, y - 3.0)
        self.space.add_solid(
            [(x, y), (x - 1.8, y - 3.0), foot, foot], dxfattribs={"layer": "FRAME"}
        )
        self.draw_line((x, y - 3.0), (x, y - 6.0), "FRAME")
        self.draw_rectangle((x - 3.0, y - 12.0), (x + 3.0, y - 6.0), "FRAME")
        self.write_text((x, y - 9.0), letter, 3.0, "MIDDLE_CENTER")

    def draw_texture(self, foot: Point, key: str = "", suffix: str = "") -> None:
        """Draw the symbol of a machined surface (ISO 21920-1) with its largest Ra [um].

        Without a key it is that of all other surfaces.
        """
        x, y = foot
        largest = self.listed[key][1].upper if key else ELSEWHERE
        text = use_decimal_comma(f"Ra {largest * 1e6:g}{suffix}")
        self.draw_polyline(
            [(x - 2.0, y + 3.5), (x, y), (x + 2.0, y + 3.5)], "DIMENSION", closed=True
        )
        end = x + 6.0 + compute_text_width(text, _TEXT)
        self.draw_polyline([(x + 2.0, y + 3.5), (x + 4.3, y + 7.5), (end, y + 7.5)], "DIMENSION")
        self.write_text((x + 5.0, y + 5.3), text, _TEXT, "MIDDLE_LEFT", key)
        if key:
            self.draw_balloon(key, (end + 3.6, y + 5.6))
            return
        self.write_text((x + 24.0, y + 3.0), "(", 4.0)
        self.draw_polyline(
            [(x + 27.0, y + 5.0), (x + 29.0, y + 2.0), (x + 32.0, y + 7.0)], "DIMENSION"
        )
        self.write_text((x + 33.0, y + 3.0), ")", 4.0)

    def draw_border(self, title: str, rows: dict[str, str]) -> None:
        """Draw frame, title block and the symbol of first-angle projection."""
        standard = {
            "unit": "mm; scales stand at the views",
            "general tolerances": "ISO 2768-m",
            "tolerancing": "ISO 8015, ISO 1101",
            "edges, surfaces": "ISO 13715, ISO 21920-1",
            "reference temperature": "20 °C (ISO 1)",
            "projection, size": "first angle (ISO 5456-2), A3",
        }
        cells = list((rows | standard).items())
        # ISO 5457: 20 mm on the left are for filing
        self.draw_rectangle((20.0, 10.0), (WIDTH - 10.0, HEIGHT - 10.0), "FRAME")
        left, half = WIDTH - 190.0, -(-len(cells) // 2)
        high = (TOP_OF_TITLE - 18.0) / half
        self.draw_rectangle((left, 10.0), (WIDTH - 10.0, TOP_OF_TITLE), "FRAME")
        self.write_text((left + 3.0, TOP_OF_TITLE - 4.0), title, 4.5, "MIDDLE_LEFT")
        for index, (name, value) in enumerate(cells):
            column, row = divmod(index, half)
            x, y = left + 90.0 * column, TOP_OF_TITLE - 8.0 - high * row
            self.draw_rectangle((x, y - high), (x + 90.0, y), "FRAME")
            self.write_text((x + 2.0, y - 2.0), name, _TEXT, "MIDDLE_LEFT")
            # a long text is written smaller rather than over the line of its field
            size = min(2.5, 2.5 * 84.0 / compute_text_width(value, 2.5)) if value else 2.5
            self.write_text((x + 2.0, y - 5.6), value, size, "MIDDLE_LEFT")
        # the truncated cone from its side and, on the right of it, from its narrow end (ISO 5456-2)
        x, y = WIDTH - 26.0, 10.0 + 0.5 * high
        side = [(x - 4.0, y - 1.2), (x + 2.0, y - 2.4), (x + 2.0, y + 2.4), (x - 4.0, y + 1.2)]
        self.draw_polyline(side, "DIMENSION", closed=True)
        for radius in (1.2, 2.4):
            self.draw_circle((x + 8.0, y), radius, "DIMENSION")
        self.draw_line((x - 5.0, y), (x + 3.0, y), "CENTRE")
        self.draw_line((x + 5.0, y), (x + 11.0, y), "CENTRE")

    def write_table(
        self, at: Point, rows: Sequence[Sequence[str]], widths: Sequence[float]
    ) -> None:
        """Draw a table downwards from its upper left corner, its first row the headings."""
        x, y = at
        for index, row in enumerate(rows):
            left, top = x, y - 6.0 * index
            for text, wide in zip(row, widths, strict=True):
                self.draw_rectangle((left, top - 6.0), (left + wide, top), "FRAME")
                self.write_text((left + 2.0, top - 3.0), text, _TEXT, "MIDDLE_LEFT")
                left += wide

    def write_notes(self, at: Point, lines: Iterable[tuple[str, str]]) -> None:
        """Write notes downwards from a point, each with the characteristic that it states."""
        for index, (line, key) in enumerate(lines):
            self.write_text((at[0], at[1] - 5.0 * index), line, key=key)
