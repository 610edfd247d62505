"""Elastic indentation: tip and edge give way by a Hertzian depth, and the step stands lower by it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _apply(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(height=state.height - values["depth_at_1n_m"] * state.load ** (2.0 / 3.0))


LAW = Law(
    id="elastic_indentation",
    slot="contact_geometry",
    covariate="load_n",
    form="H -> H - d (F_py / 1 N)^(2/3)",
    parameters=(Constant("depth_at_1n_m", "m", 0.0, -5e-6, 5e-5, 1e-6),),
    amplitudes=("depth_at_1n_m",),
    apply=_apply,
)
