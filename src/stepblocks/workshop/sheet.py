"""A drawing sheet [mm]: dimensions, tolerance frames and symbols of numbered characteristics."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ezdxf.entities import DXFEntity, Text
from ezdxf.math import Vec2

from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.lettering import compute_text_width
from stepblocks.parts.on_paper import choose_decimals, format_size_with_deviations, format_zone
from stepblocks.workshop.dimension_layout import (
    DimensionLine,
    lay_out_text_beside,
    lay_out_text_inside,
)
from stepblocks.workshop.inches import (
    INCH,
    convert_to_inches_inward,
    format_inches,
    format_largest_in_inches,
    format_largest_roughness_in_microinches,
    format_least_in_inches,
)
from stepblocks.workshop.paper import (
    TEXT_HEIGHT,
    Alignment,
    Layer,
    Paper,
    PaperX,
    Point,
    replace_decimal_points_by_commas,
    shift_points,
)

# strokes of the symbols in tolerance frames (ISO 1101), from the lower left corner of their cell
# [mm]; the only note in a frame is the straightness of a line
_SYMBOLS = {
    "flatness": [[(1.2, 1.8), (4.4, 1.8), (5.8, 4.2), (2.6, 4.2), (1.2, 1.8)]],
    "parallelism": [[(1.8, 1.4), (3.4, 4.6)], [(3.6, 1.4), (5.2, 4.6)]],
    "note": [[(1.4, 3.0), (5.6, 3.0)]],
}
_RUNOUT_SYMBOL = [[(1.8, 1.2), (5.0, 4.8)], [(3.6, 4.3), (5.0, 4.8), (4.7, 3.3)]]
_PREFIXES = {"diameter": "⌀", "radius": "R"}  # of a dimension's text, by kind
_MEASUREMENT = "<>"  # what ezdxf replaces by the measured length
_KEY_CODE = 1000  # group codes of extended data: a string and a whole number
_NUMBER_CODE = 1070
# decimal point, and no zero before it (ASME Y14.5)
_INCH_STYLE = {"dimdsep": ord("."), "dimzin": 4, "dimtzin": 4}
_MILLIMETRES_PER_INCH = 25.4
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_NOTE_SPACING = 5.0  # from line to line
ELSEWHERE = 1.6e-6  # largest Ra of surfaces that no tip touches [m]


@dataclass(frozen=True)
class _PrintedSize:
    """How a dimension is printed, in the unit of the drawing."""

    per_millimetre: float  # of the paper
    lower: float  # signed deviation
    upper: float


@dataclass(frozen=True)
class ListedCharacteristic:
    """A characteristic with its number on the inspection sheet."""

    number: int
    characteristic: Characteristic


@dataclass(frozen=True)
class Note:
    """A line of text on a sheet, with the key of the characteristic that it states, if any."""

    text: str
    key: str = ""


@dataclass(frozen=True)
class _Leader:
    """Where shelf and text of a leader lie, on the side away from its tip."""

    shelf: Point
    text: Point
    side: float  # 1 where the text stands on the right, else -1
    alignment: Alignment

    @classmethod
    def between_points(cls, tip: Point, elbow: Point) -> "_Leader":
        """Place a leader from a text at `elbow` to `tip`, its shelf away from the tip."""
        elbow_x, y = elbow
        side = 1.0
        alignment = Alignment.MIDDLE_LEFT
        if elbow_x < tip[0]:
            side = -1.0
            alignment = Alignment.MIDDLE_RIGHT
        shelf = elbow_x + side * 3.0
        return cls((shelf, y), (shelf + side, y), side, alignment)


UnwrittenNotes = list[str]  # lines of notes on views; the caller writes them
FrameLeft = Point  # middle of the left side of a tolerance frame


class Sheet(Paper):
    """A sheet with the characteristics that it states.

    Parameters
    ----------
    characteristics : iterable of Characteristic
        All characteristics of the part, in the order of its inspection sheet.
    in_inches : bool
        Whether its sizes are written in inches (ASME Y14.5), not in millimetres (ISO 129-1).

    Attributes
    ----------
    listed : dict of str to ListedCharacteristic
        The characteristics by their keys.
    numbers : set of int
        Numbers of the characteristics that stand on the sheet.
    letters : dict of str to str
        Letters by key, in place of values that a table of the sheet states.
    """

    def __init__(
        self, characteristics: Iterable[Characteristic], *, in_inches: bool = False
    ) -> None:
        super().__init__()
        self.in_inches = in_inches
        self.listed: dict[str, ListedCharacteristic] = {}
        for number, characteristic in enumerate(characteristics, start=1):
            self.listed[characteristic.key] = ListedCharacteristic(number, characteristic)
        self.numbers: set[int] = set()
        self.letters: dict[str, str] = {}

    def format_characteristic_limits(self, key: str) -> str:
        """Format nominal value and deviations of a characteristic as on a drawing."""
        characteristic = self.listed[key].characteristic
        sizes = (characteristic.nominal, characteristic.lower, characteristic.upper)
        if characteristic.quantity == "angle":
            return self.convert_decimal_signs(
                format_size_with_deviations(*sizes, characteristic.quantity)
            )
        return self.format_size(*sizes)

    def format_size(self, nominal: float, lower: float, upper: float) -> str:
        """Format a length and its deviations [m] as on a drawing."""
        if self.in_inches:
            return convert_to_inches_inward(nominal, lower, upper).format_with_deviations()
        return replace_decimal_points_by_commas(format_size_with_deviations(nominal, lower, upper))

    def format_largest(self, length: float) -> str:
        """Format the largest length [m] that is permitted."""
        if self.in_inches:
            return format_largest_in_inches(length)
        return replace_decimal_points_by_commas(f"{length * 1e3:.3g}")

    def format_least(self, length: float) -> str:
        """Format the least length [m] that is permitted."""
        if self.in_inches:
            return format_least_in_inches(length)
        return replace_decimal_points_by_commas(f"{length * 1e3:.3g}")

    def format_distance(self, length: float) -> str:
        """Format a distance without a tolerance of its own [m]."""
        if self.in_inches:
            return format_inches(length / INCH, 3)
        return replace_decimal_points_by_commas(f"{length * 1e3:g}")

    def format_tool_diameter(self, diameter: float) -> str:
        """Format the diameter of a tool [m], which is metric on either drawing."""
        size = f"⌀{diameter * 1e3:g}"
        if self.in_inches:
            return f"{size} mm"
        return replace_decimal_points_by_commas(size)

    def format_roughness(self, largest: float) -> str:
        """Format the largest roughness Ra [m]."""
        if self.in_inches:
            return f"Ra {format_largest_roughness_in_microinches(largest)} µin"
        return replace_decimal_points_by_commas(f"Ra {largest * 1e6:g}")

    def convert_decimal_signs(self, text: str) -> str:
        """Write the decimal signs of a text as the standard of the drawing does."""
        if self.in_inches:
            return text
        return replace_decimal_points_by_commas(text)

    def write_text(
        self,
        anchor: Point,
        text: str,
        height: float = TEXT_HEIGHT,
        alignment: Alignment = Alignment.LEFT,
    ) -> Text:
        """Write one line of text, aligned to the point `anchor` [mm]; return its entity."""
        if self.in_inches:
            text = _DECIMAL_COMMA.sub(".", text)
        return super().write_text(anchor, text, height, alignment)

    def write_characteristic_text(
        self,
        key: str,
        anchor: Point,
        text: str,
        alignment: Alignment = Alignment.LEFT,
    ) -> None:
        """Write a text that states a characteristic, as `write_text` does."""
        self._tag_entity_with_characteristic(
            self.write_text(anchor, text, alignment=alignment), key
        )

    def _tag_entity_with_characteristic(self, entity: DXFEntity, key: str) -> None:
        """Note in an entity which characteristic it states, for checks that none is missing."""
        number = self.listed[key].number
        self.numbers.add(number)
        entity.set_xdata("STEPBLOCKS", [(_KEY_CODE, key), (_NUMBER_CODE, number)])

    def draw_balloon(self, key: str, centre: Point) -> None:
        """Draw the number of a characteristic in a circle."""
        self.draw_circle(centre, 2.8, Layer.DIMENSION)
        number = self.listed[key].number
        self.write_text(centre, str(number), alignment=Alignment.MIDDLE_CENTER)

    def draw_dimension(
        self,
        key: str,
        start: Point,
        end: Point,
        through: Point,
        scale: float,
        *,
        upright: bool = False,
        before: bool = False,
        text_share: float = 0.5,
        clearance: float = 0.0,
    ) -> None:
        """Draw a linear dimension with its tolerance and balloon.

        Parameters
        ----------
        key : str
            Key of the characteristic.
        start, end : tuple of float
            Points between which it is measured [mm].
        through : tuple of float
            A point on the line of the dimension [mm].
        scale : float
            Scale of the view.
        upright : bool
            Whether a height is measured, not a length.
        before : bool
            Whether a text for which the line is too short stands before its start.
        text_share : float
            Share of the line at which its text stands, if the line is long enough.
        clearance : float
            Distance to be kept beyond the end of a line that is too short [mm].
        """
        characteristic = self.listed[key].characteristic
        dimension = self._add_dimension(key, start, end, through, scale, upright)
        line = DimensionLine.between_points(start, end, through, upright)
        text_width = self._measure_dimension_text(key)
        stacked = characteristic.upper != -characteristic.lower
        if line.has_room_for_text(text_width, text_share, stacked=stacked):
            layout = lay_out_text_inside(line, text_width, text_share, stacked=stacked)
            # ezdxf centres a single line of text over the middle of the line by itself
            if stacked or text_share != 0.5:
                dimension.set_location(Vec2(layout.text), leader=False)
        else:
            layout = lay_out_text_beside(
                line,
                text_width,
                stacked=stacked,
                before=before,
                clearance=clearance,
            )
            dimension.set_location(Vec2(layout.text), leader=False)
        if layout.extension is not None:
            self.draw_line(*layout.extension, Layer.DIMENSION)
        dimension.render()
        self._tag_entity_with_characteristic(dimension.dimension, key)
        self.draw_balloon(key, layout.balloon)

    def _add_dimension(
        self, key: str, start: Point, end: Point, through: Point, scale: float, upright: bool
    ) -> Any:
        """Add the entity of a linear dimension, not rendered yet; return ezdxf's handle of it."""
        characteristic = self.listed[key].characteristic
        if self.in_inches:
            size = convert_to_inches_inward(
                characteristic.nominal, characteristic.lower, characteristic.upper
            )
            printed = _PrintedSize(1.0 / (_MILLIMETRES_PER_INCH * scale), size.lower, size.upper)
            decimals = size.decimals
        else:
            sizes = (characteristic.nominal, characteristic.lower, characteristic.upper)
            printed = _PrintedSize(
                1.0 / scale, characteristic.lower * 1e3, characteristic.upper * 1e3
            )
            decimals = choose_decimals(*sizes)
        override: dict[str, object] = {
            "dimlfac": printed.per_millimetre,
            "dimdec": decimals,
            "dimtdec": decimals,
        }
        if self.in_inches:
            override |= _INCH_STYLE
        if characteristic.kind in _PREFIXES:
            override["dimpost"] = _PREFIXES[characteristic.kind] + _MEASUREMENT
        dimension = self.space.add_linear_dim(
            base=through,
            p1=start,
            p2=end,
            angle=90.0 if upright else 0.0,
            text=self.letters.get(key, _MEASUREMENT),
            dimstyle="PART",
            override=override,
            dxfattribs={"layer": Layer.DIMENSION.value},
        )
        if key not in self.letters:
            dimension.set_tolerance(
                printed.upper,
                -printed.lower,
                hfactor=1.0,  # as high as the size itself (ISO 129-1)
                dec=decimals,
                leading_zeros=not self.in_inches,
                trailing_zeros=True,
            )
        return dimension

    def _measure_dimension_text(self, key: str) -> float:
        """Return the width of a dimension's text with the space about it [mm]."""
        if key in self.letters:
            text = self.letters[key]
        else:
            prefix = _PREFIXES.get(self.listed[key].characteristic.kind, "")
            text = prefix + self.format_characteristic_limits(key).replace(" ", "")
        return compute_text_width(text, TEXT_HEIGHT) + 2.0

    def draw_cutting_line(self, left: Point, right: Point, letter: str) -> None:
        """Draw where a section is cut (ISO 128-44), as seen from below on the paper."""
        self.draw_line(left, right, Layer.CENTRE)
        for (x, y), inwards in ((left, 1.0), (right, -1.0)):
            self.draw_line((x, y), (x + 3.0 * inwards, y))
            self.draw_pointer((x, y - 6.0), (x, y))
            beside = (x - 2.6 * inwards, y - 3.0)
            self.write_text(beside, letter, 3.0, Alignment.MIDDLE_CENTER)

    def draw_edge_state(self, tip: Point, lower_left: Point, limits: str) -> None:
        """Draw the symbol of the state of an edge (ISO 13715) with its limits, led to `tip`."""
        x, y = lower_left
        width = 3.0 + compute_text_width(limits, TEXT_HEIGHT)
        self.draw_pointer(lower_left, tip)
        self.draw_polyline([(x, y + 4.5), lower_left, (x + width, y)], Layer.FRAME)
        self.write_text((x + 1.5, y + 2.4), limits, alignment=Alignment.MIDDLE_LEFT)

    def draw_leader(self, tip: Point, elbow: Point, text: str) -> None:
        """Draw an arrow to `tip` from a text at `elbow`."""
        leader = _Leader.between_points(tip, elbow)
        self.draw_pointer(leader.shelf, elbow, tip)
        self.write_text(leader.text, text, alignment=leader.alignment)

    def draw_characteristic_leader(self, key: str, tip: Point, elbow: Point, template: str) -> None:
        """Draw a leader that states a characteristic; ``{}`` in `template` are its limits."""
        text = template.format(self.format_characteristic_limits(key))
        leader = _Leader.between_points(tip, elbow)
        self.draw_pointer(leader.shelf, elbow, tip)
        self.write_characteristic_text(key, leader.text, text, leader.alignment)
        shelf_x, y = leader.shelf
        past_text = 5.0 + compute_text_width(text, TEXT_HEIGHT)
        self.draw_balloon(key, (shelf_x + leader.side * past_text, y))

    def draw_tolerance_frame(self, key: str, lower_left: Point, datum: str = "") -> FrameLeft:
        """Draw a tolerance frame from a corner; return the middle of its left side.

        It is made of lines, because viewers do not render the native entity.
        """
        characteristic = self.listed[key].characteristic
        x, y = lower_left
        height = 6.0
        cell = 7.0
        middle = y + 0.5 * height
        zone = self._format_zone(characteristic.upper)
        zone_cell = 4.0 + compute_text_width(zone, TEXT_HEIGHT)
        dividers = [x + cell]
        right = x + cell + zone_cell
        if datum:
            dividers.append(right)
            right += cell
        self.draw_rectangle(lower_left, (right, y + height), Layer.FRAME)
        for divider in dividers:
            self.draw_line((divider, y), (divider, y + height), Layer.FRAME)
        strokes = _SYMBOLS[characteristic.kind]
        if key == "runout":
            strokes = _RUNOUT_SYMBOL
        for stroke in strokes:
            self.draw_polyline(shift_points(stroke, lower_left), Layer.FRAME)
        zone_place = (x + cell + 0.5 * zone_cell, middle)
        self.write_characteristic_text(key, zone_place, zone, Alignment.MIDDLE_CENTER)
        if datum:
            datum_place = (right - 0.5 * cell, middle)
            self.write_text(datum_place, datum, alignment=Alignment.MIDDLE_CENTER)
        self.draw_balloon(key, (right + 4.0, middle))
        return x, middle

    def _format_zone(self, zone: float) -> str:
        """Format the zone of a geometric tolerance [m]."""
        if self.in_inches:
            return format_largest_in_inches(zone)
        return replace_decimal_points_by_commas(format_zone(zone))

    def draw_pointer_to_face(self, tip: Point, start: Point) -> None:
        """Draw a pointer from the left side of a frame along it, then straight to a face."""
        self.draw_pointer(start, (tip[0], start[1]), tip)

    def draw_datum(self, tip: Point, letter: str) -> None:
        """Draw a datum triangle under a face, with its letter in a box below."""
        x, y = tip
        left = (x - 1.8, y - 3.0)
        right = (x + 1.8, y - 3.0)
        self.space.add_solid([tip, left, right, right], dxfattribs={"layer": Layer.FRAME.value})
        self.draw_line((x, y - 3.0), (x, y - 6.0), Layer.FRAME)
        self.draw_rectangle((x - 3.0, y - 12.0), (x + 3.0, y - 6.0), Layer.FRAME)
        self.write_text((x, y - 9.0), letter, 3.0, Alignment.MIDDLE_CENTER)

    def draw_datum_above(self, tip: Point, letter: str) -> None:
        """Draw a datum triangle on a face, with its letter in a box above."""
        x, y = tip
        left = (x - 1.8, y + 3.0)
        right = (x + 1.8, y + 3.0)
        self.space.add_solid([tip, left, right, right], dxfattribs={"layer": Layer.FRAME.value})
        self.draw_line((x, y + 3.0), (x, y + 6.0), Layer.FRAME)
        self.draw_rectangle((x - 3.0, y + 6.0), (x + 3.0, y + 12.0), Layer.FRAME)
        self.write_text((x, y + 9.0), letter, 3.0, Alignment.MIDDLE_CENTER)

    def draw_surface_texture(self, foot: Point, key: str, suffix: str = "") -> None:
        """Draw the symbol of a machined surface (ISO 21920-1) with its largest Ra [um].

        `foot` is the point of its triangle on the surface.
        """
        largest = self.listed[key].characteristic.upper
        text = f"{self.format_roughness(largest)}{suffix}"
        end = self._draw_texture_lines(foot, text)
        x, y = foot
        self.write_characteristic_text(key, (x + 5.0, y + 5.3), text, Alignment.MIDDLE_LEFT)
        self.draw_balloon(key, (end + 3.6, y + 5.6))

    def draw_general_surface_texture(self, foot: Point) -> None:
        """Draw the symbol of all surfaces that have none of their own (ISO 21920-1)."""
        x, y = foot
        text = self.format_roughness(ELSEWHERE)
        end = self._draw_texture_lines(foot, text)
        self.write_text((x + 5.0, y + 5.3), text, alignment=Alignment.MIDDLE_LEFT)
        x = max(x + 24.0, end + 3.0)
        self.write_text((x, y + 3.0), "(", 4.0)
        tick = [(x + 3.0, y + 5.0), (x + 5.0, y + 2.0), (x + 8.0, y + 7.0)]
        self.draw_polyline(tick, Layer.DIMENSION)
        self.write_text((x + 9.0, y + 3.0), ")", 4.0)

    def _draw_texture_lines(self, foot: Point, text: str) -> PaperX:
        """Draw the triangle of a texture and the line over its text; return the end of the line."""
        x, y = foot
        triangle = [(x - 2.0, y + 3.5), (x, y), (x + 2.0, y + 3.5)]
        self.draw_polyline(triangle, Layer.DIMENSION, closed=True)
        end = x + 6.0 + compute_text_width(text, TEXT_HEIGHT)
        arm = [(x + 2.0, y + 3.5), (x + 4.3, y + 7.5), (end, y + 7.5)]
        self.draw_polyline(arm, Layer.DIMENSION)
        return end

    def write_notes(self, start: Point, notes: Sequence[Note]) -> None:
        """Write notes downwards, one a line; the first begins at `start`."""
        x, y = start
        for index, note in enumerate(notes):
            place = (x, y - _NOTE_SPACING * index)
            if note.key:
                self.write_characteristic_text(note.key, place, note.text)
            else:
                self.write_text(place, note.text)
