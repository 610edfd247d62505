"""From stimulus files to folders that a simulator loads: one folder per stimulus and simulator."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.errors import PipelineError
from stepblocks.pipeline.build import matches
from stepblocks.pipeline.declared import load_declared
from stepblocks.pipeline.predict import tool_of
from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import MarginBlock

if TYPE_CHECKING:
    from stepblocks.haptics.condition import Condition
    from stepblocks.haptics.plan import RenderingPlan
    from stepblocks.haptics.scenes.scene import Scene
    from stepblocks.stimulus.set import PredictionGrid

__all__ = ["Exported", "assemble_scene", "export_sets"]


@dataclass(frozen=True)
class Exported:
    """One folder that was written.

    Attributes
    ----------
    name : str
        Set and stimulus, ``"set/id"``.
    folder : Path or None
        Where it is; None where the simulator has no use for the part.
    plan : RenderingPlan or None
        How the device renders it.
    remark : str
        Why it was left out; empty where it was not.
    """

    name: str
    folder: Path | None
    plan: RenderingPlan | None
    remark: str = ""


def export_sets(
    files: Sequence[Path],
    simulator: str,
    output: Path,
    device: str | None = None,
    devices: Path | None = None,
    only: str | None = None,
    load: float | None = None,
    friction: float | None = None,
    ball_radius: float | None = None,
    scale: float | None = None,
) -> Iterator[Exported]:
    """Write scenes of every block of the sets.

    Parameters
    ----------
    files : sequence of Path
        Stimulus files.
    simulator : str
        One of `stepblocks.haptics.scenes.registry.SCENE_FORMATS`.
    output : Path
        Folder for ``set/id/simulator``.
    device : str, optional
        Device whose rendering plan sets the scale.
    devices : Path, optional
        File with devices of the user's.
    only : str, optional
        Pattern of stimuli.
    load, friction, ball_radius : float, optional
        Condition [N, 1, m]; the first of the set's prediction grid where omitted.
    scale : float, optional
        Magnification; that of the plan, or 1, where omitted.

    Yields
    ------
    Exported
        As each is done; a part without a working profile is reported, not written.

    Raises
    ------
    StepblocksError
        If a file, a device or a value is wrong, or nothing matches.
    """
    from stepblocks.haptics.devices import device_named, load_devices
    from stepblocks.haptics.scenes.registry import SCENE_FORMATS
    from stepblocks.haptics.scenes.scene import write_common

    if simulator not in SCENE_FORMATS:
        raise PipelineError(f"--for must be one of {', '.join(SCENE_FORMATS)}, got {simulator!r}")
    form, known = SCENE_FORMATS[simulator], load_devices(devices)
    chosen = None if device is None else device_named(device, known)
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise PipelineError(f"scale must be positive and finite, got {scale:g}")
    found = False
    for stimuli in [load_declared(path) for path in files]:
        condition = _condition(stimuli.prediction, load, friction, ball_radius)
        for stimulus in stimuli.stimuli:
            if only is not None and not matches(only, stimuli.name, stimulus.id):
                continue
            found, name = True, f"{stimuli.name}/{stimulus.id}"
            if not isinstance(stimulus, StepBlock | MarginBlock):
                yield Exported(name, None, None, "not a block: a simulator drags over blocks")
                continue
            scene = assemble_scene(stimulus, condition, chosen, scale)
            folder = output / stimuli.name / stimulus.id / simulator
            workshop = folder.with_name(f".partial-{simulator}-{os.getpid()}")
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
            yield Exported(name, folder, scene.plan)
    if not found:
        raise PipelineError(f"--only must match at least one stimulus, got {only!r}")


def _move_in(workshop: Path, folder: Path) -> None:
    """Replace the files of a scene one by one; what else lies in its folder stays."""
    for path in sorted(workshop.rglob("*")):
        if path.is_file():
            target = folder / path.relative_to(workshop)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)


def _condition(
    grid: PredictionGrid, load: float | None, friction: float | None, ball_radius: float | None
) -> Condition:
    from stepblocks.haptics.condition import Condition

    if ball_radius is None and not grid.tip_radii:
        raise PipelineError("--tip-radius must be given for a set whose prediction names no tip_radii, got none")
    return Condition(
        grid.tip_radii[0] if ball_radius is None else ball_radius,
        grid.normal_loads[0] if load is None else load,
        grid.frictions[0] if friction is None else friction,
        tool_of(grid),
    )


def assemble_scene(
    stimulus: StepBlock | MarginBlock,
    condition: Condition,
    device: object = None,
    scale: float | None = None,
) -> Scene:
    """Gather what a scene needs.

    Parameters
    ----------
    stimulus : StepBlock or MarginBlock
        The block.
    condition : Condition
        Under what it is felt.
    device : Device, optional
        Its plan sets the scale.
    scale : float, optional
        Magnification; that of the plan, or 1, where omitted.

    Returns
    -------
    Scene
        Magnified.
    """
    from stepblocks.haptics.devices import Device
    from stepblocks.haptics.event import vibration_events
    from stepblocks.haptics.mesh import Mesh, mesh_solid
    from stepblocks.haptics.pieces import convex_pieces
    from stepblocks.haptics.plan import plan_rendering
    from stepblocks.haptics.renderer.path import centre_path
    from stepblocks.haptics.scenes.scene import Scene
    from stepblocks.solids.build import build_solids

    events = vibration_events(stimulus, condition)
    plan = plan_rendering(device, events[0], condition, scale) if isinstance(device, Device) else None
    size = plan.scale if plan else 1.0 if scale is None else scale
    name, body = build_solids(stimulus)[0]
    whole = mesh_solid(stimulus, name, body)

    def magnified(mesh: Mesh) -> Mesh:
        return Mesh(mesh.name, mesh.vertices * size, mesh.triangles)

    pieces = tuple(magnified(piece) for piece in convex_pieces(stimulus))
    path = centre_path(stimulus, condition.ball_radius).scaled(size)
    return Scene(stimulus, condition, size, magnified(whole), pieces, path, events, plan)
