"""The vibration as an event: what rings, how strongly, in which direction, where and at which force.

After the release the tool is a spring that rings freely: its force is ``A exp(-t/T) sin(w t)`` with
``A = sqrt(2 k E_v)``, which by equation (1) is ``sqrt(C_v) F_px``. The damper spends ``E_v`` in all, so that a
recorded ring can be measured: ``E_v = 2 / (k T) (1 + 1/(w T)^2)`` times the integral of the force squared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status, release_at
from stepblocks.contact.operating_point import OperatingPoint

Array = NDArray[np.float64]
_LENGTH = 7.0  # of a rendered ring in time constants: all but 1e-6 of the energy


@dataclass(frozen=True, eq=False)
class Waveform:
    """A ring that was simulated in time, instead of the exponential."""

    force: Array  # shape (n,); Force on the hand in the direction of the drag [N], scaled so that `ring_energy` is E_v
    rate: float  # Its sampling rate [Hz]
    # From the release to its first sample [s]: the fall of the spring force, which the spring itself renders
    delay: float
    # Pulling force at the release [N] and energy of the ring [J] that the simulation found by itself
    simulated_peak: float
    simulated_energy: float
    factor: float  # What its force was multiplied by [1]


@dataclass(frozen=True)
class Learned:
    """What a model that a measured session has taught says of one drag."""

    status: str  # ``"ok"``, or why the prediction must not be trusted
    # Release force [N] and vibration energy [J], each with the bounds of its 95 % interval for a single trial
    peak_force: tuple[float, float, float]
    energy: tuple[float, float, float]


@dataclass(frozen=True)
class VibrationEvent:
    """The ring of one drag."""

    stimulus: str  # What is felt, and towards where: ``"+x"`` or ``"-x"`` of the part's frame
    drag: str
    status: Status  # Only a probe that releases rings; without a release, forces and energy are not-a-number
    direction: int  # +1 or -1: sign of the first half wave of the force on the hand along x, which is that of the drag
    trigger_position: float  # Position of the ball's centre across the edge at the release [m], unscaled
    trigger_height: float  # Its height over the part's z = 0 [m], unscaled
    critical_angle: float  # Slope of the path there [rad]
    critical_force: float  # Pulling force at which it releases [N]
    energy: float  # E_v [J]; never scaled
    frequency: float  # Of the ring [Hz], and the time constant of its amplitude [s]
    decay: float
    stiffness: float  # Of the tool [N/m]
    effective_mass: float  # The mass that rings at this frequency on this spring [kg]
    amplitude: float  # Of the force [N] at time 0, before decay
    acceleration: float  # Amplitude of the acceleration of the effective mass [m/s^2]
    waveform: Waveform | None = None  # A simulated ring of the same energy; None where it is the exponential
    # What a measured session has taught; energy, amplitude, frequency and decay are then its
    learned: Learned | None = None


def vibration_events(name: str, face: Counterface, point: OperatingPoint) -> tuple[VibrationEvent, VibrationEvent]:
    """Predict the rings of both drags over a counterface."""
    tool, path = point.tool, face.centre_path(point.ball_radius)
    mass = tool.effective_mass
    found = []
    for direction in (1, -1):
        x, z, angle = path.notch(float(direction))
        release = release_at(angle, point.normal_load, point.friction, tool)
        amplitude = math.sqrt(2.0 * tool.stiffness * release.vibration_energy)
        found.append(
            VibrationEvent(
                stimulus=name,
                drag="+x" if direction > 0 else "-x",
                status=release.status,
                direction=direction,
                trigger_position=x,
                trigger_height=z,
                critical_angle=angle,
                critical_force=release.pull_force,
                energy=release.vibration_energy,
                frequency=tool.frequency,
                decay=tool.decay_time,
                stiffness=tool.stiffness,
                effective_mass=mass,
                amplitude=amplitude,
                acceleration=amplitude / mass,
            )
        )
    return found[0], found[1]


def with_energy(event: VibrationEvent, energy: float) -> VibrationEvent:
    """Return an event that carries another energy."""
    amplitude = math.sqrt(2.0 * event.stiffness * energy)
    return replace(event, energy=energy, amplitude=amplitude, acceleration=amplitude / event.effective_mass)


def ring(event: VibrationEvent, rate: float) -> Array:
    """Render the ring as force samples."""
    if event.waveform is not None:
        known = np.arange(len(event.waveform.force)) / event.waveform.rate
        wanted = np.arange(math.floor(known[-1] * rate) + 1) / rate
        return np.asarray(np.interp(wanted, known, event.waveform.force))
    time = np.arange(math.ceil(_LENGTH * event.decay * rate)) / rate
    return np.asarray(event.amplitude * np.exp(-time / event.decay) * np.sin(math.tau * event.frequency * time))


def ring_energy(force: Array, rate: float, event: VibrationEvent) -> float:
    """Measure the energy of a rendered or recorded ring."""
    phase = math.tau * event.frequency * event.decay
    square = float(np.sum(np.asarray(force, dtype=np.float64) ** 2)) / rate
    return 2.0 / (event.stiffness * event.decay) * (1.0 + 1.0 / phase**2) * square


def as_record(event: VibrationEvent, scale: float = 1.0) -> dict[str, Any]:
    """Write an event as plain values for JSON, the unit in every name."""

    def known(value: float) -> float | None:
        return value if math.isfinite(value) else None

    record: dict[str, Any] = {
        "stimulus": event.stimulus,
        "drag": event.drag,
        "status": event.status.value,
        "direction_xyz": [event.direction, 0, 0],
        "trigger_position_m": event.trigger_position * scale,
        "trigger_height_m": event.trigger_height * scale,
        "critical_angle_deg": math.degrees(event.critical_angle),
        "critical_force_n": known(event.critical_force),
        "energy_j": known(event.energy),
        "frequency_hz": event.frequency,
        "decay_s": event.decay,
        "stiffness_n_per_m": event.stiffness,
        "effective_mass_kg": event.effective_mass,
        "amplitude_n": known(event.amplitude),
        "amplitude_m_per_s2": known(event.acceleration),
        "scale": scale,
        "waveform": "force on the hand along direction_xyz: amplitude_n exp(-t/decay_s) sin(2 pi frequency_hz t), t from the release",
        "energy_rule": "2/(stiffness_n_per_m decay_s) (1 + 1/(2 pi frequency_hz decay_s)^2) times the integral of force^2",
    }
    if event.waveform is not None:
        wave = event.waveform
        record |= {
            "waveform": "force on the hand along direction_xyz as in the WAV files, from the time-domain drag, scaled until its "
            "energy by energy_rule is energy_j; its first sample is simulated_delay_s after the release; amplitude, frequency and "
            "decay are those of the exponential of the same energy, which .hjif and .ahap hold",
            "simulated_delay_s": wave.delay,
            "simulated_peak_force_n": wave.simulated_peak,
            "simulated_energy_j": wave.simulated_energy,
            "simulated_factor": wave.factor,
        }
    if event.learned is not None:
        names = ("", "_low", "_high")
        record["learned"] = {
            "status": event.learned.status,
            **{f"peak_force{n}_n": known(v) for n, v in zip(names, event.learned.peak_force, strict=True)},
            **{f"energy{n}_j": known(v) for n, v in zip(names, event.learned.energy, strict=True)},
        }
    return record
