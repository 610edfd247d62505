"""The figures of one trace: friction, load, ramp, peak, release, ring, energy.

Each has its standard uncertainty.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from stepblocks.bench.faults import Bound, LandmarkError
from stepblocks.bench.signal import USUAL_TOOL, Array, Estimate, Tool, Trace
from stepblocks.bench.signal.aftermath import (
    Aftermath,
    estimate_sliding_noise,
    fit_aftermath,
    fit_bell_ring,
)
from stepblocks.bench.signal.approach import Approach, fit_approach
from stepblocks.bench.signal.extremum import find_extremum
from stepblocks.bench.signal.landmarks import Landmarks, find_bounded_landmarks, find_landmarks
from stepblocks.bench.signal.motion import Motion
from stepblocks.bench.signal.normal import (
    measure_normal_ring_amplitude,
    measure_sliding_normal_force,
)
from stepblocks.bench.signal.peak import Peak, measure_peak
from stepblocks.bench.signal.regimes import Regime, classify_regime
from stepblocks.bench.signal.saw import Sawtooth, find_sawtooth
from stepblocks.bench.signal.separable import guess_ring_frequency_and_decay
from stepblocks.bench.signal.set_down import find_set_down_and_zeros
from stepblocks.bench.signal.spectrum import BandShares, compute_loading_and_vibration_shares

Features = dict[str, Any]  # one value for each of `FEATURE_COLUMNS`, a number or a word

# of a table of features, after trial, status, reason and the covariates
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
    "stick_slip_amplitude_n",
    "stick_slip_amplitude_std_n",
    "stick_time_s",
    "stick_time_std_s",
    "static_friction",
    "static_friction_std",
    "tangential_zero_n",
    "tangential_zero_std_n",
    "normal_zero_n",
    "normal_zero_std_n",
    "regime",
)
# features over the normal force of sliding
_OVER_LOAD = (
    "sliding_friction",
    "sliding_friction_std",
    "normal_load_n",
    "normal_load_std_n",
    "static_friction",
    "static_friction_std",
)
_CUT_SHARE = 0.05  # of the samples while sliding, which noise alone does not put at the very top
_LATE_SHARE = 4  # part of the record after the peak, from which on it shows the tool
_FEWEST_CLEAR = 3  # trials that show the tool well
_CLEAR_FREQUENCY = 0.01  # relative uncertainty up to which a trial shows it well
_CLEAR_DECAY = 0.1
_NOT_KNOWN = Estimate(math.nan, math.nan)


class Zeros(NamedTuple):
    """What the gauges read while nothing was loaded [N]."""

    tangential: Estimate
    normal: Estimate


def _make_value_and_std_features(
    estimate: Estimate, value_column: str, std_column: str
) -> Features:
    """Return value and standard uncertainty of an estimate by their names."""
    value, std = estimate
    return {value_column: value, std_column: std}


def compute_energy_features(amplitude: Estimate, spring_constant: float) -> Features:
    """Return the energy of a ring's amplitude at the release [N] on a spring [N/m]."""
    energy = amplitude.value**2 / (2.0 * spring_constant)
    relative_std = math.nan
    if amplitude.value > 0.0:
        relative_std = 2.0 * (amplitude.std / amplitude.value)
    return {
        "vibration_energy_j": energy,
        "vibration_energy_std_j": energy * relative_std,
        "ln_vibration_energy_std": relative_std,
    }


@dataclass(frozen=True, kw_only=True)
class Loading:
    """Figures of a record up to its peak, with the fits behind them.

    It stands alone where the peak is only a lower bound.

    Attributes
    ----------
    start : float
        Instant of the first sample, from which the fits count [s].
    approach : Approach
    peak : Peak
    load : Estimate
        Normal force while sliding [N].
    zeros : Zeros
    speed : float
        Of the handle [m/s]; NaN where it is not known.
    saw : Sawtooth | None
        What it drew before the edge where it stuck and slipped.
    """

    start: float
    approach: Approach
    peak: Peak
    load: Estimate
    zeros: Zeros
    speed: float
    saw: Sawtooth | None = None

    def compute_ramp_slope(self) -> Estimate:
        """Return the slope of the ramp [N/s]."""
        return self.approach.compute_mean_slope(self.peak.time)

    def compute_ramp_spring_constant(self) -> Estimate:
        """Return the spring constant that the ramp shows [N/m]."""
        slope = self.compute_ramp_slope()
        return Estimate(slope.value / self.speed, slope.std / self.speed)

    def compute_friction_coefficient(self) -> Estimate:
        """Return sliding over normal force [1] with its standard uncertainty."""
        load, load_std = self.load
        friction = math.nan
        if load > 0.0:
            friction = self.approach.sliding_force / load
        level_std = self.approach.sliding_force_std
        if self.saw is not None:
            level_std = self.saw.kinetic.std
        return Estimate(friction, float(np.hypot(level_std, friction * load_std) / load))

    def compute_loading_features(self) -> Features:
        """Return the features that no saturation after the peak spoils."""
        peak = self.peak
        features: Features = {}
        features |= _make_value_and_std_features(
            self.compute_friction_coefficient(), "sliding_friction", "sliding_friction_std"
        )
        features |= _make_value_and_std_features(self.load, "normal_load_n", "normal_load_std_n")
        features["loading_onset_s"] = self.approach.onset + self.start
        features |= _make_value_and_std_features(
            self.compute_ramp_slope(), "loading_slope_n_per_s", "loading_slope_std_n_per_s"
        )
        features |= _make_value_and_std_features(
            self.compute_ramp_spring_constant(),
            "spring_constant_n_per_m",
            "spring_constant_std_n_per_m",
        )
        force = Estimate(peak.force, peak.force_std)
        features |= _make_value_and_std_features(force, "peak_force_n", "peak_force_std_n")
        features["release_time_s"] = peak.time + self.start
        features |= _make_value_and_std_features(
            self.zeros.tangential, "tangential_zero_n", "tangential_zero_std_n"
        )
        features |= _make_value_and_std_features(
            self.zeros.normal, "normal_zero_n", "normal_zero_std_n"
        )
        return features


@dataclass(frozen=True, kw_only=True)
class Measurement(Loading):
    """Features of one whole trace with the fits behind them.

    Attributes
    ----------
    aftermath : Aftermath
    sympathetic : Estimate
        Amplitude of the normal force that rings along [N].
    shares : BandShares
    regime : Regime
    spring_constant : float
        Of the explorer, as declared [N/m].
    """

    aftermath: Aftermath
    sympathetic: Estimate
    shares: BandShares
    regime: Regime
    spring_constant: float

    @cached_property
    def features(self) -> Features:
        """One value for each of `FEATURE_COLUMNS`.

        A value is NaN where the trace does not show it.
        """
        after = self.aftermath
        features = self.compute_loading_features()
        features |= _make_value_and_std_features(
            after.level, "release_level_n", "release_level_std_n"
        )
        features |= _make_value_and_std_features(
            after.frequency, "ring_frequency_hz", "ring_frequency_std_hz"
        )
        features |= _make_value_and_std_features(
            after.decay_time, "decay_time_s", "decay_time_std_s"
        )
        features |= _make_value_and_std_features(
            after.friction_decay, "friction_decay_n_per_s", "friction_decay_std_n_per_s"
        )
        features |= _make_value_and_std_features(
            after.amplitude, "ring_amplitude_n", "ring_amplitude_std_n"
        )
        features |= compute_energy_features(after.amplitude, self.spring_constant)
        features |= _make_value_and_std_features(
            self.sympathetic, "sympathetic_force_n", "sympathetic_force_std_n"
        )
        features["loading_share_0_100hz"] = self.shares.loading
        features["vibration_share_250_350hz"] = self.shares.vibration
        features |= self._compute_sticking_features()
        features["regime"] = self.regime.value
        return {name: features[name] for name in FEATURE_COLUMNS}

    def _compute_sticking_features(self) -> Features:
        """Return the features of the saw before the edge; NaN without a saw."""
        amplitude = stick_time = static_friction = _NOT_KNOWN
        if self.saw is not None:
            load, load_std = self.load
            static = self.saw.static.value / load
            std = math.hypot(self.saw.static.std, static * load_std) / load
            amplitude = self.saw.amplitude
            stick_time = self.saw.stick_time
            static_friction = Estimate(static, std)
        features = _make_value_and_std_features(
            amplitude, "stick_slip_amplitude_n", "stick_slip_amplitude_std_n"
        )
        features |= _make_value_and_std_features(stick_time, "stick_time_s", "stick_time_std_s")
        features |= _make_value_and_std_features(
            static_friction, "static_friction", "static_friction_std"
        )
        return features


def measure_trace(
    trace: Trace, spring_constant: float, speed: float = math.nan, tool: Tool | None = None
) -> Measurement:
    """Measure one trace.

    Parameters
    ----------
    trace : Trace
    spring_constant : float
        Of the explorer, as declared [N/m].
    speed : float
        Of the handle [m/s]; NaN where it is not known.
    tool : Tool, optional
        Its ring, where it is known.

    Raises
    ------
    LandmarkError
        If the trace does not show sliding, loading and slip.
    """
    set_down = find_set_down_and_zeros(trace)
    start = float(trace.time[set_down.first])
    normal = trace.normal[set_down.first :]
    force = trace.tangential[set_down.first :]
    time = trace.time[set_down.first :] - start
    marks = find_landmarks(time, force)
    saw = find_sawtooth(time, force, marks, tool or USUAL_TOOL, spring_constant)
    if saw is not None:
        force = saw.remove_saw(force)
        marks = find_landmarks(time, force)
    approach = _fit_approach(time, force, marks, tool, saw)
    after, peak = _fit_aftermath_and_peak(time, force, marks, approach, tool, saw)
    load = measure_sliding_normal_force(time, normal, approach)
    frequency, decay_time = tool or (after.frequency.value, after.decay_time.value)
    damping = 1.0 / (2.0 * math.pi * frequency * decay_time)
    force_without_hum = force - approach.compute_hum(time)
    peak_index = int(np.searchsorted(time, peak.time))
    motion = Motion(
        time,
        force_without_hum,
        normal,
        peak=peak_index,
        level=approach.sliding_force,
        load=load.value,
        slope=approach.initial_slope,
        noise=marks.noise,
        frequency=frequency,
        damping=damping,
    )
    sympathetic = measure_normal_ring_amplitude(time, normal, approach, after)
    shares = compute_loading_and_vibration_shares(time, force, approach, after, peak)
    regime = classify_regime(motion, saw, rings_freely=after.rings_freely)
    if not speed > 0.0:  # a handle at rest has no ramp
        speed = math.nan
    return Measurement(
        start=start,
        approach=approach,
        peak=peak,
        load=load,
        zeros=Zeros(set_down.tangential_zero, set_down.normal_zero),
        speed=speed,
        saw=saw,
        aftermath=after,
        sympathetic=sympathetic,
        shares=shares,
        regime=regime,
        spring_constant=spring_constant,
    )


def _fit_approach(
    time: Array, force: Array, landmarks: Landmarks, tool: Tool | None, sawtooth: Sawtooth | None
) -> Approach:
    """Fit sliding and ramp; the ring of the start is that of the tool, known or guessed."""
    start_up = tool
    if start_up is None:
        samples_after_peak = time.size - landmarks.peak
        late = landmarks.peak + samples_after_peak // _LATE_SHARE
        start_up = guess_ring_frequency_and_decay(time[late:], force[late:])
    # the ramp of a tip that stuck begins with its last tooth
    return fit_approach(time, force, landmarks, start_up, is_straight=sawtooth is not None)


def _fit_aftermath_and_peak(
    time: Array,
    force: Array,
    landmarks: Landmarks,
    approach: Approach,
    tool: Tool | None,
    sawtooth: Sawtooth | None,
) -> tuple[Aftermath, Peak]:
    """Fit the ring after the slip and the peak before it, each of which helps the other."""
    if sawtooth is not None:
        after = fit_aftermath(
            time, force, landmarks, approach, tool or USUAL_TOOL, sawtooth=sawtooth
        )
        # static friction gives way at once, and no straight ramp led up to it
        reach = 0.1 / after.frequency.value
        top = find_extremum(time, force, landmarks.peak, reach, landmarks.noise)
        return after, Peak(top.instant, top.force, top.std, corner=False)
    after = fit_aftermath(time, force, landmarks, approach, tool)
    peak = measure_peak(time, force, landmarks, approach, after)
    if (
        peak.corner and after.rings_freely and not after.is_late
    ):  # which sample is the highest is a matter of noise
        noise = estimate_sliding_noise(time, approach, landmarks)
        after = fit_bell_ring(time, force, peak.time, approach.mains_frequency, noise)
        peak = measure_peak(time, force, landmarks, approach, after)
    if peak.corner:
        after = after.carry_amplitude_to(peak.time)
    return after, peak


def measure_censored_trace(
    trace: Trace, spring_constant: float, speed: float, bound: Bound
) -> Features:
    """Measure a record whose gauge saturated or whose tip never slipped.

    Parameters
    ----------
    trace : Trace
    spring_constant : float
        Of the explorer, as declared [N/m].
    speed : float
        Of the handle [m/s].
    bound : Bound
        What the record only bounds.

    Returns
    -------
    Features
        What the record shows; empty where it does not even show a ramp.
    """
    try:
        if bound is Bound.PEAK_FORCE:
            return _measure_bounded_loading(trace, speed).compute_loading_features()
        # what saturates after the slip, or only along the normal, leaves the peak whole
        measurement = measure_trace(trace, spring_constant, speed)
    except (LandmarkError, ValueError, np.linalg.LinAlgError):
        return {}
    if bound is Bound.NORMAL_FORCE:
        return _drop_features_over_load(trace, measurement.features)
    features = measurement.compute_loading_features()
    features["loading_share_0_100hz"] = measurement.shares.loading
    return features


def _measure_bounded_loading(trace: Trace, speed: float) -> Loading:
    """Measure a record up to its highest sample, which is a lower bound of the peak."""
    set_down = find_set_down_and_zeros(trace)
    start = trace.time[set_down.first]
    time = trace.time[set_down.first :] - start
    force = trace.tangential[set_down.first :]
    marks = find_bounded_landmarks(time, force)
    approach = fit_approach(time, force, marks, None)
    highest = float(force[marks.peak])
    normal = trace.normal[set_down.first :]
    return Loading(
        start=float(start),
        approach=approach,
        peak=Peak(math.nan, highest, math.nan, corner=False),
        load=measure_sliding_normal_force(time, normal, approach),
        zeros=Zeros(set_down.tangential_zero, set_down.normal_zero),
        speed=speed,
    )


def _drop_features_over_load(trace: Trace, features: Features) -> Features:
    """Drop features that divide by the load where the normal gauge was at its limit."""
    # a level at which the gauge stood still is less than the force, and friction over it is no
    # friction
    sliding = np.abs(trace.normal[trace.time < features["loading_onset_s"]])
    limit = np.abs(trace.normal).max()
    if not sliding.size:
        return features
    share_at_limit = np.mean(sliding >= limit)
    if not share_at_limit > _CUT_SHARE:
        return features
    return {name: value for name, value in features.items() if name not in _OVER_LOAD}


def estimate_tool_from_features(feature_rows: Iterable[Mapping[str, float]]) -> Tool | None:
    """Average the ring of the tool over trials that show it well.

    The result is None where too few do.
    """
    frequencies, decay_times = [], []
    for row in feature_rows:
        frequency, decay_time = row["ring_frequency_hz"], row["decay_time_s"]
        shows_frequency = row["ring_frequency_std_hz"] < _CLEAR_FREQUENCY * frequency
        if shows_frequency and row["decay_time_std_s"] < _CLEAR_DECAY * decay_time:
            frequencies.append(frequency)
            decay_times.append(decay_time)
    if len(frequencies) < _FEWEST_CLEAR:
        return None
    return Tool(float(np.median(frequencies)), float(np.median(decay_times)))
