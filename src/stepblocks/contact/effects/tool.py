"""What the tool adds: load other than set, a spring that hardens, a viscous drag, and what its tangential gauge shows."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from stepblocks.contact.state import DragState
from stepblocks.law import Law, Parameter

_stiffness, _load, _sensor = (partial(Law, slot=slot) for slot in ("stiffness", "normal_load", "sensor"))
_bias = partial(_load, said="the load differs from the weights by", settled="weigh the arm without weights")
_pivot = partial(
    _load,
    said="a pivot rubs while the tip is lifted: share of the load, or force,",
    settled="lift the arm slowly by a scale",
)
_drag = partial(
    Law,
    slot="drag",
    covariate="speed_mm_s",
    said="a viscous drag acts: coefficient",
    settled="drag without touching a block",
)

_BIAS = (Parameter("load_bias_n", "N", 0.0, -0.25, 0.6, 0.01),)
_COEFFICIENT = (Parameter("coefficient_n_s_per_m", "N s/m", 0.0, -20.0, 100.0, 0.5),)


def _seen_bias(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    bias = values["load_bias_n"]
    return state.changed(load=state.load + bias, sensed_offset=state.sensed_offset + bias)


LAWS = (
    _stiffness(
        "hardening_spring",  # after Duffing
        "F = u + g u^3, u = k x: energy (u^2/2 + g u^4/4) / k, ramp k (1 + 3 g u^2), pitch with 3/4 g A^2 at amplitude A",
        (
            Parameter("cubic_per_n2", "1/N^2", 0.0, 0.0, 5.0, 0.02),
            # a ring that rubs has died away where its pitch is fitted best: what it shows of A^2 is found with it
            Parameter("pitch_share", "1", 0.2, -0.5, 1.0, 0.1),
        ),
        lambda state, _, v: state.changed(
            hardening=state.hardening + v["cubic_per_n2"], pitch_share=state.pitch_share + v["pitch_share"]
        ),
        covariate="peak_force_n",
        shapes=({"pitch_share": 0.0}, {"pitch_share": 0.4}),
        said="the spring hardens: g and the share of the first swing that its pitch shows",
    ),
    _bias("load_bias", "F_py -> F_py + b, as the gauge sees it", _BIAS, _seen_bias),
    _bias(
        "load_bias~unseen",
        "F_py -> F_py + b at the contact, unseen by the gauge",
        _BIAS,
        lambda state, _, v: state.changed(load=state.load + v["load_bias_n"]),
        rank=1,
    ),
    _pivot(
        "pivot_friction",
        "F_py (1 + p) while the tip climbs",
        (Parameter("pivot_share", "1", 0.0, -0.6, 2.0, 0.02),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_share"] * state.set_load),
        rank=2,
    ),
    _pivot(
        "pivot_friction~constant",
        "F_py + f while the tip climbs",
        (Parameter("pivot_force_n", "N", 0.0, -0.25, 0.6, 0.01),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_force_n"]),
        rank=3,
    ),
    _drag(
        "viscous_drag",
        "F_x + c v",
        _COEFFICIENT,
        lambda state, _, v: state.changed(drag=state.drag + v["coefficient_n_s_per_m"] * state.speed),
    ),
    _drag(
        "viscous_drag~climbing",
        "F_px + c v, while the tip climbs",
        _COEFFICIENT,
        lambda state, _, v: state.changed(climb_drag=state.climb_drag + v["coefficient_n_s_per_m"] * state.speed),
        rank=1,
    ),
)

_ZERO = Parameter("zero_n", "N", 0.0, -0.2, 0.2, 5e-3)
_NORMAL_ZERO = Parameter("normal_zero_n", "N", 0.0, -0.2, 0.2, 5e-3)
_NORMAL_GAIN = Parameter("normal_ln_gain", "1", 0.0, -0.5, 0.5, 0.01)
_CROSS_TALK = Parameter("cross_talk", "1", 0.0, -0.2, 0.2, 5e-3)
_GAIN = Parameter("ln_gain", "1", 0.0, -1.5, 1.5, 0.02)
# before the edge it shows as a gain of the normal gauge: the usual size of either cross-talk alone tells them apart
_NORMAL_CROSS_TALK = Parameter("normal_cross_talk", "1", 0.0, -0.3, 0.3, 5e-3, 0.03)
_CLOCK = Parameter("ln_clock", "1", 0.0, -0.5, 0.5, 1e-3)
_LAG = Parameter("time_constant_s", "s", 0.0, 0.0, 5e-3, 1e-4)


def set_instrument(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    """Set whichever constants of the two gauges and of their clock are given."""
    given = values.get
    return state.changed(
        zero=state.zero + given("zero_n", 0.0),
        cross_talk=state.cross_talk + given("cross_talk", 0.0),
        normal_zero=state.normal_zero + given("normal_zero_n", 0.0),
        normal_gain=state.normal_gain * np.exp(given("normal_ln_gain", 0.0)),
        normal_cross_talk=state.normal_cross_talk + given("normal_cross_talk", 0.0),
        gain=state.gain * np.exp(given("ln_gain", 0.0)),
        lag=state.lag + given("time_constant_s", 0.0),
        ln_clock=state.ln_clock + given("ln_clock", 0.0),
    )


_gauge = partial(_sensor, apply=set_instrument)
_zero = partial(_gauge, settled="tare: record both gauges unloaded before and after the drags")

SENSOR = (
    _gauge(
        "sensor_gain",
        "F_x -> G F_x",
        (_GAIN,),
        said="the tangential gauge reads by ln G of",
        settled="hang a known weight on the tangential gauge",
    ),
    _zero(
        "tangential_zero",
        "F_x shown + z; a tare enters no stored energy",
        (_ZERO,),
        said="the tangential gauge reads without force",
    ),
    _zero("normal_zero", "F_y shown + z", (_NORMAL_ZERO,), said="the normal gauge reads without force"),
    _gauge(
        "normal_gain",
        "F_y shown times G",
        (_NORMAL_GAIN,),
        said="the normal gauge reads by ln G of",
        settled="put a known weight on the normal gauge",
    ),
    _gauge(
        "cross_talk",
        "F_x shown + c F_y; it enters no stored energy",
        (_CROSS_TALK,),
        said="the tangential gauge also shows of the normal force",
        settled="drag in the other direction: friction changes its sign, cross-talk does not",
    ),
    _gauge(
        "normal_cross_talk",
        "F_y shown + c F_x",
        (_NORMAL_CROSS_TALK,),
        rank=1,
        said="the normal gauge also shows of the tangential force",
        settled="pull the tip along without a load on it",
    ),
    _gauge(
        "clock",
        "time shown times c: ring slower, decay longer, ramp softer",
        (_CLOCK,),
        rank=8,
        said="the clock of the record runs by ln c of",
        settled="record a signal of known frequency",
    ),
    _gauge(
        "instrument",  # several constants of one instrument off together: the rival of whatever looks like geometry
        "F_x shown G F_x + z + c F_y, F_y shown G' F_y + z'",
        (_ZERO, _NORMAL_ZERO, _NORMAL_GAIN, _CROSS_TALK, _GAIN),
        rank=9,
        said="several constants of the gauges are off: zeros, gain, cross-talk, gain",
        settled="tare both gauges, hang known weights on each, drag in both directions",
    ),
    _gauge(
        "sensor_bandwidth",
        "gauge of first order: peak short by k v tau (1 - exp(-t_ramp / tau))",
        (_LAG,),
        covariate="speed_mm_s",
        said="the gauge is slow: time constant",
        settled="tap the tool: the ring of a free tool shows the bandwidth",
    ),
)
