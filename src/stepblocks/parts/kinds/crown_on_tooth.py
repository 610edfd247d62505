"""The junction of prepared tooth and crown as two bodies of revolution about the path of draw."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar, Literal

from stepblocks import cad
from stepblocks.parts.characteristics import (
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    describe_plane,
    make_characteristic,
)
from stepblocks.parts.declared import (
    Table,
    check_below,
    check_rule,
    declare_default,
    make_rules_validator,
)
from stepblocks.parts.kind import (
    CONTACT_DEFLECTION,
    FITTING_DEFLECTION,
    NANOMETRE,
    Finding,
    Manifold,
    MeasuredMesh,
    Verdict,
)
from stepblocks.parts.kinds.margin import CrownMargin
from stepblocks.parts.revolution import (
    Outline,
    Turned,
    list_outline_points,
    list_ring_points,
    make_frusta,
    make_sectors,
)
from stepblocks.parts.shapes import make_hull
from stepblocks.parts.tolerance import Angle, Dimension, Length, PositiveLength
from stepblocks.quantities import format_quantity

_SEATED = "section or micro-CT, seated"


class FinishLine(Table):
    """How the preparation ends."""

    # a square ledge, a quarter round, or no ledge
    kind: Literal["shoulder", "chamfer", "feather-edge"] = "shoulder"
    # of the ledge, or radius of the quarter round [m]; 0 for the feather edge
    width: Length = declare_default("1 mm", "0.05 mm")

    @make_rules_validator
    def _check_width_of_its_kind(self) -> Iterator[str]:
        if (self.width.nominal == 0.0) != (self.kind == "feather-edge"):
            rule = (
                "be 0 for a feather-edge"
                if self.kind == "feather-edge"
                else f"be above 0 for a {self.kind}"
            )
            yield f"width must {rule}, got {format_quantity(self.width.nominal, 'length')}"


class CrownOnTooth(CrownMargin, Turned):
    """A prepared tooth and its crown, bodies of revolution about the path of draw.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    marginal_gap : Dimension
        Gap g between tooth and crown [m].
    horizontal_discrepancy : Dimension
        Height h of the crown over the tooth; positive where it is overextended [m].
    vertical_discrepancy : Dimension or None
        Distance v of the crown's margin along the path of draw [m]; None means that it is the gap.
    gum : Gum or None
        Gum beside the margin; None where the file does not say.
    material : Material
        What it is made of, with its density [kg/m^3].
    margin_radius : Dimension
        Outer radius of the tooth at the finish line [m].
    finish_line : FinishLine
        How the preparation ends.
    taper : Dimension
        Angle of the axial wall to the path of draw, half the total convergence [rad].
    preparation_height : Dimension
        Height of the preparation over the finish line [m].
    root_length : Dimension
        Length of the root below the finish line [m].
    internal_gap : Dimension
        Gap between axial wall and crown, across the wall [m].
    shell_thickness : Dimension
        Thickness of the crown over the preparation [m].
    """

    margin_radius: PositiveLength = declare_default("4 mm", "0.02 mm")
    finish_line: FinishLine = declare_default({})
    taper: Angle = declare_default("6 deg", "0.5 deg")
    preparation_height: PositiveLength = declare_default("5 mm", "0.1 mm")
    root_length: PositiveLength = declare_default("8 mm")
    internal_gap: Length = declare_default("60 um", otherwise="15 um")
    shell_thickness: PositiveLength = declare_default("1.5 mm", "0.1 mm")

    stanza: ClassVar[str] = "crown_on_tooth"
    kind_name: ClassVar[str] = "crown on tooth"
    governing_field: ClassVar[str] = "marginal_gap"
    axes: ClassVar[str] = (
        "the crown lies on its side: x along the path of draw from tooth to crown, y around, z "
        "outwards; the finish line is at "
        "x = 0, the tooth's outer surface at z = 0"
    )

    @property
    def floor_depth_and_slope(self) -> tuple[float, float]:
        return self.finish_line.width.nominal, math.tan(self.taper.nominal)

    @property
    def turn_radius(self) -> float | None:
        return self.margin_radius.nominal

    @property
    def bodies(self) -> tuple[str, ...]:
        return f"{self.id}-tooth", f"{self.id}-crown"

    @property
    def outer_radius(self) -> float:  # of the crown [m]
        return self.margin_radius.nominal + self.horizontal_discrepancy.nominal

    def outlines(self) -> list[Outline]:
        return [self.tooth_outline(), self.crown_outline()]

    def tooth_outline(self) -> Outline:
        """Half section of the prepared tooth; the finish line lies at height 0."""
        R, w, top = (
            self.margin_radius.nominal,
            self.finish_line.width.nominal,
            self.preparation_height.nominal,
        )
        outline: Outline = [
            (0.0, -self.root_length.nominal),
            (R, -self.root_length.nominal),
            (R, 0.0),
        ]
        start = 0.0
        if self.finish_line.kind == "chamfer":
            outline.append(((R - w * math.sqrt(0.5), w * (1.0 - math.sqrt(0.5))), (R - w, w)))
            start = w
        elif self.finish_line.kind == "shoulder":
            outline.append((R - w, 0.0))
        outline += [(R - w - (top - start) * math.tan(self.taper.nominal), top), (0.0, top)]
        return outline

    def crown_outline(self) -> Outline:
        """Half section of the crown, seated with its gaps."""
        R, w, g = (
            self.margin_radius.nominal,
            self.finish_line.width.nominal,
            self.marginal_gap.nominal,
        )
        slope = math.tan(self.taper.nominal)
        inner = self.internal_gap.nominal
        across = inner / math.cos(self.taper.nominal)
        ceiling = self.preparation_height.nominal + inner
        outer, roof = self.outer_radius, ceiling + self.shell_thickness.nominal
        kind = self.finish_line.kind
        start = w if kind == "chamfer" else 0.0

        def wall(height: float) -> float:
            return R - w - (height - start) * slope + across

        outline: Outline = [(0.0, ceiling), (wall(ceiling), ceiling)]
        if kind == "feather-edge":
            v = self.opening.nominal
            outline += [(R - v * slope + g / math.cos(self.taper.nominal), v), (outer, v)]
        else:
            foot = g + w if kind == "chamfer" else g
            outline.append((wall(foot), foot))
            corner = [(R + z, x) for x, z in self.corner]
            if kind == "chamfer":
                # an arc of the finish line's radius, bulging towards the axis's foot as the tooth's
                # does
                half_x, half_z = 0.5 * (R - wall(foot)), 0.5 * (g - foot)
                half = math.hypot(half_x, half_z)
                sagitta = w - math.sqrt(w * w - half * half)
                middle = (
                    wall(foot) + half_x + sagitta * half_z / half,
                    foot + half_z - sagitta * half_x / half,
                )
                outline.append((middle, (R, g)))
            outline += corner
            if corner[-1][0] != outer:
                outline.append((outer, corner[-1][1]))
        outline += [(outer, roof), (0.0, roof)]
        return outline

    def hulls(self) -> list[Manifold]:
        # Frusta of the tooth, the crown's roof, and sectors of its wall in horizontal slices
        points = list_outline_points(self.crown_outline(), 5e-6)
        ceiling, roof, outer = points[0][1], points[-1][1], points[-2][0]
        fitting = points[1 : points.index((outer, roof))]
        pieces = [
            *make_frusta(self.tooth_outline()),
            make_hull([*list_ring_points(outer, ceiling), *list_ring_points(outer, roof)]),
        ]
        walls = (
            (a, b)
            for a, b in itertools.pairwise(fitting)
            if a[1] > b[1] and max(a[0], b[0]) <= outer
        )
        cells = [[a, b, (outer, b[1]), (outer, a[1])] for a, b in walls]
        low = min(z for _, z in fitting)
        gap = self.marginal_gap.nominal
        lip = [r for r, z in fitting if z < gap] if low < 0.0 else []
        if lip:
            cells.append([(min(lip), low), (outer, low), (outer, gap), (min(lip), gap)])
        return [*pieces, *(sector for cell in cells for sector in make_sectors(cell))]

    def chordal_error(self, face: cad.door.Face) -> float:
        reach = 2.0 * (self.marginal_gap.nominal + abs(self.opening.nominal))
        at_margin = face.kind in ("PLANE", "CYLINDER")
        near = face.low[2] <= reach and face.high[2] >= -reach
        return CONTACT_DEFLECTION if at_margin and near else FITTING_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        R, h, root, height = (
            self.margin_radius,
            self.horizontal_discrepancy,
            self.root_length,
            self.preparation_height,
        )
        side = FaceRule("CYLINDER", radius=R.nominal)
        yield make_characteristic(
            "margin_diameter", "diameter", R, side, label="diameter at the margin"
        ).doubled
        top, base = describe_plane(2, height.nominal), describe_plane(2, -root.nominal)
        if self.finish_line.kind == "shoulder":
            shoulder = describe_plane(2, 0.0)
            yield make_characteristic("preparation_height", "distance", height, shoulder, top)
            yield make_characteristic("root_length", "distance", root, base, shoulder)
        else:
            whole = Dimension(
                root.nominal + height.nominal, root.upper + height.upper, root.lower + height.lower
            )
            yield replace(
                make_characteristic(
                    "tooth_length", "distance", whole, base, top, label="tooth, whole length"
                ),
                states=(root, height),
            )
        yield replace(
            make_characteristic(
                "crown_diameter",
                "diameter",
                replace(h, nominal=self.outer_radius),
                FaceRule("CYLINDER", radius=self.outer_radius),
                label="diameter of the crown",
                body=1,
            ).doubled,
            states=(h,),
        )
        ceiling = height.nominal + self.internal_gap.nominal
        yield make_characteristic(
            "shell_thickness",
            "distance",
            self.shell_thickness,
            describe_plane(2, ceiling),
            describe_plane(2, ceiling + self.shell_thickness.nominal),
            body=1,
        )
        kind = self.finish_line.kind
        width = self.finish_line.width
        key = "finish_line_width"
        if kind == "shoulder":
            yield make_characteristic(
                key,
                "distance",
                width,
                EdgeRule(side, describe_plane(2, 0.0)),
                EdgeRule(describe_plane(2, 0.0), self._state_walls()[0]),
                label="finish line, width of the shoulder",
                method="microscope",
            )
        else:  # no face is as wide
            what = "radius of the quarter round" if kind == "chamfer" else "width of its edge"
            yield make_characteristic(
                key, "note", width, label=f"finish line, {what}", method="microscope"
            )
        yield from self._list_seated_characteristics(ceiling)

    def _list_seated_characteristics(self, ceiling: float) -> Iterator[Characteristic]:
        # Gaps between the two bodies, the crown seated on its tooth
        finish = self.finish_line.kind
        g, inner = self.marginal_gap, self.internal_gap
        outside = FaceRule("CYLINDER", radius=self.margin_radius.nominal, body=0)
        ledge = (
            describe_plane(2, 0.0, 0)
            if finish == "shoulder"
            else FaceRule("TORUS" if finish == "chamfer" else "CONE", body=0)
        )
        cavosurface = EdgeRule(outside, ledge)
        end = describe_plane(2, self.opening.nominal, 1)
        walls = self._state_walls()
        # between two cones that are not parallel each gap holds at one end of the crown's
        across: tuple[Rule, Rule] = walls[0], EdgeRule(walls[1], end)
        if finish != "feather-edge":
            across = ledge if finish == "shoulder" else cavosurface, describe_plane(2, g.nominal, 1)
        yield make_characteristic("marginal_gap", "distance", g, *across, method=_SEATED)
        yield self._state_opening(cavosurface, end)
        top = (
            EdgeRule(walls[1], describe_plane(2, ceiling, 1))
            if finish == "feather-edge"
            else walls[1]
        )
        yield make_characteristic("internal_gap", "distance", inner, walls[0], top, method=_SEATED)
        if inner.nominal > 0.0:
            yield make_characteristic(
                "internal_gap_roof",
                "distance",
                inner,
                describe_plane(2, self.preparation_height.nominal, 0),
                describe_plane(2, ceiling, 1),
                label="internal gap, roof",
                method=_SEATED,
            )
        yield make_characteristic(
            "taper", "angle", self.taper, walls[0], label="total taper", method=_SEATED
        ).doubled

    def _state_walls(self) -> tuple[FaceRule, FaceRule]:
        # Axial walls of tooth and crown, halfway up, where no bevel is
        middle = {2: 0.5 * self.preparation_height.nominal}
        return FaceRule("CONE", holds=middle, body=0), FaceRule("CONE", holds=middle, body=1)

    def _state_opening(self, cavosurface: EdgeRule, end: FaceRule) -> Characteristic:
        # From the cavosurface angle along the path of draw to the margin of the crown
        finish = self.finish_line.kind
        v, g = self.opening, self.marginal_gap.nominal
        key = "vertical_discrepancy"
        if v.nominal < 0.0:
            return make_characteristic(
                key,
                "distance",
                v,
                cavosurface,
                end,
                label="vertical discrepancy, lip over the tooth",
                method=_SEATED,
            ).unsigned
        if v.nominal == g or finish == "feather-edge":
            return make_characteristic(key, "distance", v, cavosurface, end, method=_SEATED)
        # the margin is where the bevel meets the outside
        if finish == "shoulder" and v.nominal > g:
            outside = FaceRule("CYLINDER", radius=self.outer_radius, body=1)
            return make_characteristic(
                key,
                "distance",
                v,
                describe_plane(2, 0.0, 0),
                EdgeRule(FaceRule("CONE", holds={2: 0.5 * (g + v.nominal)}, body=1), outside),
                method=_SEATED,
            )
        return make_characteristic(key, "note", v, method=_SEATED)

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        radii, heights = mesh.radii, mesh.vertices[:, 2]
        if body == 0:
            yield Finding(
                "radius at the finish line",
                self.margin_radius.nominal,
                float(radii[abs(heights) < 1e-9].max()),
                2.0 * NANOMETRE,
            )
            yield Finding(
                "preparation height",
                self.preparation_height.nominal,
                float(heights.max()),
                2.0 * NANOMETRE,
            )
            return
        # the margin is the foot of the outer surface; a bevel goes on below it, inwards
        outside = radii > radii.max() - 10.0 * NANOMETRE
        foot = heights[outside].min()
        yield Finding(
            "vertical discrepancy of the margin", self.opening.nominal, float(foot), NANOMETRE
        )
        yield Finding(
            "outer radius of the crown's margin",
            self.outer_radius,
            float(radii[outside & (heights < foot + 1e-9)].max()),
            2.0 * NANOMETRE,
        )

    def choose_close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        wide = 6.0 * max(self.marginal_gap.nominal, abs(self.horizontal_discrepancy.nominal))
        return 1.0, wide, (self.margin_radius.nominal, wide, 0.0)

    @make_rules_validator
    def _check_fit_on_tooth(self) -> Iterator[str]:
        h, g, v = (
            self.horizontal_discrepancy.nominal,
            self.marginal_gap.nominal,
            self.opening.nominal,
        )
        finish = self.finish_line
        R, height = self.margin_radius.nominal, self.preparation_height.nominal
        if not 0.0 < self.taper.nominal < math.radians(45.0):
            yield (
                "taper must lie between 0 and 45 deg, got "
                f"{format_quantity(self.taper.nominal, 'angle')}"
            )
            return
        top = R - finish.width.nominal - height * math.tan(self.taper.nominal)
        yield check_rule(
            top > 0.1 * R,
            "preparation_height",
            "leave the preparation a top of a tenth of margin_radius",
            0.1 * R,
            top,
        )
        yield check_below(
            "internal_gap", "be below half of margin_radius", self.internal_gap.nominal, 0.5 * R
        )
        # of the crown across the path of draw at its fitting end
        foot = g + (finish.width.nominal if finish.kind == "chamfer" else 0.0)
        gap = self.internal_gap.nominal
        if finish.kind == "feather-edge":
            foot, gap = v, g
        inner = (
            -finish.width.nominal
            - foot * math.tan(self.taper.nominal)
            + gap / math.cos(self.taper.nominal)
        )
        wall = h - inner
        yield check_rule(
            wall > 0.0,
            "horizontal_discrepancy",
            "leave the crown a wall at its margin",
            h - wall,
            h,
        )
        shell = self.shell_thickness.nominal
        yield check_rule(
            h <= shell,
            "horizontal_discrepancy",
            "not exceed the shell (overextension beyond shell_thickness)",
            shell,
            h,
        )
        bevel = abs(v - g) if v >= 0.0 and finish.kind != "feather-edge" else 0.0
        yield check_rule(
            bevel < wall,
            "vertical_discrepancy",
            "leave a wall behind the bevel of the margin",
            g + wall,
            v,
        )
        if v < 0.0 and finish.kind == "feather-edge":
            yield (
                "vertical_discrepancy must not be negative for a feather-edge, got "
                f"{format_quantity(v, 'length')}"
            )
            return
        least = max(g, v) + finish.width.nominal
        yield check_rule(
            height > least, "preparation_height", "exceed the finish line", least, height
        )
