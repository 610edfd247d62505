"""The collector of cyclic garbage, kept from what it would search in vain."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def pause_garbage_collector() -> Iterator[None]:
    """Let the collector rest while libraries are loaded, and take what is there for old.

    The CAD kernel and its neighbours make half a million objects, all of which stay; the collector
    would look through them again and again, for a sixth of the time that they take to load.
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() == 0:
            # moved to the oldest generation, which is searched when as many new ones have survived
            gc.freeze()
            gc.unfreeze()
        gc.enable()
