"""What a Dask cluster gives: drags in time with 1, 2 and 4 workers, and the scheduler's own limit.

Workers are processes of this machine, so that more of them than cores gain nothing. How many calls
a second the scheduler hands out, with calls that do nothing, says how many workers it keeps busy.

Run: python benchmarks/cluster_efficiency.py
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from distributed import Client, LocalCluster

from stepblocks.compute.seam import run_calls
from stepblocks.predict.sweep.plan import SweepPlan
from stepblocks.predict.sweep.read import load_sweep
from stepblocks.predict.sweep.run import run_sweep

PLAN = """
[sweep]
kind = "random"
rows = 4000
rows_per_partition = 250
mode = "drag"
[parameters]
height = { from = "10 um", to = "80 um" }
friction = { from = 0.1, to = 0.2 }
normal_load = { from = "0.2 N", to = "1 N" }
speed = "5 mm/s"
"""
WORKERS = (1, 2, 4)
EMPTY_CALLS = 4000
LARGE_CLUSTER = 1000


def measure_sweep(plan: SweepPlan, folder: Path, client: Client | None = None) -> float:
    """Time one sweep after a first one has loaded and compiled what it needs [rows/s]."""
    for attempt in ("warm", "timed"):
        begin = time.perf_counter()
        run_sweep(plan, folder / attempt, on=client)
        seconds = time.perf_counter() - begin
    return plan.row_count / seconds


def measure_calls(client: Client) -> float:
    """Return how many calls that do nothing come back in a second."""
    begin = time.perf_counter()
    calls = ((number,) for number in range(EMPTY_CALLS))
    for _ in run_calls(abs, calls, jobs=1, on=client, in_order=False):
        pass
    return EMPTY_CALLS / (time.perf_counter() - begin)


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "sweep.toml"
        path.write_text(PLAN, encoding="utf-8")
        plan = load_sweep(path)
        alone = measure_sweep(plan, folder / "alone")
        print(f"this process: {alone:.0f} drags/s", flush=True)
        for workers in WORKERS:
            with (
                LocalCluster(n_workers=workers, threads_per_worker=1) as cluster,
                Client(cluster, set_as_default=False) as client,
            ):
                rate = measure_sweep(plan, folder / f"workers-{workers}", client)
                efficiency = 100.0 * rate / (workers * alone)
                print(
                    f"{workers} workers: {rate:.0f} drags/s, efficiency {efficiency:.0f} %",
                    flush=True,
                )
                calls = measure_calls(client)
        partition = plan.rows_per_partition / alone
        print(f"scheduler: {calls:.0f} calls/s")
        print(
            f"{LARGE_CLUSTER} workers ask for {LARGE_CLUSTER / partition:.0f} calls/s of "
            f"{partition:.2f} s; "
            f"{LARGE_CLUSTER / calls:.1f} s of work in each call keep them busy"
        )


if __name__ == "__main__":
    main()
