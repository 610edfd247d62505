"""The verdict on a STEP file: values typed, units right, every dimension true to the faces it names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from stepblocks.artefacts.step.part21.characteristics import Characteristic, dimensions_of, tolerances_of
from stepblocks.artefacts.step.part21.exchange import Exchange, read_exchange
from stepblocks.artefacts.step.part21.faces import faces_of
from stepblocks.artefacts.step.part21.units import density_findings, measure_of, untyped_measures

ALLOWED = 1e-9  # Largest difference between a dimension and its faces [m], and [rad] for angles


@dataclass(frozen=True)
class StepReport:
    """What stands in a STEP file."""

    name: str  # File name
    schema: tuple[str, ...]  # Its schema
    dimensions: tuple[Characteristic, ...]  # What it asks for
    tolerances: tuple[Characteristic, ...]
    materials: tuple[str, ...]  # Names of materials
    densities: tuple[float, ...]  # Densities [kg/m^3]
    textures: tuple[tuple[str, float], ...]  # Face and largest Ra of every stated surface texture [m]
    findings: tuple[str, ...]  # One line for everything wrong; none means that the file passes

    @property
    def passes(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings


def check_step_text(path: Path, require_ap242: bool = False) -> StepReport:
    """Check a STEP file without the kernel that wrote it."""
    file = read_exchange(path)
    dimensions, tolerances = dimensions_of(file), tolerances_of(file)
    densities, wrong = density_findings(file)
    findings = [*untyped_measures(file), *wrong]
    if require_ap242 and not any(schema.upper().startswith("AP242_MANAGED_MODEL") for schema in file.schema):
        findings.append(f"FILE_SCHEMA: must be AP242, got {', '.join(file.schema) or 'nothing'}")
    for one in dimensions:
        findings.extend(_dimension_findings(one))
    for one in tolerances:
        if one.problem:
            findings.append(f"{one.ref} {one.kind}: {one.problem}")
        if require_ap242 and not one.faces:
            findings.append(f"{one.ref} {one.kind}: names no face")
    return StepReport(
        file.name,
        file.schema,
        tuple(dimensions),
        tuple(tolerances),
        _materials(file),
        tuple(value for _, value in densities),
        _textures(file),
        tuple(findings),
    )


def _dimension_findings(one: Characteristic) -> list[str]:
    findings = []
    label = f"{one.ref} {one.kind}{f' ({one.name})' if one.name else ''}"
    if one.problem == "no value" and math.isnan(one.value):
        return []  # a dimension for reference only carries no value; it is listed, not judged
    if one.problem:
        findings.append(f"{label}: {one.problem}")
    if one.deviation is not None and abs(one.deviation) > ALLOWED:
        if one.angular:
            findings.append(
                f"{label}: says {math.degrees(one.value):.9g} deg, but its faces have "
                f"{math.degrees(one.value + one.deviation):.9g} deg"
            )
        else:
            findings.append(
                f"{label}: says {one.value * 1e3:.9g} mm, but its faces {', '.join(one.faces)} have "
                f"{(one.value + one.deviation) * 1e3:.9g} mm ({one.deviation * 1e9:+.3f} nm)"
            )
    return findings


def _textures(file: Exchange) -> tuple[tuple[str, float], ...]:
    found = []
    for _, values in file.named("PROPERTY_DEFINITION_REPRESENTATION"):
        definition, shown = (
            file.parameters(values[0], "PROPERTY_DEFINITION"),
            file.parameters(values[1], "REPRESENTATION"),
        )
        if len(definition) != 3 or len(shown) != 3 or str(definition[0]) != "surface texture":
            continue
        for measure in filter(None, (measure_of(file, item) for item in shown[1])):
            found += [(face.ref, measure.si) for face in faces_of(file, definition[2])]
    return tuple(found)


def _materials(file: Exchange) -> tuple[str, ...]:
    names = []
    for _, values in file.named("REPRESENTATION"):
        if len(values) == 3 and "material name" in str(values[0]).lower():
            for item in values[1]:
                described = file.parameters(item, "DESCRIPTIVE_REPRESENTATION_ITEM")
                if described:
                    names.append(str(described[0]))
    return tuple(names)
