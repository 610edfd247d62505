"""Records of trials of known truth: by equations (1) and (2), or by a drag in time."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepblocks.bench.signal import Array, Tool, Trace
from stepblocks.bench.signal.rubbing import compute_rubbing_force
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import PipelineError

_LEAST_SLIDE, _MOST_SLIDE = 50e-3, 80e-3  # [s] before the edge
_OVERSAMPLING = 16  # a sensor is filtered on a finer clock than the converter's
_MOST_SAMPLES = 100_000_000  # of a record
_CLOCK_DIGITS = 9  # decimals of the instants of samples [s]
_SYMPATHETIC_PHASE = 0.25 * np.pi  # by which the normal force rings ahead of the tangential one


@dataclass(frozen=True)
class Truth:
    """What a trial is.

    Attributes
    ----------
    load : float
        Normal force [N].
    sliding_force : float
        Tangential force while sliding [N].
    slope : float
        Of the loading ramp [N/s].
    peak_force : float
        Tangential force at release [N].
    amplitude : float
        Of the ring at release [N].
    frequency : float
        Of the ring [Hz].
    decay_time : float
        Of the ring [s].
    sympathetic : float
        Amplitude of the normal force that rings along, per amplitude of the tangential one [1].
    gap : float
        Twice the friction that turns with the tip [N]; 0 for a ring without.
    release_decay : float
        Time in which the rest of the peak dies [s].
    """

    load: float
    sliding_force: float
    slope: float
    peak_force: float
    amplitude: float
    frequency: float
    decay_time: float
    sympathetic: float = 0.25
    gap: float = 0.0
    release_decay: float = 0.4e-3

    def compute_tangential_force(self, time_since_release: Array) -> Array:
        """Return the tangential force [N] at times since the release [s], shape (n,)."""
        remainder = self.peak_force - self.sliding_force - self.amplitude
        return self._compute_sliding_and_ringing_force(time_since_release) + remainder * np.exp(
            -time_since_release / self.release_decay
        )

    def _compute_sliding_and_ringing_force(self, time_since_release: Array) -> Array:
        """Return the ringing force about the sliding force [N]; see `compute_tangential_force`."""
        if self.gap > 0.0:
            start = (self.sliding_force + self.amplitude, -self.amplitude / self.decay_time)
            tool = Tool(self.frequency, self.decay_time)
            return compute_rubbing_force(
                time_since_release, self.sliding_force, self.gap, tool, start, self.slope
            )
        phase = 2.0 * math.pi * self.frequency * time_since_release
        ring = self.amplitude * np.exp(-time_since_release / self.decay_time) * np.cos(phase)
        return np.asarray(self.sliding_force + ring, dtype=float)

    def compute_normal_force(self, time_since_release: Array) -> Array:
        """Return the normal force [N] at times since the release [s], shape (n,)."""
        phase = 2.0 * math.pi * self.frequency * time_since_release
        fading = np.exp(-time_since_release / self.decay_time) * np.cos(phase + _SYMPATHETIC_PHASE)
        ring = self.sympathetic * self.amplitude * fading
        return np.asarray(self.load + ring, dtype=float)


class TimedTrace(NamedTuple):
    """A record with the instants of its onset and release [s]."""

    trace: Trace
    onset: float
    release: float


@dataclass(frozen=True)
class RecordedTrial:
    """A record and what is true of it.

    Attributes
    ----------
    trace : Trace
    peak_force : float
        Largest tangential force before the slip [N].
    amplitude : float
        First swing below sliding, carried back to the release by the damping of the tool [N].
    release : float
        Instant of the peak [s].
    """

    trace: Trace
    peak_force: float
    amplitude: float
    release: float


@dataclass(frozen=True)
class Rig:
    """What a rig adds.

    Attributes
    ----------
    sample_rate : float
        [Hz].
    noise : float
        Standard deviation of white noise [N].
    quantum : float
        Step of the converter [N]; 0 for none.
    hum : float
        Amplitude of the mains hum [N].
    mains : float
        Its frequency [Hz].
    drift : float
        Of both channels [N/s].
    start_up : float
        Amplitude of the ring when the handle starts [N].
    bandwidth : float
        Corner of a first-order sensor [Hz]; inf for an ideal one.
    tail : float
        Length of the record after the slip, in decay times.
    """

    sample_rate: float = 10e3
    noise: float = 4.5e-3
    quantum: float = 0.5e-3
    hum: float = 3e-3
    mains: float = 50.0
    drift: float = 0.0
    start_up: float = 0.0
    bandwidth: float = math.inf
    tail: float = 5.0

    @property
    def oversampling(self) -> int:
        """True values per sample: more than one where the sensor lags."""
        if math.isinf(self.bandwidth):
            return 1
        return _OVERSAMPLING

    def record_forces(
        self, tangential: Array, normal: Array, generator: np.random.Generator
    ) -> Trace:
        """Add to true forces what the rig adds.

        These are the lag of the sensor, hum, drift, noise and the steps of the converter.

        Parameters
        ----------
        tangential, normal : Array
            Shape (n * oversampling,), true forces [N].
        generator : Generator

        Returns
        -------
        Trace
            Of n samples.
        """
        count = tangential.size // self.oversampling
        time = np.round(np.arange(count) / self.sample_rate, _CLOCK_DIGITS)
        tangential = self._record_channel(time, tangential, generator)
        normal = self._record_channel(time, normal, generator)
        return Trace(time, tangential, normal)

    def _record_channel(self, time: Array, force: Array, generator: np.random.Generator) -> Array:
        """Return what one gauge shows of a true force [N] at the instants of its samples [s]."""
        if self.oversampling > 1:
            force = self._filter_by_sensor_lag(force)[:: self.oversampling]
        phase = generator.uniform(0.0, 2.0 * math.pi)
        hum = self.hum * np.sin(2.0 * np.pi * self.mains * time + phase)
        noise = self.noise * generator.standard_normal(time.size)
        shown: Array = force + hum + self.drift * time + noise
        if self.quantum > 0.0:
            shown = np.round(shown / self.quantum) * self.quantum
        return shown

    def _filter_by_sensor_lag(self, force: Array) -> Array:
        """Return a force as a sensor of first order follows it, on the fine clock."""
        from scipy.signal import lfilter

        rate = self.sample_rate * self.oversampling
        keep = math.exp(-2.0 * math.pi * self.bandwidth / rate)
        begin = np.array([keep * force[0]])
        filtered, _ = lfilter([1.0 - keep], [1.0, -keep], force, zi=begin)
        return np.asarray(filtered, dtype=float)

    def compute_start_up_ring(
        self, time: Array, tool: Tool, end: float, generator: np.random.Generator
    ) -> Array:
        """Return the ring when the handle starts [N], up to the edge at `end` [s]."""
        frequency, decay_time = tool
        phase = float(generator.uniform(0.0, 2.0 * math.pi))
        ring = np.exp(-time / decay_time) * np.cos(2.0 * np.pi * frequency * time + phase)
        return np.where(time < end, self.start_up * ring, 0.0)


def record_trial_by_equations(
    truth: Truth, rig: Rig, generator: np.random.Generator, gain: float = 1.0
) -> TimedTrace:
    """Record a trial of a truth on a rig.

    Parameters
    ----------
    truth : Truth
    rig : Rig
    generator : Generator
    gain : float
        Of the tangential channel [1].

    Raises
    ------
    PipelineError
        If the record would have too many samples.
    """
    onset = float(generator.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    release = onset + (truth.peak_force - truth.sliding_force) / truth.slope
    # the clock does not know of the events: their phase against it is any
    duration = release + rig.tail * truth.decay_time
    count = math.ceil(duration * rig.sample_rate) * rig.oversampling
    if count > _MOST_SAMPLES:
        raise PipelineError(
            f"a record must have at most 100 million samples, the plan asks for {count:.3g}"
        )
    time = np.arange(count) / (rig.sample_rate * rig.oversampling)
    tool = Tool(truth.frequency, truth.decay_time)
    loading = truth.slope * np.maximum(time - onset, 0.0)
    start_up = rig.compute_start_up_ring(time, tool, onset, generator)
    force = truth.sliding_force + loading + start_up
    after = time >= release
    since = time[after] - release
    force[after] = truth.compute_tangential_force(since)
    normal = np.full(count, truth.load)
    normal[after] = truth.compute_normal_force(since)
    return TimedTrace(rig.record_forces(gain * force, normal, generator), onset, release)


def record_trial_by_drag(
    step: Step,
    point: OperatingPoint,
    rig: Rig,
    generator: np.random.Generator,
    *,
    gain: float = 1.0,
    added_pull: float = 0.0,
    hardening: float = 0.0,
) -> RecordedTrial | None:
    """Record a drag in time over a step.

    Parameters
    ----------
    step : Step
    point : OperatingPoint
    rig : Rig
    generator : Generator
    gain : float
        Of the tangential channel [1].
    added_pull : float
        Steady force along the drag beside the tip's [N].
    hardening : float
        Cubic stiffness of the spring [N/m^3].

    Returns
    -------
    RecordedTrial or None
        None where the tip does not slip over.
    """
    from stepblocks.drag.probe import DragSettings, build_probe_of_tool
    from stepblocks.drag.ring import measure_ring
    from stepblocks.drag.simulate import simulate_drag
    from stepblocks.drag.track import build_track

    tool = point.tool
    slide = float(generator.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    settings = DragSettings.from_point(
        point,
        lead=point.speed * slide,
        ring_time=rig.tail * tool.decay_time,
        sample_rate=rig.sample_rate * rig.oversampling,
    )
    track = build_track(step, point.ball_radius)
    probe = build_probe_of_tool(tool, point.ball_radius, hardening=hardening)
    drag = simulate_drag(track, probe, settings)
    if drag.status is not Status.RELEASES:
        return None
    count = drag.rows.shape[0] // rig.oversampling * rig.oversampling
    time = drag.column("time_s")[:count]
    ring_of_tool = Tool(tool.frequency, tool.decay_time)
    start_up = rig.compute_start_up_ring(time, ring_of_tool, slide, generator)
    force = drag.column("fx_n")[:count] + added_pull + start_up
    trace = rig.record_forces(gain * force, drag.column("fy_n")[:count], generator)
    # the first swing below sliding comes half a period after the release
    damping = math.exp(math.pi / (math.tau * tool.frequency * tool.decay_time))
    amplitude = measure_ring(drag, with_spectra=False).amplitude * damping
    return RecordedTrial(trace, drag.peak_force + added_pull, amplitude, drag.release_time)
