"""Notes of the jobs of a folder: they outlive the window that started them, and the system's start.

They lie where this system keeps the state of programs of a user, never in the folder itself.
"""

import hashlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from pydantic import TypeAdapter, ValidationError

from stepblocks.files.locks import LockState, try_lock
from stepblocks.files.paths import is_closed_to_other_writers
from stepblocks.window.command_line import ShownCommand

_PROGRAM, _PART = "stepblocks", "window"
_BEGIN = "stepblocks-window-"  # of the name of notes; behind it which folder they are of
_NAME = re.compile(rf"{_BEGIN}[0-9a-f]{{16}}-\w+")
_LOCK = "window.lock"  # held by the window that the jobs of a folder belong to
_OWN = 0o700  # mode of a folder that is a user's alone
_OLD = 90 * 24 * 3600.0  # age from which notes of a folder that nobody opened are forgotten [s]


@dataclass(frozen=True)
class JobRecord:
    """What is kept of a job for the next window on the folder.

    Attributes
    ----------
    command : ShownCommand
    process : int
        Number of its process.
    begun : float
        When that began, as its system says to a hundredth [s].
    noted : int
        When this was noted, by which jobs are in order [ns].
    """

    command: ShownCommand
    process: int
    begun: float
    noted: int


_RECORD = TypeAdapter(JobRecord)


class JobNotes:
    """Where the jobs of a folder leave their notes and what they print.

    Parameters
    ----------
    folder : Path
        The folder of the window.
    """

    def __init__(self, folder: Path) -> None:
        digest = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()
        self._prefix = f"{_BEGIN}{digest[:16]}-"
        self._locks = ExitStack()
        self._held: list[Path] = []
        self._place: Path | None = None

    def claim_killed_jobs(self) -> list[tuple[JobRecord, Path]]:
        """Lock the notes of windows on the folder that were killed; return them in order of jobs.

        Returns
        -------
        list of JobRecord and Path
            Each with the file of what the job printed.
        """
        state = _make_state_folder()
        records: list[tuple[JobRecord, Path]] = []
        for place in _yield_notes_folders(state):
            is_here = place.name.startswith(self._prefix)
            if not is_here and not _is_long_unused(place):
                continue
            if self._locks.enter_context(try_lock(place / _LOCK)) is not LockState.OURS:
                continue  # of a window that is open
            self._held.append(place)
            if is_here:
                records += _read_job_records(place)
        return sorted(records, key=lambda found: found[0].noted)

    def ensure_notes_folder(self) -> Path:
        """Return the folder for the jobs of this window; the first call makes and locks it."""
        if self._place is None:
            self._place = Path(tempfile.mkdtemp(prefix=self._prefix, dir=_make_state_folder()))
            self._held.append(self._place)
            self._locks.enter_context(try_lock(self._place / _LOCK))
        return self._place

    def remove_held_notes(self) -> None:
        """Remove all notes that are this window's or were found by it."""
        self._locks.close()
        for place in self._held:
            shutil.rmtree(place, ignore_errors=True)
        self._held = []
        self._place = None


def _make_state_folder() -> Path:
    """Return the folder of this user's state, made where it is not; else that of temporary files.

    Only where a user's own folder can be written to, notes are there after the system's next start.
    """
    import platformdirs

    folder = platformdirs.user_state_path(_PROGRAM, appauthor=False) / _PART
    with suppress(OSError):
        folder.mkdir(mode=_OWN, parents=True, exist_ok=True)
        if is_closed_to_other_writers(folder) and os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.gettempdir())


def write_job_record(command: ShownCommand, process: int, output: Path) -> None:
    """Keep what the next window needs to find a job; without it, it is not found."""
    with suppress(OSError, psutil.Error):
        begun = psutil.Process(process).create_time()
        record = JobRecord(command, process, begun, time.time_ns())
        text = json.dumps(asdict(record))
        output.with_suffix(".json").write_text(text, encoding="utf-8", newline="\n")


def _read_job_records(notes_folder: Path) -> list[tuple[JobRecord, Path]]:
    """Read the records of a folder, each with the file of its output; a damaged one is none."""
    records = []
    for path in notes_folder.glob("*.json"):
        with suppress(OSError, ValidationError):
            records.append((_RECORD.validate_json(path.read_bytes()), path.with_suffix(".txt")))
    return records


def _yield_notes_folders(state: Path) -> Iterator[Path]:
    """Yield the folders of notes that are this user's alone."""
    try:
        found = sorted(state.iterdir())
    except OSError:
        return
    for place in found:
        if _NAME.fullmatch(place.name) and is_closed_to_other_writers(place):
            yield place


def _is_long_unused(notes_folder: Path) -> bool:
    """Tell whether nobody wrote notes there for a long time."""
    try:
        return time.time() - notes_folder.stat().st_mtime > _OLD
    except OSError:
        return False
