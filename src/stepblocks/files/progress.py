"""How far a command is, for the program that started it: a line of JSON for each step.

Its last line is the exit code, from which a program that did not start it learns how it ended.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

# names, in the environment of a command, the file that it writes its steps to
PROGRESS_FILE = "STEPBLOCKS_PROGRESS"
_EXIT_CODE = "exit_code"  # key of the last line
_LAST_BYTES = 16_000  # of a file of steps, which hold the last one


@dataclass(frozen=True)
class ProgressStep:
    """A step that a command has done.

    Attributes
    ----------
    done : int
        Steps so far.
    total : int or None
        How many there will be, where that is known.
    name : str
        What was done.
    """

    done: int
    total: int | None
    name: str


def append_progress_step(path: Path, step: ProgressStep) -> None:
    """Add a step to a file; a command goes on where that file cannot be written."""
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(step)) + "\n")
    except OSError:
        return


def append_exit_code(path: Path, code: int) -> None:
    """Add the end of a command to its file of steps; it ends where that cannot be written, too."""
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({_EXIT_CODE: code}) + "\n")
    except OSError:
        return


def read_exit_code(path: Path) -> int | None:
    """Return the exit code of a command from its file of steps; None where it has not said any."""
    for line in _read_last_lines(path)[-1:]:
        try:
            code = json.loads(line)[_EXIT_CODE]
        except (ValueError, TypeError, LookupError):
            return None
        return code if isinstance(code, int) else None
    return None


def read_last_step(path: Path) -> ProgressStep | None:
    """Return the last whole step of a file; None where there is none yet."""
    for line in reversed(_read_last_lines(path)):
        try:
            return ProgressStep(**json.loads(line))
        except (ValueError, TypeError):
            continue
    return None


def _read_last_lines(path: Path) -> list[str]:
    """Return the last whole lines of a file; none where it cannot be read."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - _LAST_BYTES, 0))
            lines = file.read().decode(errors="replace").split("\n")
    except OSError:
        return []
    return lines[:-1]  # behind the last end of a line stands half a step
