"""Block tilted along the drag: the same as friction ``tan(atan mu + t)``, for every force and energy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(tilt=state.tilt + values["tilt_rad"])


LAW = Law(
    id="block_tilt",
    slot="contact_geometry",
    covariate="none",
    form="a -> a + t",
    parameters=(Constant("tilt_rad", "rad", 0.0, -0.3, 0.3, 0.01),),
    amplitudes=("tilt_rad",),
    apply=_apply,
    rank=5,
)
