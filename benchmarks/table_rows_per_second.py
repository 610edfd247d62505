"""Processor time of `predict_table` beside that of `run_sweep`, over as many rows in one run.

Run: python benchmarks/table_rows_per_second.py [ROWS]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from stepblocks.predict.sweep.run import run_sweep
from stepblocks.predict.table import predict_table

PLAN = """
[sweep]
kind = "random"
rows = {rows}
rows_per_partition = 100000
[parameters]
height = {{ from = "10 um", to = "80 um" }}
friction = {{ from = 0.1, to = 0.2 }}
normal_load = {{ from = "0.2 N", to = "1 N" }}
"""
SHARE_UNCERTAIN = 1000  # of so many rows one has an uncertainty in the last measurement


def make_table(rows: int) -> pd.DataFrame:
    """Draw heights, loads and frictions."""
    random = np.random.default_rng(0)
    return pd.DataFrame(
        {
            "height_um": random.uniform(10.0, 80.0, rows),
            "load_n": random.uniform(0.2, 1.0, rows),
            "friction": random.uniform(0.1, 0.2, rows),
        }
    )


def measure_table(table: pd.DataFrame) -> float:
    """Return the processor time of a prediction [s]."""
    begin = time.process_time()
    predict_table(table)
    return time.process_time() - begin


def main() -> None:
    """Measure and print."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    table = make_table(rows)
    predict_table(table[:10])
    exact = measure_table(table)
    print(f"predict_table, known exactly: {exact:.2f} s of processor time for {rows} rows")
    with tempfile.TemporaryDirectory() as name:
        plan = Path(name) / "sweep.toml"
        plan.write_text(PLAN.format(rows=rows))
        begin = time.process_time()
        run_sweep(plan, Path(name) / "sweep")
        swept = time.process_time() - begin
    print(f"run_sweep: {swept:.2f} s; predict_table takes {exact / swept:.2f} of it")
    uncertain = table[: max(rows // SHARE_UNCERTAIN, 1)].assign(u_height_um=0.5)
    seconds = measure_table(uncertain)
    print(f"predict_table with an interval: {1e3 * seconds / len(uncertain):.2f} ms a row")


if __name__ == "__main__":
    main()
