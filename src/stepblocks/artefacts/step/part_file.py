"""A part's STEP file against what was asked for, and anybody's as a table."""

from __future__ import annotations

import math
from pathlib import Path

from stepblocks.artefacts.step.part21.characteristics import Characteristic
from stepblocks.artefacts.step.part21.check_step import StepReport, check_step_text
from stepblocks.parts.characteristics import Characteristic as Wanted
from stepblocks.parts.characteristics import characteristics_of
from stepblocks.parts.kind import Part

_ALLOWED = 1e-9


def check_part_step(path: Path, stimulus: Part) -> tuple[StepReport, list[str]]:
    """Check the STEP file of a part: it conforms, and holds every characteristic with its limits."""
    report = check_step_text(path, require_ap242=True)
    findings = list(report.findings)
    left = list(report.dimensions) + list(report.tolerances)
    for one, found in matched(report, stimulus):
        if found is None:
            scale, unit = (180.0 / math.pi, "deg") if one.quantity == "angle" else (1e3, "mm")
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
        findings.append(
            f"material must be {stimulus.material.designation!r}, got {', '.join(report.materials) or 'none'}"
        )
    return report, findings


def matched(report: StepReport, stimulus: Part) -> list[tuple[Wanted, Characteristic | None]]:
    """Find every characteristic of a part in its file."""
    left = list(report.dimensions) + list(report.tolerances)
    pairs: list[tuple[Wanted, Characteristic | None]] = []
    for one in characteristics_of(stimulus):
        if one.kind == "note":
            continue
        label = one.label if one.kind in ("distance", "angle") else ""
        found = next((item for item in left if item.name == label and _agrees(item, one.kind, _wanted(one))), None)
        if found is not None:
            left.remove(found)
        pairs.append((one, found))
    return pairs


def _wanted(one: Wanted) -> tuple[float, ...]:
    return (one.upper,) if one.kind in ("flatness", "parallelism") else (one.nominal, one.lower, one.upper)


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


def step_table(report: StepReport) -> str:
    """Return everything that a STEP file asks for, as a table."""
    lines = [f"{report.name}: {', '.join(report.schema) or 'no schema'}"]
    if report.materials:
        densities = ", ".join(f"{value:g} kg/m^3" for value in report.densities)
        lines.append(f"material {', '.join(report.materials)} {densities}".rstrip())
    head = f"{'instance':>9} {'kind':18} {'value':>13} {'lower':>11} {'upper':>11} {'unit':7} {'geometry - value':>17}  name"
    lines += ["", head, "-" * len(head)]
    for one in (*report.dimensions, *report.tolerances):
        scale = 180.0 / math.pi if one.angular else 1e3
        signed = one.kind in {item.kind for item in report.dimensions}
        lower, upper = (_signed(value * scale) if signed else "" for value in (one.lower, one.upper))
        value = "-" if math.isnan(one.value) else f"{one.value * scale:.9g}"
        if one.deviation is None or math.isnan(one.deviation):
            deviation = "-"
        else:
            deviation = f"{one.deviation * scale:.3g} deg" if one.angular else f"{one.deviation * 1e9:.3f} nm"
        name = " ".join([one.name, *(f"|{letter}" for letter in one.datums)]).strip()
        unit = "deg" if one.angular else "mm"
        lines.append(
            f"{one.ref:>9} {one.kind:18} {value:>13} {lower:>11} {upper:>11} {unit:7} {deviation:>17}  {name}".rstrip()
        )
    lines.append("")
    lines += [f"WRONG {finding}" for finding in report.findings] or ["nothing wrong found"]
    return "\n".join(lines)


def _signed(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:+.6g}"
