"""Measure the ticks of the reference renderer, and the energy of its ring against E_v.

Every tick is timed on its own, called from Python as a servo loop would, over drags of the ten
blocks there and back. Each drag is repeated: the first figures are of all ticks, interruptions by
the machine included, the last two of the fastest of the repeats of each tick, which is what the
code takes.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from stepblocks.contact.event import compute_ring_energy, list_vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declare import load_set
from stepblocks.simulators.renderer import Renderer

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


def one(stimulus: object) -> np.ndarray:
    renderer = Renderer(stimulus.counterface().centre_path(POINT.ball_radius), POINT, rate=RATE)
    event = list_vibration_events(stimulus.counterface(), POINT)[0]
    runs = [drag(renderer, event) for _ in range(REPEATS)]
    nanoseconds, energy = np.array([times for times, _ in runs]), runs[0][1]
    row(stimulus.id, nanoseconds, energy, event.energy)
    return nanoseconds


def drag(renderer: Renderer, event: object) -> tuple[np.ndarray, float]:
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
