"""Force-feedback devices as data: at which scale each renders a stimulus, and what it loses."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, Field

from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent, replace_nan_by_none
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.files.text import read_document
from stepblocks.mistakes import validate_data
from stepblocks.quantities import parse_quantity

_MAX_FILE_BYTES = 200_000
# largest error of a force by rounded positions that a plan accepts, relative to the smaller of load
# and release force [1]
FORCE_ERROR = 0.01
# of the ring through the device's servo loop (Choi and Tan advise 5 to 10 kHz for textures)
_SAMPLES_PER_CYCLE = 10.0
_SCALES = tuple(m * 10.0**e for e in range(4) for m in (1.0, 2.0, 5.0))
# Units of a plan's figures, at the end of their names
_UNITS = {
    "ball_radius": "m",
    "hand_travel": "m",
    "stiffness": "n_per_m",
    "critical_force": "n",
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
        ``datasheet``, ``code`` (of a public driver), ``remembered`` or ``assumed``.
    """

    value: float
    source: Annotated[str, Field(min_length=1, max_length=200)]
    confidence: Literal["datasheet", "code", "remembered", "assumed"]


def _make_figure_validator(dimension: str) -> BeforeValidator:
    def parse(raw: object) -> object:
        if isinstance(raw, dict) and "value" in raw:
            value = parse_quantity(raw["value"], dimension)
            if value <= 0.0:
                raise ValueError(f"value must be positive, got {raw['value']!r}")
            return {**raw, "value": value}
        return raw

    return BeforeValidator(parse)


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
    sources = [Path(__file__).with_name("devices.toml"), *([] if path is None else [Path(path)])]
    files = [
        validate_data(
            _DeviceFile,
            read_document(source, "a device file", HapticsError, _MAX_FILE_BYTES),
            source,
            HapticsError,
        )
        for source in sources
    ]
    return tuple({device.id: device for file in files for device in file.device}.values())


def find_device(name: str, devices: tuple[Device, ...]) -> Device:
    """Find a device by its id, or say which there are."""
    found = {device.id: device for device in devices}
    HapticsError.require(name in found, f"device must be one of {', '.join(found)}, got {name!r}")
    return found[name]


class Faithfulness(StrEnum):
    """What a device makes of a stimulus."""

    FAITHFUL = "renders faithfully"
    DEVIATES = "renders with deviations"
    IMPOSSIBLE = "does not render"


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
    ring_energy : float
        Of the ring to inject, never scaled [J].
    force_step, force_error : float
        Of the rendered force, k q / S [N]; half of it over the smaller of load and release force
        [1].
    hand_travel : float
        How far the hand pulls before the release, S F_px / k [m].
    ring_route, ring_samples : str, float
        ``motors``, ``voice coil``, or ``none`` where nothing rings; samples in a cycle of the ring
        in the servo loop [1].
    verdict, reasons : Faithfulness, tuple of str
        What the device makes of it, and why, one clause each.
    """

    device: str
    stimulus: str
    scale: float
    ball_radius: float
    stiffness: float
    critical_force: float
    ring_energy: float
    force_step: float
    force_error: float
    hand_travel: float
    ring_route: str
    ring_samples: float
    verdict: Faithfulness = Faithfulness.FAITHFUL
    reasons: tuple[str, ...] = ()

    def as_record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in every name; None for what is not a number."""
        record = replace_nan_by_none(
            asdict(self) | {"verdict": self.verdict.value, "reasons": list(self.reasons)}
        )
        return {
            f"{name}_{_UNITS[name]}" if name in _UNITS else name: value
            for name, value in record.items()
        }

    def __str__(self) -> str:
        why = f": {'; '.join(self.reasons)}" if self.reasons else ""
        return f"{self.device}, {self.stimulus}: {self.verdict.value} at scale {self.scale:g}{why}"


def plan_rendering(
    device: Device, event: VibrationEvent, point: OperatingPoint, scale: float | None = None
) -> RenderingPlan:
    """Plan how a device renders one drag.

    Without a scale the plan takes the smallest at which the device follows the formula.
    """
    chosen = _choose_scale(device, event, point) if scale is None else scale
    k = point.tool.stiffness / chosen
    q = device.position_resolution.value
    samples = device.update_rate.value / point.tool.frequency
    route = "motors" if samples >= _SAMPLES_PER_CYCLE else "voice coil"
    plan = RenderingPlan(
        device=device.id,
        stimulus=event.stimulus,
        scale=chosen,
        ball_radius=chosen * point.ball_radius,
        stiffness=k,
        critical_force=event.critical_force,
        ring_energy=event.energy,
        force_step=k * q,
        force_error=0.5 * k * q / _find_smallest_force(event, point),
        hand_travel=chosen
        * _replace_if_not_finite(event.critical_force, device.peak_force.value)
        / point.tool.stiffness,
        ring_route=route if event.status is Status.RELEASES else "none",
        ring_samples=samples,
    )
    refused = _list_refusals(device, plan, point.normal_load)
    lost = _list_deviations(device, plan, event, point.normal_load)
    possible = Faithfulness.DEVIATES if lost else Faithfulness.FAITHFUL
    return replace(
        plan,
        verdict=Faithfulness.IMPOSSIBLE if refused else possible,
        reasons=(*refused, *lost),
    )


def choose_common_scale(
    device: Device, drags: Sequence[tuple[VibrationEvent, OperatingPoint]]
) -> float:
    """Choose one magnification for a set: the largest that one of its drags needs.

    With one scale the travel of the hand does not tell heights apart. A larger scale never makes a
    stimulus impossible; what a device then loses of it stands in its plan.
    """
    return max(plan_rendering(device, *drag).scale for drag in drags)


def require_renderable(plans: Iterable[RenderingPlan | None]) -> None:
    """Refuse what a device does not render, all of it in one message."""
    refused = [plan for plan in plans if plan and plan.verdict is Faithfulness.IMPOSSIBLE]
    if refused:
        why = "; ".join(f"{plan.stimulus}: {', '.join(plan.reasons)}" for plan in refused)
        raise HapticsError(
            f"device {refused[0].device} does not render {why}; choose other stimuli (--only), a "
            "smaller load (--load) or another device"
        )


def _replace_if_not_finite(value: float, otherwise: float) -> float:
    return value if math.isfinite(value) else otherwise


def _take_value_or_infinity(figure: Figure | None) -> float:
    return math.inf if figure is None else figure.value


def _find_smallest_force(event: VibrationEvent, point: OperatingPoint) -> float:
    return min(point.normal_load, _replace_if_not_finite(event.critical_force, point.normal_load))


def _choose_scale(device: Device, event: VibrationEvent, point: OperatingPoint) -> float:
    k, q = point.tool.stiffness, device.position_resolution.value
    wanted = max(
        0.5 * k * q / (FORCE_ERROR * _find_smallest_force(event, point)),
        k / _take_value_or_infinity(device.stiffness_limit),
    )
    most = (
        0.5
        * _take_value_or_infinity(device.travel)
        * k
        / _replace_if_not_finite(event.critical_force, device.peak_force.value)
    )
    fitting = [scale for scale in _SCALES if scale <= most] or [_SCALES[0]]
    return next((scale for scale in fitting if scale >= wanted * (1.0 - 1e-9)), fitting[-1])


def _list_refusals(device: Device, plan: RenderingPlan, load: float) -> list[str]:
    # List why a device does not render a plan at all
    peak, force = device.peak_force.value, plan.critical_force
    limit = _take_value_or_infinity(device.stiffness_limit)
    rules = {
        f"the load of {load:g} N exceeds its peak force of {peak:g} N": load > peak,
        f"the release force of {force:.3g} N exceeds its peak force of {peak:g} N: it would slip "
        "early": force > peak,
        f"the spring of {plan.stiffness:.4g} N/m exceeds its stiffness limit of {limit:.4g} N/m: "
        "a larger scale is needed": plan.stiffness > limit * (1.0 + 1e-9),
    }
    return [reason for reason, holds in rules.items() if holds]


def _list_deviations(
    device: Device, plan: RenderingPlan, event: VibrationEvent, load: float
) -> list[str]:
    # List what a device loses of a plan that it renders
    resolution, peak = device.position_resolution.value, device.peak_force.value
    held = max(load, _replace_if_not_finite(event.critical_force, 0.0))
    lasting = _take_value_or_infinity(device.continuous_force)
    travel = plan.hand_travel
    most = _take_value_or_infinity(device.travel)
    locks = event.status in (Status.LOCKED, Status.TOO_HIGH)
    rules = {
        f"positions rounded to {resolution * 1e6:g} um err by {100.0 * plan.force_error:.2g} % of "
        "the force": plan.force_error > FORCE_ERROR * (1.0 + 1e-9),
        f"the probe locks: the wall gives way above {peak:g} N": locks,
        f"{held:.3g} N exceed its continuous force of {lasting:g} N: short drags only": held
        > lasting,
        f"the hand must travel {travel * 1e3:.3g} mm, more than its {most * 1e3:g} mm": travel
        > most,
        f"the ring of {event.tool.frequency:g} Hz gets {plan.ring_samples:.1f} samples a cycle at "
        f"{device.update_rate.value:g} Hz and needs a voice coil": plan.ring_route == "voice coil",
        "its stiffness limit is unknown": device.stiffness_limit is None,
    }
    return [reason for reason, holds in rules.items() if holds]
