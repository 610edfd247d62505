"""Work in several processes; each ends with the one that started it, also when that is killed."""

import os
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import suppress
from typing import Any, TypeVar

from stepblocks.errors import PipelineError

R = TypeVar("R")

_OURS = "STEPBLOCKS_"  # how the environment variables begin that a worker needs
_PARENT_DIED = 1  # PR_SET_PDEATHSIG of prctl(2)


def run_in_processes(
    function: Callable[..., R],
    calls: Iterable[tuple[Any, ...]],
    jobs: int,
    *,
    in_order: bool = True,
) -> Generator[R]:
    """Call a function with each tuple of arguments in so many processes; yield the results.

    The workers load no main module: a script or a notebook needs no guard.
    """
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # the pool replaces a worker that has grown much and goes on; where warnings are errors, this
    # one would end the thread that does so, and nobody would start the work that waits
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    parallel = Parallel(
        n_jobs=jobs,
        return_as="generator" if in_order else "generator_unordered",
        initializer=_begin_worker,
        # workers of other settings are not used again
        initargs=({name: one for name, one in os.environ.items() if name.startswith(_OURS)},),
    )
    try:
        yield from parallel(delayed(function)(*call) for call in calls)
    except TerminatedWorkerError as error:
        raise PipelineError(
            "a worker process died: it was ended from outside, ran out of memory, or found no "
            "OpenGL (libGL, libEGL); run it again, and it goes on"
        ) from error


def _begin_worker(settings: Mapping[str, str]) -> None:
    os.environ.update(settings)
    die_with_parent()


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
    import psutil

    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # it has ended meanwhile
            if "resource_tracker" not in " ".join(child.cmdline()):
                child.kill()
