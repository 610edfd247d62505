"""Tip that wears: its radius grows in proportion to the drags it has made."""

from __future__ import annotations

from collections.abc import Mapping

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState, Floats

__all__ = ["LAW"]


def _apply(state: DragState, order: Floats, values: Mapping[str, float]) -> DragState:
    return state.changed(radius=state.radius + values["growth_m_per_trial"] * order)


LAW = Law(
    id="tip_wear",
    slot="contact_geometry",
    covariate="run_order",
    form="R(n) = R + w n",
    parameters=(Constant("growth_m_per_trial", "m", 0.0, 0.0, 5e-6, 3e-8),),
    amplitudes=("growth_m_per_trial",),
    apply=_apply,
)
