"""What the tool adds: a spring that hardens, a viscous drag, and what its tangential gauge does to a force."""

from __future__ import annotations

import numpy as np

from stepblocks.contact.effects.law import Law, Parameter

_COEFFICIENT = (Parameter("coefficient_n_s_per_m", "N s/m", 0.0, -20.0, 100.0, 0.5),)

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
