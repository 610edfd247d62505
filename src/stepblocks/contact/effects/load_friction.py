"""Friction that falls with the load, as of an elastic contact: ``mu ~ F_py^-p``, p = 1/3 after Hertz."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(friction=state.friction * (state.load / 0.6) ** -values["exponent"])


LAW = Law(
    id="load_dependent_friction",
    slot="friction",
    covariate="load_n",
    form="mu (F_py / 0.6 N)^-p",
    parameters=(Constant("exponent", "1", 0.0, -3.0, 3.0, 0.05),),
    amplitudes=("exponent",),
    apply=_apply,
)
