"""The STEP file of a part read back: by the kernel for volumes and validity, as text for every dimension against its faces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stepblocks.artefacts.step.check_step import Characteristic, StepReport, check_step, shown_in
from stepblocks.artefacts.verdict import Verdict
from stepblocks.confined import read_confined
from stepblocks.errors import MetrologyError
from stepblocks.parts.characteristics import FORM
from stepblocks.parts.characteristics import Characteristic as Wanted
from stepblocks.parts.kind import Part
from stepblocks.parts.shapes import solid_volumes

# between what is asked for and what stands in the file or is measured on its faces [m]; of angles relative
_ALLOWED = 1e-9


def step_verdicts(stimulus: Part, path: Path) -> Iterator[Verdict]:
    """Check the STEP file of a part."""
    name = path.name
    report, findings = check_part_step(path, stimulus)
    yield Verdict(name, "schema AP242", 1.0, float(any("AP242" in schema for schema in report.schema)), 0.0, "count")
    found_volumes = read_confined(f"{__name__}:volumes_in", path, raises=MetrologyError)["volumes"]
    volumes = solid_volumes(stimulus)
    yield Verdict(name, "solids", len(volumes), len(found_volumes), 0.0, "count")
    for index, (volume, found_volume) in enumerate(zip(volumes, found_volumes, strict=False), start=1):
        yield Verdict(name, f"volume of solid {index}", volume, found_volume, 1e-6, "volume", relative=True)
    for one, found in matched(report, stimulus):
        if one.kind not in FORM:
            measured = math.nan if found is None or found.geometry is None else found.geometry
            quantity, angular = f"{one.label}, of its faces", one.quantity == "angle"
            yield Verdict(name, quantity, one.nominal, measured, _ALLOWED, one.quantity, relative=angular)
    first = f" ({findings[0]})" if findings else ""
    yield Verdict(name, f"tolerances, material and types as asked for{first}", 0.0, len(findings), 0.0, "count")


def volumes_in(path: Path) -> dict[str, Any]:
    """Integrate the volume of each solid by the kernel, in the confined process."""
    from stepblocks.cad import kernel

    return {"volumes": [kernel.volume(body) for body in kernel.read_step(path)]}


def check_part_step(path: Path, stimulus: Part) -> tuple[StepReport, list[str]]:
    """Check the STEP file of a part: it conforms, and holds every characteristic with its limits."""
    report = check_step(path, require_ap242=True)
    findings = list(report.findings)
    left = [*report.dimensions, *report.tolerances]
    for one, found in matched(report, stimulus):
        if found is None:
            scale, unit = shown_in(one.quantity == "angle")
            said = ", ".join(f"{value * scale:.9g}" for value in _wanted(one))
            findings.append(f"{one.label}: must stand in the file as {one.kind} of {said} {unit}")
        else:
            left.remove(found)
            if found in report.dimensions and found.geometry is None and not found.problem:
                findings.append(f"{found.ref} {one.label}: the faces that it names do not determine it")
    findings += [f"{item.ref} {item.kind} {item.value * 1e3:.9g} mm: was not asked for" for item in left]
    if stimulus.has_working_faces:
        flat = {face for item in report.tolerances if item.kind == "flatness" for face in item.faces}
        rough = stimulus.face_demands.roughness
        if dict(report.textures).keys() != flat or any(abs(value - rough) > _ALLOWED for _, value in report.textures):
            findings.append(f"surface texture: every working face must have Ra {rough * 1e6:g} um")
    density = stimulus.material.density
    if not report.densities or any(abs(value / density - 1.0) > 1e-9 for value in report.densities):
        findings.append(f"density must be {density:g} kg/m^3, got {', '.join(map(str, report.densities)) or 'none'}")
    if not report.materials or any(name != stimulus.material.designation for name in report.materials):
        got = ", ".join(report.materials) or "none"
        findings.append(f"material must be {stimulus.material.designation!r}, got {got}")
    return report, findings


def matched(report: StepReport, stimulus: Part) -> list[tuple[Wanted, Characteristic | None]]:
    """Find every characteristic of a part in its file."""
    left = [*report.dimensions, *report.tolerances]
    pairs: list[tuple[Wanted, Characteristic | None]] = []
    for one in (one for one in stimulus.characteristics() if one.kind not in ("note", "roughness")):
        label = one.label if one.kind in ("distance", "angle") else ""
        found = next((item for item in left if item.name == label and _agrees(item, one.kind, _wanted(one))), None)
        if found is not None:
            left.remove(found)
        pairs.append((one, found))
    return pairs


def _wanted(one: Wanted) -> tuple[float, ...]:
    return (one.upper,) if one.kind in FORM else (one.nominal, one.lower, one.upper)


# What a kind of ours is called in the file, after the surface that carries it
_NAMES = {
    "distance": ("linear distance", "linear distance centre outer"),
    "angle": ("angular size", "angular location"),
    "radius": ("radius", "spherical radius", "toroidal major radius"),
}


def _agrees(item: Characteristic, kind: str, wanted: tuple[float, ...]) -> bool:
    names = _NAMES.get(kind, (kind,))
    got = (item.value,) if len(wanted) == 1 else (item.value, item.lower, item.upper)
    return item.kind in names and all(abs(a - b) <= _ALLOWED for a, b in zip(got, wanted, strict=True))
