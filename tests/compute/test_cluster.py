"""Promise: work on a Dask cluster is complete, each piece once, and equal to one machine's."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import stepblocks
from stepblocks.cli import main
from stepblocks.compute import cluster as clusters
from stepblocks.compute.cluster import open_cluster
from stepblocks.compute.seam import run_calls
from stepblocks.errors import PipelineError
from stepblocks.predict.sweep import run as sweeping

distributed = pytest.importorskip("distributed")

TESTS = Path(__file__).parents[1]
PLAN = """
[sweep]
kind = "random"
rows = 6000
seed = 3
rows_per_partition = 500

[parameters]
height = { from = "10 um", to = "60 um" }
friction = { from = 0.1, to = 0.3 }
"""
REHEARSAL = """
schema = 1
seed = 1
format = "csv"

[design]
heights = ["20 um", "40 um"]
loads = ["0.3 N"]
speeds = ["2 mm/s"]
"""


@contextmanager
def _start(*words: str, folder: Path):
    """Run a command of Dask beside the test; it ends with the block."""
    command = [sys.executable, "-m", "distributed.cli." + words[0], *words[1:]]
    # what the workers write by themselves goes where the test's own files are
    process = subprocess.Popen(
        command,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(TESTS)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def _start_scheduler(port: int, folder: Path):
    with _start(
        "dask_scheduler", "--port", str(port), "--no-dashboard", "--host", "127.0.0.1",
        folder=folder,
    ) as process:  # fmt: skip
        yield process


@contextmanager
def _start_worker(port: int, folder: Path):
    """Start a worker without a nanny, so that it is not started again when it is killed."""
    with _start(
        "dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--no-nanny",
        "--no-dashboard", "--local-directory", str(folder), folder=folder,
    ) as process:  # fmt: skip
        yield process


def _find_free_port() -> int:
    import socket

    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A scheduler and two workers, each a process of its own; gives the address."""
    folder = tmp_path_factory.mktemp("site")
    port = _find_free_port()
    with (
        _start_scheduler(port, folder),
        _start_worker(port, folder),
        _start_worker(port, folder),
    ):
        address = f"tcp://127.0.0.1:{port}"
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def _read_files(folder: Path) -> dict[str, bytes]:
    files = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            files[path.relative_to(folder).as_posix()] = path.read_bytes()
    return files


def test_a_sweep_on_a_cluster_has_the_bytes_of_one_machine(site, plan, tmp_path):
    alone = stepblocks.run_sweep(plan, tmp_path / "alone")
    together = stepblocks.run_sweep(plan, tmp_path / "together", on=site)
    assert (together.computed, together.found) == (12, 0)
    assert _read_files(together.folder) == _read_files(alone.folder)
    again = stepblocks.run_sweep(plan, tmp_path / "together", on=site)
    assert (again.computed, again.found) == (0, 12)


def test_workers_that_do_not_see_the_folder_return_what_they_computed(
    site, plan, tmp_path, monkeypatch
):
    alone = stepblocks.run_sweep(plan, tmp_path / "alone")
    monkeypatch.setattr(sweeping, "is_folder_shared", lambda client, folder: False)
    together = stepblocks.run_sweep(plan, tmp_path / "together", on=site)
    assert _read_files(together.folder) == _read_files(alone.folder)


def test_a_folder_of_this_machine_is_shared_with_workers_of_this_machine_alone(site, tmp_path):
    with open_cluster(site) as client:
        assert clusters.is_folder_shared(client, tmp_path)
        assert not any(tmp_path.iterdir())
        assert clusters._can_worker_read_and_write(str(tmp_path / "absent"), "token") is False


@pytest.mark.long
def test_power_does_not_depend_on_where_the_studies_are_simulated(site):
    asked = {"seed": 1, "damping": {"bare": 1.0, "soft": 0.3}, "participants": (4,), "runs": 10}
    asked["analysis"] = "f-test"
    alone = stepblocks.study_power([30e-6, 60e-6], **asked)
    together = stepblocks.study_power([30e-6, 60e-6], on=site, **asked)
    assert together.equals(alone)


@pytest.mark.long
def test_rehearsals_on_a_cluster_are_those_of_one_machine(site, tmp_path, monkeypatch):
    path = tmp_path / "plan.toml"
    path.write_text(REHEARSAL, encoding="utf-8")
    from stepblocks.rehearse import many

    alone = stepblocks.simulate_sessions(path, tmp_path / "alone", range(3), jobs=1)
    single = tmp_path / "single"
    stepblocks.simulate_session(path, single, seed=2)
    assert _read_files(alone.folders[2]) == _read_files(single)
    for folder, is_shared in (("shared", True), ("apart", False)):
        monkeypatch.setattr(
            many, "is_folder_shared", lambda client, folder, answer=is_shared: answer
        )
        together = stepblocks.simulate_sessions(path, tmp_path / folder, range(3), on=site)
        assert (together.simulated, together.found) == (3, 0)
        assert _read_files(tmp_path / folder) == _read_files(tmp_path / "alone")
    more = stepblocks.simulate_sessions(path, tmp_path / "alone", range(5), jobs=1)
    assert (more.simulated, more.found) == (2, 3)


def test_rehearsals_of_another_plan_are_refused(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(REHEARSAL, encoding="utf-8")
    stepblocks.simulate_sessions(path, tmp_path / "out", [1], jobs=1)
    path.write_text(REHEARSAL.replace("0.3 N", "0.4 N"), encoding="utf-8")
    with pytest.raises(PipelineError, match="another plan"):
        stepblocks.simulate_sessions(path, tmp_path / "out", [1], jobs=1)
    with pytest.raises(PipelineError, match="twice"):
        stepblocks.simulate_sessions(path, tmp_path / "other", [1, 1], jobs=1)


def test_a_worker_of_another_version_is_refused_and_both_are_named(site, monkeypatch):
    other = dict(clusters.collect_versions()) | {"numpy": "1.0.0"}
    monkeypatch.setattr(clusters, "collect_versions", lambda: other)
    with open_cluster(site) as client, pytest.raises(PipelineError, match=r"1\.0\.0 here") as told:
        list(run_calls(abs, [(1,)], jobs=1, on=client))
    assert "numpy" in str(told.value)
    assert "tcp://127.0.0.1" in str(told.value)


def test_a_worker_of_another_version_that_joins_later_is_refused_too(site, monkeypatch):
    other = dict(clusters.collect_versions()) | {"numpy": "1.0.0"}
    monkeypatch.setattr(clusters, "collect_versions", lambda: other)
    monkeypatch.setattr(
        clusters, "_refuse_cluster_of_other_versions", lambda client, versions: None
    )
    with open_cluster(site) as client, pytest.raises(PipelineError, match=r"1\.0\.0 here"):
        list(run_calls(abs, [(1,)], jobs=1, on=client))


def test_what_a_worker_with_a_full_disk_cannot_write_is_done_by_another(site):
    from oracles.full_disk import write_unless_full

    with open_cluster(site) as client:
        full, healthy = sorted(client.scheduler_info(n_workers=-1)["workers"])
        calls = [(number, full) for number in range(20)]
        done = list(run_calls(write_unless_full, calls, jobs=1, on=client))
        assert done == [(number, healthy) for number in range(20)]


def test_an_error_of_a_call_comes_back_as_it_was_raised(site):
    with open_cluster(site) as client, pytest.raises(ZeroDivisionError):
        list(run_calls(divmod, [(1, 0)], jobs=1, on=client))


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("cluster", "slurm"),
        ("http://127.0.0.1:1", "tcp://"),
        (3, "got int"),
    ],
)
def test_what_is_no_cluster_is_refused_with_what_is_one(place, said):
    with pytest.raises(PipelineError, match=said), open_cluster(place):
        pass


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(clusters, "_CONNECT_TIMEOUT", 1)
    address = f"tcp://127.0.0.1:{_find_free_port()}"
    with pytest.raises(PipelineError, match="no Dask scheduler answers"), open_cluster(address):
        pass


def test_tasks_of_an_array_divide_a_sweep_by_its_partitions(plan, tmp_path):
    whole = stepblocks.run_sweep(plan, tmp_path / "whole")
    output = str(tmp_path / "parts")
    for share in ("0:5", "5:12"):
        assert main(["sweep", str(plan), "-o", output, "--partitions", share, "--quiet"]) == 0
    written = _read_files(Path(output))
    del written[".stepblocks.json"]  # what the command remembers of its own files
    assert written == _read_files(whole.folder)
    assert main(["sweep", str(plan), "-o", output, "--partitions", "5:13", "--quiet"]) == 2


@pytest.mark.long
def test_blocks_built_on_a_cluster_have_the_bytes_of_one_machine(site, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'schema = 1\n[[step_block]]\nid = "a"\nheight = "30 um"\n',
        encoding="utf-8",
    )
    stepblocks.build_sets(path, tmp_path / "alone", jobs=1)
    stepblocks.build_sets(path, tmp_path / "together", on=site)
    assert _read_files(tmp_path / "together") == _read_files(tmp_path / "alone")


@pytest.mark.long
def test_a_worker_killed_in_the_middle_leaves_no_row_out_and_none_twice(plan, tmp_path):
    port = _find_free_port()
    alone = stepblocks.run_sweep(plan, tmp_path / "alone")
    with (
        _start_scheduler(port, tmp_path),
        _start_worker(port, tmp_path),
        _start_worker(port, tmp_path) as victim,
    ):

        def kill_once(number: int) -> None:
            if victim.poll() is None:
                victim.send_signal(signal.SIGKILL)

        with distributed.Client(f"tcp://127.0.0.1:{port}", set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
            together = stepblocks.run_sweep(
                plan, tmp_path / "together", on=client, on_partition=kill_once
            )
    assert together.computed == 12
    assert _read_files(together.folder) == _read_files(alone.folder)


@pytest.mark.long
def test_a_lost_scheduler_is_said_and_the_next_run_goes_on(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_LOST_TIMEOUT", 2)
    port = _find_free_port()
    address = f"tcp://127.0.0.1:{port}"
    alone = stepblocks.run_sweep(plan, tmp_path / "alone")
    output = tmp_path / "together"
    with _start_scheduler(port, tmp_path) as scheduler, _start_worker(port, tmp_path):

        def kill_scheduler(number: int) -> None:
            scheduler.kill()
            scheduler.wait()

        with pytest.raises(PipelineError, match="goes on from there"):
            stepblocks.run_sweep(plan, output, on=address, on_partition=kill_scheduler)
    finished = len(list(output.glob("part-*.parquet")))
    assert 0 < finished <= 12
    time.sleep(1)
    with _start_scheduler(port, tmp_path), _start_worker(port, tmp_path):
        again = stepblocks.run_sweep(plan, output, on=address)
    assert again.found == finished
    assert _read_files(output) == _read_files(alone.folder)


# what a batch system does, as dask-jobqueue asks for it: it keeps the script of a job, whose file
# is removed as soon as it was handed in, and starts it
SBATCH = """#!/bin/sh
cp "$1" "kept-$$.sh"
sh "kept-$$.sh" >/dev/null 2>&1 &
echo "Submitted batch job $!"
"""


@pytest.mark.long
def test_workers_are_asked_for_at_a_batch_system(plan, tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    tools = tmp_path / "tools"
    tools.mkdir()
    for name, script in (("sbatch", SBATCH), ("scancel", '#!/bin/sh\nkill "$1"\n')):
        path = tools / name
        path.write_text(script, encoding="utf-8")
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)
    alone = stepblocks.run_sweep(plan, tmp_path / "alone")
    together = stepblocks.run_sweep(plan, tmp_path / "together", on="slurm", jobs=1)
    assert _read_files(together.folder) == _read_files(alone.folder)
