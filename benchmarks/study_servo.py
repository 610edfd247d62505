"""How late the ticks of the servo loop come, and whether its log holds what the renderer says. Prints a table.

Run as ``python benchmarks/study_servo.py [SECONDS]``: the loop alone, and with a page that posts a mouse as a browser does.
"""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from http.client import HTTPConnection

import numpy as np

from stepblocks.contact.event import ring_energy
from stepblocks.study.conduct import Run, open_run
from stepblocks.study.run import design_study
from stepblocks.study.serve import RunServer


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    print("| load | ticks | late by 50 % us | 99 % | 99.9 % | worst | over 200 us | force deviates N | ring / E_v |")
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        design_study((50e-6, 60e-6), folder, seed=2, experiment="virtual", participants=1, repetitions=1)
        for load in ("a hand alone", "a page at 60 Hz"):
            run = open_run(folder, "1")
            while run.now["condition"] != "vibration-on":
                run.planned.pop(0)
            server = RunServer(run)
            threading.Thread(target=server.serve_forever, daemon=True).start()
            run.begin()
            (by_page if load.startswith("a page") else by_hand)(server, seconds)
            row(load, run)
            server.shutdown()
            server.server_close()
            run.close()


def places(seconds: float) -> list[float]:
    """Back and forth over the edge at 20 mm/s in the magnified frame, 60 times a second."""
    return [-8e-3 + 34e-3 * abs(((0.02 * n / 60 / 34e-3) + 1.0) % 2.0 - 1.0) for n in range(round(60 * seconds))]


def by_page(server: RunServer, seconds: float) -> None:
    client = HTTPConnection("127.0.0.1", server.server_address[1])
    for x in places(seconds):
        client.request("POST", "/hand", json.dumps({"x": x, "held": True}), {"X-Stepblocks": server.token})
        client.getresponse().read()
        time.sleep(1.0 / 60.0)


def by_hand(server: RunServer, seconds: float) -> None:
    for x in places(seconds):
        server.experiment.hand.post(x, True)
        time.sleep(1.0 / 60.0)


def row(load: str, run: Run) -> None:
    servo = run._running
    servo.stop()
    record, renderer = servo.record(), servo.renderer
    late = record["late_s"] * 1e6
    force, worst, before = np.zeros((servo.ticks, 3)), 0.0, 0.0
    for index in range(servo.ticks):
        position = np.array([record[f"{axis}_m"][index] for axis in "xyz"])
        if record["held"][index]:
            if not before:
                renderer.reset(position)
            force[index] = renderer.tick(position, np.zeros(3))
        before = record["held"][index]
    for axis, name in enumerate("xyz"):
        worst = max(worst, float(np.abs(force[:, axis] - record[f"force_{name}_n"]).max()))
    first = int(np.flatnonzero(record["events"] > 0)[0])
    ring = (record["force_x_n"] + record["pull_n"])[first : first + 120]
    tool = run.blocks.point.tool
    expected = tool.conversion * 0.5 * record["pull_n"][first - 1] ** 2 / tool.stiffness
    share = ring_energy(ring, 1000.0, tool) / expected
    figures = " | ".join(f"{np.quantile(late, q):.0f}" for q in (0.5, 0.99, 0.999, 1.0))
    over = 100.0 * float((late > 200.0).mean())
    print(f"| {load} | {servo.ticks} | {figures} | {over:.3f} % | {worst:.1e} | {share:.4f} |", flush=True)


if __name__ == "__main__":
    main()
