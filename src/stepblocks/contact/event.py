"""The vibration as an event: a free ring of the tool, of which its damper spends E_v in all."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface, convert_to_counterface
from stepblocks.contact.domain import Scanned
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.path.centre import CentrePath

_LENGTH = 7.0  # of a rendered ring in time constants: all but 1e-6 of the energy
_EXPONENTIAL = (
    "force on the hand along direction_xyz: amplitude_n exp(-t/decay_s) sin(2 pi frequency_hz "
    "t), t from the release"
)
_SIMULATED = (
    "force on the hand along direction_xyz as in the WAV files, from the time-domain drag, scaled "
    "until its energy by energy_rule is energy_j; its first sample is simulated_delay_s after the "
    "release; amplitude, frequency and decay are those of the exponential of the same energy"
)
_RULE = (
    "2/(stiffness_n_per_m decay_s) (1 + 1/(2 pi frequency_hz decay_s)^2) times the integral of "
    "force^2"
)


@dataclass(frozen=True, eq=False)
class Waveform:
    """A ring that was simulated in time, instead of the exponential."""

    # shape (n,), on the hand in the direction of the drag [N], scaled so that `compute_ring_energy`
    # is E_v
    force: Array
    rate: float  # of its samples [Hz]
    # from the release to the first sample [s]: the fall of the spring force, which the spring
    # renders
    delay: float
    simulated_peak: float  # pulling force at the release [N] that the simulation found by itself
    simulated_energy: float  # of the ring [J], likewise
    factor: float  # that its force was multiplied by [1]


@dataclass(frozen=True)
class LearnedPrediction:
    """What a model that was learned from a session says of one drag."""

    status: str  # "ok", or why the prediction must not be trusted
    # at the release [N], with the bounds of 95 % of single trials
    peak_force: tuple[float, float, float]
    energy: tuple[float, float, float]  # of the vibration [J], likewise


@dataclass(frozen=True)
class VibrationEvent:
    """The ring of one drag; only a probe that releases rings.

    Otherwise forces and energy are not-a-number.

    Attributes
    ----------
    stimulus : str
        What is felt.
    status : Status
        What becomes of the probe.
    direction : int
        Of the drag along x, +1 or -1, and of the first half wave of the force on the hand.
    trigger_position, trigger_height : float
        Of the centre of the ball across the edge at the release, and over z = 0 [m], unscaled.
    critical_angle : float
        Slope of the path there [rad].
    critical_force : float
        Pulling force at which the probe releases [N].
    energy : float
        E_v [J], never scaled.
    tool : Tool
        The spring that rings.
    waveform : Waveform, optional
        A simulated ring of the same energy; None where it is the exponential.
    learned : LearnedPrediction, optional
        Where a model of a session predicts: energy and tool are then those of that model.
    """

    stimulus: str
    status: Status
    direction: int
    trigger_position: float = field(repr=False)
    trigger_height: float = field(repr=False)
    critical_angle: float = field(repr=False)
    critical_force: float
    energy: float
    tool: Tool = field(repr=False)
    waveform: Waveform | None = field(default=None, repr=False)
    learned: LearnedPrediction | None = field(default=None, repr=False)

    @property
    def drag(self) -> str:
        """Towards where, in the part's frame."""
        if self.direction > 0:
            return "+x"
        return "-x"

    @property
    def amplitude(self) -> float:
        """Of the force at time 0, before decay [N]."""
        return math.sqrt(2.0 * self.tool.stiffness * self.energy)


Events = tuple[VibrationEvent, VibrationEvent]  # of the drags towards +x and -x


def list_vibration_events(
    face: Counterface | Scanned, point: OperatingPoint, stimulus: str = ""
) -> Events:
    """Predict the rings of both drags over a counterface, by equations (1) and (2).

    Parameters
    ----------
    face : Counterface or ScannedProfile
        What is dragged over under `point`; every part answers `counterface()`.
    stimulus : str
        What the events shall be called.

    Returns
    -------
    tuple of VibrationEvent
        Of the drag towards +x, and of the one towards -x.

    Raises
    ------
    ContactError
        If the ball is too large for the profile, or the profile has too many corners.
    """
    path = convert_to_counterface(face).centre_path(point.ball_radius)
    forward = _predict_event(path, point, stimulus, +1)
    backward = _predict_event(path, point, stimulus, -1)
    return forward, backward


def _predict_event(
    path: CentrePath, point: OperatingPoint, stimulus: str, direction: int
) -> VibrationEvent:
    """Predict the ring of one drag along a path of the ball's centre."""
    notch = path.find_notch(direction)
    release = find_release(notch.angle, point.normal_load, point.friction, point.tool)
    return VibrationEvent(
        stimulus,
        release.status,
        direction,
        trigger_position=notch.x,
        trigger_height=notch.z,
        critical_angle=notch.angle,
        critical_force=release.pull_force,
        energy=release.vibration_energy,
        tool=point.tool,
    )


def compute_ring_force(event: VibrationEvent, rate: float) -> Array:
    """Force on the hand in the direction of the drag [N], sampled at a rate [Hz].

    It lasts for seven time constants, or for the length of the waveform.
    """
    if event.waveform is not None:
        simulated = event.waveform.force
        times = np.arange(len(simulated)) / event.waveform.rate
        count = math.floor(times[-1] * rate) + 1
        wanted = np.arange(count) / rate
        return np.asarray(np.interp(wanted, times, simulated))
    tool = event.tool
    count = math.ceil(_LENGTH * tool.decay_time * rate)
    time = np.arange(count) / rate
    envelope = event.amplitude * np.exp(-time / tool.decay_time)
    oscillation = np.sin(math.tau * tool.frequency * time)
    return np.asarray(envelope * oscillation)


def compute_ring_energy(force: ArrayLike, rate: float, tool: Tool) -> float:
    """Energy that the damper spends on a rendered or recorded ring [J].

    The ring is a force [N], sampled at a rate [Hz].
    """
    phase = math.tau * tool.frequency * tool.decay_time
    samples = np.asarray(force, dtype=np.float64)
    integral = float(np.sum(samples**2)) / rate  # of the square [N^2 s]
    energy_per_square = 2.0 / (tool.stiffness * tool.decay_time)  # [J/(N^2 s)]
    return energy_per_square * (1.0 + 1.0 / phase**2) * integral


def build_event_record(event: VibrationEvent, scale: float = 1.0) -> dict[str, object]:
    """Describe an event as plain values for JSON, the unit in every name.

    What is not a number is written as None.
    """
    tool = event.tool
    limit = math.nan
    if event.status.is_beyond_limit:
        limit = tool.limits.first.force
    waveform = _SIMULATED
    if event.waveform is None:
        waveform = _EXPONENTIAL
    record = {
        **_make_release_fields(event, scale),
        **_make_frequency_fields(tool),
        "limit_n": limit,
        "decay_s": tool.decay_time,
        "stiffness_n_per_m": tool.stiffness,
        "effective_mass_kg": tool.effective_mass,
        "amplitude_n": event.amplitude,
        "amplitude_m_per_s2": event.amplitude / tool.effective_mass,
        "scale": scale,
        "waveform": waveform,
        "energy_rule": _RULE,
    }
    if event.waveform is not None:
        record |= _make_waveform_fields(event.waveform)
    if event.learned is not None:
        record["learned"] = replace_non_finite_by_none(_make_learned_fields(event.learned))
    return replace_non_finite_by_none(record)


def _make_release_fields(event: VibrationEvent, scale: float) -> dict[str, object]:
    """Describe where and how the probe releases, lengths magnified by a scale."""
    shown_position = event.trigger_position * scale
    shown_height = event.trigger_height * scale
    return {
        "stimulus": event.stimulus,
        "drag": event.drag,
        "status": event.status.value,
        "direction_xyz": [event.direction, 0, 0],
        "trigger_position_m": shown_position,
        "trigger_height_m": shown_height,
        "critical_angle_deg": math.degrees(event.critical_angle),
        "critical_force_n": event.critical_force,
        "energy_j": event.energy,
    }


def _make_frequency_fields(tool: Tool) -> dict[str, object]:
    """Describe the frequency of a ring and its limits."""
    return {
        "frequency_hz": tool.frequency,
        "frequency_low_hz": tool.frequency - tool.frequency_deviation,
        "frequency_high_hz": tool.frequency + tool.frequency_deviation,
    }


def _make_waveform_fields(waveform: Waveform) -> dict[str, object]:
    """Describe where a simulated ring comes from."""
    return {
        "simulated_delay_s": waveform.delay,
        "simulated_peak_force_n": waveform.simulated_peak,
        "simulated_energy_j": waveform.simulated_energy,
        "simulated_factor": waveform.factor,
    }


def _make_learned_fields(learned: LearnedPrediction) -> dict[str, object]:
    """Describe what a model of a session predicts, each figure with its bounds."""
    force, force_low, force_high = learned.peak_force
    energy, energy_low, energy_high = learned.energy
    return {
        "status": learned.status,
        "peak_force_n": force,
        "peak_force_low_n": force_low,
        "peak_force_high_n": force_high,
        "energy_j": energy,
        "energy_low_j": energy_low,
        "energy_high_j": energy_high,
    }


def replace_non_finite_by_none(record: dict[str, object]) -> dict[str, object]:
    """Return a record with None for every number that is infinite or NaN."""
    replaced = dict(record)
    for name, value in record.items():
        if isinstance(value, float) and not math.isfinite(value):
            replaced[name] = None
    return replaced
