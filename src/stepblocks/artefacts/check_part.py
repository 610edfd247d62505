"""The STEP file of a part against what the part asks for."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from stepblocks.artefacts.step.characteristic import Characteristic, choose_display_unit
from stepblocks.artefacts.step.check_step import ALLOWED, StepReport, check_step
from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.parts.characteristics import FORM, Characteristic as RequiredCharacteristic
from stepblocks.parts.kind import Part
from stepblocks.parts.verdict import Finding, Verdict

_VOLUME_LIMIT = 1e-6  # volume of a solid against its closed form, relative
_DENSITY_LIMIT = 1e-9  # stated density against that of the material, relative
_OF_WORKING_FACES = ("flatness_lower", "flatness_upper")
_NOT_ON_FACES = ("note", "roughness")  # kinds that stand in the file in another way
# What a kind of ours is called in the file, after the surface that carries it
_KINDS_IN_FILE = {
    "distance": ("linear distance", "linear distance centre outer"),
    "angle": ("angular size", "angular location"),
    "radius": ("radius", "spherical radius", "toroidal major radius"),
}


class PartCheck(NamedTuple):
    """What stands in the STEP file of a part, and what is wrong with it, a line each."""

    report: StepReport
    findings: list[str]


@dataclass(frozen=True)
class Match:
    """A characteristic of a part, and what states it in the file; None where nothing does."""

    required: RequiredCharacteristic
    stated: Characteristic | None


def judge_part_step(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge schema, solids, dimensions and tolerances of the STEP file of a part."""
    report, findings = check_part_step(path, part)
    is_ap242 = any("AP242" in schema for schema in report.schema)
    yield Finding("schema AP242", 1.0, float(is_ap242), 0.0, "count")
    yield from _judge_volumes(path, part)
    for match in match_characteristics(report, part):
        if match.required.kind not in FORM:
            yield _judge_measured_faces(match)
    first = f" ({findings[0]})" if findings else ""
    yield Finding(
        f"tolerances, material and types as asked for{first}", 0.0, len(findings), 0.0, "count"
    )


def _judge_volumes(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge the number of the solids, and the volume of each by the kernel."""
    volumes = part.volumes()
    content = read_confined(f"{__name__}:measure_volumes_in_worker", path, raises=MetrologyError)
    measured = content["volumes"]
    yield Finding("solids", len(volumes), len(measured), 0.0, "count")
    pairs = zip(volumes, measured, strict=False)
    for number, (volume, measured_volume) in enumerate(pairs, start=1):
        yield Finding(
            f"volume of solid {number}",
            volume,
            measured_volume,
            _VOLUME_LIMIT,
            "volume",
            relative=True,
        )


def measure_volumes_in_worker(path: Path) -> dict[str, object]:
    """Integrate the volume of each solid [m^3] by the kernel; runs in the confined process."""
    from stepblocks.cad import kernel

    bodies = kernel.read_step_solids(path)
    return {"volumes": list(map(kernel.compute_volume, bodies))}


def _judge_measured_faces(match: Match) -> Verdict:
    """Judge a dimension by what its faces measure."""
    required = match.required
    measured = math.nan
    if match.stated is not None and match.stated.geometry is not None:
        measured = match.stated.geometry
    return Finding(
        f"{required.label}, of its faces",
        required.nominal,
        measured,
        ALLOWED,
        required.quantity,
        relative=required.quantity == "angle",
    )


def check_part_step(path: Path, stimulus: Part) -> PartCheck:
    """Check that the STEP file of a part conforms and holds every characteristic.

    Parameters
    ----------
    path : Path
        The file.
    stimulus : Part
        What was asked for.

    Returns
    -------
    PartCheck
        The report of the file, and what is wrong with it.

    Raises
    ------
    MetrologyError
        If the file is not whole ISO 10303-21 text.
    """
    report = check_step(path, require_ap242=True)
    matches = match_characteristics(report, stimulus)
    findings = [*report.findings]
    for match in matches:
        findings += _yield_match_faults(match, report)
    findings += _yield_unrequired_characteristics(report, matches)
    if stimulus.has_working_faces:
        findings += _yield_texture_faults(report, stimulus, matches)
    findings += _yield_density_faults(report, stimulus)
    findings += _yield_material_faults(report, stimulus)
    return PartCheck(report, findings)


def match_characteristics(report: StepReport, stimulus: Part) -> list[Match]:
    """Find every characteristic of a part in its file, each line of the file once."""
    unmatched = list(report.characteristics)
    matches = []
    for required in stimulus.characteristics():
        if required.kind in _NOT_ON_FACES:
            continue
        stated = _find_stated_characteristic(required, unmatched)
        if stated is not None:
            unmatched.remove(stated)
        matches.append(Match(required, stated))
    return matches


def _find_stated_characteristic(
    required: RequiredCharacteristic, candidates: Sequence[Characteristic]
) -> Characteristic | None:
    """Find the first line of the file that states a characteristic, by name and limits."""
    name = required.label if required.kind in ("distance", "angle") else ""
    for candidate in candidates:
        if candidate.name == name and _agrees_with_required(candidate, required):
            return candidate
    return None


def _agrees_with_required(stated: Characteristic, required: RequiredCharacteristic) -> bool:
    """Tell whether kind, value and limits of a line of the file are those of a characteristic."""
    if stated.kind not in _KINDS_IN_FILE.get(required.kind, (required.kind,)):
        return False
    if required.kind in FORM:
        return abs(stated.value - required.upper) <= ALLOWED
    has_nominal = abs(stated.value - required.nominal) <= ALLOWED
    has_lower = abs(stated.lower - required.lower) <= ALLOWED
    has_upper = abs(stated.upper - required.upper) <= ALLOWED
    return has_nominal and has_lower and has_upper


def _yield_match_faults(match: Match, report: StepReport) -> Iterator[str]:
    """Yield that a characteristic is missing, or that its faces do not determine it."""
    required = match.required
    stated = match.stated
    if stated is None:
        yield (
            f"{required.label}: must stand in the file as {required.kind} of "
            f"{_format_required_values(required)}"
        )
    elif stated in report.dimensions and stated.geometry is None and not stated.problem:
        yield f"{stated.ref} {required.label}: the faces that it names do not determine it"


def _format_required_values(required: RequiredCharacteristic) -> str:
    """Write nominal value and limits of a characteristic with their unit; of a form its zone."""
    values = [required.nominal, required.lower, required.upper]
    if required.kind in FORM:
        values = [required.upper]
    unit = choose_display_unit(required.quantity == "angle")
    texts = [f"{value * unit.per_si:.9g}" for value in values]
    return f"{', '.join(texts)} {unit.name}"


def _yield_unrequired_characteristics(
    report: StepReport, matches: Sequence[Match]
) -> Iterator[str]:
    """Yield what the file states and the part does not require."""
    unmatched = list(report.characteristics)
    for match in matches:
        if match.stated is not None:
            unmatched.remove(match.stated)
    for stated in unmatched:
        yield f"{stated.ref} {stated.kind} {stated.value * 1e3:.9g} mm: was not asked for"


def _yield_texture_faults(
    report: StepReport, part: Part, matches: Sequence[Match]
) -> Iterator[str]:
    """Yield that not every working face, or another one, has the texture of the part."""
    working_faces: set[str] = set()
    for match in matches:
        if match.stated is not None and match.required.key in _OF_WORKING_FACES:
            working_faces.update(match.stated.faces)
    roughness = part.face_demands["roughness"].upper
    textured_faces = {texture.face for texture in report.textures}
    # NaN, of a roughness without its unit, is within no limit
    is_as_rough = all(abs(texture.roughness - roughness) <= ALLOWED for texture in report.textures)
    if textured_faces != working_faces or not is_as_rough:
        yield f"surface texture: every working face must have Ra {roughness * 1e6:g} um"


def _yield_density_faults(report: StepReport, part: Part) -> Iterator[str]:
    """Yield that the file does not state the density of the material, or one where it has none."""
    found = ", ".join(map(str, report.densities)) or "none"
    density = part.material.density
    if density is None:
        if report.densities:
            yield f"density must not be stated, got {found}"
        return
    ratios = [value / density.value for value in report.densities]
    is_as_dense = all(abs(ratio - 1.0) <= _DENSITY_LIMIT for ratio in ratios)
    if not ratios or not is_as_dense:
        yield f"density must be {density.value:g} kg/m^3, got {found}"


def _yield_material_faults(report: StepReport, part: Part) -> Iterator[str]:
    """Yield that the file does not name the material of the part, or names another."""
    name = part.material.order_text
    if set(report.materials) != {name}:
        found = ", ".join(report.materials) or "none"
        yield f"material must be {name!r}, got {found}"
