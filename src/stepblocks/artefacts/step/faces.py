"""Surfaces under the faces that a dimension names."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from stepblocks.artefacts.step.exchange import (
    Exchange,
    Parameters,
    is_reference,
    read_numeric_parameter,
    yield_references,
)
from stepblocks.artefacts.step.units import Unit, read_unit
from stepblocks.contact import Array

PLANE = "PLANE"
SPHERE = "SPHERICAL_SURFACE"
CYLINDER = "CYLINDRICAL_SURFACE"
CONE = "CONICAL_SURFACE"
TORUS = "TOROIDAL_SURFACE"
LINE = "LINE"
CIRCLE = "CIRCLE"

_MOST_COMPOSITES = 12  # one inside the other
_SAME_PLACE = 1e-12  # of two placements, in the units of the file
_NOWHERE: Array = np.full(3, math.nan)
_UPWARDS: Array = np.array([0.0, 0.0, 1.0])
# Entities that link an aspect with a face, of five parameters: the third is the aspect, the last
# holds the faces
_USAGES = ("GEOMETRIC_ITEM_SPECIFIC_USAGE", "ITEM_IDENTIFIED_REPRESENTATION_USAGE")
# Which parameter of an edge or a face is its curve or surface
_CARRIERS = {"EDGE_CURVE": 3, "ADVANCED_FACE": 2, "FACE_SURFACE": 2}
# A curve that is given with its traces on the two faces
_TRACED_CURVES = ("SURFACE_CURVE", "SEAM_CURVE")


@dataclass(frozen=True)
class Surface:
    """Surface of one face, or curve of one edge, in metres.

    Attributes
    ----------
    ref : str
        The face or edge.
    kind : str
        ``PLANE``, ``CYLINDRICAL_SURFACE`` or another; of an edge ``LINE`` or ``CIRCLE``.
    point : array, shape (3,)
        Location of its placement [m].
    axis : array, shape (3,)
        Direction of its placement.
    sizes : tuple of float
        Radius [m]; radius [m] and half angle [rad] of a cone; major and minor radius [m] of a
        torus.
    representation : str
        What holds it: faces of two bodies lie in two.
    """

    ref: str
    kind: str
    point: Array = field(default_factory=_NOWHERE.copy)
    axis: Array = field(default_factory=_NOWHERE.copy)
    sizes: tuple[float, ...] = ()
    representation: str = ""


def find_surfaces_of_aspect(file: Exchange, aspect: object, depth: int = 0) -> list[Surface]:
    """Find the surfaces of all faces that a shape aspect stands for, through composites.

    Parameters
    ----------
    file : Exchange
        The file.
    aspect : object
        Reference of the shape aspect; anything else has no faces.
    depth : int
        How many composites hold the aspect.

    Returns
    -------
    list of Surface
        Each face once.
    """
    if depth > _MOST_COMPOSITES or not is_reference(aspect):
        return []
    surfaces: dict[str, Surface] = {}
    for user in file.list_referrers(str(aspect)):
        parts = file.get_entities(user)
        for surface in _yield_linked_surfaces(file, parts, aspect):
            surfaces[surface.ref] = surface
        below = _find_aspect_in_composite(file, parts, aspect)
        for surface in find_surfaces_of_aspect(file, below, depth + 1):
            surfaces[surface.ref] = surface
    return list(surfaces.values())


def _yield_linked_surfaces(
    file: Exchange, entities: dict[str, Parameters], aspect: object
) -> Iterator[Surface]:
    """Read the faces that an instance links with an aspect."""
    for entity in _USAGES:
        parameters = entities.get(entity, ())
        if len(parameters) != 5:
            continue
        _, _, linked, representation, items = parameters
        if linked != aspect:
            continue
        units = read_representation_units(file, str(representation))
        for item in yield_references(items):
            surface = _read_surface(file, item, str(representation), units)
            if surface.kind:
                yield surface


def _find_aspect_in_composite(
    file: Exchange, entities: dict[str, Parameters], aspect: object
) -> object:
    """Find the aspect that an instance makes part of a composite one; None for a datum."""
    parameters = entities.get("SHAPE_ASPECT_RELATIONSHIP", ())
    if len(parameters) != 4:
        return None
    _, _, composite, part = parameters
    if composite != aspect or "DATUM" in file.get_entities(part):
        return None
    return part


@dataclass(frozen=True)
class RepresentationUnits:
    """Units of the coordinates and angles of a representation."""

    length: Unit = field(default_factory=Unit)
    angle: Unit = field(default_factory=Unit)


def read_representation_units(file: Exchange, representation: str) -> RepresentationUnits:
    """Read the units of the context of a representation; unknown where it has none."""
    for parameters in file.get_entities(representation).values():
        for parameter in parameters:
            context = file.get_parameters(parameter, "GLOBAL_UNIT_ASSIGNED_CONTEXT")
            if not context:
                continue
            by_dimension = {}
            for ref in context[0]:
                unit = read_unit(file, ref)
                by_dimension[unit.dimension] = unit
            return RepresentationUnits(
                by_dimension.get("length", Unit()),
                by_dimension.get("angle", Unit("rad", "angle", 1.0)),
            )
    return RepresentationUnits()


def _read_surface(
    file: Exchange, face_or_edge: str, representation: str, units: RepresentationUnits
) -> Surface:
    """Read the surface of a face or the curve of an edge; its kind is empty for neither."""
    kind, parameters = _find_carrier_geometry(file, face_or_edge)
    if len(parameters) < 2 or not is_reference(parameters[1]):
        return Surface(face_or_edge, kind, representation=representation)
    if kind == LINE:
        return Surface(
            face_or_edge,
            kind,
            units.length.convert_to_si(_read_coordinates(file, parameters[1])),
            _read_direction_of_line(file, parameters[-1]),
            representation=representation,
        )
    placement = _read_placement(file, parameters[1])
    return Surface(
        face_or_edge,
        kind,
        units.length.convert_to_si(placement.point),
        placement.axis,
        _read_radii_and_cone_angle(kind, parameters[2:], units),
        representation,
    )


def read_edge_curve(file: Exchange, edge: str, units: RepresentationUnits) -> Surface:
    """Read the curve of an edge, in the units of the representation that holds its body."""
    return _read_surface(file, edge, "", units)


def read_vertex_point(file: Exchange, vertex: object, units: RepresentationUnits) -> Array:
    """Read the point of a vertex [m], shape (3,), nan where it has none."""
    parameters = file.get_parameters(vertex, "VERTEX_POINT")
    if len(parameters) != 2:
        return _NOWHERE
    return units.length.convert_to_si(_read_coordinates(file, parameters[1]))


def _find_carrier_geometry(file: Exchange, face_or_edge: str) -> tuple[str, Parameters]:
    """Find kind and parameters of the surface or curve that carries a face or edge."""
    carrier: object = face_or_edge
    for entity, place in _CARRIERS.items():
        parameters = file.get_parameters(face_or_edge, entity)
        if parameters:
            carrier = parameters[place]
            break
    for entity in _TRACED_CURVES:
        traced = file.get_parameters(carrier, entity)
        if len(traced) > 1:
            carrier = traced[1]
    return next(iter(file.get_entities(carrier).items()), ("", ()))


def _read_radii_and_cone_angle(
    kind: str, parameters: Parameters, units: RepresentationUnits
) -> tuple[float, ...]:
    """Read the radii of a surface [m]; of a cone its radius and its half angle [rad].

    A parameter that is no number gives NaN.
    """
    numbers = []
    for parameter in parameters:
        number = read_numeric_parameter(parameter)
        numbers.append(math.nan if number is None else number)
    sizes = [units.length.convert_to_si(number) for number in numbers]
    if kind == CONE and len(numbers) == 2:
        sizes[1] = units.angle.convert_to_si(numbers[1])
    return tuple(sizes)


def _read_coordinates(file: Exchange, ref: object) -> Array:
    """Read a point in the units of the file, shape (3,), nan where it is none."""
    parameters = file.get_parameters(ref, "CARTESIAN_POINT")
    if len(parameters) != 2:
        return _NOWHERE
    return np.array(parameters[1], dtype=np.float64)


def _read_direction(file: Exchange, ref: object, default: Array = _NOWHERE) -> Array:
    """Read a direction of length one, shape (3,)."""
    parameters = file.get_parameters(ref, "DIRECTION")
    direction = default
    if len(parameters) == 2:
        direction = np.array(parameters[1], dtype=np.float64)
    return np.asarray(direction / np.linalg.norm(direction))


def _read_direction_of_line(file: Exchange, ref: object) -> Array:
    """Read the direction of the vector of a line, of length one, shape (3,)."""
    vector = file.get_parameters(ref, "VECTOR")
    return _read_direction(file, vector[1] if len(vector) > 1 else None)


@dataclass(frozen=True)
class _Placement:
    """Where a surface lies: location in the units of the file, and two directions."""

    point: Array
    axis: Array
    second_axis: Array


def _read_placement(file: Exchange, ref: object) -> _Placement:
    """Read a placement; NaN where there is none."""
    parameters = file.get_parameters(ref, "AXIS2_PLACEMENT_3D")
    if len(parameters) != 4:
        return _Placement(_NOWHERE, _NOWHERE, _NOWHERE)
    _, point, axis, second_axis = parameters
    return _Placement(
        _read_coordinates(file, point),
        _read_direction(file, axis, _UPWARDS),
        _read_direction(file, second_axis, _UPWARDS),
    )


def is_placed_where_drawn(file: Exchange) -> bool:
    """Tell whether every component of an assembly lies where its coordinates put it.

    Only then can two bodies be compared.
    """
    for _, parameters in file.yield_instances("ITEM_DEFINED_TRANSFORMATION"):
        first, second = (_read_placement(file, item) for item in parameters[2:4])
        if not _are_same_placement(first, second):
            return False
    return True


def _are_same_placement(first: _Placement, second: _Placement) -> bool:
    """Tell whether two placements agree in point and both axes."""
    pairs = (
        (first.point, second.point),
        (first.axis, second.axis),
        (first.second_axis, second.second_axis),
    )
    return all(np.allclose(a, b, rtol=0.0, atol=_SAME_PLACE) for a, b in pairs)
