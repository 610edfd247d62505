"""The body of a bench block with fixing holes and engraving: solid, pieces, volume."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field

from stepblocks import cad
from stepblocks.parts.characteristics import (
    DEPTH_GAUGE,
    MACHINE,
    MICROSCOPE,
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    describe_plane,
    make_characteristic,
    make_edge_break,
    make_location,
    make_surface_characteristics,
)
from stepblocks.parts.declared import (
    Table,
    WorkingFaces,
    check_below,
    check_rule,
    declare_default,
    make_rules_validator,
    read_none,
    read_positive,
)
from stepblocks.parts.kind import Part
from stepblocks.parts.lettering import compute_text_width, outline_text
from stepblocks.parts.revolution import Point, Point3
from stepblocks.parts.tolerance import Dimension, Length, PositiveLength

# by thread: core drill (ISO 261, ISO 2306), medium clearance (ISO 273), head (ISO 4762), major
# diameter [m]
_THREADS = {
    "M2": (1.6e-3, 2.4e-3, 4.4e-3, 2.0e-3),
    "M2.5": (2.05e-3, 2.9e-3, 5.0e-3, 2.5e-3),
    "M3": (2.5e-3, 3.4e-3, 6.0e-3, 3.0e-3),
    "M4": (3.3e-3, 4.5e-3, 8.0e-3, 4.0e-3),
}
DRILL_POINT = math.radians(118.0)  # included angle of a twist drill's point [rad]
OVER = 1e-3  # how far a cutting body stands out of the block [m]


class Mounting(Table):
    """Two holes on the block's long axis."""

    # ``"tapped"``: blind from below, the working faces stay whole; ``"clearance"``: through,
    # counterbored from above
    kind: Literal["tapped", "clearance"] = "tapped"
    thread: Literal["M2", "M2.5", "M3", "M4"] = "M3"  # metric coarse
    spacing: PositiveLength = declare_default("12 mm")  # of the holes along x [m]
    # of the full core hole from the base, or of the counterbore [m]
    depth: PositiveLength = declare_default("5 mm")

    @property
    def hole_diameter(self) -> float:
        """Diameter of the core hole or of the clearance hole [m]."""
        core, clearance, _, _ = _THREADS[self.thread]
        return core if self.kind == "tapped" else clearance

    @property
    def thread_depth(self) -> float:
        """Least depth of full thread [m]: the hole is 1.25 times as deep (ISO 6410-1, 5.2.3)."""
        return self.depth.nominal / 1.25

    @property
    def entry_diameter(self) -> float:
        """Diameter of the countersink at the base, or of the counterbore [m]."""
        _, _, head, major = _THREADS[self.thread]
        return major * 1.05 if self.kind == "tapped" else head + 0.5e-3


class Engraving(Table):
    """The identity cut into the front side of the block."""

    height: PositiveLength = declare_default("1.3 mm")  # of a capital letter [m]
    depth: PositiveLength = declare_default("0.15 mm", otherwise="0.05 mm")  # of the cut [m]


class Body(Table):
    """The block without its stimulus; the origin lies on the working edge."""

    # the usual one fits a 24 mm vice
    length: PositiveLength = declare_default("20 mm")  # along x, across the working edge [m]
    width: PositiveLength = declare_default("24 mm")  # along y [m]
    # from the base to the lower working face [m]
    thickness: PositiveLength = declare_default("8 mm")
    # leg of the chamfer on all edges but the working ones [m]
    edge_break: Length = declare_default("0.3 mm", otherwise="0.1 mm")
    mounting: Annotated[Mounting | None, BeforeValidator(read_none)] = declare_default({})
    engraving: Annotated[Engraving | None, BeforeValidator(read_none)] = declare_default({})

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
    def _check_fit(self) -> Iterator[str]:
        length, width, thickness = self.length.nominal, self.width.nominal, self.thickness.nominal
        holes = self.mounting
        chamfer = self.edge_break.nominal
        half = 0.5 * min(length, width, thickness)
        room = length - 2.0 * chamfer
        yield check_below("edge_break", "be smaller than half the smallest side", chamfer, half)
        if self.engraving is not None:
            yield check_below(
                "engraving.depth",
                "be below a tenth of the width",
                self.engraving.depth.nominal,
                0.1 * width,
            )
        if holes is None:
            return
        spacing, entry = holes.spacing.nominal, holes.entry_diameter
        yield check_rule(
            spacing + entry < room,
            "mounting.spacing",
            "leave the holes inside the base",
            room - entry,
            spacing,
        )
        yield check_rule(entry < spacing, "mounting.spacing", "exceed the hole", entry, spacing)
        tip = (
            0.5 * holes.hole_diameter / math.tan(0.5 * DRILL_POINT)
            if holes.kind == "tapped"
            else 0.0
        )
        yield check_below(
            "mounting.depth",
            "leave a floor over the drill point",
            holes.depth.nominal,
            thickness - tip,
        )


# along x, y and z [m]
Stock = Annotated[
    tuple[Annotated[float, read_positive("length")], ...], Field(min_length=3, max_length=3)
]


class Block(Part):
    """A bench block whose working faces meet at x = 0.

    The lower face is at z = 0, the other one higher or lower by the `rise`.
    """

    has_working_faces: ClassVar[bool] = True

    if TYPE_CHECKING:  # declared by each kind, in the order of its stanza
        body: Body
        stock: Stock | None
        working_faces: WorkingFaces | None

    @property
    def rise(self) -> float:
        """Height of the right working face over the left one [m], of either sign."""
        height: Dimension = getattr(self, self.governing_field)
        return height.nominal

    @property
    def sides(self) -> Point3:
        """Sizes along x, y and z [m]."""
        body = self.body
        return (
            body.length.nominal,
            body.width.nominal,
            body.thickness.nominal + max(self.rise, 0.0),
        )

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
        mounting = self.body.mounting
        if mounting is None:
            return 0.0
        drill, entry = 0.5 * mounting.hole_diameter, 0.5 * mounting.entry_diameter
        depth = mounting.depth.nominal
        if mounting.kind == "tapped":
            sink = entry - drill
            frustum = math.pi * sink * (entry * entry + entry * drill + drill * drill) / 3.0
            point = math.pi * drill**3 / (3.0 * math.tan(0.5 * DRILL_POINT))
            return 2.0 * (frustum + math.pi * drill * drill * (depth - sink) + point)
        bore = self.body.thickness.nominal - depth
        return math.fsum(
            math.pi * (drill * drill * bore + entry * entry * (depth + top))
            for top in (0.0, self.rise)
        )

    def _compute_engraved_volume(self) -> float:
        engraving = self.body.engraving
        if engraving is None:
            return 0.0
        import shapely

        area = math.fsum(
            shapely.Polygon(outer, inner).area
            for outer, *inner in outline_text(self.id.upper(), engraving.height.nominal)
        )
        return area * engraving.depth.nominal

    def extrude_section(self, crest: cad.door.Outline) -> cad.door.Body:
        """Extrude the section; `crest` is its outline from the right face to the left one."""
        body = self.body
        rise = self.rise
        half, base, c = body.half_length, body.base, body.edge_break.nominal
        right = dict.fromkeys(
            [(half - c, base), (half, base + c), (half, rise - c), (half - c, rise)]
        )
        left = dict.fromkeys([(-half + c, 0.0), (-half, -c), (-half, base + c), (-half + c, base)])
        return cad.kernel.make_prism([*right, *crest, *left], body.width.nominal)

    def list_body_characteristics(
        self, lower: FaceRule, upper: FaceRule, edge: Rule | None
    ) -> Iterator[Characteristic]:
        """List the characteristics of the body.

        `lower` and `upper` are the working faces, `edge` is the wall of the edge, if there is
        one.
        """
        body, mounting, engraving = self.body, self.body.mounting, self.body.engraving
        half, side, base = body.half_length, body.half_width, body.base
        yield make_characteristic(
            "length", "distance", body.length, describe_plane(0, -half), describe_plane(0, half)
        )
        yield make_characteristic(
            "width", "distance", body.width, describe_plane(1, -side), describe_plane(1, side)
        )
        yield make_characteristic(
            "thickness", "distance", body.thickness, describe_plane(2, base), lower
        )
        holes = [
            FaceRule("CYLINDER", radius=0.5 * one.hole_diameter, holds={0: x * one.spacing.nominal})
            for one in filter(None, [mounting])
            for x in (-0.5, 0.5)
        ]
        if mounting is not None:
            yield make_characteristic(
                "hole_spacing", "distance", mounting.spacing, *holes, method=MACHINE
            )
        c = body.edge_break.nominal
        # of all edges alike, measured at the one along the base on the right
        slope = FaceRule("SLOPE", holds={0: half - 0.5 * c, 1: 0.0, 2: base + 0.5 * c})
        yield make_edge_break(
            body.edge_break, describe_plane(0, half), EdgeRule(slope, describe_plane(2, base))
        )
        if engraving is not None:
            yield make_characteristic(
                "engraving_depth",
                "distance",
                engraving.depth,
                describe_plane(1, -side),
                describe_plane(1, -side + engraving.depth.nominal),
                method="microscope, focus",
            )
            yield make_characteristic(
                "engraving_height",
                "note",
                engraving.height,
                label="height of the engraved letters, middle of the front",
                method=MICROSCOPE,
            )
        if mounting is not None:
            yield from self._list_hole_characteristics(mounting, holes[0], lower)
        if edge is not None:
            yield make_location(
                "edge_position",
                "working edge from the left side",
                half,
                describe_plane(0, -half),
                edge,
            )
        yield from make_surface_characteristics(
            self.face_demands, lower, upper, describe_plane(2, base)
        )
        if mounting is not None and mounting.kind == "tapped":
            full = mounting.thread_depth
            yield Characteristic(
                "thread",
                f"thread {mounting.thread}-6H, least full depth",
                "note",
                full,
                lower=0.0,
                upper=mounting.depth.nominal - full,
                method="thread plug gauge 6H, go and no-go",
            )

    def _list_hole_characteristics(
        self, mounting: Mounting, hole: FaceRule, lower: FaceRule
    ) -> Iterator[Characteristic]:
        # List depth and place of the fixing holes, measured at the left one
        half, side, base = self.body.half_length, self.body.half_width, self.body.base
        radius = 0.5 * mounting.hole_diameter
        at = -0.5 * mounting.spacing.nominal
        deep = mounting.depth.nominal
        ends: tuple[Rule, Rule] = lower, describe_plane(2, -deep, x=at + radius)
        if tapped := mounting.kind == "tapped":  # down to where the drill's point begins
            ends = (
                describe_plane(2, base),
                EdgeRule(hole, FaceRule("CONE", holds={0: at, 2: base + deep + 0.2 * radius})),
            )
        yield make_characteristic(
            "hole_depth",
            "distance",
            mounting.depth,
            *ends,
            label="depth of the core holes" if tapped else "depth of the counterbores",
            method=DEPTH_GAUGE,
        )
        yield make_location(
            "hole_position",
            "left hole from the left side",
            half + at,
            describe_plane(0, -half),
            hole,
        )
        yield make_location(
            "hole_row", "holes from the front", side, describe_plane(1, -side), hole
        )

    def require_engravable(self) -> Iterator[str]:
        """Refuse an identity that does not fit the front, and stock that is too small."""
        body, engraving = self.body, self.body.engraving
        for axis, given, least in zip("xyz", self.stock or (), self.sides, strict=False):
            yield check_rule(given >= least, f"stock along {axis}", "hold the block", least, given)
        if engraving is None:
            return
        letter = engraving.height.nominal
        broken = 2.0 * body.edge_break.nominal
        room = body.length.nominal - broken
        width = compute_text_width(self.id.upper(), letter)
        yield check_rule(
            width < room,
            "body.engraving.height",
            f"be small enough for {self.id!r} to fit the front",
            letter * room / width,
            letter,
        )
        yield check_below(
            "body.engraving.height",
            "leave room over and under the letters",
            letter,
            0.6 * (body.thickness.nominal - broken),
        )


def make_body_cuts(body: Body, identity: str, rise: float) -> list[cad.door.Body]:
    """Bodies to cut from a block: edge breaks along x and z, holes, engraving."""
    cuts = list(_make_edge_breaks(body, rise)) if body.edge_break.nominal > 0.0 else []
    if body.mounting is not None:
        cuts += [_make_hole(body, body.mounting, side) for side in (-0.5, 0.5)]
    if body.engraving is None:
        return cuts
    middle, start = -0.5 * body.thickness.nominal, -body.half_width - 0.1 * OVER
    into = (0.0, body.engraving.depth.nominal + 0.1 * OVER, 0.0)
    for outlines in outline_text(identity.upper(), body.engraving.height.nominal):
        outer, *holes = (
            [(float(u), start, middle + float(v)) for u, v in outline] for outline in outlines
        )
        cuts.append(cad.kernel.extrude(outer, into, holes))
    return cuts


def _make_edge_breaks(body: Body, rise: float) -> Iterator[cad.door.Body]:
    half, wide, base, c = body.half_length, body.half_width, body.base, body.edge_break.nominal
    long, high = half + OVER, body.thickness.nominal + max(rise, 0.0) + 2.0 * OVER
    along = (-long, 0.0, 0.0, 1.0), (0.0, long, rise, 1.0), (-long, long, base, -1.0)
    for side in (-1.0, 1.0):
        y = side * wide
        near, far = y - side * (c + OVER), y + side * OVER
        for x0, x1, z, up in along:
            section = [(far, z - up * c - up * OVER), (near, z + up * OVER), (far, z + up * OVER)]
            yield cad.kernel.extrude([(x0, *point) for point in section], (x1 - x0, 0.0, 0.0))
        for end in (-1.0, 1.0):
            x = end * half
            corner = [(x + end * OVER, near), (x - end * (c + OVER), far), (x + end * OVER, far)]
            yield cad.kernel.extrude([(*point, base - OVER) for point in corner], (0.0, 0.0, high))


def _make_hole(body: Body, holes: Mounting, side: float) -> cad.door.Body:
    base, depth = body.base, holes.depth.nominal
    x = side * holes.spacing.nominal
    drill, entry = 0.5 * holes.hole_diameter, 0.5 * holes.entry_diameter
    if holes.kind == "tapped":
        sink, point = entry - drill, drill / math.tan(0.5 * DRILL_POINT)  # 90 degree countersink
        outline = [
            (0.0, -OVER),
            (entry + OVER, -OVER),
            (drill, sink),
            (drill, depth),
            (0.0, depth + point),
        ]
        return cad.kernel.turn(outline, (x, 0.0, base))
    outline = [
        (0.0, base - OVER),
        (drill, base - OVER),
        (drill, -depth),
        (entry, -depth),
        (entry, OVER),
    ]
    return cad.kernel.turn([*outline, (0.0, OVER)], (x, 0.0, 0.0))


def list_half_corners(body: Body, side: float, top: float, crest: Sequence[Point]) -> list[Point3]:
    """Corners of one chamfered half outwards from x = 0, its top there a crest of (x, z) points."""
    out, half = side * body.half_length, body.half_width
    base, c = body.base, body.edge_break.nominal
    points: list[Point3] = []
    for y in (-1.0, 1.0):
        for z, inset in ((base, c), (base + c, 0.0), (top - c, 0.0), (top, c)):
            corner = max(c - 2.0 * inset, 0.0)
            x, w = out - side * inset, half - inset
            points += [(x - side * corner, y * w, z), (x, y * (w - corner), z)]
            if z < top:
                points.append((0.0, y * w, z))
        points += [(x, y * (half - max(0.0, z - (top - c))), z) for x, z in crest]
        # where a chamfer's corner triangle closes, half way up
        points += [
            (out - side * 0.5 * c, y * (half - 0.5 * c), z) for z in (base + 0.5 * c, top - 0.5 * c)
        ]
    return points


def compute_half_volume(body: Body, extent: float, top: float) -> float:
    """Compute the volume of a block on one side of its edge [m^3].

    It is a box with every edge broken but the four at the section.
    """
    width, c = body.width.nominal, body.edge_break.nominal
    height = top + body.thickness.nominal

    # the slice at an inset s from the chamfers is (extent - s)(width - 2 s) less two triangles of
    # leg c - 2 s
    def rectangle(s: float) -> float:  # antiderivative of that product
        return extent * width * s - (2.0 * extent + width) * s * s / 2.0 + 2.0 * s**3 / 3.0

    # two corner triangles, leg^2 / 2 each; the leg vanishes at s = c / 2: c^3 / 6 at a chamfer
    return (height - 2.0 * c) * (extent * width - c * c) + 2.0 * (rectangle(c) - c**3 / 6.0)


def compute_strip_volume(body: Body, top: float, polygon: list[Point]) -> float:
    """Compute the volume that a section polygon (x, z) takes out of a half [m^3].

    The sides are chamfered: a contour integral of W(z) x dz.
    """
    width, c = body.width.nominal, body.edge_break.nominal
    total = 0.0
    knee = top - c
    for (x0, z0), (x1, z1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        knees = [(knee - z0) / (z1 - z0)] if z1 != z0 else []
        cuts = [0.0, *(at for at in knees if 0.0 < at < 1.0), 1.0]
        for a, b in itertools.pairwise(cuts):
            (xa, za), (xb, zb) = ((x0 + t * (x1 - x0), z0 + t * (z1 - z0)) for t in (a, b))
            mid = 0.5 * (za + zb)
            values = [
                (width - 2.0 * max(z - knee, 0.0)) * x
                for x, z in ((xa, za), (0.5 * (xa + xb), mid), (xb, zb))
            ]
            # Simpson, exact for a quadratic
            total += (zb - za) * (values[0] + 4.0 * values[1] + values[2]) / 6.0
    return abs(total)
