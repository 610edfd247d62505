"""Viscous drag on the tool: a tangential force in proportion to speed, beside friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _always(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(drag=state.drag + values["coefficient_n_s_per_m"] * state.speed)


def _climbing(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(climb_drag=state.climb_drag + values["coefficient_n_s_per_m"] * state.speed)


_COEFFICIENT = (Constant("coefficient_n_s_per_m", "N s/m", 0.0, -20.0, 100.0, 0.5),)

LAWS = (
    Law(
        id="viscous_drag",
        slot="drag",
        covariate="speed_mm_s",
        form="F_x + c v",
        parameters=_COEFFICIENT,
        amplitudes=("coefficient_n_s_per_m",),
        apply=_always,
    ),
    Law(
        id="viscous_drag~climbing",
        slot="drag",
        covariate="speed_mm_s",
        form="F_px + c v, while the tip climbs",
        parameters=_COEFFICIENT,
        amplitudes=("coefficient_n_s_per_m",),
        apply=_climbing,
        rank=1,
    ),
)
