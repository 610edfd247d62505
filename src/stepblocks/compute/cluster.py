"""Work on a Dask cluster: a scheduler by its address, a batch system by its name, or a client."""

import errno
import os
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any, TypeVar

from stepblocks import __version__
from stepblocks.compute.fingerprint import compute_code_fingerprint
from stepblocks.compute.processes import collect_worker_environment
from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from distributed import Client, Future

R = TypeVar("R")

# batch systems that dask-jobqueue starts workers on, and its class for each
BATCH_SYSTEMS = {
    "htcondor": "HTCondorCluster",
    "lsf": "LSFCluster",
    "oar": "OARCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "slurm": "SLURMCluster",
}
# libraries whose version can change a figure or a byte that a worker returns
_COMPUTING_LIBRARIES = (
    "cadquery",
    "cadquery-ocp",
    "distributed",
    "manifold3d",
    "matplotlib",
    "numba",
    "numpy",
    "pandas",
    "pyarrow",
    "pyvista",
    "scipy",
    "statsmodels",
    "trimesh",
    "vtk",
)
_CONNECT_TIMEOUT = 30  # [s]
_WORKER_TIMEOUT = 600  # until the first worker is there: a batch system has a queue [s]
_LOST_TIMEOUT = 60  # until a scheduler that does not answer counts as lost [s]
_AHEAD = 4  # calls that wait at the scheduler for each worker
_DEFAULT_MEMORY = "4GiB"  # of a worker of a batch system, where the user's configuration says none
_DEFAULT_JOBS = 4
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)

# the CAD kernel and the renderer bear one thread at a time
_ONE_CALL_AT_A_TIME = threading.Lock()

Versions = Mapping[str, str]


@contextmanager
def open_cluster(on: "str | Client | None", jobs: int | None = None) -> "Iterator[Client | None]":
    """Connect to a cluster, and leave it in the end.

    Parameters
    ----------
    on : str, distributed.Client or None
        Address of a scheduler such as ``"tcp://10.0.0.1:8786"``, a batch system of
        `BATCH_SYSTEMS`, a client, which stays open, or None for none.
    jobs : int, optional
        Workers that a batch system is asked for.

    Yields
    ------
    distributed.Client or None
        Connected, with at least one worker; None where `on` is None.

    Raises
    ------
    PipelineError
        If the address is none, a library is missing, nobody answers, or no worker comes.
    """
    if on is None:
        yield None
        return
    distributed = _import_distributed()
    if isinstance(on, distributed.Client):
        _wait_for_worker(on)
        yield on
        return
    if not isinstance(on, str):
        raise PipelineError(
            "on must be the address of a Dask scheduler, a batch system or a Client, got "
            f"{type(on).__name__}"
        )
    if on in BATCH_SYSTEMS:
        with (
            _start_batch_cluster(on, jobs or _DEFAULT_JOBS) as started,
            _connect_to_scheduler(started) as client,
        ):
            yield client
        return
    _refuse_unknown_scheduler(on)
    with _connect_to_scheduler(on) as client:
        yield client


def _import_distributed() -> Any:
    """Import Dask's scheduler, which an extra installs."""
    try:
        import distributed
    except ImportError as error:
        raise PipelineError(
            "a cluster needs Dask: install the extra with pip install 'stepblocks[cluster]'"
        ) from error
    return distributed


def _refuse_unknown_scheduler(address: str) -> None:
    """Refuse what is neither an address nor a batch system."""
    protocol, separator, place = address.partition("://")
    if protocol in ("tcp", "tls", "ucx", "ws", "wss") and separator and place:
        return
    systems = ", ".join(BATCH_SYSTEMS)
    raise PipelineError(
        f"on must be an address such as tcp://10.0.0.1:8786, or one of {systems}, got {address!r}"
    )


@contextmanager
def _connect_to_scheduler(scheduler: Any) -> "Iterator[Client]":
    """Connect to a scheduler, wait for its first worker, and leave it in the end."""
    distributed = _import_distributed()
    try:
        client = distributed.Client(scheduler, timeout=f"{_CONNECT_TIMEOUT}s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise PipelineError(
            f"no Dask scheduler answers within {_CONNECT_TIMEOUT} s; start one with "
            f"`dask scheduler` and its workers with `dask worker ADDRESS` [{scheduler}]"
        ) from error
    try:
        _wait_for_worker(client)
        yield client
    finally:
        with suppress(Exception):  # a scheduler that is gone needs no goodbye
            client.close(timeout=5)


@contextmanager
def _start_batch_cluster(batch_system: str, jobs: int) -> Iterator[Any]:
    """Start a scheduler here and ask a batch system for workers; end both."""
    try:
        import dask_jobqueue
    except ImportError as error:
        raise PipelineError(
            f"workers on {batch_system} need dask-jobqueue: install the extra with "
            "pip install 'stepblocks[cluster]'"
        ) from error
    import dask

    # any free port for the dashboard: several users share the machine that submits jobs
    settings: dict[str, Any] = {"scheduler_options": {"dashboard_address": ":0"}}
    if dask.config.get(f"jobqueue.{batch_system}.cores", None) is None:
        settings["cores"] = 1
        settings["processes"] = 1
    if dask.config.get(f"jobqueue.{batch_system}.memory", None) is None:
        settings["memory"] = _DEFAULT_MEMORY
    try:
        cluster = getattr(dask_jobqueue, BATCH_SYSTEMS[batch_system])(**settings)
    except (OSError, RuntimeError, ValueError) as error:
        raise PipelineError(f"{batch_system} cannot be used from here: {error}") from error
    try:
        cluster.scale(jobs=jobs)
        yield cluster
    finally:
        cluster.close()


def _wait_for_worker(client: "Client") -> None:
    """Wait until a cluster has a worker."""
    try:
        client.wait_for_workers(1, timeout=_WORKER_TIMEOUT)
    except (OSError, TimeoutError) as error:
        raise PipelineError(
            f"the cluster has no worker after {_WORKER_TIMEOUT} s; start one with "
            f"`dask worker {client.scheduler.address}`"
        ) from error


def run_on_cluster(
    function: Callable[..., R],
    calls: Iterable[tuple[Any, ...]],
    client: "Client",
    *,
    in_order: bool = True,
) -> Generator[R]:
    """Call a function with each tuple of arguments on the workers of a cluster.

    A few calls for each worker wait at the scheduler; the rest stay here until there is room. A
    call whose worker dies, or has no room left on its disk, is repeated by another.

    Parameters
    ----------
    function, calls, in_order
        As in `run_calls`.
    client : distributed.Client
        The cluster.

    Yields
    ------
    object
        What the function returns.

    Raises
    ------
    PipelineError
        If a worker has another version, workers die of the same call again and again, none has
        room on its disk, or the scheduler is lost.
    """
    from concurrent.futures import CancelledError

    from distributed import CancelledError as CancelledOnClusterError, KilledWorker

    versions = collect_versions()
    _refuse_cluster_of_other_versions(client, versions)
    queue = _CallQueue(
        client, _ClusterFunction(versions, collect_worker_environment(), function), iter(calls)
    )
    try:
        yield from queue.iterate_results(in_order=in_order)
    except KilledWorker as error:
        raise PipelineError(
            "several workers died of the same piece of work: they were ended from outside or ran "
            "out of memory; what is finished stays, and the same command goes on from there"
        ) from error
    except (CancelledError, CancelledOnClusterError, _SchedulerLostError) as error:
        raise _make_lost_scheduler_error(client) from error
    except (OSError, TimeoutError) as error:
        if client.status == "running":  # the error of a call
            raise
        raise _make_lost_scheduler_error(client) from error


def _make_lost_scheduler_error(client: "Client") -> PipelineError:
    """Return the error of a scheduler that has ended."""
    return PipelineError(
        "the scheduler of the cluster cannot be reached any more; what is finished stays, and the "
        f"same command goes on from there [{client.scheduler.address}]"
    )


class _SchedulerLostError(Exception):
    """The scheduler forgot what it was asked for: it has ended, or was started again."""


@dataclass(frozen=True)
class _ClusterFunction:
    """What a worker needs beside the arguments of a call."""

    versions: Versions  # of the client
    settings: Mapping[str, str]  # environment variables of the client
    function: Callable[..., Any]

    def call_on_worker(self, call: tuple[Any, ...]) -> Any:
        """Call the function on a worker, which may have joined after the others were checked."""
        worker = _get_worker_address()
        _refuse_other_versions(self.versions, collect_versions(), f"worker {worker}")
        with _ONE_CALL_AT_A_TIME:
            os.environ.update(self.settings)
            try:
                return self.function(*call)
            except (OSError, PipelineError) as error:
                if _is_disk_unwritable(error):
                    return _NoRoom(worker, str(error))
                raise


@dataclass(frozen=True)
class _NoRoom:
    """A worker could not write: its disk is full, or may only be read."""

    worker: str
    reason: str


def _is_disk_unwritable(error: BaseException | None) -> bool:
    """Tell whether an error, or one in its chain of causes, says that a disk cannot be written."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _NO_ROOM:
            return True
        error = error.__cause__
    return False


class _CallQueue:
    """Keeps a scheduler supplied with calls, and takes what comes back."""

    def __init__(
        self, client: "Client", order: _ClusterFunction, calls: Iterator[tuple[Any, ...]]
    ) -> None:
        self._client = client
        self._order = order
        self._calls = calls
        self._waiting: dict[Future[Any], tuple[Any, ...]] = {}  # in the order of the calls
        self._full_workers: set[str] = set()

    def iterate_results(self, *, in_order: bool) -> Generator[Any]:
        """Yield the results in the order of the calls, or as they come."""
        try:
            while True:
                self._submit_until_full()
                if not self._waiting:
                    return
                future = next(iter(self._waiting))
                if not in_order:
                    future = self._wait_for_any_call()
                result = self._get_result_or_repeat(future)
                yield result
        finally:
            with suppress(Exception):  # a scheduler that is gone has nothing to cancel
                self._client.cancel(list(self._waiting))

    def _list_worker_addresses(self) -> list[str]:
        """Addresses of the workers that are there now."""
        return list(self._client.scheduler_info(n_workers=-1)["workers"])

    def _submit_until_full(self) -> None:
        """Submit calls until each worker has a few before it."""
        workers = max(len(self._list_worker_addresses()), 1)
        while len(self._waiting) < _AHEAD * workers:
            call = next(self._calls, None)
            if call is None:
                return
            self._waiting[self._submit_call(call)] = call

    def _submit_call(self, call: tuple[Any, ...]) -> "Future[Any]":
        """Hand a call to the scheduler, for the workers that have room on their disks."""
        allowed = None
        if self._full_workers:
            allowed = [
                name for name in self._list_worker_addresses() if name not in self._full_workers
            ]
        # a key of its own: a call is never answered by what another run left on the scheduler
        key = f"stepblocks-{token_hex(8)}"
        return self._client.submit(
            self._order.call_on_worker, call, key=key, workers=allowed, pure=False
        )

    def _wait_for_any_call(self) -> "Future[Any]":
        """Wait until a call has ended, and return it."""
        from distributed import wait

        with self._client.as_current():
            done = wait(list(self._waiting), return_when="FIRST_COMPLETED").done
        for future in self._waiting:
            if future in done:
                return future
        raise _SchedulerLostError

    def _get_result_or_repeat(self, future: "Future[Any]") -> Any:
        """Return the result of a call; repeat it elsewhere while workers have no room."""
        while True:
            call = self._waiting[future]
            result = _wait_for_result(self._client, future)
            del self._waiting[future]
            if not isinstance(result, _NoRoom):
                return result
            self._full_workers.add(result.worker)
            if self._full_workers.issuperset(self._list_worker_addresses()):
                raise PipelineError(
                    f"no worker of the cluster has room to write: {result.reason} "
                    f"[worker {result.worker}]"
                )
            future = self._submit_call(call)
            self._waiting[future] = call


def _wait_for_result(client: "Client", future: "Future[Any]") -> Any:
    """Return what a call gave, or raise its error; notice a scheduler that is lost."""
    from distributed import TimeoutError as TimeoutOnClusterError

    while True:
        try:
            return future.result(timeout=_LOST_TIMEOUT)
        except TimeoutOnClusterError:
            if client.status != "running":
                raise _SchedulerLostError from None


def _get_worker_address() -> str:
    """Return the address of the worker that runs this call, as messages name it."""
    from distributed import get_worker

    return str(get_worker().address)


def _refuse_cluster_of_other_versions(client: "Client", versions: Versions) -> None:
    """Compare the versions of the scheduler and of all its workers with those of this process.

    The scheduler takes calls apart and needs the same code as the workers.
    """
    try:
        found = {f"scheduler {client.scheduler.address}": client.run_on_scheduler(collect_versions)}
        for worker, theirs in sorted(client.run(collect_versions).items()):
            found[f"worker {worker}"] = theirs
    except (ImportError, RuntimeError) as error:  # nobody unpickles what he has no code for
        raise PipelineError(
            f"scheduler and workers must have stepblocks {__version__} installed: {error}"
        ) from error
    for place, theirs in found.items():
        _refuse_other_versions(versions, theirs, place)


def _refuse_other_versions(
    expected_versions: Versions, found_versions: Versions, place_in_message: str
) -> None:
    """Refuse a place of a cluster where a version is not that of the client, and name both."""
    differences = []
    for name, expected in expected_versions.items():
        actual = found_versions.get(name, "missing")
        if actual != expected:
            differences.append(f"{name} {actual} there, {expected} here")
    if differences:
        raise PipelineError(
            "the cluster must have the code and libraries of the client, got "
            f"{'; '.join(differences)} [{place_in_message}]"
        )


@cache
def collect_versions() -> dict[str, str]:
    """Collect the versions that must agree: of Python, this package, its code, and libraries."""
    import platform

    major, minor, _ = platform.python_version_tuple()
    versions = {
        "Python": f"{major}.{minor}",
        "stepblocks": __version__,
        "code of stepblocks": compute_code_fingerprint()[:12],
    }
    for library in _COMPUTING_LIBRARIES:
        try:
            versions[library] = version(library)
        except PackageNotFoundError:
            versions[library] = "missing"
    return versions


def is_folder_shared(client: "Client", folder: Path) -> bool:
    """Tell whether all workers see a folder of this machine, by a file that is put there."""
    token = token_hex(16)
    path = folder.absolute() / f".shared-{token}"
    path.write_text(token, encoding="utf-8", newline="\n")
    try:
        seen = client.run(_can_worker_read_and_write, str(path), token)
    finally:
        path.unlink(missing_ok=True)
    return all(seen.values())


def _can_worker_read_and_write(path: str, token: str) -> bool:
    """Tell whether a worker can read what the client wrote, and write beside it."""
    try:
        found = Path(path).read_text(encoding="utf-8")
        return found == token and os.access(Path(path).parent, os.W_OK)
    except OSError:
        return False


def get_dashboard_address(client: "Client") -> str:
    """Return the address of the page on which Dask shows what its workers do."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return str(client.dashboard_link)
