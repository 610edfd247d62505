"""Share of energy that rings: how it may follow speed and temperature, and what a real release leaves of it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from stepblocks.contact.operating_point import PAPER
from stepblocks.contact.state import DragState
from stepblocks.law import Law, Parameter

_conversion = partial(Law, slot="conversion")


def _motion(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    weight = values["weight"]
    if weight == 0.0:
        return state
    from stepblocks.contact.effects.release_motion import released  # compiled kernels, loaded where they are used

    load = np.maximum(state.load, 1e-3)
    # k m = (k / omega)^2: the ring itself tells the mass that moves
    momentum = state.stiffness / (2.0 * np.pi * state.frequency)
    stiffness, speed = state.stiffness * state.radius / load, state.speed * momentum / load
    excess, share = released(state.height / state.radius, state.friction, stiffness, speed)
    return state.changed(
        climb_load=state.climb_load + load * np.expm1(weight * excess),
        conversion=state.conversion * np.exp(weight * (share - np.log(PAPER.tool.conversion))),
    )


def _work(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    reach = np.sqrt(np.maximum(state.height * (2.0 * state.radius - state.height), 0.0))
    work = state.load * (state.height + state.friction * reach)
    return state.changed(lost_energy=state.lost_energy + values["share"] * work)


LAWS = (
    _conversion(
        "speed_dependent_conversion",
        "C_v (v / 6 mm/s)^q",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        lambda state, _, v: state.changed(conversion=state.conversion * (state.speed / 6e-3) ** v["exponent"]),
        covariate="speed_mm_s",
        said="the share that rings follows the speed: exponent",
    ),
    _conversion(
        "temperature_dependent_conversion",
        "C_v exp(g (T - 22 C))",
        (Parameter("rate_per_k", "1/K", 0.0, -1.0, 1.0, 0.01),),
        lambda state, celsius, v: state.changed(
            conversion=state.conversion * np.exp(v["rate_per_k"] * (celsius - 22.0))
        ),
        covariate="temperature_c",
        said="the share that rings follows the temperature, per K by",
    ),
    # the tip has a mass that must be moved and lifted over the rest of the step while the handle goes on; or, by energies alone,
    # C_v less the work of lifting and rubbing
    _conversion(
        "real_release",
        "C_v and peak from (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a + atan mu), to the power w",
        (Parameter("weight", "1", 0.0, 0.0, 1.5, 0.05),),
        _motion,
        said="the tip must be moved and lifted over the step: weight of that motion",
    ),
    _conversion(
        "real_release~work",
        "E_v = C_v F_px^2 / 2k - s F_py (H + mu sqrt(H (2R - H)))",
        (Parameter("share", "1", 0.0, -1.0, 3.0, 0.02),),
        _work,
        rank=1,
        said="the tip must be moved and lifted over the step: weight of that motion",
    ),
)
