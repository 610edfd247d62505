"""The junction of prepared tooth and crown as two bodies of revolution about the path of draw."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from stepblocks import cad
from stepblocks.parts.characteristics import (
    MICROSCOPE,
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    make_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    Table,
    declare_default,
    describe_breach,
    make_rules_validator,
)
from stepblocks.parts.face_characteristics import make_contact_roughness_characteristic
from stepblocks.parts.kind import (
    CONTACT_DEFLECTION,
    FITTING_DEFLECTION,
    NANOMETRE,
    CloseUp,
    Finding,
    Manifold,
    MeasuredMesh,
    Verdict,
)
from stepblocks.parts.kinds.crown_margin import CrownMargin
from stepblocks.parts.kinds.crown_outlines import FinishKind, Preparation, SeatedCrown
from stepblocks.parts.revolution import (
    PIECE_DEFLECTION,
    Outline,
    Point,
    Turned,
    list_outline_points,
    list_ring_points,
    make_frusta,
    turn_cell_into_sectors,
)
from stepblocks.parts.shapes import make_hull
from stepblocks.parts.tolerance import Angle, Dimension, Length, PositiveLength
from stepblocks.quantities import format_quantity

_SEATED = "section or micro-CT, seated"
_LARGEST_TAPER = math.radians(45.0)
_LEAST_TOP = 0.1  # radius of the top of a preparation over that at the margin
_TOOTH = 0  # index of the body
_CROWN = 1


class FinishLine(Table):
    """How the preparation ends.

    Attributes
    ----------
    kind : str
        A square ledge (``"shoulder"``), a quarter round (``"chamfer"``), or no ledge
        (``"feather-edge"``).
    width : Dimension
        Width of the ledge, or radius of the quarter round [m]; 0 for the feather edge.
    """

    kind: FinishKind = "shoulder"
    width: Length = declare_default("1 mm", "0.05 mm")

    @make_rules_validator
    def _yield_width_breaches(self) -> Iterator[str]:
        width = self.width.nominal
        text = format_quantity(width, "length")
        if self.kind == "feather-edge":
            if width != 0.0:
                yield f"width must be 0 for a feather-edge, got {text}"
        elif width == 0.0:
            yield f"width must be above 0 for a {self.kind}, got {text}"


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
        Distance v of the crown's margin along the path of draw [m]; left out, it is the gap.
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

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "crown_on_tooth"
    kind_name: ClassVar[str] = "crown on tooth"
    governing_field: ClassVar[str] = "marginal_gap"
    axes: ClassVar[str] = (
        "the crown lies on its side: x along the path of draw from tooth to crown, y around, z "
        "outwards; the finish line is at "
        "x = 0, the tooth's outer surface at z = 0"
    )

    @property
    def preparation(self) -> Preparation:
        """The prepared tooth at its nominal sizes."""
        return Preparation(
            self.finish_line.kind,
            self.margin_radius.nominal,
            self.finish_line.width.nominal,
            self.taper.nominal,
            self.preparation_height.nominal,
            self.root_length.nominal,
        )

    @property
    def seated_crown(self) -> SeatedCrown:
        """The crown at its nominal sizes, seated on its tooth."""
        return SeatedCrown(
            self.preparation,
            self.marginal_gap.nominal,
            self.opening.nominal,
            self.internal_gap.nominal,
            self.shell_thickness.nominal,
            self.outer_radius,
            self.corner,
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
    def outer_radius(self) -> float:
        """Outer radius of the crown [m]."""
        return self.margin_radius.nominal + self.horizontal_discrepancy.nominal

    def outlines(self) -> list[Outline]:
        return [self.preparation.outline(), self.seated_crown.outline()]

    def hulls(self) -> list[Manifold]:
        # frusta of the tooth, the crown's roof, and sectors of its wall in level slices
        crown = self.seated_crown
        outer = self.outer_radius
        roof = [
            *list_ring_points(outer, crown.inner_roof_height),
            *list_ring_points(outer, crown.outer_roof_height),
        ]
        pieces = [*make_frusta(self.preparation.outline()), make_hull(roof)]
        for cell in self._list_wall_cells():
            pieces += turn_cell_into_sectors(cell)
        return pieces

    def _list_wall_cells(self) -> list[list[Point]]:
        """Cut the half section of the crown's wall into convex cells (radius, height) [m]."""
        outer = self.outer_radius
        gap = self.marginal_gap.nominal
        points = list_outline_points(self.seated_crown.outline(), PIECE_DEFLECTION)
        fitting = points[1 : points.index((outer, self.seated_crown.outer_roof_height))]
        cells = []
        for upper, lower in itertools.pairwise(fitting):
            upper_radius, upper_height = upper
            lower_radius, lower_height = lower
            if upper_height > lower_height and max(upper_radius, lower_radius) <= outer:
                cells.append([upper, lower, (outer, lower_height), (outer, upper_height)])
        lowest = min(height for _, height in fitting)
        if lowest < 0.0:
            lip_radii = [radius for radius, height in fitting if height < gap]
            inside = min(lip_radii)
            cells.append([(inside, lowest), (outer, lowest), (outer, gap), (inside, gap)])
        return cells

    def chordal_error(self, face: cad.door.Face) -> float:
        reach = 2.0 * (self.marginal_gap.nominal + abs(self.opening.nominal))
        _, _, low = face.low
        _, _, high = face.high
        is_near_margin = low <= reach and high >= -reach
        if face.kind in ("PLANE", "CYLINDER") and is_near_margin:
            return CONTACT_DEFLECTION
        return FITTING_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        outside = FaceRule("CYLINDER", radius=self.margin_radius.nominal)
        yield make_characteristic(
            "margin_diameter",
            "diameter",
            self.margin_radius,
            outside,
            label="diameter at the margin",
        ).doubled
        yield from self._yield_tooth_height_characteristics()
        yield self._make_crown_diameter_characteristic()
        crown = self.seated_crown
        yield make_characteristic(
            "shell_thickness",
            "distance",
            self.shell_thickness,
            make_plane_rule(2, crown.inner_roof_height),
            make_plane_rule(2, crown.outer_roof_height),
            body=_CROWN,
        )
        yield self._make_finish_line_characteristic(outside)
        yield from self._yield_seated_characteristics()

    def _yield_tooth_height_characteristics(self) -> Iterator[Characteristic]:
        """Yield the heights of preparation and root, together where no shoulder parts them."""
        root = self.root_length
        height = self.preparation_height
        top = make_plane_rule(2, height.nominal)
        base = make_plane_rule(2, -root.nominal)
        if self.finish_line.kind == "shoulder":
            shoulder = make_plane_rule(2, 0.0)
            yield make_characteristic("preparation_height", "distance", height, shoulder, top)
            yield make_characteristic("root_length", "distance", root, base, shoulder)
            return
        whole = Dimension(
            root.nominal + height.nominal, root.upper + height.upper, root.lower + height.lower
        )
        length = make_characteristic(
            "tooth_length", "distance", whole, base, top, label="tooth, whole length"
        )
        yield replace(length, states=(root, height))

    def _make_crown_diameter_characteristic(self) -> Characteristic:
        """State the diameter of the crown, which holds the horizontal discrepancy."""
        discrepancy = self.horizontal_discrepancy
        diameter = make_characteristic(
            "crown_diameter",
            "diameter",
            replace(discrepancy, nominal=self.outer_radius),
            FaceRule("CYLINDER", radius=self.outer_radius),
            label="diameter of the crown",
            body=_CROWN,
        ).doubled
        return replace(diameter, states=(discrepancy,))

    def _make_finish_line_characteristic(self, tooth_outside: FaceRule) -> Characteristic:
        """State the width of the finish line; only a shoulder has a face as wide."""
        key = "finish_line_width"
        width = self.finish_line.width
        if self.finish_line.kind == "shoulder":
            ledge = make_plane_rule(2, 0.0)
            return make_characteristic(
                key,
                "distance",
                width,
                EdgeRule(tooth_outside, ledge),
                EdgeRule(ledge, self._make_axial_wall_rule(_TOOTH)),
                label="finish line, width of the shoulder",
                method=MICROSCOPE,
            )
        label = "finish line, width of its edge"
        if self.finish_line.kind == "chamfer":
            label = "finish line, radius of the quarter round"
        return make_characteristic(key, "note", width, label=label, method=MICROSCOPE)

    def _yield_seated_characteristics(self) -> Iterator[Characteristic]:
        """Yield the gaps between the two bodies, the crown seated on its tooth."""
        ceiling = self.seated_crown.inner_roof_height
        tooth_wall = self._make_axial_wall_rule(_TOOTH)
        outside = FaceRule("CYLINDER", radius=self.margin_radius.nominal, body=_TOOTH)
        cavosurface = EdgeRule(outside, self._make_ledge_rule())
        end = make_plane_rule(2, self.opening.nominal, _CROWN)
        yield self._make_marginal_gap_characteristic(cavosurface, end)
        yield self._make_vertical_discrepancy_characteristic(cavosurface, end)
        # between two cones that are not parallel the gap holds at the upper end of the crown's
        inner_wall: Rule = self._make_axial_wall_rule(_CROWN)
        if self.finish_line.kind == "feather-edge":
            inner_wall = EdgeRule(
                self._make_axial_wall_rule(_CROWN), make_plane_rule(2, ceiling, _CROWN)
            )
        yield make_characteristic(
            "internal_gap", "distance", self.internal_gap, tooth_wall, inner_wall, method=_SEATED
        )
        if self.internal_gap.nominal > 0.0:
            yield make_characteristic(
                "internal_gap_roof",
                "distance",
                self.internal_gap,
                make_plane_rule(2, self.preparation_height.nominal, _TOOTH),
                make_plane_rule(2, ceiling, _CROWN),
                label="internal gap, roof",
                method=_SEATED,
            )
        yield make_characteristic(
            "taper", "angle", self.taper, tooth_wall, label="total taper", method=_SEATED
        ).doubled
        yield make_contact_roughness_characteristic(self.face_demands["roughness"])

    def _make_axial_wall_rule(self, body_index: int) -> FaceRule:
        """Make the rule of the axial wall of tooth or crown, halfway up, where no bevel is."""
        middle = 0.5 * self.preparation_height.nominal
        return FaceRule("CONE", holds={2: middle}, body=body_index)

    def _make_ledge_rule(self) -> FaceRule:
        """Make the rule of the face of the tooth inside the finish line."""
        if self.finish_line.kind == "shoulder":
            return make_plane_rule(2, 0.0, _TOOTH)
        if self.finish_line.kind == "chamfer":
            return FaceRule("TORUS", body=_TOOTH)
        return FaceRule("CONE", body=_TOOTH)

    def _make_marginal_gap_characteristic(
        self, cavosurface: EdgeRule, crown_foot: FaceRule
    ) -> Characteristic:
        """State the marginal gap, by the faces or edges that are its own distance apart.

        `crown_foot` is the foot of the crown.
        """
        gap = self.marginal_gap
        foot = make_plane_rule(2, gap.nominal, _CROWN)
        faces: tuple[Rule, Rule]
        if self.finish_line.kind == "shoulder":
            faces = (self._make_ledge_rule(), foot)
        elif self.finish_line.kind == "chamfer":
            faces = (cavosurface, foot)
        else:
            faces = (
                self._make_axial_wall_rule(_TOOTH),
                EdgeRule(self._make_axial_wall_rule(_CROWN), crown_foot),
            )
        return make_characteristic("marginal_gap", "distance", gap, *faces, method=_SEATED)

    def _make_vertical_discrepancy_characteristic(
        self, cavosurface: EdgeRule, crown_foot: FaceRule
    ) -> Characteristic:
        """State the way from the cavosurface angle along the path of draw to the crown's margin."""
        finish = self.finish_line.kind
        opening = self.opening
        gap = self.marginal_gap.nominal
        key = "vertical_discrepancy"
        if opening.nominal < 0.0:
            label = "vertical discrepancy, lip over the tooth"
            return make_characteristic(
                key, "distance", opening, cavosurface, crown_foot, label=label, method=_SEATED
            ).mirrored_to_positive
        if opening.nominal == gap or finish == "feather-edge":
            return make_characteristic(
                key, "distance", opening, cavosurface, crown_foot, method=_SEATED
            )
        # the margin is where the bevel meets the outside
        if finish == "shoulder" and opening.nominal > gap:
            ledge = make_plane_rule(2, 0.0, _TOOTH)
            outside = FaceRule("CYLINDER", radius=self.outer_radius, body=_CROWN)
            middle = 0.5 * (gap + opening.nominal)
            bevel = FaceRule("CONE", holds={2: middle}, body=_CROWN)
            return make_characteristic(
                key, "distance", opening, ledge, EdgeRule(bevel, outside), method=_SEATED
            )
        return make_characteristic(key, "note", opening, method=_SEATED)

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        if body == _TOOTH:
            yield from self._measure_tooth_mesh(mesh)
        else:
            yield from self._measure_crown_mesh(mesh)

    def _measure_tooth_mesh(self, mesh: MeasuredMesh) -> Iterator[Verdict]:
        """Measure radius and height of the prepared tooth."""
        heights = mesh.vertices[:, 2]
        at_finish_line = abs(heights) < NANOMETRE
        radius = float(mesh.radii[at_finish_line].max())
        yield Finding(
            "radius at the finish line", self.margin_radius.nominal, radius, 2.0 * NANOMETRE
        )
        top = float(heights.max())
        yield Finding("preparation height", self.preparation_height.nominal, top, 2.0 * NANOMETRE)

    def _measure_crown_mesh(self, mesh: MeasuredMesh) -> Iterator[Verdict]:
        """Measure the margin of the crown.

        It is the foot of the outer surface; a bevel goes on below it, inwards.
        """
        radii = mesh.radii
        heights = mesh.vertices[:, 2]
        outside = radii > radii.max() - 10.0 * NANOMETRE
        foot = heights[outside].min()
        yield Finding(
            "vertical discrepancy of the margin", self.opening.nominal, float(foot), NANOMETRE
        )
        at_foot = outside & (heights < foot + NANOMETRE)
        yield Finding(
            "outer radius of the crown's margin",
            self.outer_radius,
            float(radii[at_foot].max()),
            2.0 * NANOMETRE,
        )

    def choose_close_up(self) -> CloseUp:
        width = 6.0 * max(self.marginal_gap.nominal, abs(self.horizontal_discrepancy.nominal))
        return CloseUp(1.0, width, (self.margin_radius.nominal, width, 0.0))

    @make_rules_validator
    def _yield_shape_breaches(self) -> Iterator[str]:
        """Yield what keeps preparation and crown from having a shape."""
        taper = self.taper.nominal
        if not 0.0 < taper < _LARGEST_TAPER:
            yield f"taper must lie between 0 and 45 deg, got {format_quantity(taper, 'angle')}"
            return
        radius = self.margin_radius.nominal
        height = self.preparation_height.nominal
        ledge = self.finish_line.width.nominal
        top = radius - ledge - height * math.tan(taper)
        if top <= _LEAST_TOP * radius:
            rule = "leave the preparation a top of a tenth of margin_radius"
            yield describe_breach("preparation_height", rule, _LEAST_TOP * radius, top)
        internal_gap = self.internal_gap.nominal
        if internal_gap >= 0.5 * radius:
            rule = "be below half of margin_radius"
            yield describe_breach("internal_gap", rule, 0.5 * radius, internal_gap)
        yield from self._yield_crown_wall_breaches()
        opening = self.opening.nominal
        if opening < 0.0 and self.finish_line.kind == "feather-edge":
            yield (
                "vertical_discrepancy must not be negative for a feather-edge, got "
                f"{format_quantity(opening, 'length')}"
            )
            return
        least_height = max(self.marginal_gap.nominal, opening) + ledge
        if height <= least_height:
            rule = "exceed the finish line"
            yield describe_breach("preparation_height", rule, least_height, height)

    def _yield_crown_wall_breaches(self) -> Iterator[str]:
        """Yield what keeps the crown from having a wall at its margin."""
        rise = self.horizontal_discrepancy.nominal
        gap = self.marginal_gap.nominal
        opening = self.opening.nominal
        shell = self.shell_thickness.nominal
        wall = self._compute_margin_wall_thickness()
        if wall <= 0.0:
            rule = "leave the crown a wall at its margin"
            yield describe_breach("horizontal_discrepancy", rule, rise - wall, rise)
        if rise > shell:
            rule = "not exceed the shell (overextension beyond shell_thickness)"
            yield describe_breach("horizontal_discrepancy", rule, shell, rise)
        bevel = 0.0
        if opening >= 0.0 and self.finish_line.kind != "feather-edge":
            bevel = abs(opening - gap)
        if bevel >= wall:
            rule = "leave a wall behind the bevel of the margin"
            yield describe_breach("vertical_discrepancy", rule, gap + wall, opening)

    def _compute_margin_wall_thickness(self) -> float:
        """Compute the thickness of the crown across the path of draw at its fitting end [m]."""
        ledge = self.finish_line.width.nominal
        taper = self.taper.nominal
        foot = self.marginal_gap.nominal
        gap = self.internal_gap.nominal
        if self.finish_line.kind == "chamfer":
            foot += ledge
        elif self.finish_line.kind == "feather-edge":
            foot = self.opening.nominal
            gap = self.marginal_gap.nominal
        inner = -ledge - foot * math.tan(taper) + gap / math.cos(taper)
        return self.horizontal_discrepancy.nominal - inner
