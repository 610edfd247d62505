"""A contact that creeps: tip and edge give way with the logarithm of the time for which the tip leans on the edge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState, Floats


def _apply(state: DragState, time: Floats, values: Mapping[str, float]) -> DragState:
    given = values["creep_depth_m"] * np.log1p(time / values["creep_time_s"])
    return state.changed(height=np.maximum(state.height - given, 0.05 * state.height))


LAW = Law(
    id="contact_creep",
    slot="contact_geometry",
    covariate="loading_time_s",
    form="H -> H - c ln(1 + t / t0), t the time from the first load on the edge to release",
    parameters=(
        Constant("creep_depth_m", "m", 0.0, -1e-5, 2e-5, 3e-7),
        Constant("creep_time_s", "s", 20e-3, 1e-3, 1.0, 5e-3),
    ),
    amplitudes=("creep_depth_m",),
    apply=_apply,
    shapes=tuple({"creep_time_s": t} for t in (5e-3, 20e-3, 80e-3)),
)
