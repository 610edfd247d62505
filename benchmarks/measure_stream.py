"""Memory and speed of `stepblocks measure` against the number of trials.

    python benchmarks/measure_stream.py [trials ...]

Writes sessions of one HDF5 file each and measures them in a process of its own. Every trial has a
tangential force of its own, one of sixteen kinds under noise of its own, so that no row is the
duplicate of another; time and normal force are links to those of its kind, so that 100000 trials
need 0.9 GB of disk.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

from stepblocks.rehearse.record import Rig, Truth, record_trial_by_equations

HEAD = """schema = 1
[probe]
spring_constant = "9810 N/m"
[acquisition]
sample_rate = "10 kHz"
traces = "traces.h5"
channels = { time = "time_s", tangential = "fx_n", normal = "fy_n" }
"""
RUN = """
import sys
from stepblocks.bench.measure import measure_session_to_file
measure_session_to_file(sys.argv[1], sys.argv[2], jobs=int(sys.argv[3]))
"""


def write(folder: Path, count: int) -> None:
    random = np.random.default_rng(1)
    with h5py.File(folder / "traces.h5", "w", libver="latest") as file:
        pulls = []
        for kind in range(16):
            peak = 0.6 + 0.1 * kind
            truth = Truth(0.8, 0.12, 98.1, peak, 0.45 * peak, 300.0, 21.2e-3)
            trace = record_trial_by_equations(truth, Rig(), random)[0]
            file[f"kinds/{kind}/time_s"] = trace.time.astype("f4")
            file[f"kinds/{kind}/fy_n"] = trace.normal.astype("f4")
            pulls.append(trace.tangential)
        for trial in range(1, count + 1):
            group, kind = file.create_group(f"{trial:04d}"), trial % 16
            group["fx_n"] = (pulls[kind] + random.normal(0.0, 0.5e-3, pulls[kind].shape)).astype(
                "f4"
            )
            for name in ("time_s", "fy_n"):
                group[name] = h5py.SoftLink(f"/kinds/{kind}/{name}")
    (folder / "session.toml").write_text(HEAD)
    rows = (f"{t},step-{t % 16:03d},0.8,10,{t}\n" for t in range(1, count + 1))
    with (folder / "trials.csv").open("w") as table:
        table.write("trial,block,load_n,speed_mm_s,run_order\n")
        table.writelines(rows)


def main(counts: list[int], jobs: int = 2) -> None:
    print(
        f"{'trials':>8s} {'seconds':>8s} {'processors / s':>15s} {'ms/trial':>9s} "
        f"{'largest process / MiB':>22s} {'measured':>9s}"
    )
    for count in counts:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "session"
            folder.mkdir()
            write(folder, count)
            begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(
                [sys.executable, "-c", RUN, str(folder), f"{scratch}/out.csv", str(jobs)],
                check=True,
            )
            with Path(f"{scratch}/out.csv").open(encoding="utf-8") as table:
                measured = sum(",ok," in row for row in table)
            spent = time.perf_counter() - begin
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        busy, peak = (
            after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            after.ru_maxrss / 1024.0,
        )
        print(
            f"{count:8d} {spent:8.1f} {busy:15.1f} {1e3 * busy / count:9.1f} {peak:22.0f} "
            f"{measured:9d}",
            flush=True,
        )


if __name__ == "__main__":
    main([int(text) for text in sys.argv[1:]] or [100, 1000, 10_000])
