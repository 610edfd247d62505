"""Units and measures of a Part 21 file, resolved to SI, with what is wrong about them."""

import math
from dataclasses import dataclass

from stepblocks.artefacts.step.exchange import Exchange, Typed, read_number
from stepblocks.quantities import Number, multiply_by_unit

_PREFIXES = {  # symbol and factor
    "": ("", 1.0),
    "MEGA": ("M", 1e6),
    "KILO": ("k", 1e3),
    "DECI": ("d", 1e-1),
    "CENTI": ("c", 1e-2),
    "MILLI": ("m", 1e-3),
    "MICRO": ("u", 1e-6),
    "NANO": ("n", 1e-9),
    "PICO": ("p", 1e-12),
}
_BASES = {  # symbol, dimension, and SI units in one: the SI unit of mass is the kilogram
    "METRE": ("m", "length", 1.0),
    "RADIAN": ("rad", "angle", 1.0),
    "GRAM": ("g", "mass", 1e-3),
    "STERADIAN": ("sr", "solid angle", 1.0),
    "SECOND": ("s", "time", 1.0),
}
# entities that hold a measure, and which of their parameters is the value; its unit follows
_MEASURES = {
    **{
        f"{of}MEASURE_WITH_UNIT": 0
        for of in ("", "LENGTH_", "PLANE_ANGLE_", "MASS_", "RATIO_", "UNCERTAINTY_")
    },
    "MEASURE_REPRESENTATION_ITEM": 1,
}
_TYPES = {
    "length": ("LENGTH_MEASURE", "POSITIVE_LENGTH_MEASURE", "NON_NEGATIVE_LENGTH_MEASURE"),
    "angle": ("PLANE_ANGLE_MEASURE", "POSITIVE_PLANE_ANGLE_MEASURE"),
    "mass": ("MASS_MEASURE",),
}
_DENSITY = {"mass": 1.0, "length": -3.0}


@dataclass(frozen=True)
class Unit:
    """A unit."""

    name: str = "?"  # as a person writes it
    dimension: str = "unknown"  # ``length``, ``angle``, ``mass``, ...
    factor: float = math.nan  # SI units per unit

    def si(self, value: Number) -> Number:
        """Convert a value or an array; millimetres are divided by 1000 (nearest double)."""
        return multiply_by_unit(value, self.factor)


@dataclass(frozen=True)
class Measure:
    """A value in SI, and the unit that it has in the file."""

    si: float
    unit: Unit


def read_unit(file: Exchange, ref: object) -> Unit:
    """Resolve a unit, SI or converted."""
    parts = file.parts(ref)
    if values := parts.get("SI_UNIT"):
        prefix, base = (str(value).strip(".$*") for value in values[-2:])
        short, power = _PREFIXES.get(prefix, (prefix.lower(), math.nan))
        symbol, dimension, factor = _BASES.get(base, (base.lower(), "unknown", 1.0))
        return Unit(short + symbol, dimension, power * factor)
    converted = parts.get("CONVERSION_BASED_UNIT")
    if converted and (one := read_measure(file, converted[-1])) is not None:
        return Unit(str(converted[-2]).lower(), one.unit.dimension, one.si)
    return Unit()


def read_measure(file: Exchange, ref: object) -> Measure | None:
    """Read a measure with unit, whether simple, complex or a representation item."""
    for name, at in _MEASURES.items():
        values = file.parameters(ref, name)[at:]
        if len(values) >= 2:
            value = read_number(values[0])
            unit = read_unit(file, values[1])
            return None if value is None else Measure(unit.si(value), unit)
    return None


def find_untyped_measures(file: Exchange) -> list[str]:
    """List every measure whose value is no typed SELECT, or whose type does not fit its unit."""
    findings = []
    for name, at in _MEASURES.items():
        for ref, values in file.named(name):
            if len(values) < at + 2:
                continue
            raw, unit = values[at : at + 2]
            if not isinstance(raw, Typed):
                findings.append(
                    f"{ref} {name}: value must be typed, such as LENGTH_MEASURE(...), got {raw!r}"
                )
                continue
            size = read_number(raw)
            dimension = read_unit(file, unit).dimension
            if raw.type.startswith("POSITIVE_") and size is not None and not size > 0.0:
                findings.append(f"{ref} {name}: {raw.type} must be positive, got {size:g}")
            if raw.type not in _TYPES.get(dimension, (raw.type,)):
                findings.append(f"{ref} {name}: {raw.type} must not carry a unit of {dimension}")
    return findings


def read_densities(file: Exchange) -> tuple[list[float], list[str]]:
    """Find densities, in kg/m^3, and those whose unit is no density."""
    densities, findings = [], []
    for ref, values in file.named("MEASURE_REPRESENTATION_ITEM"):
        stated = values or (
            *file.parameters(ref, "REPRESENTATION_ITEM"),
            *file.parameters(ref, "MEASURE_WITH_UNIT"),
        )
        if len(stated) != 3 or "density" not in str(stated[0]).lower():
            continue
        value = read_number(stated[1])
        factor, powers = _read_derived_unit(file, stated[2])
        if powers != _DENSITY:
            shown = (
                " ".join(f"{name}^{power:g}" for name, power in sorted(powers.items())) or "nothing"
            )
            findings.append(f"{ref} density: unit must be mass^1 length^-3, got {shown}")
        elif value is None or not 10.0 <= value * factor <= 25_000.0:
            got = "no number" if value is None else f"{value * factor:g}"
            findings.append(f"{ref} density: must lie between 10 and 25000 kg/m^3, got {got}")
        else:
            densities.append(value * factor)
    return densities, findings


def _read_derived_unit(file: Exchange, ref: object) -> tuple[float, dict[str, float]]:
    factor = 1.0
    powers: dict[str, float] = {}
    for element in (file.parameters(ref, "DERIVED_UNIT") or ((),))[0]:
        values = file.parameters(element, "DERIVED_UNIT_ELEMENT")
        if len(values) == 2:
            unit = read_unit(file, values[0])
            power = read_number(values[1]) or 0.0
            powers[unit.dimension] = powers.get(unit.dimension, 0.0) + power
            factor *= unit.factor**power
    return factor, powers
