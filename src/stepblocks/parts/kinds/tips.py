"""The probe tip: a ball on a cone and a shank, straight or bent to a shepherd's hook."""

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stepblocks import cad
from stepblocks.contact.kernels import compute_locking_height
from stepblocks.contact.operating_point import PAPER
from stepblocks.parts.characteristics import (
    Characteristic,
    EdgeRule,
    FaceRule,
    make_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    LabelledText,
    Zone,
    declare_default,
    describe_breach,
    make_rules_validator,
)
from stepblocks.parts.face_characteristics import (
    make_contact_roughness_characteristic,
    make_zone_characteristic,
)
from stepblocks.parts.kind import (
    COARSE_DEFLECTION,
    CONTACT_DEFLECTION,
    CloseUp,
    Finding,
    HeldPart,
    Manifold,
    MeasuredMesh,
    Verdict,
)
from stepblocks.parts.material import MaterialField
from stepblocks.parts.revolution import (
    Outline,
    Point,
    Point3,
    Turned,
    compute_revolution_volume,
    list_ring_points,
    make_turned_hull,
)
from stepblocks.parts.shapes import make_hull
from stepblocks.parts.tolerance import Angle, Dimension, PositiveLength
from stepblocks.quantities import format_quantity

SPHERE_LIMIT = 0.1e-6  # radius, form and chordal error of the contact sphere [m]
_BEND_PIECES = 24
_RUNOUT = 20e-6  # of the ball about the shank where none is stated [m]
_WIDEST_CONE = 0.25 * math.pi  # half angle, below which a cone must lie [rad]


class Tip(Turned, HeldPart):
    """What both forms share: the ball touches the origin from above, the cone widens upwards."""

    governing_field: ClassVar[str] = "ball_radius"

    ball_radius: PositiveLength = declare_default(otherwise="2 um")  # R of the contact sphere [m]
    # half angle of the cone, tangent to the ball [rad]
    cone_angle: Angle = declare_default("8 deg", "0.5 deg")
    shank_radius: PositiveLength  # at the end of the cone [m]
    material: MaterialField = declare_default("1.4301")

    @property
    def cone_start(self) -> Point:
        """Radius and height at which the cone leaves the ball, tangent to it [m]."""
        ball = self.ball_radius.nominal
        half_angle = self.cone_angle.nominal
        return ball * math.cos(half_angle), ball * (1.0 - math.sin(half_angle))

    @property
    def cone_end(self) -> float:
        """Height at which the cone has the radius of the shank [m]."""
        start_radius, start_height = self.cone_start
        growth = self.shank_radius.nominal - start_radius
        return start_height + growth / math.tan(self.cone_angle.nominal)

    def outline_head(self) -> Outline:
        """Outline ball and cone (radius, height) [m] up to the shank; the first point touches."""
        ball = self.ball_radius.nominal
        # polar angle from the contact point to halfway up the ball
        halfway = 0.5 * (0.5 * math.pi - self.cone_angle.nominal)
        on_ball = (ball * math.sin(halfway), ball * (1.0 - math.cos(halfway)))
        return [
            (0.0, 0.0),
            (on_ball, self.cone_start),
            (self.shank_radius.nominal, self.cone_end),
        ]

    def outline(self) -> Outline:
        """Outline a half section of what is turned, up to the axis; it touches at the origin."""
        return [*self.outline_head(), (0.0, self.cone_end)]

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
        ball = FaceRule("SPHERE", radius=self.ball_radius.nominal)
        yield make_contact_roughness_characteristic(self.face_demands["roughness"], (ball,), "ball")

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        ball = self.ball_radius.nominal
        _, ball_end = self.cone_start
        radius, form, sag = mesh.fit_sphere(ball, ball_end)
        yield Finding("radius of the contact sphere", ball, radius, SPHERE_LIMIT)
        yield Finding("form of the contact sphere", 0.0, form, SPHERE_LIMIT)
        yield Finding("chordal error on the contact sphere", 0.0, sag, SPHERE_LIMIT)

    def choose_close_up(self) -> CloseUp:
        ball = self.ball_radius.nominal
        return CloseUp(1.0, 2.0 * ball, (0.0, 0.0, 1.5 * ball))

    def derived(self) -> list[LabelledText]:
        ball = self.ball_radius.nominal
        friction = PAPER.friction
        locking_height = float(compute_locking_height(ball, friction))
        locks = format_quantity(locking_height, "length", 3)
        meets_riser = format_quantity(ball, "length", 3)
        text = (
            f"on steps from {locks} at mu {friction:g}; from {meets_riser} its ball meets the riser"
        )
        return [["locks", text]]

    @make_rules_validator
    def _yield_size_breaches(self) -> Iterator[str]:
        """Yield what keeps ball, cone and shank from meeting."""
        ball = self.ball_radius.nominal
        shank = self.shank_radius.nominal
        half_angle = self.cone_angle.nominal
        if not 0.0 < half_angle < _WIDEST_CONE:
            angle = format_quantity(half_angle, "angle")
            yield f"cone_angle must lie between 0 and 45 deg, got {angle}"
        if shank <= ball:
            yield describe_breach("ball_radius", "be smaller than shank_radius", shank, ball)


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
    runout : Dimension or None
        Circular run-out of the ball about the shank [m]; left out, it is 0.02 mm.
    """

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "straight_tip"
    kind_name: ClassVar[str] = "straight probe tip"

    shank_radius: PositiveLength = declare_default(
        "1.175 mm",
        "+0 mm / -0.008 mm",
        source="ISO 1797 type 2 shank, for handpieces, diameter 2.35 mm 0/-0.016 mm",
    )
    length: PositiveLength = declare_default("40 mm")
    runout: Zone | None = None  # of the ball about the shank, datum A; default 0.02 mm

    def outline(self) -> Outline:
        shank = self.shank_radius.nominal
        end = self.length.nominal
        return [*self.outline_head(), (shank, end), (0.0, end)]

    def hulls(self) -> list[Manifold]:
        return [make_turned_hull(self.outline())]

    def characteristics(self) -> Iterator[Characteristic]:
        yield from super().characteristics()
        yield make_characteristic(
            "length",
            "distance",
            self.length,
            make_plane_rule(2, self.length.nominal),
            FaceRule("SPHERE", radius=self.ball_radius.nominal),
            label="length from the contact point",
        )
        yield self._make_runout_characteristic()

    def _make_runout_characteristic(self) -> Characteristic:
        """State the circular run-out of the ball about the shank (ISO 1101)."""
        zone = self.runout
        if zone is None:
            zone = Dimension(0.0, _RUNOUT, 0.0, usual=True)
        return make_zone_characteristic(
            "runout",
            "run-out of the ball to A, the shank",
            "note",
            zone,
            (),
            "dial gauge or microscope, turned in a V-block",
        )

    @make_rules_validator
    def _yield_length_breaches(self) -> Iterator[str]:
        """Yield that a tip ends before its cone does."""
        length = self.length.nominal
        cone = self.cone_end
        if length <= cone:
            yield describe_breach("length", "exceed the end of the cone", cone, length)


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

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "hook_tip"
    kind_name: ClassVar[str] = "shepherd's hook"

    shank_radius: PositiveLength = declare_default("0.5 mm", "0.02 mm")
    bend_radius: PositiveLength = declare_default("4 mm")
    bend_angle: Angle = declare_default("75 deg", "1 deg")
    straight_length: PositiveLength = declare_default("20 mm")

    @property
    def bend_end(self) -> Point:
        """Where the bend ends on the axis of the wire (x, z) [m]."""
        bend = self.bend_radius.nominal
        angle = self.bend_angle.nominal
        return bend * (1.0 - math.cos(angle)), self.cone_end + bend * math.sin(angle)

    def solids(self) -> list[cad.door.Body]:
        top = self.cone_end
        wire = self.shank_radius.nominal
        bend = self.bend_radius.nominal
        angle = self.bend_angle.nominal
        length = self.straight_length.nominal
        start = cad.kernel.outline_circle((0.0, 0.0, top), (wire, 0.0, 0.0), (0.0, wire, 0.0))
        arc = cad.kernel.revolve(start, (bend, 0.0, top), (0.0, 1e-3, 0.0), math.degrees(angle))
        end_x, end_z = self.bend_end
        across = (wire * math.cos(angle), 0.0, -wire * math.sin(angle))
        end = cad.kernel.outline_circle((end_x, 0.0, end_z), across, (0.0, wire, 0.0))
        run = (length * math.sin(angle), 0.0, length * math.cos(angle))
        shank = cad.kernel.extrude(end, run)
        head = cad.kernel.revolve_about_vertical(self.outline(), (0.0, 0.0, 0.0))
        return [cad.kernel.fuse([head, arc, shank])]

    def volumes(self) -> tuple[float, ...]:
        # a turned head, a torus by Pappus, and a cylinder
        head = compute_revolution_volume(self.outline())
        wire = math.pi * self.shank_radius.nominal**2
        bend = wire * self.bend_radius.nominal * self.bend_angle.nominal
        return (head + bend + wire * self.straight_length.nominal,)

    def hulls(self) -> list[Manifold]:
        angle = self.bend_angle.nominal
        turns = np.linspace(0.0, angle, _BEND_PIECES + 1).tolist()
        pieces = [make_turned_hull(self.outline())]
        for start, end in itertools.pairwise(turns):
            pieces.append(
                make_hull(
                    [*self._list_wire_section_points(start), *self._list_wire_section_points(end)]
                )
            )
        near = self._list_wire_section_points(angle)
        far = self._list_wire_section_points(angle, self.straight_length.nominal)
        pieces.append(make_hull([*near, *far]))
        return pieces

    def _list_wire_section_points(
        self, bend_angle: float, straight_run: float = 0.0
    ) -> list[Point3]:
        """List points of a section of the wire, after a turn [rad] and a straight run [m]."""
        bend = self.bend_radius.nominal
        top = self.cone_end
        cos = math.cos(bend_angle)
        sin = math.sin(bend_angle)
        points = []
        for x, y, _ in list_ring_points(self.shank_radius.nominal, 0.0):
            from_middle = bend - x
            turned_x = bend - from_middle * cos + straight_run * sin
            turned_z = top + from_middle * sin + straight_run * cos
            points.append((turned_x, y, turned_z))
        return points

    def characteristics(self) -> Iterator[Characteristic]:
        yield from super().characteristics()
        wire = FaceRule("CYLINDER", radius=self.shank_radius.nominal)
        ring = FaceRule("TORUS")
        yield make_characteristic(
            "bend_radius", "radius", self.bend_radius, ring, method="microscope"
        )
        yield make_characteristic(
            "bend_angle", "angle", self.bend_angle, FaceRule("CONE"), wire, method="microscope"
        )
        end = self._make_shank_end_rule()
        yield make_characteristic(
            "straight_length", "distance", self.straight_length, end, EdgeRule(ring, wire)
        )

    def _make_shank_end_rule(self) -> FaceRule:
        """Make the rule of the end of the shank, square to an axis only of a right angle."""
        angle = self.bend_angle.nominal
        straight = self.straight_length.nominal
        bend_end_x, bend_end_z = self.bend_end
        x = bend_end_x + straight * math.sin(angle)
        z = bend_end_z + straight * math.cos(angle)
        if math.isclose(angle, 0.5 * math.pi):
            return make_plane_rule(0, x, z=z)
        return FaceRule("SLOPE", holds={0: x, 1: 0.0, 2: z})

    @make_rules_validator
    def _yield_bend_breaches(self) -> Iterator[str]:
        """Yield what keeps the wire from being bent so."""
        shank = self.shank_radius.nominal
        bend = self.bend_radius.nominal
        angle = self.bend_angle.nominal
        if angle <= 0.0:
            yield "bend_angle must be above 0 deg, got 0 deg"
            return
        if bend <= shank:
            yield describe_breach("bend_radius", "exceed shank_radius", shank, bend)
        _, bend_end_z = self.bend_end
        end = bend_end_z + self.straight_length.nominal * math.cos(angle)
        lowest = end - shank * math.sin(angle)
        if lowest <= 0.0:
            yield (
                "bend_angle must keep the shank above the contact point, got "
                f"{format_quantity(angle, 'angle')}, which brings it to "
                f"{format_quantity(lowest, 'length')}"
            )
