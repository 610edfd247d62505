"""Compare a full build of ``paper-ten`` with cadquery and build123d scripts for STEP and STL.

    python benchmarks/build_against_scripts.py [--runs 3] [--build123d PYTHON]

Prints whole-process wall time, CPU time and peak memory of each, their ratios to the cadquery
script, what each further artefact costs, and triangles per mesh. The scripts model the same block
(step, chamfers, groove, tapped holes, engraving) as their users would. build123d needs another
build of the CAD kernel than cadquery and so another environment: ``--build123d PYTHON`` names its
interpreter; without it, it is said to be missing.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import os
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BECOME_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER of prctl(2)

CADQUERY = """
import sys, cadquery as cq
for h in range(10, 101, 10):
    H = h / 1000
    outline = [(-10, -8), (10, -8), (10, H), (0, H), (0, 0), (-10, 0)]
    block = cq.Workplane("XZ").polyline(outline).close().extrude(24, both=False)
    block = block.translate((0, 12, 0)).edges("|Z or <Z").chamfer(0.3)
    block = block.faces("<Z").workplane(origin=(0, 0, 0)).pushPoints([(-6, 0), (6, 0)]).hole(2.5, 5)
    block = block.cut(cq.Workplane("XY").box(0.6, 6, 1, centered=False).translate((2, 6, 0)))
    block = block.cut(cq.Workplane("XZ", origin=(0, -11.85, -4)).text(f"STEP-{h:03}", 3.0, 0.5))
    cq.exporters.export(block, f"{sys.argv[1]}/step-{h:03}.step")
    cq.exporters.export(block, f"{sys.argv[1]}/step-{h:03}.stl", tolerance=0.01)
"""

BUILD123D = """
import sys
from build123d import *
for h in range(10, 101, 10):
    H = h / 1000
    outline = Polyline((-10, -8), (10, -8), (10, H), (0, H), (0, 0), (-10, 0), close=True)
    block = extrude(Plane.XZ * make_face(outline), 24).translate((0, 12, 0))
    block = chamfer(block.edges().filter_by(Axis.Z) + block.faces().sort_by(Axis.Z)[0].edges(), 0.3)
    for x in (-6, 6):
        block -= Pos(x, 0, -5.5) * Cylinder(1.25, 5)
    block -= Pos(2.3, 9, 0.5) * Box(0.6, 6, 1)
    block -= extrude(Plane.XZ.offset(11.85) * Pos(0, -4) * Text(f"STEP-{h:03}", 3.0), 0.5)
    export_step(block, f"{sys.argv[1]}/step-{h:03}.step")
    export_stl(block, f"{sys.argv[1]}/step-{h:03}.stl", tolerance=0.01)
"""

TWO_FORMATS = """
import sys
from pathlib import Path
from stepblocks.artefacts.meshes.write import write_stl
from stepblocks.parts.shapes import mesh_solid
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.parts.shapes import build_solids
from stepblocks.declaration.read import load_set
for stimulus in load_set(Path(sys.argv[2])).stimuli:
    bodies = build_solids(stimulus)
    write_step_ap242(Path(sys.argv[1]) / f"{stimulus.id}.step", stimulus, bodies)
    write_stl(Path(sys.argv[1]) / f"{stimulus.id}.stl", mesh_solid(stimulus, *bodies[0]))
"""


def adopt_orphans() -> None:
    """Let this process wait for what a command leaves behind, such as the server of its workers."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(BECOME_SUBREAPER, 1, 0, 0, 0)


def measure(command: list[str]) -> tuple[float, float, float]:
    """Wall and CPU seconds and peak resident MiB (largest process) of a command.

    The CPU seconds are those of all its processes.
    """
    started = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - started
    if status:
        raise SystemExit(f"failed: {' '.join(command)[:200]}")
    usages = [usage]
    with contextlib.suppress(ChildProcessError):  # until none is left
        while True:
            usages.append(os.wait4(-1, 0)[2])
    cpu = sum(usage.ru_utime + usage.ru_stime for usage in usages)
    return wall, cpu, max(usage.ru_maxrss for usage in usages) / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument(
        "--build123d", metavar="PYTHON", help="interpreter of an environment with build123d"
    )
    arguments = parser.parse_args()
    adopt_orphans()
    runs = arguments.runs
    stimuli = str(ROOT / "stimuli" / "paper-ten.toml")
    python = sys.executable
    commands = {
        "bare cadquery script, STEP + STL": lambda out: [python, "-c", CADQUERY, out],
        "build123d script, STEP + STL": lambda out: [arguments.build123d, "-c", BUILD123D, out],
        "stepblocks, STEP + STL only": lambda out: [python, "-c", TWO_FORMATS, out, stimuli],
        "stepblocks build, everything, 1 process": lambda out: [
            python,
            "-m",
            "stepblocks",
            "build",
            stimuli,
            "-o",
            out,
            "--jobs",
            "1",
        ],
        "stepblocks build, everything": lambda out: [
            python,
            "-m",
            "stepblocks",
            "build",
            stimuli,
            "-o",
            out,
        ],
    }
    if arguments.build123d is None:
        print("build123d: not measured; name its interpreter with --build123d")
        del commands["build123d script, STEP + STL"]
    results: dict[str, list[tuple[float, float, float]]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            with tempfile.TemporaryDirectory() as out:
                results[name].append(measure(command(out)))
    base = statistics.median(run[0] for run in results["bare cadquery script, STEP + STL"])
    print(
        f"{'median of ' + str(runs) + ' runs':42s} {'wall s':>8s} {'cpu s':>8s} "
        f"{'peak MiB':>9s} "
        f"{'wall ratio':>11s}"
    )
    for name, measured in results.items():
        wall, cpu, memory = (statistics.median(column) for column in zip(*measured, strict=True))
        print(f"{name:42s} {wall:8.2f} {cpu:8.2f} {memory:9.0f} {wall / base:11.2f}")
    print()
    extra_costs(Path(stimuli))


def extra_costs(stimuli: Path) -> None:
    """Print what each artefact costs per block, in one process after imports."""
    from stepblocks.artefacts.check import check_artefact
    from stepblocks.artefacts.heightfield import write_height_field
    from stepblocks.artefacts.meshes.write import MESH_FORMATS, write_convex_pieces
    from stepblocks.artefacts.step.write import write_step_ap242
    from stepblocks.build.make import list_possible_artefact_paths
    from stepblocks.build.picture import render_part_picture
    from stepblocks.declaration.read import load_set
    from stepblocks.parts.kinds.step_block import StepBlock
    from stepblocks.parts.shapes import build_convex_pieces, build_solids, mesh_solid

    spent: dict[str, float] = {}

    def timed(name, call):
        started = time.perf_counter()
        result = call()
        spent[name] = spent.get(name, 0.0) + time.perf_counter() - started
        return result

    triangles = []
    blocks = [stimulus for stimulus in load_set(stimuli).stimuli if isinstance(stimulus, StepBlock)]
    with tempfile.TemporaryDirectory() as out:
        folder = Path(out)
        for number, block in enumerate([blocks[0], *blocks]):
            bodies = timed("solid", partial(build_solids, block))
            timed("STEP", partial(write_step_ap242, folder / f"{block.id}.step", block, bodies))
            mesh = timed("tessellation", partial(mesh_solid, block, *bodies[0]))
            for ending, write in MESH_FORMATS.items():
                timed(ending, partial(write, folder / f"{block.id}{ending}", mesh))
            pieces = timed("convex pieces", partial(build_convex_pieces, block))
            timed(
                "convex pieces",
                partial(write_convex_pieces, folder / f"{block.id}.convex.obj", pieces),
            )
            timed(
                "height field",
                partial(write_height_field, folder / f"{block.id}.heightfield", block),
            )
            arrays = [(mesh.vertices, mesh.triangles)]
            timed(
                "picture",
                partial(
                    render_part_picture,
                    folder / f"{block.id}.png",
                    arrays,
                    *block.choose_close_up(),
                ),
            )
            for path in list_possible_artefact_paths(block, folder):
                timed(f"read back {path.suffix}", partial(check_artefact, block, path))
            triangles.append(len(mesh.triangles))
            if number == 0:  # the first block pays for imports
                spent.clear()
                triangles.clear()
    print("cost of each artefact per block, ms (one process, after imports)")
    for name, seconds in spent.items():
        print(f"  {name:24s} {1e3 * seconds / len(triangles):8.1f}")
    print(f"triangles per mesh: {min(triangles)} to {max(triangles)}")


if __name__ == "__main__":
    main()
