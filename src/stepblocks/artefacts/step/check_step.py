"""The verdict on a STEP file: values typed, units right, every dimension true to the faces it names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from stepblocks.artefacts.step.characteristics import Characteristic, dimensions_of, tolerances_of
from stepblocks.artefacts.step.exchange import Exchange, read_exchange
from stepblocks.artefacts.step.faces import faces_of
from stepblocks.artefacts.step.units import density_findings, measure_of, untyped_measures
from stepblocks.confined import read_confined
from stepblocks.errors import MetrologyError

ALLOWED = 1e-9  # largest difference between a dimension and its faces [m], and [rad] for angles


@dataclass(frozen=True)
class StepReport:
    """What stands in a STEP file."""

    name: str  # of the file
    schema: tuple[str, ...]
    dimensions: tuple[Characteristic, ...]
    tolerances: tuple[Characteristic, ...]
    materials: tuple[str, ...]  # names
    densities: tuple[float, ...]  # kg/m^3
    textures: tuple[tuple[str, float], ...]  # face and largest Ra of every stated surface texture [m]
    findings: tuple[str, ...]  # one line for everything wrong; none means that the file passes

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
        Every dimension and tolerance with its limits and what its faces measure, the material, and what is wrong: untyped
        values, units that do not fit, dimensions more than 1 nm (1e-9 rad) off their faces.

    Raises
    ------
    MetrologyError
        If the file is not whole ISO 10303-21 text, or is larger than 128 MiB.
    """
    found = read_confined(f"{__name__}:report_in", Path(path), require_ap242, raises=MetrologyError)
    return TypeAdapter(StepReport).validate_python(found)


def report_in(path: Path, require_ap242: bool) -> dict[str, Any]:
    """Check a file, in the confined process."""
    file = read_exchange(path)
    dimensions, tolerances = dimensions_of(file), tolerances_of(file)
    densities, wrong = density_findings(file)
    findings = [*untyped_measures(file), *wrong]
    if require_ap242 and not any(schema.upper().startswith("AP242_MANAGED_MODEL") for schema in file.schema):
        findings.append(f"FILE_SCHEMA: must be AP242, got {', '.join(file.schema) or 'nothing'}")
    findings += [finding for one in dimensions for finding in _dimension_findings(one)]
    for one in tolerances:
        if one.problem:
            findings.append(f"{one.ref} {one.kind}: {one.problem}")
        if require_ap242 and not one.faces:
            findings.append(f"{one.ref} {one.kind}: names no face")
    return {
        **{"name": file.name, "schema": file.schema, "findings": findings},
        **{"dimensions": list(map(asdict, dimensions)), "tolerances": list(map(asdict, tolerances))},
        **{"materials": _materials(file), "densities": [value for _, value in densities], "textures": _textures(file)},
    }


def shown_in(angular: bool) -> tuple[float, str]:
    """Return the unit of a table or message, and how many of it make one of the SI."""
    return (180.0 / math.pi, "deg") if angular else (1e3, "mm")


def _dimension_findings(one: Characteristic) -> Iterator[str]:
    if one.problem == "no value":
        return  # a dimension for reference only carries no value; it is listed, not judged
    label = f"{one.ref} {one.kind}{f' ({one.name})' if one.name else ''}"
    if one.problem:
        yield f"{label}: {one.problem}"
    if one.deviation is not None and abs(one.deviation) > ALLOWED:
        scale, unit = shown_in(one.angular)
        said, had = (f"{value * scale:.9g} {unit}" for value in (one.value, one.value + one.deviation))
        faces, off = ("", "") if one.angular else (f" {', '.join(one.faces)}", f" ({one.deviation * 1e9:+.3f} nm)")
        yield f"{label}: says {said}, but its faces{faces} have {had}{off}"


def _textures(file: Exchange) -> tuple[tuple[str, float], ...]:
    found = []
    for _, values in file.named("PROPERTY_DEFINITION_REPRESENTATION"):
        definition = file.parameters(values[0], "PROPERTY_DEFINITION")
        shown = file.parameters(values[1], "REPRESENTATION")
        if len(definition) != 3 or len(shown) != 3 or str(definition[0]) != "surface texture":
            continue
        for measure in filter(None, (measure_of(file, item) for item in shown[1])):
            found += [(face.ref, measure.si) for face in faces_of(file, definition[2])]
    return tuple(found)


def _materials(file: Exchange) -> tuple[str, ...]:
    listed = (values for _, values in file.named("REPRESENTATION") if len(values) == 3)
    items = (item for values in listed if "material name" in str(values[0]).lower() for item in values[1])
    described = (file.parameters(item, "DESCRIPTIVE_REPRESENTATION_ITEM") for item in items)
    return tuple(str(values[0]) for values in described if values)


def step_table(report: StepReport) -> str:
    """Return everything that a STEP file asks for, as a table."""
    lines = [f"{report.name}: {', '.join(report.schema) or 'no schema'}"]
    if report.materials:
        densities = ", ".join(f"{value:g} kg/m^3" for value in report.densities)
        lines.append(f"material {', '.join(report.materials)} {densities}".rstrip())
    head = f"{'instance':>9} {'kind':18} {'value':>13} {'lower':>11} {'upper':>11} {'unit':7} {'geometry - value':>17}  name"
    lines += ["", head, "-" * len(head)]
    kinds = {one.kind for one in report.dimensions}
    for one in (*report.dimensions, *report.tolerances):
        scale, unit = shown_in(one.angular)
        ends = [value * scale for value in (one.lower, one.upper)] if one.kind in kinds else []
        lower, upper = ["-" if math.isnan(end) else f"{end:+.6g}" for end in ends] or ["", ""]
        value = "-" if math.isnan(one.value) else f"{one.value * scale:.9g}"
        off = math.nan if one.deviation is None else one.deviation
        deviation = "-" if math.isnan(off) else f"{off * scale:.3g} deg" if one.angular else f"{off * 1e9:.3f} nm"
        name = " ".join([one.name, *(f"|{letter}" for letter in one.datums)]).strip()
        limits = f"{lower:>11} {upper:>11} {unit:7} {deviation:>17}"
        lines.append(f"{one.ref:>9} {one.kind:18} {value:>13} {limits}  {name}".rstrip())
    lines.append("")
    lines += [f"WRONG {finding}" for finding in report.findings] or ["nothing wrong found"]
    return "\n".join(lines)
