"""A window and its job are killed in each kind of job: nothing saved is lost, nothing half written.

The files of a run that nobody disturbed are the measure: whatever is there after the kill is one
of them as a whole, and the run that the window offers again gives all of them.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytest.importorskip("nicegui")

from stepblocks.window.jobs import JobList, JobState

pytestmark = pytest.mark.skipif(os.name == "nt", reason="its processes end otherwise")

BLOCKS = """\
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
SIMULATE = ("simulate-session", "plan.toml", "-o", "bench")
DESIGN = ("study", "design", "mine.toml", "--seed=1", "-o", "study", "--participants=2")
ANSWER = ("study", "simulate", "study", "mine.toml", "--output=study/answers.csv", "--seed=1")
INSPECT = ("inspect", "scan.csv", "--stimulus", "low", "--stimuli", "mine.toml", "-o", "out")
# a kind of job: the commands that go before it, and its own
JOBS = {
    "design-set": ((), ("design-set", "even.toml", "--targets=2 uJ", "--model=formula")),
    "build": ((), ("build", "mine.toml", "-o", "out")),
    "workshop": ((), ("workshop", "mine.toml", "-o", "out")),
    "export": ((), ("export", "mine.toml", "--for", "forcelaw", "-o", "out")),
    "inspect": ((), INSPECT),
    "simulate-session": ((), SIMULATE),
    "measure": ((SIMULATE,), ("measure", "bench", "-o", "out/features.csv")),
    "check": ((SIMULATE,), ("measure", "bench", "--check", "out/check.json")),
    "loop": ((SIMULATE,), ("loop", "bench", "-o", "out", "--jobs=1")),
    "study design": ((), DESIGN),
    "study simulate": ((DESIGN,), ANSWER),
    "study analyse": ((DESIGN, ANSWER), ("study", "analyse", "study", "study/answers.csv")),
}
QUICK = ("design-set",)
SHARES = (0.5, 0.8, 0.95)  # of the time of an undisturbed run, after which it is killed
ONCE = ("design-set", "loop")  # quick, or of minutes
ENDED = (JobState.DONE, JobState.OUT_OF_TOLERANCE, JobState.NOT_PROVEN)
WITHOUT_BYTES = (".pdf", ".xlsx")  # say when they were written
KINDS = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.long, id=name) for name in JOBS
]


def put_files(folder, before):
    """The files of a user, and what the commands before have made of them."""
    folder.mkdir()
    (folder / "mine.toml").write_text(BLOCKS)
    (folder / "plan.toml").write_text(PLAN)
    rows = [f"{place},{25 * (place > 0)}" for place in range(-1000, 1000, 4)]
    (folder / "scan.csv").write_text("\n".join(["x_um,z_um", *rows]) + "\n")
    for words in before:
        run_command(folder, words)


def run_command(folder, words):
    """Run a command undisturbed; return how long it took [s]."""
    begun = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "stepblocks", *words], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode in (0, 1, 3), done.stderr
    return time.monotonic() - begun


def list_files(folder):
    """The bytes of what is in a folder, by name; locks of files are no content."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.name.endswith(".lock"):
            content = b"" if path.suffix in WITHOUT_BYTES else path.read_bytes()
            found[path.relative_to(folder).as_posix()] = content
    return found


SERVER = (
    "import sys, time; from pathlib import Path\n"
    "from stepblocks.window.jobs import JobList\n"
    "from stepblocks.window.command_line import ShownCommand\n"
    "jobs = JobList(Path(sys.argv[1]))\n"
    "jobs.start(ShownCommand('job', tuple(sys.argv[2:])))\n"
    "print('started', flush=True)\n"
    "time.sleep(3600)\n"
)


def kill_in_job(folder, words, seconds):
    """Start a command from a window, and kill both with all that they started after a time."""
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(folder), *words], stdout=subprocess.PIPE, text=True
    )
    server.stdout.readline()
    time.sleep(seconds)
    killed = [server, *psutil.Process(server.pid).children(recursive=True)]
    for process in killed:
        try:
            os.kill(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            continue
    server.communicate(timeout=60)


def wait_for_end(job):
    """Wait for a process that nobody waits for: it may stay as a number for a while."""
    for _ in range(600):
        if job.state is not JobState.RUNNING:
            return
        time.sleep(0.1)
    raise AssertionError(job.output)


def is_visible(name):
    return not any(part.startswith(".") for part in Path(name).parts)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_kill_in_a_job_leaves_whole_files_and_the_next_window_runs_it_again(kind, tmp_path):
    before, words = JOBS[kind]
    put_files(tmp_path / "whole", before)
    seconds = run_command(tmp_path / "whole", words)
    whole = list_files(tmp_path / "whole")
    shares = SHARES[:1] if kind in ONCE else SHARES
    for number, share in enumerate(shares):
        folder = tmp_path / f"killed-{number}" / "whole"  # a name that files may hold
        folder.parent.mkdir()
        put_files(folder, before)
        saved = list_files(folder)
        kill_in_job(folder, words, share * seconds)
        left = list_files(folder)
        for name, content in saved.items():
            # the note of what was written is as before the job or as behind it, never between
            assert left[name] == content or (not is_visible(name) and left[name] == whole[name])
        for name, content in left.items():
            assert not is_visible(name) or content == whole[name], name
        jobs = JobList(folder)
        jobs.find_again()
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
