"""A slice of what `benchmarks/fuzz.py` and `benchmarks/faults.py` run at length."""

import csv
import errno
import hashlib
import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

import stepblocks
from stepblocks.cli import main
from stepblocks.errors import PipelineError
from stepblocks.study.conduct.run import open_run
from stepblocks.study.run import design_study

ROOT = Path(__file__).resolve().parents[1]
FOUR = str(ROOT / "stimuli" / "paper-four.toml")


def tree(folder):
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.is_file()
    }


def test_strange_files_are_read_or_refused_in_our_own_words(tmp_path):
    texts = (
        "stimuli",
        "devices",
        "sweeps",
        "plans",
        "models",
        "as-built",
        "records",
        "tables",
        "trials",
    )
    command = [
        sys.executable,
        str(ROOT / "benchmarks" / "fuzz.py"),
        *texts,
        "hdf5",
        "mat",
        "tdms",
        "xlsx",
        "--count",
        "4",
    ]
    done = subprocess.run(
        [*command, "--keep", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(done.stdout.splitlines()) == 2 + 13 + 1  # head, kinds, and all


@pytest.mark.long  # loads every command
def test_the_honest_word_of_every_option_is_read_before_it_is_mutated(tmp_path):
    script = str(ROOT / "benchmarks" / "fuzz.py")
    command = [sys.executable, script, "arguments", "--count", "10", "--keep", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].startswith("| all | 10 |")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    assert main(["study", "design", FOUR, "--seed", "1", "-o", str(folder)]) == 0
    return tree(folder)


# so many files are renamed
@pytest.mark.parametrize(
    "point", [1, *(pytest.param(point, marks=pytest.mark.long) for point in (2, 3))]
)
@pytest.mark.parametrize("fault", ["sync", "rename", "memory"])
def test_whatever_fails_while_a_study_is_written_the_next_run_gives_the_same_bytes(
    fault, point, whole, tmp_path, monkeypatch, capsys
):
    owner, name = (Path, "replace") if fault == "rename" else (os, "fsync")
    call, count = getattr(owner, name), 0

    def failing(*arguments):
        nonlocal count
        count += 1
        if count == point:
            raise (
                MemoryError
                if fault == "memory"
                else OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            )
        return call(*arguments)

    command = ["study", "design", FOUR, "--seed", "1", "-o", str(tmp_path)]
    with monkeypatch.context() as disturbed:
        disturbed.setattr(owner, name, failing)
        assert main(command) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main(command) == 0
    assert tree(tmp_path) == whole


@pytest.mark.long
def test_a_study_that_is_killed_while_it_is_written_is_written_by_the_next_run(whole, tmp_path):
    code = """
import os, signal, sys
import stepblocks
from stepblocks.cli import main
from stepblocks.errors import PipelineError
fsync, count = os.fsync, []
def killing(number):
    count.append(number)
    if len(count) == 4:
        os.kill(os.getpid(), signal.SIGKILL)
    return fsync(number)
os.fsync = killing
main(sys.argv[1:])
"""
    command = ["study", "design", FOUR, "--seed", "1", "-o", str(tmp_path)]
    assert (
        subprocess.run([sys.executable, "-c", code, *command], check=False).returncode
        == -signal.SIGKILL
    )
    assert 0 < len(tree(tmp_path)) < len(whole)
    assert main(command) == 0
    assert tree(tmp_path) == whole
    assert {
        path.name for path in tmp_path.iterdir()
    } == whole.keys()  # what the killed one prepared is gone


def led(folder):
    """Answer all trials of a participant as a page does, asking again what could not be written."""
    run = open_run(folder, "1")
    while not (said := run.state())["done"]:
        try:
            run.answer(said["trial"], {"estimate_um": str(10 + int(said["trial"]))})
        except (PipelineError, OSError, MemoryError):
            assert run.state()["trial"] == said["trial"]
    run.close()
    text = (folder / "runs" / "participant-1.csv").read_text(encoding="utf-8")
    times = ("shown_utc", "answered_utc", "reaction_s")  # differ from run to run
    return [
        {name: cell for name, cell in row.items() if name not in times}
        for row in csv.DictReader(text.splitlines())
    ]


@pytest.mark.repeats
@pytest.mark.parametrize("point", [1, 2, 3, 5, 8, 13, 14])
@pytest.mark.parametrize("fault", ["kill", "sync", "memory", "disk"])
def test_whatever_happens_while_a_study_is_run_every_trial_is_answered_once(
    fault, point, tmp_path, monkeypatch
):
    for name in ("whole", "disturbed"):
        design_study(
            (20e-6, 50e-6),
            tmp_path / name,
            seed=1,
            participants=1,
            repetitions=3,
            probes=("bare", "soft"),
        )
    whole, fsync, count = led(tmp_path / "whole"), os.fsync, 0

    def failing(number):
        nonlocal count
        count += 1
        if count == point and fault == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if count == point and fault == "disk":  # half of the line fits
            os.ftruncate(number, os.fstat(number).st_size - 9)
        if count == point:
            raise (
                MemoryError
                if fault == "memory"
                else OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            )
        return fsync(number)

    with monkeypatch.context() as disturbed:
        if fault == "kill":
            child = os.fork()
            if child == 0:
                os.fsync = failing
                led(tmp_path / "disturbed")
                os._exit(0)  # there is no such point
            assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
        else:
            disturbed.setattr(os, "fsync", failing)
            # the first two points are the empty file's
            with suppress(PipelineError, OSError, MemoryError):
                led(tmp_path / "disturbed")
    assert led(tmp_path / "disturbed") == whole
    assert [row["trial"] for row in whole] == [str(n) for n in range(1, 13)]


def test_every_public_function_and_class_is_called_with_strange_values():
    text = (ROOT / "benchmarks" / "fuzz_library.py").read_text(encoding="utf-8")
    called = set(re.findall(r'^ +"(\w+)": \(', text, re.MULTILINE))
    (left_out,) = re.findall(r"NOT_CALLED = \{(.*?)\}", text, re.DOTALL)
    assert set(re.findall(r'"(\w+)"', left_out)) == set(stepblocks.__all__) - called
