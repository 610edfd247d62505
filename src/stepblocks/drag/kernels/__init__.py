"""The compiled integrator of a drag: a leapfrog with a fixed step.

`integrate` tells the step; each file beside it holds the parts of one topic. The parts check
nothing, see `stepblocks.drag.simulate`. Numba compiles them into `integrate` and caches that by the
date of its own file: after a change in a part, save ``integrate.py`` too.
"""

from stepblocks.drag.kernels.integrate import integrate
from stepblocks.drag.kernels.model import (
    COLUMNS,
    LEDGER,
    Carrier,
    Friction,
    Handle,
    Ledger,
    Model,
    NormalContact,
    Outcome,
    Pace,
    Passage,
    Path,
    Places,
    Spring,
    Start,
    Stop,
    Wall,
)

__all__ = [
    "COLUMNS",
    "LEDGER",
    "Carrier",
    "Friction",
    "Handle",
    "Ledger",
    "Model",
    "NormalContact",
    "Outcome",
    "Pace",
    "Passage",
    "Path",
    "Places",
    "Spring",
    "Start",
    "Stop",
    "Wall",
    "integrate",
]
