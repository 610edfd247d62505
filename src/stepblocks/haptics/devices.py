"""Force-feedback devices as data: at which scale each renders a stimulus, and what it loses."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, Field

from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent, replace_non_finite_by_none
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.files.text import read_document
from stepblocks.mistakes import validate_file_data
from stepblocks.quantities import parse_quantity

_MAX_FILE_BYTES = 200_000
# largest error of a force by rounded positions that a plan accepts, relative to the smaller of load
# and release force [1]
FORCE_ERROR = 0.01
# of the force on a hand in written files where no device is named [N]; the weakest listed device
# bears 3.3 N at its peak
SAFE_FORCE = 3.0
# of the ring through the device's servo loop (Choi and Tan advise 5 to 10 kHz for textures)
_SAMPLES_PER_CYCLE = 10.0
# magnifications that are offered, 1 to 5000
_SCALES = tuple(mantissa * 10.0**decade for decade in range(4) for mantissa in (1.0, 2.0, 5.0))
_ROUNDING = 1e-9  # by which a figure may pass its limit, relative [1]
# Units of a plan's figures, at the end of their names
_UNITS = {
    "ball_radius": "m",
    "hand_travel": "m",
    "stiffness": "n_per_m",
    "critical_force": "n",
    "largest_force": "n",
    "force_limit": "n",
    "force_step": "n",
    "force_error": "relative",
    "ring_energy": "j",
    "ring_samples": "per_cycle",
}


class Figure(BaseModel, frozen=True, extra="forbid"):
    """One figure of a device.

    Attributes
    ----------
    value : float
        In SI units.
    source : str
        Where it stands.
    confidence : str
        ``measured``, ``datasheet``, ``code`` (of a public driver), ``remembered`` or ``assumed``.
    """

    value: float
    source: Annotated[str, Field(min_length=1, max_length=200)]
    confidence: Literal["measured", "datasheet", "code", "remembered", "assumed"]


_UNSTATED = {"source": "not stated", "confidence": "assumed"}


def _make_figure_validator(dimension: str) -> BeforeValidator:
    """Make a reader of a figure: a quantity, or a table of it with its source and confidence."""

    def read_figure(raw: object) -> object:
        """Return a figure as a table, its value in SI; a bare quantity has no source."""
        if not isinstance(raw, dict):
            raw = {"value": raw, **_UNSTATED}
        if "value" in raw:
            value = parse_quantity(raw["value"], dimension)
            if value <= 0.0:
                raise ValueError(f"value must be positive, got {raw['value']!r}")
            return {**raw, "value": value}
        return raw

    return BeforeValidator(read_figure)


Length = Annotated[Figure, _make_figure_validator("length")]
Force = Annotated[Figure, _make_figure_validator("force")]


class Device(BaseModel, frozen=True, extra="forbid"):
    """A force-feedback device; a figure that is not known is None.

    Attributes
    ----------
    id, name, maker : str
        As on the command line; what people call it; who makes it.
    position_resolution, travel : Figure
        Smallest step of the measured position; shortest side of the workspace [m].
    peak_force, continuous_force : Figure
        Largest force, and the largest that it can hold [N].
    stiffness_limit : Figure
        Stiffest spring that it renders stably [N/m].
    update_rate : Figure
        Of the servo loop [Hz].
    actuated_axes, sensed_axes : int
        Degrees of freedom.
    """

    id: Annotated[str, Field(pattern=r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$", max_length=40)]
    name: Annotated[str, Field(min_length=1, max_length=60)]
    maker: Annotated[str, Field(min_length=1, max_length=60)]
    position_resolution: Length
    peak_force: Force
    continuous_force: Force | None = None
    stiffness_limit: Annotated[Figure, _make_figure_validator("stiffness")] | None = None
    update_rate: Annotated[Figure, _make_figure_validator("frequency")]
    travel: Length | None = None
    actuated_axes: Annotated[int, Field(ge=1, le=12)]
    sensed_axes: Annotated[int, Field(ge=1, le=12)]


class _DeviceFile(BaseModel, extra="forbid"):
    device: Annotated[tuple[Device, ...], Field(min_length=1, max_length=500)]


def load_devices(path: str | Path | None = None) -> tuple[Device, ...]:
    """Read device profiles: the shipped ones, and those of a file of the user's."""
    sources = [Path(__file__).with_name("devices.toml")]
    if path is not None:
        sources.append(Path(path))
    by_id: dict[str, Device] = {}
    for source in sources:
        document = read_document(source, "a device file", HapticsError, _MAX_FILE_BYTES)
        declared = validate_file_data(_DeviceFile, document, source, HapticsError)
        by_id |= {device.id: device for device in declared.device}
    return tuple(by_id.values())


def get_device(device_id: str, devices: tuple[Device, ...]) -> Device:
    """Find a device by its id, or say which there are."""
    by_id = {device.id: device for device in devices}
    if device_id not in by_id:
        raise HapticsError(f"device must be one of {', '.join(by_id)}, got {device_id!r}")
    return by_id[device_id]


class Faithfulness(StrEnum):
    """What a device makes of a stimulus."""

    FAITHFUL = "renders faithfully"
    DEVIATES = "renders with deviations"
    IMPOSSIBLE = "does not render"


class RingRoute(StrEnum):
    """What makes the ring."""

    MOTORS = "motors"
    VOICE_COIL = "voice coil"
    NONE = "none"  # nothing rings


@dataclass(frozen=True)
class RenderingPlan:
    """How a device renders a stimulus.

    Attributes
    ----------
    device, stimulus : str
        What renders what.
    scale : float
        Magnification S of ball and step [1].
    ball_radius, stiffness : float
        S R [m]; k/S [N/m].
    critical_force : float
        F_px, the same at any scale [N]; not-a-number where the probe does not release.
    largest_force, force_limit : float
        On the hand at the release, pull and load together, or the load alone; at which the written
        files limit it [N].
    ring_energy : float
        Of the ring to inject, never scaled [J].
    force_step, force_error : float
        Of the rendered force, k q / S [N]; half of it over the smaller of load and release force
        [1].
    hand_travel : float
        How far the hand pulls before the release, S F_px / k [m].
    ring_route, ring_samples : RingRoute, float
        What makes the ring; samples in a cycle of the ring in the servo loop [1].
    verdict, reasons : Faithfulness, tuple of str
        What the device makes of it, and why, one clause each.
    """

    device: str
    stimulus: str
    scale: float
    ball_radius: float
    stiffness: float
    critical_force: float
    largest_force: float
    force_limit: float
    ring_energy: float
    force_step: float
    force_error: float
    hand_travel: float
    ring_route: RingRoute
    ring_samples: float
    verdict: Faithfulness = Faithfulness.FAITHFUL
    reasons: tuple[str, ...] = ()

    def as_record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in every name; None for what is not a number."""
        fields = asdict(self)
        fields["ring_route"] = self.ring_route.value
        fields["verdict"] = self.verdict.value
        fields["reasons"] = list(self.reasons)
        record = {}
        for name, value in replace_non_finite_by_none(fields).items():
            key = name
            if name in _UNITS:
                key = f"{name}_{_UNITS[name]}"
            record[key] = value
        return record

    def __str__(self) -> str:
        sentence = f"{self.device}, {self.stimulus}: {self.verdict.value} at scale {self.scale:g}"
        if not self.reasons:
            return sentence
        return f"{sentence}: {'; '.join(self.reasons)}"


def plan_rendering(
    device: Device, event: VibrationEvent, point: OperatingPoint, scale: float | None = None
) -> RenderingPlan:
    """Plan how a device renders one drag.

    Without a scale the plan takes the smallest at which the device follows the formula.
    """
    if scale is None:
        scale = _choose_smallest_scale(device, event, point)
    stiffness = point.tool.stiffness / scale
    force_step = stiffness * device.position_resolution.value
    ring_samples = device.update_rate.value / point.tool.frequency
    pulled_force = _replace_if_non_finite(event.critical_force, device.peak_force.value)
    plan = RenderingPlan(
        device=device.id,
        stimulus=event.stimulus,
        scale=scale,
        ball_radius=scale * point.ball_radius,
        stiffness=stiffness,
        critical_force=event.critical_force,
        largest_force=_compute_largest_force(event, point),
        force_limit=device.peak_force.value,
        ring_energy=event.energy,
        force_step=force_step,
        force_error=0.5 * force_step / _compute_smallest_force(event, point),
        hand_travel=scale * pulled_force / point.tool.stiffness,
        ring_route=_choose_ring_route(event, ring_samples),
        ring_samples=ring_samples,
    )
    refusals = _list_reasons_for_refusal(device, plan, point.normal_load)
    deviations = _list_deviations(device, plan, event)
    verdict = Faithfulness.FAITHFUL
    if refusals:
        verdict = Faithfulness.IMPOSSIBLE
    elif deviations:
        verdict = Faithfulness.DEVIATES
    return replace(plan, verdict=verdict, reasons=(*refusals, *deviations))


def _choose_ring_route(event: VibrationEvent, ring_samples: float) -> RingRoute:
    """Choose what makes the ring, by the samples that the servo loop has in a cycle of it."""
    if event.status is not Status.RELEASES:
        return RingRoute.NONE
    if ring_samples >= _SAMPLES_PER_CYCLE:
        return RingRoute.MOTORS
    return RingRoute.VOICE_COIL


def choose_common_scale(
    device: Device, drags: Sequence[tuple[VibrationEvent, OperatingPoint]]
) -> float:
    """Choose one magnification for a set: the largest that one of its drags needs.

    With one scale the travel of the hand does not tell heights apart. A larger scale never makes a
    stimulus impossible; what a device then loses of it stands in its plan.
    """
    return max(plan_rendering(device, *drag).scale for drag in drags)


def require_renderable(rendering_plans: Iterable[RenderingPlan | None]) -> None:
    """Refuse what a device does not render, all of it in one message."""
    refused = []
    for plan in rendering_plans:
        if plan is not None and plan.verdict is Faithfulness.IMPOSSIBLE:
            refused.append(plan)
    if not refused:
        return
    reasons = "; ".join(f"{plan.stimulus}: {', '.join(plan.reasons)}" for plan in refused)
    raise HapticsError(
        f"device {refused[0].device} does not render {reasons}; choose other stimuli (--only), a "
        "smaller load (--load) or another device"
    )


def _replace_if_non_finite(value: float, otherwise: float) -> float:
    """Return a value, or another where it is infinite or not a number."""
    if math.isfinite(value):
        return value
    return otherwise


def _get_limit_or_infinity(figure: Figure | None) -> float:
    """Return the value of a figure; infinite where the limit is not known."""
    if figure is None:
        return math.inf
    return figure.value


def _compute_smallest_force(event: VibrationEvent, point: OperatingPoint) -> float:
    """Find the smaller of load and release force [N]."""
    release_force = _replace_if_non_finite(event.critical_force, point.normal_load)
    return min(point.normal_load, release_force)


def _compute_largest_force(event: VibrationEvent, point: OperatingPoint) -> float:
    """Find the force on the hand at the release, pull and load together; else the load [N]."""
    release_force = _replace_if_non_finite(event.critical_force, 0.0)
    return math.hypot(release_force, point.normal_load)


def _choose_smallest_scale(device: Device, event: VibrationEvent, point: OperatingPoint) -> float:
    """Choose the smallest scale at which positions and spring fit and the hand can travel."""
    stiffness = point.tool.stiffness
    force_step = stiffness * device.position_resolution.value
    for_positions = 0.5 * force_step / (FORCE_ERROR * _compute_smallest_force(event, point))
    for_spring = stiffness / _get_limit_or_infinity(device.stiffness_limit)
    wanted = max(for_positions, for_spring)
    pulled_force = _replace_if_non_finite(event.critical_force, device.peak_force.value)
    largest = 0.5 * _get_limit_or_infinity(device.travel) * stiffness / pulled_force
    fitting = [scale for scale in _SCALES if scale <= largest] or [_SCALES[0]]
    for scale in fitting:
        if scale >= wanted * (1.0 - _ROUNDING):
            return scale
    return fitting[-1]


def _list_reasons_for_refusal(device: Device, plan: RenderingPlan, load: float) -> list[str]:
    """List why a device does not render a plan at all."""
    peak = device.peak_force.value
    stiffness_limit = _get_limit_or_infinity(device.stiffness_limit)
    reasons = []
    if load > peak:
        reasons.append(f"the load of {load:g} N exceeds its peak force of {peak:g} N")
    if plan.critical_force > peak:
        reasons.append(
            f"the release force of {plan.critical_force:.3g} N exceeds its peak force of "
            f"{peak:g} N: it would slip early"
        )
    elif plan.largest_force > peak and load <= peak:
        reasons.append(
            f"the force on the hand of {plan.largest_force:.3g} N, pull and load together, exceeds "
            f"its peak force of {peak:g} N: it would be clipped"
        )
    if plan.stiffness > stiffness_limit * (1.0 + _ROUNDING):
        reasons.append(
            f"the spring of {plan.stiffness:.4g} N/m exceeds its stiffness limit of "
            f"{stiffness_limit:.4g} N/m: a larger scale is needed"
        )
    return reasons


def _list_deviations(device: Device, plan: RenderingPlan, event: VibrationEvent) -> list[str]:
    """List what a device loses of a plan that it renders."""
    held_force = plan.largest_force
    continuous_force = _get_limit_or_infinity(device.continuous_force)
    travel_limit = _get_limit_or_infinity(device.travel)
    reasons = []
    if plan.force_error > FORCE_ERROR * (1.0 + _ROUNDING):
        reasons.append(
            f"positions rounded to {device.position_resolution.value * 1e6:g} um err by "
            f"{100.0 * plan.force_error:.2g} % of the force"
        )
    if event.status in (Status.LOCKED, Status.TOO_HIGH):
        reasons.append(f"the probe locks: the wall gives way above {device.peak_force.value:g} N")
    if held_force > continuous_force:
        reasons.append(
            f"{held_force:.3g} N exceed its continuous force of {continuous_force:g} N: short "
            "drags only"
        )
    if plan.hand_travel > travel_limit:
        reasons.append(
            f"the hand must travel {plan.hand_travel * 1e3:.3g} mm, more than its "
            f"{travel_limit * 1e3:g} mm"
        )
    if plan.ring_route is RingRoute.VOICE_COIL:
        reasons.append(
            f"the ring of {event.tool.frequency:g} Hz gets {plan.ring_samples:.1f} samples a "
            f"cycle at {device.update_rate.value:g} Hz and needs a voice coil"
        )
    if device.stiffness_limit is None:
        reasons.append("its stiffness limit is unknown")
    return reasons
