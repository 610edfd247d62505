"""The body of a bench block, with fixing holes and engraving, and what all bench blocks share."""

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from stepblocks import cad
from stepblocks.parts.characteristics import (
    DEPTH_GAUGE,
    MACHINE,
    MICROSCOPE,
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    make_characteristic,
    make_edge_break_characteristic,
    make_location_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    QuantityValidator,
    Table,
    WorkingFaces,
    declare_default,
    describe_breach,
    make_positive_validator,
    make_rules_validator,
    read_none_as_absent,
)
from stepblocks.parts.face_characteristics import make_roughness_and_base_characteristics
from stepblocks.parts.kind import Part
from stepblocks.parts.lettering import compute_text_width, outline_centred_text
from stepblocks.parts.revolution import Point3
from stepblocks.parts.tolerance import (
    Dimension,
    Length,
    PositiveLength,
    find_declared_origin,
    parse_plausible_quantity,
)


@dataclass(frozen=True)
class Thread:
    """Diameters that go with a metric coarse thread [m]."""

    core: float  # of the core drill (ISO 261, ISO 2306)
    clearance: float  # of the clearance hole, medium (ISO 273)
    head: float  # of the head of the screw (ISO 4762)
    major: float


_THREADS = {
    "M2": Thread(1.6e-3, 2.4e-3, 4.4e-3, 2.0e-3),
    "M2.5": Thread(2.05e-3, 2.9e-3, 5.0e-3, 2.5e-3),
    "M3": Thread(2.5e-3, 3.4e-3, 6.0e-3, 3.0e-3),
    "M4": Thread(3.3e-3, 4.5e-3, 8.0e-3, 4.0e-3),
}
DRILL_POINT = math.radians(118.0)  # included angle of a twist drill's point [rad]
_COUNTERSINK = 1.05  # its diameter over the major diameter of the thread
_HEAD_CLEARANCE = 0.5e-3  # diameter of a counterbore over that of the head [m]
_DEPTH_OVER_THREAD = 1.25  # of a core hole over the least depth of full thread (ISO 6410-1, 5.2.3)
_DEEPEST_ENGRAVING = 0.1  # of the width of the block, at most
_LARGEST_LETTERS = 0.6  # of the height of the front, at most


def _read_offset(raw: object, info: ValidationInfo) -> float:
    """Read a length of either sign [m]."""
    return parse_plausible_quantity(raw, "length", find_declared_origin(info))


def _require_engravable_text(text: str) -> str:
    """Refuse what not every typeface and CAM program can engrave."""
    is_printable = text.isascii() and text.isprintable()
    if not is_printable or text != text.strip():
        raise ValueError(f"must be printable ASCII with no blank at either end, got {text!r}")
    return text


EngravedText = Annotated[str, Field(max_length=40), AfterValidator(_require_engravable_text)]
# along x and z
Offset = Annotated[
    tuple[Annotated[float, QuantityValidator(_read_offset, dimension="length")], ...],
    Field(min_length=2, max_length=2),
]


class Mounting(Table):
    """Two holes on the block's long axis.

    Attributes
    ----------
    kind : str
        ``"tapped"``: blind from below, the working faces stay whole; ``"clearance"``: through,
        counterbored from above.
    thread : str
        Metric coarse, ``"M2"``, ``"M2.5"``, ``"M3"`` or ``"M4"``.
    spacing : Dimension
        Distance of the holes along x [m].
    depth : Dimension
        Depth of the full core hole from the base, or of the counterbore [m].
    """

    kind: Literal["tapped", "clearance"] = "tapped"
    thread: Literal["M2", "M2.5", "M3", "M4"] = "M3"
    spacing: PositiveLength = declare_default("12 mm")
    depth: PositiveLength = declare_default("5 mm")

    @property
    def hole_diameter(self) -> float:
        """Diameter of the core hole or of the clearance hole [m]."""
        thread = _THREADS[self.thread]
        if self.kind == "tapped":
            return thread.core
        return thread.clearance

    @property
    def thread_depth(self) -> float:
        """Least depth of full thread [m]."""
        return self.depth.nominal / _DEPTH_OVER_THREAD

    @property
    def entry_diameter(self) -> float:
        """Diameter of the countersink at the base, or of the counterbore [m]."""
        thread = _THREADS[self.thread]
        if self.kind == "tapped":
            return thread.major * _COUNTERSINK
        return thread.head + _HEAD_CLEARANCE


class Engraving(Table):
    """Letters cut into the front side of the block.

    Attributes
    ----------
    text : str
        What is engraved; left out, the identity in capitals.
    offset : tuple of float
        From the middle of the front to that of the letters, along x and z [m].
    height : Dimension
        Height of a capital letter [m].
    depth : Dimension
        Depth of the cut [m].
    """

    text: EngravedText = ""
    offset: Offset = (0.0, 0.0)
    height: PositiveLength = declare_default("1.3 mm")
    depth: PositiveLength = declare_default("0.15 mm", otherwise="0.05 mm")

    def choose_text(self, identity: str) -> str:
        """Choose what is engraved in a block of this identity."""
        return self.text or identity.upper()

    def describe_position(self) -> str:
        """Say where the middle of the letters lies on the front."""
        along, up = self.offset
        parts = []
        if along != 0.0:
            side = "right" if along > 0.0 else "left"
            parts.append(f"{abs(along) * 1e3:g} mm to the {side} of")
        if up != 0.0:
            side = "over" if up > 0.0 else "under"
            parts.append(f"{abs(up) * 1e3:g} mm {side}")
        return " ".join([" and ".join(parts), "the middle of the front"]).strip()


class Body(Table):
    """The block without its stimulus; the origin lies on the working edge.

    Attributes
    ----------
    length : Dimension
        Length along x, across the working edge [m].
    width : Dimension
        Width along y [m]; the usual one fits a 24 mm vice.
    thickness : Dimension
        Thickness from the base to the lower working face [m].
    edge_break : Dimension
        Leg of the chamfer on all edges but the working ones [m].
    mounting : Mounting or None
        Two holes to hold it.
    engraving : Engraving or None
        Letters on its front.
    """

    length: PositiveLength = declare_default("20 mm")
    width: PositiveLength = declare_default("24 mm")
    thickness: PositiveLength = declare_default("8 mm")
    edge_break: Length = declare_default("0.3 mm", otherwise="0.1 mm")
    mounting: Annotated[Mounting | None, BeforeValidator(read_none_as_absent)] = declare_default({})
    engraving: Annotated[Engraving | None, BeforeValidator(read_none_as_absent)] = declare_default(
        {}
    )

    @property
    def half_length(self) -> float:
        """The right face lies at this x, the left one at its negative [m]."""
        return 0.5 * self.length.nominal

    @property
    def half_width(self) -> float:
        """The back lies at this y, the front at its negative [m]."""
        return 0.5 * self.width.nominal

    @property
    def base(self) -> float:
        """Height of the base [m], below zero."""
        return -self.thickness.nominal

    @make_rules_validator
    def _yield_fit_breaches(self) -> Iterator[str]:
        """Yield what keeps edge breaks, engraving and holes from fitting the block."""
        width = self.width.nominal
        chamfer = self.edge_break.nominal
        half_side = 0.5 * min(self.length.nominal, width, self.thickness.nominal)
        if chamfer >= half_side:
            rule = "be smaller than half the smallest side"
            yield describe_breach("edge_break", rule, half_side, chamfer)
        if self.engraving is not None:
            depth = self.engraving.depth.nominal
            deepest = _DEEPEST_ENGRAVING * width
            if depth >= deepest:
                rule = "be below a tenth of the width"
                yield describe_breach("engraving.depth", rule, deepest, depth)
        if self.mounting is not None:
            yield from self._yield_hole_breaches(self.mounting)

    def _yield_hole_breaches(self, mounting: Mounting) -> Iterator[str]:
        """Yield what keeps the holes from fitting the base."""
        spacing = mounting.spacing.nominal
        entry = mounting.entry_diameter
        room = self.length.nominal - 2.0 * self.edge_break.nominal
        if spacing + entry >= room:
            rule = "leave the holes inside the base"
            yield describe_breach("mounting.spacing", rule, room - entry, spacing)
        if entry >= spacing:
            yield describe_breach("mounting.spacing", "exceed the hole", entry, spacing)
        point = 0.0
        if mounting.kind == "tapped":
            point = 0.5 * mounting.hole_diameter / math.tan(0.5 * DRILL_POINT)
        depth = mounting.depth.nominal
        deepest = self.thickness.nominal - point
        if depth >= deepest:
            rule = "leave a floor over the drill point"
            yield describe_breach("mounting.depth", rule, deepest, depth)


# along x, y and z [m]
Stock = Annotated[
    tuple[Annotated[float, make_positive_validator("length")], ...],
    Field(min_length=3, max_length=3),
]


# why a block has no such field
_LEFT_HAND = "a left-hand block is the same part, turned by half a turn on the bench"
_OTHER_DATUM = (
    "heights, parallelism and scans are all referred to the lower working face, datum A; a height "
    "over another face would be another measurand"
)
_RELIEF = (
    'a step block takes relief = { width = "0.3 mm", depth = "0.1 mm" } at its root; a margin has '
    "its gap there"
)
_TWO_STEPS = (
    'a step block takes second_step = { height = "40 um", distance = "6 mm" } on its upper face; a '
    "margin has its gap there, and for more steps there are more blocks"
)


class Block(Part):
    """A bench block whose working faces meet at x = 0.

    The lower face is at z = 0, the other one higher or lower by the `rise`.
    """

    has_working_faces: ClassVar[bool] = True
    not_declared: ClassVar[dict[str, str]] = {
        **dict.fromkeys(("hand", "left_hand"), _LEFT_HAND),
        **dict.fromkeys(("datum", "datums"), _OTHER_DATUM),
        **dict.fromkeys(("relief", "undercut"), _RELIEF),
        **dict.fromkeys(("steps", "heights", "second_step"), _TWO_STEPS),
    }

    if TYPE_CHECKING:  # declared by each kind, in the order of its stanza
        body: Body
        stock: Stock | None
        working_faces: WorkingFaces | None

    @property
    def first_rise(self) -> float:
        """Height of the face behind the working edge over the left one [m], of either sign."""
        height: Dimension = getattr(self, self.governing_field)
        return height.nominal

    @property
    def rise(self) -> float:
        """Height of the right working face over the left one [m], of either sign."""
        return self.first_rise

    @property
    def highest(self) -> float:
        """Height of the highest working face over the left one [m]."""
        return max(self.rise, 0.0)

    @property
    def sides(self) -> Point3:
        """Sizes along x, y and z [m]."""
        body = self.body
        height = body.thickness.nominal + self.highest
        return body.length.nominal, body.width.nominal, height

    @abstractmethod
    def top(self, x: float) -> float:
        """Compute the height of the surface at a position across the edge [m].

        It is worked out apart from the counterface, to check by.
        """

    @property
    def removed_volume(self) -> float:
        """Volume of holes and engraving [m^3]."""
        return self._compute_hole_volume() + self._compute_engraved_volume()

    def _compute_hole_volume(self) -> float:
        """Compute the volume of both fixing holes [m^3]."""
        mounting = self.body.mounting
        if mounting is None:
            return 0.0
        drill = 0.5 * mounting.hole_diameter
        entry = 0.5 * mounting.entry_diameter
        depth = mounting.depth.nominal
        if mounting.kind == "tapped":
            sink = entry - drill
            frustum = math.pi * sink * (entry * entry + entry * drill + drill * drill) / 3.0
            point = math.pi * drill**3 / (3.0 * math.tan(0.5 * DRILL_POINT))
            return 2.0 * (frustum + math.pi * drill * drill * (depth - sink) + point)
        bore = self.body.thickness.nominal - depth
        left = math.pi * (drill * drill * bore + entry * entry * (depth + 0.0))
        right = math.pi * (drill * drill * bore + entry * entry * (depth + self.rise))
        return math.fsum((left, right))

    def _compute_engraved_volume(self) -> float:
        """Compute the volume of the engraved letters [m^3]."""
        engraving = self.body.engraving
        if engraving is None:
            return 0.0
        import shapely

        letters = outline_centred_text(engraving.choose_text(self.id), engraving.height.nominal)
        area = math.fsum(shapely.Polygon(outer, inner).area for outer, *inner in letters)
        return area * engraving.depth.nominal

    def extrude_section(self, crest: cad.door.Outline) -> cad.door.Body:
        """Extrude the section; `crest` is its outline from the right face to the left one."""
        half = self.body.half_length
        base = self.body.base
        chamfer = self.body.edge_break.nominal
        rise = self.rise
        right = [
            (half - chamfer, base),
            (half, base + chamfer),
            (half, rise - chamfer),
            (half - chamfer, rise),
        ]
        left = [
            (-half + chamfer, 0.0),
            (-half, -chamfer),
            (-half, base + chamfer),
            (-half + chamfer, base),
        ]
        # without a chamfer two corners are one
        outline = [*dict.fromkeys(right), *crest, *dict.fromkeys(left)]
        return cad.kernel.make_prism(outline, self.body.width.nominal)

    def yield_body_characteristics(
        self, lower: FaceRule, upper: FaceRule, edge: Rule | None
    ) -> Iterator[Characteristic]:
        """Yield the characteristics of the body.

        `lower` and `upper` are the working faces, `edge` is the wall of the edge, if
        there is one.
        """
        mounting = self.body.mounting
        half_length = self.body.half_length
        left = make_plane_rule(0, -half_length)
        base = make_plane_rule(2, self.body.base)
        yield from self._yield_size_characteristics(lower)
        if mounting is not None:
            holes = (
                self._make_hole_wall_rule(mounting, -0.5),
                self._make_hole_wall_rule(mounting, 0.5),
            )
            yield make_characteristic(
                "hole_spacing", "distance", mounting.spacing, *holes, method=MACHINE
            )
        yield self._make_edge_break_characteristic()
        yield from self._yield_engraving_characteristics()
        if mounting is not None:
            yield from self._yield_hole_characteristics(mounting, lower)
        if edge is not None:
            label = "working edge from the left side"
            yield make_location_characteristic("edge_position", label, half_length, left, edge)
        yield from make_roughness_and_base_characteristics(self.face_demands, lower, upper, base)
        if mounting is not None and mounting.kind == "tapped":
            yield self._make_thread_characteristic(mounting)

    def _yield_size_characteristics(self, lower_face: FaceRule) -> Iterator[Characteristic]:
        """Yield length, width and thickness; `lower_face` is the lower working face."""
        body = self.body
        left = make_plane_rule(0, -body.half_length)
        right = make_plane_rule(0, body.half_length)
        yield make_characteristic("length", "distance", body.length, left, right)
        front = make_plane_rule(1, -body.half_width)
        back = make_plane_rule(1, body.half_width)
        yield make_characteristic("width", "distance", body.width, front, back)
        base = make_plane_rule(2, body.base)
        yield make_characteristic("thickness", "distance", body.thickness, base, lower_face)

    def _make_hole_wall_rule(self, mounting: Mounting, half_side: float) -> FaceRule:
        """Make the rule of the wall of the left hole (`half_side` -0.5) or the right one (0.5)."""
        x = half_side * mounting.spacing.nominal
        return FaceRule("CYLINDER", radius=0.5 * mounting.hole_diameter, holds={0: x})

    def _make_edge_break_characteristic(self) -> Characteristic:
        """State the edge break of all edges alike, measured at that of the base on the right."""
        body = self.body
        chamfer = body.edge_break.nominal
        middle = {0: body.half_length - 0.5 * chamfer, 1: 0.0, 2: body.base + 0.5 * chamfer}
        slope = FaceRule("SLOPE", holds=middle)
        right = make_plane_rule(0, body.half_length)
        return make_edge_break_characteristic(
            body.edge_break, right, EdgeRule(slope, make_plane_rule(2, body.base))
        )

    def _yield_engraving_characteristics(self) -> Iterator[Characteristic]:
        """Yield depth and height of the letters, if there are some."""
        engraving = self.body.engraving
        if engraving is None:
            return
        front = -self.body.half_width
        floor = make_plane_rule(1, front + engraving.depth.nominal)
        yield make_characteristic(
            "engraving_depth",
            "distance",
            engraving.depth,
            make_plane_rule(1, front),
            floor,
            method="microscope, focus",
        )
        yield make_characteristic(
            "engraving_height",
            "note",
            engraving.height,
            label=f"height of the engraved letters, {engraving.describe_position()}",
            method=MICROSCOPE,
        )

    def _yield_hole_characteristics(
        self, mounting: Mounting, lower_face: FaceRule
    ) -> Iterator[Characteristic]:
        """Yield depth and place of the fixing holes, measured at the left one."""
        half_length = self.body.half_length
        half_width = self.body.half_width
        hole = self._make_hole_wall_rule(mounting, -0.5)
        hole_x = -0.5 * mounting.spacing.nominal
        ends: tuple[Rule, Rule]
        if mounting.kind == "tapped":
            label = "depth of the core holes"
            ends = self._make_core_hole_end_rules(mounting, hole)
        else:
            label = "depth of the counterbores"
            wall_x = hole_x + 0.5 * mounting.hole_diameter
            ends = (lower_face, make_plane_rule(2, -mounting.depth.nominal, x=wall_x))
        yield make_characteristic(
            "hole_depth", "distance", mounting.depth, *ends, label=label, method=DEPTH_GAUGE
        )
        left = make_plane_rule(0, -half_length)
        label = "left hole from the left side"
        yield make_location_characteristic("hole_position", label, half_length + hole_x, left, hole)
        front = make_plane_rule(1, -half_width)
        yield make_location_characteristic(
            "hole_row", "holes from the front", half_width, front, hole
        )

    def _make_core_hole_end_rules(
        self, mounting: Mounting, hole_wall: FaceRule
    ) -> tuple[Rule, Rule]:
        """Make rules of both ends of a core hole: the base, and where the drill's point begins."""
        base = self.body.base
        hole_x = -0.5 * mounting.spacing.nominal
        radius = 0.5 * mounting.hole_diameter
        in_point = base + mounting.depth.nominal + 0.2 * radius
        point = FaceRule("CONE", holds={0: hole_x, 2: in_point})
        return make_plane_rule(2, base), EdgeRule(hole_wall, point)

    def _make_thread_characteristic(self, mounting: Mounting) -> Characteristic:
        """State the thread and its least full depth."""
        thread_depth = mounting.thread_depth
        return Characteristic(
            "thread",
            f"thread {mounting.thread}-6H, least full depth",
            "note",
            thread_depth,
            lower=0.0,
            upper=mounting.depth.nominal - thread_depth,
            method="thread plug gauge 6H, go and no-go",
        )

    def check_engraving_and_stock(self) -> Iterator[str]:
        """Yield what keeps the identity from fitting the front, and the block its stock."""
        if self.stock is not None:
            for axis, size, side in zip("xyz", self.stock, self.sides, strict=True):
                if size < side:
                    yield describe_breach(f"stock along {axis}", "hold the block", side, size)
        if self.body.engraving is not None:
            yield from self._yield_letter_breaches(self.body.engraving)

    def _yield_letter_breaches(self, engraving: Engraving) -> Iterator[str]:
        """Yield what keeps the letters from fitting the front."""
        body = self.body
        height = engraving.height.nominal
        edge_breaks = 2.0 * body.edge_break.nominal
        along, up = (abs(offset) for offset in engraving.offset)
        text = engraving.text or self.id
        room = body.length.nominal - edge_breaks - 2.0 * along
        width = compute_text_width(engraving.choose_text(self.id), height)
        if width >= room:
            rule = f"be small enough for {text!r} to fit the front"
            largest = height * max(room, 0.0) / width
            yield describe_breach("body.engraving.height", rule, largest, height)
        # so that the letters stay clear of the working faces
        largest = _LARGEST_LETTERS * (body.thickness.nominal - edge_breaks) - 2.0 * up
        if height >= largest:
            rule = "leave room over and under the letters"
            yield describe_breach("body.engraving.height", rule, largest, height)
