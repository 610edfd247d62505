"""Simulate a session as a laboratory would bring it, with any planted effect.

Its truth comes from equations (1) and (2) or from the drag in time.
"""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.bench.signal import Trace
from stepblocks.contact import Array
from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import make_draft_folder, move_into_place, sync_folder
from stepblocks.files.tables import escape_formula
from stepblocks.rehearse import (
    TRACE_FILES,
    RecordedTrial,
    Rig,
    Truth,
    open_writer,
    record_drag,
    record_trial,
)
from stepblocks.rehearse.plan import NUMBERS, SessionPlan, name_block, read_plan
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import (
    BenchDesign,
    build_nominal_state,
    format_height_name,
    select_covariate,
)
from stepblocks.rig.state import DragState, compute_channels

_SCAN_REACH, _SCAN_STEP, _SCAN_NOISE = 600.0, 0.25, 0.05  # [um]
_LEAST_RISE = 0.02  # [N] a lower peak is no catch
_NOT_IN_TIME = ("tilt", "climb_load", "lost_energy", "climb_drag")
# slots of the state, where they are not named like those of an effect
_SLOTS = {
    "contact_geometry": ("radius",),
    "normal_load": ("load",),
    "stiffness": ("stiffness", "ring_stiffness"),
    "sensor": ("gain",),
}
_FIGURES = (
    "sliding_friction",
    "normal_load_n",
    "peak_force_n",
    "vibration_energy_j",
    "release_time_s",
)


@dataclass(frozen=True)
class SimulationSummary:
    """Counts of trials.

    Attributes
    ----------
    planned : int
    locked : int
        Gave no trace.
    """

    planned: int
    locked: int


def simulate_session(plan: str | Path, output: str | Path) -> SimulationSummary:
    """Write a simulated session: declaration, table of trials, traces, scans, and the truth.

    Parameters
    ----------
    plan : str or Path
        TOML file of the plan: design, model, scatter, rig and effects.
    output : str or Path
        Folder to make; it must not exist or be empty.

    Returns
    -------
    SimulationSummary
        Counts. A locked trial is left out of the table, as on a bench, and stands in ``truth.csv``.

    Raises
    ------
    PipelineError
        If the plan is malformed, the folder holds something, or every trial locks.
    """
    declared = read_plan(Path(plan))
    output = Path(output)
    PipelineError.require(
        not (output.exists() and (not output.is_dir() or any(output.iterdir()))),
        f"output must be a new or empty folder, got {str(output)!r}",
    )
    with make_draft_folder(output) as draft:
        summary = write_session(declared, draft)
        sync_folder(draft)
        move_into_place(draft, output)  # an empty folder gives way
    return summary


def write_session(plan: SessionPlan, folder: Path) -> SimulationSummary:
    """Write a simulated session into an empty folder."""
    random = np.random.default_rng([plan.seed, 2])
    heights = {
        h: max(h + plan.scatter.height * random.standard_normal(), 1e-7)
        for h in sorted(plan.design.heights)
    }
    # the rounding that a scan would show: what is added to the contact geometry as a constant
    added = [
        e.parameters.get("edge_radius_m", 0.0) if e.law else e.size
        for e in plan.effects
        if e.law == "edge_rounding"
        or (e.slot, e.change, e.form) == ("contact_geometry", "add", "constant")
    ]
    (folder / "scans").mkdir()
    for number, (nominal, true) in enumerate(heights.items()):
        _write_scan(
            folder / "scans" / f"{name_block(nominal)}.csv",
            Step(true, max(sum(added), 0.0)),
            np.random.default_rng([plan.seed, 3, number]),
        )
    (folder / "session.toml").write_text(format_session(plan), encoding="utf-8", newline="\n")
    rows = plan.rows()
    locked = 0
    with (
        open_writer(folder, plan.format) as write,
        (folder / "trials.csv").open("w", newline="", encoding="utf-8") as trials,
        (folder / "truth.csv").open("w", newline="", encoding="utf-8") as truths,
    ):
        table = csv.DictWriter(trials, list(rows[0]), lineterminator="\n")
        truth_writer = csv.writer(truths, lineterminator="\n")
        table.writeheader()
        truth_writer.writerow(["trial", "status", *_FIGURES])
        for number, row in enumerate(rows, start=1):
            trial = _record_row(plan, row, heights, np.random.default_rng([plan.seed, 4, number]))
            if trial is None:
                locked += 1
                truth_writer.writerow([row["trial"], "locked", *[""] * len(_FIGURES)])
                continue
            trace, figures = trial
            write(number, trace)
            table.writerow({name: escape_formula(cell) for name, cell in row.items()})
            truth_writer.writerow([row["trial"], "ok", *(f"{value:.9g}" for value in figures)])
    PipelineError.require(
        locked != len(rows),
        "every trial of the plan locks; lower the friction or the heights",
    )
    return SimulationSummary(len(rows), locked)


def _record_row(
    plan: SessionPlan, row: dict[str, str], heights: dict[float, float], chance: np.random.Generator
) -> tuple[Trace, tuple[float, ...]] | None:
    # Record of one trial and what is true of it, or None where the probe locks
    state = compute_planted_state(plan, row, heights, chance)
    if state is None:
        return None
    rig = build_rig(plan, state)
    gain = float(state.gain[0])
    if plan.source == "drag":
        step, point, pull = record_true_drag(plan, state)
        done = record_drag(
            step,
            point,
            rig,
            chance,
            gain=gain,
            pull=pull,
            hardening=float(state.hardening[0]) * point.tool.stiffness**3,
        )
        load, sliding = (
            float(state.load[0]),
            float(state.friction[0] * state.load[0] + state.drag[0]),
        )
    else:
        truth = compute_truth(plan, state)
        if truth is None:
            return None
        trace, _, release = record_trial(truth, rig, chance, gain)
        done = RecordedTrial(trace, truth.peak_force, truth.amplitude, release)
        load, sliding = truth.load, truth.sliding_force
    if done is None:
        return None
    return done.trace, (
        sliding / load,
        load,
        done.peak_force,
        done.amplitude**2 / (2.0 * plan.model.spring_constant),
        done.release,
    )


def _write_scan(path: Path, step: Step, random: np.random.Generator) -> None:
    # Write a profilometer line across the edge with a tilt and an offset, as an instrument does.
    x = np.arange(-_SCAN_REACH, _SCAN_REACH + _SCAN_STEP / 2.0, _SCAN_STEP)
    z = (
        1e6 * np.maximum(step.heights(1e-6 * x), 0.0)
        + random.uniform(-3.0, 3.0)
        + random.normal(0.0, 3e-4) * x
        + random.normal(0.0, _SCAN_NOISE, x.size)
    )
    np.savetxt(
        path, np.column_stack([x, z]), fmt="%.3f", delimiter=",", header="x_um,z_um", comments=""
    )


def format_session(plan: SessionPlan) -> str:
    """Return the declaration of a planned session, as session.toml holds it."""
    title = plan.title.replace("\\", "\\\\").replace('"', '\\"')
    return f"""schema = 1
title = "{title}"

[probe]
spring_constant = "{plan.model.spring_constant:g} N/m"
tip_radius = "{plan.model.tip_radius * 1e6:g} um"

[acquisition]
sample_rate = "{plan.rig.sample_rate:g} Hz"
traces = "{TRACE_FILES[plan.format]}"
channels = {{ time = "time_s", tangential = "fx_n", normal = "fy_n" }}

[stimuli]
set = "simulated"
scans = "scans/{{block}}.csv"
"""


def compute_planted_state(
    plan: SessionPlan,
    row: Mapping[str, str],
    heights: Mapping[float, float],
    chance: np.random.Generator,
) -> DragState | None:
    """Slots of one trial with its effects and its scatter, or None where the probe locks."""
    scatter = plan.scatter
    nominal = min(heights, key=lambda height: abs(height * 1e6 - float(row["height_um"])))
    numbers = {name: np.array([float(row[name])]) for name in NUMBERS if name in row}
    design = BenchDesign(
        np.array([row["block"]]),
        np.array([nominal]),
        numbers["load_n"],
        numbers["speed_mm_s"] / 1e3,
        np.array([plan.model.tip_radius]),
        plan.model.spring_constant,
        numbers,
    )
    values = {
        "friction": plan.model.friction,
        "ln_conversion": math.log(plan.model.conversion),
        "stiffness_ratio": 1.0,
        "ln_ring_frequency": math.log(plan.model.ring_frequency),
        "ln_decay_time": math.log(plan.model.decay_time),
    }
    bare = build_nominal_state(design, values)
    if bool(bare.locked()[0]):
        return None
    covariates: dict[str, float | str] = dict(row) | {"peak_force_n": float(bare.peak_force()[0])}
    state = build_nominal_state(
        design, values | {format_height_name(row["block"]): heights[nominal] - nominal}
    )
    for effect in plan.effects:
        if effect.law:
            law = next(one for one in list_named_laws(plan.blocks()) if one.id == effect.law)
            state = law.apply(
                state,
                select_covariate(design, state, law.covariate),
                {p.name: p.start for p in law.parameters} | effect.parameters,
            )
        else:
            names = _SLOTS.get(str(effect.slot), (str(effect.slot),))
            changed: dict[str, Array] = {
                n: np.array([effect.apply(float(getattr(state, n)[0]), covariates)]) for n in names
            }
            if effect.slot == "normal_load":
                # a load that is not the one set is weighed by the gauge all the same
                changed["sensed_offset"] = state.sensed_offset + changed["load"] - state.load
            state = state.changed(**changed)
    stray = scatter.friction * chance.standard_normal(), scatter.load * chance.standard_normal()
    state = state.changed(
        friction=state.friction + stray[0],
        load=state.load * (1.0 + stray[1]),
        sensed_offset=state.sensed_offset + stray[1] * (state.set_load + state.sensed_offset),
        conversion=state.conversion * math.exp(scatter.energy * chance.standard_normal()),
    )
    positive = np.stack(
        [state.load, state.friction, state.stiffness, state.conversion, state.height]
    )
    return None if bool(state.locked()[0]) or not bool(np.all(positive > 0.0)) else state


def build_rig(plan: SessionPlan, state: DragState) -> Rig:
    """Return the rig of a plan; a gauge that lags has a bandwidth."""
    declared = plan.rig.model_dump()
    lag = float(state.lag[0])
    return Rig(
        drift=declared.pop("drift_n_per_s"),
        bandwidth=min(
            declared.pop("bandwidth") or math.inf,
            1.0 / (2.0 * math.pi * lag) if lag > 0.0 else math.inf,
        ),
        **declared,
    )


def compute_truth(plan: SessionPlan, state: DragState) -> Truth | None:
    """Figures of a trial by equations (1) and (2), before gauge and rig.

    The result is None where nothing catches or rings.
    """
    one = np.ones(1)
    shown = compute_channels(state.changed(gain=one, lag=0.0 * one))[0]
    load = float(state.set_load[0] + state.sensed_offset[0])
    energy, peak = math.exp(shown[0]), math.exp(shown[1])
    sliding = float(shown[2]) * load
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


def record_true_drag(plan: SessionPlan, state: DragState) -> tuple[Step, OperatingPoint, float]:
    """Return the same trial for the drag in time.

    Beside the force of the tip it has the steady force along the drag [N].
    """
    if changed_slots := [name for name in _NOT_IN_TIME if np.any(getattr(state, name) != 0.0)]:
        raise PipelineError(
            f"an effect changes {changed_slots[0]}, for which the drag in time has no place"
        )
    slots = {
        name: float(value[0])
        for name, value in vars(state).items()
        if isinstance(value, np.ndarray)
    }
    ball_radius = min(plan.model.tip_radius, slots["radius"])
    point = OperatingPoint(
        ball_radius,
        slots["load"],
        slots["friction"],
        Tool(
            stiffness=slots["stiffness"],
            frequency=slots["frequency"]
            * math.sqrt(slots["ring_stiffness"] / plan.model.spring_constant),
            decay_time=slots["decay_time"] / slots["damping"],
        ),
        slots["speed"],
    )
    return Step(slots["height"], slots["radius"] - ball_radius), point, slots["drag"]
