"""Work in several processes; each ends with the one that started it, also when that is killed."""

import os
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from concurrent.futures import Future
    from multiprocessing.context import BaseContext

R = TypeVar("R")

_OURS = "STEPBLOCKS_"  # how the environment variables begin that a worker needs
_PARENT_DIED = 1  # PR_SET_PDEATHSIG of prctl(2)
_KILL = 9  # the number of SIGKILL, which not every system names
_LATEST_END = 1.0  # of a process that was killed [s]
_WORKER_DIED = (
    "a worker process died: it was ended from outside, ran out of memory, or found no "
    "OpenGL (libGL, libEGL); run it again, and it goes on"
)


def run_in_processes(
    function: Callable[..., R],
    calls: Iterable[tuple[Any, ...]],
    jobs: int,
    *,
    in_order: bool = True,
) -> Generator[R]:
    """Call a function with each tuple of arguments, in processes of this machine.

    The workers load no main module: a script or a notebook needs no main guard.

    Parameters
    ----------
    function : callable
        What is called; it and its arguments are pickled.
    calls : iterable of tuple
        The arguments of each call.
    jobs : int
        Number of processes.
    in_order : bool
        Yield the results in the order of the calls, or as they come.

    Yields
    ------
    object
        What the function returns.

    Raises
    ------
    PipelineError
        If a worker died.
    """
    # the pool replaces a worker that has grown much and goes on; where warnings are errors, this
    # one would end the thread that does so, and nobody would start the work that waits
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    run = _run_in_pool
    if jobs > 1 and _fork_server.is_running:
        run = _run_in_forks
    try:
        yield from run(function, calls, jobs, in_order)
    except TerminatedWorkerError as error:
        raise PipelineError(_WORKER_DIED) from error


def _run_in_pool(
    function: Callable[..., R], calls: Iterable[tuple[Any, ...]], jobs: int, in_order: bool
) -> Generator[R]:
    """Make calls in a pool of processes that start from nothing, and stay for the next calls."""
    from joblib import Parallel, delayed

    parallel = Parallel(
        n_jobs=jobs,
        return_as="generator" if in_order else "generator_unordered",
        initializer=_initialise_worker,
        initargs=(collect_worker_environment(),),  # workers of other settings are not used again
    )
    yield from parallel(delayed(function)(*call) for call in calls)


def _run_in_forks(
    function: Callable[..., R], calls: Iterable[tuple[Any, ...]], jobs: int, in_order: bool
) -> Generator[R]:
    """Make calls in forks of the fork server, which end with the last call."""
    from concurrent.futures import as_completed

    from joblib.externals.loky import ProcessPoolExecutor

    pool = ProcessPoolExecutor(
        jobs,
        context=_fork_server.get_context(),
        initializer=_initialise_worker,
        initargs=(collect_worker_environment(),),
    )
    futures: list[Future[R]] = []
    try:
        for call in calls:
            futures.append(pool.submit(function, *call))
        for future in futures if in_order else as_completed(futures):
            yield future.result()
    finally:
        if not all(future.done() for future in futures):
            _kill_fork_workers(futures)
        pool.shutdown()


def _kill_fork_workers(futures: "Iterable[Future[Any]]") -> None:
    """Kill the workers that make calls of which nobody wants the results; wait for their ends."""
    import multiprocessing

    for future in futures:
        future.cancel()
    for worker in multiprocessing.active_children():
        worker.kill()
        worker.join()


class _ForkServer:
    """The process that loads modules once, and is forked for every worker.

    Only Linux forks a process that has loaded much, and only the command line may be loaded again
    by a worker as its main module: it does nothing then.
    """

    def __init__(self) -> None:
        self.is_running = False

    def start_with_module(self, module: str) -> None:
        """Start it, where this process can; it loads a module while this process goes on."""
        can_fork = sys.platform == "linux" and hasattr(os, "fork")
        if can_fork and _is_command_line():
            from multiprocessing import forkserver

            forkserver.set_forkserver_preload([module])
            forkserver.ensure_running()
            self.is_running = True

    def get_context(self) -> "BaseContext":
        """Return what starts processes by it."""
        import multiprocessing

        return multiprocessing.get_context("forkserver")


_fork_server = _ForkServer()


def preload_for_workers(module_name: str) -> None:
    """Begin to load a module for the workers of the calls that follow, where they can be forked.

    It is loaded once and beside what this process does meanwhile, and not in every worker.
    Elsewhere workers load what they need by themselves.

    Parameters
    ----------
    module_name : str
        Its name; it imports what the workers need.
    """
    _fork_server.start_with_module(module_name)


def _is_command_line() -> bool:
    """Tell whether this process is ``stepblocks`` or ``python -m stepblocks``."""
    main = sys.modules["__main__"]
    if main.__spec__ is not None:
        return main.__spec__.name == "stepblocks.__main__"
    return Path(getattr(main, "__file__", None) or "").name == "stepblocks"


def collect_worker_environment() -> dict[str, str]:
    """Collect the environment variables that a worker needs as the process that starts it."""
    return {name: text for name, text in os.environ.items() if name.startswith(_OURS)}


def _initialise_worker(settings: Mapping[str, str]) -> None:
    """Give a worker the settings of its parent, and let it end with the parent."""
    os.environ.update(settings)
    arrange_end_with_parent()


def arrange_end_with_parent() -> None:
    """Arrange that this process ends when its parent does; call it at a worker's start."""
    import multiprocessing

    parent = os.getppid()
    starter = multiprocessing.parent_process()
    # a fork server stands between and lives as long as we do; who started us without one has no
    # sentinel
    if starter is not None and starter.sentinel is not None:
        _start_watching_thread(_exit_after_sentinel, starter.sentinel)
    if not _request_kill_with_parent():
        _start_watching_thread(_exit_after_process, parent)
    if os.getppid() != parent:  # it ended meanwhile
        os._exit(1)


def _request_kill_with_parent() -> bool:
    """Ask the kernel to kill this process when its parent ends; return whether it will."""
    import ctypes

    try:
        answer = ctypes.CDLL(None).prctl(_PARENT_DIED, _KILL, 0, 0, 0)
    except (OSError, AttributeError, TypeError):  # another system than Linux
        return False
    return int(answer) == 0


def _start_watching_thread(watch: Callable[[int], None], watched: int) -> None:
    """Watch in a thread for the end of another process."""
    threading.Thread(target=watch, args=(watched,), daemon=True).start()


def _exit_after_sentinel(sentinel: int) -> None:
    """End this process when the one with a sentinel has ended."""
    from multiprocessing.connection import wait

    wait([sentinel])
    os._exit(1)


def _exit_after_process(pid: int) -> None:
    """End this process when another has ended, on systems whose kernel does not see to it."""
    import psutil

    with suppress(psutil.Error):  # it is not there any more
        psutil.Process(pid).wait()
    os._exit(1)


def kill_child_processes() -> None:
    """Kill all descendants of this process, and wait for their ends.

    Trackers of shared memory end by themselves.
    """
    import psutil

    killed = []
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # it has ended meanwhile
            if "resource_tracker" not in " ".join(child.cmdline()):
                child.kill()
                killed.append(child)
    psutil.wait_procs(killed, timeout=_LATEST_END)
