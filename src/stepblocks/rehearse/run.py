"""Simulate a session as a laboratory would bring it, with any planted effect.

Its truth comes from equations (1) and (2) or from the drag in time.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stepblocks.bench.signal import Trace
from stepblocks.contact.counterface import Step
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import make_draft_folder, move_into_place, sync_folder
from stepblocks.files.tables import escape_formula
from stepblocks.quantities import check_seed
from stepblocks.rehearse.effects import PlantedEffect
from stepblocks.rehearse.kit_loads import compute_largest_common_std
from stepblocks.rehearse.plan import SessionPlan, format_block_name, read_session_plan
from stepblocks.rehearse.record import record_trial_by_drag, record_trial_by_equations
from stepblocks.rehearse.trace_files import TRACE_FILES, open_trace_writer
from stepblocks.rehearse.truth import (
    build_drag_inputs,
    build_rig,
    compute_planted_state,
    compute_truth_by_equations,
)
from stepblocks.rig.state import DragState

_SCAN_REACH, _SCAN_STEP, _SCAN_NOISE = 600.0, 0.25, 0.05  # [um]
_LARGEST_OFFSET = 3.0  # of a scan [um]
_TILT = 3e-4  # standard deviation of the tilt of a scan [1]
_LEAST_HEIGHT = 1e-7  # that scatter leaves a block [m]


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


class _TrueFigures(NamedTuple):
    """Figures of a trial in ``truth.csv``, in SI and named like its columns."""

    sliding_friction: float
    normal_load_n: float
    peak_force_n: float
    vibration_energy_j: float
    release_time_s: float


@dataclass(frozen=True)
class _SimulatedTrial:
    """A record and what is true of it."""

    trace: Trace
    figures: _TrueFigures


def simulate_session(
    plan: str | Path, output: str | Path, *, seed: int | None = None
) -> SimulationSummary:
    """Write a simulated session: declaration, table of trials, traces, scans, and the truth.

    Parameters
    ----------
    plan : str or Path
        TOML file of the plan: design, model, scatter, rig and effects.
    output : str or Path
        Folder to make; it must not exist or be empty.
    seed : int, optional
        Seed of all chance, in place of that of the plan.

    Returns
    -------
    SimulationSummary
        Counts. A locked trial is left out of the table, as on a bench, and stands in ``truth.csv``.

    Raises
    ------
    PipelineError
        If the plan is malformed, the folder holds something, or every trial locks.
    """
    declared = _read_seeded_plan(plan, seed)
    output = Path(output)
    is_free = not output.exists() or (output.is_dir() and not any(output.iterdir()))
    if not is_free:
        raise PipelineError(f"output must be a new or empty folder, got {str(output)!r}")
    return write_session_folder(declared, output)


def _read_seeded_plan(plan: str | Path, seed: int | None) -> SessionPlan:
    """Read a plan, with another seed where one is given."""
    declared = read_session_plan(Path(plan))
    if seed is None:
        return declared
    check_seed(seed)
    return declared.model_copy(update={"seed": seed})


def write_session_folder(plan: SessionPlan, output: Path) -> SimulationSummary:
    """Write a simulated session into a new folder, whole or not at all."""
    with make_draft_folder(output) as draft:
        summary = write_session(plan, draft)
        sync_folder(draft)
        move_into_place(draft, output)  # an empty folder gives way
    return summary


def write_session(plan: SessionPlan, folder: Path) -> SimulationSummary:
    """Write a simulated session into an empty folder.

    Raises
    ------
    PipelineError
        If every trial locks.
    """
    heights = _draw_true_heights(plan)
    _write_scans(plan, heights, folder / "scans")
    (folder / "session.toml").write_text(format_session_toml(plan), encoding="utf-8", newline="\n")
    summary = _write_trials_and_truth(plan, heights, folder)
    if summary.locked == summary.planned:
        raise PipelineError("every trial of the plan locks; lower the friction or the heights")
    return summary


def _draw_true_heights(plan: SessionPlan) -> dict[float, float]:
    """Return the true height of each block by its nominal one [m]."""
    random = np.random.default_rng([plan.seed, 2])
    heights = {}
    for nominal in sorted(plan.design.heights):
        error = plan.scatter.height * random.standard_normal()
        heights[nominal] = max(nominal + error, _LEAST_HEIGHT)
    return heights


def _write_scans(plan: SessionPlan, heights: Mapping[float, float], folder: Path) -> None:
    """Write a scan of each block, with the rounding of its edge."""
    folder.mkdir()
    rounding = max(sum(_get_constant_edge_rounding(effect) for effect in plan.effects), 0.0)
    for number, (nominal, height) in enumerate(heights.items()):
        path = folder / f"{format_block_name(nominal)}.csv"
        random = np.random.default_rng([plan.seed, 3, number])
        _write_simulated_scan(path, Step(height, rounding), random)


def _get_constant_edge_rounding(effect: PlantedEffect) -> float:
    """Return the constant edge rounding that an effect causes and a scan shows [m]."""
    if effect.law == "edge_rounding":
        return effect.parameters.get("edge_radius_m", 0.0)
    if effect.law:
        return 0.0
    adds_constant = effect.change == "add" and effect.form == "constant"
    if effect.slot == "contact_geometry" and adds_constant:
        return effect.size
    return 0.0


def _write_simulated_scan(path: Path, step: Step, generator: np.random.Generator) -> None:
    """Write a profilometer line across the edge with tilt and offset, as an instrument does."""
    x = np.arange(-_SCAN_REACH, _SCAN_REACH + _SCAN_STEP / 2.0, _SCAN_STEP)
    profile = 1e6 * np.maximum(step.heights(1e-6 * x), 0.0)
    offset = generator.uniform(-_LARGEST_OFFSET, _LARGEST_OFFSET)
    tilt = generator.normal(0.0, _TILT)
    noise = generator.normal(0.0, _SCAN_NOISE, x.size)
    z = profile + offset + tilt * x + noise
    np.savetxt(
        path, np.column_stack([x, z]), fmt="%.3f", delimiter=",", header="x_um,z_um", comments=""
    )


def _write_trials_and_truth(
    plan: SessionPlan, heights: Mapping[float, float], folder: Path
) -> SimulationSummary:
    """Write the table of trials, their traces, and what is true of them."""
    rows = plan.list_trial_rows()
    locked = 0
    with (
        open_trace_writer(folder, plan.format) as write_trace,
        (folder / "trials.csv").open("w", newline="", encoding="utf-8") as trials,
        (folder / "truth.csv").open("w", newline="", encoding="utf-8") as truths,
    ):
        table = csv.DictWriter(trials, list(rows[0]), lineterminator="\n")
        table.writeheader()
        truth_table = csv.writer(truths, lineterminator="\n")
        truth_table.writerow(["trial", "status", *_TrueFigures._fields])
        for number, row in enumerate(rows, start=1):
            chance = np.random.default_rng([plan.seed, 4, number])
            trial = _simulate_trial(plan, row, heights, chance)
            if trial is None:
                locked += 1
                blanks = [""] * len(_TrueFigures._fields)
                truth_table.writerow([row["trial"], "locked", *blanks])
                continue
            write_trace(number, trial.trace)
            table.writerow({name: escape_formula(cell) for name, cell in row.items()})
            figures = [f"{value:.9g}" for value in trial.figures]
            truth_table.writerow([row["trial"], "ok", *figures])
    return SimulationSummary(len(rows), locked)


def _simulate_trial(
    plan: SessionPlan,
    row: Mapping[str, str],
    heights: Mapping[float, float],
    generator: np.random.Generator,
) -> _SimulatedTrial | None:
    """Record one trial; None where the probe locks."""
    state = compute_planted_state(plan, row, heights, generator)
    if state is None:
        return None
    if plan.source == "drag":
        return _simulate_trial_by_drag(plan, state, generator)
    return _simulate_trial_by_equations(plan, state, generator)


def _simulate_trial_by_drag(
    plan: SessionPlan, state: DragState, generator: np.random.Generator
) -> _SimulatedTrial | None:
    """Record one trial as a drag in time; None where the tip does not slip over."""
    step, point, pull = build_drag_inputs(plan, state)
    record = record_trial_by_drag(
        step,
        point,
        build_rig(plan, state),
        generator,
        gain=float(state.gain[0]),
        added_pull=pull,
        hardening=float(state.hardening[0]) * point.tool.stiffness**3,
    )
    if record is None:
        return None
    load = float(state.load[0])
    sliding = float(state.friction[0] * state.load[0] + state.drag[0])
    figures = _TrueFigures(
        sliding / load,
        load,
        record.peak_force,
        _compute_amplitude_energy(plan, record.amplitude),
        record.release,
    )
    return _SimulatedTrial(record.trace, figures)


def _simulate_trial_by_equations(
    plan: SessionPlan, state: DragState, generator: np.random.Generator
) -> _SimulatedTrial | None:
    """Record one trial by equations (1) and (2); None where nothing catches or rings."""
    truth = compute_truth_by_equations(plan, state)
    if truth is None:
        return None
    rig = build_rig(plan, state)
    record = record_trial_by_equations(truth, rig, generator, float(state.gain[0]))
    figures = _TrueFigures(
        truth.sliding_force / truth.load,
        truth.load,
        truth.peak_force,
        _compute_amplitude_energy(plan, truth.amplitude),
        record.release,
    )
    return _SimulatedTrial(record.trace, figures)


def _compute_amplitude_energy(plan: SessionPlan, amplitude: float) -> float:
    """Return the energy of an amplitude [N] on the spring of the plan [J]."""
    return amplitude**2 / (2.0 * plan.model.spring_constant)


def format_session_toml(plan: SessionPlan) -> str:
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
{_format_load_calibration_toml(plan)}"""


def _format_load_calibration_toml(plan: SessionPlan) -> str:
    """Write the ``[calibration]`` table of the load by the kit's budget; empty without a kit."""
    if plan.apparatus is None:
        return ""
    std = compute_largest_common_std(plan.apparatus, plan.design.loads)
    return f"""
[calibration]
load_error = ["0 mN", "{std * 1e3:.2g} mN"]
"""
