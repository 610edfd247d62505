"""The real release: the tip has a mass that must be moved and lifted over the rest of the step, against friction.

The fixed share C_v of equation (1) becomes what the motion leaves for the ring, and the peak exceeds its quasi-static
value by what the handle moves on meanwhile. A second law keeps to energies: C_v less the work of lifting and rubbing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.effects.release_motion import released
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _motion(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    weight = values["weight"]
    if weight == 0.0:
        return state
    load = np.maximum(state.load, 1e-3)
    # k m = (k / omega)^2: the ring itself tells the mass that moves
    momentum = state.stiffness / (2.0 * np.pi * state.frequency)
    excess, share = released(
        state.height / state.radius,
        state.friction,
        state.stiffness * state.radius / load,
        state.speed * momentum / load,
    )
    force = load * np.tan(state.angle())
    return state.changed(
        climb_load=state.climb_load + force * np.expm1(weight * excess) / np.tan(state.angle()),
        conversion=state.conversion * np.exp(weight * (share - np.log(0.2))),
    )


def _work(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    reach = np.sqrt(np.maximum(state.height * (2.0 * state.radius - state.height), 0.0))
    work = state.load * (state.height + state.friction * reach)
    return state.changed(lost_energy=state.lost_energy + values["share"] * work)


LAWS = (
    Law(
        id="real_release",
        slot="conversion",
        covariate="none",
        form="C_v and peak from (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a + atan mu), to the power w",
        parameters=(Constant("weight", "1", 0.0, 0.0, 1.5, 0.05),),
        amplitudes=("weight",),
        apply=_motion,
    ),
    Law(
        id="real_release~work",
        slot="conversion",
        covariate="none",
        form="E_v = C_v F_px^2 / 2k - s F_py (H + mu sqrt(H (2R - H)))",
        parameters=(Constant("share", "1", 0.0, -1.0, 3.0, 0.02),),
        amplitudes=("share",),
        apply=_work,
        rank=1,
    ),
)
