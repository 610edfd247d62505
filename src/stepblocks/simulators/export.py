"""From stimulus files to folders that a simulator loads: one folder per stimulus and simulator."""

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import make_draft_folder, move_into_place, sync_folder
from stepblocks.haptics.devices import (
    RenderingPlan,
    choose_common_scale,
    find_device,
    load_devices,
    plan_rendering,
    require_renderable,
)
from stepblocks.records.model import LearnedModel, read_model
from stepblocks.simulators.assemble import Contact, build_scene, lay_out_teeth, resolve_contact
from stepblocks.simulators.conditions import check_overrides
from stepblocks.simulators.scene import (
    Scene,
    SceneFormat,
    find_full_scale_force,
    write_scene,
    write_tooth,
)
from stepblocks.simulators.scenes import SCENE_FORMATS


@dataclass(frozen=True)
class Exported:
    """One folder that was written.

    Attributes
    ----------
    name : str
        Of set and stimulus, ``set/id``.
    folder : Path
        Where it lies.
    plan : RenderingPlan or None
        How the device renders it, where one was named.
    """

    name: str
    folder: Path
    plan: RenderingPlan | None


def export_scenes(
    files: Sets,
    simulator: str,
    output: str | Path,
    *,
    device: str | None = None,
    devices: str | Path | None = None,
    only: str | None = None,
    step_height: float | None = None,
    scale: float | None = None,
    ring: Literal["exponential", "drag"] = "exponential",
    model: str | Path | None = None,
    progress: Callable[[Exported], object] | None = None,
    **overrides: float,
) -> list[Exported]:
    """Write scenes of every stimulus of some sets, each folder complete in itself.

    A scanned margin of a file is also written as one scene of its tooth, in
    ``set/id/simulator-tooth``, where the format has it.

    Scale and full scale of the WAV files are those of the whole set, whatever is written of it.
    Either all folders are written, or none.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them
        Stimulus files, folders of them, or sets.
    simulator : str
        One of `stepblocks.simulators.scenes.SCENE_FORMATS`.
    output : str or Path
        Folder for ``set/id/simulator``, or ``set/id/simulator-device``; what else lies there stays.
    device, devices : str, str or Path, optional
        Force-feedback device whose rendering plans set the scale; TOML file with further devices.
    only : str, optional
        Pattern of the stimuli that are meant, such as ``step-0?0`` or ``paper-*/step-0?0``.
    step_height : float, optional
        Of the step under a declared tip [m]; the first of the set's prediction if left out.
    scale : float, optional
        Magnification of every scene [1]; if left out 1, or with a device the largest that a
        stimulus of the set needs.
    ring : str
        Waveform of the WAV files: ``"exponential"``, or ``"drag"`` for that of the time-domain drag
        with the same energy.
    model : str or Path, optional
        model.json of a measured session: friction, spring, edge and ring are then those of the
        model.
    progress : callable, optional
        Is called with every folder when its files are prepared.
    **overrides : float
        ``normal_load`` [N], ``friction`` [1], ``ball_radius`` [m], ``speed`` [m/s]; the first of
        the set's prediction, and 5 mm/s, if left out. A declared tip brings its ball.

    Returns
    -------
    list of Exported
        In the order of the files.

    Raises
    ------
    StepblocksError
        If a file, a device or a value is wrong, nothing matches, or the device does not render a
        stimulus that is meant.
    """
    PipelineError.require(
        simulator in SCENE_FORMATS,
        f"--for must be one of {', '.join(SCENE_FORMATS)}, got {simulator!r}",
    )
    PipelineError.require(
        ring in ("exponential", "drag"), f"--ring must be one of exponential, drag, got {ring!r}"
    )
    check_overrides(overrides)
    known = load_devices(devices)  # a missing file is named even where no device is asked for
    chosen = None if device is None else find_device(device, known)
    learned = None if model is None else read_model(Path(model))
    sets = load_sets(files)
    contacts = [_resolve_set(one, learned, step_height, ring, overrides) for one, _ in sets]
    form = SCENE_FORMATS[simulator]
    name = simulator if chosen is None else f"{simulator}-{chosen.id}"
    meant = [
        {
            part.id: contact
            for part, contact in zip(stimuli.stimuli, each, strict=True)
            if only is None or matches_pattern(only, stimuli.name, part.id)
        }
        for (stimuli, _), each in zip(sets, contacts, strict=True)
    ]
    scales = [
        scale
        if chosen is None or scale is not None
        else choose_common_scale(chosen, [(one.events[0], one.point) for one in each])
        for each in contacts
    ]
    if chosen is not None:
        require_renderable(
            plan_rendering(chosen, one.events[0], one.point, size)
            for some, size in zip(meant, scales, strict=True)
            for one in some.values()
        )
    done: list[Exported] = []
    with make_draft_folder(Path(output)) as draft:
        for (stimuli, source), each, some, size in zip(sets, contacts, meant, scales, strict=True):
            loudest = max((find_full_scale_force(one.events) for one in each), default=0.0)
            scenes = [build_scene(one, chosen, size, full_scale=loudest) for one in some.values()]
            for identity, scene in zip(some, scenes, strict=True):
                folder = Path(stimuli.name) / identity / name
                (draft / folder).mkdir(parents=True)
                write_scene(draft / folder, scene, form)
                one = Exported(f"{stimuli.name}/{identity}", Path(output) / folder, scene.plan)
                done.append(one)
                if progress is not None:
                    progress(one)
            _write_set(draft / stimuli.name / f"{name}-blocks", scenes, form, name)
            if form.write_tooth and Path(source).is_file():
                for scan, stations in lay_out_teeth(scenes, Path(source).parent):
                    folder = draft / stimuli.name / scan.name / f"{name}-tooth"
                    write_tooth(folder, scan, stations, form)
        PipelineError.require(done, f"--only must match at least one stimulus, got {only!r}")
        _move_into_place(draft, Path(output))
    return done


def _write_set(folder: Path, scenes: list[Scene], form: SceneFormat, name: str) -> None:
    # Write what holds all stimuli of a set, where the format has it and their probes allow it
    alike = {(one.ball_radius, one.stiffness, one.point.friction) for one in scenes}
    if form.write_set and len(scenes) > 1 and (len(alike) == 1 or not form.shares_probe):
        folder.mkdir(parents=True)
        form.write_set(folder, scenes, name)


def _resolve_set(
    stimuli: StimulusSet,
    learned: LearnedModel | None,
    step_height: float | None,
    ring: Literal["exponential", "drag"],
    overrides: dict[str, float],
) -> list[Contact]:
    # Resolve the contacts of all stimuli of a set, those that are not written as well
    height = step_height or next(iter(stimuli.prediction.step_heights), None)
    return [
        resolve_contact(
            part,
            choose_operating_point(stimuli, part, overrides),
            height,
            learned,
            keep_friction="friction" in overrides,
            ring=ring,
        )
        for part in stimuli.stimuli
    ]


def _move_into_place(draft: Path, output: Path) -> None:
    # Move prepared files into their places, after it is sure that each can have its own
    sync_folder(draft)
    files = [path.relative_to(draft) for path in sorted(draft.rglob("*")) if path.is_file()]
    for file in files:
        target = output / file
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
        if blocked := [one for one in target.parents if one.exists() and not one.is_dir()]:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(blocked[0]))
    for file in files:
        (output / file).parent.mkdir(parents=True, exist_ok=True)
        move_into_place(draft / file, output / file)
