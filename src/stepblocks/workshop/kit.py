"""A kit of the apparatus: STEP, drawings, printable meshes, assembly, bill, loads."""

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepblocks import cad
from stepblocks.artefacts.meshes.write import write_3mf, write_stl
from stepblocks.artefacts.step.write import write_conforming, write_step_ap242
from stepblocks.parts.apparatus import ARM, Apparatus
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kinds.machined import Machined
from stepblocks.parts.shapes import mesh_solid
from stepblocks.tables import write_table
from stepblocks.workshop.complete import find_missing
from stepblocks.workshop.drawing import write_assembly_drawing, write_drawing

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
    """Write everything of a kit; return the files, and a list of what is wrong."""
    parts = kit.parts()
    bodies = {part.id: part.solids()[0] for part in parts}
    written: list[Path] = []
    wrong = list(find_interferences(kit, bodies))
    for part in parts:
        if not part.standard:
            paths, missing = _write_part(folder / part.id, part, bodies[part.id], order)
            written, wrong = written + paths, wrong + missing
    assembly = folder / f"{kit.id}.assembly.step"
    write_conforming(
        assembly, kit.id, [(part.id, bodies[part.id]) for part in parts], parts[0].material, []
    )
    drawn = write_assembly_drawing(folder, kit.id, parts, order)
    return [*written, assembly, *drawn, *_write_tables(folder, kit, parts)], wrong


def _write_part(
    folder: Path, part: Machined, body: cad.door.Body, order: OrderSpec
) -> tuple[list[Path], list[str]]:
    folder.mkdir(parents=True, exist_ok=True)
    step = folder / f"{part.id}.step"
    write_step_ap242(step, part, [(part.id, body)])
    drawings = write_drawing(folder, part, order=order)
    meshes = []
    if part.printable:
        mesh = mesh_solid(part, part.id, body)
        for path, write in (
            (folder / f"{part.id}.stl", write_stl),
            (folder / f"{part.id}.3mf", write_3mf),
        ):
            write(path, mesh)
            meshes.append(path)
    return [step, *drawings, *meshes], find_missing(part, drawings[0], step)


def find_interferences(kit: Apparatus, bodies: Mapping[str, cad.door.Body]) -> Iterator[str]:
    """Name every pair of parts that share volume, over the whole travel."""
    parts, half = kit.parts(), 0.5 * kit.travel.nominal
    pairs = [(a, b, 0.0) for a, b in itertools.combinations(parts, 2)]
    for index in range(POSITIONS):
        x = half * (2.0 * index / (POSITIONS - 1) - 1.0)
        pairs += [(a, b, x) for a in parts if a.moving for b in parts if not b.moving]
    for a, b, x in pairs:
        volume = cad.kernel.compute_common_volume(bodies[a.id], bodies[b.id], (x, 0.0, 0.0))
        if volume > _TOUCHING:
            where = f"where the tip is at {x * 1e3:+.2f} mm"
            yield f"{a.id} and {b.id} share {volume * 1e9:.4g} mm3 {where}"


def _write_tables(folder: Path, kit: Apparatus, parts: Sequence[Machined]) -> list[Path]:
    import pandas as pd

    made = [
        (1, part.title, part.material.designation, part.id) for part in parts if not part.standard
    ]
    given = [part.id in ("block", "explorer", "weight") or not part.standard for part in parts]
    bought = Counter(
        (part.standard, part.title) for part, has in zip(parts, given, strict=True) if not has
    )
    said = "weight {:g} g, class M1 (OIML R 111-1)".format
    weights = [
        (1, f"{said(mass * 1e3)}, bored 2.5", "", "shank of the explorer")
        for mass in kit.normal_weights
    ]
    weights += [(1, said(mass * 1e3), "", "hanger") for mass in kit.pulling_weights]
    lines = [
        *made,
        *((count, name, "", title) for (name, title), count in bought.items()),
        *weights,
    ]
    lines += [(count, what, "", where) for count, what, where in _SCREWS]
    loads = [
        {"axis": axis, "weight_g": load.mass * 1e3, "force_n": load.force, "std_n": load.std}
        | {f"{name.replace(' ', '_')}_n": std for name, std in load.budget}
        for axis, several, of in (
            ("normal", kit.normal_weights, compute_normal_load),
            ("pull", kit.pulling_weights, compute_pull),
        )
        for load in (of(kit, mass) for mass in several)
    ]
    bill = pd.DataFrame(lines, columns=["count", "what", "material", "for"])
    written = []
    for name, table in (
        ("bill", bill),
        ("loads", pd.DataFrame(loads)),
        ("flexure", pd.DataFrame([compute_flexure(kit)])),
    ):
        written.append(folder / f"{kit.id}.{name}.csv")
        write_table(table, written[-1])
    return written


_PIVOT_BORE, _PULLEY_BORE, _PULLEY = 3e-3, 3e-3, 20e-3  # diameters [m]


@dataclass(frozen=True)
class Load:
    """A force on the tip."""

    mass: float  # of the weight [kg]
    force: float  # N
    std: float  # standard uncertainty [N]
    budget: tuple[tuple[str, float], ...]  # standard uncertainties by source [N]


def compute_flexure(kit: Apparatus) -> dict[str, float]:
    """Compute the stiffness of the two leaves, and the output of the bridge for a newton."""
    leaf = kit.flexure
    length, width, thick = (one.nominal for one in (leaf.length, leaf.width, leaf.thickness))
    # clamped at both ends, which stay parallel: twice 12 E I / L^3 (Euler and Bernoulli), less the
    # share of shear 2.4 (1 + nu) (t/L)^2, nu 0.3 (Timoshenko, 5/6)
    bending = 2.0 * leaf.modulus.value * width * (thick / length) ** 3
    # gauge factor times the strain 3 F (L/2 - s) / (E b t^2) under a gauge at s from the end of a
    # leaf
    lever = 0.5 * length - leaf.gauge_place.nominal
    strain = leaf.gauge_factor.value * 3.0 * lever / (leaf.modulus.value * width * thick**2)
    stiffness = bending / (1.0 + 2.4 * 1.3 * (thick / length) ** 2)
    return {"stiffness_n_per_m": stiffness, "sensitivity_v_per_v_per_n": strain}


def compute_normal_load(kit: Apparatus, mass: float) -> Load:
    """Compute the force of a weight [kg] over the tip on a level block.

    The arm is balanced, so the force is that of the weight alone.
    """
    # tolerances count as rectangular, and so does the friction of the pivot, whose sign is that of
    # the last movement
    gravity, carried = kit.gravity.value, [one for one in kit.parts(mass) if one.id in ON_THE_PIVOT]
    counterweight = next(one for one in carried if one.id == "counterweight")
    pressing = gravity * math.fsum(one.mass for one in carried)
    parts = {
        "weight": kit.weight_tolerance.value * mass * gravity,
        "gravity": kit.gravity_tolerance.value * mass * gravity,
        "balance": counterweight.mass * gravity * kit.balance.limits[1] / ARM,
        "friction of the pivot": kit.friction.pivot.value * pressing * 0.5 * _PIVOT_BORE / ARM,
    }
    return _make_load(mass, mass * gravity, parts)


# what turns about the pivot
ON_THE_PIVOT = ("arm", "explorer-clamp", "explorer", "weight", "balance-rod", "counterweight")


def compute_pull(kit: Apparatus, mass: float) -> Load:
    """Force along the drag of a weight with its hanger [kg], less what pulley and carriage take."""
    gravity = kit.gravity.value
    weight = mass * gravity
    # a cord that turns by a right angle presses its pulley with sqrt(2) of its tension
    pulley = math.sqrt(2.0) * weight * kit.friction.pulley.value * _PULLEY_BORE / _PULLEY
    moving = math.fsum(one.mass for one in kit.parts() if one.moving)
    carriage = kit.friction.carriage.value * gravity * moving
    parts = {
        "weight": kit.weight_tolerance.value * weight,
        "gravity": kit.gravity_tolerance.value * weight,
        # makers' coefficients scatter by half
        "friction of the pulley": 0.5 * pulley,
        "friction of the carriage": 0.5 * carriage,
    }
    return _make_load(mass, weight - pulley - carriage, parts)


def _make_load(mass: float, force: float, rectangular: dict[str, float]) -> Load:
    budget = tuple((name, half / math.sqrt(3.0)) for name, half in rectangular.items())
    return Load(mass, force, math.hypot(*(std for _, std in budget)), budget)
