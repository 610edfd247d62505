"""Units and measures of a Part 21 file, resolved to SI, with what is wrong about them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stepblocks.artefacts.step.exchange import Exchange, Typed, is_reference, number

_PREFIXES = "EXA PETA TERA GIGA MEGA KILO HECTO DECA DECI CENTI MILLI MICRO NANO PICO"
_POWERS = (18, 15, 12, 9, 6, 3, 2, 1, -1, -2, -3, -6, -9, -12)
_PREFIX = {name: float(f"1e{power}") for name, power in zip(_PREFIXES.split(), _POWERS, strict=True)}
_SHORT = {"MILLI": "m", "MICRO": "u", "NANO": "n", "CENTI": "c", "KILO": "k", "DECI": "d"}
_BASES = {  # symbol and dimension
    **{"METRE": ("m", "length"), "RADIAN": ("rad", "angle"), "GRAM": ("g", "mass")},
    **{"STERADIAN": ("sr", "solid angle"), "SECOND": ("s", "time")},
}
# entities that hold a measure, and which of their parameters is the value; its unit follows
_MEASURES = {
    **{f"{of}MEASURE_WITH_UNIT": 0 for of in ("", "LENGTH_", "PLANE_ANGLE_", "MASS_", "RATIO_", "UNCERTAINTY_")},
    "MEASURE_REPRESENTATION_ITEM": 1,
}
_TYPES = {
    "length": ("LENGTH_MEASURE", "POSITIVE_LENGTH_MEASURE", "NON_NEGATIVE_LENGTH_MEASURE"),
    "angle": ("PLANE_ANGLE_MEASURE", "POSITIVE_PLANE_ANGLE_MEASURE"),
    "mass": ("MASS_MEASURE",),
}


@dataclass(frozen=True)
class Unit:
    """A unit."""

    name: str  # as a person writes it
    dimension: str  # ``length``, ``angle``, ``mass``, ... or ``unknown``
    factor: float  # SI units per unit


@dataclass(frozen=True)
class Measure:
    """A value with its unit."""

    value: float  # as it stands in the file
    unit: Unit

    @property
    def si(self) -> float:
        """The value in SI; millimetres are divided by 1000, which gives the nearest double."""
        inverse = round(1.0 / self.unit.factor) if 0.0 < self.unit.factor < 1.0 else 0
        if inverse and abs(self.unit.factor * inverse - 1.0) < 1e-12:
            return self.value / inverse
        return self.value * self.unit.factor


_UNKNOWN = Unit("?", "unknown", math.nan)


def unit_of(file: Exchange, ref: object) -> Unit:
    """Resolve a unit, SI or converted."""
    parts = file.parts(ref)
    if values := parts.get("SI_UNIT"):
        prefix, base = (str(value).strip(".$*") for value in values[-2:])
        factor = _PREFIX.get(prefix, 1.0)
        symbol, dimension = _BASES.get(base, (base.lower(), "unknown"))
        factor *= 1e-3 if base == "GRAM" else 1.0  # the SI unit of mass is the kilogram
        return Unit(_SHORT.get(prefix, prefix.lower()) + symbol, dimension, factor)
    converted = parts.get("CONVERSION_BASED_UNIT")
    if converted and (one := measure_of(file, converted[-1])) is not None:
        return Unit(str(converted[-2]).strip("'").lower(), one.unit.dimension, one.value * one.unit.factor)
    return _UNKNOWN


def measure_of(file: Exchange, ref: object) -> Measure | None:
    """Read a measure with unit, whether simple, complex or a representation item."""
    for name, at in _MEASURES.items():
        values = file.parameters(ref, name)[at:]
        if len(values) >= 2:
            value = number(values[0])
            return None if value is None else Measure(value, unit_of(file, values[1]))
    return None


def untyped_measures(file: Exchange) -> list[str]:
    """List every measure whose value is no typed SELECT, or whose type does not fit its unit."""
    findings = []
    for name, at in _MEASURES.items():
        for ref, values in file.named(name):
            if len(values) < at + 2:
                continue
            raw, unit = values[at : at + 2]
            if not isinstance(raw, Typed):
                findings.append(f"{ref} {name}: value must be typed, such as LENGTH_MEASURE(...), got {raw!r}")
                continue
            size, dimension = number(raw), unit_of(file, unit).dimension
            if raw.type.startswith("POSITIVE_") and size is not None and not size > 0.0:
                findings.append(f"{ref} {name}: {raw.type} must be positive, got {size:g}")
            if raw.type not in _TYPES.get(dimension, (raw.type,)):
                findings.append(f"{ref} {name}: {raw.type} must not carry a unit of {dimension}")
    return findings


def density_findings(file: Exchange) -> tuple[list[tuple[str, float]], list[str]]:
    """Find densities, in kg/m^3, and those whose unit is no density."""
    densities, findings = [], []
    for ref, values in file.named("MEASURE_REPRESENTATION_ITEM"):
        label = str(values[0]).lower() if len(values) == 3 else str(file.parameters(ref, "REPRESENTATION_ITEM")).lower()
        if "density" not in label:
            continue
        raw, unit = (values[1], values[2]) if len(values) == 3 else file.parameters(ref, "MEASURE_WITH_UNIT")[:2]
        value = number(raw)
        factor, powers = _derived(file, unit)
        if powers != {"mass": 1.0, "length": -3.0}:
            said = " ".join(f"{name}^{power:g}" for name, power in sorted(powers.items())) or "nothing"
            findings.append(f"{ref} density: unit must be mass^1 length^-3, got {said}")
        elif value is None or not 10.0 <= value * factor <= 25_000.0:
            got = "no number" if value is None else f"{value * factor:g}"
            findings.append(f"{ref} density: must lie between 10 and 25000 kg/m^3, got {got}")
        else:
            densities.append((ref, value * factor))
    return densities, findings


def _derived(file: Exchange, ref: object) -> tuple[float, dict[str, float]]:
    factor = 1.0
    powers: dict[str, float] = {}
    for element in (file.parameters(ref, "DERIVED_UNIT") or ((),))[0]:
        values = file.parameters(element, "DERIVED_UNIT_ELEMENT")
        if len(values) != 2 or not is_reference(values[0]):
            continue
        unit, power = unit_of(file, values[0]), number(values[1]) or 0.0
        powers[unit.dimension] = powers.get(unit.dimension, 0.0) + power
        factor *= unit.factor**power
    return factor, powers
