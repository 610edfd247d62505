"""The real release: of the stored energy some lifts the tip over the rest of the step, and some is rubbed away."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState

__all__ = ["LAW"]


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    reach = np.sqrt(np.maximum(state.height * (2.0 * state.radius - state.height), 0.0))
    work = state.load * (state.height + state.friction * reach)
    return state.changed(lost_energy=state.lost_energy + values["share"] * work)


LAW = Law(
    id="real_release",
    slot="conversion",
    covariate="height_um",
    form="E_v = C_v F_px^2 / 2k - s F_py (H + mu sqrt(H (2R - H)))",
    parameters=(Constant("share", "1", 0.0, -1.0, 3.0, 0.02),),
    amplitudes=("share",),
    apply=_apply,
)
