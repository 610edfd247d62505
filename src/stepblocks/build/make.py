"""One stimulus from its specification to a folder of checked artefacts."""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.build.manifest import RECORD, digest, hash_file, load_json
from stepblocks.parts.kind import Part


@dataclass(frozen=True)
class Made:
    """What became of one stimulus."""

    name: str  # Set and identity, ``"set/id"``
    seconds: float  # Time it took [s]
    failures: tuple[str, ...]  # Failed verdicts, one line each


def build_key(stimulus: Part, code: str) -> str:
    """Identify what a stimulus would be built from."""
    return digest((json.dumps(stimulus.record(), sort_keys=True) + code).encode())


def checked_files(stimulus: Part, folder: Path) -> list[Path]:
    """List the artefacts of a stimulus that can be checked."""
    from stepblocks.artefacts.meshes.write import MESH_FORMATS

    names = [f"{stimulus.id}.step"]
    names += [body + form.suffix for body in stimulus.bodies for form in MESH_FORMATS]
    names.append(f"{stimulus.id}.convex.obj")
    if stimulus.has_working_faces:
        names += [f"{stimulus.id}.heightfield.tiff", f"{stimulus.id}.heightfield.npz"]
    names.append(f"{stimulus.id}.png")
    return [folder / name for name in names]


def make(set_name: str, stimulus: Part, output: Path, key: str) -> Made:
    """Build, write, read back and measure one stimulus."""
    from stepblocks.artefacts.check import check_artefact

    started = time.perf_counter()
    folder = output / set_name / stimulus.id
    workshop = output / f".partial-{set_name}-{stimulus.id}-{os.getpid()}"
    shutil.rmtree(workshop, ignore_errors=True)
    workshop.mkdir(parents=True)
    try:
        _write_artefacts(stimulus, workshop)
        verdicts = [verdict for path in checked_files(stimulus, workshop) for verdict in check_artefact(stimulus, path)]
        outputs = {path.name: hash_file(path) for path in sorted(workshop.iterdir())}
        record = {
            "key": key,
            "stimulus": stimulus.id,
            "kind": stimulus.called,
            "dimensions": [[name, str(value)] for name, value in stimulus.dimensions()],
            "derived": stimulus.derived(),
            "verdicts": [verdict.as_record() | {"text": str(verdict)} for verdict in verdicts],
            "outputs": outputs,
        }
        _move_in(workshop, folder, outputs, json.dumps(record, indent=1, allow_nan=False) + "\n")
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    failures = tuple(str(verdict) for verdict in verdicts if not verdict.passed)
    return Made(f"{set_name}/{stimulus.id}", time.perf_counter() - started, failures)


def _write_artefacts(stimulus: Part, folder: Path) -> None:
    from stepblocks.artefacts.heightfield import write_height_field
    from stepblocks.artefacts.meshes.write import MESH_FORMATS, write_pieces
    from stepblocks.artefacts.step.write import write_step_ap242
    from stepblocks.build.picture import draw
    from stepblocks.build.viewer import write_view
    from stepblocks.parts.mesh import mesh_solid
    from stepblocks.parts.shapes import build_solids, convex_pieces

    bodies = build_solids(stimulus)
    write_step_ap242(folder / f"{stimulus.id}.step", stimulus, bodies)
    meshes = [mesh_solid(stimulus, name, body) for name, body in bodies]
    for mesh in meshes:
        for form in MESH_FORMATS:
            form.write(folder / f"{mesh.name}{form.suffix}", mesh)
    write_pieces(folder / f"{stimulus.id}.convex.obj", convex_pieces(stimulus))
    if stimulus.has_working_faces:
        write_height_field(folder / f"{stimulus.id}.heightfield", stimulus)
    arrays = [(mesh.vertices, mesh.triangles) for mesh in meshes]
    draw(folder / f"{stimulus.id}.png", arrays, *stimulus.close_up())
    write_view(folder / "view.js", stimulus.id, arrays, *stimulus.close_up())
    specification = json.dumps(stimulus.record(), indent=2, allow_nan=False)
    (folder / "specification.json").write_text(specification + "\n", encoding="utf-8")


def _move_in(workshop: Path, folder: Path, outputs: dict[str, str], record: str) -> None:
    """Replace a stimulus's files one by one; files that this program did not write stay."""
    folder.mkdir(parents=True, exist_ok=True)
    before: dict[str, Any] = load_json(folder / RECORD).get("outputs", {})
    (folder / RECORD).unlink(missing_ok=True)
    for name in outputs:
        (workshop / name).replace(folder / name)
    for name, known in before.items():
        if name not in outputs and hash_file(folder / name) == known:
            (folder / name).unlink()
    replace_text(folder / RECORD, record)
