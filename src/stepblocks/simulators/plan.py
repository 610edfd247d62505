"""The rendering plan: at which scale a device can render a stimulus, and what of it gets lost.

Magnifying the ball and the step by S keeps angles, friction and forces; the spring becomes k/S. The device's position
step q then makes a force step of k q / S, and its rounding an error of half of that.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.simulators.devices import Device

# Largest error of a force by rounded positions that a plan accepts, relative to the smaller of load and release force
# [1]
FORCE_ERROR = 0.01
_SAMPLES_PER_CYCLE = 10.0  # of the ring through the device's servo loop (Choi and Tan advise 5 to 10 kHz for textures)
_SCALES = tuple(m * 10.0**e for e in range(4) for m in (1.0, 2.0, 5.0))


class Faithfulness(StrEnum):
    """What a device makes of a stimulus."""

    FAITHFUL = "renders faithfully"
    DEVIATES = "renders with deviations"
    IMPOSSIBLE = "does not render"


@dataclass(frozen=True)
class RenderingPlan:
    """How a device renders a stimulus."""

    device: str  # Which
    stimulus: str
    scale: float  # Magnification S of ball and step [1]
    ball_radius: float  # What the scene uses: S R [m] and k/S [N/m]
    stiffness: float
    critical_force: float  # F_px, the same at any scale [N]; not-a-number where the probe does not release
    ring_energy: float  # Energy of the ring to inject, never scaled [J]
    force_step: float  # Step of the rendered force, k q / S [N]
    force_error: float  # Half of it over the smaller of load and release force [1]
    hand_travel: float  # How far the hand pulls before the release, S F_px / k [m]
    ring_route: str  # ``"motors"``, ``"voice coil"`` or ``"none"`` where nothing rings
    ring_samples: float  # Samples per cycle of the ring in the device's servo loop [1]
    verdict: Faithfulness  # In a word
    reasons: tuple[str, ...]  # Why, one clause each; empty where it renders faithfully

    def as_record(self) -> dict[str, Any]:
        """Return plain values for JSON, the unit in every name; None for what is not a number."""
        units = {
            "ball_radius": "_m",
            "stiffness": "_n_per_m",
            "critical_force": "_n",
            "ring_energy": "_j",
            "force_step": "_n",
            "force_error": "_relative",
            "hand_travel": "_m",
            "ring_samples": "_per_cycle",
        }
        record = asdict(self) | {"verdict": self.verdict.value, "reasons": list(self.reasons)}
        return {
            name + units.get(name, ""): None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in record.items()
        }

    def __str__(self) -> str:
        """Say it in one line."""
        why = f": {'; '.join(self.reasons)}" if self.reasons else ""
        return f"{self.device}, {self.stimulus}: {self.verdict.value} at scale {self.scale:g}{why}"


def plan_rendering(
    device: Device, event: VibrationEvent, condition: OperatingPoint, scale: float | None = None
) -> RenderingPlan:
    """Plan how a device renders one drag over a stimulus.

    Examples
    --------
    See `tests/haptics/test_plan.py`: at scale 20 the rounding of a Touch is 0.7 % of the release force at 50 um.
    """
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise HapticsError(f"scale must be positive and finite, got {scale:g}")
    chosen = _choose(device, event, condition) if scale is None else scale
    k, q = condition.tool.stiffness / chosen, device.position_resolution.value
    smallest = min(condition.normal_load, _finite(event.critical_force, condition.normal_load))
    error = 0.5 * k * q / smallest
    travel = chosen * _finite(event.critical_force, device.peak_force.value) / condition.tool.stiffness
    samples = device.update_rate.value / event.frequency
    rings = event.status is Status.RELEASES
    coil = samples < _SAMPLES_PER_CYCLE
    refused = _refusals(device, event, condition, k)
    lost = _deviations(device, event, condition, k, error, travel, rings and coil)
    verdict = Faithfulness.IMPOSSIBLE if refused else Faithfulness.DEVIATES if lost else Faithfulness.FAITHFUL
    return RenderingPlan(
        device.id,
        event.stimulus,
        chosen,
        chosen * condition.ball_radius,
        k,
        event.critical_force,
        event.energy,
        k * q,
        error,
        travel,
        ("voice coil" if coil else "motors") if rings else "none",
        samples,
        verdict,
        (*refused, *lost),
    )


def _finite(value: float, otherwise: float) -> float:
    return value if math.isfinite(value) else otherwise


def _choose(device: Device, event: VibrationEvent, condition: OperatingPoint) -> float:
    k, q = condition.tool.stiffness, device.position_resolution.value
    smallest = min(condition.normal_load, _finite(event.critical_force, condition.normal_load))
    wanted = 0.5 * k * q / (FORCE_ERROR * smallest)
    if device.stiffness_limit is not None:
        wanted = max(wanted, k / device.stiffness_limit.value)
    force = _finite(event.critical_force, device.peak_force.value)
    most = math.inf if device.travel is None else 0.5 * device.travel.value * k / force
    fitting = [scale for scale in _SCALES if scale <= most] or [_SCALES[0]]
    return next((scale for scale in fitting if scale >= wanted * (1.0 - 1e-9)), fitting[-1])


def _refusals(device: Device, event: VibrationEvent, condition: OperatingPoint, k: float) -> tuple[str, ...]:
    peak, found = device.peak_force.value, []
    if condition.normal_load > peak:
        found.append(f"the load of {condition.normal_load:g} N exceeds its peak force of {peak:g} N")
    if event.critical_force > peak:
        found.append(
            f"the release force of {event.critical_force:.3g} N exceeds its peak force of {peak:g} N: it would slip early"
        )
    if device.stiffness_limit is not None and k > device.stiffness_limit.value * (1.0 + 1e-9):
        limit = device.stiffness_limit.value
        found.append(
            f"the spring of {k:.4g} N/m exceeds its stiffness limit of {limit:.4g} N/m: a larger scale is needed"
        )
    return tuple(found)


def _deviations(
    device: Device, event: VibrationEvent, condition: OperatingPoint, k: float, error: float, travel: float, coil: bool
) -> tuple[str, ...]:
    found = []
    if error > FORCE_ERROR * (1.0 + 1e-9):
        found.append(
            f"positions rounded to {device.position_resolution.value * 1e6:g} um err by {100.0 * error:.2g} % of the force"
        )
    if event.status in (Status.LOCKED, Status.TOO_HIGH):
        found.append(f"the probe locks: the wall gives way above {device.peak_force.value:g} N")
    held = max(condition.normal_load, _finite(event.critical_force, 0.0))
    if device.continuous_force is not None and held > device.continuous_force.value:
        found.append(
            f"{held:.3g} N exceed its continuous force of {device.continuous_force.value:g} N: short drags only"
        )
    if device.travel is not None and travel > device.travel.value:
        found.append(f"the hand must travel {travel * 1e3:.3g} mm, more than its {device.travel.value * 1e3:g} mm")
    if coil:
        rate, cycles = device.update_rate.value, device.update_rate.value / event.frequency
        found.append(
            f"the ring of {event.frequency:g} Hz gets {cycles:.1f} samples a cycle at {rate:g} Hz and needs a voice coil"
        )
    if device.stiffness_limit is None:
        found.append("its stiffness limit is unknown")
    return tuple(found)
