"""What a workshop must hold: every characteristic of a part, numbered once for STEP, drawing and inspection sheet.

Each names the faces, or the edges between two faces, that carry it; the faces of a gap may belong to two bodies. What no
face carries (where a sheath sits on the shank, the opening of a bevelled margin over a chamfer) is a note.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

from stepblocks.cad.kernel import Face
from stepblocks.errors import MachiningError
from stepblocks.parts.body import Body
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip
from stepblocks.parts.tolerance import Dimension
from stepblocks.parts.working_faces import FaceDemands

Kind = Literal["distance", "diameter", "radius", "angle", "flatness", "parallelism", "note"]
# Permissible deviation of an angle without one of its own, shorter side up to 10 mm (ISO 2768-m) [rad]
_BEVEL = math.radians(1.0)
_BREAK = "edge break, 45 deg, all edges"
_REACH = 1e-7  # How far a bounding box may be off its face [m]: the kernel enlarges boxes by its tolerance


@dataclass(frozen=True)
class FaceRule:
    """How to find a face."""

    # ``PLANE`` (square to an axis), ``SLOPE`` (a plane that is not), ``CYLINDER``, ``CONE``, ``TORUS`` or ``SPHERE``
    kind: str
    axis: int = 2  # Axis that a plane is perpendicular to: 0, 1, 2
    at: float = 0.0  # Coordinate of the plane along it [m]
    radius: float = 0.0  # Radius of a cylinder or sphere [m]
    # Coordinates [m] by axis that the face's box must contain; of a slope, those of its middle
    holds: dict[int, float] = field(default_factory=dict)
    body: int | None = None  # Solid it belongs to; that of its characteristic where omitted


@dataclass(frozen=True)
class EdgeRule:
    """An edge, by the two faces that meet in it; the longest where they meet in several."""

    first: FaceRule  # The faces, of one solid
    second: FaceRule

    @property
    def body(self) -> int | None:
        """Solid it belongs to."""
        return self.first.body


Rule = FaceRule | EdgeRule


@dataclass(frozen=True)
class Characteristic:
    """One line of the inspection sheet."""

    key: str  # Name in as-built records: ``step_height``, ``edge_radius``,
    label: str  # What a person calls it
    kind: Kind  # Kind of dimension or tolerance; ``note`` where no face carries it
    nominal: float  # Nominal [m or rad]; 0 of a form tolerance
    lower: float  # Deviations, signed [m or rad]
    upper: float
    body: int = 0  # Index of the solid it belongs to
    faces: tuple[Rule, ...] = ()  # What it names: two of a distance or of an angle between planes, one of the others
    method: str = "caliper or micrometer"  # How it is measured
    quantity: str = "length"  # ``length`` or ``angle``


def find_face(faces: tuple[Face, ...], rule: FaceRule, place: str) -> int:
    """Find the one face that a rule describes, the largest where the rule fits several."""

    def fits(face: Face) -> bool:
        if face.kind != ("PLANE" if rule.kind == "SLOPE" else rule.kind):
            return False
        if rule.kind == "SLOPE":
            flat = sum(high - low < 10.0 * _REACH for low, high in zip(face.low, face.high, strict=True))
            return flat == 0 and all(
                abs(0.5 * (face.low[k] + face.high[k]) - v) < 2.0 * _REACH for k, v in rule.holds.items()
            )
        if rule.kind == "PLANE":
            low, high = face.low[rule.axis], face.high[rule.axis]
            if abs(low - rule.at) > _REACH + 1e-9 or abs(high - rule.at) > _REACH + 1e-9:
                return False
        elif rule.kind in ("CYLINDER", "SPHERE") and abs(face.radius - rule.radius) > 1e-12:
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
    """List the characteristics of a part in the order of the inspection sheet."""
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
    key: str,
    label: str,
    kind: Kind,
    dimension: Dimension,
    *faces: Rule,
    body: int = 0,
    method: str = "",
    nominal: float | None = None,
    factor: float = 1.0,
) -> Characteristic:
    if dimension.unresolved:
        raise MachiningError(
            f"{key} must have its tolerance worked out (load_declared) before it is made, got {dimension}"
        )
    return Characteristic(
        key,
        label,
        kind,
        factor * (dimension.nominal if nominal is None else nominal),
        factor * dimension.lower,
        factor * dimension.upper,
        body,
        faces,
        method or "caliper or micrometer",
        dimension.quantity,
    )


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
        sharp = EdgeRule(_plane(0, 0.0, z=0.5 * H), upper)
        yield _of("edge_radius", "edge radius", "radius", block.edge_radius, sharp, method="profilometer, arc fit")
    yield from _faces(block.face_demands, lower, upper, "lower face", "upper face")
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
        yield _of(
            f"{feature.kind}_distance",
            f"{feature.kind} from edge",
            "distance",
            feature.distance,
            riser,
            walls[0],
            method="profilometer",
        )
    yield from _body(block.body, lower)


def _faces(demands: FaceDemands, low: FaceRule, high: FaceRule, lower: str, upper: str) -> Iterator[Characteristic]:
    how = "interferometer, form of the face, minimum zone"
    yield Characteristic("flatness_lower", f"flatness, {lower}", "flatness", 0.0, 0.0, demands.flatness, 0, (low,), how)
    yield Characteristic(
        "flatness_upper", f"flatness, {upper}", "flatness", 0.0, 0.0, demands.flatness, 0, (high,), how
    )
    yield Characteristic(
        "parallelism", f"parallelism, {upper} to A", "parallelism", 0.0, 0.0, demands.parallelism, 0, (high, low), how
    )


def _body(body: Body, upper: FaceRule) -> Iterator[Characteristic]:
    half, side, base = 0.5 * body.length.nominal, 0.5 * body.width.nominal, -body.thickness.nominal
    yield _of("length", "length", "distance", body.length, _plane(0, -half), _plane(0, half))
    yield _of("width", "width", "distance", body.width, _plane(1, -side), _plane(1, side))
    yield _of("thickness", "thickness", "distance", body.thickness, _plane(2, base), upper)
    spacing, radius = body.mounting.spacing, 0.5 * body.mounting.hole_diameter
    holes = [FaceRule("CYLINDER", radius=radius, holds={0: x * spacing.nominal}) for x in (-0.5, 0.5)]
    yield _of("hole_spacing", "hole spacing", "distance", spacing, *holes, method="coordinate measuring machine")
    c = body.edge_break.nominal
    if c > 0.0:  # of all edges alike, measured at the one along the base on the right
        broken = FaceRule("SLOPE", holds={0: half - 0.5 * c, 1: 0.0, 2: base + 0.5 * c})
        yield _of("edge_break", _BREAK, "distance", body.edge_break, _plane(0, half), EdgeRule(broken, _plane(2, base)))
    else:
        yield _of("edge_break", _BREAK, "note", body.edge_break)
    depth = body.engraving.depth
    yield _of(
        "engraving_depth", "engraving depth", "distance", depth, _plane(1, -side), _plane(1, -side + depth.nominal)
    )


def _margin_block(margin: MarginBlock) -> Iterator[Characteristic]:
    g, h, v, depth = margin.marginal_gap, margin.horizontal_discrepancy, margin.opening, margin.gap_depth
    half = 0.5 * margin.body.length.nominal
    tooth, crown = _plane(2, 0.0, x=-0.5 * half), _plane(2, h.nominal, x=0.5 * half)
    low = -0.5 * depth.nominal
    yield _of(
        "marginal_gap",
        "marginal gap",
        "distance",
        g,
        _plane(0, 0.0, z=low),
        _plane(0, g.nominal, z=low),
        method="profilometer or microscope",
    )
    # a distance has no sign: of an underextended crown the limits change places
    lower, upper = (h.lower, h.upper) if h.nominal >= 0.0 else (-h.upper, -h.lower)
    yield Characteristic(
        "horizontal_discrepancy",
        "horizontal discrepancy",
        "distance",
        abs(h.nominal),
        lower,
        upper,
        0,
        (tooth, crown),
        _PROFILE,
    )
    wall = _plane(0, 0.0, z=low)
    if v.nominal > g.nominal:
        bevel = FaceRule(
            "SLOPE", holds={0: 0.5 * (g.nominal + v.nominal), 2: h.nominal - 0.5 * (v.nominal - g.nominal)}
        )
        yield _of(
            "vertical_discrepancy",
            "vertical discrepancy",
            "distance",
            v,
            wall,
            EdgeRule(bevel, crown),
            method="profilometer or microscope",
        )
        yield Characteristic(
            "bevel_angle",
            "bevel of the margin",
            "angle",
            math.radians(45.0),
            -_BEVEL,
            _BEVEL,
            0,
            (bevel, crown),
            "profilometer or microscope",
            "angle",
        )
    elif v.nominal < 0.0:
        end = _plane(0, v.nominal, z=0.5 * (g.nominal + h.nominal))
        yield Characteristic(
            "vertical_discrepancy",
            "vertical discrepancy, lip over the tooth",
            "distance",
            -v.nominal,
            -v.upper,
            -v.lower,
            0,
            (wall, end),
            "profilometer or microscope",
        )
    elif v.nominal != g.nominal:
        yield _of("vertical_discrepancy", "vertical discrepancy", "note", v, method="profilometer or microscope")
    yield from _faces(margin.face_demands, tooth, crown, "tooth", "crown")
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
        yield Characteristic(
            "tooth_length",
            "tooth, whole length",
            "distance",
            root.nominal + height.nominal,
            root.lower + height.lower,
            root.upper + height.upper,
            0,
            (base, top),
        )
    outer = R.nominal + h.nominal
    yield Characteristic(
        "crown_diameter",
        "diameter of the crown",
        "diameter",
        2.0 * outer,
        2.0 * h.lower,
        2.0 * h.upper,
        1,
        (FaceRule("CYLINDER", radius=outer),),
    )
    ceiling = height.nominal + margin.internal_gap.nominal
    yield _of(
        "shell_thickness",
        "shell thickness",
        "distance",
        margin.shell_thickness,
        _plane(2, ceiling),
        _plane(2, ceiling + margin.shell_thickness.nominal),
        body=1,
    )
    yield from _seated(margin, ceiling)


def _seated(margin: CrownOnTooth, ceiling: float) -> Iterator[Characteristic]:
    """Gaps between the two bodies, the crown seated on its tooth."""
    R, g, v = margin.margin_radius.nominal, margin.marginal_gap, margin.opening
    how = "section or micro-CT, seated"
    finish = margin.finish_line.kind
    below = FaceRule("CYLINDER", radius=R, body=0)
    ledge = {"shoulder": _plane(2, 0.0), "chamfer": FaceRule("TORUS", body=0), "feather-edge": FaceRule("CONE", body=0)}
    cavosurface = EdgeRule(below, replace(ledge[finish], body=0))
    end = _on(1, _plane(2, v.nominal))
    walls = _walls(margin)
    if finish == "shoulder":
        yield _of(
            "marginal_gap",
            "marginal gap",
            "distance",
            g,
            _on(0, _plane(2, 0.0)),
            _on(1, _plane(2, g.nominal)),
            method=how,
        )
    elif finish == "chamfer":
        yield _of("marginal_gap", "marginal gap", "distance", g, cavosurface, _on(1, _plane(2, g.nominal)), method=how)
    else:  # between two cones that are not parallel each gap holds at one end of the crown's
        yield _of("marginal_gap", "marginal gap", "distance", g, walls[0], EdgeRule(walls[1], end), method=how)
    yield _opening(margin, cavosurface, end)
    top = EdgeRule(walls[1], _on(1, _plane(2, ceiling)))
    across = (walls[0], top) if finish == "feather-edge" else walls
    yield _of("internal_gap", "internal gap", "distance", margin.internal_gap, *across, method=how)
    roof = Characteristic(
        "internal_gap_roof",
        "internal gap, roof",
        "distance",
        margin.internal_gap.nominal,
        margin.internal_gap.lower,
        margin.internal_gap.upper,
        0,
        (_on(0, _plane(2, margin.preparation_height.nominal)), _on(1, _plane(2, ceiling))),
        how,
    )
    if margin.internal_gap.nominal > 0.0:
        yield roof
    if margin.taper.nominal > 0.0:
        yield _of("taper", "total taper", "angle", margin.taper, walls[0], method=how, factor=2.0)


def _walls(margin: CrownOnTooth) -> tuple[FaceRule, FaceRule]:
    """Axial walls of tooth and crown: cones, or cylinders where there is no taper."""
    if margin.taper.nominal > 0.0:  # halfway up, where no bevel is
        middle = {2: 0.5 * margin.preparation_height.nominal}
        return FaceRule("CONE", holds=middle, body=0), FaceRule("CONE", holds=middle, body=1)
    inside = margin.margin_radius.nominal - margin.finish_line.width.nominal
    return (
        FaceRule("CYLINDER", radius=inside, body=0),
        FaceRule("CYLINDER", radius=inside + margin.internal_gap.nominal, body=1),
    )


def _opening(margin: CrownOnTooth, cavosurface: EdgeRule, end: FaceRule) -> Characteristic:
    """From the cavosurface angle along the path of draw to the margin of the crown."""
    v, g, how = margin.opening, margin.marginal_gap.nominal, "section or micro-CT, seated"
    key, label = "vertical_discrepancy", "vertical discrepancy"
    if v.nominal < 0.0:  # a distance has no sign: of a lip over the tooth the limits change places
        return Characteristic(
            key, f"{label}, lip over the tooth", "distance", -v.nominal, -v.upper, -v.lower, 0, (cavosurface, end), how
        )
    if v.nominal == g or margin.finish_line.kind == "feather-edge":
        return _of(key, label, "distance", v, cavosurface, end, method=how)
    if margin.finish_line.kind == "shoulder" and v.nominal > g:  # the margin is where the bevel meets the outside
        outside = FaceRule(
            "CYLINDER", radius=margin.margin_radius.nominal + margin.horizontal_discrepancy.nominal, body=1
        )
        bevel = FaceRule("CONE", holds={2: 0.5 * (g + v.nominal)}, body=1)
        return _of(key, label, "distance", v, _on(0, _plane(2, 0.0)), EdgeRule(bevel, outside), method=how)
    return _of(key, label, "note", v, method=how)


def _on(body: int, rule: FaceRule) -> FaceRule:
    return replace(rule, body=body)


def _tip(tip: StraightTip | HookTip) -> Iterator[Characteristic]:
    yield _of(
        "ball_radius",
        "ball radius",
        "radius",
        tip.ball_radius,
        FaceRule("SPHERE", radius=tip.ball_radius.nominal),
        method="microscope or interferometer, sphere fit",
    )
    yield _of(
        "shank_diameter",
        "shank diameter",
        "diameter",
        tip.shank_radius,
        FaceRule("CYLINDER", radius=tip.shank_radius.nominal),
        factor=2.0,
    )
    yield _of(
        "cone_angle", "cone angle, included", "angle", tip.cone_angle, FaceRule("CONE"), method="microscope", factor=2.0
    )
    ball = FaceRule("SPHERE", radius=tip.ball_radius.nominal)
    if isinstance(tip, StraightTip):
        end = _plane(2, tip.length.nominal)
        yield _of("length", "length from the contact point", "distance", tip.length, end, ball)
    else:
        yield from _hook(tip)


def _hook(tip: HookTip) -> Iterator[Characteristic]:
    angle, bend, straight = tip.bend_angle.nominal, tip.bend_radius.nominal, tip.straight_length.nominal
    wire, cone, ring = FaceRule("CYLINDER", radius=tip.shank_radius.nominal), FaceRule("CONE"), FaceRule("TORUS")
    yield _of("bend_radius", "bend radius", "radius", tip.bend_radius, ring, method="microscope")
    yield _of("bend_angle", "bend angle", "angle", tip.bend_angle, cone, wire, method="microscope")
    x = bend * (1.0 - math.cos(angle)) + straight * math.sin(angle)
    z = tip.cone_end + bend * math.sin(angle) + straight * math.cos(angle)
    square = math.isclose(angle, 0.5 * math.pi)
    end = _plane(0, x, z=z) if square else FaceRule("SLOPE", holds={0: x, 1: 0.0, 2: z})
    yield _of("straight_length", "straight length", "distance", tip.straight_length, end, EdgeRule(ring, wire))


def _sheath(sheath: Sheath) -> Iterator[Characteristic]:
    bore, outer = sheath.bore, sheath.outer_diameter
    yield _of("bore", "bore", "diameter", bore, FaceRule("CYLINDER", radius=0.5 * bore.nominal), method="pin gauges")
    yield _of("outer_diameter", "outer diameter", "diameter", outer, FaceRule("CYLINDER", radius=0.5 * outer.nominal))
    yield _of("length", "length", "distance", sheath.length, _plane(2, 0.0), _plane(2, sheath.length.nominal))
    if sheath.edge_break.nominal > 0.0:
        side = FaceRule("CYLINDER", radius=0.5 * outer.nominal)
        broken = EdgeRule(FaceRule("CONE", holds={2: 0.5 * sheath.edge_break.nominal}), side)
        yield _of("edge_break", _BREAK, "distance", sheath.edge_break, _plane(2, 0.0), broken)
    else:
        yield _of("edge_break", _BREAK, "note", sheath.edge_break)
    yield _of("position", "position, from the clamp", "note", sheath.position, method="caliper, assembled")
