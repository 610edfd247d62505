"""A file is saved by one window at a time: none other looks at it or writes it meanwhile."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stepblocks.errors import PipelineError
from stepblocks.files.locks import LockState, try_lock
from stepblocks.window import texts


@contextmanager
def hold_for_saving(path: Path) -> Iterator[None]:
    """Hold a file, to see whether somebody changed it and to write it.

    Raises
    ------
    PipelineError
        If another window holds it.
    """
    with try_lock(path.with_name(f".{path.name}.lock")) as state:
        if state is LockState.TAKEN:
            raise PipelineError(texts.BEING_SAVED.format(name=path.name))
        yield
