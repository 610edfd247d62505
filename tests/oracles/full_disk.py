"""Work for a cluster of which one worker has a full disk."""

import errno
import os

from stepblocks.errors import PipelineError


def write_unless_full(number: int, full: str) -> tuple[int, str]:
    """Fail on the worker of an address as a writer on a full disk does; else tell who worked."""
    from distributed import get_worker

    worker = str(get_worker().address)
    if worker != full:
        return number, worker
    try:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError as error:
        raise PipelineError("output cannot be written: no space left on the device") from error
