"""Flat worn on the tip: the ball rides lower by the depth of the flat, and every step stands higher by it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(height=state.height + values["flat_depth_m"])


LAW = Law(
    id="tip_flat",
    slot="contact_geometry",
    covariate="none",
    form="a = arccos(1 - (H + d) / R), flat of half width sqrt(2 R d)",
    parameters=(Constant("flat_depth_m", "m", 0.0, 0.0, 3e-5, 1e-6),),
    amplitudes=("flat_depth_m",),
    apply=_apply,
    rank=1,
)
