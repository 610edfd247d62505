"""Locks between processes: a lock file that is held while its process lives."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum, auto
from pathlib import Path


class LockState(Enum):
    """What came of an attempt to lock."""

    OURS = auto()
    TAKEN = auto()  # another process, or another run of this one, holds the lock
    UNAVAILABLE = auto()  # the file system has no locks, or nobody may write there


@contextmanager
def try_lock(file: Path) -> Iterator[LockState]:
    """Try to hold a lock file for the block, without waiting.

    Parameters
    ----------
    file : Path
        The lock file, in a folder that exists. It is made here, and removed with the lock.

    Yields
    ------
    LockState
        The block runs whatever the state: the caller decides what a lock that is not ours means.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(file, timeout=0, thread_local=False)
    state = LockState.OURS
    try:
        lock.acquire()
    except Timeout:
        state = LockState.TAKEN
    except (OSError, NotImplementedError):
        state = LockState.UNAVAILABLE
    try:
        yield state
    finally:
        if state is LockState.OURS:
            if os.name == "posix":
                # removed while it is held: whoever opened it meanwhile sees that it has no name any
                # more, and makes a new one. Windows removes it on release.
                file.unlink(missing_ok=True)
            lock.release()
