"""From stimulus files to folders that a simulator loads: one folder per stimulus and simulator."""

import errno
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import HapticsError, PipelineError
from stepblocks.files.atomic import make_draft_folder, move_into_place, sync_folder
from stepblocks.haptics.devices import (
    Device,
    RenderingPlan,
    choose_common_scale,
    get_device,
    load_devices,
    plan_rendering,
    require_renderable,
)
from stepblocks.parts.kind import Part
from stepblocks.quantities import format_quantity
from stepblocks.records.model import LearnedModel, read_model
from stepblocks.simulators.assemble import (
    Contact,
    build_scene,
    iterate_scanned_teeth,
    resolve_contact,
)
from stepblocks.simulators.conditions import refuse_bad_overrides, refuse_bad_scale
from stepblocks.simulators.scene import (
    Scene,
    SceneFormat,
    compute_full_scale_force,
    write_scene,
    write_tooth_scene,
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
    simulator: str | Sequence[str],
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

    A block with two steps is written as two, ``id-first-step`` and ``id-second-step``, each with
    one edge, since a scene rings at one. A scanned margin of a file is also written as one scene of
    its tooth, in ``set/id/simulator-tooth``, where the format has it.

    Scale and full scale of the WAV files are those of the whole set, whatever is written of it.
    Either all folders are written, or none.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them
        Stimulus files, folders of them, or sets.
    simulator : str or sequence of str
        One or several of `stepblocks.simulators.scenes.SCENE_FORMATS`.
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
    forms = _get_scene_formats(simulator)
    if ring not in ("exponential", "drag"):
        raise PipelineError(f"--ring must be one of exponential, drag, got {ring!r}")
    refuse_bad_overrides(overrides)
    if scale is not None:
        refuse_bad_scale(scale)
    profiles = load_devices(devices)  # a missing file is named even where no device is asked for
    order = _ExportOptions(
        forms=forms,
        device=None if device is None else get_device(device, profiles),
        scale=scale,
        only=only,
    )
    learned = None if model is None else read_model(Path(model))
    batches = []
    for declared, source in load_sets(files):
        stimuli = _split_two_step_blocks(declared.keep_felt())
        contacts = _resolve_set_contacts(stimuli, learned, step_height, ring, overrides)
        batches.append(_make_batch(stimuli, source, contacts, order))
    if step_height is not None:
        _refuse_idle_step_height(step_height, batches)
    if order.device is not None:
        require_renderable(_iterate_rendering_plans(order.device, batches))
    exported: list[Exported] = []
    with make_draft_folder(Path(output)) as draft:
        for batch in batches:
            scenes = _build_batch_scenes(batch, order)
            for identity, scene in scenes.items():
                for form in order.forms:
                    folder = Path(batch.stimuli.name) / identity / order.format_folder_name(form)
                    (draft / folder).mkdir(parents=True)
                    write_scene(draft / folder, scene, form)
                    written = Exported(
                        f"{batch.stimuli.name}/{identity}", Path(output) / folder, scene.plan
                    )
                    exported.append(written)
                    if progress is not None:
                        progress(written)
            for form in order.forms:
                _write_whole_set(draft, batch, list(scenes.values()), form, order)
        if not exported:
            _raise_for_empty_export(batches, only)
        _move_files_into_place(draft, Path(output))
    return exported


def _split_two_step_blocks(stimuli: StimulusSet) -> StimulusSet:
    """Return a set with a block of its own for each edge of a block with two steps.

    A scene rings at one edge: a second one in its meshes would be silent.
    """
    parts: list[Part] = []
    for part in stimuli.stimuli:
        parts += part.split_edges()
    counts = Counter(part.id for part in parts)
    repeated = [name for name, count in sorted(counts.items()) if count > 1]
    if repeated:
        raise PipelineError(
            "the edges of a block with two steps must have names that no other stimulus of "
            f"{stimuli.name} has, got {', '.join(repeated)} twice"
        )
    return stimuli.with_parts(parts)


def _refuse_idle_step_height(step_height: float, batches: "Sequence[_SetExport]") -> None:
    """Refuse the height of a step under a tip [m] where no set declares a tip."""
    for batch in batches:
        if any(not part.crossed for part in batch.stimuli.stimuli):
            return
    raise HapticsError(
        "a step height is for the step under a tip: the sets declare none, got "
        f"{format_quantity(step_height, 'length')}"
    )


def _raise_for_empty_export(batches: "Sequence[_SetExport]", only: str | None) -> None:
    """Say why nothing is exported."""
    if only is None:
        names = ", ".join(batch.stimuli.name for batch in batches)
        raise PipelineError(f"a scene needs a stimulus that is felt, got none in {names}")
    raise PipelineError(f"--only must match at least one stimulus, got {only!r}")


@dataclass(frozen=True)
class _ExportOptions:
    """What is to be written of every set."""

    forms: tuple[SceneFormat, ...]
    device: Device | None
    scale: float | None  # asked for; None leaves it to the device, or is 1
    only: str | None  # pattern of the stimuli that are meant

    def format_folder_name(self, form: SceneFormat) -> str:
        """Name each stimulus's folder for a simulator."""
        if self.device is None:
            return form.name
        return f"{form.name}-{self.device.id}"


def _get_scene_formats(simulator: str | Sequence[str]) -> tuple[SceneFormat, ...]:
    """Find the formats of one or several simulators, each once, in the order in which they came."""
    names = list(simulator)
    if isinstance(simulator, str):
        names = [simulator]
    known = ", ".join(SCENE_FORMATS)
    if not names:
        raise PipelineError(f"--for must be one of {known}, got none")
    for name in names:
        if name not in SCENE_FORMATS:
            raise PipelineError(f"--for must be one of {known}, got {name!r}")
    return tuple(SCENE_FORMATS[name] for name in dict.fromkeys(names))


@dataclass(frozen=True)
class _SetExport:
    """A set with the contacts of all its stimuli, and of those that are meant."""

    stimuli: StimulusSet
    source: str  # file of the set, or what stands for it
    contacts: list[Contact]  # of all stimuli: scale and loudness belong to the set
    meant: dict[str, Contact]  # by identity, those that are written
    scale: float | None


def _make_batch(
    stimuli: StimulusSet, source: str, contacts: list[Contact], order: _ExportOptions
) -> _SetExport:
    """Choose what is written of a set, and the scale of all its scenes."""
    meant = {}
    for part, contact in zip(stimuli.stimuli, contacts, strict=True):
        if order.only is None or matches_pattern(order.only, stimuli.name, part.id):
            meant[part.id] = contact
    scale = order.scale
    if scale is None and order.device is not None:
        drags = [(contact.events[0], contact.point) for contact in contacts]
        scale = choose_common_scale(order.device, drags)
    return _SetExport(stimuli, source, contacts, meant, scale)


def _iterate_rendering_plans(device: Device, batches: list[_SetExport]) -> Iterator[RenderingPlan]:
    """Plan how a device renders each stimulus that is meant."""
    for batch in batches:
        for contact in batch.meant.values():
            yield plan_rendering(device, contact.events[0], contact.point, batch.scale)


def _build_batch_scenes(batch: _SetExport, order: _ExportOptions) -> dict[str, Scene]:
    """Build the scenes that are meant; the loudest ring of the set is the full scale of all."""
    loudness = [compute_full_scale_force(contact.events) for contact in batch.contacts]
    full_scale = max(loudness, default=0.0)
    scenes = {}
    for identity, contact in batch.meant.items():
        scenes[identity] = build_scene(contact, order.device, batch.scale, full_scale=full_scale)
    return scenes


def _write_whole_set(
    draft: Path, batch: _SetExport, scenes: list[Scene], form: SceneFormat, order: _ExportOptions
) -> None:
    """Write what holds several stimuli at once: all blocks of a set, and scanned teeth."""
    name = order.format_folder_name(form)
    folder = draft / batch.stimuli.name
    _write_set_scene(folder / f"{name}-blocks", scenes, form, name)
    if form.write_tooth is None or not Path(batch.source).is_file():
        return
    for scan, stations in iterate_scanned_teeth(scenes, Path(batch.source).parent):
        write_tooth_scene(folder / scan.name / f"{name}-tooth", scan, stations, form)


def _write_set_scene(folder: Path, scenes: list[Scene], form: SceneFormat, name: str) -> None:
    """Write what holds all stimuli of a set, where the format has it and their probes allow it."""
    if form.write_set is None or len(scenes) < 2:
        return
    probes = set()
    for scene in scenes:
        probes.add((scene.ball_radius, scene.stiffness, scene.point.friction))
    if len(probes) > 1 and form.shares_probe:
        return
    folder.mkdir(parents=True)
    form.write_set(folder, scenes, name)


def _resolve_set_contacts(
    stimuli: StimulusSet,
    learned: LearnedModel | None,
    step_height: float | None,
    ring: Literal["exponential", "drag"],
    overrides: dict[str, float],
) -> list[Contact]:
    """Resolve the contacts of all stimuli of a set, those that are not written as well."""
    height = step_height
    if height is None:
        height = next(iter(stimuli.prediction.step_heights), None)
    contacts = []
    for part in stimuli.stimuli:
        contact = resolve_contact(
            part,
            choose_operating_point(stimuli, part, overrides),
            height,
            learned,
            keep_friction="friction" in overrides,
            ring=ring,
        )
        contacts.append(contact)
    return contacts


def _move_files_into_place(draft: Path, output: Path) -> None:
    """Move prepared files into their places, after it is sure that each can have its own."""
    sync_folder(draft)
    files = []
    for path in sorted(draft.rglob("*")):
        if path.is_file():
            files.append(path.relative_to(draft))
    for file in files:
        _require_free_place(output / file)
    for file in files:
        (output / file).parent.mkdir(parents=True, exist_ok=True)
        move_into_place(draft / file, output / file)


def _require_free_place(target: Path) -> None:
    """Refuse a place where a folder stands, or below which a file stands for a folder."""
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    for parent in target.parents:
        if parent.exists() and not parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(parent))
