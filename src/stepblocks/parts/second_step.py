"""A second step of a block: another working edge, parallel to the first, on its upper face."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

from stepblocks import cad
from stepblocks.contact import Array
from stepblocks.contact.counterface import Step
from stepblocks.parts.body import Body
from stepblocks.parts.characteristics import (
    PROFILE,
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    make_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    FaceDemands,
    Table,
    declare_default,
    describe_breach,
)
from stepblocks.parts.face_characteristics import (
    make_edge_characteristics,
    make_form_characteristics,
)
from stepblocks.parts.tolerance import Length, PositiveLength

# Length of a working face on either side of the second edge [m]: a ball of 1 mm rides on the edge
# of a step of 0.3 mm from 0.8 mm before it, and a profilometer levels on 1 mm
_LEAST_FACE = 2e-3
# of the keys of characteristics, as of a first edge
SECOND = "second_"


class SecondStep(Table):
    """A step along the whole width, which begins on the upper face of the first one.

    Attributes
    ----------
    height : Dimension
        Height between the faces beside it [m].
    distance : Dimension
        Distance from the working edge [m].
    edge_radius : Dimension
        Radius of the edge at its higher side [m]; 0 is sharp.
    direction : str
        ``"up"``, away from the first edge, or ``"down"``, so that the face between both stands
        out.
    """

    height: PositiveLength = declare_default(otherwise="1 um")
    distance: PositiveLength = declare_default(otherwise="0.1 mm")
    edge_radius: Length = declare_default("0 um", otherwise="+2 um / -0 um")
    direction: Literal["up", "down"] = "up"

    @property
    def rise(self) -> float:
        """Height of the face behind it over the face before it [m], of either sign."""
        if self.direction == "up":
            return self.height.nominal
        return -self.height.nominal

    def outline_section(self, height_before: float) -> cad.door.Outline:
        """Outline it as (x, z) [m], from the face behind it to that before it."""
        x = self.distance.nominal
        behind = height_before + self.rise
        radius = self.edge_radius.nominal
        sharp_root = radius < self.height.nominal
        bow = radius * (1.0 - math.sqrt(0.5))
        outline: list[object]
        if self.direction == "up":
            outline = [(x + radius, behind)]
            if radius > 0.0:
                outline.append(((x + bow, behind - bow), (x, behind - radius)))
            if sharp_root:
                outline.append((x, height_before))
            return outline
        outline = []
        if sharp_root:
            outline.append((x, behind))
        outline.append((x, height_before - radius))
        if radius > 0.0:
            outline.append(((x - bow, height_before - bow), (x - radius, height_before)))
        return outline

    @property
    def corner_positions(self) -> tuple[float, ...]:
        """Where the surface has corners at it [m]."""
        x = self.distance.nominal
        radius = self.edge_radius.nominal
        if radius == 0.0:
            return (x,)
        if self.direction == "up":
            return (x, x + radius)
        return (x - radius, x)

    def sample_rise(self, x: Array) -> Array:
        """Sample what the surface rises over the face before it, or falls with a negative sign."""
        step = Step(self.height.nominal, self.edge_radius.nominal)
        past = x - self.distance.nominal
        if self.direction == "up":
            return step.heights(past)
        return step.heights(-past) - self.height.nominal

    def top(self, x: float, height_before: float) -> float:
        """Compute the height of the surface at `x` [m], right of the first edge's rounding."""
        radius = self.edge_radius.nominal
        behind = height_before + self.rise
        past = x - self.distance.nominal
        if self.direction == "up":
            if past < 0.0:
                return height_before
            return behind - radius + _compute_arc_rise(past, radius)
        if past >= 0.0:
            return behind
        return height_before - radius + _compute_arc_rise(-past, radius)

    def yield_characteristics(
        self,
        body: Body,
        demands: FaceDemands,
        face_before: FaceRule,
        height_before: float,
        first_riser: Rule | None,
    ) -> Iterator[Characteristic]:
        """Make what is asked of it, with the keys of a first edge after `SECOND`.

        Parameters
        ----------
        body : Body
            The block without its steps.
        demands : dict of str to Dimension
            Demands on the face behind it.
        face_before : FaceRule
            The face before it.
        height_before : float
            Of that face over the lower one [m].
        first_riser : FaceRule or None
            Riser of the first step; None where it is all rounding.

        Yields
        ------
        Characteristic
        """
        x = self.distance.nominal
        behind = make_plane_rule(2, height_before + self.rise, x=0.5 * (x + body.half_length))
        middle = height_before + 0.5 * self.rise
        wall = None
        if self.edge_radius.nominal < self.height.nominal:
            wall = make_plane_rule(0, x, z=self._find_riser_middle(height_before))
        yield make_characteristic(
            "second_step_height",
            "distance",
            self.height,
            face_before,
            behind,
            label=f"second step height, {self.direction}",
            method=PROFILE,
        )
        yield self._make_edge_radius_characteristic(x, middle, face_before, behind)
        if wall is not None and first_riser is not None:
            yield make_characteristic(
                "second_step_distance",
                "distance",
                self.distance,
                first_riser,
                wall,
                label="second edge from the working edge",
                method="profilometer",
            )
        yield from self._yield_face_and_edge_characteristics(
            body, demands, behind, wall, face_before
        )

    def _make_edge_radius_characteristic(
        self, x: float, riser_middle: float, face_before: FaceRule, face_behind: FaceRule
    ) -> Characteristic:
        """State the radius of its edge at `x`, whose riser has its middle at a height [m]."""
        radius = self.edge_radius.nominal
        high = face_behind if self.direction == "up" else face_before
        edge: Rule = EdgeRule(make_plane_rule(0, x, z=riser_middle), high)
        if radius > 0.0:
            side = 0.5 if self.direction == "up" else -0.5
            edge = FaceRule("CYLINDER", radius=radius, holds={0: x + side * radius})
        return make_characteristic(
            "second_edge_radius",
            "radius",
            self.edge_radius,
            edge,
            method="profilometer, arc fit",
        )

    def _find_riser_middle(self, height_before: float) -> float:
        """Find the middle of its riser under the rounding [m]; the face before it at a height."""
        low = min(height_before, height_before + self.rise)
        return low + 0.5 * (self.height.nominal - self.edge_radius.nominal)

    def _yield_face_and_edge_characteristics(
        self,
        body: Body,
        demands: FaceDemands,
        face_behind: FaceRule,
        riser: FaceRule | None,
        face_before: FaceRule,
    ) -> Iterator[Characteristic]:
        """Yield form of the face behind it, and burr, angle and straightness of its edge."""
        chamfer = body.edge_break.nominal
        extent = (
            body.half_length - self.distance.nominal - chamfer,
            body.width.nominal - 2.0 * chamfer,
        )
        # the datum A of parallelism is the lower face of the block
        lower = make_plane_rule(2, 0.0, x=-0.5 * body.half_length)
        for form in make_form_characteristics(
            demands, lower, face_behind, "lower face", "second face"
        ):
            if form.key != "flatness_lower":
                yield replace(form, key=SECOND + form.key, extent=extent)
        foot = face_before if self.direction == "up" else face_behind
        for state in make_edge_characteristics(demands["burr"], riser, foot):
            yield replace(state, key=SECOND + state.key, label=f"second edge: {state.label}")

    def yield_breaches(self, body: Body, step_height: float) -> Iterator[str]:
        """Yield what keeps it from fitting the upper face; `step_height` of the first step [m]."""
        distance = self.distance.nominal
        if distance < _LEAST_FACE:
            rule = "leave a working face between both edges"
            yield describe_breach("second_step.distance", rule, _LEAST_FACE, distance)
        farthest = body.half_length - body.edge_break.nominal - _LEAST_FACE
        if distance > farthest:
            rule = "leave a working face behind the second edge"
            yield describe_breach("second_step.distance", rule, farthest, distance)
        height = self.height.nominal
        radius = self.edge_radius.nominal
        if radius > height:
            yield describe_breach(
                "second_step.edge_radius", "not exceed its height", height, radius
            )
        chamfer = body.edge_break.nominal
        over_all = abs(step_height + self.rise)
        if over_all >= chamfer and chamfer != 0.0:
            rule = "keep the last face within body.edge_break of the lower one"
            yield describe_breach("second_step.height", rule, chamfer, over_all)
        half_thickness = 0.5 * body.thickness.nominal
        if over_all >= half_thickness:
            rule = "keep the last face within half the thickness of the lower one"
            yield describe_breach("second_step.height", rule, half_thickness, over_all)
        if body.mounting is not None and body.mounting.kind == "clearance":
            yield (
                "body.mounting.kind must be 'tapped' beside a second step, whose edge a "
                "counterbore in the working faces may cut, got 'clearance'"
            )


def _compute_arc_rise(distance_from_riser: float, radius: float) -> float:
    """Compute how high an arc has risen after a run from its riser [m]: its radius at the end."""
    if distance_from_riser >= radius:
        return radius
    return math.sqrt(distance_from_riser * (2.0 * radius - distance_from_riser))
