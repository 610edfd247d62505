"""Promise: processes at work for a command end with it, and say nothing of their own."""

import subprocess
import sys

SCRIPT = """
from joblib.externals.loky import ProcessPoolExecutor
from stepblocks.workers import die_with_parent

with ProcessPoolExecutor(2, initializer=die_with_parent) as workers:
    print(sum(workers.map(abs, range(-4, 0))))
"""


def test_workers_without_a_fork_server_start_in_silence():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("10\n", "")
