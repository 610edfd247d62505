"""Share of energy that rings: how it may follow the speed of the drag and the temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState, Floats


def _speed(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(conversion=state.conversion * (state.speed / 6e-3) ** values["exponent"])


def _temperature(state: DragState, celsius: Floats, values: Mapping[str, float]) -> DragState:
    return state.changed(conversion=state.conversion * np.exp(values["rate_per_k"] * (celsius - 22.0)))


LAWS = (
    Law(
        id="speed_dependent_conversion",
        slot="conversion",
        covariate="speed_mm_s",
        form="C_v (v / 6 mm/s)^q",
        parameters=(Constant("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        amplitudes=("exponent",),
        apply=_speed,
    ),
    Law(
        id="temperature_dependent_conversion",
        slot="conversion",
        covariate="temperature_c",
        form="C_v exp(g (T - 22 C))",
        parameters=(Constant("rate_per_k", "1/K", 0.0, -1.0, 1.0, 0.01),),
        amplitudes=("rate_per_k",),
        apply=_temperature,
    ),
)
