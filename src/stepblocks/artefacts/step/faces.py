"""Surfaces under the faces that a dimension names, and the distances and angles between them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.step.exchange import Exchange, is_reference, number, references_in
from stepblocks.artefacts.step.units import unit_of

Array = NDArray[np.float64]

_PARALLEL = 1e-9
_DEEPEST = 12
_CURVES = ("LINE", "CIRCLE")
_TURNED = ("CYLINDRICAL_SURFACE", "CONICAL_SURFACE")
_ROUND = ("CYLINDRICAL_SURFACE", "SPHERICAL_SURFACE")
_NOWHERE: Array = np.full(3, math.nan)


@dataclass(frozen=True)
class Surface:
    """Surface of one face, in metres."""

    ref: str  # the face
    kind: str  # ``PLANE``, ``CYLINDRICAL_SURFACE`` or another; of an edge the kind of its curve, ``LINE`` or ``CIRCLE``
    point: Array = field(default_factory=_NOWHERE.copy)  # location of its placement [m]
    axis: Array = field(default_factory=_NOWHERE.copy)  # direction of its placement
    sizes: tuple[float, ...] = ()  # radius [m]; radius [m] and half angle [rad] of a cone; radii [m] of a torus
    representation: str = ""  # that holds it: faces of two bodies lie in two


def faces_of(file: Exchange, aspect: object, depth: int = 0) -> list[Surface]:
    """Surfaces of all faces that a shape aspect stands for, through composites."""
    if depth > _DEEPEST or not is_reference(aspect):
        return []
    found: list[Surface] = []
    for user in file.users(str(aspect)):
        parts = file.parts(user)
        for name in ("GEOMETRIC_ITEM_SPECIFIC_USAGE", "ITEM_IDENTIFIED_REPRESENTATION_USAGE"):
            values = parts.get(name, ())
            if len(values) == 5 and values[2] == aspect:
                per_metre, angle = _units(file, values[3])
                surfaces = (_surface(file, item, per_metre, angle) for item in references_in(values[4]))
                found += [replace(one, representation=str(values[3])) for one in surfaces]
        related = parts.get("SHAPE_ASPECT_RELATIONSHIP", ())
        if len(related) == 4 and related[2] == aspect and "DATUM" not in file.parts(related[3]):
            found += faces_of(file, related[3], depth + 1)
    unique = {surface.ref: surface for surface in found if surface.kind}
    return list(unique.values())


def _units(file: Exchange, representation: object) -> tuple[float, float]:
    """Units of length per metre, whole where nearly whole so that millimetres divide by 1000, and radians per unit of angle."""
    for value in (value for values in file.parts(representation).values() for value in values):
        if units := file.parameters(value, "GLOBAL_UNIT_ASSIGNED_CONTEXT"):
            resolved = {one.dimension: one.factor for one in (unit_of(file, ref) for ref in units[0])}
            exact = 1.0 / resolved.get("length", math.nan)
            whole = float(round(exact)) if math.isfinite(exact) else math.nan
            return whole if abs(exact - whole) < 1e-9 * exact else exact, resolved.get("angle", 1.0)
    return math.nan, math.nan


def _surface(file: Exchange, item: str, per_metre: float, angle: float) -> Surface:
    edge = file.parameters(item, "EDGE_CURVE")
    values = file.parameters(item, "ADVANCED_FACE") or file.parameters(item, "FACE_SURFACE")
    if len(edge) == 5:
        return _curve(file, item, edge[3], per_metre)
    if len(values) != 4:
        return Surface(item, next(iter(file.parts(item)), ""))
    kind, parameters = next(iter(file.parts(values[2]).items()), ("", ()))
    if len(parameters) < 2 or not is_reference(parameters[1]):
        return Surface(item, kind)
    point, axis, _ = _placement(file, parameters[1])
    sizes = [math.nan if (size := number(value)) is None else size / per_metre for value in parameters[2:]]
    half_angle = number(parameters[-1])
    if kind == "CONICAL_SURFACE" and len(sizes) == 2 and half_angle is not None:
        sizes[1] = half_angle * angle
    return Surface(item, kind, point / per_metre, axis, tuple(sizes))


def _curve(file: Exchange, edge: str, curve: object, per_metre: float) -> Surface:
    """Read the curve under an edge; one that is given with its traces on the two faces is its own first parameter."""
    for name in ("SURFACE_CURVE", "SEAM_CURVE"):
        inner = file.parameters(curve, name)
        curve = inner[1] if len(inner) > 1 else curve
    kind = next(iter(file.parts(curve)), "")
    parameters = file.parameters(curve, kind)
    if kind == "LINE" and len(parameters) == 3:
        vector = (*file.parameters(parameters[2], "VECTOR"), None, None)
        origin, along = _coordinates(file, parameters[1], "CARTESIAN_POINT"), _coordinates(file, vector[1], "DIRECTION")
        if origin is not None and along is not None:
            return Surface(edge, kind, origin / per_metre, along / np.linalg.norm(along))
    if kind == "CIRCLE" and len(parameters) == 3:
        middle, axis, _ = _placement(file, parameters[1])
        radius = number(parameters[2])
        return Surface(edge, kind, middle / per_metre, axis, () if radius is None else (radius / per_metre,))
    return Surface(edge, kind)


def _coordinates(file: Exchange, ref: object, entity: str) -> Array | None:
    values = file.parameters(ref, entity)
    return np.array(values[1], dtype=np.float64) if len(values) == 2 else None


def _placement(file: Exchange, ref: object) -> tuple[Array, Array, Array]:
    """Location, in the units of the file, direction, and second direction."""
    values = file.parameters(ref, "AXIS2_PLACEMENT_3D")
    if len(values) != 4:
        return _NOWHERE, _NOWHERE, _NOWHERE
    origin = _coordinates(file, values[1], "CARTESIAN_POINT")
    direction, second = (_coordinates(file, value, "DIRECTION") for value in values[2:])
    direction = np.array([0.0, 0.0, 1.0]) if direction is None else direction
    second = np.zeros(3) if second is None else second
    return _NOWHERE if origin is None else origin, direction / np.linalg.norm(direction), second


def placed_where_drawn(file: Exchange) -> bool:
    """Whether every component of an assembly lies where its own coordinates put it, so that two bodies can be compared."""
    for _, values in file.named("ITEM_DEFINED_TRANSFORMATION"):
        first, second = (_placement(file, item) for item in values[2:4])
        if not np.allclose(first, second, rtol=0.0, atol=1e-12):
            return False
    return True


def measured_size(surfaces: list[Surface], name: str) -> float | None:
    """Size of a feature from its own faces."""
    if surfaces and all(one.kind in _CURVES for one in surfaces):
        return 0.0 if "radius" in name else None  # an edge that is a curve of two faces is sharp
    if surfaces and all(one.kind in _ROUND and one.sizes for one in surfaces):
        radii = {one.sizes[0] for one in surfaces}
        if max(radii) - min(radii) > 1e-12:
            return None
        return 2.0 * max(radii) if "diameter" in name else max(radii) if "radius" in name else None
    if len(surfaces) == 1 and surfaces[0].kind == "TOROIDAL_SURFACE" and len(surfaces[0].sizes) == 2:
        # a ring's size is, as its dimension is named, that of its middle, of its wire, or of its inner or outer edge
        major, minor = surfaces[0].sizes
        named = {"high major": major + minor, "low major": major - minor, "major": major, "minor": minor}
        radius = next((value for words, value in named.items() if f"toroidal {words}" in name), None)
        return None if radius is None else 2.0 * radius if "diameter" in name else radius if "radius" in name else None
    if len(surfaces) == 2 and all(one.kind == "PLANE" for one in surfaces):
        return measured_distance([surfaces[0]], [surfaces[1]])
    if "angle" in name and len(surfaces) == 1 and surfaces[0].kind == "CONICAL_SURFACE":
        return 2.0 * surfaces[0].sizes[1]
    return None


def measured_distance(first: list[Surface], second: list[Surface], kind: str = "") -> float | None:
    """Distance between two features: planes, axes of cylinders, centres of spheres."""
    sides = kind.removeprefix("linear distance").split()
    one, other = sides if len(sides) == 2 else ("", "")
    known = []
    for a, b in itertools.product(first, second):
        if (apart := _distance(a, b)) is None:
            return None
        known.append(apart + _beyond_centre(a, one) + _beyond_centre(b, other))
    return known[0] if known and max(known) - min(known) <= 1e-12 else None


def _beyond_centre(surface: Surface, side: str) -> float:
    """How far the side of a round feature that a dimension names lies beyond its centre [m]."""
    if surface.kind not in _ROUND or not surface.sizes:
        return 0.0
    return {"outer": surface.sizes[0], "inner": -surface.sizes[0]}.get(side, 0.0)


def _distance(a: Surface, b: Surface) -> float | None:
    if b.kind == "PLANE" or (a.kind in _CURVES and b.kind not in _CURVES):
        a, b = b, a
    if b.kind in _CURVES:
        return _distance_to_curve(a, b)
    between = b.point - a.point
    ball, turned = b.kind == "SPHERICAL_SURFACE", b.kind in _TURNED
    if a.kind == b.kind == "CONICAL_SURFACE":  # the gap across two on one axis with one angle
        same_way = 1.0 if a.axis @ b.axis > 0.0 else -1.0
        gap = _across_cone(a, b) if abs(a.sizes[1] - same_way * b.sizes[1]) <= 1e-12 else None
        if gap is not None:
            return gap
    if a.kind == "PLANE":
        level = ball or (_parallel(a, b) if b.kind == "PLANE" else turned and abs(a.axis @ b.axis) <= _PARALLEL)
        return abs(float(between @ a.axis)) if level else None
    if a.kind in _TURNED and (ball or (turned and _parallel(a, b))):
        apart = float(np.linalg.norm(between - (between @ a.axis) * a.axis))
        if a.kind == b.kind and apart <= 1e-12 and a.representation != b.representation:
            return abs(a.sizes[0] - b.sizes[0])  # one body in the bore of another: the gap, their axes being one
        return apart
    return float(np.linalg.norm(between)) if a.kind == b.kind == "SPHERICAL_SURFACE" else None


def _distance_to_curve(a: Surface, b: Surface) -> float | None:
    """Distance of a plane from a straight edge along it or a round edge level over it; of what is round from a round edge about it."""
    if a.kind == b.kind == "CIRCLE":
        along = float((b.point - a.point) @ a.axis)
        coaxial = _parallel(a, b) and float(np.linalg.norm(b.point - a.point - along * a.axis)) <= 1e-12
        return math.hypot(along, b.sizes[0] - a.sizes[0]) if coaxial else None
    if a.kind == "CONICAL_SURFACE" and b.kind == "CIRCLE":
        return _across_cone(a, b)
    if a.kind != "PLANE":
        return None
    level = abs(float(a.axis @ b.axis)) <= _PARALLEL if b.kind == "LINE" else _parallel(a, b)
    return abs(float((b.point - a.point) @ a.axis)) if level else None


def _parallel(a: Surface, b: Surface) -> bool:
    return float(np.linalg.norm(np.cross(a.axis, b.axis))) <= _PARALLEL


def _across_cone(cone: Surface, other: Surface) -> float | None:
    """Distance from a cone, square to it, to the circle at which a surface or edge on the same axis is placed."""
    between = other.point - cone.point
    along = float(between @ cone.axis)
    if not _parallel(cone, other) or float(np.linalg.norm(between - along * cone.axis)) > 1e-12:
        return None
    return abs(other.sizes[0] - cone.sizes[0] - along * math.tan(cone.sizes[1])) * math.cos(cone.sizes[1])


def measured_angle(first: list[Surface], second: list[Surface], nominal: float) -> float | None:
    """Angle between two planes or axes, the one of the two supplementary angles that lies nearer to `nominal` [rad]."""
    kinds = {one.kind for one in (*first, *second)}
    if len(first) != 1 or len(second) != 1 or not (kinds == {"PLANE"} or kinds <= set(_TURNED)):
        return None
    angle = float(np.arctan2(np.linalg.norm(np.cross(first[0].axis, second[0].axis)), first[0].axis @ second[0].axis))
    return min((angle, math.pi - angle), key=lambda one: abs(one - nominal))
