"""Build sets of growing size: time per block and memory must not grow with their number.

    python benchmarks/sweep_of_blocks.py [--sizes 50 100 200] [--jobs 2]

The figure of the last acceptance is ``--sizes 250 500 1000``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def source(count: int) -> str:
    """Return a set of `count` blocks: heights in steps of 0.1 um, five edge radii."""
    text = (ROOT / "stimuli" / "paper-ten.toml").read_text().replace("paper-ten", "sweep")
    text = text.replace('id = "step-{height_um:03}"', 'id = "s-{height_um:03}-{edge_radius_um:02}"')
    last = 20.0 + 0.1 * (count // 5 - 1)
    text = text.replace(
        'from = "10 um", to = "100 um", step = "10 um"',
        f'from = "20 um", to = "{last:.1f} um", step = "0.1 um"',
    )
    return text.replace(
        'nominal = "0 um", tolerance = "+2 um / -0 um"',
        'values = ["0 um", "2 um", "5 um", "8 um", "12 um"], tolerance = "1 um"',
    )


def resident(pid: int) -> float:
    """Resident MiB of a process and its descendants."""
    total, waiting = 0.0, [pid]
    while waiting:
        one = waiting.pop()
        try:
            total += (
                int(Path(f"/proc/{one}/statm").read_text(encoding="utf-8").split()[1])
                * os.sysconf("SC_PAGE_SIZE")
                / 2**20
            )
            for task in Path(f"/proc/{one}/task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text().split()]
        except (OSError, ValueError):
            continue
    return total


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[50, 100, 200])
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    print(
        f"{'blocks':>7s} {'wall s':>8s} {'s per block':>12s} {'peak MiB, all processes':>24s} "
        f"{'second run s':>13s}"
    )
    for count in arguments.sizes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sweep.toml"
            path.write_text(source(count))
            command = [
                sys.executable,
                "-m",
                "stepblocks",
                "build",
                str(path),
                "-o",
                f"{folder}/out",
                "--jobs",
                str(arguments.jobs),
                "--quiet",
            ]
            started = time.perf_counter()
            process = subprocess.Popen(command)
            peak = [0.0]

            def watch(process=process, peak=peak) -> None:
                while process.poll() is None:
                    peak[0] = max(peak[0], resident(process.pid))
                    time.sleep(0.25)

            watcher = threading.Thread(target=watch)
            watcher.start()
            watcher.join()
            wall = time.perf_counter() - started
            if process.returncode:
                raise SystemExit(f"the build of {count} blocks failed")
            started = time.perf_counter()
            subprocess.run(command, check=True)
            print(
                f"{count:7d} {wall:8.1f} {wall / count:12.3f} {peak[0]:24.0f} "
                f"{time.perf_counter() - started:13.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
