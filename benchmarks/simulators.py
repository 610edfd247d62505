"""Measure the peak force of every block in every simulator beside the formula.

A cell is what that program printed when its exported folder was run here; what cannot be run here
says so. Programs that do not come with the extra `[sim]` are named on the command line: an
interpreter that has newton, the compile and link flags of an installed CHAI3D. The page to feel
runs in a headless Chromium. The last line says how far the energy of a rendered ring is off.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from oracles.browser import browser
from stepblocks.contact.event import compute_ring_energy
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declaration.read import load_set
from stepblocks.haptics.feel_page import write_feel_page
from stepblocks.haptics.renderer import Renderer
from stepblocks.parts.kind import Part
from stepblocks.quantities import parse_quantity
from stepblocks.simulators.assemble import build_scene, resolve_contact
from stepblocks.simulators.scene import Scene, write_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

ROOT = Path(__file__).resolve().parents[1]
SETS = [ROOT / "stimuli" / name for name in ("paper-ten.toml", "crown-margins.toml")]
DRAG_ACROSS = (ROOT / "tests" / "oracles" / "drag_across.js").read_text(encoding="utf-8")
RADIUS = 125e-6
SPEED, TICKS = 1e-3, 1e4  # m/s, 1/s
# peak force [N] and whether the ball crossed; None: not run here
Result = tuple[float, bool] | None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--load", default="1 N")
    parser.add_argument("--friction", type=float, default=0.15)
    parser.add_argument("--only", default="", help="start of the blocks' names")
    parser.add_argument(
        "--newton", metavar="PYTHON", help="interpreter that has newton[importers,sim]"
    )
    parser.add_argument(
        "--chai3d", metavar="FLAGS", help="compile and link flags of an installed CHAI3D"
    )
    arguments = parser.parse_args()
    point = OperatingPoint(RADIUS, parse_quantity(arguments.load, "force"), arguments.friction)
    print(
        f"R 125 um, F_py {arguments.load}, mu {arguments.friction:g}; peak force in N "
        "(deviation "
        "from the formula)\n"
    )
    print("| surface | formula | " + " | ".join(COLUMNS) + " | SOFA, H3D, Unity, Unreal, Isaac |")
    print("|---|---|" + "---|" * len(COLUMNS) + "---|")
    ten, margins = (load_set(path) for path in SETS)
    surfaces = [
        one for one in (*ten.stimuli, *margins.crown_on_tooth) if one.id.startswith(arguments.only)
    ]
    with tempfile.TemporaryDirectory(prefix="step blocks ") as folder, browser() as window:
        arguments.window = window
        if window is not None:
            page = Path(folder) / "feel.html"
            write_feel_page(SETS, page)
            window.get(page.as_uri())
        scenes = [row(Path(folder) / one.id, one, point, arguments) for one in surfaces]
    off = [ring_error(scene) for scene in scenes if scene.events[0].status == "releases"]
    print(f"\nring of the renderer: energy off by up to {100.0 * max(off):.2f} %")


def row(folder: Path, surface: Part, point: OperatingPoint, arguments: argparse.Namespace) -> Scene:
    scene = build_scene(resolve_contact(surface, point))
    event = scene.events[0]
    formula = event.critical_force if event.status == "releases" else None
    cells = [f"{formula:.4f}" if formula else event.status.value]
    cells += [cell(run(folder, scene, arguments), formula) for run in COLUMNS.values()]
    print(f"| {surface.id} | " + " | ".join(cells) + " | not run here |", flush=True)
    return scene


def ring_error(scene: Scene) -> float:
    """How far the energy of a rendered ring is off that of its event, as a share of it.

    What the ring adds is the difference from a drag that renders none; it is followed for 0.2 s.
    """
    path, event = scene.surface.counterface().centre_path(RADIUS), scene.events[0]
    way = event.critical_force / scene.stiffness + 0.2 * SPEED
    with_ring, without = (
        Renderer(path, scene.point, event=ring).drag(scene.point.normal_load, way, 1.0, SPEED)
        for ring in (True, False)
    )
    added = np.asarray(with_ring.force) - np.asarray(without.force)
    return abs(compute_ring_energy(added, TICKS, event.tool) / event.energy - 1.0)


def on_profile(_: Path, scene: Scene, __: argparse.Namespace) -> Result:
    renderer = Renderer(scene.surface.counterface().centre_path(RADIUS), scene.point)
    record = renderer.drag(scene.point.normal_load, travel(scene))
    return record.peak, record.crossed


def travel(scene: Scene) -> float:
    event = scene.events[0]
    force = event.critical_force if event.status == "releases" else 10.0 * scene.point.normal_load
    return 1.2 * force / scene.stiffness + 20e-6


def in_python(folder: Path, scene: Scene, _: argparse.Namespace) -> Result:
    words = output(
        [sys.executable, "-I", str(written(folder, scene, "forcelaw") / "force_law.py")]
    ).split()
    return float(words[1]), words[-1] == "1"


def in_c(folder: Path, scene: Scene, _: argparse.Namespace) -> Result:
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    place = written(folder, scene, "forcelaw")
    output(
        [
            compiler,
            "-std=c99",
            "-O2",
            str(place / "force_law_demo.c"),
            "-lm",
            "-o",
            str(place / "demo"),
        ]
    )
    words = output([str(place / "demo")]).split()
    return float(words[1]), words[-1] == "1"


def in_mujoco(folder: Path, scene: Scene, _: argparse.Namespace) -> Result:
    return result(
        [sys.executable, "-I", str(written(folder, scene, "mujoco") / "drag.py"), "--json"]
    )


def in_chai3d(folder: Path, scene: Scene, arguments: argparse.Namespace) -> Result:
    if not arguments.chai3d:
        return None
    place = written(folder, scene, "chai3d")
    flags = shlex.split(arguments.chai3d)
    output(
        [
            "c++",
            "-std=c++11",
            "-O2",
            "-w",
            str(place / "blocks.cpp"),
            *flags,
            "-o",
            str(place / "blocks"),
        ]
    )
    words = output([str(place / "blocks")], "1\nq\n").split()
    return float(words[words.index("peak") + 1]), "crossed" in words


def on_page(_: Path, scene: Scene, arguments: argparse.Namespace) -> Result:
    """Drag across on the page to feel, as its own script renders it."""
    if arguments.window is None:
        return None
    name = scene.events[0].stimulus
    tool = {"radius": RADIUS, "load": scene.point.normal_load, "friction": scene.point.friction}
    found = arguments.window.execute_script(
        f"{DRAG_ACROSS}\nreturn dragAcross(STIMULI.findIndex(one => one.name === '{name}'),"
        f" {json.dumps({**tool, 'limit': 1e3})})"
    )
    return found["peak"], found["events"] > 0


def in_newton(folder: Path, scene: Scene, arguments: argparse.Namespace) -> Result:
    if not arguments.newton:
        return None
    script = ROOT / "benchmarks" / "engines" / "newton_drag.py"
    return result([arguments.newton, "-I", str(script), str(written(folder, scene, "usd"))])


COLUMNS: dict[str, Callable[[Path, Scene, argparse.Namespace], Result]] = {
    "renderer": on_profile,
    "force law, Python": in_python,
    "force law, C": in_c,
    "MuJoCo, pieces": in_mujoco,
    "page to feel": on_page,
    "CHAI3D": in_chai3d,
    "Newton": in_newton,
}


def written(folder: Path, scene: Scene, name: str) -> Path:
    place = folder / name
    if not place.exists():
        place.mkdir(parents=True)
        write_scene(place, scene, SCENE_FORMATS[name])
    return place


def output(command: list[str], said: str = "") -> str:
    return subprocess.run(
        command, input=said, capture_output=True, text=True, check=True, cwd="/"
    ).stdout


def result(command: list[str]) -> Result:
    found = json.loads(output(command).strip().splitlines()[-1])
    return found["peak_force_n"], found["crossed"]


def cell(found: Result, formula: float | None) -> str:
    if found is None:
        return "not run here"
    peak, crossed = found
    if formula is None:
        return f"slips at {peak:.3f}" if crossed else f"holds {peak:.3f}"
    return f"{peak:.4f} ({100 * (peak / formula - 1):+.2f} %)" + (
        "" if crossed else ", did not cross"
    )


if __name__ == "__main__":
    main()
