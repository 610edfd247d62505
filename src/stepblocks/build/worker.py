"""What the workers of a build need, loaded once in the process of which they are forks.

Nobody else imports this module: it lets the process ignore an interruption, which is a matter of
the command that started it.
"""

import gc
import signal
from contextlib import suppress
from importlib import import_module

from stepblocks.compute.collector import pause_garbage_collector

_MODULES = (
    "stepblocks.artefacts.check",
    "stepblocks.artefacts.check_part",
    "stepblocks.artefacts.heightfield",
    "stepblocks.artefacts.meshes.write",
    "stepblocks.artefacts.step.write",
    "stepblocks.build.make",
    "stepblocks.build.picture",
    "stepblocks.declaration.set",
    "stepblocks.parts.shapes",
)
# Libraries that these load when they first need them; one may be missing
_LIBRARIES = (
    "joblib.externals.loky",
    "lib3mf",
    "manifold3d",
    "matplotlib.textpath",
    "meshio",
    "PIL.Image",
    "pyvista.plotting",
    "shapely",
    "tifffile",
    "trimesh",
)

signal.signal(signal.SIGINT, signal.SIG_IGN)
with pause_garbage_collector():
    for module in _MODULES:
        import_module(module)
    for library in _LIBRARIES:
        with suppress(ImportError):
            import_module(library)
    # all of it stays, and a collector that touched it would copy its memory for every fork
    gc.freeze()
