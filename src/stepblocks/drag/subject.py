"""What `stepblocks drag` drags over: a step height, a profile, or a stimulus of a set under the conditions that its set declares."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stepblocks.contact.counterface import Counterface, Margin, Step
from stepblocks.contact.path.catches import Direction, steepest
from stepblocks.contact.path.profile import profile_path
from stepblocks.contact.path.reference import rounded_step_profile
from stepblocks.contact.path.tip import Ball
from stepblocks.declare import load_declared
from stepblocks.drag.track import Track, margin_track, step_track, track_of
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet
from stepblocks.quantities import format_quantity, parse_quantity
from stepblocks.select import stimulus_files
from stepblocks.tables import read_table, si_column

_PAPER = {
    "tip_radius": 125e-6,
    "edge_radius": 0.0,
    "load": 1.0,
    "friction": 0.15,
    "stiffness": 9.81e3,
    "frequency": 300.0,
    "damping_ratio": 0.02,
}


@dataclass(frozen=True)
class DragSubject:
    """What is dragged over, and with what."""

    name: str  # For the heading and the summary
    track: Track  # Path of the tip
    angle: float  # Critical angle in closed form or by dilation [rad]
    # ``tip_radius`` [m], ``load`` [N], ``friction`` [1], ``stiffness`` [N/m], ``frequency`` [Hz] and
    # ``damping_ratio`` [1]: as given, else as the set declares, else the paper's
    values: dict[str, float]


def subject_of(text: str, given: dict[str, float], backward: bool, where: Path | None) -> DragSubject:
    """Understand what is to be dragged over."""
    if Path(text).suffix.lower() == ".csv":
        return _profile(Path(text), given, backward)
    try:
        height = parse_quantity(text, "length")
    except QuantityError:
        stimuli, stimulus = _find(text, where)
        return declared_subject(stimuli, stimulus, given, backward)
    return plain_subject(height, given, backward)


def plain_subject(height: float, given: dict[str, float], backward: bool = False) -> DragSubject:
    """Drag over a step that is nothing but a height [m]; arguments as for `subject_of`."""
    values = _PAPER | given
    track, angle = _step(height, values["edge_radius"], values["tip_radius"], backward)
    return DragSubject(f"a step of {format_quantity(height, 'length')}", track, angle, values)


def declared_subject(
    stimuli: StimulusSet, stimulus: Part, given: dict[str, float], backward: bool = False
) -> DragSubject:
    """Drag over a stimulus, or with a tip, under the first tip, load and friction of its set unless `given`."""
    grid, place = stimuli.prediction, f"[{stimuli.name}/{stimulus.id}]"
    if "edge_radius" in given:
        raise PipelineError(f"--edge-radius is for a plain step; a stimulus declares its own {place}")
    values = _PAPER | {"load": grid.normal_loads[0], "friction": grid.frictions[0], "stiffness": grid.tool.stiffness}
    if stimulus.ball is not None and "tip_radius" in given:
        raise PipelineError(f"--tip-radius must not be given for a tip, it declares its own {place}")
    if stimulus.crossed and "step_height" in given:
        raise PipelineError(f"--step-height is for a declared tip; a block declares its own {place}")
    ring = stimuli.ring_of(stimulus)
    if ring is not None:
        values |= {"stiffness": ring.stiffness, "frequency": ring.frequency, "damping_ratio": 0.5 * ring.loss_factor}
    values["tip_radius"] = grid.tip_radii[0] if stimulus.ball is None else stimulus.ball.nominal
    if not stimulus.crossed:
        values["step_height"] = grid.step_heights[0]
    values |= given
    face = stimulus.counterface(values.get("step_height"))
    track, angle = _over(face, values["tip_radius"], backward)
    name = stimulus.id if stimulus.sleeve is None else f"probe in {stimulus.id}"
    if not stimulus.crossed:
        name += f" over a step of {format_quantity(values['step_height'], 'length')}"
    elif len(face.ways) > 1:
        name += f", {face.ways[backward]}"
    return DragSubject(name, track, angle, values)


def _over(face: Counterface, ball: float, backward: bool) -> tuple[Track, float]:
    if isinstance(face, Step):
        return _step(face.height, face.edge_radius, ball, backward)
    angle = float(face.angles(ball)[backward])
    if isinstance(face, Margin):
        return margin_track(face.gap, face.opening, face.rise, ball, backward=backward), angle
    return track_of(*face.section(4.0 * ball), Ball(ball), backward=backward), angle


def _step(height: float, edge_radius: float, ball: float, backward: bool) -> tuple[Track, float]:
    if not backward:
        track = step_track(height, ball, edge_radius)
        return track, track.steepest_angle
    return track_of(*rounded_step_profile(height, edge_radius, 4.0 * ball, 401), Ball(ball), backward=True), 0.0


def _profile(path: Path, given: dict[str, float], backward: bool) -> DragSubject:
    if "edge_radius" in given:
        raise PipelineError(f"--edge-radius is for a plain step; a profile has its own [{path}]")
    frame = read_table(path)
    x, z = (si_column(frame, (name,), "length", None, path) for name in ("x", "z"))
    values = _PAPER | given
    ball = Ball(values["tip_radius"])
    direction: Direction = "backward" if backward else "forward"
    try:
        track = track_of(x, z, ball, backward=backward)
        angle = steepest(profile_path(x, z, ball, edges="flat"), direction).angle
    except ContactError as error:
        raise PipelineError(f"{error} [{path}]") from error
    return DragSubject(path.name, track, angle, values)


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
        (stimuli, stimulus)
        for stimuli in map(load_declared, files)
        for stimulus in stimuli.stimuli
        if stimulus.id == identity and wanted in ("", stimuli.name)
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
