"""Every dimension and geometric tolerance of a STEP file, with signed limits, unit, and the faces it names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from stepblocks.artefacts.step.part21.exchange import Exchange, is_reference
from stepblocks.artefacts.step.part21.faces import (
    Surface,
    faces_of,
    measured_angle,
    measured_distance,
    measured_size,
    placed_where_drawn,
)
from stepblocks.artefacts.step.part21.units import Measure, measure_of

_SIZES = ("DIMENSIONAL_SIZE", "DIMENSIONAL_SIZE_WITH_PATH", "DIMENSIONAL_SIZE_WITH_DATUM_FEATURE", "ANGULAR_SIZE")
_LOCATIONS = (
    "DIMENSIONAL_LOCATION",
    "DIRECTED_DIMENSIONAL_LOCATION",
    "DIMENSIONAL_LOCATION_WITH_PATH",
    "ANGULAR_LOCATION",
)


@dataclass(frozen=True)
class Characteristic:
    """One dimension or tolerance."""

    ref: str  # Its instance
    kind: str  # ``diameter``, ``linear distance``, ``flatness``,
    name: str  # Name or description in the file
    value: float  # Nominal of a dimension, zone of a tolerance [m or rad]
    lower: float  # Deviations, signed [m or rad]; nan where the file states none
    upper: float
    unit: str  # Unit in the file
    faces: tuple[str, ...]  # Faces it names
    geometry: float | None  # The same from the geometry of those faces [m or rad]; None where they do not determine it
    datums: tuple[str, ...] = ()  # Letters of the datums a tolerance refers to
    angular: bool = False  # Whether value and limits are angles
    problem: str = ""  # What is wrong with the dimension itself; empty where nothing is

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
        surfaces = faces_of(file, values[0])
        found.append(_dimension(file, ref, kind, name, surfaces, None))
    for ref, values in file.named(*_LOCATIONS):
        if len(values) < 4:
            continue
        named = "" if values[1] in (None, "$") else _text(values[1])
        kind = _text(values[0]) or ("angular location" if file.parameters(ref, "ANGULAR_LOCATION") else "location")
        found.append(_dimension(file, ref, kind, named, faces_of(file, values[2]), faces_of(file, values[3])))
    return sorted(found, key=lambda one: int(one.ref[1:]))


def _text(value: object) -> str:
    return "" if value is None or str(value) in ("$", "*") else str(value)


def _dimension(
    file: Exchange, ref: str, kind: str, name: str, first: list[Surface], second: list[Surface] | None
) -> Characteristic:
    nominal, limits = _values(file, ref)
    lower, upper, problem = _deviations(file, ref, nominal, limits)
    angular = nominal is not None and nominal.unit.dimension == "angle"
    value = nominal.si if nominal is not None else math.nan
    if nominal is None:
        problem = problem or "no value"
    bodies = {one.representation for one in [*first, *(second or [])]}
    if len(bodies) > 1 and not placed_where_drawn(file):
        geometry = None
    elif second is None:
        geometry = measured_size(first, "angle" if angular else kind)
    elif angular:
        geometry = measured_angle(first, second, value)
    else:
        geometry = measured_distance(first, second, kind)
    planes = bool(first and second) and all(one.kind == "PLANE" for one in [*first, *(second or [])])
    if planes and second and geometry is None and not (problem or angular) and len(bodies) == 1:
        problem = f"names planes {first[0].ref} and {second[0].ref} that are not parallel"
    faces = tuple(one.ref for one in [*first, *(second or [])])
    unit = nominal.unit.name if nominal is not None else "?"
    return Characteristic(ref, kind, name, value, lower, upper, unit, faces, geometry, (), angular, problem)


def _values(file: Exchange, ref: str) -> tuple[Measure | None, dict[str, Measure]]:
    """Nominal value, and limits that are given as values."""
    nominal: Measure | None = None
    limits: dict[str, Measure] = {}
    for user in file.users(ref):
        pair = file.parameters(user, "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION")
        if len(pair) != 2 or pair[0] != ref:
            continue
        items = (file.parameters(pair[1], "SHAPE_DIMENSION_REPRESENTATION") or ("", ()))[1]
        for item in items:
            measure = measure_of(file, item)
            if measure is None:
                continue
            label = str((file.parameters(item, "REPRESENTATION_ITEM") or ("",))[0]).lower()
            if "upper" in label:
                limits["upper"] = measure
            elif "lower" in label:
                limits["lower"] = measure
            elif nominal is None:
                nominal = measure
    return nominal, limits


def _deviations(
    file: Exchange, ref: str, nominal: Measure | None, limits: dict[str, Measure]
) -> tuple[float, float, str]:
    if nominal is not None and limits:
        lower = limits["lower"].si - nominal.si if "lower" in limits else math.nan
        upper = limits["upper"].si - nominal.si if "upper" in limits else math.nan
        return lower, upper, "limits are not in order" if lower >= upper else ""
    for user in file.users(ref):
        pair = file.parameters(user, "PLUS_MINUS_TOLERANCE")
        if len(pair) != 2 or pair[1] != ref:
            continue
        bounds = file.parameters(pair[0], "TOLERANCE_VALUE")
        if len(bounds) == 2:
            low, high = measure_of(file, bounds[0]), measure_of(file, bounds[1])
            if low is None or high is None:
                return math.nan, math.nan, "limits without a value"
            if nominal is not None and {low.unit.dimension, high.unit.dimension} != {nominal.unit.dimension}:
                return math.nan, math.nan, "limits in another kind of unit than the value"
            return low.si, high.si, "limits are not in order" if low.si >= high.si else ""
        if file.parameters(pair[0], "LIMITS_AND_FITS"):
            return math.nan, math.nan, ""
    return math.nan, math.nan, ""


def tolerances_of(file: Exchange) -> list[Characteristic]:
    """List the geometric tolerances of a file."""
    found: dict[str, Characteristic] = {}
    kinds = (
        "FLATNESS",
        "STRAIGHTNESS",
        "ROUNDNESS",
        "CYLINDRICITY",
        "PARALLELISM",
        "PERPENDICULARITY",
        "ANGULARITY",
        "POSITION",
        "CONCENTRICITY",
        "COAXIALITY",
        "SYMMETRY",
        "LINE_PROFILE",
        "SURFACE_PROFILE",
        "CIRCULAR_RUNOUT",
        "TOTAL_RUNOUT",
    )
    for kind in kinds:
        for ref, values in file.named(f"{kind}_TOLERANCE"):
            common = file.parameters(ref, "GEOMETRIC_TOLERANCE") or values
            if len(common) < 4:
                continue
            magnitude = measure_of(file, common[2])
            reference = file.parameters(ref, "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE") or values[4:5]
            value = magnitude.si if magnitude is not None else math.nan
            problem = "" if magnitude is not None else "no value"
            if magnitude is not None and not value > 0.0:
                problem = "zone must be positive"
            found[ref] = Characteristic(
                ref,
                kind.lower().replace("_", " "),
                _text(common[0]),
                value,
                0.0,
                value,
                magnitude.unit.name if magnitude else "?",
                tuple(one.ref for one in faces_of(file, common[3])),
                None,
                _datums(file, reference),
                False,
                problem,
            )
    return sorted(found.values(), key=lambda one: int(one.ref[1:]))


def _datums(file: Exchange, reference: Any) -> tuple[str, ...]:
    """Letters behind a datum system or a list of datum references, following references down to DATUM."""
    letters: list[str] = []
    stack = [value for item in reference for value in (item if isinstance(item, tuple | list) else (item,))]
    for _ in range(200):
        if not stack:
            break
        ref = stack.pop(0)
        datum = file.parameters(ref, "DATUM")
        if datum:
            letters.append(str(datum[-1]))
            continue
        for name in ("DATUM_SYSTEM", "DATUM_REFERENCE_COMPARTMENT", "DATUM_REFERENCE_ELEMENT", "DATUM_REFERENCE"):
            for value in file.parameters(ref, name)[1:]:
                inner = value if isinstance(value, tuple | list) else (value,)
                stack += [
                    one for one in inner if is_reference(one) and not file.parameters(one, "PRODUCT_DEFINITION_SHAPE")
                ]
    return tuple(dict.fromkeys(letters))
