"""A cylinder with a V-groove round it, as those on which clinicians' explorers were tested (Int J Prosthodont 1998;11:591)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

from stepblocks import cad
from stepblocks.contact.counterface import Groove
from stepblocks.parts.characteristics import Characteristic, EdgeRule, FaceRule, broken_edges, plane, toleranced
from stepblocks.parts.declared import MaterialField, below, must, rules_validator, usual
from stepblocks.parts.kind import CONTACT_DEFLECTION, FITTING_DEFLECTION, NANOMETRE, Finding, MeasuredMesh
from stepblocks.parts.revolution import Outline, Turned, stack
from stepblocks.parts.tolerance import Angle, Length, PositiveLength
from stepblocks.quantities import format_quantity


class GroovedCylinder(Turned):
    """A cylinder about z, dragged along; the groove begins half way, at z = 0."""

    stanza: ClassVar[str] = "grooved_cylinder"
    called: ClassVar[str] = "grooved cylinder"
    titled: ClassVar[str] = "Grooved cylinder"
    felt_by: ClassVar[dict[str, str]] = {"width": "groove_width", "flank": "flank_angle"}
    governed_by: ClassVar[str] = "groove_width"
    axes: ClassVar[str] = (
        "the cylinder lies on its side: x along its axis, y around, z outwards; the groove begins at x = 0, the surface lies at z = 0"
    )

    groove_width: PositiveLength = usual(otherwise="2 um")  # between its edges at the surface [m]
    flank_angle: Angle = usual("45 deg")  # of either flank against the surface [rad]
    diameter: PositiveLength = usual("5 mm")  # m
    length: PositiveLength = usual("20 mm")  # from end to end [m]
    edge_break: Length = usual("0.3 mm", otherwise="0.1 mm")  # leg of the 45 degree chamfer on the two ends [m]
    material: MaterialField = usual("stainless")

    def sized(self, **sizes: float) -> Groove:
        return Groove(max(sizes["width"], 0.0), sizes["flank"])

    @property
    def turn_radius(self) -> float | None:
        return 0.5 * self.diameter.nominal

    @property
    def groove_depth(self) -> float:
        """From the surface to the bottom [m]."""
        return 0.5 * self.groove_width.nominal * math.tan(self.flank_angle.nominal)

    def outlines(self) -> list[Outline]:
        R, end, c = 0.5 * self.diameter.nominal, 0.5 * self.length.nominal, self.edge_break.nominal
        width = self.groove_width.nominal
        groove = [(R, 0.0), (R - self.groove_depth, 0.5 * width), (R, width)]
        left, right = [(R - c, -end), (R, c - end)], [(R, end - c), (R - c, end)]
        return [[(0.0, -end), *left[c == 0.0 :], *groove, *right[c == 0.0 :], (0.0, end)]]

    def hulls(self) -> list[Any]:
        return stack(*self.outlines())

    def chordal_error(self, face: cad.kernel.Face) -> float:
        near = face.low[2] >= -1e-6 and face.high[2] <= self.groove_width.nominal + 1e-6
        return CONTACT_DEFLECTION if near and face.kind == "CONE" else FITTING_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        R, end, w = 0.5 * self.diameter.nominal, 0.5 * self.length.nominal, self.groove_width.nominal
        how = "profilometer"
        near, far = (FaceRule("CYLINDER", radius=R, holds={2: z}) for z in (-0.5 * end, 0.5 * end))
        rising, falling = (FaceRule("CONE", holds={2: share * w}) for share in (0.75, 0.25))
        edges = EdgeRule(near, falling), EdgeRule(far, rising)
        yield toleranced("groove_width", "distance", self.groove_width, *edges, method=how)
        flank = self.flank_angle
        cone = replace(flank, nominal=0.5 * math.pi - flank.nominal, lower=-flank.upper, upper=-flank.lower)
        label = "cone of either flank, included"
        whole = toleranced("flank_cone", "angle", cone, falling, label=label, method=how).doubled
        yield replace(whole, states=(flank,))
        yield toleranced("diameter", "diameter", self.diameter, near)
        yield toleranced("length", "distance", self.length, plane(2, -end), plane(2, end))
        edge = EdgeRule(FaceRule("CONE", holds={2: 0.5 * self.edge_break.nominal - end}), near)
        yield broken_edges(self.edge_break, plane(2, -end), edge)

    def measured(self, body: int, mesh: MeasuredMesh) -> Iterator[Finding]:
        radii, heights, R = mesh.radii, mesh.vertices[:, 2], 0.5 * self.diameter.nominal
        on_surface = radii > R - 5.0 * NANOMETRE
        middle = 0.5 * self.groove_width.nominal
        start, end = heights[on_surface & (heights < middle)].max(), heights[on_surface & (heights > middle)].min()
        yield Finding("width of the groove", self.groove_width.nominal, float(end - start), 2.0 * NANOMETRE)
        edge, bottom = radii[abs(heights) < NANOMETRE].max(), radii[abs(heights - middle) < NANOMETRE].min()
        yield Finding("radius at the groove", R, float(edge), 2.0 * NANOMETRE)
        yield Finding("depth of the groove", self.groove_depth, float(edge - bottom), 2.0 * NANOMETRE)

    def close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        wide = 4.0 * self.groove_width.nominal
        return 1.0, wide, (0.5 * self.diameter.nominal, wide, 0.5 * self.groove_width.nominal)

    def derived(self) -> list[list[str]]:
        return [["depth of the groove", format_quantity(self.groove_depth, "length")]]

    @rules_validator
    def _is_possible(self) -> Iterator[str]:
        R, flank, width = 0.5 * self.diameter.nominal, self.flank_angle.nominal, self.groove_width.nominal
        if not 0.0 < flank < math.radians(80.0):
            yield f"flank_angle must lie between 0 and 80 deg, got {format_quantity(flank, 'angle')}"
            return
        room, chamfer = 0.5 * self.length.nominal - self.edge_break.nominal, self.edge_break.nominal
        yield must(2.0 * width < room, "groove_width", "leave a shoulder of its own width", 0.5 * room, width)
        widest = 0.5 * R / math.tan(flank)
        yield below("groove_width", "not cut deeper than an eighth of the diameter", width, widest)
        yield below("edge_break", "be below a quarter of the diameter", chamfer, 0.5 * R)
