"""The ring after a release: its energy, its decay, and where both phases lie in the spectrum."""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

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
_SETTLED = 0.25  # last part of a ring, over which its settled force is measured
# shares of the peak and of the level of sliding: above their sum the pull has not fallen yet
_OF_PEAK, _OF_LEVEL = 0.9, 0.1
_FEWEST = 3  # samples of a ring that the next place cuts short
_FEWEST_OF_PHASE = 16  # samples of a spectrum
_NOTHING = 1e-300  # which keeps a quotient finite


class Phase(StrEnum):
    """A part of a trace that has a spectrum."""

    LOADING = "loading"
    VIBRATION = "vibration"


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


def _cut_ring_of_event(trace: DragTrace, event: int) -> DragTrace:
    """Cut what belongs to one release: its pull, from the release to the next one or to the end.

    `event` is the number of the release, or -1 for the only one of a trace without events.
    """
    time = trace.column("time_s")
    if event < 0:
        return replace(trace, rows=trace.rows[time >= trace.release_time])
    released = trace.events[event]
    first = int(np.searchsorted(time, released.released_s))
    last = len(time)
    for later in trace.events[event + 1 :]:
        if later.status is Status.RELEASES:
            end = int(np.searchsorted(time, later.released_s))
            last = max(end, first + _FEWEST)
            break
    return replace(
        trace,
        rows=trace.rows[first:last],
        peak_force=released.pull_n,
        release_time=released.released_s,
        asked=event,
    )


def measure_ring(trace: DragTrace, *, with_spectra: bool = True, event: int | None = None) -> Ring:
    """Measure the ring of the release that was asked about, or of another event.

    Parameters
    ----------
    trace : DragTrace
        With a release.
    with_spectra : bool
        Whether to compute the three spectral figures, which takes longer than the drag itself.
    event : int, optional
        Number of the event; by default the one that was asked about.

    Returns
    -------
    Ring
        Its spectral figures are NaN without `with_spectra`.

    Raises
    ------
    ContactError
        If the trace has no release or ends too early, or if the ring has more energy than it is
        given.
    """
    if event is None:
        _refuse_trace_without_ring(trace)
        event = trace.asked
    cut = _cut_ring_of_event(trace, event)
    level = cut.sliding_force
    swing = _cut_first_swing(cut, level)
    force = swing.column("fx_n")
    amplitude = max(level - float(force.min()), 0.0)
    mode_energies = _compute_mode_energies(swing, level)
    if mode_energies:
        energy = sum(mode_energies)
    elif trace.probe.hardening > 0.0:
        energy = trace.probe.compute_energy(level - amplitude, level)
    else:
        energy = trace.probe.compute_energy(amplitude)
    # the spring and the fall of the load feed the first swing, which ends where the tip turns
    turning = int(np.argmin(force))
    heights = cut.column("y_m")[: turning + 1]
    fall = trace.settings.normal_load * float(heights[0] - heights.min())
    available = cut.stored_energy + fall
    if not energy <= available:
        raise ContactError(
            f"the ring at {cut.release_time:.6g} s has {energy:.3g} J, but is given "
            f"{available:.3g} J: its energy ledger fails; raise the resolution"
        )
    ring = Ring(
        amplitude,
        level,
        energy,
        share=energy / available,
        duration=_compute_ring_duration(cut, amplitude),
        decay_time=_estimate_decay_time(cut),
        fall_energy=fall,
        mode_energies=mode_energies,
    )
    if with_spectra:
        return _add_spectral_figures(ring, trace)
    return ring


def _refuse_trace_without_ring(trace: DragTrace) -> None:
    """Refuse a trace whose release is missing or too close to its end."""
    if trace.status is not Status.RELEASES:
        raise ContactError(f"a trace that is {trace.status} has no ring")
    length = float(trace.column("time_s")[-1] - trace.release_time)
    if not length >= _PAPER_RING:
        raise ContactError(f"a ring needs {_PAPER_RING:g} s after the release, got {length:g} s")


def _cut_first_swing(cut: DragTrace, level: float) -> DragTrace:
    """Cut the first swing of a ring about a `level` [N].

    Its lowest point lies within one period of the release, after the fall itself; on a long ramp
    the pull stays near its peak for long before it falls.
    """
    time, force = cut.column("time_s"), cut.column("fx_n")
    period = 1.0 / cut.probe.frequency
    near_peak = _OF_PEAK * cut.peak_force + _OF_LEVEL * level
    is_held = (time <= _find_fall_time(cut)) & (force > near_peak)
    held_until = time[is_held].max(initial=0.0)
    end = max(cut.release_time + 2.0 * period, held_until + 1.5 * period)
    count = max(int(np.searchsorted(time, end)), _FEWEST)
    return replace(cut, rows=cut.rows[:count])


def _compute_mode_energies(swing: DragTrace, level: float) -> tuple[float, ...]:
    """Return the energy of each mode by its own swing [J]; empty without overtones."""
    probe = swing.probe
    if not probe.overtones:
        return ()
    stiffness = [probe.first_stiffness, *(mode.stiffness for mode in probe.overtones)]
    lowest = swing.rows[:, len(COLUMNS) :].min(axis=0)
    amplitudes = np.maximum(level - lowest, 0.0)
    return tuple((0.5 * amplitudes * amplitudes / stiffness).tolist())


def _compute_ring_duration(cut: DragTrace, amplitude: float) -> float:
    """Find the time until the force stays near where it settles [s]."""
    deviation = np.abs(cut.column("fx_n") - _measure_settled_force(cut))
    loud = np.flatnonzero(deviation > _QUIET * amplitude)
    if loud.size == 0:
        return 0.0
    return float(cut.column("time_s")[loud[-1]] - cut.release_time)


def _add_spectral_figures(ring: Ring, trace: DragTrace) -> Ring:
    """Return the ring with its three spectral figures."""
    frequencies, power = compute_phase_spectrum(trace, Phase.VIBRATION)
    loading = compute_phase_spectrum(trace, Phase.LOADING)
    return replace(
        ring,
        frequency=float(frequencies[np.argmax(power)]),
        loading_share=compute_spectral_band_share(*loading, LOADING_BAND),
        ring_band_share=compute_spectral_band_share(frequencies, power, RING_BAND),
    )


def compute_phase_spectrum(
    trace: DragTrace, phase: str, channel: str = "fx_n"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy spectrum of one phase of a trace, as in figures 4 and 5 of the paper.

    Parameters
    ----------
    trace : DragTrace
        With a release.
    phase : Phase or str
        ``"loading"`` or ``"vibration"``.
    channel : str
        Column of the trace.

    Returns
    -------
    frequency, energy : ndarray
        Frequencies [Hz] and energy density there [unit of the channel squared times s/Hz].

    Raises
    ------
    ContactError
        If the phase is unknown, or has fewer than 16 samples.
    """
    from scipy.signal import periodogram

    rate = trace.settings.sample_rate
    values = trace.column(channel)[_mark_phase_samples(trace, phase)]
    if values.size < _FEWEST_OF_PHASE:
        raise ContactError(
            f"the {phase} phase has {values.size} samples, at least {_FEWEST_OF_PHASE} are needed"
        )
    points = 1 << math.ceil(math.log2(max(values.size, rate)))
    frequency, density = periodogram(values, rate, nfft=points, detrend="constant")
    return np.asarray(frequency), np.asarray(density * values.size / rate)


def _mark_phase_samples(trace: DragTrace, phase: str) -> NDArray[np.bool_]:
    """Select the samples of a phase; the loading begins where the place before lets go."""
    if phase not in tuple(Phase):
        raise ContactError(f"phase must be loading or vibration, got {phase!r}")
    time = trace.column("time_s")
    if phase == Phase.LOADING:
        before = -math.inf
        if trace.asked > 0:
            before = trace.events[trace.asked - 1].released_s
        return np.asarray((time < trace.release_time) & (time > before))
    cut = _cut_ring_of_event(trace, trace.asked)
    begin = _find_fall_time(cut)
    last = float(cut.column("time_s")[-1])
    end = min(begin + _PAPER_RING, math.nextafter(last, math.inf))
    return np.asarray((time >= begin) & (time < end))


def _estimate_decay_time(cut: DragTrace) -> float:
    """Find the time after the fall in which the swings sink to 1/e of the first [s].

    A swing is the greatest deviation in half a period. NaN where the trace ends before.
    """
    is_falling = cut.column("time_s") >= _find_fall_time(cut)
    force = cut.column("fx_n")[is_falling]
    rate = cut.settings.sample_rate
    half = max(round(0.5 * rate / cut.probe.frequency), 2)  # samples of half a period
    whole = force[: force.size // half * half]
    deviation = np.abs(whole - _measure_settled_force(cut))
    swings = deviation.reshape(-1, half).max(axis=1)
    below = np.flatnonzero(swings <= swings[:1] / math.e)
    if below.size == 0 or below[0] == 0:
        return math.nan
    last = int(below[0])
    # between two half periods the swings fall exponentially
    fall = math.log(swings[last - 1] / max(swings[last], _NOTHING))
    part = math.log(swings[last - 1] * math.e / swings[0]) / max(fall, _NOTHING)
    return (last - 1 + min(part, 1.0)) * half / rate


def _measure_settled_force(cut: DragTrace) -> float:
    """Measure the mean pull over the last whole periods, which averages out a ring [N]."""
    time, force = cut.column("time_s"), cut.column("fx_n")
    last_part = _SETTLED * (time[-1] - cut.release_time)
    frequency = cut.probe.frequency
    periods = max(np.floor(last_part * frequency), 1.0)
    count = max(round(periods / frequency * cut.settings.sample_rate), 2)
    return float(force[-count - 1 : -1].mean())


def _find_fall_time(cut: DragTrace) -> float:
    """Find when the pull is first down at that of sliding, after the release [s]."""
    below = np.flatnonzero(cut.column("fx_n") <= cut.sliding_force)
    if below.size == 0:
        return cut.release_time
    return float(cut.column("time_s")[below[0]])


def compute_spectral_band_share(
    frequencies: NDArray[np.float64], energy: NDArray[np.float64], band: tuple[float, float]
) -> float:
    """Return the share of a spectrum's energy between two frequencies [1]."""
    low, high = band
    is_inside = (frequencies >= low) & (frequencies <= high)
    inside = energy[is_inside].sum()
    return float(inside / energy.sum())
