"""What a drag goes over, and under what: a height, a file, a declared stimulus or a counterface."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, cast

from stepblocks.contact.counterface import Counterface, Profile, Step, convert_to_counterface
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.files.tables import load_table, read_si_columns, warn_of_notes
from stepblocks.files.text import escape_file_name
from stepblocks.parts.kind import Part
from stepblocks.quantities import format_quantity, is_quantity, parse_quantity
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
    replaced_values: Mapping[str, float],
    backward: bool = False,
    stimuli: Sets | None = None,
    layout: TableLayout = UNDECLARED,
) -> Subject:
    """Find out what is to be dragged over; `replaced_values` [SI] come before all else."""
    if is_quantity(subject) and not hasattr(getattr(subject, "magnitude", None), "__len__"):
        subject = f"{parse_quantity(subject, 'length')!r} m"
    if not isinstance(subject, (str, Path)):
        if hasattr(subject, "__len__"):  # a table or arrays
            subject = load_scan(cast("Scan", subject), layout=layout)
        name = getattr(subject, "id", "a counterface")
        return _make_surface_subject(name, convert_to_counterface(subject), replaced_values)
    path = Path(subject)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        profile = _read_profile(path, layout)
        return _make_surface_subject(
            escape_file_name(path.name), profile, replaced_values, f"[{path}]"
        )
    if suffix not in ("", ".toml") and path.is_file():  # of an instrument
        face = convert_to_counterface(load_scan(path, layout=layout))
        return _make_surface_subject(
            escape_file_name(path.name), face, replaced_values, f"[{path}]"
        )
    refuse_declared_layout(layout, "a step or a declared stimulus", PipelineError)
    try:
        height = parse_quantity(str(subject), "length")
    except QuantityError:
        declared = _find_declared_part(str(subject), stimuli)
        return _make_declared_subject(declared, replaced_values, backward)
    if "step_height" in replaced_values:
        raise PipelineError(f"step_height is for a declared tip, the step here is {subject}")
    return Subject(
        f"a step of {format_quantity(height, 'length')}",
        Step(height, replaced_values.get("edge_radius", 0.0)),
        change_operating_point(PAPER, replaced_values),
    )


def _read_profile(path: Path, layout: TableLayout) -> Profile:
    """Read a profile from the columns x and z of a CSV, their units in their names."""
    wanted = {"x": (["x"], "length", None), "z": (["z"], "length", None)}
    table = load_table(path, layout=layout)
    warn_of_notes(table.notes, path)
    columns = read_si_columns(table.frame, wanted, table.source)
    try:
        return Profile(columns["x"], columns["z"])
    except ContactError as error:
        raise PipelineError(f"{error} [{path}]") from error


def _make_surface_subject(
    name: str, face: Counterface, replaced_values: Mapping[str, float], place_in_message: str = ""
) -> Subject:
    """Make a subject of a surface under the paper's conditions; its shape cannot be changed."""
    for size in ("edge_radius", "step_height"):
        if size in replaced_values:
            rule = f"{size} is for a plain step; {face!r} has its own shape {place_in_message}"
            raise PipelineError(rule.rstrip())
    return Subject(name, face, change_operating_point(PAPER, replaced_values), place_in_message)


class _DeclaredPart(NamedTuple):
    """A part, and the set that declares it."""

    stimuli: StimulusSet
    part: Part


def _make_declared_subject(
    declared: _DeclaredPart, replaced_values: Mapping[str, float], backward: bool
) -> Subject:
    """Make a subject of a part that a tip crosses, or of a tip over a step.

    It is under the first conditions of its set, tip, load and friction, unless the values differ.
    """
    stimuli, part = declared
    _refuse_values_declared_by_part(declared, replaced_values)
    point = choose_operating_point(stimuli, part, {})
    if part.crossed:
        face = part.counterface(None)
        name = part.id
        if len(face.ways) > 1:
            name = f"{name}, {face.ways[bool(backward)]}"
        if len(part.split_edges()) > 1:
            name = f"{name}, first step"
    else:
        height = replaced_values.get("step_height", stimuli.prediction.step_heights[0])
        face = part.counterface(height)
        probe = part.id
        if part.ball is None:
            probe = f"probe in {part.id}"
        name = f"{probe} over a step of {format_quantity(height, 'length')}"
    return Subject(name, face, change_operating_point(point, replaced_values))


def _refuse_values_declared_by_part(
    declared: _DeclaredPart, replaced_values: Mapping[str, float]
) -> None:
    """Refuse a value that the part declares itself."""
    stimuli, part = declared
    rules = {"edge_radius": "--edge-radius is for a plain step; a stimulus declares its own"}
    if part.ball is not None:
        rules["tip_radius"] = "--tip-radius must not be given for a tip, it declares its own"
    if part.crossed:
        rules["step_height"] = "--step-height is for a declared tip; a block declares its own"
    for name, rule in rules.items():
        if name in replaced_values:
            raise PipelineError(f"{rule} [{stimuli.name}/{part.id}]")


def change_operating_point(point: OperatingPoint, values: Mapping[str, float]) -> OperatingPoint:
    """Return the point with the given values; a new coefficient replaces a law of friction."""
    of_tool: dict[str, Any] = {name: values[name] for name in OF_TOOL if name in values}
    changes: dict[str, Any] = {"tool": replace(point.tool, **of_tool)}
    for name, field in OF_POINT.items():
        if name in values:
            changes[field] = values[name]
    if "friction" in changes:
        changes["friction_law"] = None
    return replace(point, **changes)


def _iterate_parts_and_edges(declared: StimulusSet) -> Iterator[Part]:
    """Yield the parts of a set, and behind each with two steps its edges as blocks of their own."""
    for part in declared.stimuli:
        yield part
        edges = part.split_edges()
        if len(edges) > 1:
            yield from edges


def _find_declared_part(address: str, stimuli: Sets | None) -> _DeclaredPart:
    """Find a stimulus by ``ID``, ``SET/ID`` or ``FILE.toml/ID``."""
    folder, _, identity = address.rpartition("/")
    if folder.endswith(".toml"):
        sets, pattern = load_sets(Path(folder)), identity
    elif stimuli is not None or Path("stimuli").is_dir():
        sets, pattern = load_sets(stimuli), address
    else:
        raise PipelineError(f"{_RULE}, or FILE.toml/ID (no folder stimuli here), got {address!r}")
    matches = []
    for declared, _ in sets:
        for part in _iterate_parts_and_edges(declared):
            if matches_pattern(pattern, declared.name, part.id):
                matches.append(_DeclaredPart(declared, part))
    if not matches:
        places = ", ".join(place for _, place in sets)
        identities = ", ".join(part.id for declared, _ in sets for part in declared.stimuli)
        raise PipelineError(
            f"{_RULE}, or declared in {places}, got {address!r}; declared are {identities:.200}"
        )
    if len(matches) > 1:
        names = ", ".join(f"{stimuli.name}/{part.id}" for stimuli, part in matches)
        raise PipelineError(f"stimulus must be one, {identity!r} is several: {names}")
    return matches[0]
