"""Tip that wears: its radius grows in proportion to the drags it has made, or was larger than stated all along."""

from __future__ import annotations

from collections.abc import Mapping

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState, Floats


def _apply(state: DragState, order: Floats, values: Mapping[str, float]) -> DragState:
    return state.changed(radius=state.radius + values["growth_m_per_trial"] * order)


def _worn(state: DragState, _: object, values: Mapping[str, float]) -> DragState:
    return state.changed(radius=state.radius + values["radius_error_m"])


LAW = Law(
    id="tip_wear",
    slot="contact_geometry",
    covariate="run_order",
    form="R(n) = R + w n",
    parameters=(Constant("growth_m_per_trial", "m", 0.0, 0.0, 5e-6, 3e-8),),
    amplitudes=("growth_m_per_trial",),
    apply=_apply,
)

WORN = Law(
    id="tip_radius_error",
    slot="contact_geometry",
    covariate="none",
    form="R -> R + w; the same as a rounded edge, which a scan must rule out",
    parameters=(Constant("radius_error_m", "m", 0.0, -1e-4, 3e-4, 5e-6),),
    amplitudes=("radius_error_m",),
    apply=_worn,
    rank=1,
)
