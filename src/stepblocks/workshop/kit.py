"""A kit of the apparatus: every part as STEP, drawing and printable mesh, the assembly moved through its travel, bill and loads."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from stepblocks import cad
from stepblocks.artefacts.meshes.write import write_3mf, write_stl
from stepblocks.artefacts.step.write import write_conforming, write_step_ap242
from stepblocks.parts.apparatus import Apparatus
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kinds.machined import Machined
from stepblocks.parts.shapes import mesh_solid
from stepblocks.tables import write_table
from stepblocks.workshop.complete import missing_from
from stepblocks.workshop.drawing import write_drawing
from stepblocks.workshop.loads import flexure_sensitivity, flexure_stiffness, normal_load, pull

POSITIONS = 21  # of the travel at which the assembly is looked at
_TOUCHING = 1e-15  # volume that the kernel's intersection may leave where faces touch [m^3]
# what holds it together: count, what, and where
_SCREWS = (
    (10, "screw ISO 4762 M4 x 16", "base to portals, seat, bracket and rig"),
    (4, "screw ISO 4762 M4 x 40", "clamp and jaws of the damping rig"),
    (2, "screw ISO 4762 M3 x 12", "block to its seat, from below"),
    (2, "screw ISO 4762 M3 x 30", "flexure to carriage"),
    (2, "screw ISO 4762 M3 x 12", "yoke to flexure"),
    (2, "screw ISO 4762 M2.5 x 10", "clamp of the explorer"),
    (4, "strain gauge 350 ohm, constantan", "flexure, at the roots of the leaves, full bridge"),
    (1, "force-sensing resistor, 9.5 mm", "pressure sensor in the upper jaw"),
    (1, "braided cord 0.3 mm, 0.5 m", "hook to hanger"),
)


def write_kit(folder: Path, kit: Apparatus, order: OrderSpec) -> tuple[list[Path], list[str]]:
    """Write everything of a kit; return the files, and what is wrong: parts in the way, dimensions that would be asked for."""
    parts = kit.parts()
    bodies = {part.id: part.solids()[0] for part in parts}
    written: list[Path] = []
    wrong = list(interferences(kit, bodies))
    for part in parts:
        if not part.standard:
            paths, missing = _write_part(folder / part.id, part, bodies[part.id], order)
            written, wrong = written + paths, wrong + missing
    assembly = folder / f"{kit.id}.assembly.step"
    write_conforming(assembly, kit.id, [(part.id, bodies[part.id]) for part in parts], parts[0].material, [])
    return [*written, assembly, *_write_tables(folder, kit, parts)], wrong


def _write_part(folder: Path, part: Machined, body: cad.kernel.Body, order: OrderSpec) -> tuple[list[Path], list[str]]:
    folder.mkdir(parents=True, exist_ok=True)
    step = folder / f"{part.id}.step"
    write_step_ap242(step, part, [(part.id, body)])
    drawings = write_drawing(folder, part, order=order)
    meshes = []
    if part.printable:
        mesh = mesh_solid(part, part.id, body)
        for path, write in ((folder / f"{part.id}.stl", write_stl), (folder / f"{part.id}.3mf", write_3mf)):
            write(path, mesh)
            meshes.append(path)
    return [step, *drawings, *meshes], missing_from(part, drawings[0], step)


def interferences(kit: Apparatus, bodies: Mapping[str, cad.kernel.Body]) -> Iterator[str]:
    """Name every pair of parts that share volume, all of them in the middle of the travel and what moves past what does not."""
    parts, half = kit.parts(), 0.5 * kit.travel.nominal
    for a, b in itertools.combinations(parts, 2):
        yield from _shared(a, b, cad.kernel.common_volume(bodies[a.id], bodies[b.id]), 0.0)
    for index in range(POSITIONS):
        x = half * (2.0 * index / (POSITIONS - 1) - 1.0)
        for a in (one for one in parts if one.moving):
            there = cad.kernel.moved(bodies[a.id], (x, 0.0, 0.0))
            for b in (one for one in parts if not one.moving):
                yield from _shared(a, b, cad.kernel.common_volume(there, bodies[b.id]), x)


def _shared(a: Machined, b: Machined, volume: float, x: float) -> Iterator[str]:
    if volume > _TOUCHING:
        yield f"{a.id} and {b.id} share {volume * 1e9:.4g} mm3 where the tip is at {x * 1e3:+.2f} mm"


def _write_tables(folder: Path, kit: Apparatus, parts: Sequence[Machined]) -> list[Path]:
    import pandas as pd

    made = [(1, part.title, part.material.designation, part.id) for part in parts if not part.standard]
    given = [part.id in ("block", "explorer", "weight") or not part.standard for part in parts]
    bought = Counter((part.standard, part.title) for part, has in zip(parts, given, strict=True) if not has)
    said = "weight {:g} g, class M1 (OIML R 111-1)".format
    weights = [(1, f"{said(mass * 1e3)}, bored 2.5", "", "shank of the explorer") for mass in kit.normal_weights]
    weights += [(1, said(mass * 1e3), "", "hanger") for mass in kit.pulling_weights]
    lines = [*made, *((count, name, "", title) for (name, title), count in bought.items()), *weights]
    lines += [(count, what, "", where) for count, what, where in _SCREWS]
    loads = [
        {"axis": axis, "weight_g": load.mass * 1e3, "force_n": load.force, "std_n": load.std}
        | {f"{name.replace(' ', '_')}_n": std for name, std in load.budget}
        for axis, several, of in (("normal", kit.normal_weights, normal_load), ("pull", kit.pulling_weights, pull))
        for load in (of(kit, mass) for mass in several)
    ]
    flexure = [{"stiffness_n_per_m": flexure_stiffness(kit), "sensitivity_v_per_v_per_n": flexure_sensitivity(kit)}]
    bill = pd.DataFrame(lines, columns=["count", "what", "material", "for"])
    written = []
    for name, table in (("bill", bill), ("loads", pd.DataFrame(loads)), ("flexure", pd.DataFrame(flexure))):
        written.append(folder / f"{kit.id}.{name}.csv")
        write_table(table, written[-1])
    return written
