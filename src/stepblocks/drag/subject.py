"""What a drag goes over, and under what: a height, a file, a declared stimulus or a counterface."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from stepblocks.contact.counterface import Counterface, Profile, Step, take_counterface
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.files.tables import read_si_columns, read_table
from stepblocks.files.text import escape_file_name
from stepblocks.parts.kind import Part
from stepblocks.quantities import format_quantity, parse_quantity
from stepblocks.scans.read import Scan, load_scan

# What of an operating point and of its tool may be given beside the subject
OF_POINT = {"tip_radius": "ball_radius", "load": "normal_load", "friction": "friction"}
OF_TOOL = ("stiffness", "frequency")
_RULE = "stimulus must be a step height such as '25 um', a CSV"


@dataclass(frozen=True)
class Subject:
    """What is dragged over, and under what."""

    name: str  # for the heading and the summary
    face: Counterface
    point: OperatingPoint
    place: str = ""  # file of a profile, for messages


def resolve_subject(
    subject: "Scan | Counterface | Part",
    values: Mapping[str, float],
    backward: bool = False,
    stimuli: Sets | None = None,
) -> Subject:
    """Find out what is to be dragged over; `values` [SI] replace what the paper or the set says."""
    if not isinstance(subject, (str, Path)):
        if hasattr(subject, "__len__"):  # a table or arrays
            subject = load_scan(subject)
        return _take_surface(
            getattr(subject, "id", "a counterface"), take_counterface(subject), values
        )
    if (path := Path(subject)).suffix.lower() == ".csv":
        columns = read_si_columns(
            read_table(path), {name: ([name], "length", None) for name in ("x", "z")}, path
        )
        try:
            profile = Profile(columns["x"], columns["z"])
        except ContactError as error:
            raise PipelineError(f"{error} [{path}]") from error
        return _take_surface(escape_file_name(path.name), profile, values, f"[{path}]")
    if path.suffix.lower() not in ("", ".toml") and path.is_file():  # of an instrument
        return _take_surface(
            escape_file_name(path.name), take_counterface(load_scan(path)), values, f"[{path}]"
        )
    try:
        height = parse_quantity(str(subject), "length")
    except QuantityError:
        return _resolve_declared_part(*_find_declared_part(str(subject), stimuli), values, backward)
    PipelineError.require(
        "step_height" not in values,
        f"step_height is for a declared tip, the step here is {subject}",
    )
    return Subject(
        f"a step of {format_quantity(height, 'length')}",
        Step(height, values.get("edge_radius", 0.0)),
        change_point(PAPER, values),
    )


def _take_surface(
    name: str, face: Counterface, values: Mapping[str, float], place: str = ""
) -> Subject:
    # Take a surface under the paper's conditions; its shape is its own
    for size in ("edge_radius", "step_height"):
        PipelineError.require(
            size not in values,
            f"{size} is for a plain step; {face!r} has its own shape {place}".rstrip(),
        )
    return Subject(name, face, change_point(PAPER, values), place)


def _resolve_declared_part(
    stimuli: StimulusSet, part: Part, values: Mapping[str, float], backward: bool
) -> Subject:
    # Drag over a part, or with it, under the first tip, load, friction and step of its set unless
    # `values` differ
    own = {
        "edge_radius": "--edge-radius is for a plain step; a stimulus declares its own",
        "tip_radius": "--tip-radius must not be given for a tip, it declares its own"
        if part.ball is not None
        else "",
        "step_height": "--step-height is for a declared tip; a block declares its own"
        if part.crossed
        else "",
    }
    for name, rule in own.items():
        PipelineError.require(not rule or name not in values, f"{rule} [{stimuli.name}/{part.id}]")
    point = choose_operating_point(stimuli, part, {})
    height = None if part.crossed else values.get("step_height", stimuli.prediction.step_heights[0])
    face = part.counterface(height)
    name = part.id
    if height is not None:
        probe = name if part.ball is not None else f"probe in {name}"
        name = f"{probe} over a step of {format_quantity(height, 'length')}"
    elif len(face.ways) > 1:
        name = f"{name}, {face.ways[bool(backward)]}"
    return Subject(name, face, change_point(point, values))


def change_point(point: OperatingPoint, values: Mapping[str, float]) -> OperatingPoint:
    """Return the point with the given values; a new coefficient replaces a law of friction."""
    of_tool = {name: values[name] for name in OF_TOOL if name in values}
    changes: dict[str, object] = {
        field: values[name] for name, field in OF_POINT.items() if name in values
    }
    if "friction" in changes:
        changes["friction_law"] = None
    return replace(point, tool=replace(point.tool, **of_tool), **changes)  # type: ignore[arg-type]


def _find_declared_part(text: str, stimuli: Sets | None) -> tuple[StimulusSet, Part]:
    # Find a stimulus by ``ID``, ``SET/ID`` or ``FILE.toml/ID``
    head, _, identity = text.rpartition("/")
    meant = stimuli
    wanted = text
    if head.endswith(".toml"):
        meant = Path(head)
        wanted = identity
    else:
        PipelineError.require(
            stimuli is not None or Path("stimuli").is_dir(),
            f"{_RULE}, or FILE.toml/ID (no folder stimuli here), got {text!r}",
        )
    sets = load_sets(meant)
    found = [
        (one, part)
        for one, _ in sets
        for part in one.stimuli
        if matches_pattern(wanted, one.name, part.id)
    ]
    if len(found) > 1:
        names = ", ".join(f"{one.name}/{part.id}" for one, part in found)
        raise PipelineError(f"stimulus must be one, {identity!r} is several: {names}")
    if not found:
        places = ", ".join(place for _, place in sets)
        known = ", ".join(part.id for one, _ in sets for part in one.stimuli)
        raise PipelineError(
            f"{_RULE}, or declared in {places}, got {text!r}; declared are {known:.200}"
        )
    return found[0]
