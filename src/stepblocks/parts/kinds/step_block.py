"""The step block: a working edge, and a groove or ridge of the same height or a second step."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator

from stepblocks import cad
from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface, FurtherStep, Step
from stepblocks.contact.relieved_step import RelievedStep
from stepblocks.parts.body import Block, Body, Stock
from stepblocks.parts.body_solid import (
    OVER,
    WorkingFace,
    compute_half_block_volume,
    compute_slab_volume,
    list_half_hull_points,
    make_body_cuts,
)
from stepblocks.parts.characteristics import (
    MICROSCOPE,
    PROFILE,
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    make_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    LabelledText,
    Table,
    WorkingFaces,
    complete_face_demands,
    declare_default,
    describe_breach,
    make_rules_validator,
    read_none_as_absent,
)
from stepblocks.parts.face_characteristics import (
    make_edge_characteristics,
    make_form_characteristics,
)
from stepblocks.parts.felt_tolerance import FeltTolerance, list_felt_tolerance_rows
from stepblocks.parts.kind import (
    COARSE_DEFLECTION,
    CONTACT_DEFLECTION,
    NANOMETRE,
    CloseUp,
    Finding,
    Manifold,
    MeasuredMesh,
    Part,
    Verdict,
    choose_exaggeration,
)
from stepblocks.parts.material import MaterialField
from stepblocks.parts.relief import Relief, list_untouched_ball_rows
from stepblocks.parts.revolution import Point, Point3
from stepblocks.parts.second_step import SecondStep
from stepblocks.parts.shapes import make_hull, split_solid
from stepblocks.parts.tolerance import Dimension, Length, PositiveLength

# Least height of a step [m]: the kernel takes points within 100 nm for one, so that lower steps
# lose their faces, or name one face twice; a sharp edge needs more
_LEAST_ROUNDED = 0.2e-6
_LEAST_SHARP = 0.5e-6
_LONGEST_STEM = 28  # letters of an identity that are kept in the name of one of its edges


class MetrologyFeature(Table):
    """A groove or ridge that ISO 5436-1 type A1 can evaluate; a single edge cannot be.

    Attributes
    ----------
    kind : str
        ``"groove"`` in the upper face, its floor level with the lower face; or ``"ridge"`` on the
        lower, level with the upper.
    width : Dimension
        Width W between its edges along x [m]; a plane face of at least W lies on either side.
    lane : Dimension
        Length of the lane along y, from the back side of the block [m].
    distance : Dimension
        Distance of its nearer edge from the working edge [m].
    """

    kind: Literal["groove", "ridge"] = "groove"
    width: PositiveLength = declare_default("0.6 mm", "0.05 mm")
    lane: PositiveLength = declare_default("6 mm")
    distance: PositiveLength = declare_default("2 mm", "0.1 mm")

    @property
    def depth_key(self) -> str:
        """Key of the characteristic that states its depth or height."""
        if self.kind == "groove":
            return "groove_depth"
        return "ridge_height"


class StepBlock(Block):
    """A block with one working edge, at x = 0.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    height : Dimension
        Height H of the step [m].
    edge_radius : Dimension
        Radius r of the working edge; 0 is sharp [m].
    body : Body
        Size of the block and its mounting.
    stock : tuple of float or None
        Stock that the workshop has, along x, y and z [m]; left out, the setup sheet chooses it.
    metrology : MetrologyFeature or None
        Groove or ridge that ISO 5436-1 type A1 can evaluate; None where it is left out.
    relief : Relief or None
        Relief at the root of the riser; None where there is none.
    second_step : SecondStep or None
        Another edge on the upper face, in place of groove or ridge; None where there is none.
    material : Material
        What it is made of, with its density [kg/m^3].
    working_faces : WorkingFaces or None
        Demands on the faces beside the edge; None where the file states none.
    tolerance : FeltTolerance or None
        What its ring may change by: limits of `height` and `edge_radius` follow from it where the
        file states none.
    """

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "step_block"
    kind_name: ClassVar[str] = "step block"
    counterface_fields: ClassVar[dict[str, str]] = {
        "height": "height",
        "edge_radius": "edge_radius",
    }
    governing_field: ClassVar[str] = "height"

    height: PositiveLength = declare_default(otherwise="1 um")
    edge_radius: Length = declare_default("0 um", otherwise="+2 um / -0 um")
    body: Body = declare_default({})
    stock: Stock | None = None
    metrology: Annotated[MetrologyFeature | None, BeforeValidator(read_none_as_absent)] = (
        declare_default({})
    )
    relief: Annotated[Relief | None, BeforeValidator(read_none_as_absent)] = None
    second_step: Annotated[SecondStep | None, BeforeValidator(read_none_as_absent)] = None
    material: MaterialField = declare_default("steel")
    working_faces: WorkingFaces | None = None
    tolerance: FeltTolerance | None = None
    _is_further_edge: bool = False  # whether it stands for the second edge of another block

    @property
    def sizes(self) -> dict[str, Dimension]:
        sizes = dict(super().sizes)
        if self.relief is not None:
            sizes["relief_width"] = self.relief.width
            sizes["relief_depth"] = self.relief.depth
        return sizes

    def make_counterface(self, **sizes: float) -> Counterface:
        height = sizes["height"]
        edge_radius = max(sizes["edge_radius"], 0.0)
        if self._is_further_edge:
            return FurtherStep(height, edge_radius)
        if self.relief is None:
            return Step(height, edge_radius)
        return RelievedStep(height, edge_radius, sizes["relief_width"], sizes["relief_depth"])

    @property
    def last_edge(self) -> float:
        if self.second_step is None:
            return 0.0
        return self.second_step.distance.nominal

    @property
    def surface_corners(self) -> tuple[float, ...]:
        corners = super().surface_corners
        if self.second_step is not None:
            corners += self.second_step.corner_positions
        return corners

    def sample_surface(self, x: Array) -> Array:
        heights = super().sample_surface(x)
        if self.second_step is not None:
            heights = heights + self.second_step.sample_rise(x)
        return heights

    def list_felt_edges(self) -> tuple["StepBlock", ...]:
        second = self.second_step
        if second is None:
            return (self,)
        update = {"height": second.height, "edge_radius": second.edge_radius, "second_step": None}
        further = self.model_copy(update=update)
        further._is_further_edge = True
        return (self, further)

    def split_edges(self) -> tuple["StepBlock", ...]:
        if self.second_step is None:
            return (self,)
        blocks = []
        for edge, name in zip(self.list_felt_edges(), ("first-step", "second-step"), strict=True):
            stem = self.id[:_LONGEST_STEM].rstrip("-")
            block = edge.model_copy(update={"id": f"{stem}-{name}", "second_step": None})
            block._is_further_edge = False
            blocks.append(block)
        return tuple(blocks)

    def derived(self) -> list[LabelledText]:
        return [
            *list_felt_tolerance_rows(self.tolerance),
            *list_untouched_ball_rows(self.counterface()),
        ]

    def top(self, x: float) -> float:
        # circle about (r, H - r) between the two faces
        height = self.height.nominal
        radius = self.edge_radius.nominal
        if x < 0.0:
            return self._compute_lower_surface_height(x)
        if x >= radius and self.second_step is not None:
            return self.second_step.top(x, height)
        if x >= radius:
            return height
        return height - radius + math.sqrt(x * (2.0 * radius - x))

    def _compute_lower_surface_height(self, x: float) -> float:
        """Compute the height of the surface left of the riser [m]."""
        if self.relief is None or x < -self.relief.width.nominal:
            return 0.0
        return -self.relief.depth.nominal

    def solids(self) -> list[cad.door.Body]:
        body = self.extrude_section(self._outline_step_section())
        cuts = make_body_cuts(self.body, self.id, self._list_upper_working_faces())
        feature = self.metrology
        if feature is not None:
            if feature.kind == "ridge":
                body = cad.kernel.fuse([body, self._make_ridge(feature)])
            else:
                cuts.append(self._make_groove(feature))
        if cuts:
            body = cad.kernel.cut(body, cuts)
        return [body]

    def _outline_step_section(self) -> cad.door.Outline:
        """Outline the step as (x, z) [m], from the upper face to the lower one."""
        height = self.height.nominal
        radius = self.edge_radius.nominal
        crest: list[object] = []
        if self.second_step is not None:
            crest += self.second_step.outline_section(height)
        crest.append((radius, height))
        if radius > 0.0:
            bow = radius * (1.0 - math.sqrt(0.5))
            crest.append(((bow, height - bow), (0.0, height - radius)))
        if self.relief is not None:
            crest += self.relief.section_corners
        elif radius < height:
            crest.append((0.0, 0.0))
        return crest

    def _make_groove(self, feature: MetrologyFeature) -> cad.door.Body:
        """Make the groove to cut, from z = 0 over the height of the step."""
        x = feature.distance.nominal
        y = self.body.half_width - feature.lane.nominal
        low = (x, y, 0.0)
        high = (
            x + feature.width.nominal,
            y + (feature.lane.nominal + OVER),
            self.height.nominal + OVER,
        )
        return cad.kernel.make_box(low, high)

    def _make_ridge(self, feature: MetrologyFeature) -> cad.door.Body:
        """Make the ridge to add, from z = 0 to the height of the step.

        It ends where the edge break of its side begins, level with the upper face.
        """
        x = -feature.distance.nominal - feature.width.nominal
        y = self.body.half_width - feature.lane.nominal
        low = (x, y, 0.0)
        high = (x + feature.width.nominal, y + feature.lane.nominal, self.height.nominal)
        return cad.kernel.make_box(low, high)

    def volumes(self) -> tuple[float, ...]:
        # two halves, less the rounding, with or without the feature, less holes
        half = self.body.half_length
        left = compute_half_block_volume(self.body, half, 0.0)
        right = self._compute_volume_right_of_edge()
        volume = left + right - self._compute_rounding_volume(self.edge_radius.nominal)
        if self.metrology is not None:
            volume += self._compute_signed_feature_volume(self.metrology)
        if self.relief is not None:
            volume -= self.relief.compute_removed_volume(self.body)
        return (volume - self.removed_volume,)

    def _compute_volume_right_of_edge(self) -> float:
        """Compute the volume right of the working edge [m^3], as if that were sharp."""
        half = self.body.half_length
        height = self.height.nominal
        second = self.second_step
        if second is None:
            return compute_half_block_volume(self.body, half, height)
        distance = second.distance.nominal
        between = compute_slab_volume(self.body, distance, height)
        behind = compute_half_block_volume(self.body, half - distance, height + second.rise)
        return between + behind - self._compute_rounding_volume(second.edge_radius.nominal)

    def _compute_rounding_volume(self, radius: float) -> float:
        """Compute what a rounding takes off an edge [m^3].

        It takes u(z) = r - sqrt(r^2 - zeta^2) off a face that is W - 2 (c - r) - 2 zeta wide, and
        so less at its two corners by r^3 / 3.
        """
        chamfer = self.body.edge_break.nominal
        width = self.body.width.nominal - 2.0 * max(chamfer - radius, 0.0)
        corners = 0.0
        if chamfer > 0.0:
            corners = radius**3 / 3.0
        return width * radius * radius * (1.0 - 0.25 * math.pi) - corners

    def _compute_signed_feature_volume(self, feature: MetrologyFeature) -> float:
        """Compute what a ridge adds or a groove, with a negative sign, takes away [m^3].

        It lies between the boundary of the lane and the chamfered side, z from 0 to H. The edge
        break of the side runs on through a ridge, from c inside at z = 0.
        """
        height = self.height.nominal
        chamfer = self.body.edge_break.nominal
        side = 1.0 if feature.kind == "ridge" else -1.0
        broken_off = 0.0
        if chamfer > 0.0:
            broken_off = chamfer * height + side * 0.5 * height * height
        section = feature.lane.nominal * height - broken_off
        return side * feature.width.nominal * section

    def hulls(self) -> list[Manifold]:
        height = self.height.nominal
        feature = self.metrology
        left = make_hull(list_half_hull_points(self.body, -1.0, 0.0, [(0.0, 0.0)]))
        radius = self.edge_radius.nominal
        rounding = _list_rounding_points(height, radius)
        left_pieces = [left]
        if self.relief is not None:
            left_pieces = self.relief.split_left_half(left)
        if self.second_step is not None:
            return [*left_pieces, *self._make_pieces_beside_second_edge(self.second_step, rounding)]
        right = make_hull(list_half_hull_points(self.body, 1.0, height, rounding))
        if feature is None:
            return [*left_pieces, right]
        if feature.kind == "ridge":
            return [*left_pieces, right, make_hull(self._list_ridge_corners(feature))]
        return [*left_pieces, *self._split_half_at_groove(feature, right)]

    def _make_pieces_beside_second_edge(
        self, second: SecondStep, first_rounding: Sequence[Point]
    ) -> list[Manifold]:
        """Make the pieces before and behind a second edge; `first_rounding` is of the first."""
        height = self.height.nominal
        radius = second.edge_radius.nominal
        distance = second.distance.nominal
        top = height + second.rise
        foot = [(distance, height)]
        crest = [(distance, top)]
        if second.direction == "up":
            crest = [(distance + x, z) for x, z in _list_rounding_points(top, radius)]
        else:
            foot = [(distance - x, z) for x, z in _list_rounding_points(height, radius)]
        middle = 0.5 * distance
        between = []
        for point in list_half_hull_points(self.body, 1.0, height, first_rounding):
            if point[0] < middle:
                between.append(point)
        for point in list_half_hull_points(self.body, -1.0, height, foot, distance):
            if point[0] > middle:
                between.append(point)
        behind = list_half_hull_points(self.body, 1.0, top, crest, distance)
        return [make_hull(between), make_hull(behind)]

    def _list_ridge_corners(self, feature: MetrologyFeature) -> list[Point3]:
        """List the corners of a ridge (x, y, z) [m]."""
        height = self.height.nominal
        near = -feature.distance.nominal
        front = self.body.half_width - feature.lane.nominal
        back = self.body.half_width - self.body.edge_break.nominal
        section = ((front, 0.0), (front, height), (back, 0.0), (back - height, height))
        corners = []
        for x in (near - feature.width.nominal, near):
            for y, z in section:
                corners.append((x, y, z))
        return corners

    def _split_half_at_groove(
        self, feature: MetrologyFeature, right_half: Manifold
    ) -> list[Manifold]:
        """Cut the right half into convex pieces about the groove."""
        near = feature.distance.nominal
        far = near + feature.width.nominal
        lane = self.body.half_width - feature.lane.nominal
        before, from_groove = split_solid(right_half, "x", near)
        middle, after = split_solid(from_groove, "x", far)
        in_front, groove = split_solid(middle, "y", lane)
        floor, _ = split_solid(groove, "z", 0.0)
        return [before, in_front, floor, after]

    def chordal_error(self, face: cad.door.Face) -> float:
        if face.kind == "CYLINDER" and self._has_edge_of_radius(face.radius):
            return CONTACT_DEFLECTION
        return COARSE_DEFLECTION

    def _has_edge_of_radius(self, radius: float) -> bool:
        """Tell whether an edge has a radius [m]."""
        radii = [self.edge_radius.nominal]
        if self.second_step is not None:
            radii.append(self.second_step.edge_radius.nominal)
        return any(abs(radius - edge_radius) < NANOMETRE for edge_radius in radii)

    def characteristics(self) -> Iterator[Characteristic]:
        height = self.height.nominal
        radius = self.edge_radius.nominal
        body = self.body
        demands = self.face_demands
        lower = make_plane_rule(2, 0.0, x=-0.5 * body.half_length)
        second = self.second_step
        end = body.half_length if second is None else second.distance.nominal
        upper = make_plane_rule(2, height, x=0.5 * end)
        yield make_characteristic(
            "step_height", "distance", self.height, lower, upper, method=PROFILE
        )
        edge: Rule = EdgeRule(make_plane_rule(0, 0.0, z=0.5 * height), upper)
        if radius > 0.0:
            edge = FaceRule("CYLINDER", radius=radius, holds={0: 0.5 * radius})
        yield make_characteristic(
            "edge_radius", "radius", self.edge_radius, edge, method="profilometer, arc fit"
        )
        chamfer = body.edge_break.nominal
        extent = (body.half_length - chamfer, body.width.nominal - 2.0 * chamfer)
        for form in make_form_characteristics(demands, lower, upper, "lower face", "upper face"):
            if form.key == "flatness_upper" and second is not None:
                extent = (end, body.width.nominal - 2.0 * chamfer)
            yield replace(form, extent=extent)
        if self.metrology is not None:
            yield from self._yield_groove_or_ridge_characteristics(self.metrology, lower, upper)
        if self.relief is not None:
            yield from self.relief.yield_characteristics(lower)
        wall = None
        if radius < height:
            wall = make_plane_rule(0, 0.0, y=-0.25 * body.width.nominal)
        if second is not None:
            demands_behind = complete_face_demands(self.working_faces, second.height)
            yield from second.yield_characteristics(body, demands_behind, upper, height, wall)
        yield from self.yield_body_characteristics(lower, upper, wall)
        yield from make_edge_characteristics(demands["burr"], wall, lower)

    def _yield_groove_or_ridge_characteristics(
        self, feature: MetrologyFeature, lower_face: FaceRule, upper_face: FaceRule
    ) -> Iterator[Characteristic]:
        """Yield depth, width and length of groove or ridge, and its distance from a small arc."""
        height = self.height.nominal
        back = self.body.half_width
        lane = back - 0.5 * feature.lane.nominal  # its middle along y
        kind = feature.kind
        side = 1.0 if kind == "groove" else -1.0
        near = side * feature.distance.nominal
        width = side * feature.width.nominal
        middle = near + 0.5 * width
        if kind == "groove":
            faces = (make_plane_rule(2, 0.0, x=middle, y=lane), upper_face)
        else:
            faces = (lower_face, make_plane_rule(2, height, x=middle, y=lane))
        yield make_characteristic(
            feature.depth_key,
            "distance",
            self.height,
            *faces,
            method="profilometer, ISO 5436-1 A1",
        )
        near_wall = make_plane_rule(0, near, y=lane)
        far_wall = make_plane_rule(0, near + width, y=lane)
        yield make_characteristic(
            f"{kind}_width", "distance", feature.width, near_wall, far_wall, method="profilometer"
        )
        back_side = make_plane_rule(1, back)
        end = make_plane_rule(1, 2.0 * lane - back, x=middle)
        yield make_characteristic(
            f"{kind}_length", "distance", feature.lane, back_side, end, method=MICROSCOPE
        )
        if self.edge_radius.nominal < height:
            yield make_characteristic(
                f"{kind}_distance",
                "distance",
                feature.distance,
                make_plane_rule(0, 0.0, y=-0.5 * back),
                near_wall,
                label=f"{kind} from edge",
                method="profilometer",
            )

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        beside = 0.0
        if self.relief is not None:
            beside = -self.relief.width.nominal
            floor = mesh.measure_face_height_beside(0.0, -1)
            yield Finding("floor of the relief", -self.relief.depth.nominal, floor, NANOMETRE)
        low = mesh.measure_face_height_beside(beside, -1)
        high = mesh.measure_face_height_beside(self.edge_radius.nominal, +1)
        yield Finding("step height", self.height.nominal, high - low, NANOMETRE)
        yield Finding("lower working face at z = 0", 0.0, low, NANOMETRE)
        if self.second_step is not None:
            yield self._measure_second_step(self.second_step, mesh)

    def _measure_second_step(self, second: SecondStep, mesh: MeasuredMesh) -> Verdict:
        """Measure the rise of a mesh at its second edge."""
        distance = second.distance.nominal
        radius = second.edge_radius.nominal
        before, behind = distance, distance + radius
        if second.direction == "down":
            before, behind = distance - radius, distance
        low = mesh.measure_face_height_beside(before, -1)
        high = mesh.measure_face_height_beside(behind, +1)
        return Finding("rise at the second edge", second.rise, high - low, NANOMETRE)

    def choose_close_up(self) -> CloseUp:
        height = self.height.nominal
        return CloseUp(choose_exaggeration(height), 2.5 * height, (0.0, 0.0, 0.0))

    @property
    def rise(self) -> float:
        rise = super().rise
        if self.second_step is not None:
            rise += self.second_step.rise
        return rise

    @property
    def highest(self) -> float:
        return max(face.height for face in self._list_upper_working_faces())

    def _list_upper_working_faces(self) -> list[WorkingFace]:
        """List the working faces right of the lower one."""
        height = self.height.nominal
        faces = [WorkingFace(0.0, height)]
        if self.second_step is not None:
            begin = self.second_step.distance.nominal
            faces.append(WorkingFace(begin, height + self.second_step.rise))
        return faces

    @model_validator(mode="before")
    @classmethod
    def _leave_out_metrology_beside_second_step(cls, raw: object) -> object:
        """Leave groove or ridge out beside a second step, where the file states none."""
        if not isinstance(raw, dict) or raw.get("second_step", "none") in (None, "none"):
            return raw
        return {"metrology": "none", **raw}

    @make_rules_validator
    def _yield_size_breaches(self) -> Iterator[str]:
        """Yield what keeps edge, step and feature from fitting the block."""
        height = self.height.nominal
        radius = self.edge_radius.nominal
        chamfer = self.body.edge_break.nominal
        half_thickness = 0.5 * self.body.thickness.nominal
        yield from _yield_least_height_breach("height", height, radius)
        if radius > height:
            yield describe_breach("edge_radius", "not exceed height", height, radius)
        if height >= chamfer and chamfer != 0.0:
            rule = "be smaller than body.edge_break, or the chamfers of the two faces part"
            yield describe_breach("height", rule, chamfer, height)
        if height >= half_thickness:
            yield describe_breach("height", "be below half the thickness", half_thickness, height)
        yield from self.check_engraving_and_stock()
        if self.relief is not None:
            yield from self.relief.yield_breaches(self.body)
        if self.metrology is not None:
            yield from self._yield_feature_breaches(self.metrology)
        if self.second_step is not None:
            second = self.second_step
            yield from _yield_least_height_breach(
                "second_step.height", second.height.nominal, second.edge_radius.nominal
            )
            yield from second.yield_breaches(self.body, height)
            yield from self._yield_breaches_beside_second_step()

    def _yield_breaches_beside_second_step(self) -> Iterator[str]:
        """Yield what a block with a second step cannot have besides."""
        if self.metrology is not None:
            yield (
                "metrology must be 'none' beside second_step: its walls would be more edges in the "
                f"same trace, got a {self.metrology.kind}"
            )
        if self.relief is not None:
            yield (
                "relief must be left out beside second_step: only the root of a single riser is "
                "relieved and inspected so, got one"
            )

    def _yield_feature_breaches(self, feature: MetrologyFeature) -> Iterator[str]:
        """Yield what keeps groove or ridge from fitting the block."""
        body = self.body
        width = feature.width.nominal
        distance = feature.distance.nominal
        lane = feature.lane.nominal
        room = body.half_length - body.edge_break.nominal
        reach = distance + 2.0 * width
        if reach > room:
            rule = "leave a plane face of its own width on either side"
            yield describe_breach("metrology.width", rule, room, reach)
        least_distance = width + self.edge_radius.nominal
        if distance < least_distance:
            rule = "be at least its width plus edge_radius"
            yield describe_breach("metrology.distance", rule, least_distance, distance)
        if self.relief is not None and feature.kind == "ridge":
            wide = self.relief.width.nominal
            if distance < width + wide:
                rule = "leave a plane face of its own width between ridge and relief"
                yield describe_breach("metrology.distance", rule, width + wide, distance)
        half_width = body.half_width
        if body.mounting is not None and body.mounting.kind == "clearance":
            bore = 0.5 * body.mounting.entry_diameter
            if half_width - lane <= bore:
                rule = "keep clear of the counterbores"
                yield describe_breach("metrology.lane", rule, half_width - bore, lane)
        if lane >= half_width:
            rule = "leave more than half the width to the drag"
            yield describe_breach("metrology.lane", rule, half_width, lane)


def get_second_step(part: Part) -> SecondStep | None:
    """Find the second step of a part; None of a part that has one edge or none."""
    if isinstance(part, StepBlock):
        return part.second_step
    return None


def _list_rounding_points(face_height: float, radius: float) -> list[Point]:
    """List points (x, z) [m] of the rounding of an edge at x = 0 below a face at a height.

    Their chords lie within the contact's error.
    """
    if radius == 0.0:
        return [(0.0, face_height)]
    step = 2.0 * math.acos(max(1.0 - CONTACT_DEFLECTION / radius, 0.0))
    count = max(2, math.ceil(0.5 * math.pi / step) + 1)
    points = []
    for turn in np.linspace(0.0, 0.5 * math.pi, count).tolist():
        x = radius * (1.0 - math.sin(turn))
        z = face_height - radius * (1.0 - math.cos(turn))
        points.append((x, z))
    return points


def _yield_least_height_breach(field: str, height: float, edge_radius: float) -> Iterator[str]:
    """Yield that a step of an edge radius is lower than what the kernel builds, if it is [m]."""
    least_height = _LEAST_ROUNDED if edge_radius > 0.0 else _LEAST_SHARP
    if height < least_height:
        rule = "be at least what the kernel builds so that the built part can be checked"
        yield describe_breach(field, rule, least_height, height)
