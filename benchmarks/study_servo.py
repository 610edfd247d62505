"""Measure how late the ticks of the servo loop come, and whether its log is the renderer's.

Run as ``python benchmarks/study_servo.py [SECONDS] [SLICES]``: the loop alone, and with a page that
posts a mouse as a browser does; before each, for as long, a bare loop in C that does nothing but
wait for its ticks, with the same priority: what the machine does to anybody. The three take turns,
so that they see the same other programs; the load average stands beside.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from http.client import HTTPConnection
from pathlib import Path

import numpy as np

from stepblocks.contact.event import compute_ring_energy
from stepblocks.haptics.hands import Mouse
from stepblocks.haptics.servo import request_real_time_priority
from stepblocks.study.conduct.run import Run, open_run
from stepblocks.study.conduct.server import RunServer
from stepblocks.study.run import design_study

# waits as the servo does: asleep until 60 us before a tick is due, then by the clock; prints how
# late each came [s]
BARE = """
#define _GNU_SOURCE
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>
static double now(void) {
  struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}
int main(int count, char **given) {
  int n = atoi(given[1]); double *late = malloc(n * sizeof *late);
  struct sched_param first = { 20 };
  mlockall(MCL_CURRENT | MCL_FUTURE); prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
  sched_setscheduler(0, SCHED_FIFO, &first);
  double start = now() + 0.01;
  for (int i = 0; i < n; ++i) {
    double due = start + 1e-3 * i, wake = due - 60e-6;
    struct timespec t = { (time_t) wake, (long) (1e9 * (wake - (time_t) wake)) };
    if (now() < wake) clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, 0);
    while (now() < due) ;
    late[i] = now() - due;
    if (late[i] > 1e-3) start += late[i];
  }
  for (int i = 0; i < n; ++i) printf("%.9f ", late[i]);
  return 0; }
"""


def main() -> None:
    seconds, slices = (int(text) for text in (*sys.argv[1:], "10", "4")[:2])
    print(
        "| loop | load | ticks | late by 50 % us | 99 % | 99.9 % | worst | over 200 us | force "
        "deviates N | ring / E_v |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    found: dict[str, list[tuple[np.ndarray, float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        bare = compiled(Path(folder))
        design_study(
            (50e-6, 60e-6), folder, seed=2, experiment="virtual", participants=1, repetitions=1
        )
        for _ in range(slices):
            if bare:
                said = subprocess.run(
                    [bare, str(1000 * seconds)], capture_output=True, text=True, check=True
                ).stdout
                late = np.array(said.split(), dtype=float)
                found.setdefault("bare, in C", []).append(
                    (late, os.getloadavg()[0], np.nan, np.nan)
                )
            for name, drive in (("a hand alone", by_hand), ("a page at 60 Hz", by_page)):
                run = open_run(folder, "1")
                while run.now is not None and run.now["condition"] != "vibration-on":
                    run.planned.pop(0)
                server = RunServer(run)
                threading.Thread(target=served, args=(server,), daemon=True).start()
                run.begin()
                drive(server, seconds)
                late, *checks = checked(run)
                found.setdefault(name, []).append((late, os.getloadavg()[0], *checks))
                server.shutdown()
                server.server_close()
                run.close()
    for name, rows in found.items():
        row(name, rows)


def places(seconds: float) -> list[float]:
    """Back and forth over the edge at 20 mm/s in the magnified frame, 60 times a second."""
    return [
        -8e-3 + 34e-3 * abs(((0.02 * n / 60 / 34e-3) + 1.0) % 2.0 - 1.0)
        for n in range(round(60 * seconds))
    ]


def by_page(server: RunServer, seconds: float) -> None:
    """Post from a process of its own, as a browser does."""
    told = (server.server_address[1], server.token, seconds)
    page = multiprocessing.get_context("spawn").Process(target=posting, args=told)
    page.start()
    page.join()


def posting(port: int, token: str, seconds: float) -> None:
    client = HTTPConnection("127.0.0.1", port)
    for x in places(seconds):
        client.request("POST", "/hand", json.dumps({"x": x, "held": True}), {"X-Stepblocks": token})
        client.getresponse().read()
        time.sleep(1.0 / 60.0)


def by_hand(server: RunServer, seconds: float) -> None:
    """Post from a thread of the server's priority, without a page."""
    assert isinstance(server.experiment, Run)
    hand = server.experiment.hand
    assert isinstance(hand, Mouse)

    def move() -> None:
        request_real_time_priority(10)
        for x in places(seconds):
            hand.update_target(x, True)
            time.sleep(1.0 / 60.0)

    mover = threading.Thread(target=move)
    mover.start()
    mover.join()


def checked(run: Run) -> tuple[np.ndarray, float, float]:
    """Return lateness [s], deviation of logged forces [N], and the share of E_v in the ring."""
    servo = run.servo
    assert servo is not None
    assert run.blocks is not None
    servo.stop()
    record, renderer = servo.get_log_columns(), servo.renderer
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
    return record["late_s"], worst, compute_ring_energy(ring, 1000.0, tool) / expected


def row(name: str, rows: list[tuple[np.ndarray, float, float, float]]) -> None:
    late = 1e6 * np.concatenate([ticks for ticks, *_ in rows])
    load, worst, ring = np.array([figures for _, *figures in rows]).T
    figures = " | ".join(f"{np.quantile(late, q):.0f}" for q in (0.5, 0.99, 0.999, 1.0))
    over = 100.0 * float((late > 200.0).mean())
    checks = f"{worst.max():.1e} | {ring.mean():.4f}" if np.isfinite(worst).all() else "- | -"
    print(
        f"| {name} | {load.mean():.1f} | {len(late)} | {figures} | {over:.3f} % | {checks} |",
        flush=True,
    )


def compiled(folder: Path) -> str:
    """Compile the bare loop; nothing where there is no compiler."""
    if (compiler := shutil.which("cc") or shutil.which("gcc")) is None:
        return ""
    (folder / "bare.c").write_text(BARE)
    subprocess.run([compiler, "-O2", "-o", folder / "bare", folder / "bare.c"], check=True)
    return str(folder / "bare")


def served(server: RunServer) -> None:
    """Serve as `RunServer.serve_until_done` does, without its end."""
    request_real_time_priority(10)
    server.serve_forever(poll_interval=0.1)


if __name__ == "__main__":
    main()
