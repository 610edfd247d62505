"""What ``drag.json`` says of one drag, beside equation (1)."""

import json
import math
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from stepblocks.contact.energy import Release, Status
from stepblocks.contact.kernels import (
    compute_height_at_angle,
    compute_pull_force,
    compute_step_angle,
)
from stepblocks.contact.laws import FrictionLaw
from stepblocks.drag.probe import DragSettings, Probe, Setting
from stepblocks.drag.result import DragResult
from stepblocks.drag.ring import Ring
from stepblocks.drag.simulate import Belonging, DragTrace
from stepblocks.quantities import format_quantity

_SCHEMA = 1
_NOTABLE = 2e-3  # of the pull, above which a cause of a difference is named


@dataclass(frozen=True)
class TextureRecord:
    """The steepest place beside the one that was asked about."""

    texture_angle_deg: float
    texture_hides_step_m: float  # height of the step that has this critical angle


@dataclass(frozen=True)
class RingRecord:
    """The release that was asked about, and its ring."""

    peak_force_n: float
    release_time_s: float
    stored_energy_j: float
    vibration_energy_j: float
    mode_energies_j: list[float]
    ring_share: float
    fall_energy_j: float
    ring_duration_s: float
    ring_decay_time_s: float | None  # None where the trace ends before
    ring_frequency_hz: float
    loading_share_0_100_hz: float
    vibration_share_250_350_hz: float


@dataclass(frozen=True)
class FormulaRecord:
    """What equation (1) says; force and energy only of a release."""

    status: str
    peak_force_n: float | None = None
    vibration_energy_j: float | None = None


@dataclass(frozen=True)
class ComparisonRecord:
    """How far the drag is from equation (1), where both release."""

    peak_force_over_equation_1: float
    difference_from_equation_1: str


@dataclass(frozen=True)
class DragRecord:
    """What ``drag.json`` says of one drag, units in the names; `to_json` writes it.

    The fields of texture, ring and comparison stand beside the others in the file.
    """

    subject: str
    status: str
    ledger_j: dict[str, float]
    ledger_error: float
    time_step_s: float
    probe: Probe
    settings: DragSettings
    tool_frequency_hz: float
    tool_frequency_deviation_hz: float
    events: list[dict[str, object]]  # rows of ``events.csv``
    other_releases: int
    reason: str
    limit: str
    setting: Setting | None
    texture: TextureRecord | None
    ring: RingRecord | None
    equation_1: FormulaRecord | None
    comparison: ComparisonRecord | None

    def to_json(self) -> dict[str, object]:
        """Return the record as plain values; what there is not has no key."""
        document: dict[str, object] = {
            "schema": _SCHEMA,
            "subject": self.subject,
            "status": self.status,
            "ledger_j": self.ledger_j,
            "ledger_error": self.ledger_error,
            "time_step_s": self.time_step_s,
            "probe": _make_probe_fields(self.probe),
            "settings": _make_settings_fields(self.settings),
            "tool_frequency_hz": self.tool_frequency_hz,
            "tool_frequency_deviation_hz": self.tool_frequency_deviation_hz,
            "events": self.events,
            "other_releases": self.other_releases,
        }
        if self.reason:
            document["reason"] = self.reason
        if self.limit:
            document["limit"] = self.limit
        if self.setting is not None:
            document["setting"] = asdict(self.setting)
        for part in (self.texture, self.ring, self.comparison):
            if part is not None:
                document |= asdict(part)
        if self.equation_1 is not None:
            document["equation_1"] = _make_formula_fields(self.equation_1)
        return document


def build_drag_record(drag: DragResult) -> DragRecord:
    """Build the record of a drag."""
    trace, ring = drag.trace, drag.ring
    events = json.loads(drag.events.to_json(orient="records", double_precision=15))
    is_elsewhere = drag.events.belongs_to != Belonging.FEATURE.value
    elsewhere = drag.events[is_elsewhere]
    other_releases = (elsewhere.status == Status.RELEASES.value).sum()
    reason = _explain_status(trace, ring)
    texture = _make_texture_record(elsewhere, drag.ball_radius)
    return DragRecord(
        subject=drag.title,
        status=str(trace.status),
        ledger_j=trace.ledger,
        ledger_error=trace.ledger_error,
        time_step_s=trace.time_step,
        probe=trace.probe,
        settings=trace.settings,
        tool_frequency_hz=drag.tool.frequency,
        tool_frequency_deviation_hz=drag.tool.frequency_deviation,
        events=events,
        other_releases=int(other_releases),
        reason=reason,
        limit=_explain_exceeded_limit(drag),
        setting=drag.setting,
        texture=texture,
        ring=_make_ring_record(trace, ring),
        equation_1=_make_formula_record(drag.formula),
        comparison=_make_comparison_record(drag),
    )


def _make_probe_fields(probe: Probe) -> dict[str, object]:
    """Return every field of a probe as plain values, its overtones as lists."""
    overtones = [list(mode) for mode in probe.overtones]
    return asdict(probe) | {"overtones": overtones}


def _make_settings_fields(settings: DragSettings) -> dict[str, object]:
    """Return every field of the settings, a law of friction as text and only where there is one."""
    document = dict(vars(settings))
    law = document.pop("friction_law")
    if isinstance(law, FrictionLaw):
        document["friction_law"] = repr(law)
    return document


def _make_formula_fields(formula: FormulaRecord) -> dict[str, object]:
    """Return what equation (1) says as plain values, without what it does not say."""
    return {name: value for name, value in asdict(formula).items() if value is not None}


def _explain_status(trace: DragTrace, ring: Ring | None) -> str:
    """Say why a drag came out so, where that needs a sentence."""
    if ring is not None and ring.fall_energy > trace.stored_energy:
        return (
            f"the tip falls behind the edge: the load gives {1e6 * ring.fall_energy:.3g} uJ, "
            f"the spring had stored {1e6 * trace.stored_energy:.3g} uJ"
        )
    return trace.reason


def _explain_exceeded_limit(drag: DragResult) -> str:
    """Say which limit equation (1) takes more than, since a drag in time itself has none."""
    first = drag.tool.limits.first
    pull = drag.formula.pull_force
    if drag.trace.status is not Status.RELEASES or not pull > first.force:
        return ""
    return (
        f"a drag in time knows no limits; equation (1) takes {pull:.4g} N, more than the "
        f"{first.force:g} N of the {first.name}, so that `predict` says beyond-{first.name}"
    )


def _make_texture_record(elsewhere: pd.DataFrame, ball_radius: float) -> TextureRecord | None:
    """Find the step that the texture hides, from the events that are not of the feature."""
    if len(elsewhere) == 0:
        return None
    angle = float(elsewhere.critical_angle_deg.max())
    hidden = compute_height_at_angle(math.radians(angle), ball_radius)
    return TextureRecord(angle, float(hidden))


def _make_ring_record(trace: DragTrace, ring: Ring | None) -> RingRecord | None:
    """Return the record of the ring after the release that was asked about; None without one."""
    if ring is None:
        return None
    decay_time = None
    if not math.isnan(ring.decay_time):
        decay_time = ring.decay_time
    return RingRecord(
        peak_force_n=trace.peak_force,
        release_time_s=trace.release_time,
        stored_energy_j=trace.stored_energy,
        vibration_energy_j=ring.energy,
        mode_energies_j=list(ring.mode_energies),
        ring_share=ring.share,
        fall_energy_j=ring.fall_energy,
        ring_duration_s=ring.duration,
        ring_decay_time_s=decay_time,
        ring_frequency_hz=ring.frequency,
        loading_share_0_100_hz=ring.loading_share,
        vibration_share_250_350_hz=ring.ring_band_share,
    )


def _make_formula_record(formula: Release) -> FormulaRecord | None:
    """Return the record of what equation (1) says; None where nothing catches."""
    if formula.status is Status.NO_CATCH:
        return None
    if formula.status is not Status.RELEASES:
        return FormulaRecord(str(formula.status))
    return FormulaRecord(str(formula.status), formula.pull_force, formula.vibration_energy)


def _make_comparison_record(drag: DragResult) -> ComparisonRecord | None:
    """Compare the drag with equation (1), where both release."""
    if drag.ring is None or drag.formula.status is not Status.RELEASES:
        return None
    ratio = drag.trace.peak_force / drag.formula.pull_force
    return ComparisonRecord(ratio, _explain_difference(drag))


def _explain_difference(drag: DragResult) -> str:
    """Say how far the pull is from equation (1), and what each cause adds to it."""
    trace, pull = drag.trace, drag.formula.pull_force
    causes = []
    for cause, size in _estimate_causes_of_difference(drag).items():
        if abs(size) > _NOTABLE * pull:
            causes.append(f"{cause} ({1e3 * float(size):+.3g} mN)")
    if trace.asked > 0:
        causes.append("the tip still swings from the place before")
    return (
        f"equation (1) {pull:.4g} N, the drag {1e3 * (trace.peak_force - pull):+.3g} mN: "
        f"{', '.join(causes)}"
    )


def _estimate_causes_of_difference(drag: DragResult) -> dict[str, float]:
    """List what equation (1) leaves out, and what each adds to its pull to first order [N]."""
    trace, probe, settings = drag.trace, drag.trace.probe, drag.trace.settings
    pull, angle, load = drag.formula.pull_force, drag.formula.angle, settings.normal_load
    depth = probe.compute_indentation(load)
    height = compute_height_at_angle(angle, drag.ball_radius)
    pressed_height = max(height - depth, 0.0)
    pressed_angle = compute_step_angle(pressed_height, drag.ball_radius)
    pull_angle = pressed_angle + math.atan2(pull, load) - angle
    pressed_pull = compute_pull_force(load, pull_angle, 0.0)
    time, handle = trace.column("time_s"), trace.column("handle_m")
    speeds = np.gradient(handle, time)
    speed = float(np.interp(trace.release_time, time, speeds))
    catching_up = speed * math.sqrt(probe.first_stiffness * probe.mass)
    at_rest = compute_pull_force(load, angle, settings.friction_at_rest) - pull
    sliding = compute_pull_force(load, angle, settings.friction) - pull
    return {
        f"the contact gives way by {format_quantity(depth, 'length')}": pressed_pull - pull,
        f"the handle goes on at {1e3 * speed:.3g} mm/s while the tip gathers speed": catching_up,
        "the tool rubs along a wall": settings.tissue_friction,
        f"friction is {settings.friction_at_rest:.3g} at rest and {settings.friction:.3g} as "
        "the tip slides, at most": at_rest + sliding,
    }
