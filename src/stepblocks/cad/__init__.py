"""The only importer of cadquery and OCP, which are loaded on first use."""

from typing import TYPE_CHECKING

import lazy_loader

from stepblocks.cad import door as door

if TYPE_CHECKING:
    from stepblocks.cad import kernel as kernel, pmi as pmi

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["kernel", "pmi"])
