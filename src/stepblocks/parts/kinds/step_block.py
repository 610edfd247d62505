"""The step block: one working edge, and a groove or ridge of the same height."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator

from stepblocks import cad
from stepblocks.contact.counterface import Step
from stepblocks.parts.body import (
    OVER,
    Block,
    Body,
    Stock,
    compute_half_volume,
    list_half_corners,
    make_body_cuts,
)
from stepblocks.parts.characteristics import (
    MICROSCOPE,
    PROFILE,
    Characteristic,
    EdgeRule,
    FaceRule,
    describe_plane,
    make_characteristic,
    make_edge_characteristics,
    make_form_characteristics,
)
from stepblocks.parts.declared import (
    MaterialField,
    Table,
    WorkingFaces,
    check_below,
    check_rule,
    declare_default,
    make_rules_validator,
    read_none,
)
from stepblocks.parts.kind import (
    COARSE_DEFLECTION,
    CONTACT_DEFLECTION,
    NANOMETRE,
    Finding,
    Manifold,
    MeasuredMesh,
    Verdict,
    choose_exaggeration,
)
from stepblocks.parts.shapes import make_hull, split_solid
from stepblocks.parts.tolerance import Length, PositiveLength


class MetrologyFeature(Table):
    """A groove or ridge that ISO 5436-1 type A1 can evaluate; a single edge cannot be."""

    # ``"groove"`` in the upper face, its floor level with the lower face; or ``"ridge"`` on the
    # lower, level with the upper
    kind: Literal["groove", "ridge"] = "groove"
    # W between its edges along x [m]; a plane face of at least W lies on either side
    width: PositiveLength = declare_default("0.6 mm", "0.05 mm")
    lane: PositiveLength = declare_default("6 mm")  # along y, from the back side of the block [m]
    # from the working edge to its nearer edge [m]
    distance: PositiveLength = declare_default("2 mm", "0.1 mm")


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
        Stock that the workshop has, along x, y and z [m]; None lets the setup sheet choose it.
    metrology : MetrologyFeature or None
        Groove or ridge that ISO 5436-1 type A1 can evaluate; None where it is left out.
    material : Material
        What it is made of, with its density [kg/m^3].
    working_faces : WorkingFaces or None
        Demands on the faces beside the edge; None where the file states none.
    """

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
    metrology: Annotated[MetrologyFeature | None, BeforeValidator(read_none)] = declare_default({})
    material: MaterialField = declare_default("steel")
    working_faces: WorkingFaces | None = None

    def make_counterface(self, **sizes: float) -> Step:
        return Step(sizes["height"], max(sizes["edge_radius"], 0.0))

    def top(self, x: float) -> float:
        # Circle about (r, H - r) between the two faces
        H, r = self.height.nominal, self.edge_radius.nominal
        if x < 0.0:
            return 0.0
        return H if x >= r else H - r + math.sqrt(x * (2.0 * r - x))

    def solids(self) -> list[cad.door.Body]:
        height, radius = self.height.nominal, self.edge_radius.nominal
        crest: list[object] = [(radius, height)]
        if radius > 0.0:
            bow = radius * (1.0 - math.sqrt(0.5))
            crest.append(((bow, height - bow), (0.0, height - radius)))
        if radius < height:
            crest.append((0.0, 0.0))
        body = self.extrude_section(crest)
        cuts = make_body_cuts(self.body, self.id, height)
        if self.metrology is not None and self.metrology.kind == "ridge":
            body = cad.kernel.fuse([body, self._make_feature(self.metrology)])
        elif self.metrology is not None:
            cuts.append(self._make_feature(self.metrology))
        return [cad.kernel.cut(body, cuts) if cuts else body]

    def _make_feature(self, feature: MetrologyFeature) -> cad.door.Body:
        # Make the groove to cut or the ridge to add, from z = 0 to the height of the step
        near, lane = feature.distance.nominal, feature.lane.nominal
        y0 = self.body.half_width - lane
        groove = feature.kind == "groove"
        # a ridge ends where the edge break of its side begins, level with the upper face
        over = OVER if groove else 0.0
        x0 = near if groove else -near - feature.width.nominal
        return cad.kernel.make_box(
            (x0, y0, 0.0),
            (x0 + feature.width.nominal, y0 + (lane + over), self.height.nominal + over),
        )

    def volumes(self) -> tuple[float, ...]:
        # Add two halves, less the rounding, with or without the feature, less holes
        body = self.body
        feature = self.metrology
        H, r = self.height.nominal, self.edge_radius.nominal
        half, c = body.half_length, body.edge_break.nominal
        volume = compute_half_volume(body, half, 0.0) + compute_half_volume(body, half, H)
        # the rounding takes u(z) = r - sqrt(r^2 - zeta^2) off a face that is W - 2 (c - r) - 2 zeta
        # wide, and so less at its two corners by r^3 / 3
        volume -= (body.width.nominal - 2.0 * max(c - r, 0.0)) * r * r * (1.0 - 0.25 * math.pi) - (
            r**3 / 3.0 if c > 0.0 else 0.0
        )
        if feature is not None:
            # from the lane's boundary to the chamfered side, z from 0 to H; the side's edge break
            # runs on through a ridge, from c inside at z = 0
            side = 1.0 if feature.kind == "ridge" else -1.0
            lane, w = feature.lane.nominal, feature.width.nominal
            volume += side * w * (lane * H - (c * H + side * 0.5 * H * H if c > 0.0 else 0.0))
        return (volume - self.removed_volume,)

    def hulls(self) -> list[Manifold]:
        body = self.body
        height = self.height.nominal
        feature = self.metrology
        left = make_hull(list_half_corners(body, -1.0, 0.0, [(0.0, 0.0)]))
        rounding = [(0.0, height)]
        radius = self.edge_radius.nominal
        if radius > 0.0:  # chords that keep the contact's chordal error
            step = 2.0 * math.acos(max(1.0 - CONTACT_DEFLECTION / radius, 0.0))
            turns = np.linspace(0.0, 0.5 * math.pi, max(2, math.ceil(0.5 * math.pi / step) + 1))
            rounding = [
                (radius * (1.0 - math.sin(turn)), height - radius * (1.0 - math.cos(turn)))
                for turn in turns.tolist()
            ]
        right = make_hull(list_half_corners(body, 1.0, height, rounding))
        if feature is None:
            return [left, right]
        near = feature.distance.nominal
        lane = body.half_width - feature.lane.nominal
        if feature.kind == "ridge":
            y1 = body.half_width - body.edge_break.nominal
            ridge = [
                (x, y, z)
                for x in (-near - feature.width.nominal, -near)
                for y, z in ((lane, 0.0), (lane, height), (y1, 0.0), (y1 - height, height))
            ]
            return [left, right, make_hull(ridge)]
        before, rest = split_solid(right, "x", near)
        middle, after = split_solid(rest, "x", near + feature.width.nominal)
        drag, groove = split_solid(middle, "y", lane)
        floor, _ = split_solid(groove, "z", 0.0)
        return [left, before, drag, floor, after]

    def chordal_error(self, face: cad.door.Face) -> float:
        at_edge = face.kind == "CYLINDER" and abs(face.radius - self.edge_radius.nominal) < 1e-9
        return CONTACT_DEFLECTION if at_edge else COARSE_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        H, r, half = self.height.nominal, self.edge_radius.nominal, self.body.half_length
        lower, upper = describe_plane(2, 0.0, x=-0.5 * half), describe_plane(2, H, x=0.5 * half)
        yield make_characteristic(
            "step_height", "distance", self.height, lower, upper, method=PROFILE
        )
        arc = FaceRule("CYLINDER", radius=r, holds={0: 0.5 * r})
        edge = arc if r > 0.0 else EdgeRule(describe_plane(0, 0.0, z=0.5 * H), upper)
        yield make_characteristic(
            "edge_radius", "radius", self.edge_radius, edge, method="profilometer, arc fit"
        )
        chamfer = self.body.edge_break.nominal
        for one in make_form_characteristics(
            self.face_demands, lower, upper, "lower face", "upper face"
        ):
            yield replace(one, extent=(half - chamfer, self.body.width.nominal - 2.0 * chamfer))
        if self.metrology is not None:
            yield from self._list_feature_characteristics(self.metrology, lower, upper)
        wall = describe_plane(0, 0.0, y=-0.25 * self.body.width.nominal) if r < H else None
        yield from self.list_body_characteristics(lower, upper, wall)
        yield from make_edge_characteristics(self.face_demands["burr"], wall, lower)

    def _list_feature_characteristics(
        self, feature: MetrologyFeature, lower: FaceRule, upper: FaceRule
    ) -> Iterator[Characteristic]:
        H = self.height.nominal
        back = self.body.half_width
        lane = back - 0.5 * feature.lane.nominal
        kind = feature.kind
        side = 1.0 if kind == "groove" else -1.0
        near, width = side * feature.distance.nominal, side * feature.width.nominal
        middle = near + 0.5 * width
        ends = (
            (describe_plane(2, 0.0, x=middle, y=lane), upper)
            if kind == "groove"
            else (lower, describe_plane(2, H, x=middle, y=lane))
        )
        yield make_characteristic(
            "groove_depth" if kind == "groove" else "ridge_height",
            "distance",
            self.height,
            *ends,
            method="profilometer, ISO 5436-1 A1",
        )
        walls = describe_plane(0, near, y=lane), describe_plane(0, near + width, y=lane)
        yield make_characteristic(
            f"{kind}_width", "distance", feature.width, *walls, method="profilometer"
        )
        ends = describe_plane(1, back), describe_plane(1, 2.0 * lane - back, x=middle)
        yield make_characteristic(
            f"{kind}_length", "distance", feature.lane, *ends, method=MICROSCOPE
        )
        if self.edge_radius.nominal < H:
            yield make_characteristic(
                f"{kind}_distance",
                "distance",
                feature.distance,
                describe_plane(0, 0.0, y=-0.5 * back),
                walls[0],
                label=f"{kind} from edge",
                method="profilometer",
            )

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        low, high = (
            mesh.measure_level_beside(0.0, -1),
            mesh.measure_level_beside(self.edge_radius.nominal, +1),
        )
        yield Finding("step height", self.height.nominal, high - low, NANOMETRE)
        yield Finding("lower working face at z = 0", 0.0, low, NANOMETRE)

    def choose_close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        height = self.height.nominal
        return choose_exaggeration(height), 2.5 * height, (0.0, 0.0, 0.0)

    @make_rules_validator
    def _check_sizes(self) -> Iterator[str]:
        body = self.body
        height, radius = self.height.nominal, self.edge_radius.nominal
        yield check_rule(radius <= height, "edge_radius", "not exceed height", height, radius)
        chamfer = body.edge_break.nominal
        yield check_rule(
            height < chamfer or chamfer == 0.0,
            "height",
            "be smaller than body.edge_break, or the chamfers of the two faces part",
            chamfer,
            height,
        )
        yield check_below(
            "height", "be below half the thickness", height, 0.5 * body.thickness.nominal
        )
        yield from self.require_engravable()
        if self.metrology is not None:
            yield from self._check_feature(self.metrology)

    def _check_feature(self, feature: MetrologyFeature) -> Iterator[str]:
        body = self.body
        radius = self.edge_radius.nominal
        width, distance, lane = (
            feature.width.nominal,
            feature.distance.nominal,
            feature.lane.nominal,
        )
        room, reach, least = (
            body.half_length - body.edge_break.nominal,
            distance + 2.0 * width,
            width + radius,
        )
        yield check_rule(
            reach <= room,
            "metrology.width",
            "leave a plane face of its own width on either side",
            room,
            reach,
        )
        yield check_rule(
            distance >= least,
            "metrology.distance",
            "be at least its width plus edge_radius",
            least,
            distance,
        )
        half = body.half_width
        if body.mounting is not None and body.mounting.kind == "clearance":
            bore = 0.5 * body.mounting.entry_diameter
            yield check_rule(
                half - lane > bore,
                "metrology.lane",
                "keep clear of the counterbores",
                half - bore,
                lane,
            )
        yield check_below(
            "metrology.lane", "leave more than half the width to the drag", lane, half
        )
