"""What every bench block has in common: the body, its fixing holes, its engraved identity."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import model_validator

from stepblocks.parts.characteristics import BREAK, Characteristic, EdgeRule, FaceRule, plane, toleranced
from stepblocks.parts.declared import Table, WorkingFaces, require, require_below
from stepblocks.parts.kind import Part
from stepblocks.parts.lettering import engraved_text, text_width
from stepblocks.parts.tolerance import Length, PositiveLength

# ISO 261/ISO 2306 core drill, ISO 273 medium clearance, ISO 4762 head: diameter [m] by thread.
_CORE_DRILL = {"M2": 1.6e-3, "M2.5": 2.05e-3, "M3": 2.5e-3, "M4": 3.3e-3}
_CLEARANCE = {"M2": 2.4e-3, "M2.5": 2.9e-3, "M3": 3.4e-3, "M4": 4.5e-3}
_HEAD = {"M2": 4.4e-3, "M2.5": 5.0e-3, "M3": 6.0e-3, "M4": 8.0e-3}
_MAJOR = {"M2": 2.0e-3, "M2.5": 2.5e-3, "M3": 3.0e-3, "M4": 4.0e-3}
DRILL_POINT = math.radians(118.0)  # included angle of a twist drill's point [rad]


class Mounting(Table):
    """Two holes on the block's long axis."""

    # ``"tapped"``: blind from below, the working faces stay whole; ``"clearance"``: through, counterbored from above
    kind: Literal["tapped", "clearance"]
    thread: Literal["M2", "M2.5", "M3", "M4"]  # metric coarse thread, M2 to M4
    spacing: PositiveLength  # distance between the holes along x [m]
    # depth of the full core hole from the base [m]; for ``"clearance"`` the depth of the counterbore
    depth: PositiveLength

    @property
    def hole_diameter(self) -> float:
        """Diameter of the core hole or of the clearance hole [m] (ISO 2306, ISO 273 medium)."""
        return (_CORE_DRILL if self.kind == "tapped" else _CLEARANCE)[self.thread]

    @property
    def entry_diameter(self) -> float:
        """Diameter of the countersink at the base, or of the counterbore [m]."""
        return _MAJOR[self.thread] * 1.05 if self.kind == "tapped" else _HEAD[self.thread] + 0.5e-3


class Engraving(Table):
    """The identity cut into the front side of the block."""

    height: PositiveLength  # height of a capital letter [m]
    depth: PositiveLength  # depth of the cut [m]


class Body(Table):
    """The block without its stimulus. The origin lies on the working edge, z = 0 on the lower working face."""

    length: PositiveLength  # extent along x, across the working edge [m]
    width: PositiveLength  # extent along y, along the working edge [m]
    thickness: PositiveLength  # from the base to the lower working face [m]
    edge_break: Length  # leg of the 45 degree chamfer on every edge but the working ones [m]
    mounting: Mounting
    engraving: Engraving

    @model_validator(mode="after")
    def _fits(self) -> Body:
        half = 0.5 * min(self.length.nominal, self.width.nominal, self.thickness.nominal)
        require_below("edge_break", "be smaller than half the smallest side", self.edge_break.nominal, half)
        holes = self.mounting
        reach = holes.spacing.nominal + holes.entry_diameter
        room = self.length.nominal - 2.0 * self.edge_break.nominal
        require(
            reach < room,
            "mounting.spacing",
            "leave the holes inside the base",
            room - holes.entry_diameter,
            holes.spacing.nominal,
        )
        require(
            holes.entry_diameter < holes.spacing.nominal,
            "mounting.spacing",
            "exceed the hole",
            holes.entry_diameter,
            holes.spacing.nominal,
        )
        tip = 0.5 * holes.hole_diameter / math.tan(0.5 * DRILL_POINT) if holes.kind == "tapped" else 0.0
        left = self.thickness.nominal - tip
        require_below("mounting.depth", "leave a floor over the drill point", holes.depth.nominal, left)
        require_below(
            "engraving.depth", "be below a tenth of the width", self.engraving.depth.nominal, 0.1 * self.width.nominal
        )
        return self


class Block(Part):
    """A bench block whose working faces meet at x = 0: the lower one at z = 0, the other higher or lower by the `rise`."""

    has_working_faces: ClassVar[bool] = True

    if TYPE_CHECKING:  # declared by each kind, in the order of its stanza

        @property
        def body(self) -> Body:
            """The block."""

        @property
        def working_faces(self) -> WorkingFaces | None:
            """Stated demands."""

    @property
    @abstractmethod
    def rise(self) -> float:
        """Height of the right working face over the left one [m], of either sign."""

    @abstractmethod
    def top(self, x: float) -> float:
        """Height of its surface at a position across the edge [m], worked out apart from the counterface, to check by."""

    @property
    def filled(self) -> float:
        """Volume of holes and engraving [m^3]."""
        from stepblocks.parts.body_shape import cut_volume

        return cut_volume(self.body, self.id, self.rise)

    def body_characteristics(self, lower: FaceRule) -> Iterator[Characteristic]:
        """List what a workshop must hold of the block itself, `lower` being its lower working face."""
        body = self.body
        half, side, base = 0.5 * body.length.nominal, 0.5 * body.width.nominal, -body.thickness.nominal
        yield toleranced("length", "distance", body.length, plane(0, -half), plane(0, half))
        yield toleranced("width", "distance", body.width, plane(1, -side), plane(1, side))
        yield toleranced("thickness", "distance", body.thickness, plane(2, base), lower)
        spacing, radius = body.mounting.spacing, 0.5 * body.mounting.hole_diameter
        holes = [FaceRule("CYLINDER", radius=radius, holds={0: x * spacing.nominal}) for x in (-0.5, 0.5)]
        yield toleranced("hole_spacing", "distance", spacing, *holes, method="coordinate measuring machine")
        c = body.edge_break.nominal
        if c > 0.0:  # of all edges alike, measured at the one along the base on the right
            broken = FaceRule("SLOPE", holds={0: half - 0.5 * c, 1: 0.0, 2: base + 0.5 * c})
            at = plane(0, half), EdgeRule(broken, plane(2, base))
            yield toleranced("edge_break", "distance", body.edge_break, *at, label=BREAK)
        else:
            yield toleranced("edge_break", "note", body.edge_break, label=BREAK)
        depth = body.engraving.depth
        yield toleranced("engraving_depth", "distance", depth, plane(1, -side), plane(1, -side + depth.nominal))

    def require_engravable(self) -> None:
        """Refuse an identity that does not fit the front of the block."""
        body, letter = self.body, self.body.engraving.height.nominal
        broken = 2.0 * body.edge_break.nominal
        room = body.length.nominal - broken
        width = text_width(engraved_text(self.id), letter)
        require(width < room, "engraving.height", f"let {self.id!r} fit the front", letter * room / width, letter)
        low = 0.6 * (body.thickness.nominal - broken)
        require_below("engraving.height", "leave room over and under the letters", letter, low)
