"""Surfaces under the faces that a dimension names, and the distances and angles between them."""

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from stepblocks.artefacts.step.exchange import Exchange, find_references, is_reference, read_number
from stepblocks.artefacts.step.units import Unit, read_unit
from stepblocks.contact import Array

_PARALLEL = 1e-9
_ONE_AXIS = 1e-12  # how far apart the axes of what is turned about one may be [m]
_DEEPEST = 12
_CURVES = ("LINE", "CIRCLE")
_TURNED = ("CYLINDRICAL_SURFACE", "CONICAL_SURFACE")
_ROUND = ("CYLINDRICAL_SURFACE", "SPHERICAL_SURFACE")
_NOWHERE: Array = np.full(3, math.nan)
_UPWARDS: Array = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Surface:
    """Surface of one face, or curve of one edge, in metres."""

    ref: str  # the face or edge
    # ``PLANE``, ``CYLINDRICAL_SURFACE`` or another; of an edge the kind of its curve, ``LINE`` or
    # ``CIRCLE``
    kind: str
    point: Array = field(default_factory=_NOWHERE.copy)  # location of its placement [m]
    axis: Array = field(default_factory=_NOWHERE.copy)  # direction of its placement
    sizes: tuple[
        float, ...
    ] = ()  # radius [m]; radius [m] and half angle [rad] of a cone; radii [m] of a torus
    representation: str = ""  # that holds it: faces of two bodies lie in two


def find_faces(file: Exchange, aspect: object, depth: int = 0) -> list[Surface]:
    """Surfaces of all faces that a shape aspect stands for, through composites."""
    if depth > _DEEPEST or not is_reference(aspect):
        return []
    found: list[Surface] = []
    for user in file.users(str(aspect)):
        parts = file.parts(user)
        for name in ("GEOMETRIC_ITEM_SPECIFIC_USAGE", "ITEM_IDENTIFIED_REPRESENTATION_USAGE"):
            values = parts.get(name, ())
            if len(values) == 5 and values[2] == aspect:
                found += [
                    _read_surface(file, item, str(values[3])) for item in find_references(values[4])
                ]
        related = parts.get("SHAPE_ASPECT_RELATIONSHIP", ())
        if len(related) == 4 and related[2] == aspect and "DATUM" not in file.parts(related[3]):
            found += find_faces(file, related[3], depth + 1)
    return list({surface.ref: surface for surface in found if surface.kind}.values())


def _read_units(file: Exchange, representation: str) -> tuple[Unit, Unit]:
    # Units of length and of angle
    for value in (value for values in file.parts(representation).values() for value in values):
        if units := file.parameters(value, "GLOBAL_UNIT_ASSIGNED_CONTEXT"):
            resolved = {one.dimension: one for one in (read_unit(file, ref) for ref in units[0])}
            return resolved.get("length", Unit()), resolved.get("angle", Unit("rad", "angle", 1.0))
    return Unit(), Unit()


def _read_surface(file: Exchange, item: str, representation: str) -> Surface:
    length, angle = _read_units(file, representation)
    under = {"EDGE_CURVE": 3, "ADVANCED_FACE": 2, "FACE_SURFACE": 2}
    carrier = next(
        (
            file.parameters(item, name)[at]
            for name, at in under.items()
            if file.parameters(item, name)
        ),
        item,
    )
    # a curve that is given with its traces on the two faces
    for name in (
        "SURFACE_CURVE",
        "SEAM_CURVE",
    ):
        carrier = (*file.parameters(carrier, name)[1:2], carrier)[0]
    kind, parameters = next(iter(file.parts(carrier).items()), ("", ()))
    if len(parameters) < 2 or not is_reference(parameters[1]):
        return Surface(item, kind, representation=representation)
    if kind == "LINE":
        along = (*file.parameters(parameters[-1], "VECTOR"), None, None)[1]
        return Surface(
            item,
            kind,
            length.si(_read_coordinates(file, parameters[1])),
            _read_direction(file, along),
            representation=representation,
        )
    point, axis, _ = _read_placement(file, parameters[1])
    numbers = [
        math.nan if (size := read_number(value)) is None else size for value in parameters[2:]
    ]
    sizes = [length.si(size) for size in numbers]
    if kind == "CONICAL_SURFACE" and len(sizes) == 2:
        sizes[1] = angle.si(numbers[1])
    return Surface(item, kind, length.si(point), axis, tuple(sizes), representation)


def _read_coordinates(file: Exchange, ref: object) -> Array:
    values = file.parameters(ref, "CARTESIAN_POINT")
    return np.array(values[1], dtype=np.float64) if len(values) == 2 else _NOWHERE


def _read_direction(file: Exchange, ref: object, default: Array = _NOWHERE) -> Array:
    values = file.parameters(ref, "DIRECTION")
    direction = np.array(values[1], dtype=np.float64) if len(values) == 2 else default
    return np.asarray(direction / np.linalg.norm(direction))


def _read_placement(file: Exchange, ref: object) -> tuple[Array, Array, Array]:
    # Location, in the units of the file, direction, and second direction
    values = file.parameters(ref, "AXIS2_PLACEMENT_3D")
    if len(values) != 4:
        return _NOWHERE, _NOWHERE, _NOWHERE
    return (
        _read_coordinates(file, values[1]),
        _read_direction(file, values[2], _UPWARDS),
        _read_direction(file, values[3], _UPWARDS),
    )


def is_placed_where_drawn(file: Exchange) -> bool:
    """Tell whether every component of an assembly lies where its coordinates put it.

    Only then can two bodies be compared.
    """
    for _, values in file.named("ITEM_DEFINED_TRANSFORMATION"):
        first, second = (_read_placement(file, item) for item in values[2:4])
        if not np.allclose(first, second, rtol=0.0, atol=1e-12):
            return False
    return True


def _scale_by_name(radius: float, name: str) -> float | None:
    # Give what a dimension is named after: a diameter, a radius, or neither
    return next(
        (factor * radius for word, factor in (("diameter", 2.0), ("radius", 1.0)) if word in name),
        None,
    )


def measure_size(surfaces: list[Surface], name: str) -> float | None:
    """Size of a feature from its own faces."""
    if surfaces and all(one.kind in _CURVES for one in surfaces):
        return 0.0 if "radius" in name else None  # an edge that is a curve of two faces is sharp
    if surfaces and all(one.kind in _ROUND and one.sizes for one in surfaces):
        radii = {one.sizes[0] for one in surfaces}
        return _scale_by_name(max(radii), name) if max(radii) - min(radii) <= 1e-12 else None
    if (
        len(surfaces) == 1
        and surfaces[0].kind == "TOROIDAL_SURFACE"
        and len(surfaces[0].sizes) == 2
    ):
        # a ring's size is, as its dimension is named, that of its middle, of its wire, or of its
        # inner or outer edge
        major, minor = surfaces[0].sizes
        named = {
            "high major": major + minor,
            "low major": major - minor,
            "major": major,
            "minor": minor,
        }
        radius = next(
            (value for words, value in named.items() if f"toroidal {words}" in name), None
        )
        return None if radius is None else _scale_by_name(radius, name)
    if len(surfaces) == 2 and all(one.kind == "PLANE" for one in surfaces):
        return measure_distance([surfaces[0]], [surfaces[1]])
    if "angle" in name and len(surfaces) == 1 and surfaces[0].kind == "CONICAL_SURFACE":
        return 2.0 * surfaces[0].sizes[1]
    return None


def measure_distance(first: list[Surface], second: list[Surface], kind: str = "") -> float | None:
    """Distance between two features: planes, axes of cylinders, centres of spheres."""
    sides = kind.removeprefix("linear distance").split()
    one, other = sides if len(sides) == 2 else ("", "")
    known = []
    for a, b in itertools.product(first, second):
        if (apart := _measure_distance(a, b)) is None:
            return None
        known.append(apart + _measure_beyond_centre(a, one) + _measure_beyond_centre(b, other))
    return known[0] if known and max(known) - min(known) <= 1e-12 else None


def _measure_beyond_centre(surface: Surface, side: str) -> float:
    # How far the side of a round feature that a dimension names lies beyond its centre [m]
    if surface.kind not in _ROUND or not surface.sizes:
        return 0.0
    return {"outer": surface.sizes[0], "inner": -surface.sizes[0]}.get(side, 0.0)


def _measure_distance(a: Surface, b: Surface) -> float | None:
    if b.kind == "PLANE" or (a.kind in _CURVES and b.kind not in _CURVES):
        a, b = b, a
    between = b.point - a.point
    parallel = float(np.linalg.norm(np.cross(a.axis, b.axis))) <= _PARALLEL
    if a.kind == "PLANE":
        along = b.kind in ("LINE", *_TURNED) and abs(float(a.axis @ b.axis)) <= _PARALLEL
        level = (
            along or b.kind == "SPHERICAL_SURFACE" or (b.kind in ("PLANE", "CIRCLE") and parallel)
        )
        return abs(float(between @ a.axis)) if level else None
    if a.kind == b.kind == "SPHERICAL_SURFACE":
        return float(np.linalg.norm(between))
    along_axis = float(between @ a.axis)
    apart = float(np.linalg.norm(between - along_axis * a.axis))
    one_axis = parallel and apart <= _ONE_AXIS
    if b.kind == "CIRCLE" and one_axis and a.kind == "CIRCLE":
        return math.hypot(along_axis, b.sizes[0] - a.sizes[0])
    if a.kind == "CONICAL_SURFACE" and one_axis and _is_as_steep(a, b):  # square to the cone
        wider = b.sizes[0] - a.sizes[0] - along_axis * math.tan(a.sizes[1])
        return abs(wider) * math.cos(a.sizes[1])
    if a.kind not in _TURNED or not (
        b.kind == "SPHERICAL_SURFACE" or (b.kind in _TURNED and parallel)
    ):
        return None
    if a.kind == b.kind and apart <= _ONE_AXIS and a.representation != b.representation:
        # one body in the bore of another: the gap, their axes being one
        return abs(a.sizes[0] - b.sizes[0])
    return apart


def _is_as_steep(cone: Surface, other: Surface) -> bool:
    # Tell whether a cone and a surface about its axis have one distance. They do for a round edge,
    # or a cone of the same angle.
    same_way = 1.0 if cone.axis @ other.axis > 0.0 else -1.0
    cones = (
        other.kind == "CONICAL_SURFACE" and abs(cone.sizes[1] - same_way * other.sizes[1]) <= 1e-12
    )
    return cones or other.kind == "CIRCLE"


def measure_angle(first: list[Surface], second: list[Surface], nominal: float) -> float | None:
    """Measure the angle between two planes or axes [rad].

    Of the two supplementary angles it is the one nearer to `nominal`.
    """
    kinds = {one.kind for one in (*first, *second)}
    if len(first) != 1 or len(second) != 1 or not (kinds == {"PLANE"} or kinds <= set(_TURNED)):
        return None
    angle = float(
        np.arctan2(
            np.linalg.norm(np.cross(first[0].axis, second[0].axis)), first[0].axis @ second[0].axis
        )
    )
    return min((angle, math.pi - angle), key=lambda one: abs(one - nominal))
