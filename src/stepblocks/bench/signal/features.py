"""What one trace says: friction, load, ramp, peak, release, ring, energy, each with its standard uncertainty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

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

# columns of a table of features, after trial, status, reason and the covariates
FEATURE_COLUMNS = (
    "sliding_friction",
    "sliding_friction_std",
    "normal_load_n",
    "normal_load_std_n",
    "loading_onset_s",
    "loading_slope_n_per_s",
    "loading_slope_std_n_per_s",
    "spring_constant_n_per_m",
    "spring_constant_std_n_per_m",
    "peak_force_n",
    "peak_force_std_n",
    "release_time_s",
    "release_level_n",
    "release_level_std_n",
    "ring_frequency_hz",
    "ring_frequency_std_hz",
    "decay_time_s",
    "decay_time_std_s",
    "friction_decay_n_per_s",
    "friction_decay_std_n_per_s",
    "ring_amplitude_n",
    "ring_amplitude_std_n",
    "vibration_energy_j",
    "vibration_energy_std_j",
    "ln_vibration_energy_std",
    "sympathetic_force_n",
    "sympathetic_force_std_n",
    "loading_share_0_100hz",
    "vibration_share_250_350hz",
)

LOADING_BAND = (0.0, 100.0)  # in which the paper finds more than 64 % of the energy of loading [Hz]
VIBRATION_BAND = (250.0, 350.0)  # in which the paper finds about 86 % of the energy of the vibration [Hz]

_FEWEST_CLEAR = 3
_RING_TIMES = 5.0  # decay times after which the ring counts as over


@dataclass(frozen=True)
class Measurement:
    """Features of one trace with the fits behind them."""

    features: dict[str, float]  # one for each of `FEATURE_COLUMNS`; not-a-number where the trace does not show it
    approach: Approach
    peak: Peak
    aftermath: Aftermath


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
    values = (
        _sliding(time, trace.normal, approach)
        | _loading(approach, peak, speed, float(trace.time[0]))
        | _ringing(after, spring_constant)
        | _bands(time, force, approach, after, peak)
    )
    sympathetic = sympathetic_force(time, trace.normal, approach, after)
    values["sympathetic_force_n"], values["sympathetic_force_std_n"] = sympathetic
    return Measurement({name: values[name] for name in FEATURE_COLUMNS}, approach, peak, after)


def _sliding(time: Array, normal: Array, approach: Approach) -> dict[str, float]:
    load, load_std = normal_level(time, normal, approach)
    friction = approach.level / load if load > 0.0 else float("nan")
    return {
        "sliding_friction": friction,
        "sliding_friction_std": float(np.hypot(approach.level_std, friction * load_std) / load),
        "normal_load_n": load,
        "normal_load_std_n": load_std,
    }


def _loading(approach: Approach, peak: Peak, speed: float, start: float) -> dict[str, float]:
    # a handle at rest has no ramp
    moving = speed if speed > 0.0 else float("nan")
    return {
        "loading_onset_s": approach.onset + start,
        "loading_slope_n_per_s": approach.slope,
        "loading_slope_std_n_per_s": approach.slope_std,
        "spring_constant_n_per_m": approach.slope / moving,
        "spring_constant_std_n_per_m": approach.slope_std / moving,
        "peak_force_n": peak.force,
        "peak_force_std_n": peak.force_std,
        "release_time_s": peak.time + start,
    }


def _ringing(after: Aftermath, spring_constant: float) -> dict[str, float]:
    amplitude, amplitude_std = after.amplitude
    energy = amplitude**2 / (2.0 * spring_constant)
    relative = amplitude_std / amplitude if amplitude > 0.0 else float("nan")
    return {
        "release_level_n": after.level[0],
        "release_level_std_n": after.level[1],
        "ring_frequency_hz": after.frequency[0],
        "ring_frequency_std_hz": after.frequency[1],
        "decay_time_s": after.decay_time[0],
        "decay_time_std_s": after.decay_time[1],
        "friction_decay_n_per_s": after.friction_decay[0],
        "friction_decay_std_n_per_s": after.friction_decay[1],
        "ring_amplitude_n": amplitude,
        "ring_amplitude_std_n": amplitude_std,
        "vibration_energy_j": energy,
        "vibration_energy_std_j": 2.0 * energy * relative,
        "ln_vibration_energy_std": 2.0 * relative,
    }


def _bands(time: Array, force: Array, approach: Approach, after: Aftermath, peak: Peak) -> dict[str, float]:
    rate = (time.size - 1) / (time[-1] - time[0])
    clean = force - approach.hum(time)
    onset, release = np.searchsorted(time, (approach.onset, peak.time))
    end = int(np.searchsorted(time, after.start + _RING_TIMES * after.decay_time[0]))
    begin = int(np.searchsorted(time, max(after.start, peak.time)))
    return {
        "loading_share_0_100hz": band_share(clean[onset:release] - approach.level, rate, LOADING_BAND),
        "vibration_share_250_350hz": band_share(clean[begin:end] - after.level[0], rate, VIBRATION_BAND),
    }


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
