"""Commands that run in processes of their own: a closed page does not end them.

What a command prints goes to a file of this system, not to a pipe: it goes on where the server of
the window is killed, and has written all that it would have. The next window on the folder finds
its file, with how it ended.
"""

import os
import subprocess
import sys
from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Protocol

import psutil

from stepblocks.errors import PipelineError
from stepblocks.files.paths import describe_system_error
from stepblocks.files.progress import (
    PROGRESS_FILE,
    ProgressStep,
    read_exit_code,
    read_last_step,
)
from stepblocks.window import texts
from stepblocks.window.command_line import ShownCommand
from stepblocks.window.job_notes import JobNotes, JobRecord, write_job_record

_MOST_AT_ONCE = 4
_MOST_KEPT = 100  # jobs whose output is kept
_MOST_SHOWN = 20_000  # bytes of an output, from its end
_WIDTH = "110"  # of what a command prints [letters]
_GRACE = 5.0  # for a command to end when asked to [s]
_SAME_START = 1.0  # within which two processes of one number are the same one [s]


class JobState(Enum):
    """How far a job is, and how it ended; the exit codes are those of the command line."""

    RUNNING = texts.RUNNING
    DONE = texts.DONE
    OUT_OF_TOLERANCE = texts.OUT_OF_TOLERANCE
    WRONG_INPUT = texts.WRONG_INPUT
    NOT_PROVEN = texts.NOT_PROVEN
    CANCELLED = texts.CANCELLED
    FAILED = texts.FAILED
    LOST = texts.LOST


_STATES = {
    0: JobState.DONE,
    1: JobState.OUT_OF_TOLERANCE,
    2: JobState.WRONG_INPUT,
    3: JobState.NOT_PROVEN,
}


class JobProcess(Protocol):
    """A process of a command, as a job asks for it."""

    def is_running(self) -> bool:
        """Tell whether it runs."""

    def find_exit_code(self) -> int | None:
        """Return its exit code once it does not run; None where nobody knows it."""

    def terminate(self) -> None:
        """Ask it to end."""

    def wait(self, seconds: float) -> None:
        """Wait for its end, at most so long [s]."""


class StartedProcess:
    """A process that this window has started."""

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        self._process = process

    def is_running(self) -> bool:
        """Tell whether it runs."""
        return self._process.poll() is None

    def find_exit_code(self) -> int | None:
        """Return its exit code."""
        return self._process.poll()

    def terminate(self) -> None:
        """Ask it to end."""
        with suppress(OSError):  # it has ended meanwhile
            self._process.terminate()

    def wait(self, seconds: float) -> None:
        """Wait for its end, at most so long [s]."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)


class FoundProcess:
    """A process that a window before this one has started.

    Parameters
    ----------
    record : JobRecord
    steps : Path
        File in which the command says how far it is, and how it ended.
    """

    def __init__(self, record: JobRecord, steps: Path) -> None:
        self._steps = steps
        self._process: psutil.Process | None = None
        with suppress(psutil.Error):
            process = psutil.Process(record.process)
            # numbers are given again: another process has begun at another time
            if abs(process.create_time() - record.begun) < _SAME_START:
                self._process = process

    def is_running(self) -> bool:
        """Tell whether it runs."""
        if self._process is None:
            return False
        try:
            return self._process.is_running() and self._process.status() != psutil.STATUS_ZOMBIE
        except psutil.Error:
            return False

    def find_exit_code(self) -> int | None:
        """Return its exit code, as it noted it."""
        return read_exit_code(self._steps)

    def terminate(self) -> None:
        """Ask it to end."""
        if self._process is not None:
            with suppress(psutil.Error):
                self._process.terminate()

    def wait(self, seconds: float) -> None:
        """Wait for its end, at most so long [s]."""
        if self._process is not None:
            with suppress(psutil.Error):
                self._process.wait(seconds)


class Job:
    """A command that was started.

    Attributes
    ----------
    number : int
        From 1, in the order in which jobs were started.
    command : ShownCommand
    """

    def __init__(
        self, number: int, command: ShownCommand, output: Path, process: JobProcess
    ) -> None:
        self.number = number
        self.command = command
        self._output = output
        self._process = process
        self._is_cancelled = False

    @property
    def state(self) -> JobState:
        """How far it is."""
        if self._process.is_running():
            return JobState.RUNNING
        code = self._process.find_exit_code()
        if self._is_cancelled and code != 0:
            return JobState.CANCELLED
        if code is None:
            return JobState.LOST
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
        return read_last_step(_get_steps_path(self._output))

    def cancel(self) -> None:
        """Ask it to end; its workers end with it, and nothing half-written stays."""
        self._is_cancelled = True
        self._process.terminate()

    def wait(self, seconds: float) -> None:
        """Wait for its end, at most so long [s]."""
        self._process.wait(seconds)


def _get_steps_path(output: Path) -> Path:
    """Return the file of the steps of a job, beside that of its output."""
    return output.with_suffix(".steps")


def _start_process(command: ShownCommand, folder: Path, output: Path) -> "subprocess.Popen[bytes]":
    """Start a command in a folder; what it prints goes to a file."""
    # -P: a file of the folder that is called like a module of Python is not run
    words = [sys.executable, "-P", "-m", "stepblocks", *command.words]
    environment = {
        **os.environ,
        "COLUMNS": _WIDTH,
        "PYTHONUNBUFFERED": "1",
        PROGRESS_FILE: str(_get_steps_path(output)),
    }
    with output.open("wb") as sink:
        return subprocess.Popen(
            words,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=subprocess.STDOUT,
        )


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
        self._notes = JobNotes(folder)

    @property
    def latest_first(self) -> list[Job]:
        """The jobs that are kept."""
        return self._jobs[::-1]

    def take_over_killed_jobs(self) -> None:
        """Take over the jobs of windows on this folder that were killed; those that run go on."""
        for record, output in self._notes.claim_killed_jobs():
            process = FoundProcess(record, _get_steps_path(output))
            self._jobs.append(Job(self._next_number, record.command, output, process))

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
                texts.TOO_MANY_JOBS.format(most=_MOST_AT_ONCE, count=len(running) + 1)
            )
        number = self._next_number
        output = self._notes.ensure_notes_folder() / f"{number}.txt"
        try:
            process = _start_process(command, self._folder, output)
        except OSError as error:
            reason = describe_system_error(error, output)
            raise PipelineError(texts.CANNOT_START.format(reason=reason)) from error
        write_job_record(command, process.pid, output)
        job = Job(number, command, output, StartedProcess(process))
        ended = [job for job in self._jobs if job not in running]
        forgotten = ended[:-_MOST_KEPT]
        self._jobs = [kept for kept in [*self._jobs, job] if kept not in forgotten]
        return job

    def start_once(self, command: ShownCommand) -> Job:
        """Start a command unless it runs already, as after a double click; return its job.

        Raises
        ------
        PipelineError
            As `start` raises it.
        """
        last = self.find_last(command)
        if last is not None and last.state is JobState.RUNNING:
            return last
        return self.start(command)

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
        self._notes.remove_held_notes()

    @property
    def _next_number(self) -> int:
        """The number of the next job."""
        return self._jobs[-1].number + 1 if self._jobs else 1
