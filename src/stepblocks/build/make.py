"""Stimuli from their specifications to folders of checked artefacts, one by one or in parallel."""

import json
import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from stepblocks.artefacts.meshes.write import MESH_FORMATS, write_pieces
from stepblocks.build.manifest import (
    RECORD,
    find_unchanged,
    hash_file,
    list_outputs,
    load_json,
    write_sealed,
)
from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import run_in_processes
from stepblocks.files.atomic import make_draft_folder, move_into_place, sync_folder
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part

# set, stimulus, hash of its inputs, and the order that its STEP file states
OutdatedStimulus: TypeAlias = tuple[str, Part, str, OrderSpec]


@dataclass(frozen=True)
class BuiltStimulus:
    """What became of one stimulus."""

    name: str  # ``"set/id"``
    seconds: float  # time it took [s]


def build_stimuli(
    outdated: Sequence[OutdatedStimulus], output: Path, jobs: int | None
) -> Generator[BuiltStimulus]:
    """Make stimuli in as many processes as there are cores; give each when it is ready."""
    return run_in_processes(
        build_stimulus,
        ((output, *one) for one in outdated),
        min(jobs or count_cores(), max(len(outdated), 1)),
        in_order=False,
    )


def list_checkable_files(stimulus: Part, folder: Path) -> list[Path]:
    """List the artefacts of a stimulus that can be checked."""
    fields = ("heightfield.tiff", "heightfield.npz") if stimulus.has_working_faces else ()
    names = (
        f"{stimulus.id}.step",
        *(body + ending for body in stimulus.bodies for ending in MESH_FORMATS),
        *(f"{stimulus.id}.{ending}" for ending in ("convex.obj", *fields, "png")),
        "specification.json",
    )
    return [folder / name for name in names]


def build_stimulus(
    output: Path, set_name: str, stimulus: Part, key: str, order: OrderSpec
) -> BuiltStimulus:
    """Build, write, read back and measure one stimulus."""
    from stepblocks.artefacts.check import check_artefact

    started = time.perf_counter()
    with make_draft_folder(output / f"{set_name}-{stimulus.id}") as workshop:
        _write_artefacts(stimulus, workshop, order)
        paths = list_checkable_files(stimulus, workshop)
        # of all that was asked for: what somebody removes meanwhile is missed and not left out
        outputs = {path.name: hash_file(path) for path in sorted({*paths, *workshop.iterdir()})}
        record = {
            "schema": 1,
            "key": key,
            "stimulus": stimulus.id,
            "kind": stimulus.kind_name,
            "dimensions": [[name, str(value)] for name, value in stimulus.dimensions()],
            "derived": stimulus.derived(),
            "verdicts": [
                verdict.as_record() | {"text": str(verdict)}
                for path in paths
                for verdict in check_artefact(stimulus, path)
            ],
            "outputs": outputs,
        }
        sync_folder(workshop)
        _replace_files(workshop, output / set_name / stimulus.id, record)
    return BuiltStimulus(f"{set_name}/{stimulus.id}", time.perf_counter() - started)


def _write_artefacts(stimulus: Part, folder: Path, order: OrderSpec) -> None:
    from stepblocks.artefacts.heightfield import write_height_field
    from stepblocks.artefacts.step.write import write_step_ap242
    from stepblocks.build.picture import draw_part, write_view_script
    from stepblocks.parts.shapes import build_convex_pieces, build_solids, mesh_solid

    bodies = build_solids(stimulus)
    write_step_ap242(folder / f"{stimulus.id}.step", stimulus, bodies, order)
    meshes = [mesh_solid(stimulus, name, body) for name, body in bodies]
    for mesh in meshes:
        for ending, write in MESH_FORMATS.items():
            write(folder / f"{mesh.name}{ending}", mesh)
    write_pieces(folder / f"{stimulus.id}.convex.obj", build_convex_pieces(stimulus))
    if stimulus.has_working_faces:
        write_height_field(folder / f"{stimulus.id}.heightfield", stimulus)
    arrays = [(mesh.vertices, mesh.triangles) for mesh in meshes]
    draw_part(folder / f"{stimulus.id}.png", arrays, *stimulus.choose_close_up())
    write_view_script(folder / "view.js", stimulus.id, arrays, *stimulus.choose_close_up())
    specification = json.dumps({"schema": 1, **stimulus.record()}, indent=2, allow_nan=False)
    (folder / "specification.json").write_text(specification + "\n", encoding="utf-8", newline="\n")


def _replace_files(draft: Path, folder: Path, record: Mapping[str, object]) -> None:
    # Replace a stimulus's files one by one; files that this program did not write stay
    folder.mkdir(parents=True, exist_ok=True)
    outputs, before = list_outputs(record), list_outputs(load_json(folder / RECORD))
    (folder / RECORD).unlink(missing_ok=True)
    for name in outputs:
        move_into_place(draft / name, folder / name)
    for name in set(before) - set(outputs):
        if (left := find_unchanged(folder, name, before[name])) is not None:
            left.unlink()
    write_sealed(folder / RECORD, record)
