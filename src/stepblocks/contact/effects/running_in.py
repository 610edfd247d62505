"""Running-in: friction settles over the trials, from the first to its final value."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState, Floats


def _apply(state: DragState, order: Floats, values: Mapping[str, float]) -> DragState:
    excess = values["excess"] * np.exp(-order / values["settling_trials"])
    return state.changed(friction=state.friction * np.maximum(1.0 + excess, 0.02))


LAW = Law(
    id="running_in",
    slot="friction",
    covariate="run_order",
    form="mu (1 + s exp(-n / n0))",
    parameters=(
        Constant("excess", "1", 0.0, -0.95, 20.0, 0.05),
        Constant("settling_trials", "1", 50.0, 3.0, 1000.0, 10.0),
    ),
    amplitudes=("excess",),
    apply=_apply,
    shapes=tuple({"settling_trials": n} for n in (15.0, 40.0, 100.0, 400.0)),
)
