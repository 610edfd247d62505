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

from stepblocks.contact.energy import Status, release_at
from stepblocks.haptics.condition import Condition
from stepblocks.haptics.renderer.path import Surface, centre_path

__all__ = [
    "DECAY",
    "FREQUENCY",
    "Learned",
    "RingLaw",
    "VibrationEvent",
    "Waveform",
    "as_record",
    "ring",
    "ring_energy",
    "vibration_events",
    "with_energy",
]

Array = NDArray[np.float64]
FREQUENCY = 300.0
"""Middle of the 250 to 350 Hz in which the explorer of the paper rings [Hz]."""
_BAND_SHARE, _HALF_BAND = 0.86, 50.0
DECAY = math.tan(0.5 * math.pi * _BAND_SHARE) / (math.tau * _HALF_BAND)
"""Time constant of the amplitude [s], 14.2 ms: the one whose spectrum has the 86 % of its energy in 250 to 350 Hz that
the paper reports (a decaying sine has a Lorentzian line); 89 % of the energy is then spent in the paper's 16 ms."""
_LENGTH = 7.0  # of a rendered ring in time constants: all but 1e-6 of the energy


@dataclass(frozen=True)
class RingLaw:
    """How the tool rings.

    Attributes
    ----------
    frequency, decay : float
        Frequency [Hz], and time constant of the amplitude [s].
    """

    frequency: float = FREQUENCY
    decay: float = DECAY


@dataclass(frozen=True, eq=False)
class Waveform:
    """A ring that was simulated in time, instead of the exponential.

    Attributes
    ----------
    force : ndarray, shape (n,)
        Force on the hand in the direction of the drag [N], scaled so that `ring_energy` is E_v.
    rate : float
        Its sampling rate [Hz].
    delay : float
        From the release to its first sample [s]: the fall of the spring force, which the spring itself renders.
    simulated_peak, simulated_energy : float
        Pulling force at the release [N] and energy of the ring [J] that the simulation found by itself.
    factor : float
        What its force was multiplied by [1].
    """

    force: Array
    rate: float
    delay: float
    simulated_peak: float
    simulated_energy: float
    factor: float


@dataclass(frozen=True)
class Learned:
    """What a model that a measured session has taught says of one drag.

    Attributes
    ----------
    status : str
        ``"ok"``, or why the prediction must not be trusted.
    peak_force, energy : tuple of float
        Release force [N] and vibration energy [J], each with the bounds of its 95 % interval for a single trial.
    """

    status: str
    peak_force: tuple[float, float, float]
    energy: tuple[float, float, float]


@dataclass(frozen=True)
class VibrationEvent:
    """The ring of one drag.

    Attributes
    ----------
    stimulus, drag : str
        What is felt, and towards where: ``"+x"`` or ``"-x"`` of the part's frame.
    status : Status
        Only a probe that releases rings; without a release, forces and energy are not-a-number.
    direction : int
        +1 or -1: sign of the first half wave of the force on the hand along x, which is that of the drag.
    trigger_position : float
        Position of the ball's centre across the edge at the release [m], unscaled.
    trigger_height : float
        Its height over the part's z = 0 [m], unscaled.
    critical_angle : float
        Slope of the path there [rad].
    critical_force : float
        Pulling force at which it releases [N].
    energy : float
        E_v [J]; never scaled.
    frequency, decay : float
        Of the ring [Hz], and the time constant of its amplitude [s].
    stiffness : float
        Of the tool [N/m].
    effective_mass : float
        The mass that rings at this frequency on this spring [kg].
    amplitude : float
        Of the force [N] at time 0, before decay.
    acceleration : float
        Amplitude of the acceleration of the effective mass [m/s^2].
    waveform : Waveform or None
        A simulated ring of the same energy; None where it is the exponential.
    learned : Learned or None
        What a measured session has taught; energy, amplitude, frequency and decay are then its.
    """

    stimulus: str
    drag: str
    status: Status
    direction: int
    trigger_position: float
    trigger_height: float
    critical_angle: float
    critical_force: float
    energy: float
    frequency: float
    decay: float
    stiffness: float
    effective_mass: float
    amplitude: float
    acceleration: float
    waveform: Waveform | None = None
    learned: Learned | None = None


def vibration_events(
    stimulus: Surface, condition: Condition, law: RingLaw | None = None
) -> tuple[VibrationEvent, VibrationEvent]:
    """Predict the rings of both drags over a stimulus.

    Parameters
    ----------
    stimulus : StepBlock, MarginBlock or CrownOnTooth
        The stimulus.
    condition : Condition
        Ball, load, friction, tool.
    law : RingLaw, optional
        Frequency and decay of the ring; the paper's where omitted.

    Returns
    -------
    up, down : VibrationEvent
        Towards +x, and towards -x.
    """
    frequency, decay = (law or RingLaw()).frequency, (law or RingLaw()).decay
    path = centre_path(stimulus, condition.ball_radius)
    stiffness = condition.tool.stiffness
    mass = stiffness / (math.tau * frequency) ** 2
    found = []
    for direction in (1, -1):
        x, z, angle = path.notch(float(direction))
        release = release_at(angle, condition.normal_load, condition.friction, condition.tool)
        amplitude = math.sqrt(2.0 * stiffness * release.vibration_energy)
        found.append(
            VibrationEvent(stimulus.id, "+x" if direction > 0 else "-x", release.status, direction, x, z, angle,
                           release.pull_force, release.vibration_energy, frequency, decay, stiffness, mass,
                           amplitude, amplitude / mass)
        )  # fmt: skip
    return found[0], found[1]


def with_energy(event: VibrationEvent, energy: float) -> VibrationEvent:
    """Return an event that carries another energy.

    Parameters
    ----------
    event : VibrationEvent
        One that releases.
    energy : float
        E_v [J].

    Returns
    -------
    VibrationEvent
        Amplitudes follow the energy.
    """
    amplitude = math.sqrt(2.0 * event.stiffness * energy)
    return replace(event, energy=energy, amplitude=amplitude, acceleration=amplitude / event.effective_mass)


def ring(event: VibrationEvent, rate: float) -> Array:
    """Render the ring as force samples.

    Parameters
    ----------
    event : VibrationEvent
        One that releases.
    rate : float
        Sampling rate [Hz].

    Returns
    -------
    ndarray, shape (n,)
        Force along the drag [N], from the release until all but a millionth of the energy is spent; of a simulated ring
        from its first swing.
    """
    if event.waveform is not None:
        known = np.arange(len(event.waveform.force)) / event.waveform.rate
        wanted = np.arange(math.floor(known[-1] * rate) + 1) / rate
        return np.asarray(np.interp(wanted, known, event.waveform.force))
    time = np.arange(math.ceil(_LENGTH * event.decay * rate)) / rate
    return np.asarray(event.amplitude * np.exp(-time / event.decay) * np.sin(math.tau * event.frequency * time))


def ring_energy(force: Array, rate: float, event: VibrationEvent) -> float:
    """Measure the energy of a rendered or recorded ring.

    Parameters
    ----------
    force : ndarray, shape (n,)
        Samples [N].
    rate : float
        Sampling rate [Hz].
    event : VibrationEvent
        Its spring, frequency and decay say what the force means.

    Returns
    -------
    float
        Energy that the ring spends [J].
    """
    phase = math.tau * event.frequency * event.decay
    square = float(np.sum(np.asarray(force, dtype=np.float64) ** 2)) / rate
    return 2.0 / (event.stiffness * event.decay) * (1.0 + 1.0 / phase**2) * square


def as_record(event: VibrationEvent, scale: float = 1.0) -> dict[str, Any]:
    """Write an event as plain values for JSON, the unit in every name.

    Parameters
    ----------
    event : VibrationEvent
        The event.
    scale : float
        Magnification S of the scene: positions grow with it, force and energy do not.

    Returns
    -------
    dict
        None where a probe that does not release has no value.
    """

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
