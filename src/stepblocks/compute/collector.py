"""The collector of cyclic garbage, kept from what it would search in vain."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def pause_collector() -> Iterator[None]:
    """Let the collector rest while libraries are loaded.

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
        gc.enable()
