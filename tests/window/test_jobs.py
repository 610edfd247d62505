"""What is clicked gives the files that the shown command gives, and what it would say."""

import asyncio
import json
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from nicegui.testing.user_interaction import UserInteraction
from nicegui.testing.user_simulation import user_simulation

from stepblocks.cli import main
from stepblocks.errors import PipelineError
from stepblocks.window.command_line import ShownCommand
from stepblocks.window.jobs import JobList, JobState
from stepblocks.window.window import Window

needs_state = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="its place of state is named by another variable"
)


@pytest.fixture
def jobs(tmp_path):
    found = JobList(tmp_path)
    yield found
    found.close()


def run(jobs, *words):
    job = jobs.start(ShownCommand("title", words))
    job.wait(120.0)
    return job


def test_a_mistake_is_the_message_of_the_command_line_without_a_traceback(jobs):
    job = run(jobs, "predict", "none.toml")
    assert job.state is JobState.WRONG_INPUT
    assert job.output.startswith("stepblocks: error: ")
    assert "none.toml" in job.output
    assert "Traceback" not in job.output


def test_a_file_of_the_folder_that_is_called_like_a_module_is_not_run(jobs, tmp_path):
    (tmp_path / "typer.py").write_text("open('owned', 'w').close()\n")
    (tmp_path / "stepblocks.py").write_text("open('owned', 'w').close()\n")
    assert run(jobs, "help", "predict").state is JobState.DONE
    assert not (tmp_path / "owned").exists()


def test_a_cancelled_command_ends_and_more_than_four_at_once_are_refused(jobs, monkeypatch):
    script = "import time; time.sleep(600)"
    started = subprocess.Popen

    def sleep(words, **options):
        return started([sys.executable, "-c", script], **options)

    monkeypatch.setattr("stepblocks.window.jobs.subprocess.Popen", sleep)
    running = [jobs.start(ShownCommand("sleep", ())) for _ in range(4)]
    with pytest.raises(PipelineError, match="at most 4 commands run at once, got 5"):
        jobs.start(ShownCommand("sleep", ()))
    assert {job.state for job in running} == {JobState.RUNNING}
    running[0].cancel()
    running[0].wait(60.0)
    assert running[0].state is JobState.CANCELLED
    jobs.close()
    assert {job.state for job in running} == {JobState.CANCELLED}


def test_a_double_click_starts_a_command_once(jobs, monkeypatch):
    script = "import time; time.sleep(600)"
    started = subprocess.Popen

    def sleep(words, **options):
        return started([sys.executable, "-c", script], **options)

    monkeypatch.setattr("stepblocks.window.jobs.subprocess.Popen", sleep)
    command = ShownCommand("sleep", ("sleep",))
    first = jobs.start_once(command)
    assert jobs.start_once(command) is first
    first.cancel()
    first.wait(60.0)
    assert jobs.start_once(command) is not first


async def begin_and_find_again(folder):
    """Run a beginning from an empty folder by one click; look at it from a page opened anew."""
    window = Window(folder)
    async with user_simulation(root=window.build) as user:
        await user.open("/")
        button = min(user.find("Run").elements, key=lambda element: element.id)
        UserInteraction(user, {button}, "Run").click()
        (job,) = window.jobs.latest_first
        await user.open("/work")
        await user.should_see(job.command.line, retries=20)
        await user.should_see(JobState.DONE.value, retries=600)
        window.jobs.close()
        return job


def test_a_click_gives_the_files_of_the_shown_command_byte_for_byte(tmp_path, monkeypatch):
    clicked, typed = tmp_path / "clicked", tmp_path / "typed"
    clicked.mkdir()
    typed.mkdir()
    job = asyncio.run(begin_and_find_again(clicked))
    words = shlex.split(job.command.line)
    assert words[0] == "stepblocks"
    monkeypatch.chdir(typed)
    assert main(words[1:]) == 0
    assert list_bytes(clicked) == list_bytes(typed)
    assert list_bytes(clicked)


def list_bytes(folder: Path):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_command_goes_on_where_the_window_is_killed(tmp_path):
    """Its output goes to no pipe, which would end it with the window."""
    code = (
        "import os, sys; from pathlib import Path\n"
        "from stepblocks.window.jobs import JobList\n"
        "from stepblocks.window.command_line import ShownCommand\n"
        "jobs = JobList(Path(sys.argv[1]))\n"
        "jobs.start(ShownCommand('', ('new', 'block', 'mine.toml')))\n"
        "os._exit(9)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert done.returncode == 9
    declared = tmp_path / "mine.toml"
    for _ in range(1200):
        if declared.exists():
            break
        time.sleep(0.1)
    assert "[[step_block]]" in declared.read_text()


def write_long_plan(folder):
    """A session, of which so many are simulated that it takes minutes."""
    (folder / "plan.toml").write_text(
        'schema = 1\nseed = 1\nformat = "csv"\n[design]\nheights = ["20 um", "40 um"]\n'
        'loads = ["0.5 N"]\nspeeds = ["2 mm/s"]\ntrials = 8\n'
    )


def wait_for_end(job):
    """A process that nobody waits for may stay as a number for a while."""
    for _ in range(600):
        if job.state is not JobState.RUNNING:
            return
        time.sleep(0.1)
    raise AssertionError(job.output)


def wait_for_step(job):
    for _ in range(1200):
        if job.progress is not None:
            return
        time.sleep(0.1)
    raise AssertionError(job.output)


@pytest.mark.skipif(os.name == "nt", reason="its server ends otherwise")
def test_jobs_of_a_killed_window_are_found_again_with_what_they_did(tmp_path):
    """One had ended, one runs on and can be cancelled, one was killed together with the window."""
    (tmp_path / "lab").mkdir()
    write_long_plan(tmp_path / "lab")
    code = (
        "import os, sys; from pathlib import Path\n"
        "from stepblocks.window.jobs import JobList\n"
        "from stepblocks.window.command_line import ShownCommand\n"
        "jobs = JobList(Path(sys.argv[1]))\n"
        "done = jobs.start(ShownCommand('begin', ('new', 'block', 'mine.toml')))\n"
        "done.wait(600)\n"
        "for name in ('killed', 'on'):\n"
        "    words = ('simulate-session', 'plan.toml', '-o', name, '--seeds=1:2000', '--jobs=1')\n"
        "    job = jobs.start(ShownCommand(name, words))\n"
        "    print(job._process._process.pid, flush=True)\n"
        "os._exit(9)\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "lab")],
        check=False,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 9, process.stderr
    killed, _ = map(int, process.stdout.split())
    os.kill(killed, signal.SIGKILL)
    jobs = JobList(tmp_path / "lab")
    jobs.take_over_killed_jobs()
    try:
        on, lost, done = jobs.latest_first
        assert [job.command.title for job in (done, lost, on)] == ["begin", "killed", "on"]
        assert done.state is JobState.DONE
        assert "mine.toml" in done.output
        wait_for_end(lost)
        assert lost.state is JobState.LOST
        assert on.state is JobState.RUNNING
        wait_for_step(on)
        other = JobList(tmp_path / "lab")  # a second window on the folder has jobs of its own
        other.take_over_killed_jobs()
        assert other.latest_first == []
        other.close()
        again = jobs.start(lost.command)
        assert (again.number, again.state) == (4, JobState.RUNNING)
        on.cancel()
        wait_for_end(on)
        assert on.state is JobState.CANCELLED
    finally:
        jobs.close()
    after = JobList(tmp_path / "lab")
    after.take_over_killed_jobs()
    assert after.latest_first == []
    after.close()


async def look_at_lost(folder, record):
    window = Window(folder)
    window.jobs.take_over_killed_jobs()
    (job,) = window.jobs.latest_first
    async with user_simulation(root=window.build) as user:
        await user.open("/work")
        await user.should_see(JobState.LOST.value)
        user.find("Run again").click()
        await user.should_see(JobState.DONE.value, retries=600)
        window.jobs.close()
        return job


@pytest.mark.long
@needs_state
def test_a_job_that_ended_with_its_window_is_shown_and_run_again(tmp_path, state):
    (tmp_path / "lab").mkdir()
    before = JobList(tmp_path / "lab")
    run(before, "new", "block", "mine.toml")
    (record,) = state.rglob("1.json")
    for damaged in ("2.json", "3.json"):
        record.with_name(damaged).write_text("{" if damaged == "2.json" else "[]")
    record.with_suffix(".steps").unlink()  # as of a process that was killed
    before._notes._locks.close()
    (tmp_path / "lab" / "mine.toml").unlink()
    job = asyncio.run(look_at_lost(tmp_path / "lab", record))
    assert job.state is JobState.LOST
    assert (tmp_path / "lab" / "mine.toml").is_file()
    assert list((state / "stepblocks" / "window").iterdir()) == []


@needs_state
def test_notes_of_jobs_lie_in_the_state_of_the_user_and_never_in_the_folder(tmp_path, state):
    """Temporary files go when the system starts anew; the state of a user stays."""
    (tmp_path / "lab").mkdir()
    before = JobList(tmp_path / "lab")
    run(before, "help", "predict")
    assert list((tmp_path / "lab").iterdir()) == []
    (place,) = (state / "stepblocks" / "window").iterdir()
    assert place.stat().st_mode & 0o777 == 0o700
    before._notes._locks.close()
    # as after a new start of the system: its process is another one, or none
    record = json.loads((place / "1.json").read_text())
    (place / "1.json").write_text(json.dumps(record | {"begun": 1.0}))
    after = JobList(tmp_path / "lab")
    after.take_over_killed_jobs()
    (job,) = after.latest_first
    assert job.state is JobState.DONE
    assert "predict" in job.output
    after.close()
    assert list((state / "stepblocks" / "window").iterdir()) == []


@needs_state
def test_notes_of_a_folder_that_nobody_opened_for_a_quarter_are_forgotten(tmp_path, state):
    for name in ("old", "new", "mine"):
        (tmp_path / name).mkdir()
        jobs = JobList(tmp_path / name)
        run(jobs, "help", "predict")
        jobs._notes._locks.close()
        if name == "old":
            (place,) = (state / "stepblocks" / "window").iterdir()
            os.utime(place, (0.0, 0.0))
    mine = JobList(tmp_path / "mine")
    mine.take_over_killed_jobs()
    assert len(mine.latest_first) == 1
    mine.close()
    assert len(list((state / "stepblocks" / "window").iterdir())) == 1


@pytest.mark.skipif(os.name == "nt", reason="modes of another kind")
def test_without_a_place_for_state_the_notes_lie_among_temporary_files(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temp"))
    (tmp_path / "temp").mkdir()
    (tmp_path / "lab").mkdir()
    jobs = JobList(tmp_path / "lab")
    assert run(jobs, "help", "predict").state is JobState.DONE
    assert len(list((tmp_path / "temp").iterdir())) == 1
    jobs.close()
