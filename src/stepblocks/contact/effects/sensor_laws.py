"""What the tangential gauge does to a force: a gain other than one, and a bandwidth that rounds the peak."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _gain(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(gain=state.gain * np.exp(values["ln_gain"]))


def _bandwidth(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    return state.changed(lag=state.lag + values["time_constant_s"])


LAWS = (
    Law(
        id="sensor_gain",
        slot="sensor",
        covariate="none",
        form="F_x -> G F_x",
        parameters=(Constant("ln_gain", "1", 0.0, -1.5, 1.5, 0.02),),
        amplitudes=("ln_gain",),
        apply=_gain,
    ),
    Law(
        id="sensor_bandwidth",
        slot="sensor",
        covariate="speed_mm_s",
        form="gauge of first order: peak short by k v tau (1 - exp(-t_ramp / tau))",
        parameters=(Constant("time_constant_s", "s", 0.0, 0.0, 5e-3, 1e-4),),
        amplitudes=("time_constant_s",),
        apply=_bandwidth,
    ),
)
