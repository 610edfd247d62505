"""The ring after a release: its energy, its decay, and where both phases lie in the spectrum."""

import math
from dataclasses import dataclass, replace

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

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Ring:
    """The vibration after a release.

    Attributes
    ----------
    amplitude : float
        First swing of the tangential force below `level` [N]; the tip runs forward all through it.
    level : float
        mu F_py, the force of sliding forward on a level face, about which that swing goes [N].
    energy : float
        E_v = amplitude^2 / 2k [J].
    share : float
        E_v over the energy stored at the release [1]; the paper's C_v.
    duration : float
        From the release until the force stays within 5 % of the first swing around where it settles
        [s].
    decay_time : float
        In which the swings fall to 1/e of the first [s]; NaN where the trace ends before.
    frequency : float
        Peak of the spectrum over 16 ms after the release [Hz].
    loading_share : float
        Share of the loading phase's spectral energy in 0-100 Hz [1].
    ring_band_share : float
        Share of the vibration phase's spectral energy in 250-350 Hz [1].
    """

    amplitude: float
    level: float
    energy: float
    share: float
    duration: float
    decay_time: float
    frequency: float = math.nan
    loading_share: float = math.nan
    ring_band_share: float = math.nan


@dataclass(frozen=True)
class _Window:
    """The part of a trace that belongs to one release."""

    time: Floats  # from the release to the next one, or to the end [s]
    force: Floats  # the pull [N]
    period: float  # of the tool's ring [s]
    level: float  # pull of sliding [N]
    rate: float  # of the samples [Hz]
    whole: bool  # whether nothing else catches the tip within the paper's 16 ms

    @property
    def settled(self) -> float:
        """Mean pull over the last whole periods, so that a ring that still goes on averages out [N]."""
        span = 0.25 * float(self.time[-1] - self.time[0])
        periods = max(np.floor(span / self.period), 1.0)
        count = max(round(periods * self.period * self.rate), 2)
        return float(self.force[-count - 1 : -1].mean())

    @property
    def fallen(self) -> int:
        """Number of the first sample at which the pull is down at that of sliding."""
        below = np.flatnonzero(self.force <= self.level)
        return int(below[0]) if below.size else 0


def _cut_window(trace: DragTrace, passage: int) -> _Window:
    """Cut the part of a trace that belongs to one passage; -1 stands for the release of the trace."""
    time, force = trace.column("time_s"), trace.column("fx_n")
    after = trace.passages[passage + 1 :] if trace.passages and passage >= 0 else ()
    begin = trace.passages[passage].time if passage >= 0 else trace.release_time
    # the next place ends the ring once it holds the tip
    caught = [one.time for one in after if one.status is not Status.RUN_OVER]
    inside = time >= begin
    whole = True
    if caught:
        inside &= time <= caught[0]
        whole = caught[0] - begin > _PAPER_RING
    if np.count_nonzero(inside) < _FEWEST:
        inside = (time >= begin) & (np.cumsum(time >= begin) <= _FEWEST)
    return _Window(
        time[inside],
        force[inside],
        1.0 / trace.probe.frequency,
        trace.settings.sliding_force,
        trace.settings.sample_rate,
        whole,
    )


def measure_ring(trace: DragTrace, *, spectra: bool = True, passage: int | None = None) -> Ring:
    """Measure the ring of the release that was asked about, or of another passage.

    The three spectral figures take longer than the drag itself.
    """
    asked = passage is None
    number = trace.asked if passage is None else passage
    status = trace.status if passage is None else trace.passages[number].status
    if status is not Status.RELEASES:
        raise ContactError(f"a trace that is {status} has no ring")
    window = _cut_window(trace, number)
    if asked and window.whole and window.time[-1] - window.time[0] < _PAPER_RING:
        raise ContactError(
            f"a ring needs {_PAPER_RING:g} s after the release, got "
            f"{window.time[-1] - trace.release_time:g} s"
        )
    begin = trace.release_time if number < 0 else trace.passages[number].time
    pull = trace.peak_force if number < 0 else trace.passages[number].pull
    # the lowest point of the first swing lies within one period of the release, after the fall
    # itself
    first = window.force[: max(np.searchsorted(window.time, begin + 2.0 * window.period), 3)]
    amplitude = max(window.level - float(first.min()), 0.0)
    loud = np.flatnonzero(np.abs(window.force - window.settled) > _QUIET * amplitude)
    duration = float(window.time[loud[-1]] - begin) if loud.size else 0.0
    level, probe = window.level, trace.probe
    hard = probe.hardening > 0.0
    energy = probe.energy(level - amplitude, level) if hard else probe.energy(amplitude)
    share = energy / probe.energy(pull)
    _require_energy(trace, number, energy)
    ring = Ring(amplitude, level, energy, share, duration, _find_decay_time(window))
    if not spectra:
        return ring
    frequencies, power = compute_phase_spectrum(trace, "vibration")
    loading, own = (
        compute_band_share(*compute_phase_spectrum(trace, "loading"), LOADING_BAND),
        compute_band_share(frequencies, power, RING_BAND),
    )
    return replace(
        ring,
        frequency=float(frequencies[np.argmax(power)]),
        loading_share=loading,
        ring_band_share=own,
    )


def _require_energy(trace: DragTrace, number: int, energy: float) -> None:
    """Refuse a ring that has more energy than the spring, the fall of the load and the handle can give."""
    begin = trace.release_time if number < 0 else trace.passages[number].time
    pull = trace.peak_force if number < 0 else trace.passages[number].pull
    rows = trace.rows[trace.column("time_s") >= begin]
    if not len(rows):
        return
    soon = rows[: max(int(np.searchsorted(rows[:, 0], begin + 2.0 / trace.probe.frequency)), 2)]
    height, handle = soon[:, COLUMNS.index("y_m")], soon[:, COLUMNS.index("handle_m")]
    fallen = trace.settings.normal_load * max(float(height[0] - height.min()), 0.0)
    work = max(pull, 0.0) * float(np.ptp(handle))
    speed = float(np.abs(np.gradient(handle, soon[:, 0])).max()) if len(soon) > 2 else 0.0
    moving = 0.5 * (trace.probe.mass + trace.settings.handle_mass) * speed**2
    given = trace.probe.energy(pull) + fallen + work + moving
    if energy > 1.02 * given:
        raise ContactError(
            f"the ring at {begin:.6g} s has {energy:.3g} J, but only {given:.3g} J are given to it: "
            "the energy ledger of the drag fails; raise the resolution"
        )


def compute_phase_spectrum(
    trace: DragTrace, phase: str, channel: str = "fx_n"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy spectrum of one phase of a trace, as in figures 4 and 5 of the paper."""
    from scipy.signal import periodogram

    time, values = trace.column("time_s"), trace.column(channel)
    rate = trace.settings.sample_rate
    if phase not in ("loading", "vibration"):
        raise ContactError(f"phase must be loading or vibration, got {phase!r}")
    window = _cut_window(trace, trace.asked)
    begin = float(window.time[window.fallen])
    # the loading begins where the place before lets go
    start = trace.passages[trace.asked - 1].time if trace.asked > 0 else -math.inf
    loading = (time < trace.release_time) & (time > start)
    ringing = (time >= begin) & (time < begin + _PAPER_RING) & (time <= window.time[-1])
    part = values[loading if phase == "loading" else ringing]
    if part.size < 16:
        raise ContactError(f"the {phase} phase has {part.size} samples, at least 16 are needed")
    padded = 1 << math.ceil(math.log2(max(part.size, rate)))
    frequency, density = periodogram(part, rate, nfft=padded, detrend="constant")
    return np.asarray(frequency), np.asarray(density * part.size / rate)


def _find_decay_time(window: _Window) -> float:
    """Time after the fall in which the greatest deviation of each half period sinks to 1/e of the first [s]."""
    force = window.force[window.fallen :]
    half = max(round(0.5 * window.rate * window.period), 2)
    if force.size < half:
        return math.nan
    swings = (
        np.abs(force[: force.size // half * half] - window.settled).reshape(-1, half).max(axis=1)
    )
    below = np.flatnonzero(swings <= swings[:1] / math.e)
    if below.size == 0 or below[0] == 0:
        return math.nan
    last = int(below[0])
    # between two half periods the swings fall exponentially
    fall = math.log(swings[last - 1] / max(swings[last], 1e-300))
    part = math.log(swings[last - 1] * math.e / swings[0]) / max(fall, 1e-300)
    return (last - 1 + min(part, 1.0)) * half / window.rate


def compute_band_share(
    frequency: NDArray[np.float64], energy: NDArray[np.float64], band: tuple[float, float]
) -> float:
    """Share of a spectrum's energy between two frequencies [1]."""
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return float(energy[inside].sum() / energy.sum())
