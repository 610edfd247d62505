"""The ring after a release: its energy, its decay, and where both phases lie in the spectrum."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.kernels import COLUMNS
from stepblocks.drag.simulate import DragTrace
from stepblocks.errors import ContactError

LOADING_BAND = (0.0, 100.0)
RING_BAND = (250.0, 350.0)
_PAPER_RING = PAPER.tool.ring_duration
_QUIET = 0.05  # of the first swing: below it the ring has ended
_FEWEST = 3  # samples of a ring that the next place cuts short


@dataclass(frozen=True)
class Ring:
    """The vibration after a release.

    Attributes
    ----------
    amplitude : float
        First swing of the tangential force below `level` [N]; the tip runs forward all through it.
    level : float
        F_py tan(slope + atan mu), the force of sliding forward on the face where the tip lands,
        about which that swing goes [N]; mu F_py on a level one.
    energy : float
        E_v = amplitude^2 / 2k [J]; with overtones the sum over the modes, each by its own swing.
    share : float
        E_v over what it is given, the energy stored at the release and `fall_energy` [1], never
        above 1; where nothing falls it is the paper's C_v.
    duration : float
        From the release until the force stays within 5 % of the first swing around where it settles
        [s].
    decay_time : float
        In which the swings fall to 1/e of the first [s]; NaN where the trace ends before.
    fall_energy : float
        Work of the load as the tip falls behind the edge in that first swing [J].
    frequency : float
        Peak of the spectrum over 16 ms after the release [Hz].
    loading_share : float
        Share of the loading phase's spectral energy in 0-100 Hz [1].
    ring_band_share : float
        Share of the vibration phase's spectral energy in 250-350 Hz [1].
    mode_energies : tuple of float
        Energy of the first mode and of each overtone [J]; empty where there is no overtone.
    """

    amplitude: float
    level: float = field(repr=False)
    energy: float
    share: float
    duration: float
    decay_time: float
    fall_energy: float = field(repr=False)
    frequency: float = math.nan
    loading_share: float = field(default=math.nan, repr=False)
    ring_band_share: float = field(default=math.nan, repr=False)
    mode_energies: tuple[float, ...] = ()


def _cut_ring(trace: DragTrace, event: int) -> DragTrace:
    # Cut what belongs to one release: its pull, from the release to the next one or to the end
    if event < 0:
        return replace(trace, rows=trace.rows[trace.column("time_s") >= trace.release_time])
    one = trace.events[event]
    later = [other.released_s for other in trace.events[event + 1 :] if other.status == "releases"]
    time = trace.column("time_s")
    first = int(np.searchsorted(time, one.released_s))
    last = max(int(np.searchsorted(time, later[0])), first + _FEWEST) if later else len(time)
    return replace(
        trace,
        rows=trace.rows[first:last],
        peak_force=one.pull_n,
        release_time=one.released_s,
        asked=event,
    )


def measure_ring(trace: DragTrace, *, spectra: bool = True, event: int | None = None) -> Ring:
    """Measure the ring of the release that was asked about, or of another event.

    The three spectral figures take longer than the drag itself.
    """
    ContactError.require(
        event is not None or trace.status is Status.RELEASES,
        f"a trace that is {trace.status} has no ring",
    )
    cut = _cut_ring(trace, trace.asked if event is None else event)
    time, swing = cut.column("time_s"), cut.column("fx_n")
    ContactError.require(
        event is not None or trace.column("time_s")[-1] - trace.release_time >= _PAPER_RING,
        f"a ring needs {_PAPER_RING:g} s after the release, got "
        f"{time[-1] - trace.release_time:g} s",
    )
    level = cut.sliding_force
    # the lowest point of the first swing lies within one period of the release, after the fall
    # itself; on a long ramp the pull stays near its peak for long before it falls
    period = 1.0 / trace.probe.frequency
    held = time[(time <= _find_fall_time(cut)) & (swing > 0.9 * cut.peak_force + 0.1 * level)]
    end = max(cut.release_time + 2.0 * period, held.max(initial=0.0) + 1.5 * period)
    first = swing[: max(np.searchsorted(time, end), _FEWEST)]
    amplitude = max(level - float(first.min()), 0.0)
    loud = np.flatnonzero(np.abs(swing - _measure_settled_force(cut)) > _QUIET * amplitude)
    duration = float(time[loud[-1]] - cut.release_time) if loud.size else 0.0
    energy = (
        trace.probe.energy(level - amplitude, level)
        if trace.probe.hardening > 0.0
        else trace.probe.energy(amplitude)
    )
    modes: tuple[float, ...] = ()
    if trace.probe.overtones:
        stiffness = [trace.probe.first_stiffness, *(one[0] for one in trace.probe.overtones)]
        swings = np.maximum(level - cut.rows[: first.size, len(COLUMNS) :].min(axis=0), 0.0)
        modes = tuple((0.5 * swings * swings / stiffness).tolist())
        energy = sum(modes)
    # the spring and the fall of the load feed the first swing, which ends where the tip turns
    heights = cut.column("y_m")[: int(np.argmin(first)) + 1]
    fall = trace.settings.normal_load * float(heights[0] - heights.min())
    given = cut.stored_energy + fall
    ContactError.require(
        energy <= given,
        f"the ring at {cut.release_time:.6g} s has {energy:.3g} J, but is given {given:.3g} J: "
        "its energy ledger fails; raise the resolution",
    )
    ring = Ring(
        amplitude,
        level,
        energy,
        energy / given,
        duration,
        _find_decay_time(cut),
        fall,
        mode_energies=modes,
    )
    if not spectra:
        return ring
    frequencies, power = compute_phase_spectrum(trace, "vibration")
    return replace(
        ring,
        frequency=float(frequencies[np.argmax(power)]),
        loading_share=compute_band_share(*compute_phase_spectrum(trace, "loading"), LOADING_BAND),
        ring_band_share=compute_band_share(frequencies, power, RING_BAND),
    )


def compute_phase_spectrum(
    trace: DragTrace, phase: str, channel: str = "fx_n"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy spectrum of one phase of a trace, as in figures 4 and 5 of the paper."""
    from scipy.signal import periodogram

    time, values = trace.column("time_s"), trace.column(channel)
    rate = trace.settings.sample_rate
    ContactError.require(
        phase in ("loading", "vibration"), f"phase must be loading or vibration, got {phase!r}"
    )
    cut = _cut_ring(trace, trace.asked)
    begin = _find_fall_time(cut)
    # the loading begins where the place before lets go
    before = trace.events[trace.asked - 1].released_s if trace.asked > 0 else -math.inf
    loading = (time < trace.release_time) & (time > before)
    end = min(begin + _PAPER_RING, math.nextafter(float(cut.column("time_s")[-1]), math.inf))
    part = values[loading if phase == "loading" else (time >= begin) & (time < end)]
    ContactError.require(
        part.size >= 16, f"the {phase} phase has {part.size} samples, at least 16 are needed"
    )
    frequency, density = periodogram(
        part, rate, nfft=1 << math.ceil(math.log2(max(part.size, rate))), detrend="constant"
    )
    return np.asarray(frequency), np.asarray(density * part.size / rate)


def _find_decay_time(cut: DragTrace) -> float:
    # Time after the fall in which the greatest deviation of each half period sinks to 1/e of the
    # first [s]
    force = cut.column("fx_n")[cut.column("time_s") >= _find_fall_time(cut)]
    rate = cut.settings.sample_rate
    half = max(round(0.5 * rate / cut.probe.frequency), 2)
    off = np.abs(force[: force.size // half * half] - _measure_settled_force(cut))
    swings = off.reshape(-1, half).max(axis=1)
    below = np.flatnonzero(swings <= swings[:1] / math.e)
    if below.size == 0 or below[0] == 0:
        return math.nan
    last = int(below[0])
    # between two half periods the swings fall exponentially
    fall = math.log(swings[last - 1] / max(swings[last], 1e-300))
    part = math.log(swings[last - 1] * math.e / swings[0]) / max(fall, 1e-300)
    return (last - 1 + min(part, 1.0)) * half / rate


def _measure_settled_force(cut: DragTrace) -> float:
    # Mean pull over the last whole periods, so that a ring that still goes on averages out [N]
    time, force = cut.column("time_s"), cut.column("fx_n")
    periods = max(np.floor(0.25 * (time[-1] - cut.release_time) * cut.probe.frequency), 1.0)
    count = max(round(periods / cut.probe.frequency * cut.settings.sample_rate), 2)
    return float(force[-count - 1 : -1].mean())


def _find_fall_time(cut: DragTrace) -> float:
    # First time after the release at which the pull is down at that of sliding [s]
    below = np.flatnonzero(cut.column("fx_n") <= cut.sliding_force)
    return float(cut.column("time_s")[below[0]]) if below.size else cut.release_time


def compute_band_share(
    frequency: NDArray[np.float64], energy: NDArray[np.float64], band: tuple[float, float]
) -> float:
    """Share of a spectrum's energy between two frequencies [1]."""
    return float(energy[(frequency >= band[0]) & (frequency <= band[1])].sum() / energy.sum())
