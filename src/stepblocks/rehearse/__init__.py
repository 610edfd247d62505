"""Records of trials of known truth, in the layouts of laboratories."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from stepblocks.bench.signal import Array, Tool, Trace
from stepblocks.bench.signal.ring import compute_rubbing_force
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import PipelineError

_LEAST_SLIDE, _MOST_SLIDE = 50e-3, 80e-3  # [s] before the edge
_NAMES = ("time_s", "fx_n", "fy_n")
# where the traces of a session lie, by format
TRACE_FILES = {
    "csv": "traces/{trial:04d}.csv",
    "hdf5": "traces.h5",
}
_OVERSAMPLING = 16  # a sensor is filtered on a finer clock than the converter's

Write = Callable[[int, Trace], None]  # appends the trace of a trial


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
        return 1 if math.isinf(self.bandwidth) else _OVERSAMPLING

    def disturb(self, tangential: Array, normal: Array, random: np.random.Generator) -> Trace:
        """Add to true forces what the rig adds.

        These are the lag of the sensor, hum, drift, noise and the steps of the converter.
        """
        from scipy.signal import lfilter

        keep = math.exp(-2.0 * math.pi * self.bandwidth / (self.sample_rate * self.oversampling))
        count = tangential.size // self.oversampling
        time = np.round(np.arange(count) / self.sample_rate, 9)
        channels = []
        for values in (tangential, normal):
            if self.oversampling > 1:
                values = lfilter(
                    [1.0 - keep], [1.0, -keep], values, zi=np.array([keep * values[0]])
                )[0][:: self.oversampling]
            phase = random.uniform(0.0, 2.0 * math.pi)
            hum = self.hum * np.sin(2.0 * np.pi * self.mains * time + phase)
            noisy = values + hum + self.drift * time + self.noise * random.standard_normal(count)
            channels.append(
                np.round(noisy / self.quantum) * self.quantum if self.quantum > 0.0 else noisy
            )
        return Trace(time, *channels)


def record_trial(
    truth: Truth, rig: Rig, random: np.random.Generator, gain: float = 1.0
) -> tuple[Trace, float, float]:
    """Record a trial; with the instants of its onset and release [s]."""
    onset = float(random.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    release = onset + (truth.peak_force - truth.sliding_force) / truth.slope
    # the clock does not know of the events: their phase against it is any
    count = math.ceil((release + rig.tail * truth.decay_time) * rig.sample_rate) * rig.oversampling
    PipelineError.require(
        count <= 100_000_000,
        f"a record must have at most 100 million samples, the plan asks for {count:.3g}",
    )
    time = np.arange(count) / (rig.sample_rate * rig.oversampling)
    force = (
        truth.sliding_force
        + truth.slope * np.maximum(time - onset, 0.0)
        + _start_up_ring(rig, time, (truth.frequency, truth.decay_time), onset, random)
    )
    after = time >= release
    since = time[after] - release
    phase = 2.0 * math.pi * truth.frequency * since
    rest = truth.peak_force - truth.sliding_force - truth.amplitude
    ring = (
        compute_rubbing_force(
            since,
            truth.sliding_force,
            truth.gap,
            (truth.frequency, truth.decay_time),
            (truth.sliding_force + truth.amplitude, -truth.amplitude / truth.decay_time),
            truth.slope,
        )
        if truth.gap > 0.0
        else truth.sliding_force
        + truth.amplitude * np.exp(-since / truth.decay_time) * np.cos(phase)
    )
    force[after] = ring + rest * np.exp(-since / truth.release_decay)
    normal = np.full(count, truth.load)
    fading = np.exp(-since / truth.decay_time) * np.cos(phase + 0.25 * np.pi)
    normal[after] = truth.load + truth.sympathetic * truth.amplitude * fading
    return rig.disturb(gain * force, normal, random), onset, release


def _start_up_ring(
    rig: Rig, time: Array, tool: Tool, end: float, random: np.random.Generator
) -> Array:
    # Ring when the handle starts, up to the edge
    frequency, decay_time = tool
    phase = float(random.uniform(0.0, 2.0 * math.pi))
    ring = np.exp(-time / decay_time) * np.cos(2.0 * np.pi * frequency * time + phase)
    return np.where(time < end, rig.start_up * ring, 0.0)


def record_drag(
    step: Step,
    point: OperatingPoint,
    rig: Rig,
    random: np.random.Generator,
    *,
    gain: float = 1.0,
    pull: float = 0.0,
    hardening: float = 0.0,
) -> RecordedTrial | None:
    """Record a drag in time over a step; None where the tip does not slip over."""
    # `pull` is a steady force along the drag beside the tip's [N]; `hardening` the cubic stiffness
    # of the spring [N/m^3].
    from stepblocks.drag.probe import DragSettings, build_probe
    from stepblocks.drag.ring import measure_ring
    from stepblocks.drag.simulate import simulate_drag
    from stepblocks.drag.track import build_track

    tool = point.tool
    slide = float(random.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    settings = DragSettings.under(
        point,
        lead=point.speed * slide,
        ring_time=rig.tail * tool.decay_time,
        sample_rate=rig.sample_rate * rig.oversampling,
    )
    done = simulate_drag(
        build_track(step, point.ball_radius),
        build_probe(tool, point.ball_radius, hardening=hardening),
        settings,
    )
    if done.status is not Status.RELEASES:
        return None
    count = done.rows.shape[0] // rig.oversampling * rig.oversampling
    time = done.column("time_s")[:count]
    force = (
        done.column("fx_n")[:count]
        + pull
        + _start_up_ring(rig, time, (tool.frequency, tool.decay_time), slide, random)
    )
    trace = rig.disturb(gain * force, done.column("fy_n")[:count], random)
    amplitude = measure_ring(done, spectra=False).amplitude * math.exp(
        math.pi / (math.tau * tool.frequency * tool.decay_time)
    )
    return RecordedTrial(trace, done.peak_force + pull, amplitude, done.release_time)


@contextmanager
def open_writer(folder: Path, kind: str) -> Iterator[Write]:
    """Begin the traces of a session in an empty folder."""
    if kind == "csv":
        (folder / TRACE_FILES[kind]).parent.mkdir()
        yield lambda trial, trace: np.savetxt(
            folder / TRACE_FILES["csv"].format(trial=trial),
            np.column_stack([trace.time, trace.tangential, trace.normal]),
            fmt=("%.6f", "%.6g", "%.6g"),
            delimiter=",",
            header=",".join(_NAMES),
            comments="",
        )
        return
    # the first layout of HDF5, since an older library writes the time into later ones
    with h5py.File(folder / TRACE_FILES[kind], "w") as file:
        yield lambda trial, trace: _write_group(file.create_group(f"{trial:04d}"), trace)


def _write_group(group: "h5py.Group", trace: Trace) -> None:
    for name, values in zip(_NAMES, (trace.time, trace.tangential, trace.normal), strict=True):
        group.create_dataset(
            name, data=values.astype(np.float32), compression="gzip", track_times=False
        )
