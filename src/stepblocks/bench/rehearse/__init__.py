"""Records of trials of known truth, as a rig would have written them, in the layouts that laboratories keep."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.bench.signal import Array, Tool, Trace
from stepblocks.bench.signal.rubbing_ring import rubbing_force
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import BenchError

_LEAST_SLIDE, _MOST_SLIDE = 50e-3, 80e-3  # [s] before the edge
_NAMES = ("time_s", "fx_n", "fy_n")
_MAT_HEADER = b"MATLAB 5.0 MAT-file, written by stepblocks"
_OVERSAMPLING = 16  # a sensor is filtered on a finer clock than the converter's

Write = Callable[[int, Trace], None]  # appends the trace of a trial


@dataclass(frozen=True)
class Truth:
    """What a trial is."""

    load: float  # normal force [N]
    sliding_force: float  # tangential force while sliding [N]
    slope: float  # of the loading ramp [N/s]; of one that hardens, that of the unstretched spring
    peak_force: float  # tangential force at release [N]
    amplitude: float  # of the ring at release [N]
    frequency: float  # of the ring [Hz]
    decay_time: float  # of the ring [s]
    sympathetic: float = 0.25  # amplitude of the normal force that rings along, per amplitude of the tangential one [1]
    gap: float = 0.0  # twice the friction that turns with the tip [N]; 0 for a ring without
    release_decay: float = 0.4e-3  # time in which the rest of the peak dies [s]
    hardening: float = 0.0  # g of ``F = u + g u^3``, where u is the force had the spring not hardened [1/N^2]

    def softened(self, force: float) -> float:
        """Return the force had the spring not hardened [N]: the real root, by Viete's hyperbolic sine."""
        if not self.hardening:
            return force
        root = math.sqrt(3.0 * self.hardening)
        return 2.0 / root * math.sinh(math.asinh(1.5 * force * root) / 3.0)


@dataclass(frozen=True)
class RecordedTrial:
    """A record and what is true of it."""

    trace: Trace
    peak_force: float  # largest tangential force before the slip [N]
    amplitude: float  # first swing below sliding, carried back to the release by the damping of the tool [N]
    release: float  # instant of the peak [s]


@dataclass(frozen=True)
class Rig:
    """What a rig adds."""

    sample_rate: float = 10e3  # [Hz]
    noise: float = 4.5e-3  # standard deviation of white noise [N]
    quantum: float = 0.5e-3  # step of the converter [N]; 0 for none
    hum: float = 3e-3  # amplitude of the mains hum [N]
    mains: float = 50.0  # its frequency [Hz]
    drift: float = 0.0  # of both channels [N/s]
    start_up: float = 0.0  # amplitude of the ring when the handle starts [N]
    bandwidth: float = math.inf  # corner of a first-order sensor [Hz]; inf for an ideal one
    tail: float = 5.0  # length of the record after the slip, in decay times

    @property
    def oversampling(self) -> int:
        """True values per sample: more than one where the sensor lags."""
        return 1 if math.isinf(self.bandwidth) else _OVERSAMPLING

    def disturb(self, tangential: Array, normal: Array, random: np.random.Generator) -> Trace:
        """Put on true forces what the rig adds: the sensor's lag, hum, drift, noise, the steps of the converter."""
        from scipy.signal import lfilter

        keep = math.exp(-2.0 * math.pi * self.bandwidth / (self.sample_rate * self.oversampling))
        count = tangential.size // self.oversampling
        time = np.round(np.arange(count) / self.sample_rate, 9)
        channels = []
        for values in (tangential, normal):
            if self.oversampling > 1:
                values = lfilter([1.0 - keep], [1.0, -keep], values, zi=np.array([keep * values[0]]))[0]
                values = values[:: self.oversampling]
            phase = random.uniform(0.0, 2.0 * math.pi)
            hum = self.hum * np.sin(2.0 * np.pi * self.mains * time + phase)
            noisy = values + hum + self.drift * time + self.noise * random.standard_normal(count)
            channels.append(np.round(noisy / self.quantum) * self.quantum if self.quantum > 0.0 else noisy)
        return Trace(time, *channels)


def record(truth: Truth, rig: Rig, random: np.random.Generator, gain: float = 1.0) -> tuple[Trace, float, float]:
    """Record a trial; with the instants of its onset and release [s]."""
    onset = float(random.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    sliding = truth.softened(truth.sliding_force)
    release = onset + (truth.softened(truth.peak_force) - sliding) / truth.slope
    # the clock does not know of the events: their phase against it is any
    count = math.ceil((release + rig.tail * truth.decay_time) * rig.sample_rate) * rig.oversampling
    time = np.arange(count) / (rig.sample_rate * rig.oversampling)
    force = sliding + truth.slope * np.maximum(time - onset, 0.0)
    force = force + truth.hardening * force**3 if truth.hardening else force
    force = force + _start_up(rig, time, (truth.frequency, truth.decay_time), onset, random)
    after = time >= release
    since = time[after] - release
    rest = truth.peak_force - truth.sliding_force - truth.amplitude
    if truth.hardening:
        ring = _duffing_ring(since, truth)
    elif truth.gap > 0.0:
        start = (truth.sliding_force + truth.amplitude, -truth.amplitude / truth.decay_time)
        tool = truth.frequency, truth.decay_time
        ring = rubbing_force(since, truth.sliding_force, truth.gap, tool, start, truth.slope)
    else:
        swing = truth.amplitude * np.exp(-since / truth.decay_time) * np.cos(2.0 * math.pi * truth.frequency * since)
        ring = truth.sliding_force + swing
    force[after] = ring + rest * np.exp(-since / truth.release_decay)
    normal = np.full(count, truth.load)
    phase = 2.0 * np.pi * truth.frequency * since + 0.25 * np.pi
    size = truth.sympathetic * truth.amplitude
    normal[after] = truth.load + size * np.exp(-since / truth.decay_time) * np.cos(phase)
    return rig.disturb(gain * force, normal, random), onset, release


def _duffing_ring(since: Array, truth: Truth) -> Array:
    """Force of a tool that hardens, let go at its amplitude, by the equation of motion."""
    from scipy.integrate import solve_ivp

    square, loss = (2.0 * math.pi * truth.frequency) ** 2, 2.0 / truth.decay_time

    def motion(_: float, state: Array) -> list[float]:
        force = state[0] + truth.hardening * state[0] ** 3
        return [state[1], -square * (force - truth.sliding_force) - loss * state[1]]

    rest = truth.softened(truth.sliding_force)
    begin = truth.softened(truth.sliding_force + truth.amplitude)
    start = [begin, -(begin - rest) / truth.decay_time]
    u = solve_ivp(motion, (0.0, float(since[-1])), start, "DOP853", since, rtol=1e-9, atol=1e-9).y[0]
    return np.asarray(u + truth.hardening * u**3, dtype=float)


def _start_up(rig: Rig, time: Array, tool: Tool, end: float, random: np.random.Generator) -> Array:
    """Ring when the handle starts, up to the edge."""
    (frequency, decay_time), phase = tool, float(random.uniform(0.0, 2.0 * math.pi))
    ring = np.exp(-time / decay_time) * np.cos(2.0 * np.pi * frequency * time + phase)
    return np.where(time < end, rig.start_up * ring, 0.0)


def drag_trial(
    step: Step,
    point: OperatingPoint,
    rig: Rig,
    random: np.random.Generator,
    *,
    gain: float = 1.0,
    pull: float = 0.0,
    hardening: float = 0.0,
) -> RecordedTrial | None:
    """Record a drag in time over a step; None where the tip does not slip over.

    `pull` is a steady force along the drag beside the tip's [N]; `hardening` the cubic stiffness of the spring [N/m^3].
    """
    from stepblocks.drag.ring import ring_of
    from stepblocks.drag.simulate import DragSettings, probe_for, simulate
    from stepblocks.drag.track import track_over

    tool, omega = point.tool, 2.0 * math.pi * point.tool.frequency
    slide = float(random.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    settings = DragSettings.under(
        point,
        lead=point.speed * slide,
        ring_time=rig.tail * tool.decay_time,
        sample_rate=rig.sample_rate * rig.oversampling,
    )
    probe = probe_for(tool, point.ball_radius, hardening=hardening)
    done = simulate(track_over(step, point.ball_radius), probe, settings)
    if done.status is not Status.RELEASES:
        return None
    ring = ring_of(done, spectra=False)
    count = done.rows.shape[0] // rig.oversampling * rig.oversampling
    time = done.column("time_s")[:count]
    force = done.column("fx_n")[:count] + pull
    force = force + _start_up(rig, time, (tool.frequency, tool.decay_time), slide, random)
    trace = rig.disturb(gain * force, done.column("fy_n")[:count], random)
    amplitude = ring.amplitude * math.exp(math.pi / (omega * tool.decay_time))
    return RecordedTrial(trace, done.peak_force + pull, amplitude, done.release_time)


def open_writer(folder: Path, kind: str) -> AbstractContextManager[Write]:
    """Begin the traces of a session in an empty folder."""
    if kind not in _WRITERS:
        raise BenchError(f"`format` must be one of {', '.join(_WRITERS)}, got {kind!r}")
    return _WRITERS[kind](folder / TRACE_FILES[kind])


def _csv(pattern: Path) -> AbstractContextManager[Write]:
    pattern.parent.mkdir()

    def write(trial: int, trace: Trace) -> None:
        table = np.column_stack([trace.time, trace.tangential, trace.normal])
        path = str(pattern).format(trial=trial)
        np.savetxt(path, table, fmt=("%.6f", "%.6g", "%.6g"), delimiter=",", header=",".join(_NAMES), comments="")

    return nullcontext(write)


@contextmanager
def _hdf5(path: Path) -> Iterator[Write]:
    import h5py

    with h5py.File(path, "w", libver="latest") as file:

        def write(trial: int, trace: Trace) -> None:
            group = file.create_group(f"{trial:04d}")
            for name, values in _columns(trace).items():
                group.create_dataset(name, data=values, compression="gzip", track_times=False)

        yield write


@contextmanager
def _tdms(path: Path) -> Iterator[Write]:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(str(path)) as file:
        yield lambda trial, trace: file.write_segment(
            [ChannelObject(f"{trial:04d}", name, values) for name, values in _columns(trace).items()]
        )


@contextmanager
def _mat(path: Path) -> Iterator[Write]:
    from scipy.io import savemat

    with path.open("wb") as file:
        # SciPy puts the date into the header; the same session must give the same bytes
        file.write(_MAT_HEADER.ljust(124) + b"\x00\x01IM")

        def write(trial: int, trace: Trace) -> None:
            buffer = io.BytesIO()
            savemat(buffer, {f"trial_{trial:04d}": _columns(trace)}, do_compression=True)
            file.write(buffer.getvalue()[128:])

        yield write


def _columns(trace: Trace) -> dict[str, np.ndarray[Any, np.dtype[np.float32]]]:
    values = (trace.time, trace.tangential, trace.normal)
    return {name: column.astype(np.float32) for name, column in zip(_NAMES, values, strict=True)}


_WRITERS = {"csv": _csv, "hdf5": _hdf5, "tdms": _tdms, "mat": _mat}
# where the traces of a session lie, by format
TRACE_FILES = {"csv": "traces/{trial:04d}.csv", "hdf5": "traces.h5", "tdms": "traces.tdms", "mat": "traces.mat"}
