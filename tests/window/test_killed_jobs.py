"""A window and its job are killed in each kind of job: nothing saved is lost, nothing half written.

The files of a run that nobody disturbed are the measure: whatever is there after the kill is one
of them as a whole, and the run that the window offers again gives all of them. Where the server
alone is killed, the job goes on and gives all of them itself.
"""

import ast
import http.client
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import chdir, closing
from pathlib import Path

import psutil
import pytest

pytest.importorskip("nicegui")

from oracles.loop_folder import write_explained_session
from stepblocks.cli import main
from stepblocks.window import texts
from stepblocks.window.batch_form import make_batch_command
from stepblocks.window.build_page import make_build_command, make_order_command, make_scenes_command
from stepblocks.window.declaration_check import make_declaration_check_command
from stepblocks.window.folder import Entry, Kind
from stepblocks.window.inspect_page import InspectionAnswers
from stepblocks.window.jobs import JobList, JobState
from stepblocks.window.loop_view import make_prediction_command
from stepblocks.window.set_page import make_set_design_command
from stepblocks.window.study_page import (
    make_analysis_command,
    make_design_command,
    make_run_command,
    make_sheets_command,
    make_simulation_command,
)
from stepblocks.window.suggestions import suggest_beginnings, suggest_commands

pytestmark = pytest.mark.skipif(os.name == "nt", reason="its processes end otherwise")

BLOCKS = """\
defaults.step_block.body.engraving = "none"
[[step_block]]
id = "low"
height = "25 um"
[[step_block]]
id = "high"
height = "50 um"
"""
PLAN = (
    'schema = 1\nseed = 3\nformat = "csv"\n[design]\nheights = ["20 um", "40 um"]\n'
    'loads = ["0.5 N", "0.9 N"]\nspeeds = ["5 mm/s"]\ntrials = 16\ndays = 1\n'
)
NAME = "lab"  # of each folder that a command runs in: files may hold it
FILE, STUDY, SESSION = "mine.toml", "study", "rehearsed"
SIMULATE = ("simulate-session", "plan.toml", "-o", SESSION)
ANSWERS = {  # of a form, where they are not those that it says at first
    "file": FILE,
    "study": STUDY,
    "answers": f"{STUDY}/answers.csv",
    "participants": "2",
    "number": "2",
}


def answer(form, **answers):
    """The command of a form, with what is said at first or above, and with other answers."""
    said = {}
    for question in form.questions:
        said[question.name] = ANSWERS.get(question.name, question.default)
    return form.make_command(said | answers)


DESIGN = answer(make_design_command([FILE]))
SIMULATED = answer(make_simulation_command([STUDY], [FILE]))
RUN = answer(make_run_command([STUDY], [FILE]), file="")  # serves a page until it is ended


def list_suggested():
    """What the window offers for the entries of its folder and for an empty one, by a name."""
    found = {f"new {command.words[-1]}": command for command in suggest_beginnings()}
    for name, kind in ((FILE, Kind.STIMULI), ("scan.csv", Kind.SCAN), (SESSION, Kind.SESSION)):
        for command in suggest_commands(Entry(name, kind)):
            found[f"{command.words[0]} {name}"] = command
    return found


# what the window starts; every other command of it does the same with other words
JOBS = {
    **list_suggested(),
    "build": make_build_command([FILE]),
    "workshop": make_order_command([FILE]),
    "export": make_scenes_command([FILE], "forcelaw"),
    "inspect": InspectionAnswers("scan.csv", "low", FILE).make_command(),
    "inspect list": make_batch_command("scans.csv", FILE, "", "2 um"),
    "check": make_declaration_check_command(SESSION),
    "predict session": make_prediction_command("bench/b1", "out/b1-loop"),
    "study design": DESIGN,
    "study sheet": answer(make_sheets_command([STUDY])),
    "study run": RUN,
    "study simulate": SIMULATED,
    "study analyse": answer(make_analysis_command([STUDY])),
    "design-set": answer(make_set_design_command([FILE]), file="even.toml"),
}
# the commands that go before a job
BEFORE = {
    **{name: (SIMULATE,) for name in JOBS if name.endswith(SESSION) or name == "check"},
    "study sheet": (DESIGN.words,),
    "study run": (DESIGN.words,),
    "study simulate": (DESIGN.words,),
    "study analyse": (DESIGN.words, SIMULATED.words),
}
ENDLESS = ("study run",)  # has a test of its own
SHOWN_ONLY = {"DRAW_TRIAL", "BUILD_BY_MODEL"}  # to copy, without a button that runs them
SHARES = (0.5, 0.8, 0.95)  # of the time of an undisturbed job, after which it is killed
WITH_WORKERS = ("build",)  # the inputs of other jobs are too small for any
OFTEN = ("build", "inspect", "check", "study analyse")  # of these, more places are tried
ENDED = (JobState.DONE, JobState.OUT_OF_TOLERANCE, JobState.NOT_PROVEN)
WITHOUT_BYTES = (".pdf", ".xlsx")  # say when they were written
# the same words are offered in two places and killed once
ONCE = {command.words: name for name, command in JOBS.items()}.values()
KINDS = [name for name in ONCE if name not in ENDLESS]


def put_files(folder, kind):
    """The files of a user."""
    folder.mkdir(parents=True)
    if kind == "predict session":
        write_explained_session(folder)
    if not kind.startswith("new "):  # which is offered where there is nothing to begin with
        (folder / FILE).write_text(BLOCKS)
    (folder / "scans.csv").write_text("scan,stimulus,block\nscan.csv,low,A\n")
    (folder / "plan.toml").write_text(PLAN)
    rows = [f"{place},{25 * (place > 0)}" for place in range(-1000, 1000, 4)]
    (folder / "scan.csv").write_text("\n".join(["x_um,z_um", *rows]) + "\n")


@pytest.fixture(scope="module")
def prepare(tmp_path_factory):
    """Function that copies to a folder what a user has before a job of a kind.

    What the commands before a job make is made once for all jobs that come after them.
    """
    made = {}

    def prepare_folder(folder, kind):
        commands = BEFORE.get(kind, ())
        if not commands:
            put_files(folder, kind)
            return
        if commands not in made:
            made[commands] = tmp_path_factory.mktemp("before") / NAME
            put_files(made[commands], kind)
            for words in commands:
                run_command(made[commands], words)
        shutil.copytree(made[commands], folder)

    return prepare_folder


def run_command(folder, words):
    """Run a command undisturbed, in this process: a start takes longer than most commands."""
    with chdir(folder):
        assert main(list(words)) in (0, 1, 3)


def list_files(folder):
    """The bytes of what is in a folder, by name; locks of files are no content."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.name.endswith(".lock"):
            content = b"" if path.suffix in WITHOUT_BYTES else path.read_bytes()
            found[path.relative_to(folder).as_posix()] = content
    return found


SERVERS = """
import json, os, signal, sys
from pathlib import Path
from stepblocks.window.command_line import ShownCommand
from stepblocks.window.window import Window, serve_window

def serve(folder, words):
    window = Window(Path(folder))

    def start(_):
        window.jobs.start(ShownCommand("job", tuple(words)))
        print(os.getpid(), flush=True)

    serve_window(window, 0, start)

signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for a server
for line in sys.stdin:
    folder, words, environment = json.loads(line)
    if os.fork() == 0:
        os.environ.update(environment)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        serve(folder, words)
        os._exit(0)
"""


class Servers:
    """A process that has loaded the window once, and begins servers as forks of itself."""

    def __init__(self):
        command = [sys.executable, "-c", SERVERS]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self._process = subprocess.Popen(command, text=True, **pipes)

    def start(self, folder, words):
        """Start the server of a window, and a job from it; return its process."""
        self._process.stdin.write(json.dumps([str(folder), words, dict(os.environ)]) + "\n")
        self._process.stdin.flush()
        return psutil.Process(int(self._process.stdout.readline()))

    def close(self):
        self._process.communicate(timeout=60)


@pytest.fixture(scope="module")
def servers():
    begun = Servers()
    yield begun
    begun.close()


def kill(processes):
    """End processes as a system does that has no memory left: they cannot do anything more."""
    for process in processes:
        try:
            os.kill(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            continue


def kill_with_all(server):
    """Kill a server with all that it started."""
    kill([server, *server.children(recursive=True)])
    server.wait(60)


def kill_in_job(servers, folder, words, seconds):
    """Start a command from a window, and kill both with all that they started after a time."""
    server = servers.start(folder, words)
    time.sleep(seconds)
    kill_with_all(server)


def wait_for_end(job):
    """Wait for a process that nobody waits for: it may stay as a number for a while."""
    for _ in range(36000):
        if job.state is not JobState.RUNNING:
            return
        time.sleep(0.1)
    raise AssertionError(job.output)


def is_visible(name):
    return not any(part.startswith(".") for part in Path(name).parts)


def test_every_command_that_the_window_can_start_is_killed_here():
    """By the titles of all commands that its modules make."""
    made = set()
    for path in Path(texts.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_made = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
            if is_made and node.func.id in ("ShownCommand", "FormCommand", "_SetDesignCommand"):
                made |= set(re.findall(r"texts\.([A-Z_]+)", ast.unparse(node.args[0])))
    killed = {command.title for command in JOBS.values()}
    titles = {getattr(texts, name).partition("{")[0]: name for name in made - SHOWN_ONLY}
    assert made >= SHOWN_ONLY
    assert [
        name
        for begin, name in titles.items()
        if not any(title.startswith(begin) for title in killed)
    ] == []


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_kill_in_a_job_leaves_whole_files_and_the_next_window_runs_it_again(
    kind, servers, prepare, tmp_path, monkeypatch
):
    words = JOBS[kind].words
    if kind in WITH_WORKERS:
        monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "2")
    ready = tmp_path / "ready" / NAME
    prepare(ready, kind)
    undisturbed = tmp_path / "undisturbed" / NAME
    shutil.copytree(ready, undisturbed)
    run_command(undisturbed, words)
    whole = list_files(undisturbed)
    alone = tmp_path / "alone" / NAME
    shutil.copytree(ready, alone)
    seconds = go_on_without_server(servers, alone, words, whole)
    shares = SHARES if kind in OFTEN else SHARES[:1]
    for number, share in enumerate(shares):
        folder = tmp_path / f"killed-{number}" / NAME
        shutil.copytree(ready, folder)
        saved = list_files(folder)
        kill_in_job(servers, folder, words, share * seconds)
        left = list_files(folder)
        for name, content in saved.items():
            # the note of what was written is as before the job or as behind it, never between
            assert left[name] == content or (not is_visible(name) and left[name] == whole[name])
        for name, content in left.items():
            assert not is_visible(name) or content == whole[name], name
        jobs = JobList(folder)
        jobs.take_over_killed_jobs()
        try:
            (job,) = jobs.latest_first
            wait_for_end(job)
            assert job.state in (JobState.LOST, *ENDED)
            assert "run it again" in JobState.LOST.value
            if list_files(folder) == whole:  # killed between its last file and its end
                continue
            again = jobs.start(job.command)
            again.wait(3600)
            assert again.state in ENDED, again.output
        finally:
            jobs.close()
        assert list_files(folder) == whole


def go_on_without_server(servers, folder, words, whole):
    """Kill the server alone: its job goes on, the next window finds it, and all files are there.

    Returns how long the job took [s].
    """
    begun = time.monotonic()
    server = servers.start(folder, words)
    kill([server])
    server.wait(60)
    jobs = JobList(folder)
    jobs.take_over_killed_jobs()
    try:
        (job,) = jobs.latest_first
        wait_for_end(job)
        seconds = time.monotonic() - begun
        assert job.state in ENDED, job.output
    finally:
        jobs.close()
    assert list_files(folder) == whole
    return seconds


def find_free_port():
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        return listener.getsockname()[1]


def ask(port, path, body=None, **headers):
    """What the page of a participant answers once it is served."""
    for _ in range(600):
        try:
            with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as line:
                line.request("POST" if body else "GET", path, body, headers)
                return line.getresponse().read().decode()
        except OSError:
            time.sleep(0.1)
    raise AssertionError("no page of the participant")


@pytest.mark.long
def test_an_answer_of_a_participant_outlives_a_kill_and_the_run_goes_on_with_the_next(
    servers, prepare, tmp_path
):
    """Server, run and all that they started are killed while the second trial is asked for."""
    folder = tmp_path / "lab"
    prepare(folder, "study run")
    port = find_free_port()
    words = answer(make_run_command([STUDY], [FILE]), file="", port=str(port)).words
    server = servers.start(folder, words)
    (token,) = re.findall(r'token = "([^"]+)"', ask(port, "/"))
    body = json.dumps({"trial": "1", "answers": {"estimate_um": "30"}})
    assert json.loads(ask(port, "/answer", body, **{"X-Stepblocks": token}))["trial"] == "2"
    saved = list_files(folder)
    assert f"{STUDY}/runs/participant-1.csv" in saved
    kill_with_all(server)
    assert list_files(folder) == saved
    jobs = JobList(folder)
    jobs.take_over_killed_jobs()
    try:
        (job,) = jobs.latest_first
        wait_for_end(job)
        assert job.state is JobState.LOST
        again = jobs.start(job.command)
        assert json.loads(ask(port, "/state"))["trial"] == "2"
        again.cancel()
        again.wait(60.0)  # on a busy machine a page takes longer to end than a window waits
    finally:
        jobs.close()
    assert list_files(folder) == saved
