"""The characteristics of a part, numbered once for all files, with their faces."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from stepblocks import cad
from stepblocks.errors import MachiningError
from stepblocks.parts.tolerance import Dimension, find_general_deviation

Kind = Literal[
    "distance", "diameter", "radius", "angle", "flatness", "parallelism", "roughness", "note"
]
FaceKind = Literal["PLANE", "SLOPE", "CYLINDER", "CONE", "TORUS", "SPHERE"]
FORM = ("flatness", "parallelism", "roughness")  # kinds with a largest value and no nominal
PROFILE = "profilometer, two planes with edge exclusion"
CALIPER = "caliper"
DEPTH_GAUGE = "depth gauge"
MICROMETER = "micrometer"
MACHINE = "coordinate measuring machine"
MICROSCOPE = "microscope"
# a caliper (u about 10 um) proves a tolerance of 0.2 mm, as rounded in metres, and no less [m]
_CALIPER_TOLERANCE = 0.1999e-3
# how far a bounding box may be off its face [m]: the kernel enlarges boxes by its tolerance
_REACH = 1e-7
_SAME_PLANE = 1e-9  # further than that [m]
_SAME_RADIUS = 1e-12  # [m]


@dataclass(frozen=True)
class FaceRule:
    """How to find a face."""

    kind: FaceKind  # a ``PLANE`` is square to an axis, a ``SLOPE`` is a plane that is not
    axis: int = 2  # that a plane is square to
    at: float = 0.0  # coordinate of the plane along it [m]
    radius: float = 0.0  # of a cylinder or sphere [m]
    # coordinates [m] by axis within its box; of a slope, its middle
    holds: dict[int, float] = field(default_factory=dict)
    body: int | None = None  # solid it belongs to; that of its characteristic where omitted


@dataclass(frozen=True)
class EdgeRule:
    """An edge in which two faces of one solid meet; the longest if there are several."""

    first: FaceRule
    second: FaceRule

    @property
    def body(self) -> int | None:
        """Solid it belongs to."""
        return self.first.body


Rule = FaceRule | EdgeRule


@dataclass(frozen=True)
class Characteristic:
    """One line of the inspection sheet."""

    key: str  # in as-built records: ``step_height``, ``edge_radius``
    label: str  # what a person calls it
    kind: Kind  # ``note`` where no face carries it
    nominal: float  # m or rad; 0 of a form tolerance
    lower: float  # signed deviation [m or rad]
    upper: float  # signed deviation [m or rad]
    body: int = 0  # index of the solid it belongs to
    faces: tuple[
        Rule, ...
    ] = ()  # two of a distance or of an angle between planes, one of the others
    method: str = CALIPER  # how it is measured
    quantity: str = "length"  # ``length`` or ``angle``
    # what the file declares and it holds; empty where it follows from other dimensions
    states: tuple[Dimension, ...] = ()
    # of the face that a form tolerance holds, across and along the edge [m]; () where not stated
    extent: tuple[float, ...] = ()

    @property
    def doubled(self) -> "Characteristic":
        """The diameter of a radius, or the whole of a half angle."""
        return replace(
            self, nominal=2.0 * self.nominal, lower=2.0 * self.lower, upper=2.0 * self.upper
        )

    @property
    def mirrored_to_positive(self) -> "Characteristic":
        """The distance without its sign, as a workshop measures it.

        Of a negative nominal size both deviations are negated and change places.
        """
        if self.nominal >= 0.0:
            return self
        return replace(self, nominal=-self.nominal, lower=-self.upper, upper=-self.lower)


def find_face_index(faces: Sequence[cad.door.Face], rule: FaceRule, solid_name: str) -> int:
    """Find the face that a rule describes.

    Parameters
    ----------
    faces : sequence of Face
        All faces of a solid.
    rule : FaceRule
        Which of them is meant.
    solid_name : str
        What the solid belongs to, for the message.

    Returns
    -------
    int
        Index of the face; that of the largest where the rule fits several.

    Raises
    ------
    MachiningError
        If no face fits.
    """
    candidates = [index for index, face in enumerate(faces) if _fits_rule(face, rule)]
    if not candidates:
        raise MachiningError(f"a face must exist for {rule}, got none [{solid_name}]")
    return max(candidates, key=lambda index: _compute_bounding_box_area(faces[index]))


def _compute_bounding_box_area(face: cad.door.Face) -> float:
    """Return the product of the two longest sides of a face's bounding box [m^2]."""
    sides = sorted(high - low for low, high in zip(face.low, face.high, strict=True))
    _, middle, longest = sides
    return longest * middle


def _fits_rule(face: cad.door.Face, rule: FaceRule) -> bool:
    """Tell whether a rule describes a face."""
    if rule.kind == "SLOPE":
        return face.kind == "PLANE" and _fits_slope(face, rule)
    if face.kind != rule.kind:
        return False
    if rule.kind == "PLANE" and not _lies_in_plane(face, rule):
        return False
    if rule.kind in ("CYLINDER", "SPHERE") and abs(face.radius - rule.radius) > _SAME_RADIUS:
        return False
    for axis, coordinate in rule.holds.items():
        if not face.low[axis] - _REACH <= coordinate <= face.high[axis] + _REACH:
            return False
    return True


def _lies_in_plane(face: cad.door.Face, rule: FaceRule) -> bool:
    """Tell whether a plane face lies in the plane of a rule."""
    tolerance = _REACH + _SAME_PLANE
    low_offset = abs(face.low[rule.axis] - rule.at)
    high_offset = abs(face.high[rule.axis] - rule.at)
    return not (low_offset > tolerance or high_offset > tolerance)


def _fits_slope(face: cad.door.Face, rule: FaceRule) -> bool:
    """Tell whether a plane face is square to no axis, and its middle is that of a rule."""
    for low, high in zip(face.low, face.high, strict=True):
        if high - low < 10.0 * _REACH:
            return False
    for axis, coordinate in rule.holds.items():
        middle = 0.5 * (face.low[axis] + face.high[axis])
        if not abs(middle - coordinate) < 2.0 * _REACH:
            return False
    return True


def make_plane_rule(
    axis: int, coordinate: float, body: int | None = None, **contained_point: float
) -> FaceRule:
    """Make the rule of a plane square to an axis at a coordinate along it [m].

    Its face contains the coordinates `x`, `y` and `z` that are given [m].
    """
    by_axis = {"xyz".index(name): value for name, value in contained_point.items()}
    return FaceRule("PLANE", axis, coordinate, holds=by_axis, body=body)


def make_characteristic(
    key: str,
    kind: Kind,
    dimension: Dimension,
    *faces: Rule,
    label: str = "",
    body: int = 0,
    method: str = "",
) -> Characteristic:
    """State a dimension as declared.

    Parameters
    ----------
    key : str
        Key of the characteristic.
    kind : str
        How its faces carry it.
    dimension : Dimension
        What is declared.
    *faces : FaceRule or EdgeRule
        Faces or edges that it is measured between, or of.
    label : str
        What a person calls it; the key with spaces where omitted.
    body : int
        Index of the solid it belongs to.
    method : str
        How it is measured; where omitted, a caliper or a micrometer by its tolerance.

    Returns
    -------
    Characteristic
        A line of the inspection sheet.
    """
    return Characteristic(
        key,
        label or key.replace("_", " "),
        kind,
        dimension.nominal,
        dimension.lower,
        dimension.upper,
        body,
        faces,
        method or _choose_measuring_method(dimension),
        dimension.quantity,
        states=(dimension,),
    )


def _choose_measuring_method(dimension: Dimension) -> str:
    """Choose a caliper where it proves the tolerance, else a micrometer."""
    if dimension.quantity == "angle":
        return CALIPER
    if dimension.upper - dimension.lower >= _CALIPER_TOLERANCE:
        return CALIPER
    return MICROMETER


def make_edge_break_characteristic(edge_break: Dimension, *faces: Rule) -> Characteristic:
    """State the chamfer of all outer edges, measured at one of them.

    Sharp edges have no face that carries it.
    """
    kind: Kind = "distance"
    if not edge_break.nominal:
        kind = "note"
        faces = ()
    label = "edge break, 45 deg, outer edges"
    return make_characteristic(
        "edge_break", kind, edge_break, *faces, label=label, method=MICROSCOPE
    )


def make_location_characteristic(
    key: str, label: str, distance: float, *faces: Rule
) -> Characteristic:
    """State the distance of a feature [m] between faces, with the tolerance of ISO 2768-m."""
    deviation = find_general_deviation(distance) or 0.0
    return Characteristic(
        key, label, "distance", distance, -deviation, deviation, 0, faces, MACHINE
    )
