"""What is clicked gives the files that the shown command gives, and what it would say."""

import asyncio
import shlex
import subprocess
import sys
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
