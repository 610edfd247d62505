"""From stimulus files to folders that a simulator loads: one folder per stimulus and simulator."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.predict.predictions import tool_of
from stepblocks.select import matches

if TYPE_CHECKING:
    from stepblocks.artefacts.model_file import LearnedModel
    from stepblocks.contact.operating_point import OperatingPoint
    from stepblocks.contact.rod.cantilever import RodRing
    from stepblocks.parts.conditions import PredictionGrid
    from stepblocks.parts.kind import Part
    from stepblocks.simulators.devices import Device
    from stepblocks.simulators.plan import RenderingPlan
    from stepblocks.simulators.scenes.scene import Scene, SceneFormat


@dataclass(frozen=True)
class Wishes:
    """Under what the scenes are felt; what is None comes from the set's prediction grid, its first value."""

    # Normal load [N], coefficient [1], R [m], and the step under a declared tip [m]; a tip brings its own ball
    load: float | None = None
    friction: float | None = None
    ball_radius: float | None = None
    step_height: float | None = None
    scale: float | None = None  # Magnification [1]; that of the device's plan, or 1
    ring: str = "exponential"  # ``"exponential"`` or ``"drag"``, the simulated waveform
    speed: float = 5e-3  # Of the handle in the simulated drag, and for what was learnt [m/s]


@dataclass(frozen=True)
class Exported:
    """One folder that was written."""

    name: str  # Set and stimulus, ``"set/id"``
    folder: Path  # Where it is
    plan: RenderingPlan | None  # How the device renders it


def export_sets(
    files: Sequence[Path],
    simulator: str,
    output: Path,
    device: str | None = None,
    devices: Path | None = None,
    only: str | None = None,
    wishes: Wishes | None = None,
    model: Path | None = None,
) -> Iterator[Exported]:
    """Write scenes of every stimulus of the sets.

    Parameters
    ----------
    files : sequence of Path
        Stimulus files.
    simulator : str
        One of `stepblocks.simulators.scenes.registry.SCENE_FORMATS`.
    output : Path
        Folder for ``set/id/simulator``.
    device : str, optional
        Device whose rendering plan sets the scale.
    devices : Path, optional
        File with devices of the user's.
    only : str, optional
        Pattern of stimuli.
    wishes : Wishes, optional
        OperatingPoint, scale and ring.
    model : Path, optional
        model.json of a measured session: friction, spring, edge and ring are then what it taught.

    Yields
    ------
    Exported
        As each is done.

    Raises
    ------
    StepblocksError
        If a file, a device or a value is wrong, or nothing matches.
    """
    from stepblocks.artefacts.model_file import read_model
    from stepblocks.simulators.devices import device_named, load_devices
    from stepblocks.simulators.scenes.registry import SCENE_FORMATS

    wishes = wishes or Wishes()
    if simulator not in SCENE_FORMATS:
        raise PipelineError(f"--for must be one of {', '.join(SCENE_FORMATS)}, got {simulator!r}")
    known = load_devices(devices)
    chosen = None if device is None else device_named(device, known)
    if wishes.scale is not None and not (math.isfinite(wishes.scale) and wishes.scale > 0.0):
        raise PipelineError(f"scale must be positive and finite, got {wishes.scale:g}")
    learned = None if model is None else read_model(model)
    found = False
    for stimuli in [load_declared(path) for path in files]:
        for stimulus in stimuli.stimuli:
            if only is not None and not matches(only, stimuli.name, stimulus.id):
                continue
            found = True
            scene = scene_of(stimulus, stimuli.grid_of(stimulus), wishes, chosen, learned, stimuli.ring_of(stimulus))
            folder = output / stimuli.name / stimulus.id / simulator
            _write(folder, scene, SCENE_FORMATS[simulator])
            yield Exported(f"{stimuli.name}/{stimulus.id}", folder, scene.plan)
    if not found:
        raise PipelineError(f"--only must match at least one stimulus, got {only!r}")


def scene_of(
    stimulus: Part,
    grid: PredictionGrid,
    wishes: Wishes,
    device: Device | None = None,
    learned: LearnedModel | None = None,
    ring: RodRing | None = None,
) -> Scene:
    """Gather one scene."""
    from stepblocks.contact.event import vibration_events
    from stepblocks.simulators.drag_ring import with_drag_ring
    from stepblocks.simulators.scenes.assemble import assemble_scene, surface_of
    from stepblocks.simulators.taught import teach

    condition = _condition(stimulus, grid, wishes, ring)
    surface = surface_of(stimulus, wishes.step_height or next(iter(grid.step_heights), None))
    events = vibration_events(surface.id, surface.counterface(), condition)
    if learned is not None:
        surface, condition, events = teach(
            learned, surface, condition, wishes.speed, keep_friction=wishes.friction is not None
        )
    if stimulus.ball is None:
        stimulus = surface
    if wishes.ring == "drag":
        path = surface.counterface().centre_path(condition.ball_radius)
        up, down = (with_drag_ring(event, path, condition, wishes.speed) for event in events)
        events = (up, down)
    return assemble_scene(stimulus, condition, device, wishes.scale, surface, events)


def _write(folder: Path, scene: Scene, form: SceneFormat) -> None:
    from stepblocks.simulators.scenes.scene import write_common

    workshop = folder.with_name(f".partial-{form.name}-{os.getpid()}")
    shutil.rmtree(workshop, ignore_errors=True)
    try:
        workshop.mkdir(parents=True)
        form.write(workshop, scene)
        write_common(workshop, scene, form)
        _move_in(workshop, folder)
    except OSError as error:
        raise PipelineError(f"the folder cannot be written: {error.strerror} [{folder}]") from error
    finally:
        shutil.rmtree(workshop, ignore_errors=True)


def _move_in(workshop: Path, folder: Path) -> None:
    """Replace the files of a scene one by one; what else lies in its folder stays."""
    for path in sorted(workshop.rglob("*")):
        if path.is_file():
            target = folder / path.relative_to(workshop)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)


def _condition(stimulus: Part, grid: PredictionGrid, wishes: Wishes, ring: RodRing | None) -> OperatingPoint:
    from stepblocks.contact.operating_point import OperatingPoint

    ball = wishes.ball_radius if stimulus.ball is None else stimulus.ball.nominal
    if ball is None and not grid.tip_radii:
        raise PipelineError("--tip-radius must be given for a set whose prediction names no tip_radii, got none")
    tool = tool_of(grid)
    if ring is not None:  # how the probe rings with this part on its shank
        tool = replace(tool, frequency=ring.frequency, decay_time=ring.decay_time)
    return OperatingPoint(
        grid.tip_radii[0] if ball is None else ball,
        grid.normal_loads[0] if wishes.load is None else wishes.load,
        grid.frictions[0] if wishes.friction is None else wishes.friction,
        tool,
    )
