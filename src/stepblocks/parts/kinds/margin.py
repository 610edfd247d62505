"""The junction of crown and tooth, as a block."""

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from stepblocks import cad
from stepblocks.parts.body import Block, Body, Stock
from stepblocks.parts.body_solid import (
    WorkingFace,
    compute_cutout_volume,
    compute_half_block_volume,
    list_half_hull_points,
    make_body_cuts,
)
from stepblocks.parts.characteristics import (
    PROFILE,
    Characteristic,
    EdgeRule,
    FaceRule,
    make_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    WorkingFaces,
    declare_default,
    describe_breach,
    make_rules_validator,
)
from stepblocks.parts.face_characteristics import (
    make_burr_characteristic,
    make_form_characteristics,
)
from stepblocks.parts.kind import NANOMETRE, Finding, Manifold, MeasuredMesh, Verdict
from stepblocks.parts.kinds.crown_margin import CrownMargin
from stepblocks.parts.material import MaterialField
from stepblocks.parts.revolution import Point, Point3
from stepblocks.parts.shapes import make_hull, split_solid
from stepblocks.parts.tolerance import ANGULAR_DEVIATION, Dimension, PositiveLength, SignedLength

ACROSS = "profilometer or microscope"
_BEVEL_ANGLE = math.radians(45.0)


class MarginBlock(CrownMargin, Block):
    """A bench block: the tooth at z = 0 and x < 0, the crown at z = h beyond the gap.

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
    gap_depth : Dimension
        Depth of the gap below the surface of the tooth [m].
    body : Body
        Size of the block and its mounting.
    stock : tuple of float or None
        Stock that the workshop has, along x, y and z [m]; left out, the setup sheet chooses it.
    working_faces : WorkingFaces or None
        Demands on the faces of tooth and crown; None where the file states none.
    """

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "margin_block"
    kind_name: ClassVar[str] = "margin block"
    governing_field: ClassVar[str] = "horizontal_discrepancy"

    marginal_gap: PositiveLength = declare_default(otherwise="2 um")
    horizontal_discrepancy: SignedLength = declare_default("0 um", otherwise="2 um")
    vertical_discrepancy: SignedLength | None = declare_default(None, otherwise="3 um")
    material: MaterialField = declare_default("steel")
    gap_depth: PositiveLength = declare_default("0.4 mm", otherwise="0.05 mm")
    body: Body = declare_default({})
    stock: Stock | None = None
    working_faces: WorkingFaces | None = None

    @property
    def floor_depth_and_slope(self) -> tuple[float, float]:
        return self.gap_depth.nominal, 0.0

    def top(self, x: float) -> float:
        # the uppermost of the straight lines of the section at x
        depth = self.gap_depth.nominal
        far = self.body.length.nominal
        section = [
            (-far, 0.0),
            (0.0, 0.0),
            (0.0, -depth),
            (self.marginal_gap.nominal, -depth),
            *self.corner,
            (far, self.rise),
        ]
        heights = []
        for (x0, z0), (x1, z1) in itertools.pairwise(section):
            if x0 != x1 and min(x0, x1) <= x <= max(x0, x1):
                heights.append(z0 + (z1 - z0) * (x - x0) / (x1 - x0))
        return max(heights)

    def solids(self) -> list[cad.door.Body]:
        gap = self.marginal_gap.nominal
        depth = self.gap_depth.nominal
        crest = [*reversed(self.corner), (gap, -depth), (0.0, -depth), (0.0, 0.0)]
        cuts = make_body_cuts(self.body, self.id, [WorkingFace(0.0, self.rise)])
        return [cad.kernel.cut(self.extrude_section(crest), cuts)]

    def volumes(self) -> tuple[float, ...]:
        # the halves on either side of x = 0, less the gap, corrected at the corner
        gap = self.marginal_gap.nominal
        depth = self.gap_depth.nominal
        half = self.body.half_length
        left = compute_half_block_volume(self.body, half, 0.0)
        right = compute_half_block_volume(self.body, half, self.rise)
        above = [*self.corner, (0.0, self.rise)]
        has_lip = self.opening.nominal < 0.0
        if has_lip:
            above = [(gap, gap), (0.0, gap)]
        gap_section = [(0.0, -depth), (gap, -depth), *above]
        volume = left + right - compute_cutout_volume(self.body, self.rise, gap_section)
        if has_lip:
            volume += self._compute_lip_volume()
        return (volume - self.removed_volume,)

    def _compute_lip_volume(self) -> float:
        """Compute the volume of the lip over the tooth [m^3], where the left half's chamfer is."""
        gap = self.marginal_gap.nominal
        rise = self.rise
        chamfer = self.body.edge_break.nominal
        narrowed = 0.0
        if chamfer > 0.0:
            narrowed = 2.0 * chamfer * (rise - gap) + rise * rise - gap * gap
        return -self.opening.nominal * (self.body.width.nominal * (rise - gap) - narrowed)

    def hulls(self) -> list[Manifold]:
        gap = self.marginal_gap.nominal
        rise = self.rise
        opening = self.opening.nominal
        left = make_hull(list_half_hull_points(self.body, -1.0, 0.0, [(0.0, 0.0)]))
        right = make_hull(list_half_hull_points(self.body, 1.0, rise, [(0.0, rise)]))
        under, crown = split_solid(right, "x", gap)
        floor, _ = split_solid(under, "z", -self.gap_depth.nominal)
        if opening > gap:  # bevelled: cut the corner off along 45 degrees
            slope = math.sqrt(0.5)
            crown = crown.trim_by_plane((slope, 0.0, -slope), -1e3 * (rise - opening) * slope)
        pieces = [left, floor, crown]
        if opening < 0.0:
            over_gap = [(0.0, gap), (0.0, rise), (gap, gap), (gap, rise)]
            pieces.append(make_hull(self._list_lip_corners()))
            pieces.append(make_hull(self._list_prism_corners(over_gap)))
        elif opening < gap:
            wedge = [(gap, rise - (gap - opening)), (opening, rise), (gap, rise)]
            pieces.append(make_hull(self._list_prism_corners(wedge)))
        return pieces

    def _list_prism_corners(self, section: list[Point]) -> list[Point3]:
        """List the corners of a section (x, z) of the crown between its chamfered sides [m]."""
        half_width = self.body.half_width
        chamfer = self.body.edge_break.nominal
        corners: list[Point3] = []
        for x, z in section:
            half_breadth = half_width - max(0.0, z - self.rise + chamfer)
            corners += [(x, -1 * half_breadth, z), (x, 1 * half_breadth, z)]
        return corners

    def _list_lip_corners(self) -> list[Point3]:
        """List the corners of the lip, between the chamfered sides of the tooth [m]."""
        half_width = self.body.half_width
        chamfer = self.body.edge_break.nominal
        corners: list[Point3] = []
        for x in (self.opening.nominal, 0.0):
            for z in (self.marginal_gap.nominal, self.rise):
                half_breadth = half_width - chamfer - z
                corners += [(x, -1 * half_breadth, z), (x, 1 * half_breadth, z)]
        return corners

    def characteristics(self) -> Iterator[Characteristic]:
        gap = self.marginal_gap
        rise = self.horizontal_discrepancy
        depth = self.gap_depth
        half_length = self.body.half_length
        tooth = make_plane_rule(2, 0.0, x=-0.5 * half_length)
        crown = make_plane_rule(2, rise.nominal, x=0.5 * half_length)
        halfway_down = -0.5 * depth.nominal
        wall = make_plane_rule(0, 0.0, z=halfway_down)
        crown_wall = make_plane_rule(0, gap.nominal, z=halfway_down)
        yield make_characteristic("marginal_gap", "distance", gap, wall, crown_wall, method=ACROSS)
        yield make_characteristic(
            "horizontal_discrepancy", "distance", rise, tooth, crown, method=PROFILE
        ).mirrored_to_positive
        yield from self._yield_vertical_discrepancy_characteristics(wall, crown)
        yield from make_form_characteristics(self.face_demands, tooth, crown, "tooth", "crown")
        yield make_characteristic(
            "gap_depth",
            "distance",
            depth,
            make_plane_rule(2, -depth.nominal, x=0.5 * gap.nominal),
            tooth,
            label="depth of the gap",
            method="microscope",
        )
        yield from self.yield_body_characteristics(tooth, crown, wall)
        yield make_burr_characteristic(self.face_demands["burr"], "tooth and crown")

    def _yield_vertical_discrepancy_characteristics(
        self, tooth_wall: FaceRule, crown_face: FaceRule
    ) -> Iterator[Characteristic]:
        """Yield what holds the way from the tooth's wall to the margin of the crown."""
        opening = self.opening
        gap = self.marginal_gap.nominal
        key = "vertical_discrepancy"
        if opening.nominal > gap:
            yield from self._yield_bevel_characteristics(tooth_wall, crown_face)
        elif opening.nominal < 0.0:
            end = make_plane_rule(0, opening.nominal, z=0.5 * (gap + self.rise))
            label = "vertical discrepancy, lip over the tooth"
            yield make_characteristic(
                key, "distance", opening, tooth_wall, end, label=label, method=ACROSS
            ).mirrored_to_positive
            under_lip = make_plane_rule(2, gap, x=0.5 * opening.nominal)
            yield make_characteristic(
                "lip_gap",
                "distance",
                self.marginal_gap,
                make_plane_rule(2, 0.0, x=-0.5 * self.body.half_length),
                under_lip,
                label="gap under the lip, over the tooth",
                method=ACROSS,
            )
        elif self.vertical_discrepancy is not None:
            yield make_characteristic(key, "note", opening, method=ACROSS)

    def _yield_bevel_characteristics(
        self, tooth_wall: FaceRule, crown_face: FaceRule
    ) -> Iterator[Characteristic]:
        """Yield place and angle of a bevelled margin."""
        opening = self.opening
        gap = self.marginal_gap.nominal
        middle_x = 0.5 * (gap + opening.nominal)
        middle_z = self.rise - 0.5 * (opening.nominal - gap)
        bevel = FaceRule("SLOPE", holds={0: middle_x, 2: middle_z})
        edge = EdgeRule(bevel, crown_face)
        yield make_characteristic(
            "vertical_discrepancy", "distance", opening, tooth_wall, edge, method=ACROSS
        )
        angle = Dimension(_BEVEL_ANGLE, ANGULAR_DEVIATION, -ANGULAR_DEVIATION, "angle")
        label = "bevel of the margin"
        yield make_characteristic(
            "bevel_angle", "angle", angle, bevel, crown_face, label=label, method=ACROSS
        )

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        yield self.measure_gap(mesh, self.body.length)
        opening = self.opening.nominal
        crown = mesh.measure_face_height_beside(opening, +1)
        tooth = mesh.measure_face_height_beside(
            self.body.edge_break.nominal - self.body.half_length, +1
        )
        yield Finding("horizontal discrepancy", self.rise, crown - tooth, NANOMETRE)
        yield Finding("vertical discrepancy", opening, mesh.find_level_face_start(crown), NANOMETRE)

    @make_rules_validator
    def _yield_fit_breaches(self) -> Iterator[str]:
        """Yield what keeps the margin from fitting the block."""
        body = self.body
        gap = self.marginal_gap.nominal
        opening = abs(self.opening.nominal)
        depth = self.gap_depth.nominal
        largest = 0.5 * (body.half_length - body.edge_break.nominal)
        if gap >= largest:
            rule = "be narrower than a quarter of the body"
            yield describe_breach("marginal_gap", rule, largest, gap)
        if opening >= largest:
            rule = "be smaller than a quarter of the body"
            yield describe_breach("vertical_discrepancy", rule, largest, opening)
        deepest = 0.25 * body.thickness.nominal
        if depth >= deepest:
            rule = "be below a quarter of the thickness"
            yield describe_breach("gap_depth", rule, deepest, depth)
        yield from self.check_engraving_and_stock()
        yield from self._yield_rise_breaches()

    def _yield_rise_breaches(self) -> Iterator[str]:
        """Yield what is wrong with the discrepancies beside gap depth and edge break."""
        gap = self.marginal_gap.nominal
        opening = self.opening.nominal
        rise = self.horizontal_discrepancy.nominal
        depth = self.gap_depth.nominal
        chamfer = self.body.edge_break.nominal
        lowest = -rise  # depth at which the margin of the crown ends
        if opening >= 0.0:
            lowest = abs(opening - gap) - rise
        if lowest >= depth:
            yield describe_breach("gap_depth", "reach below the margin", lowest, depth)
        if abs(rise) >= chamfer and chamfer != 0.0:
            rule = "be smaller than body.edge_break"
            yield describe_breach("horizontal_discrepancy", rule, chamfer, abs(rise))
