"""Job: a session as a laboratory would bring it, from equations (1) and (2), with any effect planted."""

from __future__ import annotations

import csv
import math
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.bench.trace_writers import TRACE_FILES, open_writer
from stepblocks.bench.waveform import Rig, Truth, record
from stepblocks.contact import kernels
from stepblocks.errors import PipelineError
from stepblocks.pipeline.session_plan import SessionPlan, block_name, read_plan

__all__ = ["SimulationSummary", "simulate_session"]

_SCAN_REACH, _SCAN_STEP, _SCAN_NOISE = 600.0, 0.25, 0.05  # [um]
_LEAST_RISE = 0.02  # [N] a lower peak is no catch
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
    """Trials that were planned, and those that gave no trace because the probe locked."""

    planned: int
    locked: int


def simulate_session(plan_file: Path, output: Path) -> SimulationSummary:
    """Write a simulated session.

    Parameters
    ----------
    plan_file : Path
        The plan; see `stepblocks.pipeline.session_plan`.
    output : Path
        Folder to make; it must not exist or be empty.

    Returns
    -------
    SimulationSummary
        Counts. A locked trial is left out of the table, as on a bench, and stands in ``truth.csv``.

    Raises
    ------
    PipelineError
        If the plan is malformed or the folder holds something.
    """
    plan = read_plan(plan_file)
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise PipelineError(f"output must be a new or empty folder, got {str(output)!r}")
    if not output.parent.is_dir():
        raise PipelineError(f"folder of the output does not exist: {str(output.parent)!r}")
    beside = output.with_name(output.name + ".part")
    if beside.exists():
        raise PipelineError(f"an unfinished run is in the way, remove {str(beside)!r}")
    beside.mkdir()
    try:
        summary = _fill(plan, beside)
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
        _write_scan(folder / "scans" / f"{block_name(nominal)}.csv", true, edge_radius, [plan.seed, 3, number])
    (folder / "session.toml").write_text(_declaration(plan), encoding="utf-8")
    rows = plan.rows()
    locked = 0
    writer = open_writer(folder, plan.format)
    try:
        with (
            (folder / "trials.csv").open("w", newline="", encoding="utf-8") as trials,
            (folder / "truth.csv").open("w", newline="", encoding="utf-8") as truths,
        ):
            table = csv.DictWriter(trials, list(rows[0]), lineterminator="\n")
            told = csv.writer(truths, lineterminator="\n")
            table.writeheader()
            told.writerow(_TRUTH)
            for number, row in enumerate(rows, start=1):
                chance = np.random.default_rng([plan.seed, 4, number])
                truth, gain = _truth(plan, row, heights, chance)
                if truth is None:
                    locked += 1
                    told.writerow([row["trial"], "locked", *[""] * (len(_TRUTH) - 2)])
                    continue
                trace, _, release = record(truth, _rig(plan), chance, gain)
                writer.write(number, trace)
                table.writerow(row)
                energy = truth.amplitude**2 / (2.0 * plan.model.spring_constant)
                figures = (truth.sliding_force / truth.load, truth.load, truth.peak_force, energy, release)
                told.writerow([row["trial"], "ok", *(f"{value:.9g}" for value in figures)])
    finally:
        writer.close()
    if locked == len(rows):
        raise PipelineError("every trial of the plan locks; lower the friction or the heights")
    return SimulationSummary(len(rows), locked)


def _rig(plan: SessionPlan) -> Rig:
    rig = plan.rig
    return Rig(
        rig.sample_rate, rig.noise, rig.quantum, rig.hum, rig.mains, rig.drift_n_per_s, rig.start_up,
        rig.bandwidth or math.inf,
    )  # fmt: skip


def _edge_radius(plan: SessionPlan) -> float:
    """Return the rounding that a scan would show: what is added to the contact geometry as a constant [m]."""
    added = [e.size for e in plan.effects if e.slot == "contact_geometry" and (e.change, e.form) == ("add", "constant")]
    return max(sum(added), 0.0)


def _truth(
    plan: SessionPlan, row: dict[str, str], heights: dict[float, float], chance: np.random.Generator
) -> tuple[Truth | None, float]:
    """Figures of one trial, or None where the probe locks, and the gain of the tangential channel."""
    model, scatter = plan.model, plan.scatter
    load, speed = float(row["load_n"]), float(row["speed_mm_s"]) / 1e3
    nominal = min(heights, key=lambda height: abs(height * 1e6 - float(row["height_um"])))
    conditions = {name: float(cell) for name, cell in row.items() if name.rsplit("_", 1)[-1] in _NUMERIC}
    angle = float(kernels.angle_on_step(nominal, model.tip_radius)) if nominal < model.tip_radius else math.inf
    if angle + math.atan(model.friction) >= 0.5 * math.pi:
        return None, 1.0
    conditions["peak_force_n"] = float(kernels.pull_force(load, angle, model.friction))
    slots = {
        "contact_geometry": model.tip_radius,
        "friction": model.friction,
        "normal_load": load,
        "stiffness": model.spring_constant,
        "conversion": model.conversion,
        "drag": 0.0,
        "sensor": 1.0,
    }
    for effect in plan.effects:
        slots[effect.slot] = effect.apply(slots[effect.slot], conditions)
    friction = slots["friction"] + scatter.friction * chance.standard_normal()
    normal = slots["normal_load"] * (1.0 + scatter.load * chance.standard_normal())
    height = heights[nominal]
    if height >= slots["contact_geometry"] or normal <= 0.0 or friction < 0.0 or slots["stiffness"] <= 0.0:
        return None, 1.0
    angle = float(kernels.angle_on_step(height, slots["contact_geometry"]))
    if angle + math.atan(friction) >= 0.5 * math.pi:
        return None, 1.0
    sliding = friction * normal + slots["drag"]
    peak = float(kernels.pull_force(normal, angle, friction)) + slots["drag"]
    energy = slots["conversion"] * float(kernels.stored_energy(peak, slots["stiffness"]))
    energy *= math.exp(scatter.energy * chance.standard_normal())
    if peak - sliding < _LEAST_RISE or energy <= 0.0:
        return None, 1.0
    stiffer = math.sqrt(slots["stiffness"] / model.spring_constant)
    truth = Truth(
        load=normal,
        sliding_force=sliding,
        slope=slots["stiffness"] * speed,
        peak_force=peak,
        amplitude=math.sqrt(2.0 * slots["stiffness"] * energy),
        frequency=model.ring_frequency * stiffer,
        decay_time=model.decay_time,
        sympathetic=model.sympathetic,
        gap=2.0 * friction * normal if model.ring == "rubbing" else 0.0,
    )
    return truth, slots["sensor"]


_NUMERIC = ("um", "n", "s", "order", "c", "pct")


def _write_scan(path: Path, height: float, edge_radius: float, seed: list[int]) -> None:
    """Profilometer line across the edge, with its own tilt and offset, as an instrument writes it."""
    random = np.random.default_rng(seed)
    x = np.arange(-_SCAN_REACH, _SCAN_REACH + _SCAN_STEP / 2.0, _SCAN_STEP)
    step, radius = height * 1e6, edge_radius * 1e6
    into = np.clip(radius - x, 0.0, radius)
    z = np.where(x >= 0.0, np.maximum(step - radius + np.sqrt(np.maximum(radius**2 - into**2, 0.0)), 0.0), 0.0)
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
