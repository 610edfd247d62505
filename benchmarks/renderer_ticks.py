"""Measure the ticks of the reference renderer, and the energy of its ring against E_v.

Every tick is timed on its own, called from Python as a servo loop would, over drags of the ten
blocks there and back. Each drag is repeated: the first figures are of all ticks, interruptions by
the machine included, the last two of the fastest of the repeats of each tick, which is what the
code takes.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from stepblocks.contact.event import VibrationEvent, compute_ring_energy, list_vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.haptics.renderer import Renderer
from stepblocks.parts.kind import Part
from stepblocks.simulators.assemble import build_scene, iterate_scanned_teeth, resolve_contact
from stepblocks.simulators.export import export_scenes
from stepblocks.simulators.scene import write_tooth_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

RATE = 10e3
REPEATS = 5
POINT = OperatingPoint(125e-6, 1.0, 0.15)
ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    print(
        "| surface | ticks | median us | 99.9 % us | worst us | fastest of 5: 99.9 % | worst | "
        "ring uJ | E_v uJ | deviation |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    blocks = load_set(ROOT / "stimuli" / "paper-ten.toml").stimuli
    row("ten blocks", np.concatenate([one(block) for block in blocks], axis=1))
    row("tooth of six stations, C library called from Python", tooth())
    print(f"\nC library called from C, block of 50 um: {in_c()}")


def one(stimulus: Part) -> np.ndarray:
    renderer = Renderer(stimulus.counterface().centre_path(POINT.ball_radius), POINT, rate=RATE)
    event = list_vibration_events(stimulus.counterface(), POINT)[0]
    runs = [drag(renderer, event) for _ in range(REPEATS)]
    nanoseconds, energy = np.array([times for times, _ in runs]), runs[0][1]
    row(stimulus.id, nanoseconds, energy, event.energy)
    return nanoseconds


def in_c() -> str:
    """Build the library as its README says, and let its example time 200,000 ticks on one core."""
    with tempfile.TemporaryDirectory() as name:
        export_scenes(ROOT / "stimuli" / "paper-ten.toml", "native", name, only="step-050")
        folder = Path(name) / "paper-ten" / "step-050" / "native"
        for command in (["-S", ".", "-B", "build"], ["--build", "build"]):
            subprocess.run(["cmake", *command], cwd=folder, capture_output=True, check=True)
        command = ["build/drag", "blocks.txt", "--time"]
        if shutil.which("taskset"):
            command = ["taskset", "-c", "0", *command]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()[-1]


def tooth() -> np.ndarray:
    """Time each tick of a drag over the margin of a scanned tooth, as a loop in C answers it."""
    sys.path.insert(0, str(ROOT / "tests"))
    from oracles.scanned_tooth import RADIUS, scan, scanned_set

    with tempfile.TemporaryDirectory() as name:
        source = scanned_set(Path(name), scan(noise=0.0), stations=6)
        stimuli = load_set(source)
        scenes = [
            build_scene(resolve_contact(part, choose_operating_point(stimuli, part, {})))
            for part in stimuli.stimuli
        ]
        ((mesh, stations),) = iterate_scanned_teeth(scenes, source.parent)
        folder = Path(name) / "native"
        write_tooth_scene(folder, mesh, stations, SCENE_FORMATS["native"])
        for command in (["-S", ".", "-B", "build"], ["--build", "build"]):
            subprocess.run(["cmake", *command], cwd=folder, capture_output=True, check=True)
        path = folder / "stepblocks_native.py"
        spec = importlib.util.spec_from_file_location("tooth_binding", path)
        assert spec is not None
        assert spec.loader is not None
        binding = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(binding)
        times, clock = np.empty((REPEATS, 4000), dtype=np.int64), time.perf_counter_ns
        for repeat in range(REPEATS):
            with binding.World(folder / "blocks.txt") as world:
                hand = np.array([RADIUS + POINT.ball_radius - 5e-5, 0.0, -1e-4])
                for index in range(times.shape[1]):
                    start = clock()
                    last = world.tick_tooth(hand, dt=1.0 / RATE)
                    times[repeat, index] = clock() - start
                    hand += np.array([(last.load - 0.5) / 9.81e3, 0.0, 1e-7])
    return times


def drag(renderer: Renderer, event: VibrationEvent) -> tuple[np.ndarray, float]:
    """Pull over the edge at 2 mm/s, stop for the ring, and return; the load is held."""
    pull = 1.1 * event.critical_force / renderer.stiffness
    x = event.trigger_position - 20e-6
    there = np.arange(x, event.trigger_position + pull + 1e-4, 2e-3 / RATE)
    xs = np.concatenate([there, np.full(1500, there[-1]), there[::-1]])
    position, velocity = np.array([x, 0.0, event.trigger_height - 1e-6]), np.zeros(3)
    above = np.array([x, 0.0, 1e-3])
    renderer.reset(above)
    renderer.tick(position, velocity)  # compiled before it is timed
    renderer.reset(above)
    times, ring = np.empty(len(xs), dtype=np.int64), []
    clock = time.perf_counter_ns
    for index, x in enumerate(xs):
        position[0] = x
        start = clock()
        force = renderer.tick(position, velocity)
        times[index] = clock() - start
        if renderer.events == 1 and index < len(there) + 1500:
            ring.append(force[0] + renderer.pull)
        position[2] += (force[2] - POINT.normal_load) / renderer.wall
    return times, compute_ring_energy(np.array(ring), RATE, event.tool)


def row(
    name: str, nanoseconds: np.ndarray, energy: float | None = None, expected: float | None = None
) -> None:
    median, most, worst = (float(np.quantile(nanoseconds, q)) * 1e-3 for q in (0.5, 0.999, 1.0))
    own, longest = (float(np.quantile(nanoseconds.min(axis=0), q)) * 1e-3 for q in (0.999, 1.0))
    times = (
        f"{nanoseconds.size} | {median:.2f} | {most:.1f} | {worst:.0f} | {own:.1f} | {longest:.1f}"
    )
    tail = "| | |"
    if energy is not None:
        tail = (
            f"{energy * 1e6:.3f} | {expected * 1e6:.3f} | {100 * (energy / expected - 1):+.2f} % |"
        )
    print(f"| {name} | {times} | {tail}", flush=True)


if __name__ == "__main__":
    main()
