"""Every dimension and geometric tolerance of a STEP file, with signed limits, unit, and the faces it names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from stepblocks.artefacts.step.exchange import Exchange, references_in
from stepblocks.artefacts.step.faces import (
    Surface,
    faces_of,
    measured_angle,
    measured_distance,
    measured_size,
    placed_where_drawn,
)
from stepblocks.artefacts.step.units import Measure, measure_of

_SIZES = ("DIMENSIONAL_SIZE", "DIMENSIONAL_SIZE_WITH_PATH", "DIMENSIONAL_SIZE_WITH_DATUM_FEATURE", "ANGULAR_SIZE")
_LOCATIONS = (
    *("DIMENSIONAL_LOCATION", "DIRECTED_DIMENSIONAL_LOCATION", "DIMENSIONAL_LOCATION_WITH_PATH"),
    "ANGULAR_LOCATION",
)
_TOLERANCES = (
    *("FLATNESS", "STRAIGHTNESS", "ROUNDNESS", "CYLINDRICITY"),
    *("PARALLELISM", "PERPENDICULARITY", "ANGULARITY"),
    *("POSITION", "CONCENTRICITY", "COAXIALITY", "SYMMETRY"),
    *("LINE_PROFILE", "SURFACE_PROFILE", "CIRCULAR_RUNOUT", "TOTAL_RUNOUT"),
)


@dataclass(frozen=True)
class Characteristic:
    """One dimension or tolerance."""

    ref: str  # instance
    kind: str  # ``diameter``, ``linear distance``, ``flatness``
    name: str  # name or description in the file
    value: float  # nominal of a dimension, zone of a tolerance [m or rad]
    lower: float  # signed deviation [m or rad]; nan where the file states none
    upper: float  # signed deviation [m or rad]; nan where the file states none
    unit: str  # in the file
    faces: tuple[str, ...]  # that it names
    geometry: float | None = None  # the value by those faces [m or rad]; None where they do not determine it
    datums: tuple[str, ...] = ()  # letters of those that a tolerance refers to
    angular: bool = False  # whether value and limits are angles
    problem: str = ""  # what is wrong with the dimension itself; empty where nothing is

    @property
    def deviation(self) -> float | None:
        """Geometry minus value [m or rad]."""
        return None if self.geometry is None else self.geometry - self.value


def dimensions_of(file: Exchange) -> list[Characteristic]:
    """List the dimensions of a file."""
    found = []
    for ref, values in file.named(*_SIZES):
        kind, name = (str(values[1]) if len(values) > 1 else "size"), ""
        if file.parameters(ref, "ANGULAR_SIZE"):
            kind, name = "angular size", _text(values[1])
        found.append(_dimension(file, ref, kind, name, faces_of(file, values[0])))
    for ref, values in file.named(*_LOCATIONS):
        if len(values) >= 4:
            kind = _text(values[0]) or ("angular location" if file.parameters(ref, "ANGULAR_LOCATION") else "location")
            sides = faces_of(file, values[2]), faces_of(file, values[3])
            found.append(_dimension(file, ref, kind, _text(values[1]), *sides))
    return sorted(found, key=lambda one: int(one.ref[1:]))


def _text(value: object) -> str:
    return "" if value is None or value in ("$", "*") else str(value)


def _dimension(file: Exchange, ref: str, kind: str, name: str, *sides: list[Surface]) -> Characteristic:
    """Size of the faces of one side, or distance or angle between two."""
    nominal, limits = _values(file, ref)
    lower, upper, problem = _deviations(file, ref, nominal, limits)
    angular = nominal is not None and nominal.unit.dimension == "angle"
    value = nominal.si if nominal is not None else math.nan
    named = [one for side in sides for one in side]
    bodies = {one.representation for one in named}
    if len(bodies) > 1 and not placed_where_drawn(file):
        geometry = None
    elif len(sides) == 1:
        geometry = measured_size(sides[0], "angle" if angular else kind)
    else:
        first, second = sides
        geometry = measured_angle(first, second, value) if angular else measured_distance(first, second, kind)
    planes = len(sides) == 2 and all(sides) and all(one.kind == "PLANE" for one in named)
    if nominal is None:
        problem = problem or "no value"
    elif planes and geometry is None and not (problem or angular) and len(bodies) == 1:
        problem = f"names planes {sides[0][0].ref} and {sides[1][0].ref} that are not parallel"
    return Characteristic(
        ref=ref,
        kind=kind,
        name=name,
        value=value,
        lower=lower,
        upper=upper,
        unit=nominal.unit.name if nominal is not None else "?",
        faces=tuple(one.ref for one in named),
        geometry=geometry,
        angular=angular,
        problem=problem,
    )


def _linked(file: Exchange, ref: str, entity: str, own: int) -> Iterator[object]:
    """Yield what an entity of two parameters links with an instance, which is its parameter `own`."""
    for user in file.users(ref):
        pair = file.parameters(user, entity)
        if len(pair) == 2 and pair[own] == ref:
            yield pair[1 - own]


def _values(file: Exchange, ref: str) -> tuple[Measure | None, dict[str, Measure]]:
    """Nominal value, and limits that are given as values."""
    found: dict[str, Measure] = {}
    for representation in _linked(file, ref, "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", 0):
        for item in (file.parameters(representation, "SHAPE_DIMENSION_REPRESENTATION") or ("", ()))[1]:
            if (measure := measure_of(file, item)) is not None:
                label = str((file.parameters(item, "REPRESENTATION_ITEM") or ("",))[0]).lower()
                side = next((side for side in ("upper", "lower") if side in label), "")
                found[side] = measure if side else found.get(side, measure)  # the first value is the nominal
    return found.pop("", None), found


def _deviations(
    file: Exchange, ref: str, nominal: Measure | None, limits: dict[str, Measure]
) -> tuple[float, float, str]:
    """Signed deviations, and what is wrong with them."""
    if nominal is not None and limits:
        lower, upper = (limits[side].si - nominal.si if side in limits else math.nan for side in ("lower", "upper"))
        return lower, upper, "limits are not in order" if lower >= upper else ""
    for stated in _linked(file, ref, "PLUS_MINUS_TOLERANCE", 1):
        bounds = file.parameters(stated, "TOLERANCE_VALUE")
        if len(bounds) == 2:
            low, high = measure_of(file, bounds[0]), measure_of(file, bounds[1])
            if low is None or high is None:
                return math.nan, math.nan, "limits without a value"
            if nominal is not None and {low.unit.dimension, high.unit.dimension} != {nominal.unit.dimension}:
                return math.nan, math.nan, "limits in another kind of unit than the value"
            return low.si, high.si, "limits are not in order" if low.si >= high.si else ""
        if file.parameters(stated, "LIMITS_AND_FITS"):
            break
    return math.nan, math.nan, ""


def tolerances_of(file: Exchange) -> list[Characteristic]:
    """List the geometric tolerances of a file."""
    found: dict[str, Characteristic] = {}
    for kind in _TOLERANCES:
        for ref, values in file.named(f"{kind}_TOLERANCE"):
            common = file.parameters(ref, "GEOMETRIC_TOLERANCE") or values
            if len(common) < 4:
                continue
            zone = measure_of(file, common[2])
            value = zone.si if zone is not None else math.nan
            reference = file.parameters(ref, "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE") or values[4:5]
            found[ref] = Characteristic(
                ref=ref,
                kind=kind.lower().replace("_", " "),
                name=_text(common[0]),
                value=value,
                lower=0.0,
                upper=value,
                unit=zone.unit.name if zone else "?",
                faces=tuple(one.ref for one in faces_of(file, common[3])),
                datums=_datums(file, reference),
                problem="no value" if zone is None else "" if value > 0.0 else "zone must be positive",
            )
    return sorted(found.values(), key=lambda one: int(one.ref[1:]))


def _datums(file: Exchange, reference: object) -> tuple[str, ...]:
    """Letters behind a datum system or a list of datum references, following references down to DATUM."""
    letters: list[str] = []
    stack = list(references_in(reference))
    for _ in range(200):
        if not stack:
            break
        ref = stack.pop(0)
        if datum := file.parameters(ref, "DATUM"):
            letters.append(str(datum[-1]))
            continue
        for name in ("DATUM_SYSTEM", "DATUM_REFERENCE_COMPARTMENT", "DATUM_REFERENCE_ELEMENT", "DATUM_REFERENCE"):
            inner = references_in(file.parameters(ref, name)[1:])
            stack += [one for one in inner if not file.parameters(one, "PRODUCT_DEFINITION_SHAPE")]
    return tuple(dict.fromkeys(letters))
