"""One row of a sweep: its inputs, drawn from the plan and its number alone, and what equations and integrator say to them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from stepblocks.contact.counterface import Counterface, Margin, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tool
from stepblocks.errors import ContactError
from stepblocks.predict.predictions import dragged
from stepblocks.predict.sweep.plan import DIRECTIONS, PARAMETERS, SURFACES, SweepPlan

_UNITS = {
    "length": "_m",
    "force": "_n",
    "stiffness": "_n_m",
    "speed": "_m_s",
    "frequency": "_hz",
    "ratio": "",
    "direction": "",
}
STATIC_COLUMNS = ("status", "critical_angle_rad", "peak_force_n", "vibration_energy_j", "problem")
DRAG_COLUMNS = (
    "drag_status",
    "drag_peak_force_n",
    "drag_vibration_energy_j",
    "drag_share",
    "drag_ring_s",
    "drag_ledger_error",
)


def design_row(plan: SweepPlan, row: int) -> dict[str, float]:
    """Draw the inputs [SI] of one row; they depend on the plan and the row's number alone."""
    left = point = row // plan.draws
    inputs: dict[str, float] = {}
    random = np.random.default_rng([plan.seed, point])
    for name in PARAMETERS[plan.surface]:
        if name in plan.ranges:
            inputs[name] = float(random.uniform(plan.ranges[name][0], plan.ranges[name][1]))
        elif name in plan.values:
            choices = plan.values[name]
            if plan.kind == "grid":
                left, index = divmod(left, len(choices))
            else:
                index = int(random.integers(len(choices)))
            inputs[name] = choices[index]
    spreads = dict(plan.spreads)
    if plan.stimuli:
        index = left if plan.kind == "grid" else int(random.integers(len(plan.stimuli)))
        chosen = plan.stimuli[index]
        inputs |= {"stimulus": index} | chosen["values"]
        spreads = chosen["spreads"] | spreads
    spreads |= {name: share * inputs[name] for name, share in plan.shares.items()}
    if spreads:
        noise = np.random.default_rng([plan.seed, row, 1])
        signed = ("horizontal_discrepancy", "vertical_discrepancy")
        for name in PARAMETERS[plan.surface]:
            if name in spreads:
                moved = inputs[name] + spreads[name] * float(noise.standard_normal())
                inputs[name] = moved if name in signed else max(moved, 0.0)
    return inputs


def sweep_row(plan: SweepPlan, row: int) -> dict[str, Any]:
    """Compute a row of the table; one outside the equations has its reason in ``problem``, no figures."""
    inputs = design_row(plan, row)
    result: dict[str, Any] = {"row": row, "draw": row % plan.draws}
    if plan.stimuli:
        result["stimulus"] = plan.stimuli[int(inputs["stimulus"])]["id"]
    for name, (dimension, _) in PARAMETERS[plan.surface].items():
        result[name + _UNITS[dimension]] = inputs.get(name, math.nan)
    if plan.surface == "margin":
        result["direction"] = DIRECTIONS[int(inputs["direction"])]
    result |= dict.fromkeys(STATIC_COLUMNS, math.nan) | {"status": "invalid", "problem": ""}
    if plan.mode == "drag":
        result |= dict.fromkeys(DRAG_COLUMNS, math.nan) | {"drag_status": "invalid"}
    try:
        face = _face(plan.surface, inputs)
        tool = Tool(inputs["stiffness"], inputs["conversion"], limits=Limits(**plan.limits))
        point = OperatingPoint(inputs["tip_radius"], inputs["normal_load"], inputs["friction"], tool)
        backward = bool(inputs.get("direction", 0.0))
        release = face.release(point, backward)
        result |= {
            "status": str(release.status),
            "critical_angle_rad": release.angle,
            "peak_force_n": release.pull_force,
            "vibration_energy_j": release.vibration_energy,
        }
        if plan.mode == "drag" and (release.status.beyond or release.status in (Status.TOO_HIGH, Status.NO_CATCH)):
            result["drag_status"] = str(release.status)
        elif plan.mode == "drag":
            result |= _dragged(face, point, backward, inputs)
    except ContactError as error:
        result["problem"] = str(error)
    return result


def _face(surface: str, inputs: dict[str, float]) -> Counterface:
    sizes = {name: inputs[column] for name, column in SURFACES[surface].items() if column in inputs}
    # the end of a crown is square where no vertical discrepancy is given
    return Step(**sizes) if surface == "step" else Margin(**{"opening": sizes["gap"]} | sizes)


def _dragged(face: Counterface, point: OperatingPoint, backward: bool, inputs: dict[str, float]) -> dict[str, Any]:
    point = replace(point, tool=replace(point.tool, frequency=inputs["frequency"]))
    trace, ring = dragged(face, point, backward, inputs["speed"], damping_ratio=inputs["damping_ratio"])
    result: dict[str, Any] = {"drag_status": str(trace.status), "drag_ledger_error": trace.ledger_error}
    if ring is None:
        return result
    return result | {
        "drag_peak_force_n": trace.peak_force,
        "drag_vibration_energy_j": ring.energy,
        "drag_share": ring.share,
        "drag_ring_s": ring.duration,
    }
