"""STEP files read back: by the kernel for volumes and validity, and as text for every dimension against its faces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from stepblocks.artefacts.step.part_file import check_part_step, matched
from stepblocks.artefacts.verdict import Verdict
from stepblocks.cad import kernel
from stepblocks.errors import MetrologyError
from stepblocks.parts.kind import Part
from stepblocks.parts.shapes import solid_volumes

_LENGTH_LIMIT = 1e-9
_ANGLE_LIMIT = 1e-9  # relative


def check_step(stimulus: Part, path: Path) -> Iterator[Verdict]:
    """Check a STEP file."""
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise MetrologyError(f"must be a Part 21 text [{path}]") from error
    if not text.startswith("ISO-10303-21;") or not text.rstrip().endswith("END-ISO-10303-21;"):
        raise MetrologyError(f"must begin and end as ISO 10303-21 [{path}]")
    name = path.name
    report, findings = check_part_step(path, stimulus)
    yield Verdict(name, "schema AP242", 1.0, float(any("AP242" in schema for schema in report.schema)), 0.0, "count")
    bodies = kernel.read_step(path)
    volumes = solid_volumes(stimulus)
    yield Verdict(name, "solids", len(volumes), len(bodies), 0.0, "count")
    for index, (volume, body) in enumerate(zip(volumes, bodies, strict=False), start=1):
        yield Verdict(name, f"volume of solid {index}", volume, kernel.volume(body), 1e-6, "volume", relative=True)
    for one, found in matched(report, stimulus):
        if one.kind in ("flatness", "parallelism"):
            continue
        measured = float("nan") if found is None or found.geometry is None else found.geometry
        if one.quantity == "angle":
            yield Verdict(
                name, f"{one.label}, of its faces", one.nominal, measured, _ANGLE_LIMIT, "angle", relative=True
            )
        else:
            yield Verdict(name, f"{one.label}, of its faces", one.nominal, measured, _LENGTH_LIMIT)
    first = f" ({findings[0]})" if findings else ""
    yield Verdict(name, f"tolerances, material and types as asked for{first}", 0.0, len(findings), 0.0, "count")
