"""Check of any STEP file: typed values, sound units, dimensions true to their faces."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from html import unescape
from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter

from stepblocks.artefacts.step.characteristic import Characteristic, Problem
from stepblocks.artefacts.step.dimensions import list_dimensions
from stepblocks.artefacts.step.exchange import Exchange, read_exchange_file
from stepblocks.artefacts.step.faces import find_surfaces_of_aspect
from stepblocks.artefacts.step.tolerances import list_tolerances
from stepblocks.artefacts.step.units import (
    list_mistyped_measures,
    read_densities_and_faults,
    read_measure,
)
from stepblocks.artefacts.step.vertices import list_vertices_off_edges
from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.pages import render_page

ALLOWED = 1e-9  # largest difference between a dimension and its faces [m], and [rad] for angles


class Texture(NamedTuple):
    """Stated surface texture of a face."""

    face: str
    roughness: float  # largest Ra [m]


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
    textures: tuple[Texture, ...]
    findings: tuple[str, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings

    @property
    def unproven(self) -> list[str]:
        """Why nothing wrong proves nothing, one line each; none of a file that states enough."""
        if not self.characteristics:
            return ["holds no dimension and no tolerance"]
        lines = []
        for dimension in self.dimensions:
            if dimension.problem is Problem.NO_VALUE:
                lines.append(f"{dimension.ref} {dimension.kind}: states no value")
        if not any(dimension.deviation is not None for dimension in self.dimensions):
            lines.append("no dimension can be compared with its faces")
        return lines

    @property
    def characteristics(self) -> tuple[Characteristic, ...]:
        """All dimensions, then all tolerances."""
        return (*self.dimensions, *self.tolerances)


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
        f"{__name__}:check_step_in_worker", Path(path), require_ap242, raises=MetrologyError
    )
    return _build_report_validator().validate_python(found)


@cache
def _build_report_validator() -> TypeAdapter[StepReport]:
    """Build what turns the answer of the confined process into a report, on first use."""
    return TypeAdapter(StepReport)


def check_step_in_worker(path: Path, require_ap242: bool) -> dict[str, object]:
    """Check a file; returns the fields of a `StepReport`, runs in the confined process."""
    file = read_exchange_file(path)
    densities, wrong_densities = read_densities_and_faults(file)
    dimensions = list_dimensions(file)
    tolerances = list_tolerances(file)
    findings = [*list_mistyped_measures(file), *wrong_densities]
    if require_ap242 and not _is_ap242(file):
        findings.append(f"FILE_SCHEMA: must be AP242, got {', '.join(file.schema) or 'nothing'}")
    for dimension in dimensions:
        findings += _yield_dimension_faults(dimension)
    for tolerance in tolerances:
        findings += _yield_tolerance_faults(tolerance, require_ap242)
    findings += list_vertices_off_edges(file)
    report = StepReport(
        name=file.name,
        schema=file.schema,
        dimensions=tuple(dimensions),
        tolerances=tuple(tolerances),
        materials=tuple(_yield_material_names(file)),
        densities=tuple(densities),
        textures=tuple(_yield_textures(file)),
        findings=tuple(findings),
    )
    return asdict(report)


def _is_ap242(file: Exchange) -> bool:
    """Tell whether a file states the schema AP242."""
    return any(schema.upper().startswith("AP242_MANAGED_MODEL") for schema in file.schema)


def _yield_dimension_faults(dimension: Characteristic) -> Iterator[str]:
    """Yield what is wrong with a dimension, and where it is not true to its faces."""
    if dimension.problem is Problem.NO_VALUE:
        return  # a dimension for reference only carries no value; it is listed, not judged
    label = f"{dimension.ref} {dimension.kind}"
    if dimension.name:
        label += f" ({dimension.name})"
    if dimension.problem is Problem.PLANES_NOT_PARALLEL:
        yield f"{label}: {dimension.problem}, {', '.join(dimension.faces)}"
    elif dimension.problem:
        yield f"{label}: {dimension.problem}"
    deviation = dimension.deviation
    if deviation is not None and math.isnan(deviation):
        yield f"{label}: the faces that it names have no measure, for want of a unit or a placement"
        return
    if deviation is None or not abs(deviation) > ALLOWED:
        return
    unit = dimension.display_unit
    stated = unit.format_value(dimension.value)
    measured = unit.format_value(dimension.value + deviation)
    if dimension.angular:
        yield f"{label}: says {stated}, but its faces have {measured}"
    else:
        faces = ", ".join(dimension.faces)
        off = f"({deviation * 1e9:+.3f} nm)"
        yield f"{label}: says {stated}, but its faces {faces} have {measured} {off}"


def _yield_tolerance_faults(tolerance: Characteristic, require_face: bool) -> Iterator[str]:
    """Yield what is wrong with a tolerance."""
    if tolerance.problem:
        yield f"{tolerance.ref} {tolerance.kind}: {tolerance.problem}"
    if require_face and not tolerance.faces:
        yield f"{tolerance.ref} {tolerance.kind}: names no face"


def _yield_textures(file: Exchange) -> Iterator[Texture]:
    """Yield the surface textures that are stated, one for each face."""
    for _, parameters in file.yield_instances("PROPERTY_DEFINITION_REPRESENTATION"):
        definition, representation = parameters[:2]
        defined = file.get_parameters(definition, "PROPERTY_DEFINITION")
        if not defined or defined[0] != "surface texture":
            continue
        _, _, owner = defined
        for item in _yield_representation_items(file, representation):
            measure = read_measure(file, item)
            if measure is None:
                continue
            for face in find_surfaces_of_aspect(file, owner):
                yield Texture(face.ref, measure.si)


def _yield_representation_items(file: Exchange, representation: object) -> Iterator[object]:
    """Yield the items of a representation; empty where the reference is not one."""
    parameters = file.get_parameters(representation, "REPRESENTATION")
    if len(parameters) > 1:
        yield from parameters[1]


def _yield_material_names(file: Exchange) -> Iterator[str]:
    """Yield the names of materials that a file states."""
    for ref, parameters in file.yield_instances("REPRESENTATION"):
        if len(parameters) != 3 or "material name" not in str(parameters[0]).lower():
            continue
        for item in _yield_representation_items(file, ref):
            yield from map(str, file.get_parameters(item, "DESCRIPTIVE_REPRESENTATION_ITEM")[:1])


def format_step_requirements(report: StepReport) -> str:
    """Write a table of everything that a STEP file requires."""
    # kinds of which limits are shown
    ranged = {dimension.kind for dimension in report.dimensions}
    return unescape(
        render_page("stepblocks.artefacts", "step.txt.j2", report=report, ranged=ranged)
    ).rstrip()
