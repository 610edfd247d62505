"""Time of `stepblocks loop` from a folder of traces to the report, by the wall and in processor seconds.

python benchmarks/loop_seconds.py SESSION ...
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main(sessions: list[str]) -> None:
    print(f"{'session':20s} {'trials':>7s} {'wall / s':>9s} {'processors / s':>15s}")
    for session in sessions:
        with tempfile.TemporaryDirectory() as scratch:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            begin = time.perf_counter()
            code = "import sys; from stepblocks.cli import main; sys.exit(main(sys.argv[1:]))"
            command = [sys.executable, "-c", code, "loop", session, "-o", f"{scratch}/loop"]
            subprocess.run(command, check=True, capture_output=True)
            spent = time.perf_counter() - begin
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            trials = len((Path(scratch) / "loop" / "features.csv").read_text(encoding="utf-8").splitlines()) - 1
        processors = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        print(f"{Path(session).name:20s} {trials:7d} {spent:9.1f} {processors:15.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
