"""The only importer of cadquery and OCP, which are loaded on first use."""

from typing import TYPE_CHECKING, Any

import lazy_loader

from stepblocks.cad import door as door
from stepblocks.compute.collector import pause_garbage_collector

if TYPE_CHECKING:
    from stepblocks.cad import kernel as kernel, pmi as pmi

_load, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["kernel", "pmi"])


def __getattr__(name: str) -> Any:
    """Load a submodule with its libraries."""
    with pause_garbage_collector():
        return _load(name)
