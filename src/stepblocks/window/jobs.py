"""Commands that run in processes of their own: a closed page does not end them.

What a command prints goes to a file of this system, not to a pipe: it goes on where the server of
the window is killed, and has written all that it would have.
"""

import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from enum import Enum
from pathlib import Path

from stepblocks.errors import PipelineError
from stepblocks.files.paths import describe_system_error
from stepblocks.files.progress import PROGRESS_FILE, ProgressStep, read_last_step
from stepblocks.window import texts
from stepblocks.window.command_line import ShownCommand

_MOST_AT_ONCE = 4
_MOST_KEPT = 100  # jobs whose output is kept
_MOST_SHOWN = 20_000  # bytes of an output, from its end
_WIDTH = "110"  # of what a command prints [letters]
_GRACE = 5.0  # for a command to end when asked to [s]


class JobState(Enum):
    """How far a job is, and how it ended; the exit codes are those of the command line."""

    RUNNING = texts.RUNNING
    DONE = texts.DONE
    OUT_OF_TOLERANCE = texts.OUT_OF_TOLERANCE
    WRONG_INPUT = texts.WRONG_INPUT
    NOT_PROVEN = texts.NOT_PROVEN
    CANCELLED = texts.CANCELLED
    FAILED = texts.FAILED


_STATES = {
    0: JobState.DONE,
    1: JobState.OUT_OF_TOLERANCE,
    2: JobState.WRONG_INPUT,
    3: JobState.NOT_PROVEN,
}


class Job:
    """A command that was started.

    Attributes
    ----------
    number : int
        From 1, in the order in which jobs were started.
    command : ShownCommand
    """

    def __init__(self, number: int, command: ShownCommand, folder: Path, output: Path) -> None:
        self.number = number
        self.command = command
        self._output = output
        self._steps = output.with_suffix(".steps")
        self._is_cancelled = False
        # -P: a file of the folder that is called like a module of Python is not run
        words = [sys.executable, "-P", "-m", "stepblocks", *command.words]
        environment = {
            **os.environ,
            "COLUMNS": _WIDTH,
            "PYTHONUNBUFFERED": "1",
            PROGRESS_FILE: str(self._steps),
        }
        with output.open("wb") as sink:
            self._process = subprocess.Popen(
                words,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
            )

    @property
    def state(self) -> JobState:
        """How far it is."""
        code = self._process.poll()
        if code is None:
            return JobState.RUNNING
        if self._is_cancelled and code != 0:
            return JobState.CANCELLED
        return _STATES.get(code, JobState.FAILED)

    @property
    def output(self) -> str:
        """What the command printed so far; of a long output the end."""
        try:
            with self._output.open("rb") as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(max(size - _MOST_SHOWN, 0))
                return file.read().decode(errors="replace")
        except OSError:
            return ""

    @property
    def progress(self) -> ProgressStep | None:
        """The step that it did last; None where it has not said any."""
        return read_last_step(self._steps)

    def cancel(self) -> None:
        """Ask it to end; its workers end with it, and nothing half-written stays."""
        self._is_cancelled = True
        with suppress(OSError):  # it has ended meanwhile
            self._process.terminate()

    def wait(self, seconds: float) -> None:
        """Wait for its end, at most so long [s]."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)


class JobList:
    """The jobs of a window.

    Parameters
    ----------
    folder : Path
        Where commands are run.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._jobs: list[Job] = []
        self._outputs: tempfile.TemporaryDirectory[str] | None = None

    @property
    def latest_first(self) -> list[Job]:
        """The jobs that are kept."""
        return self._jobs[::-1]

    def start(self, command: ShownCommand) -> Job:
        """Start a command.

        Raises
        ------
        PipelineError
            If too many run already, or the system starts no more.
        """
        running = [job for job in self._jobs if job.state is JobState.RUNNING]
        if len(running) >= _MOST_AT_ONCE:
            raise PipelineError(
                f"at most {_MOST_AT_ONCE} commands run at once, got {len(running) + 1}: wait for "
                "one, or cancel it"
            )
        number = self._jobs[-1].number + 1 if self._jobs else 1
        output = self._get_output_folder() / f"{number}.txt"
        try:
            job = Job(number, command, self._folder, output)
        except OSError as error:
            reason = describe_system_error(error, output)
            raise PipelineError(f"the command cannot be started: {reason}") from error
        ended = [job for job in self._jobs if job not in running]
        forgotten = ended[:-_MOST_KEPT]
        self._jobs = [kept for kept in [*self._jobs, job] if kept not in forgotten]
        return job

    def find_last(self, command: ShownCommand) -> Job | None:
        """Return the last job of a command; None where it was not run yet."""
        for job in self.latest_first:
            if job.command.words == command.words:
                return job
        return None

    def close(self) -> None:
        """End what runs, and forget what was printed."""
        for job in self._jobs:
            if job.state is JobState.RUNNING:
                job.cancel()
        for job in self._jobs:
            job.wait(_GRACE)
        if self._outputs is not None:
            self._outputs.cleanup()
            self._outputs = None

    def _get_output_folder(self) -> Path:
        """Return the folder of what is printed, which is made with the first job."""
        if self._outputs is None:
            self._outputs = tempfile.TemporaryDirectory(
                prefix="stepblocks-window-", ignore_cleanup_errors=True
            )
        return Path(self._outputs.name)
