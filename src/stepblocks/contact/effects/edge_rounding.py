"""Edge of the block rounded: the ball meets an arc, and R becomes R + r in equation (2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(radius=state.radius + values["edge_radius_m"])


LAW = Law(
    id="edge_rounding",
    slot="contact_geometry",
    covariate="none",
    form="a = arccos(1 - H / (R + r))",
    parameters=(Constant("edge_radius_m", "m", 0.0, 0.0, 3e-4, 5e-6),),
    amplitudes=("edge_radius_m",),
    apply=_apply,
)
