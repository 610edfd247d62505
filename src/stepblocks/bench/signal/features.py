"""What one trace says: friction, load, ramp, peak, release, ring, energy, each with its standard uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.aftermath import Aftermath, settle, settle_from
from stepblocks.bench.signal.approach import Approach, fit_approach
from stepblocks.bench.signal.landmarks import find_landmarks
from stepblocks.bench.signal.normal_channel import normal_level, sympathetic_force
from stepblocks.bench.signal.peak import Peak, peak_of
from stepblocks.bench.signal.ring import guess_ring
from stepblocks.bench.signal.trace import Trace

Array = NDArray[np.float64]

LOADING_BAND = (0.0, 100.0)  # in which the paper finds more than 64 % of the energy of loading [Hz]
VIBRATION_BAND = (250.0, 350.0)  # in which the paper finds about 86 % of the energy of the vibration [Hz]

_FEWEST_CLEAR = 3
_RING_TIMES = 5.0  # decay times after which the ring counts as over


@dataclass(frozen=True)
class Measurement:
    """Features of one trace with the fits behind them."""

    start: float  # instant of the first sample, from which the fits count [s]
    approach: Approach
    peak: Peak
    aftermath: Aftermath
    load: tuple[float, float]  # normal force while sliding, and its standard uncertainty [N]
    sympathetic: tuple[float, float]  # amplitude of the normal force that rings along, and its standard uncertainty [N]
    shares: tuple[float, float]  # of the energy of loading and of vibration in their bands [1]
    spring_constant: float  # of the explorer, as declared [N/m]
    speed: float  # of the handle [m/s]; not-a-number where it is not known

    @cached_property
    def features(self) -> dict[str, float]:
        """One value for each of `FEATURE_COLUMNS`; not-a-number where the trace does not show it."""
        return {name: figure(self) for name, figure in _FIGURES.items()}

    @property
    def friction(self) -> tuple[float, float]:
        """Sliding over normal force, and its standard uncertainty [1]."""
        load, load_std = self.load
        friction = self.approach.level / load if load > 0.0 else float("nan")
        return friction, float(np.hypot(self.approach.level_std, friction * load_std) / load)

    @property
    def energy(self) -> float:
        """E_v, that of the amplitude at the release on the declared spring [J]."""
        return self.aftermath.amplitude[0] ** 2 / (2.0 * self.spring_constant)

    @property
    def energy_std(self) -> float:
        """Relative standard uncertainty of the energy [1]."""
        amplitude, std = self.aftermath.amplitude
        return 2.0 * (std / amplitude if amplitude > 0.0 else float("nan"))


_FIGURES: dict[str, Callable[[Measurement], float]] = {
    "sliding_friction": lambda m: m.friction[0],
    "sliding_friction_std": lambda m: m.friction[1],
    "normal_load_n": lambda m: m.load[0],
    "normal_load_std_n": lambda m: m.load[1],
    "loading_onset_s": lambda m: m.approach.onset + m.start,
    "loading_slope_n_per_s": lambda m: m.approach.slope,
    "loading_slope_std_n_per_s": lambda m: m.approach.slope_std,
    "spring_constant_n_per_m": lambda m: m.approach.slope / m.speed,
    "spring_constant_std_n_per_m": lambda m: m.approach.slope_std / m.speed,
    "peak_force_n": lambda m: m.peak.force,
    "peak_force_std_n": lambda m: m.peak.force_std,
    "release_time_s": lambda m: m.peak.time + m.start,
    "release_level_n": lambda m: m.aftermath.level[0],
    "release_level_std_n": lambda m: m.aftermath.level[1],
    "ring_frequency_hz": lambda m: m.aftermath.frequency[0],
    "ring_frequency_std_hz": lambda m: m.aftermath.frequency[1],
    "decay_time_s": lambda m: m.aftermath.decay_time[0],
    "decay_time_std_s": lambda m: m.aftermath.decay_time[1],
    "friction_decay_n_per_s": lambda m: m.aftermath.friction_decay[0],
    "friction_decay_std_n_per_s": lambda m: m.aftermath.friction_decay[1],
    "ring_amplitude_n": lambda m: m.aftermath.amplitude[0],
    "ring_amplitude_std_n": lambda m: m.aftermath.amplitude[1],
    "vibration_energy_j": lambda m: m.energy,
    "vibration_energy_std_j": lambda m: m.energy * m.energy_std,
    "ln_vibration_energy_std": lambda m: m.energy_std,
    "sympathetic_force_n": lambda m: m.sympathetic[0],
    "sympathetic_force_std_n": lambda m: m.sympathetic[1],
    "loading_share_0_100hz": lambda m: m.shares[0],
    "vibration_share_250_350hz": lambda m: m.shares[1],
}
FEATURE_COLUMNS = tuple(_FIGURES)  # of a table of features, after trial, status, reason and the covariates


def measure_trace(
    trace: Trace, spring_constant: float, speed: float = float("nan"), tool: tuple[float, float] | None = None
) -> Measurement:
    """Measure one trace.

    Parameters
    ----------
    trace : Trace
        The record, screened.
    spring_constant : float
        Of the explorer, with which an amplitude becomes an energy [N/m].
    speed : float
        Of the handle, with which the ramp becomes a spring constant [m/s]; not-a-number where it is not known.
    tool : (float, float), optional
        Frequency [Hz] and decay time [s] of the tool, where other trials told them.

    Returns
    -------
    Measurement
        Features in SI and what was fitted.

    Raises
    ------
    LandmarkError
        If the trace lacks a part of the course of a trial.
    """
    time, force = trace.time - trace.time[0], trace.tangential
    marks = find_landmarks(time, force)
    late = marks.peak + (time.size - marks.peak) // 4
    approach = fit_approach(time, force, marks, tool or guess_ring(time[late:], force[late:]))
    after = settle(time, force, marks, approach, tool)
    peak = peak_of(time, force, marks, approach, after)
    if peak.corner and after.kind == "damped":
        after = settle_from(time, force, marks, approach, peak.time, after)
        peak = peak_of(time, force, marks, approach, after)
    if peak.corner:
        after = after.carried_to(peak.time)
    return Measurement(
        start=float(trace.time[0]),
        approach=approach,
        peak=peak,
        aftermath=after,
        load=normal_level(time, trace.normal, approach),
        sympathetic=sympathetic_force(time, trace.normal, approach, after),
        shares=_shares(time, force, approach, after, peak),
        spring_constant=spring_constant,
        speed=speed if speed > 0.0 else float("nan"),  # a handle at rest has no ramp
    )


def _shares(time: Array, force: Array, approach: Approach, after: Aftermath, peak: Peak) -> tuple[float, float]:
    rate = (time.size - 1) / (time[-1] - time[0])
    clean = force - approach.hum(time)
    onset, release = np.searchsorted(time, (approach.onset, peak.time))
    end = int(np.searchsorted(time, after.start + _RING_TIMES * after.decay_time[0]))
    begin = int(np.searchsorted(time, max(after.start, peak.time)))
    return (
        band_share(clean[onset:release] - approach.level, rate, LOADING_BAND),
        band_share(clean[begin:end] - after.level[0], rate, VIBRATION_BAND),
    )


def band_share(values: Array, rate: float, band: tuple[float, float]) -> float:
    """Share of the energy of a transient that lies in a band, as in figures 4 and 5 of the paper.

    The energy spectrum of the zero-padded transient is integrated (Parseval). No window: a transient ends by itself,
    and a window would move energy from the release into the band.

    Examples
    --------
    >>> t = np.arange(4000) / 10e3
    >>> ring = np.exp(-t / 0.05) * np.cos(2 * np.pi * 300.0 * t)
    >>> round(band_share(ring, 10e3, (250.0, 350.0)), 2)
    0.96
    """
    from scipy.signal import periodogram

    if values.size < 2 or not np.any(values):
        return float("nan")
    size = max(1 << (4 * values.size - 1).bit_length(), 1 << int(np.ceil(np.log2(rate))))
    frequency, density = periodogram(values, fs=rate, window="boxcar", detrend=False, nfft=size, scaling="density")
    inside = (frequency >= band[0]) & (frequency < band[1])
    return float(density[inside].sum() / density.sum())


def tool_of(features: Iterable[dict[str, float]]) -> tuple[float, float] | None:
    """Frequency [Hz] and decay time [s] of the tool from some trials that show them well, or None.

    A trial whose ring is faint is fitted the better for knowing them; a clear ring overrules them.
    """
    clear = [
        (row["ring_frequency_hz"], row["decay_time_s"])
        for row in features
        if row["ring_frequency_std_hz"] < 0.01 * row["ring_frequency_hz"]
        and row["decay_time_std_s"] < 0.1 * row["decay_time_s"]
    ]
    if len(clear) < _FEWEST_CLEAR:
        return None
    frequency, decay = np.median(np.array(clear), axis=0)
    return float(frequency), float(decay)
