"""Effects of the two gauges and of their clock: what is shown, and not what is."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.state import DragState, Floats

_ZERO = Parameter("zero_n", "N", 0.0, -0.2, 0.2, 5e-3)
_NORMAL_ZERO = Parameter("normal_zero_n", "N", 0.0, -0.2, 0.2, 5e-3)
_NORMAL_GAIN = Parameter("normal_ln_gain", "1", 0.0, -0.5, 0.5, 0.01)
_CROSS_TALK = Parameter("cross_talk", "1", 0.0, -0.2, 0.2, 5e-3)
_GAIN = Parameter("ln_gain", "1", 0.0, -1.5, 1.5, 0.02)
# before the edge it shows as a gain of the normal gauge: the usual size of either cross-talk alone
# tells them apart
_NORMAL_CROSS_TALK = Parameter("normal_cross_talk", "1", 0.0, -0.3, 0.3, 5e-3, 0.03)
# a quartz errs by 1e-4, an oscillator without one by a per cent: what is more is no clock
_CLOCK = Parameter("ln_clock", "1", 0.0, -0.5, 0.5, 1e-3, 0.01)
_LAG = Parameter("time_constant_s", "s", 0.0, 0.0, 5e-3, 1e-4)


# Slots of the state that a constant shifts, and those that it multiplies by its exponential
_SHIFTED = {
    "zero": "zero_n",
    "cross_talk": "cross_talk",
    "normal_zero": "normal_zero_n",
    "normal_cross_talk": "normal_cross_talk",
    "gauge_square": "square_per_n",
    "gauge_hysteresis": "rayleigh_per_n",
    "normal_square": "normal_square_per_n",
    "lag": "time_constant_s",
    "ln_clock": "ln_clock",
}
_SCALED = {"normal_gain": "normal_ln_gain", "gain": "ln_gain"}


def apply_instrument_constants(
    state: DragState, _: object, values: Mapping[str, float | Floats]
) -> DragState:
    """Set whichever constants of the two gauges and of their clock are given."""
    amounts = {}
    for slot, name in _SHIFTED.items():
        amounts[slot] = values.get(name, 0.0)
    factors = {}
    for slot, name in _SCALED.items():
        logarithm = values.get(name, 0.0)
        factors[slot] = np.exp(logarithm)
    return state.shifted(**amounts).scaled(**factors)


_gauge = partial(Law, slot="sensor", apply=apply_instrument_constants)
_zero = partial(
    _gauge, how_to_decide="tare: record both gauges unloaded before and after the drags"
)

GAUGE_LAWS = (
    _gauge(
        "sensor_gain",
        "F_x -> G F_x",
        (_GAIN,),
        description="the tangential gauge has another gain than stated: logarithm",
        how_to_decide="hang a known weight on the tangential gauge",
    ),
    _zero(
        "tangential_zero",
        "F_x shown + z; a tare enters no stored energy",
        (_ZERO,),
        description="the tangential gauge reads without force",
    ),
    _zero(
        "normal_zero",
        "F_y shown + z",
        (_NORMAL_ZERO,),
        description="the normal gauge reads without force",
    ),
    _gauge(
        "normal_gain",
        "F_y shown times G",
        (_NORMAL_GAIN,),
        description="the normal gauge has another gain than stated: logarithm",
        how_to_decide="put a known weight on the normal gauge",
    ),
    _gauge(
        "cross_talk",
        "F_x shown + c F_y; it enters no stored energy",
        (_CROSS_TALK,),
        description="the tangential gauge also shows of the normal force",
        how_to_decide="drag in the other direction: friction changes its sign, cross-talk does not",
    ),
    _gauge(
        "gauge_not_linear",
        "F_x shown F_x (1 + q F_x)",
        (Parameter("square_per_n", "1/N", 0.0, -0.2, 0.2, 5e-3),),
        description="the tangential gauge is not linear: it shows F (1 + q F) with q of",
        how_to_decide="hang five known weights on the tangential gauge",
    ),
    _gauge(
        "gauge_hysteresis",
        "F_x shown F_x + b F_x^2 at first, loops of amplitude A after Rayleigh: A (1 + b A)",
        (Parameter("rayleigh_per_n", "1/N", 0.0, -0.2, 0.2, 5e-3),),
        rank=1,
        description="the tangential gauge has hysteresis: it shows F + b F^2 on its way up, with b "
        "of",
        how_to_decide="hang weights on the tangential gauge and take them off again",
    ),
    _gauge(
        # of a force that only rises before it is read, a quadratic gauge and one with hysteresis
        # show the same
        "normal_not_linear",
        "F_y shown F_y (1 + q F_y)",
        (Parameter("normal_square_per_n", "1/N", 0.0, -0.2, 0.2, 5e-3),),
        rank=1,
        description="the normal gauge is not linear: it shows F (1 + q F) with q of",
        how_to_decide="put five known weights on the normal gauge",
    ),
    _gauge(
        "normal_cross_talk",
        "F_y shown + c F_x",
        (_NORMAL_CROSS_TALK,),
        rank=1,
        description="the normal gauge also shows of the tangential force",
        how_to_decide="pull the tip along without a load on it",
    ),
    _gauge(
        "clock",
        "time shown times c: ring slower, decay longer, ramp softer",
        (_CLOCK,),
        rank=8,
        description="the clock of the record runs at another rate: logarithm",
        how_to_decide="record a signal of known frequency",
    ),
    _gauge(
        # several constants of one instrument off together: the rival of whatever looks like
        # geometry
        "instrument",
        "F_x shown G F_x + z + c F_y, F_y shown G' F_y + z'",
        (_ZERO, _NORMAL_ZERO, _NORMAL_GAIN, _CROSS_TALK, _GAIN),
        rank=9,
        description="several constants of the gauges are off: zeros {} and {} (normal), logarithm "
        "of the normal gain {}, cross-talk {}, logarithm of the tangential gain {}",
        how_to_decide="tare both gauges, hang known weights on each, drag in both directions",
    ),
    _gauge(
        "sensor_bandwidth",
        "gauge of first order: peak short by k v tau (1 - exp(-t_ramp / tau))",
        (_LAG,),
        covariate="speed_mm_s",
        description="the gauge is slow: time constant",
        how_to_decide="tap the tool: the ring of a free tool shows the bandwidth",
    ),
)
