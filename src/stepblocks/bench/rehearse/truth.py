"""What is true of each trial of a simulated session: the slots of the model, effects planted, and the trial's scatter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.bench.rehearse.plan import PlantedEffect, SessionPlan
from stepblocks.bench.rehearse.records import Rig, Truth
from stepblocks.contact.counterface import Step
from stepblocks.contact.effects import named_laws
from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import BenchDesign, height_name, nominal_state
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.state import DragState, observe
from stepblocks.errors import PipelineError

_LEAST_RISE = 0.02  # [N] a lower peak is no catch
_NOT_IN_TIME = ("tilt", "climb_load", "hardening", "lost_energy", "climb_drag")
_SLOTS = {
    "contact_geometry": ("radius",),
    "friction": ("friction",),
    "normal_load": ("load",),
    "stiffness": ("stiffness", "ring_stiffness"),
    "conversion": ("conversion",),
    "drag": ("drag",),
    "sensor": ("gain",),
}


def planted_state(
    plan: SessionPlan, row: Mapping[str, str], heights: Mapping[float, float], chance: np.random.Generator
) -> DragState | None:
    """Slots of one trial with its effects and its scatter, or None where the probe locks."""
    scatter = plan.scatter
    nominal = min(heights, key=lambda height: abs(height * 1e6 - float(row["height_um"])))
    bare = _nominal(plan, row, nominal, nominal)
    if bool(bare.locked()[0]):
        return None
    conditions: dict[str, Any] = dict(row) | {"peak_force_n": float(bare.peak_force()[0])}
    state = _nominal(plan, row, nominal, heights[nominal])
    for effect in plan.effects:
        state = _with_law(plan, effect, state, row) if effect.law else _with_form(effect, state, conditions)
    stray = scatter.friction * chance.standard_normal(), scatter.load * chance.standard_normal()
    state = state.changed(
        friction=state.friction + stray[0],
        load=state.load * (1.0 + stray[1]),
        sensed_offset=state.sensed_offset + stray[1] * (state.set_load + state.sensed_offset),
        conversion=state.conversion * math.exp(scatter.energy * chance.standard_normal()),
    )
    positive = np.stack([state.load, state.friction, state.stiffness, state.conversion, state.height])
    if bool(state.locked()[0]) or not bool(np.all(positive > 0.0)):
        return None
    return state


def _nominal(plan: SessionPlan, row: Mapping[str, str], nominal: float, true: float) -> DragState:
    model = plan.model
    design = BenchDesign(
        np.array([row["block"]]),
        np.array([nominal]),
        np.array([float(row["load_n"])]),
        np.array([float(row["speed_mm_s"]) / 1e3]),
        np.array([model.tip_radius]),
        model.spring_constant,
    )
    return nominal_state(
        design,
        {
            "friction": model.friction,
            "ln_conversion": math.log(model.conversion),
            "stiffness_ratio": 1.0,
            "ln_ring_frequency": math.log(model.ring_frequency),
            "ln_decay_time": math.log(model.decay_time),
            height_name(row["block"]): true - nominal,
        },
    )


def _with_form(effect: PlantedEffect, state: DragState, conditions: Mapping[str, Any]) -> DragState:
    changed: dict[str, Any] = {
        name: np.array([effect.apply(float(getattr(state, name)[0]), conditions)]) for name in _SLOTS[str(effect.slot)]
    }
    if effect.slot == "normal_load":
        # a load that is not the one set is weighed by the gauge all the same
        changed["sensed_offset"] = state.sensed_offset + changed["load"] - state.load
    return state.changed(**changed)


def _with_law(plan: SessionPlan, effect: PlantedEffect, state: DragState, row: Mapping[str, str]) -> DragState:
    law = next(one for one in named_laws(plan.blocks()) if one.id == effect.law)
    values = {p.name: p.start for p in law.parameters} | effect.parameters
    return law.apply(state, _column(law, state, row), values)


def _column(law: Law, state: DragState, row: Mapping[str, str]) -> Any:
    if law.covariate == "none":
        return None
    if law.covariate == "peak_force_n":
        return state.peak_force()
    if law.covariate == "loading_time_s":
        return state.loading_time()
    cell = row[law.covariate]
    return np.array([cell]) if law.covariate == "block" else np.array([float(cell)])


def rig_of(plan: SessionPlan, state: DragState) -> Rig:
    """Return the rig of a plan; a gauge that lags has a bandwidth."""
    declared, lag = plan.rig.model_dump(), float(state.lag[0])
    bandwidth = min(declared.pop("bandwidth") or math.inf, 1.0 / (2.0 * math.pi * lag) if lag > 0.0 else math.inf)
    return Rig(drift=declared.pop("drift_n_per_s"), bandwidth=bandwidth, **declared)


def truth_of(plan: SessionPlan, state: DragState) -> Truth | None:
    """Figures of a trial by equations (1) and (2), before gauge and rig; None where nothing catches or rings."""
    one = np.ones(1)
    shown = observe(state.changed(gain=one, lag=0.0 * one))[0]
    load = float(state.set_load[0] + state.sensed_offset[0])
    energy, peak, sliding = math.exp(shown[0]), math.exp(shown[1]), float(shown[2]) * load
    if peak - sliding < _LEAST_RISE or not energy > 0.0:
        return None
    spring = plan.model.spring_constant
    return Truth(
        load=load,
        sliding_force=sliding,
        slope=float(shown[3]) * spring * float(state.speed[0]),
        peak_force=peak,
        amplitude=math.sqrt(2.0 * spring * energy),
        frequency=math.exp(shown[4]),
        decay_time=math.exp(shown[5]),
        sympathetic=plan.model.sympathetic,
        gap=2.0 * float(state.friction[0]) * load if plan.model.ring == "rubbing" else 0.0,
    )


def true_drag(plan: SessionPlan, state: DragState) -> tuple[Step, OperatingPoint, float]:
    """Return the same trial for the drag in time, with the steady force along the drag beside the tip's [N]."""
    moved = [name for name in _NOT_IN_TIME if bool(np.any(getattr(state, name) != 0.0))]
    if moved:
        raise PipelineError(f"an effect changes {moved[0]}, for which the drag in time has no place")
    slots = {name: float(value[0]) for name, value in vars(state).items() if isinstance(value, np.ndarray)}
    ball_radius = min(plan.model.tip_radius, slots["radius"])
    tool = Tool(
        stiffness=slots["stiffness"],
        frequency=slots["frequency"] * math.sqrt(slots["ring_stiffness"] / plan.model.spring_constant),
        decay_time=slots["decay_time"] / slots["damping"],
    )
    point = OperatingPoint(ball_radius, slots["load"], slots["friction"], tool, slots["speed"])
    return Step(slots["height"], slots["radius"] - ball_radius), point, slots["drag"]
