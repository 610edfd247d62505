"""One stimulus from its specification to a folder of checked artefacts."""

from __future__ import annotations

import json
import math
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.build.manifest import RECORD, digest, hash_file, load_json
from stepblocks.parts.energy_tolerance import EnergyBudget
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath, format_mass
from stepblocks.parts.specification import dimensions, resolved
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip


@dataclass(frozen=True)
class Made:
    """What became of one stimulus."""

    name: str  # Set and identity, ``"set/id"``
    seconds: float  # Time it took [s]
    failures: tuple[str, ...]  # Failed verdicts, one line each


def build_key(stimulus: Stimulus, code: str) -> str:
    """Identify what a stimulus would be built from."""
    return digest((json.dumps(resolved(stimulus), sort_keys=True) + code).encode())


def checked_files(stimulus: Stimulus, folder: Path) -> list[Path]:
    """List the artefacts of a stimulus that can be checked."""
    from stepblocks.artefacts.meshes.write import MESH_FORMATS

    names = [f"{stimulus.id}.step"]
    bodies = [f"{stimulus.id}-tooth", f"{stimulus.id}-crown"] if isinstance(stimulus, CrownOnTooth) else [stimulus.id]
    names += [body + form.suffix for body in bodies for form in MESH_FORMATS]
    names.append(f"{stimulus.id}.convex.obj")
    if isinstance(stimulus, StepBlock | MarginBlock):
        names += [f"{stimulus.id}.heightfield.tiff", f"{stimulus.id}.heightfield.npz"]
    names.append(f"{stimulus.id}.png")
    return [folder / name for name in names]


def make(set_name: str, stimulus: Stimulus, output: Path, key: str) -> Made:
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
            "kind": resolved(stimulus)["kind"],
            "dimensions": [[name, str(value)] for name, value in dimensions(stimulus)],
            "derived": _derived(stimulus),
            "verdicts": [verdict.as_record() | {"text": str(verdict)} for verdict in verdicts],
            "outputs": outputs,
        }
        _move_in(workshop, folder, outputs, json.dumps(record, indent=1, allow_nan=False) + "\n")
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    failures = tuple(str(verdict) for verdict in verdicts if not verdict.passed)
    return Made(f"{set_name}/{stimulus.id}", time.perf_counter() - started, failures)


def _write_artefacts(stimulus: Stimulus, folder: Path) -> None:
    from stepblocks.artefacts.heightfield import write_height_field
    from stepblocks.artefacts.meshes.write import MESH_FORMATS, write_pieces
    from stepblocks.artefacts.step.write import write_step_ap242
    from stepblocks.build.picture import draw
    from stepblocks.build.viewer import write_view
    from stepblocks.parts.mesh import mesh_solid
    from stepblocks.parts.pieces import convex_pieces
    from stepblocks.parts.shapes import build_solids

    bodies = build_solids(stimulus)
    write_step_ap242(folder / f"{stimulus.id}.step", stimulus, bodies)
    meshes = [mesh_solid(stimulus, name, body) for name, body in bodies]
    for mesh in meshes:
        for form in MESH_FORMATS:
            form.write(folder / f"{mesh.name}{form.suffix}", mesh)
    write_pieces(folder / f"{stimulus.id}.convex.obj", convex_pieces(stimulus))
    if isinstance(stimulus, StepBlock | MarginBlock):
        write_height_field(folder / f"{stimulus.id}.heightfield", stimulus)
    arrays = [(mesh.vertices, mesh.triangles) for mesh in meshes]
    draw(folder / f"{stimulus.id}.png", arrays, *staging(stimulus))
    write_view(folder / "view.js", stimulus.id, arrays, *staging(stimulus))
    specification = json.dumps(resolved(stimulus), indent=2, allow_nan=False)
    (folder / "specification.json").write_text(specification + "\n", encoding="utf-8")


def staging(stimulus: Stimulus) -> tuple[float, float, tuple[float, float, float]]:
    """Choose how to show a stimulus."""
    match stimulus:
        case StepBlock():
            return _exaggeration(stimulus.height.nominal), 2.5 * stimulus.height.nominal, (0.0, 0.0, 0.0)
        case MarginBlock():
            rise, gap = abs(stimulus.horizontal_discrepancy.nominal), stimulus.marginal_gap.nominal
            wide = 2.5 * max(rise, gap, abs(stimulus.opening.nominal))
            return (_exaggeration(rise) if rise else 1.0), wide, (0.5 * gap, 0.0, 0.0)
        case CrownOnTooth():
            wide = 6.0 * max(stimulus.marginal_gap.nominal, abs(stimulus.horizontal_discrepancy.nominal))
            return 1.0, wide, (stimulus.margin_radius.nominal, wide, 0.0)
        case StraightTip() | HookTip():
            radius = stimulus.ball_radius.nominal
            return 1.0, 2.0 * radius, (0.0, 0.0, 1.5 * radius)
        case Sheath():
            outer = stimulus.outer_diameter.nominal
            return 1.0, min(0.6 * outer, 4.9e-3), (0.0, 0.0, 0.4 * outer)


def _exaggeration(height: float) -> float:
    """Round factor that draws a height at about a millimetre and a half."""
    wanted = 1.5e-3 / height
    decade = 10.0 ** math.floor(math.log10(wanted))
    return max(round(wanted / decade) * decade, 1.0)


def _derived(stimulus: Stimulus) -> list[list[str]]:
    """Figures that follow from the specification, for the page."""
    if isinstance(stimulus, MarginBlock | CrownOnTooth):
        grade = "clinically acceptable" if stimulus.clinically_acceptable else "above the clinical limit of 100 um"
        return [["absolute marginal discrepancy", f"{stimulus.absolute_discrepancy * 1e6:.4g} um, {grade}"]]
    if isinstance(stimulus, StepBlock | StraightTip | HookTip) and isinstance(stimulus.energy_tolerance, EnergyBudget):
        budget = stimulus.energy_tolerance
        tips = ", ".join(str(tip) for tip in budget.tips)
        return [["vibration energy", f"kept within {budget.within:.3g} of the nominal with a tip of {tips}"]]
    if isinstance(stimulus, Sheath):
        low, high = stimulus.mass_limits
        text = f"{format_mass(stimulus.mass)} ({format_mass(low)} to {format_mass(high)} within tolerances)"
        return [["mass", text], ["material", stimulus.material.designation]]
    return []


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
