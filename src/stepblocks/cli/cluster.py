"""What a command says of the cluster that it works on."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distributed import Client


@contextmanager
def open_shown_cluster(
    on: str | None, jobs: int | None, *, quiet: bool
) -> "Iterator[Client | None]":
    """Connect to a cluster and print where its dashboard is; None for this machine alone."""
    if on is None:
        yield None
        return
    from stepblocks.compute.cluster import get_dashboard_address, open_cluster

    with open_cluster(on, jobs) as client:
        assert client is not None  # a place was named
        if not quiet:
            print(f"dashboard: {get_dashboard_address(client)}", file=sys.stderr)
        yield client
