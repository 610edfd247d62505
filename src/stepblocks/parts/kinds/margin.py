"""The junction of crown and tooth, as a block.

Terms are those of Holmes et al. 1989; see docs/reference/stimulus-file.md.
"""

import itertools
import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar

from stepblocks import cad
from stepblocks.contact.counterface import Margin
from stepblocks.contact.operating_point import Tissue, Tool
from stepblocks.parts.body import (
    Block,
    Body,
    Stock,
    compute_half_volume,
    compute_strip_volume,
    list_half_corners,
    make_body_cuts,
)
from stepblocks.parts.characteristics import (
    PROFILE,
    Characteristic,
    EdgeRule,
    FaceRule,
    describe_plane,
    make_characteristic,
    make_form_characteristics,
)
from stepblocks.parts.conditions import Gum
from stepblocks.parts.declared import (
    MaterialField,
    WorkingFaces,
    check_below,
    check_rule,
    declare_default,
    make_rules_validator,
)
from stepblocks.parts.kind import (
    NANOMETRE,
    Finding,
    Manifold,
    MeasuredMesh,
    Part,
    Verdict,
    choose_exaggeration,
)
from stepblocks.parts.shapes import make_hull, split_solid
from stepblocks.parts.tolerance import ANGULAR_DEVIATION, Dimension, PositiveLength, SignedLength
from stepblocks.quantities import format_quantity

ACROSS = "profilometer or microscope"
# largest clinically acceptable absolute marginal discrepancy [m] (the paper; McLean and von
# Fraunhofer 1971 say 120 um)
_CLINICAL_LIMIT = 100e-6


class CrownMargin(Part):
    """What all forms share: x along the path of draw from root to crown, z outwards.

    The cavosurface angle of the tooth is the origin.
    """

    counterface_fields: ClassVar = {
        "gap": "marginal_gap",
        "rise": "horizontal_discrepancy",
        "opening": "vertical_discrepancy",
    }

    marginal_gap: PositiveLength = declare_default(otherwise="10 um")  # g
    # h; positive: overextended
    horizontal_discrepancy: SignedLength = declare_default("0 um", otherwise="10 um")
    # v; left out, it is g
    vertical_discrepancy: SignedLength | None = declare_default(None, otherwise="10 um")
    gum: Gum | None = None  # beside the margin; none where the file does not say
    material: MaterialField = declare_default("zirconia")

    def tissue(self, tool: Tool) -> Tissue:
        return Tissue() if self.gum is None else self.gum.tissue(tool.frequency)

    @property
    @abstractmethod
    def floor_depth_and_slope(self) -> tuple[float, float]:
        """Depth of the gap [m] where it begins, and how steeply its floor falls from there [1]."""

    def make_counterface(self, **sizes: float) -> Margin:
        gap = sizes["gap"]
        return Margin(
            max(gap, 0.0), sizes.get("opening", gap), sizes["rise"], *self.floor_depth_and_slope
        )

    @property
    def opening(self) -> Dimension:
        """The vertical discrepancy in force: the one stated, or the marginal gap."""
        return self.marginal_gap if self.vertical_discrepancy is None else self.vertical_discrepancy

    @property
    def absolute_discrepancy(self) -> float:
        """Absolute marginal discrepancy [m]: from the crown's margin to the cavosurface angle."""
        return math.hypot(self.opening.nominal, self.horizontal_discrepancy.nominal)

    @property
    def corner(self) -> list[tuple[float, float]]:
        """Outline of the crown's margin from inside the gap to its outer corner [m]."""
        g, v, h = (
            self.marginal_gap.nominal,
            self.opening.nominal,
            self.horizontal_discrepancy.nominal,
        )
        if v < 0.0:
            return [(g, g), (v, g), (v, h)]
        return [(g, h)] if v == g else [(g, h - abs(v - g)), (v, h)]

    @make_rules_validator
    def _check_lip_clears_the_tooth(self) -> Iterator[str]:
        v, g, h = (
            self.opening.nominal,
            self.marginal_gap.nominal,
            self.horizontal_discrepancy.nominal,
        )
        if v < 0.0 and h <= g:
            yield (
                f"horizontal_discrepancy must exceed marginal_gap ({format_quantity(g, 'length')}) "
                f"where vertical_discrepancy is negative, got {format_quantity(h, 'length')}"
            )

    def measure_gap(self, mesh: MeasuredMesh, length: Dimension) -> Verdict:
        """Measure the marginal gap on the mesh of a body of this length."""
        reach = 0.25 * length.nominal
        return Finding(
            "marginal gap",
            self.marginal_gap.nominal,
            mesh.measure_wall_position(-1, reach) - mesh.measure_wall_position(+1, reach),
            NANOMETRE,
        )

    def choose_close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        rise = abs(self.horizontal_discrepancy.nominal)
        gap = self.marginal_gap.nominal
        wide = 2.5 * max(rise, gap, abs(self.opening.nominal))
        return (choose_exaggeration(rise) if rise else 1.0), wide, (0.5 * gap, 0.0, 0.0)

    def derived(self) -> list[list[str]]:
        accepted = self.absolute_discrepancy <= _CLINICAL_LIMIT * (1.0 + 1e-12)
        grade = "clinically acceptable" if accepted else "above the clinical limit of 100 um"
        return [
            ["absolute marginal discrepancy", f"{self.absolute_discrepancy * 1e6:.4g} um, {grade}"]
        ]


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
        Distance v of the crown's margin along the path of draw [m]; None means that it is the gap.
    gum : Gum or None
        Gum beside the margin; None where the file does not say.
    material : Material
        What it is made of, with its density [kg/m^3].
    gap_depth : Dimension
        Depth of the gap below the surface of the tooth [m].
    body : Body
        Size of the block and its mounting.
    stock : tuple of float or None
        Stock that the workshop has, along x, y and z [m]; None lets the setup sheet choose it.
    working_faces : WorkingFaces or None
        Demands on the faces of tooth and crown; None where the file states none.
    """

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
        # Uppermost of the straight lines of the section at x
        depth, far = self.gap_depth.nominal, self.body.length.nominal
        lines = itertools.pairwise(
            [
                (-far, 0.0),
                (0.0, 0.0),
                (0.0, -depth),
                (self.marginal_gap.nominal, -depth),
                *self.corner,
                (far, self.rise),
            ]
        )
        across = [
            (a, b) for a, b in lines if a[0] != b[0] and min(a[0], b[0]) <= x <= max(a[0], b[0])
        ]
        return max(za + (zb - za) * (x - xa) / (xb - xa) for (xa, za), (xb, zb) in across)

    def solids(self) -> list[cad.door.Body]:
        gap, depth = self.marginal_gap.nominal, self.gap_depth.nominal
        return [
            cad.kernel.cut(
                self.extrude_section(
                    [*reversed(self.corner), (gap, -depth), (0.0, -depth), (0.0, 0.0)]
                ),
                make_body_cuts(self.body, self.id, self.rise),
            )
        ]

    def volumes(self) -> tuple[float, ...]:
        # Add the halves on either side of x = 0, less the gap, corrected at the corner
        body = self.body
        half, depth = body.half_length, self.gap_depth.nominal
        g, v, h = self.marginal_gap.nominal, self.opening.nominal, self.rise
        volume = compute_half_volume(body, half, 0.0) + compute_half_volume(body, half, h)
        above = [*self.corner, (0.0, h)] if v >= 0.0 else [(g, g), (0.0, g)]
        volume -= compute_strip_volume(body, h, [(0.0, -depth), (g, -depth), *above])
        if (
            v < 0.0
            # the lip stands over the tooth, on the tooth's side, where the left half's chamfer
            # applies
        ):
            c = body.edge_break.nominal
            narrowed = 2.0 * c * (h - g) + h * h - g * g if c > 0.0 else 0.0
            volume += -v * (body.width.nominal * (h - g) - narrowed)
        return (volume - self.removed_volume,)

    def hulls(self) -> list[Manifold]:
        body = self.body
        gap, rise, opening = self.marginal_gap.nominal, self.rise, self.opening.nominal
        left = make_hull(list_half_corners(body, -1.0, 0.0, [(0.0, 0.0)]))
        right = make_hull(list_half_corners(body, 1.0, rise, [(0.0, rise)]))
        under, crown = split_solid(right, "x", gap)
        floor, _ = split_solid(under, "z", -self.gap_depth.nominal)
        half, c = body.half_width, body.edge_break.nominal

        def make_prism(section: list[tuple[float, float]]) -> Manifold:
            return make_hull(
                (x, y * (half - max(0.0, z - rise + c)), z) for x, z in section for y in (-1, 1)
            )

        if opening > gap:  # bevelled: cut the corner off along 45 degrees
            slope = math.sqrt(0.5)
            crown = crown.trim_by_plane((slope, 0.0, -slope), -1e3 * (rise - opening) * slope)
        pieces = [left, floor, crown]
        if opening < 0.0:
            lip = [
                (x, y * (half - c - z), z)
                for x in (opening, 0.0)
                for z in (gap, rise)
                for y in (-1, 1)
            ]
            pieces += [
                make_hull(lip),
                make_prism([(x, z) for x in (0.0, gap) for z in (gap, rise)]),
            ]
        elif opening < gap:
            pieces.append(make_prism([(gap, rise - (gap - opening)), (opening, rise), (gap, rise)]))
        return pieces

    def characteristics(self) -> Iterator[Characteristic]:
        g, h, depth = self.marginal_gap, self.horizontal_discrepancy, self.gap_depth
        half = self.body.half_length
        tooth, crown = (
            describe_plane(2, 0.0, x=-0.5 * half),
            describe_plane(2, h.nominal, x=0.5 * half),
        )
        low = -0.5 * depth.nominal
        wall = describe_plane(0, 0.0, z=low)
        yield make_characteristic(
            "marginal_gap", "distance", g, wall, describe_plane(0, g.nominal, z=low), method=ACROSS
        )
        yield make_characteristic(
            "horizontal_discrepancy", "distance", h, tooth, crown, method=PROFILE
        ).unsigned
        yield from self._list_opening_characteristics(wall, crown)
        yield from make_form_characteristics(self.face_demands, tooth, crown, "tooth", "crown")
        yield make_characteristic(
            "gap_depth",
            "distance",
            depth,
            describe_plane(2, -depth.nominal, x=0.5 * g.nominal),
            tooth,
            label="depth of the gap",
            method="microscope",
        )
        yield from self.list_body_characteristics(tooth, crown, wall)

    def _list_opening_characteristics(
        self, wall: FaceRule, crown: FaceRule
    ) -> Iterator[Characteristic]:
        # From the tooth's wall to the margin of the crown
        v, g, h = self.opening, self.marginal_gap.nominal, self.rise
        key = "vertical_discrepancy"
        if v.nominal > g:
            bevel = FaceRule(
                "SLOPE", holds={0: 0.5 * (g + v.nominal), 2: h - 0.5 * (v.nominal - g)}
            )
            yield make_characteristic(
                key, "distance", v, wall, EdgeRule(bevel, crown), method=ACROSS
            )
            angle = Dimension(math.radians(45.0), ANGULAR_DEVIATION, -ANGULAR_DEVIATION, "angle")
            yield make_characteristic(
                "bevel_angle",
                "angle",
                angle,
                bevel,
                crown,
                label="bevel of the margin",
                method=ACROSS,
            )
        elif v.nominal < 0.0:
            end = describe_plane(0, v.nominal, z=0.5 * (g + h))
            yield make_characteristic(
                key,
                "distance",
                v,
                wall,
                end,
                label="vertical discrepancy, lip over the tooth",
                method=ACROSS,
            ).unsigned
        elif self.vertical_discrepancy is not None:
            yield make_characteristic(key, "note", v, method=ACROSS)

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        yield self.measure_gap(mesh, self.body.length)
        crown = mesh.measure_level_beside(self.opening.nominal, +1)
        tooth = mesh.measure_level_beside(self.body.edge_break.nominal - self.body.half_length, +1)
        yield Finding("horizontal discrepancy", self.rise, crown - tooth, NANOMETRE)
        yield Finding(
            "vertical discrepancy", self.opening.nominal, mesh.start_of_level(crown), NANOMETRE
        )

    @make_rules_validator
    def _check_fit_in_body(self) -> Iterator[str]:
        body = self.body
        g, v = self.marginal_gap.nominal, self.opening.nominal
        h, depth, chamfer = (
            self.horizontal_discrepancy.nominal,
            self.gap_depth.nominal,
            self.body.edge_break.nominal,
        )
        room = body.half_length - chamfer
        yield check_below("marginal_gap", "be narrower than a quarter of the body", g, 0.5 * room)
        yield check_below(
            "vertical_discrepancy", "be smaller than a quarter of the body", abs(v), 0.5 * room
        )
        yield check_below(
            "gap_depth", "be below a quarter of the thickness", depth, 0.25 * body.thickness.nominal
        )
        yield from self.require_engravable()
        if self.working_faces is not None and self.working_faces.burr is not None:
            yield "working_faces.burr is for step blocks"
        deepest = abs(v - g) - h if v >= 0.0 else -h
        yield check_rule(deepest < depth, "gap_depth", "reach below the margin", deepest, depth)
        yield check_rule(
            abs(h) < chamfer or chamfer == 0.0,
            "horizontal_discrepancy",
            "be smaller than body.edge_break",
            chamfer,
            abs(h),
        )
