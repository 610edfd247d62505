"""Measure `stepblocks loop` from a folder of traces to the report, wall and processor seconds.

``python benchmarks/loop_seconds.py SESSION ...`` takes sessions that are there, ``--trials 240
4000`` makes some of so many trials by ``tests/oracles/virtual_session.py``, friction that runs in
among them; ``--jobs`` as of the command.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session


def seconds(session: Path, *options: str) -> tuple[int, float, float]:
    """Trials, and seconds by the wall and of all processors together."""
    with tempfile.TemporaryDirectory() as scratch:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.perf_counter()
        code = "import sys; from stepblocks.cli import main; sys.exit(main(sys.argv[1:]))"
        asked = [
            sys.executable,
            "-c",
            code,
            "loop",
            str(session),
            "-o",
            f"{scratch}/loop",
            *options,
        ]
        subprocess.run(asked, check=True, capture_output=True)
        wall = time.perf_counter() - begin
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        trials = (
            len((Path(scratch) / "loop" / "features.csv").read_text(encoding="utf-8").splitlines())
            - 1
        )
    return trials, wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print a row for each session."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", nargs="*", type=Path, metavar="SESSION")
    parser.add_argument(
        "--trials",
        nargs="+",
        type=int,
        default=[],
        metavar="N",
        help="make sessions of so many trials",
    )
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    passed = ["--jobs", str(options.jobs)]
    print(f"{'session':20s} {'trials':>7s} {'wall / s':>9s} {'processors / s':>15s}")
    with tempfile.TemporaryDirectory() as scratch:
        made = [Path(scratch) / f"of-{count}" for count in options.trials]
        for folder, count in zip(made, options.trials, strict=True):
            write_session(
                folder, Plan(bench=Bench(conversion=0.2), trials=count, running_in=0.5), 1
            )
        for session in (*options.sessions, *made):
            trials, wall, processors = seconds(session, *passed)
            print(f"{session.name:20s} {trials:7d} {wall:9.1f} {processors:15.1f}", flush=True)


if __name__ == "__main__":
    main()
