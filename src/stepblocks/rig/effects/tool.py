"""Effects of the tool and of what loads it: its spring, the weights, and drag beside friction."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.effects.conversion import ROOM_TEMPERATURE
from stepblocks.rig.state import DragState, Floats

_stiffness = partial(Law, slot="stiffness")
_load = partial(Law, slot="normal_load")
_softening = partial(
    _stiffness,
    covariate="temperature_c",
    how_to_decide="load the tool with a known weight, cold and warm",
)
_bias = partial(
    _load,
    description="the load differs from the weights by",
    how_to_decide="weigh the arm without weights",
)
_pivot = partial(
    _load,
    description="a pivot rubs while the tip is lifted: share of the load",
    how_to_decide="lift the arm slowly by a scale",
)
_drag = partial(
    Law,
    slot="drag",
    covariate="speed_mm_s",
    description="a viscous drag acts: coefficient",
    how_to_decide="drag without touching a block",
)

_SOFTENING = Parameter("softening_per_k", "1/K", 0.0, -0.05, 0.05, 1e-3)
_BIAS = (Parameter("load_bias_n", "N", 0.0, -0.25, 0.6, 0.01),)
_COEFFICIENT = (Parameter("coefficient_n_s_per_m", "N s/m", 0.0, 0.0, 100.0, 0.5),)
_LEAST_STIFFNESS = 0.1  # of the nominal, where a fit strays [1]


def _harden_spring(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Let the spring harden, after Duffing."""
    return state.shifted(
        hardening=law_values["cubic_per_n2"], pitch_share=law_values["pitch_share"]
    )


def _compute_softening_factor(celsius: Floats, law_values: Mapping[str, float]) -> Floats:
    """Stiffness of a warm spring over that at room temperature [1]."""
    warmth = celsius - ROOM_TEMPERATURE
    share = 1.0 - law_values["softening_per_k"] * warmth
    return np.asarray(np.maximum(share, _LEAST_STIFFNESS))


def _soften_spring_and_pitch(
    state: DragState, celsius: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let the spring soften as it warms, and its rate of decay with a power of its stiffness."""
    factor = _compute_softening_factor(celsius, law_values)
    damping_factor = factor ** law_values["damping_power"]
    return state.scaled(stiffness=factor, ring_stiffness=factor, damping=damping_factor)


def _soften_spring_without_pitch(
    state: DragState, celsius: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let the spring soften as it warms, though its pitch does not."""
    factor = _compute_softening_factor(celsius, law_values)
    return state.scaled(stiffness=factor, conversion=factor)


def _add_load_seen_by_gauge(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Add a load that the normal gauge sees."""
    bias = law_values["load_bias_n"]
    return state.shifted(load=bias, sensed_offset=bias)


def _add_unseen_load(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Add a load that no gauge sees."""
    return state.shifted(load=law_values["load_bias_n"])


def _add_proportional_pivot_friction(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let a pivot rub by a share of the load while the tip is lifted."""
    rubbed = law_values["pivot_share"] * state.set_load
    return state.shifted(climb_load=rubbed)


def _add_constant_pivot_friction(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let a pivot rub by a constant force while the tip is lifted."""
    return state.shifted(climb_load=law_values["pivot_force_n"])


def _add_viscous_drag(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Let a viscous drag act at any time."""
    viscous = law_values["coefficient_n_s_per_m"] * state.speed
    return state.shifted(drag=viscous)


def _add_viscous_climb_drag(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let a viscous drag act while the tip climbs."""
    viscous = law_values["coefficient_n_s_per_m"] * state.speed
    return state.shifted(climb_drag=viscous)


TOOL_LAWS: tuple[Law, ...] = (
    _stiffness(
        "hardening_spring",
        "F = u + g u^3, u = k x: energy (u^2/2 + g u^4/4) / k, ramp k (1 + 3 g u^2), pitch with "
        "3/4 g A^2 at amplitude A",
        (
            Parameter("cubic_per_n2", "1/N^2", 0.0, 0.0, 5.0, 0.02),
            # a ring that rubs has died away where its pitch is fitted best: what it shows of A^2 is
            # found with it
            Parameter("pitch_share", "1", 0.2, -0.5, 1.0, 0.1),
        ),
        _harden_spring,
        covariate="peak_force_n",
        given=False,
        shapes=({"pitch_share": 0.0}, {"pitch_share": 0.4}),
        description="the spring hardens: g {}, its pitch shows {} of the first swing",
    ),
    _softening(
        "softening_spring",
        "k (1 - s (T - 22 C)), rate of decay with the power q of k",
        (
            _SOFTENING,
            # a damper of oil keeps its coefficient (0), one of rubber its ratio (1/2)
            Parameter("damping_power", "1", 0.25, -1.0, 1.5, 0.1, 0.5),
        ),
        _soften_spring_and_pitch,
        shapes=({"damping_power": 0.0}, {"damping_power": 0.5}),
        description="the spring softens as it warms: by {}, its damping with the power {} of k",
    ),
    _softening(
        "softening_spring~pitch_unchanged",
        "k (1 - s (T - 22 C)) of the ramp alone",
        (_SOFTENING,),
        _soften_spring_without_pitch,
        rank=1,
        description="the spring softens as it warms, though its pitch does not: per K by",
    ),
    _bias("load_bias", "F_py -> F_py + b, as the gauge sees it", _BIAS, _add_load_seen_by_gauge),
    _bias(
        "load_bias~unseen",
        "F_py -> F_py + b at the contact, unseen by the gauge",
        _BIAS,
        _add_unseen_load,
        rank=1,
    ),
    _pivot(
        "pivot_friction",
        "F_py (1 + p) while the tip climbs",
        # what rubs presses on a tip that is lifted, and never carries it
        (Parameter("pivot_share", "1", 0.0, 0.0, 2.0, 0.02),),
        _add_proportional_pivot_friction,
        rank=2,
    ),
    _pivot(
        "pivot_friction~constant",
        "F_py + f while the tip climbs",
        (Parameter("pivot_force_n", "N", 0.0, 0.0, 0.6, 0.01),),
        _add_constant_pivot_friction,
        rank=3,
        description="a pivot rubs while the tip is lifted: force",
    ),
    _drag("viscous_drag", "F_x + c v", _COEFFICIENT, _add_viscous_drag),
    _drag(
        "viscous_drag~climbing",
        "F_px + c v, while the tip climbs",
        _COEFFICIENT,
        _add_viscous_climb_drag,
        rank=1,
    ),
)
