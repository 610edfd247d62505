"""Promise: processes at work for a command end with it, and say nothing of their own."""

import subprocess
import sys

import pytest

SCRIPT = """
from joblib.externals.loky import ProcessPoolExecutor
from stepblocks.compute.processes import die_with_parent

with ProcessPoolExecutor(2, initializer=die_with_parent) as workers:
    print(sum(workers.map(abs, range(-4, 0))))
"""


def test_workers_without_a_fork_server_start_in_silence():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("10\n", "")


GROWING = """
import sys
import time

from stepblocks.compute.processes import run_in_processes


def hold(number):
    # 400 MB more than after the first call; the pool looks once in a second
    sys.held = b"x" * (400_000_000 if number else 1)
    time.sleep(1.2)
    return number


print(list(run_in_processes(hold, [(number,) for number in range(6)], 2)))
"""


@pytest.mark.long
def test_a_worker_that_has_grown_is_replaced_in_silence_and_the_work_goes_on():
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", GROWING],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert (done.stdout, done.stderr) == ("[0, 1, 2, 3, 4, 5]\n", "")
