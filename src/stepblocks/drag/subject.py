"""What is dragged over, and under what: a step height, a profile, or a stimulus under the conditions that its set declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from stepblocks.contact.counterface import Counterface, Profile, Step
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.declare import load_declared
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet
from stepblocks.quantities import format_quantity, parse_quantity
from stepblocks.select import stimulus_files
from stepblocks.tables import read_table, si_column

# what may be given beside the subject [SI]: where it goes in an operating point, and in its tool
_OF_POINT = {"tip_radius": "ball_radius", "load": "normal_load", "friction": "friction"}
_OF_TOOL = ("stiffness", "frequency")


@dataclass(frozen=True)
class Subject:
    """A counterface, an operating point and a direction."""

    name: str  # for the heading and the summary
    face: Counterface
    point: OperatingPoint
    backward: bool = False
    place: str = ""  # file of a profile, for messages


def subject_of(
    given: str | Path | Counterface, values: Mapping[str, float], backward: bool = False, where: Path | None = None
) -> Subject:
    """Understand what is to be dragged over; `values` [SI] take the place of what the paper or the set says."""
    if isinstance(given, Counterface):
        return Subject("a counterface", given, _changed(PAPER, values), backward)
    if Path(given).suffix.lower() == ".csv":
        return _profile(Path(given), values, backward)
    try:
        height = parse_quantity(str(given), "length")
    except QuantityError:
        return declared_subject(*_find(str(given), where), values, backward)
    face = Step(height, values.get("edge_radius", 0.0))
    return Subject(f"a step of {format_quantity(height, 'length')}", face, _changed(PAPER, values), backward)


def declared_subject(stimuli: StimulusSet, part: Part, values: Mapping[str, float], backward: bool = False) -> Subject:
    """Drag over a part, or with it, under the first tip, load, friction and step of its set unless `values` differ."""
    grid, place = stimuli.grid_of(part), f"[{stimuli.name}/{part.id}]"
    if "edge_radius" in values:
        raise PipelineError(f"--edge-radius is for a plain step; a stimulus declares its own {place}")
    if part.ball is not None and "tip_radius" in values:
        raise PipelineError(f"--tip-radius must not be given for a tip, it declares its own {place}")
    if part.crossed and "step_height" in values:
        raise PipelineError(f"--step-height is for a declared tip; a block declares its own {place}")
    ball = grid.tip_radii[0] if part.ball is None else part.ball.nominal
    height = None if part.crossed else values.get("step_height", grid.step_heights[0])
    tool, ring = Tool(**grid.tool.model_dump()), stimuli.ring_of(part)
    tool = tool if ring is None else ring.as_tool(tool)
    point = OperatingPoint(ball, grid.normal_loads[0], grid.frictions[0], tool)
    face, name = part.counterface(height), part.id
    if height is not None:
        probe = name if part.ball is not None else f"probe in {name}"
        name = f"{probe} over a step of {format_quantity(height, 'length')}"
    elif len(face.ways) > 1:
        name = f"{name}, {face.ways[backward]}"
    return Subject(name, face, _changed(point, values), backward)


def _changed(point: OperatingPoint, values: Mapping[str, float]) -> OperatingPoint:
    tool = replace(point.tool, **{name: values[name] for name in _OF_TOOL if name in values})
    return replace(point, tool=tool, **{field: values[name] for name, field in _OF_POINT.items() if name in values})


def _profile(path: Path, values: Mapping[str, float], backward: bool) -> Subject:
    if "edge_radius" in values:
        raise PipelineError(f"--edge-radius is for a plain step; a profile has its own [{path}]")
    frame = read_table(path)
    x, z = (si_column(frame, (name,), "length", None, path) for name in ("x", "z"))
    try:
        return Subject(path.name, Profile(x, z), _changed(PAPER, values), backward, f"[{path}]")
    except ContactError as error:
        raise PipelineError(f"{error} [{path}]") from error


def _find(text: str, where: Path | None) -> tuple[StimulusSet, Part]:
    """Find a stimulus by ``ID``, ``SET/ID`` or ``FILE.toml/ID``."""
    head, _, identity = text.rpartition("/")
    if head.endswith(".toml"):
        files, wanted = [Path(head)], ""
    elif where is None and not Path("stimuli").is_dir():
        raise PipelineError(
            f"stimulus must be a step height such as '25 um', a CSV, or FILE.toml/ID (no folder stimuli here), got {text!r}"
        )
    else:
        files, wanted = stimulus_files([where] if where else []), head
    found = [
        (stimuli, part)
        for stimuli in map(load_declared, files)
        for part in stimuli.stimuli
        if part.id == identity and wanted in ("", stimuli.name)
    ]
    if len(found) > 1:
        names = ", ".join(f"{stimuli.name}/{identity}" for stimuli, _ in found)
        raise PipelineError(f"stimulus must be one, {identity!r} is several: {names}")
    if not found:
        places = ", ".join(str(file) for file in files)
        raise PipelineError(
            f"stimulus must be a step height such as '25 um', a CSV, or declared in {places}, got {text!r}"
        )
    return found[0]
