"""Promise: processes at work for a command end with it, and say nothing of their own."""

import subprocess
import sys

import pytest

SCRIPT = """
from joblib.externals.loky import ProcessPoolExecutor
from stepblocks.compute.processes import arrange_end_with_parent

with ProcessPoolExecutor(2, initializer=arrange_end_with_parent) as workers:
    print(sum(workers.map(abs, range(-4, 0))))
"""


def test_workers_without_a_fork_server_start_in_silence():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("10\n", "")


FORKED = """
import os
import sys

from stepblocks.compute.processes import preload_for_workers, run_in_processes
from stepblocks.errors import PipelineError


def describe(number):
    if number < 0:
        os._exit(1)
    return number, "colorsys" in sys.modules, os.getppid()


if __name__ == "__main__":
    preload_for_workers("colorsys")
    found = list(run_in_processes(describe, [(number,) for number in range(6)], 2))
    numbers, have_loaded, starters = zip(*found)
    print(numbers, all(have_loaded), len(set(starters)), os.getpid() in starters)
    try:
        list(run_in_processes(describe, [(-1,), (0,)], 2))
    except PipelineError as error:
        print(str(error).partition(":")[0])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks what has loaded much")
def test_workers_of_the_command_line_are_forks_of_one_process_that_has_loaded_what_they_need(
    tmp_path,
):
    script = tmp_path / "stepblocks"
    script.write_text(FORKED)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.splitlines() == [
        "(0, 1, 2, 3, 4, 5) True 1 False",
        "a worker process died",
    ]
    assert done.stderr == ""


def test_a_script_without_a_main_guard_starts_its_workers_from_nothing(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(FORKED.replace('if __name__ == "__main__":', "if True:"))
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True, timeout=60
    )
    first, last = done.stdout.splitlines()
    assert first.startswith("(0, 1, 2, 3, 4, 5) False")
    assert last == "a worker process died"


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
