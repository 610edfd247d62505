"""A session as a laboratory would bring it, from equations (1) and (2) or the drag in time, any effect planted."""

from __future__ import annotations

import csv
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.bench.rehearse.plan import SessionPlan, block_name, read_plan
from stepblocks.bench.rehearse.records import drag_trial, record
from stepblocks.bench.rehearse.trace_writers import TRACE_FILES, open_writer
from stepblocks.bench.rehearse.truth import planted_state, rig_of, true_drag, truth_of
from stepblocks.bench.signal.trace import Trace
from stepblocks.contact.counterface import Step
from stepblocks.errors import PipelineError

_SCAN_REACH, _SCAN_STEP, _SCAN_NOISE = 600.0, 0.25, 0.05  # [um]
_TRUTH = (
    "trial",
    "status",
    "sliding_friction",
    "normal_load_n",
    "peak_force_n",
    "vibration_energy_j",
    "release_time_s",
)


@dataclass(frozen=True)
class SimulationSummary:
    """Counts of trials."""

    planned: int
    locked: int  # gave no trace


def simulate_session(plan: str | Path, output: str | Path) -> SimulationSummary:
    """Write a simulated session: declaration, table of trials, traces, scans, and the truth behind them.

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
    declared, output = read_plan(Path(plan)), Path(output)
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise PipelineError(f"output must be a new or empty folder, got {str(output)!r}")
    if not output.parent.is_dir():
        raise PipelineError(f"folder of the output does not exist: {str(output.parent)!r}")
    beside = output.with_name(output.name + ".part")
    if beside.exists():
        raise PipelineError(f"an unfinished run is in the way, remove {str(beside)!r}")
    beside.mkdir()
    try:
        summary = _fill(declared, beside)
        if output.exists():
            output.rmdir()
        beside.rename(output)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return summary


def _fill(plan: SessionPlan, folder: Path) -> SimulationSummary:
    random = np.random.default_rng([plan.seed, 2])
    heights = {h: max(h + plan.scatter.height * random.standard_normal(), 1e-7) for h in sorted(plan.design.heights)}
    edge_radius = _edge_radius(plan)
    (folder / "scans").mkdir()
    for number, (nominal, true) in enumerate(heights.items()):
        _write_scan(folder / "scans" / f"{block_name(nominal)}.csv", Step(true, edge_radius), [plan.seed, 3, number])
    (folder / "session.toml").write_text(_declaration(plan), encoding="utf-8")
    rows = plan.rows()
    locked = 0
    with (
        open_writer(folder, plan.format) as write,
        (folder / "trials.csv").open("w", newline="", encoding="utf-8") as trials,
        (folder / "truth.csv").open("w", newline="", encoding="utf-8") as truths,
    ):
        table = csv.DictWriter(trials, list(rows[0]), lineterminator="\n")
        told = csv.writer(truths, lineterminator="\n")
        table.writeheader()
        told.writerow(_TRUTH)
        for number, row in enumerate(rows, start=1):
            trial = _trial(plan, row, heights, np.random.default_rng([plan.seed, 4, number]))
            if trial is None:
                locked += 1
                told.writerow([row["trial"], "locked", *[""] * (len(_TRUTH) - 2)])
                continue
            trace, figures = trial
            write(number, trace)
            table.writerow(row)
            told.writerow([row["trial"], "ok", *(f"{value:.9g}" for value in figures)])
    if locked == len(rows):
        raise PipelineError("every trial of the plan locks; lower the friction or the heights")
    return SimulationSummary(len(rows), locked)


def _trial(
    plan: SessionPlan, row: dict[str, str], heights: dict[float, float], chance: np.random.Generator
) -> tuple[Trace, tuple[float, ...]] | None:
    """Record of one trial and what is true of it, or None where the probe locks."""
    state = planted_state(plan, row, heights, chance)
    if state is None:
        return None
    rig, gain = rig_of(plan, state), float(state.gain[0])
    spring = plan.model.spring_constant
    if plan.source == "drag":
        step, point, pull = true_drag(plan, state)
        dragged = drag_trial(step, point, rig, chance, gain=gain, pull=pull)
        if dragged is None:
            return None
        load, sliding = float(state.load[0]), float(state.friction[0] * state.load[0] + state.drag[0])
        energy = dragged.amplitude**2 / (2.0 * spring)
        return dragged.trace, (sliding / load, load, dragged.peak_force, energy, dragged.release)
    truth = truth_of(plan, state)
    if truth is None:
        return None
    trace, _, release = record(truth, rig, chance, gain)
    energy = truth.amplitude**2 / (2.0 * spring)
    return trace, (truth.sliding_force / truth.load, truth.load, truth.peak_force, energy, release)


def _edge_radius(plan: SessionPlan) -> float:
    """Return the rounding that a scan would show: what is added to the contact geometry as a constant [m]."""
    added = [e.size for e in plan.effects if e.slot == "contact_geometry" and (e.change, e.form) == ("add", "constant")]
    added += [e.parameters.get("edge_radius_m", 0.0) for e in plan.effects if e.law == "edge_rounding"]
    return max(sum(added), 0.0)


def _write_scan(path: Path, step: Step, seed: list[int]) -> None:
    """Write a profilometer line across the edge, with its own tilt and offset, as an instrument does."""
    random = np.random.default_rng(seed)
    x = np.arange(-_SCAN_REACH, _SCAN_REACH + _SCAN_STEP / 2.0, _SCAN_STEP)
    z = 1e6 * np.maximum(step.heights(1e-6 * x), 0.0)
    z = z + random.uniform(-3.0, 3.0) + random.normal(0.0, 3e-4) * x + random.normal(0.0, _SCAN_NOISE, x.size)
    np.savetxt(path, np.column_stack([x, z]), fmt="%.3f", delimiter=",", header="x_um,z_um", comments="")


def _declaration(plan: SessionPlan) -> str:
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
