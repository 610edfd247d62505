"""Rows per second of a sweep, static and in time, in one process and with two.

Run: python benchmarks/sweep_rows_per_second.py
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from stepblocks.predict.sweep.read import load_sweep
from stepblocks.predict.sweep.run import run_sweep

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
        plans, alone = {}, {}
        for mode, rows, size in (("static", 1_000_000, 100_000), ("drag", 6000, 250)):
            path = folder / f"{mode}.toml"
            path.write_text(TEXT.format(rows=rows, size=size, mode=mode))
            plans[mode] = load_sweep(path)
            begin = time.perf_counter()
            run_sweep(plans[mode], folder / f"{mode}-0")
            alone[mode] = time.perf_counter() - begin
            print(f"{mode:6s} in this process: {rows / alone[mode]:8.0f} rows/s", flush=True)
        for mode, plan in plans.items():
            begin = time.perf_counter()
            run_sweep(plan, folder / f"{mode}-2", jobs=2)
            seconds = time.perf_counter() - begin
            same = all(
                path.read_bytes() == (folder / f"{mode}-0" / path.name).read_bytes()
                for path in (folder / f"{mode}-2").glob("part-*.parquet")
            )
            rate = f"{plan.row_count / seconds:8.0f} rows/s"
            print(
                f"{mode:6s} in two processes: {rate}, same bytes: {same}, "
                f"{alone[mode] / seconds:.1f} times as fast"
            )


if __name__ == "__main__":
    main()
