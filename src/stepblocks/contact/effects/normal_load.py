"""Normal load other than set: a constant bias of the weights, or friction in the pivot that resists the lifting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law, Parameter
from stepblocks.contact.state import DragState

SLOT = "normal_load"
_BIAS = (Parameter("load_bias_n", "N", 0.0, -0.25, 0.6, 0.01),)


def _seen_bias(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    bias = values["load_bias_n"]
    return state.changed(load=state.load + bias, sensed_offset=state.sensed_offset + bias)


LAWS = (
    Law("load_bias", SLOT, "none", "F_py -> F_py + b, as the gauge sees it", _BIAS, _seen_bias),
    Law(
        "load_bias~unseen",
        SLOT,
        "none",
        "F_py -> F_py + b at the contact, unseen by the gauge",
        _BIAS,
        lambda state, _, v: state.changed(load=state.load + v["load_bias_n"]),
        rank=1,
    ),
    Law(
        "pivot_friction",
        SLOT,
        "none",
        "F_py (1 + p) while the tip climbs",
        (Parameter("pivot_share", "1", 0.0, -0.6, 2.0, 0.02),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_share"] * state.set_load),
        rank=2,
    ),
    Law(
        "pivot_friction~constant",
        SLOT,
        "none",
        "F_py + f while the tip climbs",
        (Parameter("pivot_force_n", "N", 0.0, -0.25, 0.6, 0.01),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_force_n"]),
        rank=3,
    ),
)
