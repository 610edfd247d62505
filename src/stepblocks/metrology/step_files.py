"""STEP files read back: by the kernel for volumes and validity, and as text for header, planes and spheres."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from stepblocks.errors import MetrologyError
from stepblocks.metrology.closed_forms import solid_volumes
from stepblocks.metrology.part21.part_file import check_part_step
from stepblocks.metrology.verdict import Verdict
from stepblocks.solids import kernel
from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import CrownOnTooth, MarginBlock
from stepblocks.stimulus.set import Stimulus
from stepblocks.stimulus.sheath import Sheath
from stepblocks.stimulus.tip import HookTip, StraightTip

__all__ = ["check_step"]

_ENTITY = re.compile(r"#(\d+)\s*=\s*([A-Z0-9_]+)\s*\((.*?)\)\s*;", re.DOTALL)
_REFERENCE = re.compile(r"#(\d+)")
_NUMBER = re.compile(r"[-+]?\d+\.\d*(?:E[-+]?\d+)?")


def check_step(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    """Check a STEP file.

    Parameters
    ----------
    stimulus : Stimulus
        What was asked for.
    path : Path
        The file.

    Yields
    ------
    Verdict
        Schema, solids, volumes by the kernel; heights, gaps and radii from the text of the file.

    Raises
    ------
    MetrologyError
        If it is not a STEP file.
    """
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise MetrologyError(f"must be a Part 21 text [{path}]") from error
    if not text.startswith("ISO-10303-21;") or not text.rstrip().endswith("END-ISO-10303-21;"):
        raise MetrologyError(f"must begin and end as ISO 10303-21 [{path}]")
    name = path.name
    yield Verdict(name, "schema AP242", 1.0, float("AP242" in text[: text.index("ENDSEC")]), 0.0, "count")
    bodies = kernel.read_step(path)
    volumes = solid_volumes(stimulus)
    yield Verdict(name, "solids", len(volumes), len(bodies), 0.0, "count")
    for index, (volume, body) in enumerate(zip(volumes, bodies, strict=False), start=1):
        yield Verdict(name, f"volume of solid {index}", volume, kernel.volume(body), 1e-6, "volume", relative=True)
    entities = {int(number): (kind, body) for number, kind, body in _ENTITY.findall(text)}
    yield from _dimensions(stimulus, name, entities)
    yield from _tolerances(stimulus, path)


def _tolerances(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    """Every dimension against the faces it names, and every characteristic of the part with its limits."""
    report, findings = check_part_step(path, stimulus)
    for one in report.dimensions:
        measured = float("nan") if one.geometry is None else one.geometry
        yield Verdict(path.name, f"faces of {one.name or one.kind} {one.ref}", one.value, measured, 1e-9)
    first = f" ({findings[0]})" if findings else ""
    yield Verdict(path.name, f"tolerances, material and types as asked for{first}", 0.0, len(findings), 0.0, "count")


Entities = dict[int, tuple[str, str]]


def _dimensions(stimulus: Stimulus, name: str, entities: Entities) -> Iterator[Verdict]:
    limit = 1e-9
    match stimulus:
        case StepBlock():
            height = stimulus.height.nominal
            yield Verdict(name, "step height", height, _nearest(_planes(entities, 2), height) - _nearest(_planes(entities, 2), 0.0),
                          limit)  # fmt: skip
        case MarginBlock():
            gap, rise = stimulus.marginal_gap.nominal, stimulus.horizontal_discrepancy.nominal
            yield Verdict(name, "marginal gap", gap, _nearest(_planes(entities, 0), gap) - _nearest(_planes(entities, 0), 0.0),
                          limit)  # fmt: skip
            yield Verdict(name, "horizontal discrepancy", rise, _nearest(_planes(entities, 2), rise), limit)
        case CrownOnTooth():
            gap = stimulus.marginal_gap.nominal
            yield Verdict(name, "marginal gap", gap, _nearest(_planes(entities, 2), gap), limit)
        case StraightTip() | HookTip():
            radius = stimulus.ball_radius.nominal
            yield Verdict(
                name,
                "radius of the contact sphere",
                radius,
                _nearest(_radii(entities, "SPHERICAL_SURFACE"), radius),
                1e-7,
            )
        case Sheath():
            yield Verdict(
                name, "length", stimulus.length.nominal, _nearest(_planes(entities, 2), stimulus.length.nominal), limit
            )
            for label, one in (("bore", stimulus.bore), ("outer diameter", stimulus.outer_diameter)):
                diameters = [2.0 * radius for radius in _radii(entities, "CYLINDRICAL_SURFACE")]
                yield Verdict(name, label, one.nominal, _nearest(diameters, one.nominal), limit)


def _nearest(values: list[float], nominal: float) -> float:
    """Value that stands in the file nearest to the nominal; not-a-number if there is none."""
    return min(values, key=lambda value: abs(value - nominal), default=float("nan"))


def _planes(entities: Entities, axis: int) -> list[float]:
    """Positions along an axis of the planes that faces lie on and that are square to it [m]."""
    found = []
    for kind, body in entities.values():
        if kind != "ADVANCED_FACE":
            continue
        surface_kind, surface = entities[int(_REFERENCE.findall(body)[-1])]
        if surface_kind != "PLANE":
            continue
        _, placement = entities[int(_REFERENCE.findall(surface)[0])]
        point, direction = (entities[int(ref)][1] for ref in _REFERENCE.findall(placement)[:2])
        if abs(abs(_numbers(direction)[axis]) - 1.0) < 1e-12:
            found.append(_numbers(point)[axis] * 1e-3)
    return found


def _radii(entities: Entities, surface: str) -> list[float]:
    return [_numbers(body)[-1] * 1e-3 for kind, body in entities.values() if kind == surface]


def _numbers(body: str) -> list[float]:
    return [float(number) for number in _NUMBER.findall(body.rsplit("(", 1)[-1] if "(" in body else body)]
