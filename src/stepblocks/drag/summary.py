"""What ``drag.json`` says of one drag, beside equation (1)."""

import json
import math
from dataclasses import asdict

import numpy as np

from stepblocks.contact.energy import Status
from stepblocks.contact.kernels import (
    compute_height_at_angle,
    compute_pull_force,
    compute_step_angle,
)
from stepblocks.contact.laws import FrictionLaw
from stepblocks.drag.probe import DragSettings, Probe
from stepblocks.drag.result import DragResult
from stepblocks.drag.ring import Ring
from stepblocks.drag.simulate import Belonging, DragTrace
from stepblocks.files.text import Document
from stepblocks.quantities import format_quantity

_NOTABLE = 2e-3  # of the pull, above which a cause of a difference is named


def write_summary(drag: DragResult) -> Document:
    """Write a drag as plain values for JSON, units in the names."""
    trace, ring = drag.trace, drag.ring
    summary: Document = {
        "schema": 1,
        "subject": drag.title,
        "status": str(trace.status),
        "ledger_j": trace.ledger,
        "ledger_error": trace.ledger_error,
        "time_step_s": trace.time_step,
        "probe": _write_probe(trace.probe),
        "settings": _write_settings(trace.settings),
        "tool_frequency_hz": drag.tool.frequency,
        "tool_frequency_deviation_hz": drag.tool.frequency_deviation,
        "events": json.loads(drag.events.to_json(orient="records", double_precision=15)),
    }
    summary |= _write_texture(drag)
    reason = _explain_status(trace, ring)
    if reason:
        summary["reason"] = reason
    if drag.setting is not None:
        summary["setting"] = asdict(drag.setting)
    if ring is not None:
        summary |= _write_ring(trace, ring)
    return summary | _write_formula(drag)


def _write_probe(probe: Probe) -> Document:
    """Write every field of a probe, its overtones as lists."""
    return asdict(probe) | {"overtones": [list(mode) for mode in probe.overtones]}


def _write_settings(settings: DragSettings) -> Document:
    """Write every field of the settings, a law of friction as text and only where there is one."""
    document: Document = dict(vars(settings))
    law = document.pop("friction_law")
    if isinstance(law, FrictionLaw):
        document["friction_law"] = repr(law)
    return document


def _write_texture(drag: DragResult) -> Document:
    """Write what other places than the one that was asked about do to it."""
    others = drag.events[drag.events.belongs_to != Belonging.FEATURE.value]
    document: Document = {"other_releases": int((others.status == Status.RELEASES.value).sum())}
    if len(others) == 0:
        return document
    # a step of this height has the critical angle of the steepest place of the texture
    angle = float(others.critical_angle_deg.max())
    height = compute_height_at_angle(math.radians(angle), drag.ball_radius)
    document["texture_angle_deg"] = angle
    document["texture_hides_step_m"] = float(height)
    return document


def _explain_status(trace: DragTrace, ring: Ring | None) -> str:
    """Say why a drag came out so, where that needs a sentence."""
    if ring is not None and ring.fall_energy > trace.stored_energy:
        return (
            f"the tip falls behind the edge: the load gives {1e6 * ring.fall_energy:.3g} uJ, "
            f"the spring had stored {1e6 * trace.stored_energy:.3g} uJ"
        )
    return trace.reason


def _write_ring(trace: DragTrace, ring: Ring) -> Document:
    """Write the release and its ring."""
    return {
        "peak_force_n": trace.peak_force,
        "release_time_s": trace.release_time,
        "stored_energy_j": trace.stored_energy,
        "vibration_energy_j": ring.energy,
        "mode_energies_j": list(ring.mode_energies),
        "ring_share": ring.share,
        "fall_energy_j": ring.fall_energy,
        "ring_duration_s": ring.duration,
        "ring_decay_time_s": None if math.isnan(ring.decay_time) else ring.decay_time,
        "ring_frequency_hz": ring.frequency,
        "loading_share_0_100_hz": ring.loading_share,
        "vibration_share_250_350_hz": ring.ring_band_share,
    }


def _write_formula(drag: DragResult) -> Document:
    """Write what equation (1) says, and how far the drag is from it."""
    formula = drag.formula
    if formula.status is Status.NO_CATCH:
        return {}
    if formula.status is not Status.RELEASES:
        return {"equation_1": {"status": str(formula.status)}}
    document: Document = {
        "equation_1": {
            "status": str(formula.status),
            "peak_force_n": formula.pull_force,
            "vibration_energy_j": formula.vibration_energy,
        }
    }
    if drag.ring is not None:
        ratio = drag.trace.peak_force / formula.pull_force
        document["peak_force_over_equation_1"] = ratio
        document["difference_from_equation_1"] = _explain_difference(drag)
    return document


def _explain_difference(drag: DragResult) -> str:
    """Say how far the pull is from equation (1), and what each cause adds to it."""
    trace, pull = drag.trace, drag.formula.pull_force
    causes = []
    for cause, size in _list_causes(drag).items():
        if abs(size) > _NOTABLE * pull:
            causes.append(f"{cause} ({1e3 * float(size):+.3g} mN)")
    if trace.asked > 0:
        causes.append("the tip still swings from the place before")
    return (
        f"equation (1) {pull:.4g} N, the drag {1e3 * (trace.peak_force - pull):+.3g} mN: "
        f"{', '.join(causes)}"
    )


def _list_causes(drag: DragResult) -> dict[str, float]:
    """List what equation (1) leaves out, and what each adds to its pull to first order [N]."""
    trace, probe, settings = drag.trace, drag.trace.probe, drag.trace.settings
    pull, angle, load = drag.formula.pull_force, drag.formula.angle, settings.normal_load
    depth = probe.find_indentation(load)
    pressed_height = max(compute_height_at_angle(angle, drag.ball_radius) - depth, 0.0)
    pressed_angle = compute_step_angle(pressed_height, drag.ball_radius)
    pressed_pull = compute_pull_force(load, pressed_angle + math.atan2(pull, load) - angle, 0.0)
    time, handle = trace.column("time_s"), trace.column("handle_m")
    speed = float(np.interp(trace.release_time, time, np.gradient(handle, time)))
    at_rest = compute_pull_force(load, angle, settings.friction_at_rest) - pull
    sliding = compute_pull_force(load, angle, settings.friction) - pull
    return {
        f"the contact gives way by {format_quantity(depth, 'length')}": pressed_pull - pull,
        f"the handle goes on at {1e3 * speed:.3g} mm/s while the tip gathers speed": (
            speed * math.sqrt(probe.first_stiffness * probe.mass)
        ),
        "the tool rubs along a wall": settings.tissue_friction,
        f"friction is {settings.friction_at_rest:.3g} at rest and {settings.friction:.3g} as "
        "the tip slides, at most": at_rest + sliding,
    }
