"""Sheaths for the shank of a probe: tubes of different materials, one made as heavy as another."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from stepblocks.errors import ContactError, QuantityError
from stepblocks.parts.body import Identity, Part, require
from stepblocks.parts.material import Material
from stepblocks.parts.sourced import SourcedDensity, SourcedModulus, SourcedRatio
from stepblocks.parts.tolerance import Length, PositiveLength
from stepblocks.quantities import parse_quantity

if TYPE_CHECKING:
    from stepblocks.contact.counterface import Counterface

# Largest relative difference in mass of two sheaths that are to weigh the same (the paper's sheaths: equal weight)
MASS_MATCH = 0.01
_SOLVABLE = ("bore", "outer_diameter", "length")
_STEP = 10e-6  # A solved dimension is rounded to this, so that a drawing can state it [m]


@dataclass(frozen=True)
class SheathMaterial(Material):
    """A material that bends and damps."""

    modulus: float  # Young's modulus [Pa], Poisson's ratio [1] and loss factor at the ring's frequency [1]
    poisson: float
    loss_factor: float
    modulus_source: str  # Where they come from
    poisson_source: str
    loss_source: str


class _MaterialTable(Part):
    name: Identity
    designation: Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[ -&(-~]+$")]
    density: SourcedDensity
    modulus: SourcedModulus
    poisson: SourcedRatio
    loss_factor: SourcedRatio


def _material(raw: object) -> SheathMaterial:
    if isinstance(raw, SheathMaterial):
        return raw
    if not isinstance(raw, dict):
        raise ValueError(
            f"must be a table with name, designation, density, modulus, poisson and loss_factor, got {raw!r:.60}"
        )
    try:
        table = _MaterialTable.model_validate(raw)
    except ValidationError as error:
        raise ValueError(_first(error)) from error
    if table.poisson.value > 0.5:
        raise ValueError(f"poisson must not exceed 0.5, got {table.poisson.value:g}")
    return SheathMaterial(
        table.name,
        table.designation,
        table.density.value,
        table.density.source,
        table.modulus.value,
        table.poisson.value,
        table.loss_factor.value,
        table.modulus.source,
        table.poisson.source,
        table.loss_factor.source,
    )


class Sheath(Part):
    """A tube over the shank; its end near the clamp lies at z = 0, its axis is z."""

    id: Identity  # Identity
    bore: PositiveLength  # Inner diameter [m]
    outer_diameter: PositiveLength  # Outer diameter [m]
    length: PositiveLength  # From end to end [m]
    edge_break: Length  # Leg of the 45 degree chamfer on the two outer edges [m]
    position: Length  # From the clamp to the near end, on the shank [m]
    material: Annotated[SheathMaterial, BeforeValidator(_material)]  # What it is made of

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Answer a sharp step under the probe that wears it."""
        from stepblocks.contact.counterface import Step

        if step_height is None:
            raise ContactError(f"the height of the step under the probe must be given, got none [{self.id}]")
        return Step(step_height)

    @property
    def wall(self) -> float:
        """Thickness of the wall [m]."""
        return 0.5 * (self.outer_diameter.nominal - self.bore.nominal)

    @property
    def mass(self) -> float:
        """Nominal mass [kg]."""
        return self.material.density * _volume(
            self.bore.nominal, self.outer_diameter.nominal, self.length.nominal, self.edge_break.nominal
        )

    @property
    def mass_limits(self) -> tuple[float, float]:
        """Least and greatest mass within the tolerances [kg]."""
        (thin, wide), (small, large) = self.bore.limits, self.outer_diameter.limits
        (short, long), (sharp, blunt) = self.length.limits, self.edge_break.limits
        density = self.material.density
        return density * _volume(wide, small, short, blunt), density * _volume(thin, large, long, max(sharp, 0.0))

    @model_validator(mode="after")
    def _is_possible(self) -> Sheath:
        bore, outer, broken = self.bore.nominal, self.outer_diameter.nominal, self.edge_break.nominal
        require(outer > bore, "outer_diameter", "exceed bore", bore, outer)
        room = min(self.wall, 0.5 * self.length.nominal)
        require(broken < room, "edge_break", "be smaller than the wall and half the length", room, broken)
        return self


def _volume(bore: float, outer: float, length: float, broken: float) -> float:
    """Tube less two rings of triangular section, by Pappus."""
    tube = 0.25 * math.pi * (outer**2 - bore**2) * length
    return tube - 2.0 * math.pi * broken**2 * (0.5 * outer - broken / 3.0)


def balanced(raw: object) -> object:
    """Solve the sheaths that are to weigh as much as another one."""
    if not isinstance(raw, list | tuple) or not all(isinstance(one, dict) for one in raw):
        return raw
    solved = []
    for stanza in raw:
        wanted = [name for name, value in stanza.items() if isinstance(value, dict) and "mass_of" in value]
        if not wanted:
            solved.append(stanza)
            continue
        place = f"sheath {stanza.get('id')!r}"
        if len(wanted) > 1 or wanted[0] not in _SOLVABLE:
            raise ValueError(
                f"mass_of must stand at one of {', '.join(_SOLVABLE)}, got it at {', '.join(wanted)} [{place}]"
            )
        solved.append(_solved(stanza, wanted[0], _target(stanza[wanted[0]]["mass_of"], raw, place), place))
    return solved


def _validated(stanza: Mapping[str, Any], place: str) -> Sheath:
    """Validate a stanza on its own, with one line and its place where it is wrong."""
    try:
        return Sheath.model_validate(dict(stanza))
    except ValidationError as error:
        raise ValueError(f"{_first(error)} [{place}]") from error


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    where, said = ".".join(str(part) for part in first["loc"]), first["msg"].removeprefix("Value error, ")
    return f"{where}: {said}" if where and not said.startswith(where) else said


def _target(name: object, stanzas: Sequence[Mapping[str, Any]], place: str) -> float:
    for other in stanzas:
        if other.get("id") == name:
            if any(isinstance(value, dict) and "mass_of" in value for value in other.values()):
                raise ValueError(f"mass_of must name a sheath with given dimensions, got {name!r} [{place}]")
            return _validated(other, f"sheath {name!r}").mass
    raise ValueError(f"mass_of must name a sheath of the set, got {name!r} [{place}]")


def _solved(stanza: Mapping[str, Any], field: str, mass: float, place: str) -> dict[str, Any]:
    table = stanza[field]
    if not {"mass_of", "least", "most"} <= set(table) <= {"mass_of", "least", "most", "tolerance"}:
        raise ValueError(
            f"{field} must have mass_of, least, most and tolerance, got {', '.join(sorted(table))} [{place}]"
        )
    try:
        low, high = (parse_quantity(table[name], "length") for name in ("least", "most"))
    except QuantityError as error:
        raise ValueError(f"{field}: {error} [{place}]") from error
    if not 0.0 < low < high:
        raise ValueError(
            f"{field}: least must be positive and below most, got {table['least']} and {table['most']} [{place}]"
        )

    def tried(value: float) -> Sheath:
        kept = {"tolerance": table["tolerance"]} if "tolerance" in table else {}
        return _validated(dict(stanza) | {field: _nominal(value, mass, kept, table["mass_of"])}, place)

    def excess(value: float) -> float:
        return tried(value).mass - mass

    value = _root(excess, low, high)
    best = min(max(round(value / _STEP) * _STEP, low), high) if value is not None else _nearer(excess, low, high)
    found = tried(best)
    if abs(found.mass / mass - 1.0) > MASS_MATCH:
        masses = sorted(format_mass(tried(limit).mass) for limit in (low, high))
        raise ValueError(
            f"{field} must give the mass of {table['mass_of']!r} ({format_mass(mass)}) within {MASS_MATCH:.0%} between "
            f"{table['least']} and {table['most']}, got {' to '.join(masses)} [{place}]"
        )
    return dict(stanza) | {field: getattr(found, field)}


def _nominal(value: float, mass: float, kept: Mapping[str, Any], other: object) -> dict[str, Any]:
    return {
        "nominal": f"{value * 1e3:.9g} mm",
        "source": f"solved for the mass of {other}, {format_mass(mass)}",
        **kept,
    }


def _root(excess: Callable[[float], float], low: float, high: float) -> float | None:
    from scipy.optimize import brentq

    if excess(low) * excess(high) > 0.0:
        return None
    return float(brentq(excess, low, high, xtol=1e-9, rtol=1e-12))


def _nearer(excess: Callable[[float], float], low: float, high: float) -> float:
    return min((low, high), key=lambda value: abs(excess(value)))


def format_mass(mass: float) -> str:
    """Write a mass as people read it."""
    return f"{mass * 1e3:.4g} g"
