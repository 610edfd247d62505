"""Geometric tolerances of a STEP file."""

import math

from stepblocks.artefacts.step.characteristic import Characteristic, Problem, read_optional_text
from stepblocks.artefacts.step.exchange import Exchange, yield_references
from stepblocks.artefacts.step.faces import find_surfaces_of_aspect
from stepblocks.artefacts.step.units import read_measure

_KINDS = (
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
# What leads from a tolerance to a datum
_TO_DATUM = (
    "DATUM_SYSTEM",
    "DATUM_REFERENCE_COMPARTMENT",
    "DATUM_REFERENCE_ELEMENT",
    "DATUM_REFERENCE",
)
_PARAMETERS = 4  # of any tolerance: name, description, zone, aspect


def list_tolerances(file: Exchange) -> list[Characteristic]:
    """List the geometric tolerances of a file, in the order of their instances."""
    tolerances: dict[str, Characteristic] = {}
    for kind in _KINDS:
        entity = f"{kind}_TOLERANCE"
        for ref, _ in file.yield_instances(entity):
            tolerance = _read_tolerance(file, ref, entity, kind.lower().replace("_", " "))
            if tolerance is not None:
                tolerances[ref] = tolerance
    return sorted(tolerances.values(), key=lambda tolerance: tolerance.number)


def _read_tolerance(file: Exchange, ref: str, entity: str, kind: str) -> Characteristic | None:
    """Read a tolerance, an instance of one entity or of several; None where it is incomplete."""
    simple = file.get_parameters(ref, entity)
    parameters = file.get_parameters(ref, "GEOMETRIC_TOLERANCE") or simple
    if len(parameters) < _PARAMETERS:
        return None
    name, _, stated_zone, aspect = parameters[:_PARAMETERS]
    with_datum = file.get_parameters(ref, "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE")
    datum_references = with_datum or simple[_PARAMETERS : _PARAMETERS + 1]
    zone = read_measure(file, stated_zone)
    value = math.nan
    unit = "?"
    problem = Problem.NO_VALUE
    if zone is not None:
        value = zone.si
        unit = zone.unit.name
        problem = Problem.NONE if value > 0.0 else Problem.ZONE_NOT_POSITIVE
    return Characteristic(
        ref=ref,
        kind=kind,
        name=read_optional_text(name),
        value=value,
        lower=0.0,
        upper=value,
        unit=unit,
        faces=tuple(surface.ref for surface in find_surfaces_of_aspect(file, aspect)),
        datums=_read_datum_letters(file, datum_references),
        problem=problem,
    )


def _read_datum_letters(file: Exchange, references: object) -> tuple[str, ...]:
    """Read the letters behind a datum system or a list of datum references."""
    letters: list[str] = []
    pending = list(yield_references(references))
    for ref in pending:  # which grows on the way
        letters += map(str, file.get_parameters(ref, "DATUM")[-1:])
        for entity in _TO_DATUM:
            for below in yield_references(file.get_parameters(ref, entity)[1:]):
                if below not in pending:
                    pending.append(below)
    return tuple(dict.fromkeys(letters))
