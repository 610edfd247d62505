"""The characteristics of a part, numbered once for all files, with their faces."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

from stepblocks import cad
from stepblocks.errors import MachiningError
from stepblocks.parts.declared import FaceDemands
from stepblocks.parts.tolerance import ANGULAR_DEVIATION, Dimension, find_general_deviation

Kind = Literal[
    "distance", "diameter", "radius", "angle", "flatness", "parallelism", "roughness", "note"
]
FORM = ("flatness", "parallelism", "roughness")  # kinds with a largest value and no nominal
PROFILE = "profilometer, two planes with edge exclusion"
CALIPER = "caliper"
DEPTH_GAUGE = "depth gauge"
MICROMETER = "micrometer"
MACHINE = "coordinate measuring machine"
MICROSCOPE = "microscope"
# distance from a working edge within which nothing may stand over the upper face [m]
BURR_ZONE = 0.2e-3
# ISO 2768-2:1989, table 1, class H, of a length up to 10 mm [m]
RISER_STRAIGHTNESS = 0.02e-3
# how far a bounding box may be off its face [m]: the kernel enlarges boxes by its tolerance
_REACH = 1e-7


@dataclass(frozen=True)
class FaceRule:
    """How to find a face."""

    # ``PLANE`` (square to an axis), ``SLOPE`` (a plane that is not), ``CYLINDER``, ``CONE``,
    # ``TORUS``, ``SPHERE``
    kind: str
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
    def unsigned(self) -> "Characteristic":
        """The distance without its sign, as a workshop measures it.

        The limits of a negative length change places.
        """
        return (
            replace(self, nominal=-self.nominal, lower=-self.upper, upper=-self.lower)
            if self.nominal < 0.0
            else self
        )


def find_face(faces: tuple[cad.door.Face, ...], rule: FaceRule, place: str) -> int:
    """Find the one face that a rule describes, the largest where the rule fits several."""
    found = [index for index, face in enumerate(faces) if _is_face_of(face, rule)]
    MachiningError.require(found, f"a face must exist for {rule}, got none [{place}]")

    def extent(index: int) -> float:
        sides = sorted(
            high - low for low, high in zip(faces[index].low, faces[index].high, strict=True)
        )
        return sides[-1] * sides[-2]

    return max(found, key=extent)


def _is_face_of(face: cad.door.Face, rule: FaceRule) -> bool:
    if face.kind != ("PLANE" if rule.kind == "SLOPE" else rule.kind):
        return False
    if rule.kind == "SLOPE":
        flat = any(
            high - low < 10.0 * _REACH for low, high in zip(face.low, face.high, strict=True)
        )
        middle = [0.5 * (low + high) for low, high in zip(face.low, face.high, strict=True)]
        return not flat and all(abs(middle[k] - v) < 2.0 * _REACH for k, v in rule.holds.items())
    if rule.kind == "PLANE":
        if any(abs(end[rule.axis] - rule.at) > _REACH + 1e-9 for end in (face.low, face.high)):
            return False
    elif rule.kind in ("CYLINDER", "SPHERE") and abs(face.radius - rule.radius) > 1e-12:
        return False
    return all(face.low[k] - _REACH <= v <= face.high[k] + _REACH for k, v in rule.holds.items())


def make_characteristic(
    key: str,
    kind: Kind,
    dimension: Dimension,
    *faces: Rule,
    label: str = "",
    body: int = 0,
    method: str = "",
) -> Characteristic:
    """State a dimension as declared; its key with spaces is its label where none is given."""
    # a caliper (u about 10 um) proves a tolerance of 0.2 mm, as rounded in metres, and no less
    wide = dimension.upper - dimension.lower >= 0.1999e-3 or dimension.quantity == "angle"
    method = method or (CALIPER if wide else MICROMETER)
    return Characteristic(
        key,
        label or key.replace("_", " "),
        kind,
        dimension.nominal,
        dimension.lower,
        dimension.upper,
        body,
        faces,
        method,
        dimension.quantity,
        states=(dimension,),
    )


def make_edge_break(edge_break: Dimension, *faces: Rule) -> Characteristic:
    """State the chamfer of all edges, measured at one of them.

    Sharp edges have no face that carries it.
    """
    return make_characteristic(
        "edge_break",
        "distance" if edge_break.nominal else "note",
        edge_break,
        *(faces if edge_break.nominal else ()),
        label="edge break, 45 deg, all edges",
        method=MICROSCOPE,
    )


def describe_plane(axis: int, at: float, body: int | None = None, **holds: float) -> FaceRule:
    """Describe a plane square to an axis that contains the coordinates `x`, `y` and `z` [m]."""
    return FaceRule(
        "PLANE",
        axis,
        at,
        holds={"xyz".index(name): value for name, value in holds.items()},
        body=body,
    )


def make_form_characteristics(
    demands: FaceDemands, low: FaceRule, high: FaceRule, lower: str, upper: str
) -> Iterator[Characteristic]:
    """State flatness and parallelism of the two working faces."""
    method = "interferometer, form of the face, minimum zone"
    yield from _make_forms(
        demands,
        ("flatness_lower", f"flatness, {lower}", "flatness", (low,), method),
        ("flatness_upper", f"flatness, {upper}", "flatness", (high,), method),
        ("parallelism", f"parallelism, {upper} to A", "parallelism", (high, low), method),
    )


def make_surface_characteristics(
    demands: FaceDemands, lower: FaceRule, upper: FaceRule, base: FaceRule
) -> Iterator[Characteristic]:
    """State the roughness of the working faces, and the form of the base under the lower one."""
    yield from _make_forms(
        demands,
        (
            "roughness",
            "roughness Ra, working faces",
            "roughness",
            (lower, upper),
            "profilometer or interferometer, ISO 21920-2",
        ),
        (
            "flatness_base",
            "flatness, base",
            "flatness",
            (base,),
            "optical flat or electronic comparator",
        ),
        (
            "parallelism_base",
            "parallelism, lower face to B, the base",
            "parallelism",
            (lower, base),
            "comparator on a surface plate",
        ),
    )


def _make_forms(
    demands: FaceDemands, *rows: tuple[str, str, Kind, tuple[Rule, ...], str]
) -> Iterator[Characteristic]:
    for key, label, kind, faces, method in rows:
        zone = demands[f"base_{kind}" if key.endswith("_base") else kind]
        yield Characteristic(
            key,
            label,
            kind,
            0.0,
            0.0,
            zone.upper,
            faces=faces,
            method=method,
            states=() if zone.usual else (zone,),
        )


def make_location(key: str, label: str, at: float, *faces: Rule) -> Characteristic:
    """State where a feature lies [m], with the general tolerance of ISO 2768-m."""
    deviation = find_general_deviation(at) or 0.0
    return Characteristic(key, label, "distance", at, -deviation, deviation, 0, faces, MACHINE)


def make_edge_characteristics(
    burr: Dimension, wall: FaceRule | None, lower: FaceRule
) -> Iterator[Characteristic]:
    """State the burr at the working edge (ISO 13715), and angle and straightness of its wall."""
    yield Characteristic(
        "burr",
        f"burr over the upper face within {BURR_ZONE * 1e3:g} mm of the edge",
        "note",
        0.0,
        0.0,
        burr.upper,
        method="profilometer or interferometer, ISO 13715",
        states=() if burr.usual else (burr,),
    )
    if wall is None:  # of a rounding as high as the step nothing is upright
        return
    method = "section or replica across the edge"
    yield make_characteristic(
        "riser_angle",
        "angle",
        Dimension(0.5 * math.pi, ANGULAR_DEVIATION, -ANGULAR_DEVIATION, "angle"),
        wall,
        lower,
        label="angle of the riser to the faces",
        method=method,
    )
    yield Characteristic(
        "riser_straightness",
        "straightness of the riser across the edge",
        "note",
        0.0,
        0.0,
        RISER_STRAIGHTNESS,
        method=method,
    )
