"""Peak force of every block in every simulator beside the formula: python benchmarks/simulators.py [--load '1 N'] [--friction 0.15].

A cell is what that program printed when its exported folder was run here; what cannot be run here says so.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from stepblocks.haptics.condition import Condition
from stepblocks.haptics.renderer.hand import drag
from stepblocks.haptics.renderer.path import centre_path
from stepblocks.haptics.renderer.servo import Renderer
from stepblocks.haptics.scenes.assemble import assemble_scene
from stepblocks.haptics.scenes.registry import SCENE_FORMATS
from stepblocks.haptics.scenes.scene import write_common
from stepblocks.quantities import parse_quantity
from stepblocks.stimulus.loader import load_set

ROOT = Path(__file__).resolve().parents[1]
RADIUS = 125e-6
NOT_RUN = ("chai3d", "sofa", "usd", "gltf", "x3d", "urdf")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--load", default="1 N")
    parser.add_argument("--friction", type=float, default=0.15)
    arguments = parser.parse_args()
    condition = Condition(RADIUS, parse_quantity(arguments.load, "force"), arguments.friction)
    print(f"R 125 um, F_py {arguments.load}, mu {arguments.friction:g}; peak force in N (deviation from the formula)\n")
    print("| block | formula | reference renderer | force law | MuJoCo | CHAI3D, SOFA, USD, glTF, X3D, URDF engines |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="step blocks ") as folder:
        for block in load_set(ROOT / "stimuli" / "paper-ten.toml").stimuli:
            row(Path(folder), block, condition)


def row(folder: Path, block: object, condition: Condition) -> None:
    scene = assemble_scene(block, condition)
    event = scene.events[0]
    formula = event.critical_force if event.status == "releases" else None
    renderer = Renderer(centre_path(block, RADIUS), condition)
    travel = 1.2 * (formula or 10.0 * condition.normal_load) / renderer.stiffness
    record = drag(renderer, condition.normal_load, travel)
    law = run(folder, scene, "forcelaw", "force_law.py").split()
    mujoco = json.loads(run(folder, scene, "mujoco", "drag.py", "--json"))
    cells = [
        f"{formula:.4f}" if formula else event.status.value,
        cell(record.peak, record.crossed, formula),
        cell(float(law[1]), law[-1] == "1", formula),
        cell(mujoco["peak_force_n"], mujoco["crossed"], formula),
        "not run here",
    ]
    print(f"| {block.id} | " + " | ".join(cells) + " |", flush=True)


def run(folder: Path, scene: object, name: str, script: str, *arguments: str) -> str:
    place = folder / scene.stimulus.id / name
    place.mkdir(parents=True)
    SCENE_FORMATS[name].write(place, scene)
    write_common(place, scene, SCENE_FORMATS[name])
    command = [sys.executable, "-I", str(place / script), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd="/").stdout


def cell(peak: float, crossed: bool, formula: float | None) -> str:
    if formula is None:
        return f"slips at {peak:.3f}" if crossed else f"holds {peak:.3f}"
    return f"{peak:.4f} ({100 * (peak / formula - 1):+.2f} %)" + ("" if crossed else ", did not cross")


if __name__ == "__main__":
    main()
