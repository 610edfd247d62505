"""End every process with the one that started it, also when that is killed."""

import os
import signal
import threading
from contextlib import suppress
from pathlib import Path

_PARENT_DIED = 1  # PR_SET_PDEATHSIG of prctl(2)


def die_with_parent() -> None:
    """Let the kernel kill this process when its parent ends; call it at a worker's start."""
    import ctypes
    import multiprocessing

    # a fork server stands between and lives as long as we do; who started us without one has no
    # sentinel
    if (asked := multiprocessing.parent_process()) is not None and asked.sentinel is not None:
        threading.Thread(target=_end_with_parent, args=(asked.sentinel,), daemon=True).start()
    parent = os.getppid()
    with suppress(OSError, AttributeError):  # another system than Linux
        ctypes.CDLL(None).prctl(_PARENT_DIED, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:  # it ended meanwhile
        os._exit(1)


def _end_with_parent(sentinel: int) -> None:
    from multiprocessing.connection import wait

    wait([sentinel])
    os.kill(os.getpid(), signal.SIGKILL)


def kill_workers() -> None:
    """Kill every process below this one; trackers of shared memory end by themselves."""
    for number in _list_children(os.getpid()):
        with suppress(OSError):
            if b"resource_tracker" not in Path(f"/proc/{number}/cmdline").read_bytes():
                os.kill(number, signal.SIGKILL)


def _list_children(process: int) -> list[int]:
    found: list[int] = []
    for tasks in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):
            found += map(int, tasks.read_text().split())
    return [deeper for child in found for deeper in (*_list_children(child), child)]
