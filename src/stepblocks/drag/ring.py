"""What a trace of a drag says: the ring after the release, its energy, and where in the spectrum both phases lie."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.simulate import DragTrace
from stepblocks.errors import ContactError
from stepblocks.figure_file import make_figure, save_figure

LOADING_BAND = (0.0, 100.0)
RING_BAND = (250.0, 350.0)
_PAPER_RING = PAPER.tool.ring_duration
_QUIET = 0.05  # of the first swing: below it the ring has ended


@dataclass(frozen=True)
class Ring:
    """The vibration after a release."""

    # first swing of the tangential force below `level` [N]: the tip runs forward all through it
    amplitude: float
    # mu F_py, the force of sliding forward on a level face, about which that swing goes [N]
    level: float
    energy: float  # E_v = amplitude^2 / 2k [J]
    share: float  # E_v over the energy stored at the release [1]; the paper's C_v
    # from the release until the force stays within 5 % of the first swing around where it settles
    # [s]
    duration: float
    decay_time: (
        float  # in which the swings fall to 1/e of the first [s]; NaN where the trace ends before
    )
    frequency: float = math.nan  # peak of the spectrum over 16 ms after the release [Hz]
    loading_share: float = math.nan  # of the loading phase's spectral energy in 0-100 Hz [1]
    ring_band_share: float = math.nan  # of the vibration phase's spectral energy in 250-350 Hz [1]


def measure_ring(trace: DragTrace, *, spectra: bool = True) -> Ring:
    """Measure the ring of a trace that released; its three spectral figures take longer than the drag itself."""
    if trace.status is not Status.RELEASES:
        raise ContactError(f"a trace that is {trace.status} has no ring")
    time, force = trace.column("time_s"), trace.column("fx_n")
    if time[-1] - trace.release_time < _PAPER_RING:
        raise ContactError(
            f"a ring needs {_PAPER_RING:g} s after the release, got "
            f"{time[-1] - trace.release_time:g} s"
        )
    after = time >= trace.release_time
    swing = force[after]
    level = trace.settings.sliding_force
    # the lowest point of the first swing lies within one period of the release, after the fall
    # itself
    first = swing[
        : max(np.searchsorted(time[after], trace.release_time + 2.0 / trace.probe.frequency), 3)
    ]
    amplitude = max(level - float(first.min()), 0.0)
    loud = np.flatnonzero(np.abs(swing - _settled(trace)) > _QUIET * amplitude)
    duration = float(time[after][loud[-1]] - trace.release_time) if loud.size else 0.0
    hard = trace.probe.hardening > 0.0
    energy = trace.probe.energy(level - amplitude, level) if hard else trace.probe.energy(amplitude)
    ring = Ring(
        amplitude, level, energy, energy / trace.stored_energy, duration, _decay_time(trace)
    )
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


def compute_phase_spectrum(
    trace: DragTrace, phase: str, channel: str = "fx_n"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy spectrum of one phase of a trace, as in figures 4 and 5 of the paper."""
    from scipy.signal import periodogram

    time, values = trace.column("time_s"), trace.column(channel)
    rate = trace.settings.sample_rate
    if phase not in ("loading", "vibration"):
        raise ContactError(f"phase must be loading or vibration, got {phase!r}")
    begin = _fallen(trace)
    loading, ringing = time < trace.release_time, (time >= begin) & (time < begin + _PAPER_RING)
    part = values[loading if phase == "loading" else ringing]
    if part.size < 16:
        raise ContactError(f"the {phase} phase has {part.size} samples, at least 16 are needed")
    padded = 1 << math.ceil(math.log2(max(part.size, rate)))
    frequency, density = periodogram(part, rate, nfft=padded, detrend="constant")
    return np.asarray(frequency), np.asarray(density * part.size / rate)


def _decay_time(trace: DragTrace) -> float:
    """Time after the fall in which the greatest deviation of each half period sinks to 1/e of the first [s]."""
    force = trace.column("fx_n")[trace.column("time_s") >= _fallen(trace)]
    rate = trace.settings.sample_rate
    half = max(round(0.5 * rate / trace.probe.frequency), 2)
    swings = (
        np.abs(force[: force.size // half * half] - _settled(trace)).reshape(-1, half).max(axis=1)
    )
    below = np.flatnonzero(swings <= swings[:1] / math.e)
    if below.size == 0:
        return math.nan
    last = int(below[0])
    # between two half periods the swings fall exponentially
    fall = math.log(swings[last - 1] / max(swings[last], 1e-300))
    part = math.log(swings[last - 1] * math.e / swings[0]) / max(fall, 1e-300)
    return (last - 1 + min(part, 1.0)) * half / rate


def _settled(trace: DragTrace) -> float:
    """Mean force over the last whole periods of the trace, so that a ring that still goes on averages out [N]."""
    time, force = trace.column("time_s"), trace.column("fx_n")
    span = 0.25 * (time[-1] - trace.release_time)
    periods = max(np.floor(span * trace.probe.frequency), 1.0)
    count = max(round(periods / trace.probe.frequency * trace.settings.sample_rate), 2)
    return float(force[-count - 1 : -1].mean())


def _fallen(trace: DragTrace) -> float:
    """First time after the release at which the force is down at that of sliding forward [s]."""
    time, force = trace.column("time_s"), trace.column("fx_n")
    after = np.flatnonzero(time >= trace.release_time)
    below = after[force[after] <= trace.settings.sliding_force]
    return float(time[below[0]]) if below.size else trace.release_time


def compute_band_share(
    frequency: NDArray[np.float64], energy: NDArray[np.float64], band: tuple[float, float]
) -> float:
    """Share of a spectrum's energy between two frequencies [1]."""
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return float(energy[inside].sum() / energy.sum())


def draw_force(trace: DragTrace, path: Path, title: str) -> None:
    """Draw both forces against time, as figure 3 of the paper does, and mark the release."""
    figure, axes = make_figure(2, 1, sharex=True, height=4.6)
    time = trace.column("time_s") * 1e3
    for axis, name, label in (
        (axes[0], "fx_n", "tangential $F_x$ [N]"),
        (axes[1], "fy_n", "normal $F_y$ [N]"),
    ):
        axis.plot(time, trace.column(name), lw=0.8, color="#1f4e79")
        axis.set_ylabel(label)
        if trace.status is Status.RELEASES:
            axis.axvline(trace.release_time * 1e3, color="#b03030", lw=0.8, ls="--")
    if trace.status is Status.RELEASES:
        said, place = (
            f"release, $F_{{px}}$ = {trace.peak_force:.3g} N",
            (trace.release_time * 1e3, trace.peak_force),
        )
        axes[0].annotate(
            said, place, (8, 2), textcoords="offset points", va="top", fontsize=8, color="#b03030"
        )
    axes[1].set_xlabel("time [ms]")
    axes[0].set_title(title, fontsize=10)
    save_figure(figure, path)


def draw_spectra(trace: DragTrace, path: Path, title: str) -> None:
    """Draw the spectra of the loading and of the vibration phase of both forces, as figures 4 and 5 do."""
    figure, axes = make_figure(2, 2, sharex=True, height=5.0)
    for row, (channel, label) in enumerate((("fx_n", "$F_x$"), ("fy_n", "$F_y$"))):
        for axis, (phase, band) in zip(
            axes[row], (("loading", LOADING_BAND), ("vibration", RING_BAND)), strict=True
        ):
            frequency, energy = compute_phase_spectrum(trace, phase, channel)
            shown = frequency <= 600.0
            axis.plot(
                frequency[shown],
                energy[shown] / max(float(energy[shown].max()), 1e-300),
                lw=0.9,
                color="#1f4e79",
            )
            axis.axvspan(*band, color="#f0c040", alpha=0.25, lw=0)
            share = compute_band_share(frequency, energy, band)
            axis.set_title(
                f"{phase}, {label}: {share:.0%} in {band[0]:.0f}-{band[1]:.0f} Hz", fontsize=9
            )
            axis.set_ylabel("relative energy")
    for axis in axes[1]:
        axis.set_xlabel("frequency [Hz]")
    figure.suptitle(title, fontsize=10)
    save_figure(figure, path)
