"""What one trace says: friction, load, ramp, peak, release, ring, energy, each with its standard uncertainty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal.aftermath import Aftermath, settle, settle_from
from stepblocks.bench.signal.approach import Approach, fit_approach
from stepblocks.bench.signal.landmarks import Landmarks, find_landmarks
from stepblocks.bench.signal.normal_channel import normal_level, sympathetic_force
from stepblocks.bench.signal.peak import Peak, peak_of
from stepblocks.bench.signal.ring import guess_ring
from stepblocks.bench.signal.spectrum import LOADING_BAND, VIBRATION_BAND, band_share
from stepblocks.bench.signal.trace import Trace

# Columns of a table of features, after trial, status, reason and the covariates
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

_FEWEST_CLEAR = 3
_RING_TIMES = 5.0  # decay times after which the ring counts as over


@dataclass(frozen=True)
class Measurement:
    """Features of one trace with the fits behind them."""

    features: dict[str, float]  # One value for each of `FEATURE_COLUMNS`; not-a-number where the trace does not show it
    landmarks: Landmarks  # What was fitted, for drawing
    approach: Approach
    peak: Peak
    aftermath: Aftermath


def measure_trace(
    trace: Trace, spring_constant: float, speed: float = float("nan"), tool: tuple[float, float] | None = None
) -> Measurement:
    """Measure one trace."""
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
    load, load_std = normal_level(time, trace.normal, approach)
    values = _mechanics(approach, after, peak, load, load_std, spring_constant, speed)
    values["loading_onset_s"] += float(trace.time[0])
    values["release_time_s"] += float(trace.time[0])
    sympathetic = sympathetic_force(time, trace.normal, approach, after)
    values["sympathetic_force_n"], values["sympathetic_force_std_n"] = sympathetic
    values.update(_bands(time, force, approach, after, peak))
    return Measurement({name: values[name] for name in FEATURE_COLUMNS}, marks, approach, peak, after)


def _mechanics(
    approach: Approach, after: Aftermath, peak: Peak, load: float, load_std: float, spring_constant: float, speed: float
) -> dict[str, float]:
    amplitude, amplitude_std = after.amplitude
    energy = amplitude**2 / (2.0 * spring_constant)
    relative = amplitude_std / amplitude if amplitude > 0.0 else float("nan")
    friction = approach.level / load if load > 0.0 else float("nan")
    friction_std = float(np.hypot(approach.level_std, friction * load_std) / load) if load > 0.0 else float("nan")
    # a handle at rest has no ramp
    moving = speed if speed > 0.0 else float("nan")
    return {
        "sliding_friction": friction,
        "sliding_friction_std": friction_std,
        "normal_load_n": load,
        "normal_load_std_n": load_std,
        "loading_onset_s": approach.onset,
        "loading_slope_n_per_s": approach.slope,
        "loading_slope_std_n_per_s": approach.slope_std,
        "spring_constant_n_per_m": approach.slope / moving,
        "spring_constant_std_n_per_m": approach.slope_std / moving,
        "peak_force_n": peak.force,
        "peak_force_std_n": peak.force_std,
        "release_time_s": peak.time,
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


def _bands(
    time: NDArray[np.float64], force: NDArray[np.float64], approach: Approach, after: Aftermath, peak: Peak
) -> dict[str, float]:
    rate = (time.size - 1) / (time[-1] - time[0])
    clean = force - approach.hum(time)
    onset, release = np.searchsorted(time, (approach.onset, peak.time))
    end = int(np.searchsorted(time, after.start + _RING_TIMES * after.decay_time[0]))
    begin = int(np.searchsorted(time, max(after.start, peak.time)))
    return {
        "loading_share_0_100hz": band_share(clean[onset:release] - approach.level, rate, LOADING_BAND),
        "vibration_share_250_350hz": band_share(clean[begin:end] - after.level[0], rate, VIBRATION_BAND),
    }


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
