"""Check of any STEP file: typed values, sound units, dimensions true to their faces."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from html import unescape
from pathlib import Path

from pydantic import TypeAdapter

from stepblocks.artefacts.step.exchange import Exchange, find_references, read_exchange
from stepblocks.artefacts.step.faces import (
    Surface,
    find_faces,
    is_placed_where_drawn,
    measure_angle,
    measure_distance,
    measure_size,
)
from stepblocks.artefacts.step.units import (
    Measure,
    find_untyped_measures,
    read_densities,
    read_measure,
)
from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.pages import render_page

ALLOWED = 1e-9  # largest difference between a dimension and its faces [m], and [rad] for angles
_SIZES = (
    "DIMENSIONAL_SIZE",
    "DIMENSIONAL_SIZE_WITH_PATH",
    "DIMENSIONAL_SIZE_WITH_DATUM_FEATURE",
    "ANGULAR_SIZE",
)
_LINEAR = (
    "DIMENSIONAL_LOCATION",
    "DIRECTED_DIMENSIONAL_LOCATION",
    "DIMENSIONAL_LOCATION_WITH_PATH",
)
_LOCATIONS = (*_LINEAR, "ANGULAR_LOCATION")
_FORMS = (
    "FLATNESS",
    "STRAIGHTNESS",
    "ROUNDNESS",
    "CYLINDRICITY",
    "PARALLELISM",
    "PERPENDICULARITY",
    "ANGULARITY",
)
_PLACES = ("POSITION", "CONCENTRICITY", "COAXIALITY", "SYMMETRY", "LINE_PROFILE", "SURFACE_PROFILE")
_TOLERANCES = (*_FORMS, *_PLACES, "CIRCULAR_RUNOUT", "TOTAL_RUNOUT")
_TO_DATUM = (
    "DATUM_SYSTEM",
    "DATUM_REFERENCE_COMPARTMENT",
    "DATUM_REFERENCE_ELEMENT",
    "DATUM_REFERENCE",
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
    geometry: float | None = (
        None  # the value by those faces [m or rad]; None where they do not determine it
    )
    datums: tuple[str, ...] = ()  # letters of those that a tolerance refers to
    angular: bool = False  # whether value and limits are angles
    problem: str = ""  # what is wrong with the dimension itself; empty where nothing is

    @property
    def deviation(self) -> float | None:
        """Geometry minus value [m or rad]."""
        return None if self.geometry is None else self.geometry - self.value


@dataclass(frozen=True)
class StepReport:
    """What stands in a STEP file.

    Attributes
    ----------
    name : str
        Of the file.
    schema : tuple of str
        FILE_SCHEMA of its header.
    dimensions, tolerances : tuple of Characteristic
        Each with its limits and what its faces measure [m], [rad].
    materials : tuple of str
        Names.
    densities : tuple of float
        Of these [kg/m^3].
    textures : tuple of (str, float)
        Face and largest Ra of every stated surface texture [m].
    findings : tuple of str
        One line for everything wrong; none means that the file passes.
    """

    name: str
    schema: tuple[str, ...]
    dimensions: tuple[Characteristic, ...]
    tolerances: tuple[Characteristic, ...]
    materials: tuple[str, ...]
    densities: tuple[float, ...]
    textures: tuple[tuple[str, float], ...]
    findings: tuple[str, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings


def check_step(path: str | Path, *, require_ap242: bool = False) -> StepReport:
    """Check anybody's STEP file as text, without the kernel that wrote it.

    Parameters
    ----------
    path : str or Path
        The file.
    require_ap242 : bool, optional
        Whether another schema, or a tolerance that names no face, is something wrong.

    Returns
    -------
    StepReport
        Every dimension and tolerance with its limits and what its faces measure, the material, and
        what is wrong: untyped values, units that do not fit, dimensions more than 1 nm (1e-9 rad)
        off their faces.

    Raises
    ------
    MetrologyError
        If the file is not whole ISO 10303-21 text, or is larger than 128 MiB.
    """
    found = read_confined(
        f"{__name__}:report_confined", Path(path), require_ap242, raises=MetrologyError
    )
    return TypeAdapter(StepReport).validate_python(found)


def report_confined(path: Path, require_ap242: bool) -> dict[str, object]:
    """Check a file, in the confined process."""
    file = read_exchange(path)
    dimensions, tolerances = list_dimensions(file), list_tolerances(file)
    densities, wrong = read_densities(file)
    findings = [*find_untyped_measures(file), *wrong]
    if require_ap242 and not any(
        schema.upper().startswith("AP242_MANAGED_MODEL") for schema in file.schema
    ):
        findings.append(f"FILE_SCHEMA: must be AP242, got {', '.join(file.schema) or 'nothing'}")
    findings += [finding for one in dimensions for finding in _check_dimension(one)]
    for one in tolerances:
        if one.problem:
            findings.append(f"{one.ref} {one.kind}: {one.problem}")
        if require_ap242 and not one.faces:
            findings.append(f"{one.ref} {one.kind}: names no face")
    return {
        "name": file.name,
        "schema": file.schema,
        "findings": findings,
        "dimensions": list(map(asdict, dimensions)),
        "tolerances": list(map(asdict, tolerances)),
        "materials": list(_list_material_names(file)),
        "densities": densities,
        "textures": list(_list_textures(file)),
    }


def list_dimensions(file: Exchange) -> list[Characteristic]:
    """List the dimensions of a file: sizes, distances and angles."""
    found = []
    for ref, values in file.named(*_SIZES):
        angular = file.parameters(ref, "ANGULAR_SIZE")
        kind, name = (
            ("angular size", _read_optional_text(values[1]))
            if angular
            else (str((*values, "size")[1]), "")
        )
        found.append(_read_dimension(file, ref, kind, name, find_faces(file, values[0])))
    for ref, values in file.named(*_LOCATIONS):
        if len(values) >= 4:
            kind = _read_optional_text(values[0]) or (
                "angular location" if file.parameters(ref, "ANGULAR_LOCATION") else "location"
            )
            found.append(
                _read_dimension(
                    file,
                    ref,
                    kind,
                    _read_optional_text(values[1]),
                    find_faces(file, values[2]),
                    find_faces(file, values[3]),
                )
            )
    return sorted(found, key=lambda one: int(one.ref[1:]))


def _read_optional_text(value: object) -> str:
    return "" if value is None or value in ("$", "*") else str(value)


def _read_dimension(
    file: Exchange, ref: str, kind: str, name: str, *sides: list[Surface]
) -> Characteristic:
    nominal, lower, upper, problem = _read_limits(file, ref)
    unit, value = ("?", math.nan) if nominal is None else (nominal.unit.name, nominal.si)
    angular = nominal is not None and nominal.unit.dimension == "angle"
    named = [one for side in sides for one in side]
    bodies = {one.representation for one in named}
    if len(bodies) > 1 and not is_placed_where_drawn(file):
        geometry = None
    elif len(sides) == 1:
        geometry = measure_size(sides[0], "angle" if angular else kind)
    else:
        first, second = sides
        geometry = (
            measure_angle(first, second, value)
            if angular
            else measure_distance(first, second, kind)
        )
    planes = len(sides) == 2 and all(sides) and all(one.kind == "PLANE" for one in named)
    if planes and geometry is None and not (problem or angular) and len(bodies) == 1:
        problem = f"names planes {sides[0][0].ref} and {sides[1][0].ref} that are not parallel"
    return Characteristic(
        ref,
        kind,
        name,
        value,
        lower,
        upper,
        unit,
        tuple(one.ref for one in named),
        geometry,
        (),
        angular,
        problem,
    )


def _list_related_instances(file: Exchange, ref: str, entity: str, own: int) -> Iterator[object]:
    # Yield what an entity of two parameters links with an instance (parameter `own`)
    for user in file.users(ref):
        pair = file.parameters(user, entity)
        if len(pair) == 2 and pair[own] == ref:
            yield pair[1 - own]


def _read_limits(file: Exchange, ref: str) -> tuple[Measure | None, float, float, str]:
    # Read the nominal value, the signed deviations, and what is wrong with them. Limits stand as
    # deviations or as values of their own.
    found: dict[str, Measure] = {}
    for representation in _list_related_instances(
        file, ref, "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", 0
    ):
        for item in (file.parameters(representation, "SHAPE_DIMENSION_REPRESENTATION") or ("", ()))[
            1
        ]:
            if (measure := read_measure(file, item)) is not None:
                label = str((file.parameters(item, "REPRESENTATION_ITEM") or ("",))[0]).lower()
                side = next((side for side in ("upper", "lower") if side in label), "")
                # the first value is the nominal
                found[side] = measure if side else found.get(side, measure)
    if (nominal := found.pop("", None)) is None:
        return None, math.nan, math.nan, "no value"
    lower, upper = (
        found[side].si - nominal.si if side in found else math.nan for side in ("lower", "upper")
    )
    problem = ""
    if not found:
        for stated in _list_related_instances(file, ref, "PLUS_MINUS_TOLERANCE", 1):
            if bounds := file.parameters(stated, "TOLERANCE_VALUE"):
                sides = [one for bound in bounds if (one := read_measure(file, bound)) is not None]
                if len(sides) != 2:
                    problem = "limits without a value"
                elif {one.unit.dimension for one in sides} != {nominal.unit.dimension}:
                    problem = "limits in another kind of unit than the value"
                else:
                    lower, upper = (one.si for one in sides)
                break
    return nominal, lower, upper, "limits are not in order" if lower >= upper else problem


def list_tolerances(file: Exchange) -> list[Characteristic]:
    """List the geometric tolerances of a file."""
    found: dict[str, Characteristic] = {}
    for kind in _TOLERANCES:
        for ref, values in file.named(f"{kind}_TOLERANCE"):
            common = file.parameters(ref, "GEOMETRIC_TOLERANCE") or values
            if len(common) < 4:
                continue
            zone = read_measure(file, common[2])
            unit, value = ("?", math.nan) if zone is None else (zone.unit.name, zone.si)
            reference = (
                file.parameters(ref, "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE") or values[4:5]
            )
            problem = "" if value > 0.0 else "zone must be positive"
            found[ref] = Characteristic(
                ref=ref,
                kind=kind.lower().replace("_", " "),
                name=_read_optional_text(common[0]),
                value=value,
                lower=0.0,
                upper=value,
                unit=unit,
                faces=tuple(one.ref for one in find_faces(file, common[3])),
                datums=_read_datums(file, reference),
                problem="no value" if zone is None else problem,
            )
    return sorted(found.values(), key=lambda one: int(one.ref[1:]))


def _read_datums(file: Exchange, reference: object) -> tuple[str, ...]:
    # Read the letters behind a datum system or a list of datum references
    letters: list[str] = []
    refs = list(find_references(reference))
    for ref in refs:  # which grows on the way
        letters += [str(one) for one in file.parameters(ref, "DATUM")[-1:]]
        below = (
            one for name in _TO_DATUM for one in find_references(file.parameters(ref, name)[1:])
        )
        refs += [one for one in below if one not in refs]
    return tuple(dict.fromkeys(letters))


def choose_display_unit(angular: bool) -> tuple[float, str]:
    """Return the unit of a table or message, and how many of it make one of the SI."""
    return (180.0 / math.pi, "deg") if angular else (1e3, "mm")


def _check_dimension(dimension: Characteristic) -> Iterator[str]:
    if dimension.problem == "no value":
        return  # a dimension for reference only carries no value; it is listed, not judged
    label = f"{dimension.ref} {dimension.kind}{f' ({dimension.name})' if dimension.name else ''}"
    if dimension.problem:
        yield f"{label}: {dimension.problem}"
    if dimension.deviation is not None and abs(dimension.deviation) > ALLOWED:
        scale, unit = choose_display_unit(dimension.angular)
        stated, measured = (
            f"{value * scale:.9g} {unit}"
            for value in (dimension.value, dimension.value + dimension.deviation)
        )
        faces, off = (
            ("", "")
            if dimension.angular
            else (f" {', '.join(dimension.faces)}", f" ({dimension.deviation * 1e9:+.3f} nm)")
        )
        yield f"{label}: says {stated}, but its faces{faces} have {measured}{off}"


def _list_textures(file: Exchange) -> Iterator[tuple[str, float]]:
    for _, (described, shown, *_) in file.named("PROPERTY_DEFINITION_REPRESENTATION"):
        kind, _, owner = file.parameters(described, "PROPERTY_DEFINITION") or ("", "", "")
        if kind != "surface texture":
            continue
        for item in (file.parameters(shown, "REPRESENTATION") or ("", ()))[1]:
            if (measure := read_measure(file, item)) is not None:
                yield from ((face.ref, measure.si) for face in find_faces(file, owner))


def _list_material_names(file: Exchange) -> Iterator[str]:
    for _, values in file.named("REPRESENTATION"):
        if len(values) == 3 and "material name" in str(values[0]).lower():
            for item in values[1]:
                yield from map(str, file.parameters(item, "DESCRIPTIVE_REPRESENTATION_ITEM")[:1])


def format_step_table(report: StepReport) -> str:
    """Return everything that a STEP file asks for, as a table."""
    kinds = {one.kind for one in report.dimensions}
    rows = [
        (one, one.kind in kinds, *choose_display_unit(one.angular))
        for one in (*report.dimensions, *report.tolerances)
    ]
    return unescape(
        render_page("stepblocks.artefacts", "step.txt.j2", report=report, rows=rows)
    ).rstrip()
