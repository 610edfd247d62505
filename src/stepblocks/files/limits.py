"""Limits on a process that reads what others made: by the kernel where it can, else watched."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil

# what a reader may fill [bytes]; what its libraries map but do not fill comes on top
MEMORY = 2 * 2**30
_MAPPED = 4 * 2**30

_LOOK_EVERY = 0.05  # time between two looks at a process that the kernel does not limit [s]


class Breach(Enum):
    """The limit for which a process was ended."""

    TIME = "time"
    MEMORY = "memory"


def can_kernel_limit_processes() -> bool:
    """Tell whether the kernel limits the memory and processor time of a process when asked.

    Windows has no such call, and macOS accepts a limit on memory without holding it.
    """
    if sys.platform == "linux":
        try:
            import resource  # noqa: F401
        except ImportError:
            return False
        return True
    else:
        return False


def limit_this_process(seconds: float) -> None:
    """Limit what this process may use, and its processor time from now on [s], where possible.

    A lower limit of the user's own stays.
    """
    if sys.platform != "win32" and can_kernel_limit_processes():
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        limits = {
            resource.RLIMIT_AS: _MAPPED,
            resource.RLIMIT_DATA: MEMORY,
            resource.RLIMIT_CORE: 0,
            resource.RLIMIT_CPU: int(used.ru_utime + used.ru_stime + seconds) + 1,
        }
        for kind, limit in limits.items():
            _, hard = resource.getrlimit(kind)
            soft = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
            resource.setrlimit(kind, (soft, hard))


def ran_out_of_time(exit_code: int | None) -> bool:
    """Tell whether a process ended with this code because the kernel's limit on time was over."""
    if sys.platform != "win32":
        return exit_code == -signal.SIGXCPU
    else:
        return False


class Watch:
    """A thread that ends a process once it has used too much.

    Parameters
    ----------
    process : Popen
        The process.
    processor_seconds : float
        How long it may compute [s]; looked at where the kernel does not limit it.
    wall_seconds : float
        How long it may take [s].

    Attributes
    ----------
    breach : Breach, optional
        Why the process was ended here; None while it was not.
    """

    def __init__(
        self, process: subprocess.Popen[bytes], processor_seconds: float, wall_seconds: float
    ) -> None:
        self.breach: Breach | None = None
        self._process = process
        self._processor_seconds = processor_seconds
        self._deadline = time.monotonic() + wall_seconds
        self._stopped = threading.Event()
        watch: Callable[[], None] = self._wait_for_deadline
        if not can_kernel_limit_processes():
            import psutil  # here, since who imports it in the thread fails unseen

            seen = psutil.Process(process.pid)
            watch = partial(self._watch_usage, seen, _sum_processor_time(seen))
        self._thread = threading.Thread(target=watch, daemon=True)

    def __enter__(self) -> "Watch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()

    def _wait_for_deadline(self) -> None:
        """End the process when the time is over; the kernel sees to all else."""
        if not self._stopped.wait(max(self._deadline - time.monotonic(), 0.0)):
            self._kill_process(Breach.TIME)

    def _watch_usage(self, process: "psutil.Process", cpu_seconds_before: float) -> None:
        """End the process when it has used too much time or memory, or hides what it uses."""
        try:
            while not self._stopped.wait(_LOOK_EVERY):
                computed = _sum_processor_time(process) - cpu_seconds_before
                is_late = time.monotonic() > self._deadline
                if is_late or computed > self._processor_seconds:
                    self._kill_process(Breach.TIME)
                    return
                if process.memory_info().rss > MEMORY:
                    self._kill_process(Breach.MEMORY)
                    return
        except Exception:  # it has ended, or the system does not tell
            self._process.kill()

    def _kill_process(self, breach: Breach) -> None:
        """Note what limit was breached, and kill the process."""
        self.breach = breach
        self._process.kill()


def _sum_processor_time(process: "psutil.Process") -> float:
    """Return the processor time that a process has used [s]."""
    times = process.cpu_times()
    return float(times.user + times.system)
