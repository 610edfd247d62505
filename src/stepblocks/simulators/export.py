"""From stimulus files to folders that a simulator loads: one folder per stimulus and simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from stepblocks.atomic import make_draft_folder, sync_folder
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.select import find_stimulus_files, matches_pattern

if TYPE_CHECKING:
    from stepblocks.parts.kind import Part
    from stepblocks.parts.set import StimulusSet
    from stepblocks.simulators.devices import RenderingPlan
    from stepblocks.simulators.scene import Scene, SceneFormat


@dataclass(frozen=True)
class Exported:
    """One folder that was written."""

    name: str  # of set and stimulus, "set/id"
    folder: Path
    plan: RenderingPlan | None  # how the device renders it, where one was named


def export(
    files: str | Path | Sequence[str | Path],
    simulator: str,
    output: str | Path,
    *,
    device: str | None = None,
    devices: str | Path | None = None,
    only: str | None = None,
    step_height: float | None = None,
    scale: float | Literal["per-block"] | None = None,
    ring: Literal["exponential", "drag"] = "exponential",
    model: str | Path | None = None,
    progress: Callable[[Exported], object] | None = None,
    **felt: float,
) -> list[Exported]:
    """Write scenes of every stimulus of some sets, each folder complete in itself.

    Parameters
    ----------
    files : str, Path or sequence of them
        Stimulus files, or folders of them.
    simulator : str
        One of `stepblocks.simulators.scenes.SCENE_FORMATS`.
    output : str or Path
        Folder for ``set/id/simulator``, or ``set/id/simulator-device``; what else lies there stays.
    device, devices : str, str or Path, optional
        Force-feedback device whose rendering plan sets the scale; TOML file with devices of the
        user's.
    only : str, optional
        Pattern of the stimuli that are meant, such as ``step-0?0``.
    step_height : float, optional
        Of the step under a declared tip [m]; the first of the set's prediction if left out.
    scale : float or "per-block", optional
        Magnification of every scene [1]; if left out 1, or with a device the one that all stimuli
        of a set can have. Each stimulus at the scale of its own plan (``"per-block"``) is
        confounded: springs and travels then tell heights apart.
    ring : str
        Waveform of the WAV files: ``"exponential"``, or ``"drag"`` for that of the time-domain drag
        with the same energy.
    model : str or Path, optional
        model.json of a measured session: friction, spring, edge and ring are then what it taught.
    progress : callable, optional
        Is told of every folder when it is done.
    **felt : float
        ``normal_load`` [N], ``friction`` [1], ``ball_radius`` [m], ``speed`` [m/s]; the first of
        the set's prediction, and 5 mm/s, if left out. A declared tip brings its ball.

    Returns
    -------
    list of Exported
        In the order of the files.

    Raises
    ------
    StepblocksError
        If a file, a device or a value is wrong, or nothing matches.
    """
    from stepblocks.artefacts.model_file import read_model
    from stepblocks.simulators.assemble import assemble_scene, resolve_contact
    from stepblocks.simulators.devices import choose_common_scale, find_device, load_devices
    from stepblocks.simulators.scenes import SCENE_FORMATS

    if simulator not in SCENE_FORMATS:
        raise PipelineError(f"--for must be one of {', '.join(SCENE_FORMATS)}, got {simulator!r}")
    known = load_devices(
        devices
    )  # a file that is missing is told also where no device is asked for
    chosen = None if device is None else find_device(device, known)
    learned = None if model is None else read_model(Path(model))
    done: list[Exported] = []
    for stimuli in [load_declared(path) for path in find_stimulus_files(files)]:
        meant = [
            part
            for part in stimuli.stimuli
            if only is None or matches_pattern(only, stimuli.name, part.id)
        ]
        points = [_choose_operating_point(stimuli, part, felt) for part in meant]
        height = step_height or next(iter(stimuli.prediction.step_heights), None)
        taught: dict[str, Any] = {
            "step_height": height,
            "learned": learned,
            "keep_friction": "friction" in felt,
        }
        shared = None if scale == "per-block" else scale
        if chosen is not None and scale is None and meant:
            each = [
                resolve_contact(part, point, **taught)
                for part, point in zip(meant, points, strict=True)
            ]
            shared = choose_common_scale(chosen, [(events[0], point) for _, point, events in each])
        options = taught | {
            "device": chosen,
            "scale": shared,
            "ring": ring,
            "own_scale": scale == "per-block",
        }
        scenes = [
            assemble_scene(part, point, **options)
            for part, point in zip(meant, points, strict=True)
        ]
        loudest = max((scene.largest_ring_force() for scene in scenes), default=0.0)
        form, place = SCENE_FORMATS[simulator], Path(output) / stimuli.name
        called = simulator if chosen is None else f"{simulator}-{chosen.id}"
        for part, scene in zip(meant, scenes, strict=True):
            _write_scene_folder(place / part.id / called, replace(scene, full_scale=loudest), form)
            done.append(Exported(f"{stimuli.name}/{part.id}", place / part.id / called, scene.plan))
            if progress is not None:
                progress(done[-1])
        alike = {(one.ball_radius, one.stiffness, one.point.friction) for one in scenes}
        if form.write_set is not None and len(scenes) > 1 and len(alike) == 1:
            form.write_set(place / f"{called}-blocks", scenes, called)
    if not done:
        raise PipelineError(f"--only must match at least one stimulus, got {only!r}")
    return done


def _choose_operating_point(
    stimuli: StimulusSet, part: Part, given: Mapping[str, Any]
) -> OperatingPoint:
    """Return the first operating point of a set's prediction, as a part changes it and as it was asked for."""
    grid, worn = stimuli.grid_of(part), stimuli.ring_of(part)
    tool = grid.as_tool()
    if worn is not None:  # how the probe rings with this part on its shank
        tool = replace(tool, frequency=worn.frequency, decay_time=worn.decay_time)
    ball = next(iter(grid.tip_radii), None) if part.ball is None else part.ball.nominal
    if ball is None and "ball_radius" not in given:
        raise PipelineError(
            "--tip-radius must be given for a set whose prediction names no tip_radii, got none"
        )
    own = {"ball_radius": ball, "normal_load": grid.normal_loads[0], "friction": grid.frictions[0]}
    asked = given if part.ball is None else {**given, "ball_radius": ball}
    values: dict[str, Any] = {**own, "tool": tool, "tissue": part.tissue(tool), **asked}
    return OperatingPoint(**values)


def _write_scene_folder(folder: Path, scene: Scene, form: SceneFormat) -> None:
    """Write a folder beside its place, then replace its files one by one: what else lies there stays."""
    from stepblocks.simulators.scene import write_scene

    try:
        with make_draft_folder(folder) as draft:
            write_scene(draft, scene, form)
            sync_folder(draft)
            for path in sorted(file for file in draft.rglob("*") if file.is_file()):
                target = folder / path.relative_to(draft)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
    except OSError as error:
        raise PipelineError(f"the folder cannot be written: {error.strerror} [{folder}]") from error
