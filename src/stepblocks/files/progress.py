"""How far a command is, for the program that started it: a line of JSON for each step."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

# names, in the environment of a command, the file that it writes its steps to
PROGRESS_FILE = "STEPBLOCKS_PROGRESS"
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


def append_step(path: Path, step: ProgressStep) -> None:
    """Add a step to a file; a command goes on where that file cannot be written."""
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(step)) + "\n")
    except OSError:
        return


def read_last_step(path: Path) -> ProgressStep | None:
    """Return the last whole step of a file; None where there is none yet."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - _LAST_BYTES, 0))
            lines = file.read().decode(errors="replace").split("\n")
    except OSError:
        return None
    for line in reversed(lines[:-1]):  # behind the last end of a line stands half a step
        try:
            return ProgressStep(**json.loads(line))
        except (ValueError, TypeError):
            continue
    return None
