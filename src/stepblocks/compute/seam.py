"""The seam of heavy work: processes of this machine, or the workers of a Dask cluster."""

from collections.abc import Callable, Generator, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

from stepblocks.compute.processes import run_in_processes

if TYPE_CHECKING:
    from distributed import Client

R = TypeVar("R")


def run_calls(
    function: Callable[..., R],
    calls: Iterable[tuple[Any, ...]],
    *,
    jobs: int,
    on: "Client | None" = None,
    in_order: bool = True,
) -> Generator[R]:
    """Call a function with each tuple of arguments, here or on a cluster.

    A call may run twice where a worker dies, so it must give the same result each time and leave
    the same files.

    Parameters
    ----------
    function : callable
        What is called; it and its arguments are pickled.
    calls : iterable of tuple
        The arguments of each call.
    jobs : int
        Processes of this machine; a cluster has its own number.
    on : distributed.Client, optional
        The cluster, as `open_cluster` gives it; processes of this machine where omitted.
    in_order : bool
        Yield the results in the order of the calls, or as they come.

    Yields
    ------
    object
        What the function returns.

    Raises
    ------
    PipelineError
        If a worker died, differs in its version, or the cluster cannot be reached.
    """
    if on is None:
        return run_in_processes(function, calls, jobs, in_order=in_order)
    from stepblocks.compute.cluster import run_on_cluster

    return run_on_cluster(function, calls, on, in_order=in_order)
