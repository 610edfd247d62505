"""Rows per second of a sweep, static and in time, in one process and with 1 and 2 Dask workers.

Run: python benchmarks/sweep_rows_per_second.py
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from distributed import Client, LocalCluster

from stepblocks.predict.sweep.plan import load_sweep
from stepblocks.predict.sweep.run import sweep

TEXT = """
[sweep]
kind = "random"
rows = {rows}
rows_per_partition = {size}
mode = "{mode}"
[parameters]
height = {{ from = "10 um", to = "80 um" }}
friction = {{ from = 0.1, to = 0.2 }}
normal_load = {{ from = "0.2 N", to = "1 N" }}
speed = "5 mm/s"
[draws]
height = "0.5 um"
"""


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plans = {}
        for mode, rows, size in (("static", 100_000, 5000), ("drag", 6000, 250)):
            path = folder / f"{mode}.toml"
            path.write_text(TEXT.format(rows=rows, size=size, mode=mode))
            plans[mode] = load_sweep(path)
            begin = time.perf_counter()
            sweep(plans[mode], folder / f"{mode}-0")
            print(
                f"{mode:6s} in this process: {rows / (time.perf_counter() - begin):8.0f} rows/s",
                flush=True,
            )
        for workers in (1, 2):
            cluster = LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
            with cluster, Client(cluster, set_as_default=False) as client:
                client.run(__import__, "stepblocks.drag.ring")
                for mode, plan in plans.items():
                    begin = time.perf_counter()
                    sweep(plan, folder / f"{mode}-{workers}", scheduler=cluster.scheduler_address)
                    seconds = time.perf_counter() - begin
                    same = all(
                        p.read_bytes() == (folder / f"{mode}-0" / p.name).read_bytes()
                        for p in (folder / f"{mode}-{workers}").glob("part-*.parquet")
                    )
                    print(
                        f"{mode:6s} {workers} worker(s): {plan.rows / seconds:8.0f} "
                        "rows/s, "
                        "same "
                        f"bytes: {same}"
                    )


if __name__ == "__main__":
    main()
