"""What every bench block has in common: the body, its fixing holes, its engraved identity."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from stepblocks.parts.lettering import engraved_text, text_width
from stepblocks.parts.material import Material, material_named
from stepblocks.parts.tolerance import Length, PositiveLength
from stepblocks.quantities import format_quantity

# Name of a stimulus: lower-case words and digits joined by hyphens; it becomes a folder and an engraving
Identity = Annotated[str, Field(pattern=r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$", max_length=40)]
MaterialField = Annotated[Material, BeforeValidator(material_named)]

# ISO 261/ISO 2306 core drill, ISO 273 medium clearance, ISO 4762 head: diameter [m] by thread.
_CORE_DRILL = {"M2": 1.6e-3, "M2.5": 2.05e-3, "M3": 2.5e-3, "M4": 3.3e-3}
_CLEARANCE = {"M2": 2.4e-3, "M2.5": 2.9e-3, "M3": 3.4e-3, "M4": 4.5e-3}
_HEAD = {"M2": 4.4e-3, "M2.5": 5.0e-3, "M3": 6.0e-3, "M4": 8.0e-3}
_MAJOR = {"M2": 2.0e-3, "M2.5": 2.5e-3, "M3": 3.0e-3, "M4": 4.0e-3}
DRILL_POINT = math.radians(118.0)  # Included angle of a twist drill's point [rad]


def require_engravable(identity: str, body: Body) -> None:
    """Refuse an identity that does not fit the front of its block."""
    letter, broken = body.engraving.height.nominal, 2.0 * body.edge_break.nominal
    room = body.length.nominal - broken
    width = text_width(engraved_text(identity), letter)
    require(width < room, "engraving.height", f"let {identity!r} fit the front", letter * room / width, letter)
    low = 0.6 * (body.thickness.nominal - broken)
    require(letter < low, "engraving.height", "leave room over and under the letters", low, letter)


def require(holds: bool, field: str, rule: str, limit: float, value: float) -> None:
    """Refuse a length that breaks a rule, naming field, rule, limit and value."""
    if not holds:
        raise ValueError(
            f"{field} must {rule} ({format_quantity(limit, 'length')}), got {format_quantity(value, 'length')}"
        )


class Part(BaseModel):
    """Base of everything declared: frozen, and nothing unknown let through."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)


class Mounting(Part):
    """Two holes on the block's long axis."""

    # ``"tapped"``: blind from below, the working faces stay whole; ``"clearance"``: through, counterbored from above
    kind: Literal["tapped", "clearance"]
    thread: Literal["M2", "M2.5", "M3", "M4"]  # Metric coarse thread, M2 to M4
    spacing: PositiveLength  # Distance between the holes along x [m]
    # Depth of the full core hole from the base [m]; for ``"clearance"`` the depth of the counterbore
    depth: PositiveLength

    @property
    def hole_diameter(self) -> float:
        """Diameter of the core hole or of the clearance hole [m] (ISO 2306, ISO 273 medium)."""
        return (_CORE_DRILL if self.kind == "tapped" else _CLEARANCE)[self.thread]

    @property
    def entry_diameter(self) -> float:
        """Diameter of the countersink at the base, or of the counterbore [m]."""
        return _MAJOR[self.thread] * 1.05 if self.kind == "tapped" else _HEAD[self.thread] + 0.5e-3


class Engraving(Part):
    """The identity cut into the front side of the block."""

    height: PositiveLength  # Height of a capital letter [m]
    depth: PositiveLength  # Depth of the cut [m]


class Body(Part):
    """The block without its stimulus. The origin lies on the working edge, z = 0 on the lower working face."""

    length: PositiveLength  # Extent along x, across the working edge [m]
    width: PositiveLength  # Extent along y, along the working edge [m]
    thickness: PositiveLength  # From the base to the lower working face [m]
    edge_break: Length  # Leg of the 45 degree chamfer on every edge but the working ones [m]
    mounting: Mounting  # Fixing holes
    engraving: Engraving  # Engraved identity

    @model_validator(mode="after")
    def _fits(self) -> Body:
        half = 0.5 * min(self.length.nominal, self.width.nominal, self.thickness.nominal)
        require(
            self.edge_break.nominal < half,
            "edge_break",
            "be smaller than half the smallest side",
            half,
            self.edge_break.nominal,
        )
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
        require(
            holes.depth.nominal < left,
            "mounting.depth",
            "leave a floor over the drill point",
            left,
            holes.depth.nominal,
        )
        require(
            self.engraving.depth.nominal < 0.1 * self.width.nominal,
            "engraving.depth",
            "be below a tenth of the width",
            0.1 * self.width.nominal,
            self.engraving.depth.nominal,
        )
        return self
