"""Dimensions of a STEP file: sizes, distances and angles, with limits and what faces measure."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from stepblocks.artefacts.step.characteristic import (
    Characteristic,
    Problem,
    read_optional_text,
)
from stepblocks.artefacts.step.distances import measure_angle, measure_distance, measure_size
from stepblocks.artefacts.step.exchange import Exchange, Parameters
from stepblocks.artefacts.step.faces import (
    PLANE,
    Surface,
    find_surfaces_of_aspect,
    is_placed_where_drawn,
)
from stepblocks.artefacts.step.units import Measure, read_measure

_SIZES = (
    "DIMENSIONAL_SIZE",
    "DIMENSIONAL_SIZE_WITH_PATH",
    "DIMENSIONAL_SIZE_WITH_DATUM_FEATURE",
    "ANGULAR_SIZE",
)
_LOCATIONS = (
    "DIMENSIONAL_LOCATION",
    "DIRECTED_DIMENSIONAL_LOCATION",
    "DIMENSIONAL_LOCATION_WITH_PATH",
    "ANGULAR_LOCATION",
)


def list_dimensions(file: Exchange) -> list[Characteristic]:
    """List the dimensions of a file, in the order of their instances."""
    dimensions = []
    for ref, parameters in file.yield_instances(*_SIZES):
        dimensions.append(_read_dimension(file, _read_size(file, ref, parameters)))
    for ref, parameters in file.yield_instances(*_LOCATIONS):
        if len(parameters) >= 4:
            dimensions.append(_read_dimension(file, _read_location(file, ref, parameters)))
    return sorted(dimensions, key=lambda dimension: dimension.number)


@dataclass(frozen=True)
class _Statement:
    """A dimension without its value: what it is called, and what it names.

    A size has one side, a location two.
    """

    ref: str
    kind: str
    name: str
    sides: tuple[list[Surface], ...]

    @property
    def surfaces(self) -> list[Surface]:
        """The surfaces of all sides."""
        return [surface for side in self.sides for surface in side]

    @property
    def representations(self) -> set[str]:
        """References of the representations that hold the surfaces: one for each body."""
        return {surface.representation for surface in self.surfaces}

    @property
    def names_planes(self) -> bool:
        """Whether it is the distance or angle of planes of one body."""
        if len(self.sides) != 2 or not all(self.sides) or len(self.representations) != 1:
            return False
        return all(surface.kind == PLANE for surface in self.surfaces)


def _read_size(file: Exchange, ref: str, parameters: Parameters) -> _Statement:
    """Read the faces and the kind of a DIMENSIONAL_SIZE."""
    sides = (find_surfaces_of_aspect(file, parameters[0]),)
    if file.get_parameters(ref, "ANGULAR_SIZE"):
        return _Statement(ref, "angular size", read_optional_text(parameters[1]), sides)
    kind = str(parameters[1]) if len(parameters) > 1 else "size"
    return _Statement(ref, kind, "", sides)


def _read_location(file: Exchange, ref: str, parameters: Parameters) -> _Statement:
    """Read both sides, kind and description of a DIMENSIONAL_LOCATION."""
    name, description, first, second = parameters[:4]
    kind = read_optional_text(name)
    if not kind:
        is_angle = file.get_parameters(ref, "ANGULAR_LOCATION")
        kind = "angular location" if is_angle else "location"
    sides = (find_surfaces_of_aspect(file, first), find_surfaces_of_aspect(file, second))
    return _Statement(ref, kind, read_optional_text(description), sides)


def _read_dimension(file: Exchange, stated: _Statement) -> Characteristic:
    """Read value and limits of a dimension, and measure it by the faces that it names."""
    limits = _read_limits(file, stated.ref)
    value = math.nan
    unit = "?"
    angular = False
    if limits.nominal is not None:
        value = limits.nominal.si
        unit = limits.nominal.unit.name
        angular = limits.nominal.unit.dimension == "angle"
    geometry = _measure_named_faces(file, stated, value, angular)
    problem = limits.problem
    is_sound_length = problem is Problem.NONE and not angular
    if geometry is None and is_sound_length and stated.names_planes:
        problem = Problem.PLANES_NOT_PARALLEL
    return Characteristic(
        ref=stated.ref,
        kind=stated.kind,
        name=stated.name,
        value=value,
        lower=limits.lower,
        upper=limits.upper,
        unit=unit,
        faces=tuple(surface.ref for surface in stated.surfaces),
        geometry=geometry,
        angular=angular,
        problem=problem,
    )


def _measure_named_faces(
    file: Exchange, stated: _Statement, value: float, angular: bool
) -> float | None:
    """Measure a dimension by the faces that it names [m or rad].

    The result is None where they do not determine it: bodies can only be compared where an assembly
    leaves them.
    """
    if len(stated.representations) > 1 and not is_placed_where_drawn(file):
        return None
    if len(stated.sides) == 1:
        (side,) = stated.sides
        return measure_size(side, "angle" if angular else stated.kind)
    first, second = stated.sides
    if angular:
        return measure_angle(first, second, value)
    return measure_distance(first, second, stated.kind)


@dataclass(frozen=True)
class _Limits:
    """Nominal value and signed deviations [m or rad], nan where there are none."""

    nominal: Measure | None
    lower: float = math.nan
    upper: float = math.nan
    problem: Problem = Problem.NONE


def _read_limits(file: Exchange, ref: str) -> _Limits:
    """Read the nominal value and the limits, which stand as values or as deviations."""
    limits = _read_labelled_values(file, ref)
    if limits.nominal is None:
        return _Limits(None, problem=Problem.NO_VALUE)
    if math.isnan(limits.lower) and math.isnan(limits.upper):
        limits = _read_deviations(file, ref, limits.nominal)
    if limits.lower >= limits.upper:
        return _Limits(limits.nominal, limits.lower, limits.upper, Problem.LIMITS_NOT_IN_ORDER)
    return limits


def _read_labelled_values(file: Exchange, ref: str) -> _Limits:
    """Read the values of a dimension: the first is the nominal, limits are labelled."""
    nominal = upper = lower = None
    for representation in _yield_linked_instances(
        file, ref, "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", 0
    ):
        parameters = file.get_parameters(representation, "SHAPE_DIMENSION_REPRESENTATION")
        if len(parameters) < 2:
            continue
        for item in parameters[1]:
            measure = read_measure(file, item)
            if measure is None:
                continue
            label = _read_item_label(file, item)
            if "upper" in label:
                upper = measure
            elif "lower" in label:
                lower = measure
            elif nominal is None:
                nominal = measure
    if nominal is None:
        return _Limits(None)
    lower_deviation = upper_deviation = math.nan
    if lower is not None:
        lower_deviation = lower.si - nominal.si
    if upper is not None:
        upper_deviation = upper.si - nominal.si
    return _Limits(nominal, lower_deviation, upper_deviation)


def _read_item_label(file: Exchange, item: object) -> str:
    """Read the name of a representation item in lower case; empty where it has none."""
    parameters = file.get_parameters(item, "REPRESENTATION_ITEM")
    if not parameters:
        return ""
    return str(parameters[0]).lower()


def _read_deviations(file: Exchange, ref: str, nominal: Measure) -> _Limits:
    """Read the lower and the upper deviation of a PLUS_MINUS_TOLERANCE."""
    for tolerance in _yield_linked_instances(file, ref, "PLUS_MINUS_TOLERANCE", 1):
        bounds = file.get_parameters(tolerance, "TOLERANCE_VALUE")
        if not bounds:
            continue
        measures = [read_measure(file, bound) for bound in bounds]
        deviations = [measure for measure in measures if measure is not None]
        if len(deviations) != 2:
            return _Limits(nominal, problem=Problem.LIMITS_WITHOUT_VALUE)
        lower, upper = deviations
        if {lower.unit.dimension, upper.unit.dimension} != {nominal.unit.dimension}:
            return _Limits(nominal, problem=Problem.LIMITS_OF_OTHER_UNIT)
        return _Limits(nominal, lower.si, upper.si)
    return _Limits(nominal)


def _yield_linked_instances(
    file: Exchange, ref: str, entity: str, parameter_index: int
) -> Iterator[object]:
    """Yield what entities of two parameters link with an instance.

    Parameters
    ----------
    file : Exchange
        The file.
    ref : str
        The instance.
    entity : str
        The linking entity.
    parameter_index : {0, 1}
        Which of its parameters is the instance; the other one is yielded.
    """
    for user in file.list_referrers(ref):
        pair = file.get_parameters(user, entity)
        if len(pair) == 2 and pair[parameter_index] == ref:
            yield pair[1 - parameter_index]
