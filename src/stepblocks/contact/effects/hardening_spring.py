"""Spring that stiffens: ``F = k x + k3 x^3``; a given force stores less energy and the ramp steepens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(hardening=state.hardening + values["cubic_per_n2"])


LAW = Law(
    id="hardening_spring",
    slot="stiffness",
    covariate="peak_force_n",
    form="F = u + g u^3, u = k x, stored energy (u^2/2 + g u^4/4) / k",
    parameters=(Constant("cubic_per_n2", "1/N^2", 0.0, 0.0, 5.0, 0.02),),
    amplitudes=("cubic_per_n2",),
    apply=_apply,
)
