"""Sizes, distances and angles of the features that a dimension names, by their surfaces.

Every result is None where the surfaces do not determine it.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.artefacts.step.faces import (
    CIRCLE,
    CONE,
    CYLINDER,
    LINE,
    PLANE,
    SPHERE,
    TORUS,
    Surface,
)

_PARALLEL = 1e-9  # largest sine of an angle between parallel directions [1]
_SAME_LENGTH = 1e-12  # of faces of one feature [m]
_SAME_ANGLE = 1e-12  # of two cones [rad]
_ONE_AXIS = 1e-12  # how far apart the axes of what is turned about one may be [m]
_CURVES = (LINE, CIRCLE)
_WITH_AXIS = (CYLINDER, CONE)
_WITH_RADIUS = (CYLINDER, SPHERE)
_LOCATED = "linear distance"  # begins the kind of a distance; the sides that it joins follow


def measure_size(surfaces: Sequence[Surface], size_name: str) -> float | None:
    """Measure the size of a feature by its own faces.

    Parameters
    ----------
    surfaces : sequence of Surface
        All faces of the feature.
    size_name : str
        What the file calls the size: ``diameter``, ``toroidal major radius``, ``angle``.

    Returns
    -------
    float or None
        The size [m or rad].
    """
    if not surfaces:
        return None
    kinds = {surface.kind for surface in surfaces}
    if kinds <= set(_CURVES):
        # an edge that is a curve of two faces is sharp
        return 0.0 if "radius" in size_name else None
    if kinds <= set(_WITH_RADIUS) and all(surface.sizes for surface in surfaces):
        return _measure_round_faces(surfaces, size_name)
    if len(surfaces) == 2 and kinds == {PLANE}:
        first, second = surfaces
        return measure_distance([first], [second])
    if len(surfaces) > 1:
        return None
    (surface,) = surfaces
    if surface.kind == TORUS and len(surface.sizes) == 2:
        return _measure_torus(surface, size_name)
    if surface.kind == CONE and "angle" in size_name:
        _, half_angle = surface.sizes
        return 2.0 * half_angle
    return None


def _measure_round_faces(surfaces: Sequence[Surface], size_name: str) -> float | None:
    """Measure diameter or radius [m] of faces that have one radius."""
    radii = [surface.sizes[0] for surface in surfaces]
    largest = max(radii)
    if not largest - min(radii) <= _SAME_LENGTH:
        return None
    return _choose_diameter_or_radius(largest, size_name)


def _choose_diameter_or_radius(radius: float, size_name: str) -> float | None:
    """Return the size that a name states [m]; None where it is neither diameter nor radius."""
    if "diameter" in size_name:
        return 2.0 * radius
    if "radius" in size_name:
        return radius
    return None


def _measure_torus(torus: Surface, size_name: str) -> float | None:
    """Measure the size of a torus that its name states [m].

    It is that of its middle, of its wire, or of its inner or outer edge.
    """
    major, minor = torus.sizes
    if "toroidal high major" in size_name:
        return _choose_diameter_or_radius(major + minor, size_name)
    if "toroidal low major" in size_name:
        return _choose_diameter_or_radius(major - minor, size_name)
    if "toroidal major" in size_name:
        return _choose_diameter_or_radius(major, size_name)
    if "toroidal minor" in size_name:
        return _choose_diameter_or_radius(minor, size_name)
    return None


def measure_distance(
    first: Sequence[Surface], second: Sequence[Surface], distance_kind: str = ""
) -> float | None:
    """Measure the distance between two features: planes, axes of cylinders, centres of spheres.

    Parameters
    ----------
    first, second : sequence of Surface
        All faces of each feature; every pair of them must have the same distance.
    distance_kind : str
        What the file calls the distance; ``linear distance centre outer`` says from and to which
        side of a round feature.

    Returns
    -------
    float or None
        The distance [m].
    """
    first_side, second_side = _read_end_sides(distance_kind)
    distances = []
    for one_face, another_face in itertools.product(first, second):
        distance = _measure_surface_distance(one_face, another_face)
        if distance is None:
            return None
        distance += _measure_beyond_centre(one_face, first_side)
        distance += _measure_beyond_centre(another_face, second_side)
        distances.append(distance)
    if not distances:
        return None
    if not max(distances) - min(distances) <= _SAME_LENGTH:
        return None
    return distances[0]


def _read_end_sides(distance_kind: str) -> tuple[str, str]:
    """Read ``inner``, ``centre`` or ``outer`` for each end of a distance; empty where not said."""
    words = distance_kind.removeprefix(_LOCATED).split()
    if len(words) != 2:
        return "", ""
    first, second = words
    return first, second


def _measure_beyond_centre(surface: Surface, side: str) -> float:
    """Measure how far a side of a round feature lies beyond its centre [m]."""
    if surface.kind not in _WITH_RADIUS or not surface.sizes:
        return 0.0
    (radius, *_) = surface.sizes
    if side == "outer":
        return radius
    if side == "inner":
        return -radius
    return 0.0


@dataclass(frozen=True)
class _Relation:
    """How two surfaces lie to each other.

    A plane comes first, a curve beside a surface second.

    Attributes
    ----------
    first, second : Surface
        The pair, in that order.
    along_axis, beside_axis : float
        From the point of the first to that of the second, along the axis of the first and square
        to it [m].
    centres : float
        Distance of their points [m].
    is_parallel, is_square : bool
        Whether their axes are parallel, or at right angles.
    """

    first: Surface
    second: Surface
    along_axis: float
    beside_axis: float
    centres: float
    is_parallel: bool
    is_square: bool

    @property
    def has_one_axis(self) -> bool:
        """Whether both are turned about one axis."""
        return self.is_parallel and self.beside_axis <= _ONE_AXIS


def _compute_relation(first: Surface, second: Surface) -> _Relation:
    """Find how two surfaces lie to each other."""
    is_curve_first = first.kind in _CURVES and second.kind not in _CURVES
    if second.kind == PLANE or is_curve_first:
        first, second = second, first
    between = second.point - first.point
    along_axis = float(between @ first.axis)
    beside_axis = np.linalg.norm(between - along_axis * first.axis)
    sine = np.linalg.norm(np.cross(first.axis, second.axis))
    cosine = abs(float(first.axis @ second.axis))
    return _Relation(
        first,
        second,
        along_axis=along_axis,
        beside_axis=float(beside_axis),
        centres=float(np.linalg.norm(between)),
        is_parallel=bool(sine <= _PARALLEL),
        is_square=cosine <= _PARALLEL,
    )


def _measure_surface_distance(one_face: Surface, another_face: Surface) -> float | None:
    """Measure the distance between two surfaces, round ones from their centres or axes [m]."""
    relation = _compute_relation(one_face, another_face)
    if relation.first.kind == PLANE:
        return abs(relation.along_axis) if _is_equidistant_from_plane(relation) else None
    if relation.first.kind == SPHERE and relation.second.kind == SPHERE:
        return relation.centres
    if relation.has_one_axis:
        distance = _measure_about_one_axis(relation)
        if distance is not None:
            return distance
    if relation.first.kind in _WITH_AXIS:
        return _measure_from_axis(relation)
    return None


def _measure_about_one_axis(relation: _Relation) -> float | None:
    """Measure between circles, from a cone, or across a gap, where both have one axis [m]."""
    first = relation.first
    second = relation.second
    if first.kind == CIRCLE and second.kind == CIRCLE:
        return math.hypot(relation.along_axis, second.sizes[0] - first.sizes[0])
    if first.kind == CONE and _is_equidistant_from_cone(first, second):
        return _measure_from_cone(relation)
    is_in_bore = first.kind == second.kind and first.representation != second.representation
    if first.kind in _WITH_AXIS and is_in_bore:
        # one body in the bore of another: the gap
        return abs(first.sizes[0] - second.sizes[0])
    return None


def _measure_from_axis(relation: _Relation) -> float | None:
    """Measure from an axis to a parallel one, or to the centre of a sphere [m]."""
    if relation.second.kind == SPHERE:
        return relation.beside_axis
    if relation.second.kind in _WITH_AXIS and relation.is_parallel:
        return relation.beside_axis
    return None


def _is_equidistant_from_plane(relation: _Relation) -> bool:
    """Tell whether a surface, or its axis, is equally far from a plane everywhere."""
    kind = relation.second.kind
    if kind == SPHERE:
        return True
    if kind in (PLANE, CIRCLE):
        return relation.is_parallel
    return kind in (LINE, *_WITH_AXIS) and relation.is_square


def _is_equidistant_from_cone(cone: Surface, surface: Surface) -> bool:
    """Tell whether a surface about the axis of a cone has one distance from it.

    A round edge has, and a cone of the same angle.
    """
    if surface.kind == CIRCLE:
        return True
    if surface.kind != CONE:
        return False
    opens_the_same_way = cone.axis @ surface.axis > 0.0
    _, half_angle = cone.sizes
    _, second_half_angle = surface.sizes
    if not opens_the_same_way:
        second_half_angle = -second_half_angle
    return abs(half_angle - second_half_angle) <= _SAME_ANGLE


def _measure_from_cone(relation: _Relation) -> float:
    """Measure the distance from a cone to a cone or circle about its axis, square to it [m]."""
    radius, half_angle = relation.first.sizes
    second_radius = relation.second.sizes[0]
    wider = second_radius - radius - relation.along_axis * math.tan(half_angle)
    return abs(wider) * math.cos(half_angle)


def measure_angle(
    first: Sequence[Surface], second: Sequence[Surface], nominal: float
) -> float | None:
    """Measure the angle between two planes or axes.

    Parameters
    ----------
    first, second : sequence of Surface
        The only face of each feature.
    nominal : float
        The stated angle [rad]: of the two supplementary angles the one nearer to it is taken.

    Returns
    -------
    float or None
        The angle [rad].
    """
    if len(first) != 1 or len(second) != 1:
        return None
    (one_face,) = first
    (another_face,) = second
    kinds = {one_face.kind, another_face.kind}
    if kinds != {PLANE} and not kinds <= set(_WITH_AXIS):
        return None
    sine = np.linalg.norm(np.cross(one_face.axis, another_face.axis))
    cosine = one_face.axis @ another_face.axis
    angle = float(np.arctan2(sine, cosine))
    supplement = math.pi - angle
    return min((angle, supplement), key=lambda candidate: abs(candidate - nominal))
