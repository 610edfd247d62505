"""Stimuli from their specifications to folders of checked artefacts, one by one or in parallel."""

import json
import tempfile
import time
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.artefacts.meshes.write import MESH_FORMATS, write_convex_pieces
from stepblocks.build.manifest import (
    RECORD,
    NamedText,
    RecordedVerdict,
    StimulusRecord,
    find_unaltered_file,
    hash_file,
    load_stimulus_record,
    write_sealed_json,
)
from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import preload_for_workers
from stepblocks.compute.seam import run_calls
from stepblocks.files.atomic import make_draft_folder, move_into_place, sync_folder
from stepblocks.files.confined import read_in_this_process
from stepblocks.files.packed import PackedFolder, pack_folder, unpack_folder
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part

if TYPE_CHECKING:
    from distributed import Client

    # loaded by the process of which workers are forks, by its name
    from stepblocks.build import worker as worker
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.predict.predictions import Prediction


@dataclass(frozen=True)
class OutdatedStimulus:
    """A stimulus to build.

    Attributes
    ----------
    set_name : str
        Its set.
    part : Part
        The stimulus.
    key : str
        Hash of its inputs.
    order : OrderSpec
        The order that its STEP file states.
    """

    set_name: str
    part: Part
    key: str
    order: OrderSpec

    @property
    def set_and_id(self) -> str:
        """Set and id, ``"set/id"``."""
        return f"{self.set_name}/{self.part.id}"


@dataclass(frozen=True)
class BuiltStimulus:
    """Outcome for one stimulus: its name ``"set/id"``, and the time it took [s]."""

    name: str
    seconds: float


@dataclass(frozen=True)
class PredictedSet:
    """What is predicted of a set."""

    name: str
    predictions: "tuple[Prediction, ...]"


@dataclass(frozen=True)
class PackedStimulus:
    """A stimulus made on another machine: its files, their record, and the time it took [s]."""

    outdated: OutdatedStimulus
    files: PackedFolder
    record: StimulusRecord
    seconds: float


def build_stimuli(
    outdated: Sequence[OutdatedStimulus],
    output: Path,
    jobs: int | None,
    cluster: "Client | None" = None,
    predicted: "Sequence[StimulusSet]" = (),
) -> "Generator[BuiltStimulus | PredictedSet]":
    """Make stimuli here, in as many processes as there are cores, or on a cluster.

    Each is given when its files are in place. Sets are predicted in this process, beside them where
    others make them.
    """
    if cluster is not None:
        yield from _build_on_cluster(outdated, output, cluster)
        yield from map(predict_declared_set, predicted)
        return
    processes = min(jobs or count_cores(), max(len(outdated), 1))
    # workers of an earlier build have the working folder of that time
    calls = [(output.absolute(), stimulus) for stimulus in outdated]
    if processes == 1:
        yield from run_calls(build_stimulus, calls, jobs=1, in_order=False)
        yield from map(predict_declared_set, predicted)
        return
    preload_for_workers("stepblocks.build.worker")
    with _start_predictions(predicted) as predictions:
        yield from run_calls(build_stimulus, calls, jobs=processes, in_order=False)
        for prediction in predictions:
            yield prediction.result()


@contextmanager
def _start_predictions(
    predicted: "Sequence[StimulusSet]",
) -> "Iterator[list[Future[PredictedSet]]]":
    """Start to predict sets in a thread of this process, and give a future for each.

    The thread only waits for its workers. What has not begun when the block ends is cancelled.
    """
    thread = ThreadPoolExecutor(1)
    try:
        yield [thread.submit(predict_declared_set, stimuli) for stimuli in predicted]
    finally:
        thread.shutdown(cancel_futures=True)


def predict_declared_set(stimuli: "StimulusSet") -> PredictedSet:
    """Predict a set and drag its conditions in time."""
    from stepblocks.predict.predictions import predict_and_drag_set

    return PredictedSet(stimuli.name, predict_and_drag_set(stimuli))


def _build_on_cluster(
    outdated: Sequence[OutdatedStimulus], output: Path, cluster: "Client"
) -> Generator[BuiltStimulus]:
    """Make stimuli on a cluster, whose workers need not see the output folder."""
    calls = [(stimulus,) for stimulus in outdated]
    for packed in run_calls(build_packed_stimulus, calls, jobs=1, on=cluster, in_order=False):
        stimulus = packed.outdated
        with make_draft_folder(output / f"{stimulus.set_name}-{stimulus.part.id}") as draft:
            unpack_folder(packed.files, draft)
            sync_folder(draft)
            _replace_stimulus_files(
                draft, output / stimulus.set_name / stimulus.part.id, packed.record
            )
        yield BuiltStimulus(stimulus.set_and_id, packed.seconds)


def list_possible_artefact_paths(stimulus: Part, folder: Path) -> list[Path]:
    """List where the artefacts of a stimulus lie that can be checked, whether or not they exist."""
    names = [f"{stimulus.id}.step"]
    for body in stimulus.bodies:
        names += [body + ending for ending in MESH_FORMATS]
    names.append(f"{stimulus.id}.convex.obj")
    if stimulus.has_working_faces:
        names += [f"{stimulus.id}.heightfield.tiff", f"{stimulus.id}.heightfield.npz"]
    names += [f"{stimulus.id}.png", "specification.json"]
    return [folder / name for name in names]


def build_stimulus(output: Path, outdated: OutdatedStimulus) -> BuiltStimulus:
    """Build, write, read back and measure one stimulus."""
    started = time.perf_counter()
    part = outdated.part
    with make_draft_folder(output / f"{outdated.set_name}-{part.id}") as draft:
        record = _write_checked_artefacts(outdated, draft)
        sync_folder(draft)
        _replace_stimulus_files(draft, output / outdated.set_name / part.id, record)
    return BuiltStimulus(outdated.set_and_id, time.perf_counter() - started)


def build_packed_stimulus(outdated: OutdatedStimulus) -> PackedStimulus:
    """Build, write, read back and measure one stimulus in a temporary folder of this machine."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="stepblocks-") as name:
        draft = Path(name)
        record = _write_checked_artefacts(outdated, draft)
        files = pack_folder(draft)
    return PackedStimulus(outdated, files, record, time.perf_counter() - started)


def _write_checked_artefacts(outdated: OutdatedStimulus, draft: Path) -> StimulusRecord:
    """Write the artefacts of a stimulus into a folder, read them back, and record both."""
    _write_artefacts(outdated.part, draft, outdated.order)
    return _check_and_record_artefacts(outdated.part, outdated.key, draft)


def _check_and_record_artefacts(part: Part, key: str, draft: Path) -> StimulusRecord:
    """Hash and check the artefacts in a draft folder."""
    from stepblocks.artefacts.check import check_artefact

    paths = list_possible_artefact_paths(part, draft)
    # of all that was asked for: what somebody removes meanwhile is missed and not left out
    outputs = {path.name: hash_file(path) for path in sorted({*paths, *draft.iterdir()})}
    verdicts = []
    with read_in_this_process():
        for path in paths:
            for verdict in check_artefact(part, path):
                verdicts.append(RecordedVerdict(str(verdict), verdict.passed, verdict.as_record()))
    return StimulusRecord(
        key=key,
        stimulus=part.id,
        kind=part.kind_name,
        dimensions=[NamedText(name, str(value)) for name, value in part.dimensions()],
        derived=[NamedText(*entry) for entry in part.derived()],
        verdicts=verdicts,
        outputs=outputs,
    )


def _write_artefacts(stimulus: Part, folder: Path, order: OrderSpec) -> None:
    """Write every file of a stimulus into a folder."""
    from stepblocks.artefacts.heightfield import write_height_field
    from stepblocks.artefacts.step.write import write_step_ap242
    from stepblocks.build.picture import render_part_picture, write_view_call
    from stepblocks.parts.shapes import build_convex_pieces, build_solids, mesh_solid

    bodies = build_solids(stimulus)
    write_step_ap242(folder / f"{stimulus.id}.step", stimulus, bodies, order)
    meshes = [mesh_solid(stimulus, name, body) for name, body in bodies]
    for mesh in meshes:
        for ending, write in MESH_FORMATS.items():
            write(folder / f"{mesh.name}{ending}", mesh)
    write_convex_pieces(folder / f"{stimulus.id}.convex.obj", build_convex_pieces(stimulus))
    if stimulus.has_working_faces:
        write_height_field(folder / f"{stimulus.id}.heightfield", stimulus)
    arrays = [(mesh.vertices, mesh.triangles) for mesh in meshes]
    exaggeration, half_width, centre = stimulus.choose_close_up()
    render_part_picture(folder / f"{stimulus.id}.png", arrays, exaggeration, half_width, centre)
    write_view_call(folder / "view.js", stimulus.id, arrays, exaggeration, half_width, centre)
    specification = json.dumps({"schema": 1, **stimulus.record()}, indent=2, allow_nan=False)
    (folder / "specification.json").write_text(specification + "\n", encoding="utf-8", newline="\n")


def _replace_stimulus_files(draft: Path, folder: Path, record: StimulusRecord) -> None:
    """Replace a stimulus's files one by one; files that this program did not write stay."""
    folder.mkdir(parents=True, exist_ok=True)
    replaced = load_stimulus_record(folder)
    (folder / RECORD).unlink(missing_ok=True)
    for name in record.outputs:
        move_into_place(draft / name, folder / name)
    if replaced is not None:
        for name in set(replaced.outputs) - set(record.outputs):
            stale = find_unaltered_file(folder, name, replaced.outputs[name])
            if stale is not None:
                stale.unlink()
    write_sealed_json(folder / RECORD, record.as_json())
