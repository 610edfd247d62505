"""What a workshop must hold: every characteristic of a part, numbered once for STEP, drawing and inspection sheet.

Form tolerances are not asked for in a stimulus file; they follow from the height: a face may deviate by a quarter of the
height's tolerance band, and the two faces from parallelism by half of it, or the height has no meaning to its tolerance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from stepblocks.errors import MachiningError
from stepblocks.solids.kernel import Face
from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.body import Body
from stepblocks.stimulus.margin import CrownOnTooth, MarginBlock
from stepblocks.stimulus.set import Stimulus
from stepblocks.stimulus.sheath import Sheath
from stepblocks.stimulus.tip import HookTip, StraightTip
from stepblocks.stimulus.tolerance import Dimension

__all__ = ["Characteristic", "FaceRule", "characteristics_of", "find_face"]

Kind = Literal["distance", "diameter", "radius", "flatness", "parallelism", "note"]
_REACH = 1e-7
"""How far a bounding box may be off its face [m]: the kernel enlarges boxes by its tolerance."""


@dataclass(frozen=True)
class FaceRule:
    """How to find a face.

    Attributes
    ----------
    kind : str
        ``PLANE``, ``CYLINDER`` or ``SPHERE``.
    axis : int
        Axis that a plane is perpendicular to: 0, 1, 2.
    at : float
        Coordinate of the plane along it [m].
    radius : float
        Radius of a cylinder or sphere [m].
    holds : dict
        Coordinates [m] by axis that the face's box must contain.
    """

    kind: str
    axis: int = 2
    at: float = 0.0
    radius: float = 0.0
    holds: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Characteristic:
    """One line of the inspection sheet.

    Attributes
    ----------
    key : str
        Name in as-built records: ``step_height``, ``edge_radius``, ...
    label : str
        What a person calls it.
    kind : str
        Kind of dimension or tolerance; ``note`` where no face carries it.
    nominal : float
        Nominal [m or rad]; 0 of a form tolerance.
    lower, upper : float
        Deviations, signed [m or rad].
    body : int
        Index of the solid it belongs to.
    faces : tuple of FaceRule
        Faces it names: two of a distance, one of the others.
    method : str
        How it is measured.
    quantity : str
        ``length`` or ``angle``.
    """

    key: str
    label: str
    kind: Kind
    nominal: float
    lower: float
    upper: float
    body: int = 0
    faces: tuple[FaceRule, ...] = ()
    method: str = "caliper or micrometer"
    quantity: str = "length"


def find_face(faces: tuple[Face, ...], rule: FaceRule, place: str) -> int:
    """Find the one face that a rule describes, the largest where the rule fits several.

    Parameters
    ----------
    faces : tuple of Face
        Faces of a solid.
    rule : FaceRule
        What is looked for.
    place : str
        Name of the stimulus, for the error.

    Returns
    -------
    int
        Index of the face.

    Raises
    ------
    MachiningError
        If no face fits.
    """

    def fits(face: Face) -> bool:
        if face.kind != rule.kind:
            return False
        if rule.kind == "PLANE":
            low, high = face.low[rule.axis], face.high[rule.axis]
            if abs(low - rule.at) > _REACH + 1e-9 or abs(high - rule.at) > _REACH + 1e-9:
                return False
        elif abs(face.radius - rule.radius) > 1e-12:
            return False
        return all(face.low[k] - _REACH <= v <= face.high[k] + _REACH for k, v in rule.holds.items())

    found = [index for index, face in enumerate(faces) if fits(face)]
    if not found:
        raise MachiningError(f"a face must exist for {rule}, got none [{place}]")

    def extent(index: int) -> float:
        sides = sorted(high - low for low, high in zip(faces[index].low, faces[index].high, strict=True))
        return sides[-1] * sides[-2]

    return max(found, key=extent)


def characteristics_of(stimulus: Stimulus) -> list[Characteristic]:
    """List the characteristics of a part in the order of the inspection sheet.

    Parameters
    ----------
    stimulus : Stimulus
        What is asked for.

    Returns
    -------
    list of Characteristic
        Numbered by their place, from 1.
    """
    match stimulus:
        case StepBlock():
            return list(_step_block(stimulus))
        case MarginBlock():
            return list(_margin_block(stimulus))
        case CrownOnTooth():
            return list(_crown(stimulus))
        case StraightTip() | HookTip():
            return list(_tip(stimulus))
        case Sheath():
            return list(_sheath(stimulus))


def _of(
    key: str, label: str, kind: Kind, dimension: Dimension, *faces: FaceRule, body: int = 0, method: str = "",
    nominal: float | None = None, factor: float = 1.0,
) -> Characteristic:  # fmt: skip
    if dimension.unresolved:
        raise MachiningError(
            f"{key} must have its tolerance worked out (load_declared) before it is made, got {dimension}"
        )
    return Characteristic(
        key, label, kind, factor * (dimension.nominal if nominal is None else nominal), factor * dimension.lower,
        factor * dimension.upper, body, faces, method or "caliper or micrometer", dimension.quantity,
    )  # fmt: skip


def _plane(axis: int, at: float, **holds: float) -> FaceRule:
    return FaceRule("PLANE", axis, at, holds={"xyz".index(name): value for name, value in holds.items()})


_PROFILE = "profilometer, two planes with edge exclusion"


def _step_block(block: StepBlock) -> Iterator[Characteristic]:
    H, r, half = block.height.nominal, block.edge_radius.nominal, 0.5 * block.body.length.nominal
    feature, back = block.metrology, 0.5 * block.body.width.nominal
    lower, upper = _plane(2, 0.0, x=-0.5 * half), _plane(2, H, x=0.5 * half)
    yield _of("step_height", "step height", "distance", block.height, lower, upper, method=_PROFILE)
    if r > 0.0:
        arc = FaceRule("CYLINDER", radius=r, holds={0: 0.5 * r})
        yield _of("edge_radius", "edge radius", "radius", block.edge_radius, arc, method="profilometer, arc fit")
    else:
        yield _of("edge_radius", "edge radius", "note", block.edge_radius, method="profilometer, arc fit")
    band = block.height.upper - block.height.lower
    for key, label, face in (
        ("flatness_lower", "flatness, lower face", lower),
        ("flatness_upper", "flatness, upper face", upper),
    ):
        yield Characteristic(key, label, "flatness", 0.0, 0.0, 0.25 * band, 0, (face,), "interferometer, minimum zone")
    yield Characteristic("parallelism", "parallelism, upper face to A", "parallelism", 0.0, 0.0, 0.5 * band, 0,
                         (upper, lower), "interferometer, minimum zone")  # fmt: skip
    lane = back - 0.5 * feature.lane.nominal
    if feature.kind == "groove":
        near = feature.distance.nominal
        floor = _plane(2, 0.0, x=near + 0.5 * feature.width.nominal, y=lane)
        yield _of(
            "groove_depth", "groove depth", "distance", block.height, floor, upper, method="profilometer, ISO 5436-1 A1"
        )
        walls = _plane(0, near, y=lane), _plane(0, near + feature.width.nominal, y=lane)
    else:
        near = -feature.distance.nominal
        top = _plane(2, H, x=near - 0.5 * feature.width.nominal, y=lane)
        yield _of(
            "ridge_height", "ridge height", "distance", block.height, lower, top, method="profilometer, ISO 5436-1 A1"
        )
        walls = _plane(0, near, y=lane), _plane(0, near - feature.width.nominal, y=lane)
    yield _of(
        f"{feature.kind}_width", f"{feature.kind} width", "distance", feature.width, *walls, method="profilometer"
    )
    if r < H:
        riser = _plane(0, 0.0, y=-0.5 * back)
        yield _of(f"{feature.kind}_distance", f"{feature.kind} from edge", "distance", feature.distance, riser, walls[0],
                  method="profilometer")  # fmt: skip
    yield from _body(block.body, lower)


def _body(body: Body, upper: FaceRule) -> Iterator[Characteristic]:
    half, side, base = 0.5 * body.length.nominal, 0.5 * body.width.nominal, -body.thickness.nominal
    yield _of("length", "length", "distance", body.length, _plane(0, -half), _plane(0, half))
    yield _of("width", "width", "distance", body.width, _plane(1, -side), _plane(1, side))
    yield _of("thickness", "thickness", "distance", body.thickness, _plane(2, base), upper)
    spacing, radius = body.mounting.spacing, 0.5 * body.mounting.hole_diameter
    holes = [FaceRule("CYLINDER", radius=radius, holds={0: x * spacing.nominal}) for x in (-0.5, 0.5)]
    yield _of("hole_spacing", "hole spacing", "distance", spacing, *holes, method="coordinate measuring machine")
    yield _of("edge_break", "edge break, 45 deg", "note", body.edge_break)
    yield _of("engraving_depth", "engraving depth", "note", body.engraving.depth)


def _margin_block(margin: MarginBlock) -> Iterator[Characteristic]:
    g, h, v, depth = margin.marginal_gap, margin.horizontal_discrepancy, margin.opening, margin.gap_depth
    half = 0.5 * margin.body.length.nominal
    tooth, crown = _plane(2, 0.0, x=-0.5 * half), _plane(2, h.nominal, x=0.5 * half)
    low = -0.5 * depth.nominal
    yield _of("marginal_gap", "marginal gap", "distance", g, _plane(0, 0.0, z=low), _plane(0, g.nominal, z=low),
              method="profilometer or microscope")  # fmt: skip
    if h.nominal != 0.0:
        lower, upper = (h.lower, h.upper) if h.nominal > 0.0 else (-h.upper, -h.lower)
        yield Characteristic("horizontal_discrepancy", "horizontal discrepancy", "distance", abs(h.nominal), lower, upper,
                             0, (tooth, crown), _PROFILE)  # fmt: skip
    else:
        yield _of("horizontal_discrepancy", "horizontal discrepancy", "note", h, method=_PROFILE)
    if v.nominal != g.nominal:
        yield _of("vertical_discrepancy", "vertical discrepancy", "note", v, method="profilometer or microscope")
    floor = _plane(2, -depth.nominal, x=0.5 * g.nominal)
    yield _of("gap_depth", "depth of the gap", "distance", depth, floor, tooth, method="microscope")
    yield from _body(margin.body, tooth)


def _crown(margin: CrownOnTooth) -> Iterator[Characteristic]:
    R, h = margin.margin_radius, margin.horizontal_discrepancy
    root, height = margin.root_length, margin.preparation_height
    yield _of(
        "margin_diameter", "diameter at the margin", "diameter", R, FaceRule("CYLINDER", radius=R.nominal), factor=2.0
    )
    top, base = _plane(2, height.nominal), _plane(2, -root.nominal)
    if margin.finish_line.kind == "shoulder":
        shoulder = _plane(2, 0.0)
        yield _of("preparation_height", "preparation height", "distance", height, shoulder, top)
        yield _of("root_length", "root length", "distance", root, base, shoulder)
    else:
        yield Characteristic("tooth_length", "tooth, whole length", "distance", root.nominal + height.nominal,
                             root.lower + height.lower, root.upper + height.upper, 0, (base, top))  # fmt: skip
    outer = R.nominal + h.nominal
    yield Characteristic("crown_diameter", "diameter of the crown", "diameter", 2.0 * outer, 2.0 * h.lower, 2.0 * h.upper, 1,
                         (FaceRule("CYLINDER", radius=outer),))  # fmt: skip
    ceiling = height.nominal + margin.internal_gap.nominal
    yield _of("shell_thickness", "shell thickness", "distance", margin.shell_thickness, _plane(2, ceiling),
              _plane(2, ceiling + margin.shell_thickness.nominal), body=1)  # fmt: skip
    for key, dimension in (("marginal_gap", margin.marginal_gap), ("vertical_discrepancy", margin.opening),
                           ("internal_gap", margin.internal_gap), ("taper", margin.taper)):  # fmt: skip
        yield _of(key, key.replace("_", " "), "note", dimension, method="section or micro-CT, seated")


def _tip(tip: StraightTip | HookTip) -> Iterator[Characteristic]:
    yield _of("ball_radius", "ball radius", "radius", tip.ball_radius, FaceRule("SPHERE", radius=tip.ball_radius.nominal),
              method="microscope or interferometer, sphere fit")  # fmt: skip
    yield _of("shank_diameter", "shank diameter", "diameter", tip.shank_radius,
              FaceRule("CYLINDER", radius=tip.shank_radius.nominal), factor=2.0)  # fmt: skip
    yield _of("cone_angle", "half angle of the cone", "note", tip.cone_angle, method="microscope")
    if isinstance(tip, StraightTip):
        yield _of("length", "length from the contact point", "note", tip.length)
    else:
        yield _of("bend_radius", "bend radius", "note", tip.bend_radius)
        yield _of("bend_angle", "bend angle", "note", tip.bend_angle)
        yield _of("straight_length", "straight length", "note", tip.straight_length)


def _sheath(sheath: Sheath) -> Iterator[Characteristic]:
    bore, outer = sheath.bore, sheath.outer_diameter
    yield _of("bore", "bore", "diameter", bore, FaceRule("CYLINDER", radius=0.5 * bore.nominal), method="pin gauges")
    yield _of("outer_diameter", "outer diameter", "diameter", outer, FaceRule("CYLINDER", radius=0.5 * outer.nominal))
    yield _of("length", "length", "distance", sheath.length, _plane(2, 0.0), _plane(2, sheath.length.nominal))
    yield _of("edge_break", "edge break, 45 deg", "note", sheath.edge_break)
    yield _of("position", "position, from the clamp", "note", sheath.position, method="caliper, assembled")
