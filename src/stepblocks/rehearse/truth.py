"""What is true of one trial of a plan: its slots, and its figures by equations (1) and (2)."""

import math
from collections.abc import Mapping

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tool
from stepblocks.errors import PipelineError
from stepblocks.rehearse.effects import NUMBERS, PlantedEffect
from stepblocks.rehearse.kit_loads import draw_trial_load_error
from stepblocks.rehearse.plan import SessionPlan
from stepblocks.rehearse.record import Rig, Truth
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import (
    BenchDesign,
    build_nominal_state,
    compute_followed_covariate,
    make_height_error_name,
)
from stepblocks.rig.state import DragState, compute_shown_channels

_LEAST_RISE = 0.02  # [N] a lower peak is no catch
_NOT_IN_TIME = ("tilt", "climb_load", "lost_energy", "climb_drag")
# slots of the state, where they are not named like those of an effect
_SLOTS = {
    "contact_geometry": ("radius",),
    "normal_load": ("load",),
    "stiffness": ("stiffness", "ring_stiffness"),
    "sensor": ("gain",),
}


def compute_planted_state(
    plan: SessionPlan,
    row: Mapping[str, str],
    heights: Mapping[float, float],
    generator: np.random.Generator,
) -> DragState | None:
    """Compute the slots of one trial with its effects and its scatter.

    Parameters
    ----------
    plan : SessionPlan
    row : mapping of str to str
        Conditions of the trial, as the table writes them.
    heights : mapping of float to float
        True height by the nominal one [m].
    generator : Generator
        Of the scatter.

    Returns
    -------
    DragState or None
        None where the probe locks.
    """
    nominal = _find_planned_height(row, heights)
    design = _build_trial_design(plan, row, nominal)
    values = _map_nominal_values(plan)
    if plan.apparatus is not None:
        load = float(design.load[0])
        values["load_error"] = draw_trial_load_error(plan.apparatus, load, plan.seed, generator)
    bare = build_nominal_state(design, values)
    if bool(bare.mark_locked_trials()[0]):
        return None
    covariates: dict[str, float | str] = {
        **row,
        "peak_force_n": float(bare.compute_peak_force()[0]),
    }
    values[make_height_error_name(row["block"])] = heights[nominal] - nominal
    state = build_nominal_state(design, values)
    for effect in plan.effects:
        if effect.law:
            state = _apply_catalogue_law(plan, effect, design, state)
        else:
            state = _apply_covariate_form(effect, covariates, state)
    state = _add_scatter(plan, state, generator)
    if bool(state.mark_locked_trials()[0]) or not _are_quantities_positive(state):
        return None
    return state


def _find_planned_height(row: Mapping[str, str], heights: Mapping[float, float]) -> float:
    """Return the height of the plan that a row has rounded [m]."""
    height = float(row["height_um"])
    return min(heights, key=lambda nominal: abs(nominal * 1e6 - height))


def _build_trial_design(plan: SessionPlan, row: Mapping[str, str], height: float) -> BenchDesign:
    """Return the conditions of one trial in SI."""
    numbers = {}
    for name in NUMBERS:
        if name in row:
            numbers[name] = np.array([float(row[name])])
    speed = numbers["speed_mm_s"] / 1e3
    return BenchDesign(
        np.array([row["block"]]),
        np.array([height]),
        numbers["load_n"],
        speed,
        np.array([plan.model.tip_radius]),
        plan.model.spring_constant,
        numbers,
    )


def _map_nominal_values(plan: SessionPlan) -> dict[str, float]:
    """Return the parameters of the nominal model of a plan."""
    return {
        "friction": plan.model.friction,
        "ln_conversion": math.log(plan.model.conversion),
        "stiffness_ratio": 1.0,
        "ln_ring_frequency": math.log(plan.model.ring_frequency),
        "ln_decay_time": math.log(plan.model.decay_time),
    }


def _apply_catalogue_law(
    plan: SessionPlan, effect: PlantedEffect, design: BenchDesign, state: DragState
) -> DragState:
    """Return the state after an effect that is a law of the catalogue."""
    laws = {law.id: law for law in list_named_laws(plan.list_blocks())}
    law = laws[effect.law]
    values = {parameter.name: parameter.start for parameter in law.parameters}
    values |= effect.parameters
    covariate = compute_followed_covariate(design, state, law.covariate)
    planted: DragState = law.apply(state, covariate, values)
    return planted


def _apply_covariate_form(
    effect: PlantedEffect, covariates: Mapping[str, float | str], state: DragState
) -> DragState:
    """Return the state after an effect that is a form of one covariate."""
    slot = str(effect.slot)
    changed: dict[str, Array] = {}
    for name in _SLOTS.get(slot, (slot,)):
        value = float(getattr(state, name)[0])
        changed[name] = np.array([effect.compute_changed_value(value, covariates)])
    if effect.slot == "normal_load":
        # a load that is not the one set is weighed by the gauge all the same
        changed["sensed_offset"] = state.sensed_offset + changed["load"] - state.load
    return state.changed(**changed)


def _add_scatter(plan: SessionPlan, state: DragState, generator: np.random.Generator) -> DragState:
    """Return the state with what differs from trial to trial."""
    friction = plan.scatter.friction * generator.standard_normal()
    load = plan.scatter.load * generator.standard_normal()
    ln_energy = plan.scatter.energy * generator.standard_normal()
    sensed = state.set_load + state.sensed_offset
    return state.changed(
        friction=state.friction + friction,
        load=state.load * (1.0 + load),
        sensed_offset=state.sensed_offset + load * sensed,
        conversion=state.conversion * math.exp(ln_energy),
    )


def _are_quantities_positive(state: DragState) -> bool:
    """Tell whether all quantities that must be positive are so."""
    positive = np.stack(
        [state.load, state.friction, state.stiffness, state.conversion, state.height]
    )
    return bool(np.all(positive > 0.0))


def build_rig(plan: SessionPlan, state: DragState) -> Rig:
    """Return the rig of a plan; a gauge that lags has a bandwidth."""
    declared = plan.rig
    bandwidth = declared.bandwidth or math.inf
    lag = float(state.lag[0])
    if lag > 0.0:
        bandwidth = min(bandwidth, 1.0 / (2.0 * math.pi * lag))
    return Rig(
        sample_rate=declared.sample_rate,
        noise=declared.noise,
        quantum=declared.quantum,
        hum=declared.hum,
        mains=declared.mains,
        drift=declared.drift_n_per_s,
        start_up=declared.start_up,
        bandwidth=bandwidth,
    )


def compute_truth_by_equations(plan: SessionPlan, state: DragState) -> Truth | None:
    """Compute the figures of a trial by equations (1) and (2), before gauge and rig.

    The result is None where nothing catches or rings.
    """
    ideal_gauge = state.changed(gain=np.ones(1), lag=np.zeros(1))
    channels, *_ = compute_shown_channels(ideal_gauge)
    ln_energy, ln_peak, friction, stiffness_ratio, ln_frequency, ln_decay_time, *_ = channels
    load = float(state.set_load[0] + state.sensed_offset[0])
    energy = math.exp(ln_energy)
    peak = math.exp(ln_peak)
    sliding = float(friction) * load
    if peak - sliding < _LEAST_RISE or not energy > 0.0:
        return None
    spring = plan.model.spring_constant
    gap = 0.0
    if plan.model.ring == "rubbing":
        gap = 2.0 * float(state.friction[0]) * load
    return Truth(
        load=load,
        sliding_force=sliding,
        slope=float(stiffness_ratio) * spring * float(state.speed[0]),
        peak_force=peak,
        amplitude=math.sqrt(2.0 * spring * energy),
        frequency=math.exp(ln_frequency),
        decay_time=math.exp(ln_decay_time),
        sympathetic=plan.model.sympathetic,
        gap=gap,
    )


def build_drag_inputs(plan: SessionPlan, state: DragState) -> tuple[Step, OperatingPoint, float]:
    """Return step, operating point and steady pull of a trial, as the drag in time takes them.

    Returns
    -------
    step : Step
    point : OperatingPoint
    pull : float
        Steady force along the drag beside the force of the tip [N].

    Raises
    ------
    PipelineError
        If an effect changes a quantity that the drag in time does not model.
    """
    for name in _NOT_IN_TIME:
        if np.any(getattr(state, name) != 0.0):
            raise PipelineError(f"an effect changes {name}, which the drag in time does not model")
    radius = float(state.radius[0])
    ball_radius = min(plan.model.tip_radius, radius)
    # the frequency refers to the nominal spring
    stiffness_ratio = float(state.ring_stiffness[0]) / plan.model.spring_constant
    tool = Tool(
        stiffness=float(state.stiffness[0]),
        frequency=float(state.frequency[0]) * math.sqrt(stiffness_ratio),
        decay_time=float(state.decay_time[0]) / float(state.damping[0]),
        limits=Limits(),  # a bench pulls as far as it must
    )
    point = OperatingPoint(
        ball_radius,
        float(state.load[0]),
        float(state.friction[0]),
        tool,
        float(state.speed[0]),
    )
    step = Step(float(state.height[0]), radius - ball_radius)
    return step, point, float(state.drag[0])
