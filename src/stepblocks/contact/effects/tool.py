"""What the tool adds: load other than set, a spring that hardens, a viscous drag, and what its tangential gauge shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law, Parameter
from stepblocks.contact.state import DragState

_BIAS = (Parameter("load_bias_n", "N", 0.0, -0.25, 0.6, 0.01),)
_COEFFICIENT = (Parameter("coefficient_n_s_per_m", "N s/m", 0.0, -20.0, 100.0, 0.5),)


def _seen_bias(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    bias = values["load_bias_n"]
    return state.changed(load=state.load + bias, sensed_offset=state.sensed_offset + bias)


LOAD = (
    Law("load_bias", "normal_load", "none", "F_py -> F_py + b, as the gauge sees it", _BIAS, _seen_bias),
    Law(
        "load_bias~unseen",
        "normal_load",
        "none",
        "F_py -> F_py + b at the contact, unseen by the gauge",
        _BIAS,
        lambda state, _, v: state.changed(load=state.load + v["load_bias_n"]),
        rank=1,
    ),
    Law(
        "pivot_friction",
        "normal_load",
        "none",
        "F_py (1 + p) while the tip climbs",
        (Parameter("pivot_share", "1", 0.0, -0.6, 2.0, 0.02),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_share"] * state.set_load),
        rank=2,
    ),
    Law(
        "pivot_friction~constant",
        "normal_load",
        "none",
        "F_py + f while the tip climbs",
        (Parameter("pivot_force_n", "N", 0.0, -0.25, 0.6, 0.01),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_force_n"]),
        rank=3,
    ),
)

STIFFNESS = (
    Law(
        "hardening_spring",
        "stiffness",
        "peak_force_n",
        "F = u + g u^3, u = k x, stored energy (u^2/2 + g u^4/4) / k",
        (Parameter("cubic_per_n2", "1/N^2", 0.0, 0.0, 5.0, 0.02),),
        lambda state, _, v: state.changed(hardening=state.hardening + v["cubic_per_n2"]),
    ),
)

DRAG = (
    Law(
        "viscous_drag",
        "drag",
        "speed_mm_s",
        "F_x + c v",
        _COEFFICIENT,
        lambda state, _, v: state.changed(drag=state.drag + v["coefficient_n_s_per_m"] * state.speed),
    ),
    Law(
        "viscous_drag~climbing",
        "drag",
        "speed_mm_s",
        "F_px + c v, while the tip climbs",
        _COEFFICIENT,
        lambda state, _, v: state.changed(climb_drag=state.climb_drag + v["coefficient_n_s_per_m"] * state.speed),
        rank=1,
    ),
)

SENSOR = (
    Law(
        "sensor_gain",
        "sensor",
        "none",
        "F_x -> G F_x",
        (Parameter("ln_gain", "1", 0.0, -1.5, 1.5, 0.02),),
        lambda state, _, v: state.changed(gain=state.gain * np.exp(v["ln_gain"])),
    ),
    Law(
        "sensor_bandwidth",
        "sensor",
        "speed_mm_s",
        "gauge of first order: peak short by k v tau (1 - exp(-t_ramp / tau))",
        (Parameter("time_constant_s", "s", 0.0, 0.0, 5e-3, 1e-4),),
        lambda state, _, v: state.changed(lag=state.lag + v["time_constant_s"]),
    ),
)
