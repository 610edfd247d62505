"""Effects of the release: which share of the stored energy rings."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from stepblocks.contact.operating_point import PAPER
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.state import DragState, Floats

_conversion = partial(Law, slot="conversion")

# at which the share is that of the nominal model
_SPEED = 6e-3  # [m/s]
ROOM_TEMPERATURE = 22.0  # [C]
_LEAST_LOAD = 1e-3  # where a fit strays [N]


def _scale_conversion_by_speed(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let the share of stored energy that becomes vibration follow a power of the speed."""
    ratio = state.speed / _SPEED
    factor = ratio ** law_values["exponent"]
    return state.scaled(conversion=factor)


def _scale_conversion_by_temperature(
    state: DragState, celsius: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let the share of stored energy that becomes vibration follow the temperature [C]."""
    warmth = celsius - ROOM_TEMPERATURE
    factor = np.exp(law_values["rate_per_k"] * warmth)
    return state.scaled(conversion=factor)


def _apply_tip_inertia(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Let the tip have a mass that is moved and lifted while the handle goes on."""
    weight = law_values["weight"]
    if weight == 0.0:
        return state
    # compiled kernels, loaded where they are used
    from stepblocks.rig.effects.release_motion import compute_log_excess_and_ring_share

    load = np.maximum(state.load, _LEAST_LOAD)
    # k m = (k / omega)^2: the ring itself tells the mass that moves
    omega = 2.0 * np.pi * state.frequency
    momentum = state.stiffness / omega
    step = state.height / state.radius
    stiffness = state.stiffness * state.radius / load
    speed = state.speed * momentum / load
    damping_ratio = state.damping / (omega * state.decay_time)
    cubic = np.maximum(state.hardening, 0.0) * load**2
    excess, share = compute_log_excess_and_ring_share(
        step, state.friction, stiffness, speed, damping_ratio, cubic
    )
    added = load * np.expm1(weight * excess)
    change = share - np.log(PAPER.tool.conversion)
    factor = np.exp(weight * change)
    return state.shifted(climb_load=added).scaled(conversion=factor)


def _lose_energy_to_tip_work(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Take a share of the work of lifting the tip and rubbing over the step from the ring."""
    to_diameter = 2.0 * state.radius - state.height
    square = state.height * to_diameter
    reach = np.sqrt(np.maximum(square, 0.0))
    rubbing = state.friction * reach
    work = state.load * (state.height + rubbing)
    lost = law_values["share"] * work
    return state.shifted(lost_energy=lost)


CONVERSION_LAWS: tuple[Law, ...] = (
    _conversion(
        "speed_dependent_conversion",
        "C_v (v / 6 mm/s)^q",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        _scale_conversion_by_speed,
        covariate="speed_mm_s",
        description="the share that rings follows the speed: exponent",
    ),
    _conversion(
        "temperature_dependent_conversion",
        "C_v exp(g (T - 22 C))",
        (Parameter("rate_per_k", "1/K", 0.0, -1.0, 1.0, 0.01),),
        _scale_conversion_by_temperature,
        covariate="temperature_c",
        description="the share that rings follows the temperature, per K by",
    ),
    _conversion(
        "real_release",
        "C_v and peak from (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a + atan mu), to the "
        "power w",
        (Parameter("weight", "1", 0.0, 0.0, 1.5, 0.05),),
        _apply_tip_inertia,
        description="the tip must be moved and lifted over the step: weight of that motion",
    ),
    _conversion(
        "real_release~work",  # the same by energies alone
        "E_v = C_v F_px^2 / 2k - s F_py (H + mu sqrt(H (2R - H)))",
        (Parameter("share", "1", 0.0, -1.0, 3.0, 0.02),),
        _lose_energy_to_tip_work,
        rank=1,
        description="the tip must be moved and lifted over the step: weight of that motion",
    ),
)
