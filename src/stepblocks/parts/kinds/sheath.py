"""Sheaths for the shank of a probe: tubes of different materials, one made as heavy as another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, ValidationError

from stepblocks import cad
from stepblocks.contact.rod import Sleeve
from stepblocks.errors import QuantityError
from stepblocks.parts.characteristics import Characteristic, EdgeRule, FaceRule, broken_edges, plane, toleranced
from stepblocks.parts.declared import Identity, Material, Sourced, Table, below, must, rules_validator, sourced
from stepblocks.parts.kind import FITTING_DEFLECTION, Finding, HeldPart, MeasuredMesh
from stepblocks.parts.revolution import Outline, Point, Turned, sectors
from stepblocks.parts.tolerance import Length, PositiveLength
from stepblocks.quantities import format_quantity, parse_quantity

# Largest relative difference in mass of two sheaths that are to weigh the same (the paper's sheaths: equal weight)
MASS_MATCH = 0.01
MASS_LIMIT = 1e-6  # mass of a mesh against the declared one, relative
_FLOAT32_LIMIT = 10e-9  # of lengths up to 100 mm, which GLB keeps as float32 in metres
_SOLVABLE = ("bore", "outer_diameter", "length")
_STEP = 10e-6  # a solved dimension is rounded to this, so that a drawing can state it [m]


@dataclass(frozen=True)
class SheathMaterial(Material):
    """A material that bends and damps; modulus and ratios at the frequency of the ring."""

    modulus: float  # Young's [Pa]
    modulus_source: str
    poisson: float  # ratio [1]
    poisson_source: str
    loss_factor: float  # 1
    loss_factor_source: str


class _MaterialTable(Table):
    name: Identity
    designation: Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[ -&(-~]+$")]
    density: Annotated[Sourced, sourced("density")]
    modulus: Annotated[Sourced, sourced("pressure")]
    poisson: Annotated[Sourced, sourced("ratio")]
    loss_factor: Annotated[Sourced, sourced("ratio")]


def _material(raw: object) -> SheathMaterial:
    if isinstance(raw, SheathMaterial):
        return raw
    if not isinstance(raw, dict):
        names = "name, designation, density, modulus, poisson and loss_factor"
        raise ValueError(f"must be a table with {names}, got {raw!r:.60}")
    try:
        table = _MaterialTable.model_validate(raw)
    except ValidationError as error:
        raise ValueError(_first(error)) from error
    if table.poisson.value > 0.5:
        raise ValueError(f"poisson must not exceed 0.5, got {table.poisson.value:g}")
    values: dict[str, Any] = dict(table)
    for name in ("modulus", "poisson", "loss_factor"):
        values[name], values[f"{name}_source"] = values[name].value, values[name].source
    values["density"], values["source"] = table.density.value, table.density.source
    return SheathMaterial(**values)


class Sheath(Turned, HeldPart):
    """A tube over the shank; its end near the clamp lies at z = 0, its axis is z."""

    stanza: ClassVar[str] = "sheath"
    called: ClassVar[str] = "sheath of the probe"
    titled: ClassVar[str] = "Sheath"
    governed_by: ClassVar[str] = "bore"

    bore: PositiveLength  # inner diameter [m]
    outer_diameter: PositiveLength  # m
    length: PositiveLength  # from end to end [m]
    edge_break: Length  # leg of the 45 degree chamfer on the two outer edges [m]
    position: Length  # from the clamp to the near end, on the shank [m]
    material: Annotated[SheathMaterial, BeforeValidator(_material)]

    @classmethod
    def prepared(cls, stanzas: object) -> object:
        return balanced(stanzas)

    @property
    def sleeve(self) -> Sleeve | None:
        bore, outer, length = self.bore.nominal, self.outer_diameter.nominal, self.length.nominal
        bending = self.material.modulus * math.pi * (outer**4 - bore**4) / 64.0
        return Sleeve(self.position.nominal, length, bending, self.mass / length, self.material.loss_factor)

    @property
    def mass(self) -> float:
        """Nominal mass [kg]."""
        sizes = self.bore, self.outer_diameter, self.length, self.edge_break
        return self.material.density * _volume(*(one.nominal for one in sizes))

    @property
    def mass_limits(self) -> tuple[float, float]:
        """Least and greatest mass within the tolerances [kg]."""
        (thin, wide), (small, large) = self.bore.limits, self.outer_diameter.limits
        (short, long), (sharp, blunt) = self.length.limits, self.edge_break.limits
        density = self.material.density
        return density * _volume(wide, small, short, blunt), density * _volume(thin, large, long, max(sharp, 0.0))

    def outlines(self) -> list[Outline]:
        return [[*self.outline()]]

    def outline(self) -> list[Point]:
        """Half section; the near end lies at height 0."""
        bore, outer = 0.5 * self.bore.nominal, 0.5 * self.outer_diameter.nominal
        length, c = self.length.nominal, self.edge_break.nominal
        if c == 0.0:
            return [(bore, 0.0), (outer, 0.0), (outer, length), (bore, length)]
        return [(bore, 0.0), (outer - c, 0.0), (outer, c), (outer, length - c), (outer - c, length), (bore, length)]

    def hulls(self) -> list[Any]:
        return sectors(self.outline())

    def chordal_error(self, face: cad.kernel.Face) -> float:
        return FITTING_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        bore, outer, broken = self.bore, self.outer_diameter, self.edge_break
        side = FaceRule("CYLINDER", radius=0.5 * outer.nominal)
        yield toleranced("bore", "diameter", bore, FaceRule("CYLINDER", radius=0.5 * bore.nominal), method="pin gauges")
        yield toleranced("outer_diameter", "diameter", outer, side)
        yield toleranced("length", "distance", self.length, plane(2, 0.0), plane(2, self.length.nominal))
        edge = EdgeRule(FaceRule("CONE", holds={2: 0.5 * broken.nominal}), side)
        yield broken_edges(broken, plane(2, 0.0), edge)
        where = "position, from the clamp"
        yield toleranced("position", "note", self.position, label=where, method="caliper, assembled")

    def measured(self, body: int, mesh: MeasuredMesh) -> Iterator[Finding]:
        heights, radii = mesh.vertices[:, 2], mesh.radii
        yield Finding("length", self.length.nominal, float(heights.max() - heights.min()), _FLOAT32_LIMIT)
        yield Finding("radius of the bore", 0.5 * self.bore.nominal, float(radii.min()), FITTING_DEFLECTION)
        yield Finding("outer radius", 0.5 * self.outer_diameter.nominal, float(radii.max()), FITTING_DEFLECTION)
        yield Finding("mass", self.mass, self.material.density * mesh.volume, MASS_LIMIT, "mass", relative=True)

    def close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        outer = self.outer_diameter.nominal
        return 1.0, min(0.6 * outer, 4.9e-3), (0.0, 0.0, 0.4 * outer)

    def derived(self) -> list[list[str]]:
        low, high = self.mass_limits
        text = f"{format_mass(self.mass)} ({format_mass(low)} to {format_mass(high)} within tolerances)"
        return [["mass", text], ["material", self.material.designation]]

    def lacks(self, conditions: Mapping[str, Any]) -> Iterator[str]:
        missing = [name for name in ("probe", "damping_rig") if conditions[name] is None]
        yield from (f"{name} must be declared for a set with sheaths, got none" for name in missing)
        shank = 0.0 if "probe" in missing else conditions["probe"].shank_diameter.value
        if self.bore.limits[0] < shank:
            rule = f"not be less than the shank ({format_quantity(shank, 'length')}) within its tolerance"
            yield f"bore must {rule}, got {self.bore} [{self.place}]"

    @rules_validator
    def _is_possible(self) -> Iterator[str]:
        bore, outer, broken = self.bore.nominal, self.outer_diameter.nominal, self.edge_break.nominal
        yield must(outer > bore, "outer_diameter", "exceed bore", bore, outer)
        if outer > bore:  # without a wall, nothing can be said of what is cut into it
            room = min(0.5 * (outer - bore), 0.5 * self.length.nominal)
            yield below("edge_break", "be smaller than the wall and half the length", broken, room)


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
        wanted = _to_solve(stanza)
        place = f"sheath {stanza.get('id')!r}"
        if len(wanted) > 1 or not set(wanted) <= set(_SOLVABLE):
            at = ", ".join(wanted)
            raise ValueError(f"mass_of must stand at one of {', '.join(_SOLVABLE)}, got it at {at} [{place}]")
        solved.append(_solved(stanza, wanted[0], raw, place) if wanted else stanza)
    return solved


def _to_solve(stanza: Mapping[str, Any]) -> list[str]:
    return [name for name, value in stanza.items() if isinstance(value, dict) and "mass_of" in value]


def _validated(stanza: Mapping[str, Any], place: str) -> Sheath:
    """Validate a stanza on its own, with one line and its place where it is wrong."""
    try:
        return Sheath.model_validate(dict(stanza))
    except ValidationError as error:
        raise ValueError("\n".join(f"{line} [{place}]" for line in _first(error).splitlines())) from error


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    where, said = ".".join(str(part) for part in first["loc"]), first["msg"].removeprefix("Value error, ")
    return f"{where}: {said}" if where and not said.startswith(where) else said


def _solved(stanza: Mapping[str, Any], field: str, stanzas: Sequence[Mapping[str, Any]], place: str) -> dict[str, Any]:
    """Find the dimension at which a sheath weighs as much as another, rounded to what a drawing states."""
    from scipy.optimize import brentq

    table, name = stanza[field], stanza[field]["mass_of"]
    other = next((one for one in stanzas if one.get("id") == name), None)
    if other is None or _to_solve(other):
        rule = "a sheath of the set" if other is None else "a sheath with given dimensions"
        raise ValueError(f"mass_of must name {rule}, got {name!r} [{place}]")
    mass = _validated(other, f"sheath {name!r}").mass
    low, high = _bounds(table, field, place)
    kept = {key: table[key] for key in ("tolerance",) if key in table}
    kept["source"] = f"solved for the mass of {name}, {format_mass(mass)}"

    def tried(value: float) -> Sheath:
        return _validated(dict(stanza) | {field: {"nominal": f"{value * 1e3:.9g} mm", **kept}}, place)

    def excess(value: float) -> float:
        return tried(value).mass - mass

    if excess(low) * excess(high) > 0.0:
        best = min((low, high), key=lambda value: abs(excess(value)))
    else:
        root = brentq(excess, low, high, xtol=1e-9, rtol=1e-12)
        best = min(max(round(root / _STEP) * _STEP, low), high)
    found = tried(best)
    if abs(found.mass / mass - 1.0) > MASS_MATCH:
        masses = sorted(format_mass(tried(limit).mass) for limit in (low, high))
        wish = f"give the mass of {name!r} ({format_mass(mass)}) within {MASS_MATCH:.0%}"
        room = f"between {table['least']} and {table['most']}"
        raise ValueError(f"{field} must {wish} {room}, got {' to '.join(masses)} [{place}]")
    return dict(stanza) | {field: getattr(found, field)}


def _bounds(table: Mapping[str, Any], field: str, place: str) -> tuple[float, float]:
    """Read between which lengths a dimension is sought [m]."""
    if not {"mass_of", "least", "most"} <= set(table) <= {"mass_of", "least", "most", "tolerance"}:
        got = ", ".join(sorted(table))
        raise ValueError(f"{field} must have mass_of, least, most and tolerance, got {got} [{place}]")
    try:
        low, high = (parse_quantity(table[name], "length") for name in ("least", "most"))
    except QuantityError as error:
        raise ValueError(f"{field}: {error} [{place}]") from error
    if not 0.0 < low < high:
        got = f"{table['least']} and {table['most']}"
        raise ValueError(f"{field}: least must be positive and below most, got {got} [{place}]")
    return low, high


def format_mass(mass: float) -> str:
    """Write a mass as people read it."""
    return f"{mass * 1e3:.4g} g"
