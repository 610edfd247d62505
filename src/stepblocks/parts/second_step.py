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
    describe_plane,
    make_characteristic,
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

    def outline(self, upper: float) -> cad.door.Outline:
        """Outline it as (x, z) [m], from the face behind it to that before it, at `upper`."""
        x = self.distance.nominal
        behind = upper + self.rise
        radius = self.edge_radius.nominal
        sharp_root = radius < self.height.nominal
        bow = radius * (1.0 - math.sqrt(0.5))
        outline: list[object]
        if self.direction == "up":
            outline = [(x + radius, behind)]
            if radius > 0.0:
                outline.append(((x + bow, behind - bow), (x, behind - radius)))
            if sharp_root:
                outline.append((x, upper))
            return outline
        outline = []
        if sharp_root:
            outline.append((x, behind))
        outline.append((x, upper - radius))
        if radius > 0.0:
            outline.append(((x - bow, upper - bow), (x - radius, upper)))
        return outline

    @property
    def corners(self) -> tuple[float, ...]:
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

    def compute_top(self, x: float, upper: float) -> float:
        """Compute the height of the surface at `x` [m], right of the first edge's rounding."""
        radius = self.edge_radius.nominal
        behind = upper + self.rise
        past = x - self.distance.nominal
        if self.direction == "up":
            if past < 0.0:
                return upper
            return behind - radius + _compute_sagitta(past, radius)
        if past >= 0.0:
            return behind
        return upper - radius + _compute_sagitta(-past, radius)

    def make_characteristics(
        self, body: Body, demands: FaceDemands, upper: FaceRule, height: float, first: Rule | None
    ) -> Iterator[Characteristic]:
        """Make what is asked of it, with the keys of a first edge after `SECOND`.

        Parameters
        ----------
        body : Body
            The block without its steps.
        demands : dict of str to Dimension
            Demands on the face behind it.
        upper : FaceRule
            The face before it.
        height : float
            Of that face over the lower one [m].
        first : FaceRule or None
            Riser of the first step; None where it is all rounding.

        Yields
        ------
        Characteristic
        """
        x = self.distance.nominal
        behind = describe_plane(2, height + self.rise, x=0.5 * (x + body.half_length))
        middle = height + 0.5 * self.rise
        wall = None
        if self.edge_radius.nominal < self.height.nominal:
            wall = describe_plane(0, x, z=self._find_riser_middle(height))
        yield make_characteristic(
            "second_step_height",
            "distance",
            self.height,
            upper,
            behind,
            label=f"second step height, {self.direction}",
            method=PROFILE,
        )
        yield self._state_edge_radius(x, middle, upper, behind)
        if wall is not None and first is not None:
            yield make_characteristic(
                "second_step_distance",
                "distance",
                self.distance,
                first,
                wall,
                label="second edge from the working edge",
                method="profilometer",
            )
        yield from self._yield_face_demands(body, demands, behind, wall, upper)

    def _state_edge_radius(
        self, x: float, middle: float, upper: FaceRule, behind: FaceRule
    ) -> Characteristic:
        """State the radius of its edge at `x`, whose riser has its middle at a height [m]."""
        radius = self.edge_radius.nominal
        high = behind if self.direction == "up" else upper
        edge: Rule = EdgeRule(describe_plane(0, x, z=middle), high)
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

    def _find_riser_middle(self, height: float) -> float:
        """Find the middle of its riser under the rounding [m]; the face before it at a height."""
        low = min(height, height + self.rise)
        return low + 0.5 * (self.height.nominal - self.edge_radius.nominal)

    def _yield_face_demands(
        self,
        body: Body,
        demands: FaceDemands,
        behind: FaceRule,
        wall: FaceRule | None,
        upper: FaceRule,
    ) -> Iterator[Characteristic]:
        """Yield form of the face behind it, and burr, angle and straightness of its edge."""
        chamfer = body.edge_break.nominal
        extent = (
            body.half_length - self.distance.nominal - chamfer,
            body.width.nominal - 2.0 * chamfer,
        )
        # the datum A of parallelism is the lower face of the block
        lower = describe_plane(2, 0.0, x=-0.5 * body.half_length)
        for form in make_form_characteristics(demands, lower, behind, "lower face", "second face"):
            if form.key != "flatness_lower":
                yield replace(form, key=SECOND + form.key, extent=extent)
        foot = upper if self.direction == "up" else behind
        for state in make_edge_characteristics(demands["burr"], wall, foot):
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


def _compute_sagitta(run: float, radius: float) -> float:
    """Compute how high an arc has risen after a run from its riser [m]: its radius at the end."""
    if run >= radius:
        return radius
    return math.sqrt(run * (2.0 * radius - run))
