"""The probe tip: a ball on a cone and a shank, straight or bent to a shepherd's hook."""

import itertools
import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from stepblocks import cad
from stepblocks.contact.kernels import compute_locking_height
from stepblocks.contact.operating_point import PAPER
from stepblocks.parts.characteristics import (
    Characteristic,
    EdgeRule,
    FaceRule,
    describe_plane,
    make_characteristic,
)
from stepblocks.parts.declared import (
    MaterialField,
    check_rule,
    declare_default,
    make_rules_validator,
)
from stepblocks.parts.kind import (
    COARSE_DEFLECTION,
    CONTACT_DEFLECTION,
    Finding,
    HeldPart,
    Manifold,
    MeasuredMesh,
    Verdict,
)
from stepblocks.parts.revolution import (
    Outline,
    Point3,
    Turned,
    compute_revolution_volume,
    list_ring_points,
    make_turned_hull,
)
from stepblocks.parts.shapes import make_hull
from stepblocks.parts.tolerance import Angle, PositiveLength
from stepblocks.quantities import format_quantity

SPHERE_LIMIT = 0.1e-6  # radius, form and chordal error of the contact sphere [m]
_BEND_PIECES = 24


class Tip(Turned, HeldPart):
    """What both forms share: the ball touches the origin from above, the cone widens upwards."""

    governing_field: ClassVar[str] = "ball_radius"

    ball_radius: PositiveLength = declare_default(otherwise="2 um")  # R of the contact sphere [m]
    # half angle of the cone, tangent to the ball [rad]
    cone_angle: Angle = declare_default("8 deg", "0.5 deg")
    shank_radius: PositiveLength  # at the end of the cone [m]
    material: MaterialField = declare_default("1.4301")

    @property
    def cone_start(self) -> tuple[float, float]:
        """Radius and height at which the cone leaves the ball, tangent to it [m]."""
        R, half = self.ball_radius.nominal, self.cone_angle.nominal
        return R * math.cos(half), R * (1.0 - math.sin(half))

    @property
    def cone_end(self) -> float:
        """Height at which the cone has the radius of the shank [m]."""
        radius, height = self.cone_start
        return height + (self.shank_radius.nominal - radius) / math.tan(self.cone_angle.nominal)

    def outline(self) -> Outline:
        """Half section of ball and cone up to the axis; the contact point is the origin."""
        R, half = self.ball_radius.nominal, self.cone_angle.nominal
        # polar angle from the contact point to halfway up the ball
        middle = 0.5 * (0.5 * math.pi - half)
        bow = R * math.sin(middle), R * (1.0 - math.cos(middle))
        return [
            (0.0, 0.0),
            (bow, self.cone_start),
            (self.shank_radius.nominal, self.cone_end),
            (0.0, self.cone_end),
        ]

    def outlines(self) -> list[Outline]:
        return [self.outline()]

    def chordal_error(self, face: cad.door.Face) -> float:
        return CONTACT_DEFLECTION if face.kind == "SPHERE" else COARSE_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        yield make_characteristic(
            "ball_radius",
            "radius",
            self.ball_radius,
            FaceRule("SPHERE", radius=self.ball_radius.nominal),
            method="microscope or interferometer, sphere fit",
        )
        yield make_characteristic(
            "shank_diameter",
            "diameter",
            self.shank_radius,
            FaceRule("CYLINDER", radius=self.shank_radius.nominal),
        ).doubled
        yield make_characteristic(
            "cone_angle",
            "angle",
            self.cone_angle,
            FaceRule("CONE"),
            label="cone angle, included",
            method="microscope",
        ).doubled

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        R = self.ball_radius.nominal
        radius, form, sag = mesh.fit_sphere(R, self.cone_start[1])
        yield Finding("radius of the contact sphere", R, radius, SPHERE_LIMIT)
        yield Finding("form of the contact sphere", 0.0, form, SPHERE_LIMIT)
        yield Finding("chordal error on the contact sphere", 0.0, sag, SPHERE_LIMIT)

    def choose_close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        radius = self.ball_radius.nominal
        return 1.0, 2.0 * radius, (0.0, 0.0, 1.5 * radius)

    def derived(self) -> list[list[str]]:
        ball, mu = self.ball_radius.nominal, PAPER.friction
        sticks, riser = (
            format_quantity(height, "length", 3)
            for height in (float(compute_locking_height(ball, mu)), ball)
        )
        return [
            ["locks", f"on steps from {sticks} at mu {mu:g}; from {riser} its ball meets the riser"]
        ]

    @make_rules_validator
    def _check_sizes(self) -> Iterator[str]:
        R, shank, half = (
            self.ball_radius.nominal,
            self.shank_radius.nominal,
            self.cone_angle.nominal,
        )
        if not 0.0 < half < 0.25 * math.pi:
            yield f"cone_angle must lie between 0 and 45 deg, got {format_quantity(half, 'angle')}"
        yield check_rule(shank > R, "ball_radius", "be smaller than shank_radius", shank, R)


class StraightTip(Tip):
    """Ball, cone and cylindrical shank on one axis.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    ball_radius : Dimension
        Radius R of the contact sphere [m].
    cone_angle : Dimension
        Half angle of the cone, which is tangent to the ball [rad].
    shank_radius : Dimension
        Radius of the shank, at the end of the cone [m].
    material : Material
        What it is made of, with its density [kg/m^3].
    length : Dimension
        From the contact point to the end of the shank [m].
    """

    stanza: ClassVar[str] = "straight_tip"
    kind_name: ClassVar[str] = "straight probe tip"

    shank_radius: PositiveLength = declare_default(
        "1.175 mm", "+0 mm / -0.016 mm", source="ISO 1797 type 1 shank, 2.35 mm"
    )
    length: PositiveLength = declare_default("40 mm")

    def outline(self) -> Outline:
        """Half section with the shank."""
        end = self.length.nominal
        return [*super().outline()[:-1], (self.shank_radius.nominal, end), (0.0, end)]

    def hulls(self) -> list[Manifold]:
        return [make_turned_hull(self.outline())]

    def characteristics(self) -> Iterator[Characteristic]:
        yield from super().characteristics()
        yield make_characteristic(
            "length",
            "distance",
            self.length,
            describe_plane(2, self.length.nominal),
            FaceRule("SPHERE", radius=self.ball_radius.nominal),
            label="length from the contact point",
        )

    @make_rules_validator
    def _check_shank(self) -> Iterator[str]:
        length, cone = self.length.nominal, self.cone_end
        yield check_rule(length > cone, "length", "exceed the end of the cone", cone, length)


class HookTip(Tip):
    """The shepherd's hook: ball and cone, then a wire bent in one arc, then the straight shank.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    ball_radius : Dimension
        Radius R of the contact sphere [m].
    cone_angle : Dimension
        Half angle of the cone, which is tangent to the ball [rad].
    shank_radius : Dimension
        Radius of the shank, at the end of the cone [m].
    material : Material
        What it is made of, with its density [kg/m^3].
    bend_radius : Dimension
        Radius of the bend, at the axis of the wire [m].
    bend_angle : Dimension
        Angle of the bend, below 180 degrees [rad].
    straight_length : Dimension
        Length of the shank beyond the bend [m].
    """

    stanza: ClassVar[str] = "hook_tip"
    kind_name: ClassVar[str] = "shepherd's hook"

    shank_radius: PositiveLength = declare_default("0.5 mm", "0.02 mm")
    bend_radius: PositiveLength = declare_default("4 mm")
    bend_angle: Angle = declare_default("75 deg", "1 deg")
    straight_length: PositiveLength = declare_default("20 mm")

    def solids(self) -> list[cad.door.Body]:
        top, wire = self.cone_end, self.shank_radius.nominal
        bend, angle, length = (
            self.bend_radius.nominal,
            self.bend_angle.nominal,
            self.straight_length.nominal,
        )
        section = cad.kernel.outline_circle((0.0, 0.0, top), (wire, 0.0, 0.0), (0.0, wire, 0.0))
        arc = cad.kernel.revolve(section, (bend, 0.0, top), (0.0, 1e-3, 0.0), math.degrees(angle))
        end = (bend * (1.0 - math.cos(angle)), 0.0, top + bend * math.sin(angle))
        along = (math.sin(angle), 0.0, math.cos(angle))
        section = cad.kernel.outline_circle(
            end, (wire * math.cos(angle), 0.0, -wire * math.sin(angle)), (0.0, wire, 0.0)
        )
        shank = cad.kernel.extrude(section, tuple(length * a for a in along))
        return [cad.kernel.fuse([cad.kernel.turn(self.outline(), (0.0, 0.0, 0.0)), arc, shank])]

    def volumes(self) -> tuple[float, ...]:
        # Add a turned head, a torus by Pappus, and a cylinder
        wire = math.pi * self.shank_radius.nominal**2
        bend = wire * self.bend_radius.nominal * self.bend_angle.nominal
        return (
            compute_revolution_volume(self.outline()) + bend + wire * self.straight_length.nominal,
        )

    def hulls(self) -> list[Manifold]:
        top, bend, angle = self.cone_end, self.bend_radius.nominal, self.bend_angle.nominal

        def section(turn: float, along: float = 0.0) -> list[Point3]:
            c, s = math.cos(turn), math.sin(turn)
            return [
                (bend - (bend - x) * c + along * s, y, top + (bend - x) * s + along * c)
                for x, y, _ in list_ring_points(self.shank_radius.nominal, 0.0)
            ]

        turns = np.linspace(0.0, angle, _BEND_PIECES + 1)
        bent = [
            make_hull([*section(float(a)), *section(float(b))])
            for a, b in itertools.pairwise(turns)
        ]
        return [
            make_turned_hull(self.outline()),
            *bent,
            make_hull([*section(angle), *section(angle, self.straight_length.nominal)]),
        ]

    def characteristics(self) -> Iterator[Characteristic]:
        yield from super().characteristics()
        angle, bend, straight = (
            self.bend_angle.nominal,
            self.bend_radius.nominal,
            self.straight_length.nominal,
        )
        wire, cone, ring = (
            FaceRule("CYLINDER", radius=self.shank_radius.nominal),
            FaceRule("CONE"),
            FaceRule("TORUS"),
        )
        yield make_characteristic(
            "bend_radius", "radius", self.bend_radius, ring, method="microscope"
        )
        yield make_characteristic(
            "bend_angle", "angle", self.bend_angle, cone, wire, method="microscope"
        )
        x = bend * (1.0 - math.cos(angle)) + straight * math.sin(angle)
        z = self.cone_end + bend * math.sin(angle) + straight * math.cos(angle)
        end = (
            describe_plane(0, x, z=z)
            if math.isclose(angle, 0.5 * math.pi)
            else FaceRule("SLOPE", holds={0: x, 1: 0.0, 2: z})
        )
        yield make_characteristic(
            "straight_length", "distance", self.straight_length, end, EdgeRule(ring, wire)
        )

    @make_rules_validator
    def _check_bend(self) -> Iterator[str]:
        if self.bend_angle.nominal <= 0.0:
            yield "bend_angle must be above 0 deg, got 0 deg"
            return
        shank, bend, angle = (
            self.shank_radius.nominal,
            self.bend_radius.nominal,
            self.bend_angle.nominal,
        )
        yield check_rule(bend > shank, "bend_radius", "exceed shank_radius", shank, bend)
        end = (
            self.cone_end + bend * math.sin(angle) + self.straight_length.nominal * math.cos(angle)
        )
        lowest = end - shank * math.sin(angle)
        if lowest <= 0.0:
            yield (
                "bend_angle must keep the shank above the contact point, got "
                f"{format_quantity(angle, 'angle')}, which brings it to "
                f"{format_quantity(lowest, 'length')}"
            )
