"""Normal load other than set: a constant bias of the weights, or friction in the pivot that resists the lifting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState

_BIAS = (Constant("load_bias_n", "N", 0.0, -0.25, 0.6, 0.01),)


def _bias(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(load=state.load + values["load_bias_n"])


def _seen_bias(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    bias = values["load_bias_n"]
    return state.changed(load=state.load + bias, sensed_offset=state.sensed_offset + bias)


def _climb_bias(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(climb_load=state.climb_load + values["pivot_force_n"])


def _climb_share(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(climb_load=state.climb_load + values["pivot_share"] * state.set_load)


LAWS = (
    Law(
        id="load_bias",
        slot="normal_load",
        covariate="none",
        form="F_py -> F_py + b, as the gauge sees it",
        parameters=_BIAS,
        amplitudes=("load_bias_n",),
        apply=_seen_bias,
    ),
    Law(
        id="load_bias~unseen",
        slot="normal_load",
        covariate="none",
        form="F_py -> F_py + b at the contact, unseen by the gauge",
        parameters=_BIAS,
        amplitudes=("load_bias_n",),
        apply=_bias,
        rank=1,
    ),
    Law(
        id="pivot_friction",
        slot="normal_load",
        covariate="none",
        form="F_py (1 + p) while the tip climbs",
        parameters=(Constant("pivot_share", "1", 0.0, -0.6, 2.0, 0.02),),
        amplitudes=("pivot_share",),
        apply=_climb_share,
        rank=2,
    ),
    Law(
        id="pivot_friction~constant",
        slot="normal_load",
        covariate="none",
        form="F_py + f while the tip climbs",
        parameters=(Constant("pivot_force_n", "N", 0.0, -0.25, 0.6, 0.01),),
        amplitudes=("pivot_force_n",),
        apply=_climb_bias,
        rank=3,
    ),
)
