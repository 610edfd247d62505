"""Units and measures of a Part 21 file, resolved to SI, with what is wrong about them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from stepblocks.artefacts.step.exchange import Exchange, Parameters, Typed, read_numeric_parameter
from stepblocks.quantities import Number, multiply_by_unit

_UNKNOWN = "unknown"


@dataclass(frozen=True)
class _Prefix:
    symbol: str
    factor: float


@dataclass(frozen=True)
class _Base:
    symbol: str
    dimension: str
    factor: float  # SI units in one: the SI unit of mass is the kilogram


_PREFIXES = {
    "": _Prefix("", 1.0),
    "MEGA": _Prefix("M", 1e6),
    "KILO": _Prefix("k", 1e3),
    "DECI": _Prefix("d", 1e-1),
    "CENTI": _Prefix("c", 1e-2),
    "MILLI": _Prefix("m", 1e-3),
    "MICRO": _Prefix("u", 1e-6),
    "NANO": _Prefix("n", 1e-9),
    "PICO": _Prefix("p", 1e-12),
}
_BASES = {
    "METRE": _Base("m", "length", 1.0),
    "RADIAN": _Base("rad", "angle", 1.0),
    "GRAM": _Base("g", "mass", 1e-3),
    "STERADIAN": _Base("sr", "solid angle", 1.0),
    "SECOND": _Base("s", "time", 1.0),
}
# Entities that hold a measure, and which of their parameters is the value; its unit follows
_MEASURES = {
    "MEASURE_WITH_UNIT": 0,
    "LENGTH_MEASURE_WITH_UNIT": 0,
    "PLANE_ANGLE_MEASURE_WITH_UNIT": 0,
    "MASS_MEASURE_WITH_UNIT": 0,
    "RATIO_MEASURE_WITH_UNIT": 0,
    "UNCERTAINTY_MEASURE_WITH_UNIT": 0,
    "MEASURE_REPRESENTATION_ITEM": 1,
}
# Types of a value that may carry a unit of each dimension
_TYPES = {
    "length": ("LENGTH_MEASURE", "POSITIVE_LENGTH_MEASURE", "NON_NEGATIVE_LENGTH_MEASURE"),
    "angle": ("PLANE_ANGLE_MEASURE", "POSITIVE_PLANE_ANGLE_MEASURE"),
    "mass": ("MASS_MEASURE",),
}
_DENSITY_POWERS = {"mass": 1.0, "length": -3.0}
# Densities of solids [kg/m^3]: foams are lighter, no element is heavier
_LEAST_DENSITY = 10.0
_LARGEST_DENSITY = 25_000.0


@dataclass(frozen=True)
class Unit:
    """A unit.

    Attributes
    ----------
    name : str
        As a person writes it.
    dimension : str
        ``length``, ``angle``, ``mass``, ...
    factor : float
        SI units per unit.
    """

    name: str = "?"
    dimension: str = _UNKNOWN
    factor: float = math.nan

    def convert_to_si(self, value: Number) -> Number:
        """Convert a value or an array; millimetres are divided by 1000 (nearest double)."""
        return multiply_by_unit(value, self.factor)


@dataclass(frozen=True)
class Measure:
    """A value in SI, and the unit that it has in the file."""

    si: float
    unit: Unit


def read_unit(file: Exchange, ref: object) -> Unit:
    """Resolve a unit, SI or converted."""
    parts = file.get_entities(ref)
    stated = parts.get("SI_UNIT")
    if stated:
        return _read_si_unit(stated)
    converted = parts.get("CONVERSION_BASED_UNIT")
    if not converted:
        return Unit()
    *_, name, conversion = converted
    measure = read_measure(file, conversion)
    if measure is None:
        return Unit()
    return Unit(str(name).lower(), measure.unit.dimension, measure.si)


def _read_si_unit(parameters: Parameters) -> Unit:
    """Read prefix and name of an SI unit; an unknown prefix has the factor NaN."""
    prefix_name, base_name = (str(value).strip(".$*") for value in parameters[-2:])
    prefix = _PREFIXES.get(prefix_name, _Prefix(prefix_name.lower(), math.nan))
    base = _BASES.get(base_name, _Base(base_name.lower(), _UNKNOWN, 1.0))
    return Unit(prefix.symbol + base.symbol, base.dimension, prefix.factor * base.factor)


def read_measure(file: Exchange, ref: object) -> Measure | None:
    """Read a measure with unit, whether simple, complex or a representation item."""
    for entity, place in _MEASURES.items():
        parameters = file.get_parameters(ref, entity)[place:]
        if len(parameters) < 2:
            continue
        stated_value, stated_unit, *_ = parameters
        value = read_numeric_parameter(stated_value)
        if value is None:
            return None
        unit = read_unit(file, stated_unit)
        return Measure(unit.convert_to_si(value), unit)
    return None


def list_mistyped_measures(file: Exchange) -> list[str]:
    """List every measure whose value is untyped, or whose type does not fit its unit."""
    findings: list[str] = []
    for entity, place in _MEASURES.items():
        for ref, parameters in file.yield_instances(entity):
            if len(parameters) < place + 2:
                continue
            value, unit = parameters[place : place + 2]
            dimension = read_unit(file, unit).dimension
            for finding in _yield_typed_value_faults(value, dimension):
                findings.append(f"{ref} {entity}: {finding}")
    return findings


def _yield_typed_value_faults(value: object, dimension: str) -> Iterator[str]:
    """Yield what is wrong with a value that has a unit of a dimension."""
    if not isinstance(value, Typed):
        yield f"value must be typed, such as LENGTH_MEASURE(...), got {value!r}"
        return
    number = read_numeric_parameter(value)
    if value.type.startswith("POSITIVE_") and number is not None and not number > 0.0:
        yield f"{value.type} must be positive, got {number:g}"
    if dimension in _TYPES and value.type not in _TYPES[dimension]:
        yield f"{value.type} must not carry a unit of {dimension}"


def read_densities_and_faults(file: Exchange) -> tuple[list[float], list[str]]:
    """Find the densities of a file.

    Returns
    -------
    densities : list of float
        Those that a solid can have [kg/m^3].
    findings : list of str
        What is wrong with the others.
    """
    densities: list[float] = []
    findings: list[str] = []
    for ref, parameters in file.yield_instances("MEASURE_REPRESENTATION_ITEM"):
        stated = parameters or (
            *file.get_parameters(ref, "REPRESENTATION_ITEM"),
            *file.get_parameters(ref, "MEASURE_WITH_UNIT"),
        )
        if len(stated) != 3:
            continue
        name, stated_value, stated_unit = stated
        if "density" not in str(name).lower():
            continue
        unit = _read_derived_unit(file, stated_unit)
        value = read_numeric_parameter(stated_value)
        density = math.nan if value is None else value * unit.factor
        if unit.powers != _DENSITY_POWERS:
            findings.append(
                f"{ref} density: unit must be mass^1 length^-3, got {unit.describe_powers()}"
            )
        elif _LEAST_DENSITY <= density <= _LARGEST_DENSITY:
            densities.append(density)
        else:
            found = "no number" if value is None else f"{density:g}"
            findings.append(
                f"{ref} density: must lie between {_LEAST_DENSITY:g} and {_LARGEST_DENSITY:g} "
                f"kg/m^3, got {found}"
            )
    return densities, findings


@dataclass(frozen=True)
class _DerivedUnit:
    """A product of powers of units: SI units per unit, and the power of each dimension."""

    factor: float
    powers: dict[str, float]

    def describe_powers(self) -> str:
        """Write the dimensions with their powers, such as ``length^-3 mass^1``."""
        texts = [f"{dimension}^{power:g}" for dimension, power in sorted(self.powers.items())]
        return " ".join(texts) or "nothing"


def _read_derived_unit(file: Exchange, ref: object) -> _DerivedUnit:
    """Read a derived unit; without elements it is 1 and has no powers."""
    factor = 1.0
    powers: dict[str, float] = {}
    elements = file.get_parameters(ref, "DERIVED_UNIT")
    if not elements:
        return _DerivedUnit(factor, powers)
    for element in elements[0]:
        parameters = file.get_parameters(element, "DERIVED_UNIT_ELEMENT")
        if len(parameters) != 2:
            continue
        stated_unit, stated_power = parameters
        unit = read_unit(file, stated_unit)
        power = read_numeric_parameter(stated_power) or 0.0
        powers[unit.dimension] = powers.get(unit.dimension, 0.0) + power
        factor *= unit.factor**power
    return _DerivedUnit(factor, powers)
