"""Viscous drag on the tool: a tangential force in proportion to speed, beside friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState

__all__ = ["LAW"]


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(drag=state.drag + values["coefficient_n_s_per_m"] * state.speed)


LAW = Law(
    id="viscous_drag",
    slot="drag",
    covariate="speed_mm_s",
    form="F_x + c v",
    parameters=(Constant("coefficient_n_s_per_m", "N s/m", 0.0, -20.0, 100.0, 0.5),),
    amplitudes=("coefficient_n_s_per_m",),
    apply=_apply,
)
