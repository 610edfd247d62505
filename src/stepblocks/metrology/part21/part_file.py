"""A part's STEP file against what was asked for, and anybody's as a table."""

from __future__ import annotations

import math
from pathlib import Path

from stepblocks.machining.characteristics import characteristics_of
from stepblocks.metrology.part21.characteristics import Characteristic
from stepblocks.metrology.part21.check_step import StepReport, check_step_text
from stepblocks.stimulus.set import Stimulus

__all__ = ["check_part_step", "step_table"]

_ALLOWED = 1e-9


def check_part_step(path: Path, stimulus: Stimulus) -> tuple[StepReport, list[str]]:
    """Check the STEP file of a part: it conforms, and holds every characteristic with its limits.

    Parameters
    ----------
    path : Path
        The file.
    stimulus : Stimulus
        What was asked for.

    Returns
    -------
    report : StepReport
        What stands in the file.
    findings : list of str
        Everything wrong, one line each; empty if the file passes.

    Raises
    ------
    MetrologyError
        If the file cannot be read.
    """
    report = check_step_text(path, require_ap242=True)
    findings = list(report.findings)
    left = list(report.dimensions) + list(report.tolerances)
    for one in characteristics_of(stimulus):
        if one.kind == "note":
            continue
        wanted = (one.upper,) if one.kind in ("flatness", "parallelism") else (one.nominal, one.lower, one.upper)
        label = one.label if one.kind == "distance" else ""
        found = next((item for item in left if item.name == label and _agrees(item, one.kind, wanted)), None)
        if found is None:
            findings.append(
                f"{one.label}: must stand in the file as {one.kind} of {', '.join(f'{v * 1e3:.9g}' for v in wanted)} mm"
            )
        else:
            left.remove(found)
    findings += [f"{item.ref} {item.kind} {item.value * 1e3:.9g} mm: was not asked for" for item in left]
    density = stimulus.material.density
    if not report.densities or any(abs(value / density - 1.0) > 1e-9 for value in report.densities):
        findings.append(f"density must be {density:g} kg/m^3, got {', '.join(map(str, report.densities)) or 'none'}")
    if not report.materials or any(name != stimulus.material.designation for name in report.materials):
        findings.append(
            f"material must be {stimulus.material.designation!r}, got {', '.join(report.materials) or 'none'}"
        )
    return report, findings


def _agrees(item: Characteristic, kind: str, wanted: tuple[float, ...]) -> bool:
    name = {"distance": "linear distance"}.get(kind, kind)
    got = (item.value,) if len(wanted) == 1 else (item.value, item.lower, item.upper)
    return item.kind == name and all(abs(a - b) <= _ALLOWED for a, b in zip(got, wanted, strict=True))


def step_table(report: StepReport) -> str:
    """Return everything that a STEP file asks for, as a table.

    Parameters
    ----------
    report : StepReport
        From `check_step_text`.

    Returns
    -------
    str
        Lines without a trailing newline; lengths in mm, angles in degrees, deviations in nm.
    """
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
