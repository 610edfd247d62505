"""Paths on three systems: how long they may be, where they lead, and what an error says of them."""

import os
import stat
from pathlib import Path

# the longest path that Windows opens unless it was set up for longer ones [characters]
# (Microsoft Learn, Maximum Path Length Limitation: MAX_PATH is 260 with its closing zero)
_LONGEST_ON_WINDOWS = 259
_SYSTEM_HAS_SHORT_PATHS = os.name == "nt"
_WRITTEN_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def describe_system_error(error: OSError, path: Path) -> str:
    """Return what the system has against a path, as words for a message.

    Windows answers a path that is too long with "not found"; here it is called too long.
    """
    length = len(str(path.absolute()))
    if _SYSTEM_HAS_SHORT_PATHS and length > _LONGEST_ON_WINDOWS:
        return (
            f"a path must have at most {_LONGEST_ON_WINDOWS} characters on Windows, got {length}; "
            "choose a folder nearer to the root of the drive"
        )
    return error.strerror or str(error)


def resolve_inside(folder: Path, name: str) -> Path | None:
    """Follow a name that was read from a file; None where it may lead out of the folder.

    It may do so if it is empty or absolute, contains ``..``, or passes a link.
    """
    relative = Path(name)
    if not relative.parts or relative.anchor or ".." in relative.parts or "\0" in name:
        return None
    path = folder
    for part in relative.parts:
        path = path / part
        if path.is_symlink():
            return None
    return path


def is_closed_to_other_writers(folder: Path) -> bool:
    """Tell whether a folder is one of this user, into which nobody else can write.

    Others may be able to read it. A link, a file, or a path that does not exist is no such folder.
    Where users have no numbers, as on Windows, every folder is: each has one for temporary files.
    """
    try:
        found = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(found.st_mode):
        return False
    if not hasattr(os, "getuid"):
        return True
    return found.st_uid == os.getuid() and not found.st_mode & _WRITTEN_BY_OTHERS
