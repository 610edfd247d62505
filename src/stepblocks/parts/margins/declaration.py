"""The junction of crown and tooth in the terms of Holmes et al. (1989), as a bench block and as a body of revolution.

Seen in a section through the tooth's axis, x runs along the path of draw from the root to the crown and z outwards. The
cavosurface angle of the tooth, where its finish line meets its outer surface, is the origin; the tooth's outer surface is z = 0.
The margin of the crown is the corner (v, h):

- marginal gap g: between the crown's fitting surface and the finish line, measured across the opening;
- vertical discrepancy v: from the cavosurface angle to the crown's margin along the path of draw. It equals g where the crown ends
  square; larger, its margin is bevelled back at 45 degrees; smaller, a lip narrows the gap; negative, the lip has slid over the tooth;
- horizontal discrepancy h: outwards; positive is an overextended margin, negative an underextended one;
- absolute marginal discrepancy: the hypotenuse of v and h.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from pydantic import model_validator

from stepblocks.parts.body import Body, Identity, MaterialField, Part, require, require_engravable
from stepblocks.parts.tolerance import Angle, Dimension, Length, PositiveLength, SignedLength
from stepblocks.parts.working_faces import FaceDemands, WorkingFaces, face_demands
from stepblocks.quantities import format_quantity

if TYPE_CHECKING:
    from stepblocks.contact.counterface import Counterface

# Largest absolute marginal discrepancy that is clinically acceptable [m] (the paper; McLean and von Fraunhofer 1971
# say 120 um)
CLINICAL_LIMIT = 100e-6


def crown_corner(gap: float, vertical: float, horizontal: float) -> list[tuple[float, float]]:
    """Outline of the crown's margin from inside the gap to its outer corner."""
    if vertical < 0.0:
        return [(gap, gap), (vertical, gap), (vertical, horizontal)]
    if vertical == gap:
        return [(gap, horizontal)]
    return [(gap, horizontal - abs(vertical - gap)), (vertical, horizontal)]


class _Margin(Part):
    """What both forms share."""

    id: Identity  # Identity
    marginal_gap: PositiveLength  # Marginal gap g [m]
    # Horizontal marginal discrepancy h [m]; positive where the crown is overextended
    horizontal_discrepancy: SignedLength
    # Vertical marginal discrepancy v [m]; the marginal gap where the file does not give it
    vertical_discrepancy: SignedLength | None = None
    material: MaterialField  # What it is made of

    @property
    def opening(self) -> Dimension:
        """The vertical discrepancy in force: the one stated, or the marginal gap."""
        return self.marginal_gap if self.vertical_discrepancy is None else self.vertical_discrepancy

    @property
    def absolute_discrepancy(self) -> float:
        """Absolute marginal discrepancy [m]: from the crown's margin to the cavosurface angle."""
        return math.hypot(self.opening.nominal, self.horizontal_discrepancy.nominal)

    @property
    def clinically_acceptable(self) -> bool:
        """Whether the absolute marginal discrepancy is at most 100 um."""
        return self.absolute_discrepancy <= CLINICAL_LIMIT * (1.0 + 1e-12)

    def _across(self, depth: float, fall: float) -> Counterface:
        """Tooth, gap and crown at nominal size, x from the tooth to the crown; depth [m] and fall [1] of the gap's floor."""
        from stepblocks.contact.counterface import Margin

        gap, opening, rise = self.marginal_gap.nominal, self.opening.nominal, self.horizontal_discrepancy.nominal
        return Margin(gap, opening, rise, depth, fall)

    @property
    def corner(self) -> list[tuple[float, float]]:
        """Outline of the crown's margin, see `crown_corner` [m]."""
        return crown_corner(self.marginal_gap.nominal, self.opening.nominal, self.horizontal_discrepancy.nominal)

    @model_validator(mode="after")
    def _lip_clears_the_tooth(self) -> _Margin:
        v, g, h = self.opening.nominal, self.marginal_gap.nominal, self.horizontal_discrepancy.nominal
        if v < 0.0 and h <= g:
            raise ValueError(
                "horizontal_discrepancy must exceed marginal_gap "
                f"({format_quantity(g, 'length')}) where vertical_discrepancy is negative, got {format_quantity(h, 'length')}"
            )
        return self


class MarginBlock(_Margin):
    """A bench block: the tooth's outer surface at z = 0 and x < 0, the crown's at z = h beyond the gap."""

    gap_depth: PositiveLength  # Depth of the gap below the tooth's surface [m]
    body: Body  # The block
    # Flatness, parallelism and roughness of tooth and crown face, where the file states them
    working_faces: WorkingFaces | None = None

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Across the edge."""
        return self._across(self.gap_depth.nominal, 0.0)

    @property
    def face_demands(self) -> FaceDemands:
        """Flatness, parallelism and roughness in force."""
        return face_demands(self.working_faces, self.horizontal_discrepancy.upper - self.horizontal_discrepancy.lower)

    @model_validator(mode="after")
    def _fits_the_body(self) -> MarginBlock:
        body, g, v = self.body, self.marginal_gap.nominal, self.opening.nominal
        h, depth, chamfer = self.horizontal_discrepancy.nominal, self.gap_depth.nominal, self.body.edge_break.nominal
        room = 0.5 * body.length.nominal - chamfer
        require(g < 0.5 * room, "marginal_gap", "be narrower than a quarter of the body", 0.5 * room, g)
        require(
            abs(v) < 0.5 * room, "vertical_discrepancy", "be smaller than a quarter of the body", 0.5 * room, abs(v)
        )
        require(
            depth < 0.25 * body.thickness.nominal,
            "gap_depth",
            "be below a quarter of the thickness",
            0.25 * body.thickness.nominal,
            depth,
        )
        require_engravable(self.id, body)
        deepest = abs(v - g) - h if v >= 0.0 else -h
        require(deepest < depth, "gap_depth", "reach below the margin", deepest, depth)
        require(
            abs(h) < chamfer or chamfer == 0.0, "horizontal_discrepancy", "be smaller than edge_break", chamfer, abs(h)
        )
        return self


class FinishLine(Part):
    """How the preparation ends."""

    # ``"shoulder"`` (a square ledge), ``"chamfer"`` (a quarter round) or ``"feather-edge"`` (no ledge)
    kind: Literal["shoulder", "chamfer", "feather-edge"]
    width: Length  # Width of the ledge, or radius of the quarter round [m]; 0 for the feather edge

    @model_validator(mode="after")
    def _has_the_width_of_its_kind(self) -> FinishLine:
        if (self.width.nominal == 0.0) != (self.kind == "feather-edge"):
            rule = "be 0 for a feather-edge" if self.kind == "feather-edge" else f"be above 0 for a {self.kind}"
            raise ValueError(f"width must {rule}, got {format_quantity(self.width.nominal, 'length')}")
        return self


class CrownOnTooth(_Margin):
    """A prepared tooth and its crown, both bodies of revolution about the path of draw."""

    margin_radius: PositiveLength  # Outer radius of the tooth at the finish line [m]
    finish_line: FinishLine  # Shoulder, chamfer or feather edge
    taper: Angle  # Angle between the axial wall and the path of draw [rad] (half the total convergence)
    preparation_height: PositiveLength  # From the finish line to the top of the preparation [m]
    root_length: PositiveLength  # From the finish line down to the base [m]
    internal_gap: Length  # Between the axial wall and the crown, across the wall [m]
    shell_thickness: PositiveLength  # Thickness of the crown over the top of the preparation [m]

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Along the path of draw, z outwards from the tooth's outer surface."""
        return self._across(self.finish_line.width.nominal, math.tan(self.taper.nominal))

    @property
    def wall_thickness(self) -> float:
        """Thickness of the crown's wall across the path of draw at its fitting end [m]."""
        g, finish = self.marginal_gap.nominal, self.finish_line
        height = (
            self.opening.nominal
            if finish.kind == "feather-edge"
            else g + (finish.width.nominal if finish.kind == "chamfer" else 0.0)
        )
        gap = g if finish.kind == "feather-edge" else self.internal_gap.nominal
        inner = -finish.width.nominal - height * math.tan(self.taper.nominal) + gap / math.cos(self.taper.nominal)
        return self.horizontal_discrepancy.nominal - inner

    @model_validator(mode="after")
    def _fits_the_tooth(self) -> CrownOnTooth:
        h, g, v = self.horizontal_discrepancy.nominal, self.marginal_gap.nominal, self.opening.nominal
        R, finish, height = self.margin_radius.nominal, self.finish_line, self.preparation_height.nominal
        if self.taper.nominal >= math.radians(45.0):
            raise ValueError(f"taper must be less than 45 deg, got {format_quantity(self.taper.nominal, 'angle')}")
        top = R - finish.width.nominal - height * math.tan(self.taper.nominal)
        require(
            top > 0.1 * R, "preparation_height", "leave the preparation a top of a tenth of margin_radius", 0.1 * R, top
        )
        require(
            self.internal_gap.nominal < 0.5 * R,
            "internal_gap",
            "be below half of margin_radius",
            0.5 * R,
            self.internal_gap.nominal,
        )
        wall = self.wall_thickness
        require(wall > 0.0, "horizontal_discrepancy", "leave the crown a wall at its margin", h - wall, h)
        require(
            h <= self.shell_thickness.nominal,
            "horizontal_discrepancy",
            "not exceed the shell (overextension beyond shell_thickness)",
            self.shell_thickness.nominal,
            h,
        )
        if finish.kind == "feather-edge" and self.taper.nominal == 0.0:
            raise ValueError(
                "taper must exceed 0 deg for a feather-edge, whose finish line is where the taper begins, got 0 deg"
            )
        bevel = abs(v - g) if v >= 0.0 and finish.kind != "feather-edge" else 0.0
        require(bevel < wall, "vertical_discrepancy", "leave a wall behind the bevel of the margin", g + wall, v)
        if v < 0.0 and finish.kind == "feather-edge":
            raise ValueError(
                f"vertical_discrepancy must not be negative for a feather-edge, got {format_quantity(v, 'length')}"
            )
        require(
            max(g, v) + finish.width.nominal < height,
            "preparation_height",
            "exceed the finish line",
            max(g, v) + finish.width.nominal,
            height,
        )
        return self
