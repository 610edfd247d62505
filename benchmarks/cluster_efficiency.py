"""What a Dask cluster gives: drags in time with 1, 2 and 4 workers, and the scheduler's own limit.

Workers are processes of this machine, so that more of them than cores gain nothing. How many calls
a second the scheduler hands out, with calls that do nothing, says how many workers it keeps busy.

Ten million drags in time and a thousand rehearsals are not run: their times are a count over the
rate that was measured with workers that have a core each. For a hundred cores the rate of one of
these workers is multiplied by a hundred. That holds while the scheduler hands out calls as fast as
a hundred workers end them: the last column says what share of its calls they take.

Run: python benchmarks/cluster_efficiency.py
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from distributed import Client, LocalCluster

from stepblocks.compute.cores import count_cores
from stepblocks.compute.seam import run_calls
from stepblocks.loop.rehearsal import rehearse_once
from stepblocks.predict.sweep.plan import SweepPlan
from stepblocks.predict.sweep.read import load_sweep
from stepblocks.predict.sweep.run import run_sweep
from stepblocks.rehearse.plan import SessionPlan, read_session_plan

PLAN = """
[sweep]
kind = "random"
rows = 4000
rows_per_partition = 500
mode = "drag"
[parameters]
height = { from = "10 um", to = "80 um" }
friction = { from = 0.1, to = 0.2 }
normal_load = { from = "0.2 N", to = "1 N" }
speed = "5 mm/s"
"""
SESSION = Path(__file__).parents[1] / "examples" / "undeclared.toml"
REHEARSALS = 16
WORKERS = (1, 2, 4)
EMPTY_CALLS = 4000
MANY_DRAGS = 10_000_000
MANY_REHEARSALS = 1000
SMALL_CLUSTER = 100
LARGE_CLUSTER = 1000


@dataclass(frozen=True)
class Job:
    """Work that is too large for one machine.

    Attributes
    ----------
    name : str
    count : int
        Of what is computed.
    per_call : int
        How many of them one call of a worker computes.
    """

    name: str
    count: int
    per_call: int


def measure_sweep(plan: SweepPlan, folder: Path, client: Client | None = None) -> float:
    """Time one sweep after a first one has loaded and compiled what it needs [rows/s]."""
    for attempt in ("warm", "timed"):
        begin = time.perf_counter()
        run_sweep(plan, folder / attempt, on=client)
        seconds = time.perf_counter() - begin
    return plan.row_count / seconds


def measure_rehearsals(plan: SessionPlan, client: Client) -> float:
    """Time rehearsals of a session after a first one on each worker [rehearsals/s]."""
    for count in (count_cores(), REHEARSALS):
        seeded = [(plan.model_copy(update={"seed": seed}),) for seed in range(count)]
        begin = time.perf_counter()
        for _ in run_calls(rehearse_once, seeded, jobs=1, on=client, in_order=False):
            pass
        seconds = time.perf_counter() - begin
    return REHEARSALS / seconds


def measure_calls(client: Client) -> float:
    """Return how many calls that do nothing come back in a second."""
    begin = time.perf_counter()
    calls = ((number,) for number in range(EMPTY_CALLS))
    for _ in run_calls(abs, calls, jobs=1, on=client, in_order=False):
        pass
    return EMPTY_CALLS / (time.perf_counter() - begin)


def format_seconds(seconds: float) -> str:
    """Write a time in the unit in which people say it."""
    if seconds >= 2.0 * 3600.0:
        return f"{seconds / 3600.0:.1f} h"
    return f"{seconds / 60.0:.1f} min"


def print_job(job: Job, rate: float, workers: int, calls_per_second: float) -> None:
    """Print the row of a job.

    Parameters
    ----------
    job : Job
    rate : float
        Of `workers` together [1/s].
    workers : int
        Each with a core of its own.
    calls_per_second : float
        That the scheduler hands out.
    """
    large_rate = SMALL_CLUSTER * rate / workers
    here = format_seconds(job.count / rate)
    there = format_seconds(job.count / large_rate)
    share = large_rate / job.per_call / calls_per_second
    print(f"| {job.name} | {rate:.1f} | {here} | {there} | {100.0 * share:.1f} % |", flush=True)


def main() -> None:
    """Measure and print."""
    calls_per_second = 0.0
    rates = {}
    with_a_core = max(workers for workers in WORKERS if workers <= count_cores())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "sweep.toml"
        path.write_text(PLAN, encoding="utf-8")
        plan = load_sweep(path)
        alone = measure_sweep(plan, folder / "alone")
        print(f"this process: {alone:.0f} drags/s\n", flush=True)
        print("# Drags in time by the workers of this machine")
        print("| workers | drags/s | efficiency |\n|---|---|---|")
        for workers in WORKERS:
            with (
                LocalCluster(n_workers=workers, threads_per_worker=1) as cluster,
                Client(cluster, set_as_default=False) as client,
            ):
                rate = measure_sweep(plan, folder / f"workers-{workers}", client)
                efficiency = 100.0 * rate / (workers * alone)
                print(f"| {workers} | {rate:.0f} | {efficiency:.0f} % |", flush=True)
                if workers == with_a_core:
                    calls_per_second = measure_calls(client)
                    rates["drags"] = rate
                    rates["rehearsals"] = measure_rehearsals(read_session_plan(SESSION), client)
    print(f"\nscheduler: {calls_per_second:.0f} calls/s")
    print(
        f"{LARGE_CLUSTER} workers are busy while each call takes "
        f"{LARGE_CLUSTER / calls_per_second:.1f} s or more\n"
    )
    print(f"# Large jobs, from the rate of {with_a_core} workers")
    print(f"| job | each second | here | {SMALL_CLUSTER} cores | of the scheduler |")
    print("|---|---|---|---|---|")
    drags = Job(f"{MANY_DRAGS:,} drags in time", MANY_DRAGS, plan.rows_per_partition)
    print_job(drags, rates["drags"], with_a_core, calls_per_second)
    rehearsals = Job(f"{MANY_REHEARSALS:,} rehearsals", MANY_REHEARSALS, 1)
    print_job(rehearsals, rates["rehearsals"], with_a_core, calls_per_second)


if __name__ == "__main__":
    main()
