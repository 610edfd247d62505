"""The figures of one trace: friction, load, ramp, peak, release, ring, energy.

Each has its standard uncertainty.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import label

from stepblocks.bench.signal import Array, Estimate, Tool, Trace, find_set_down
from stepblocks.bench.signal.aftermath import (
    Aftermath,
    estimate_sliding_noise,
    fit_aftermath,
    fit_bell,
    measure_normal_level,
    measure_sympathetic_force,
)
from stepblocks.bench.signal.approach import (
    Approach,
    LandmarkError,
    Landmarks,
    find_bounded_landmarks,
    find_landmarks,
    fit_approach,
)
from stepblocks.bench.signal.regimes import (
    USUAL_TOOL,
    Motion,
    Sawtooth,
    classify_regime,
    find_extremum,
    find_saw,
)
from stepblocks.bench.signal.ring import Ring
from stepblocks.bench.signal.separable import fit_with_covariance, guess_ring, propagate_std

Features = dict[str, Any]  # one value for each of `FEATURE_COLUMNS`, a number or a word
LOADING_BAND = (0.0, 100.0)  # in which the paper finds more than 64 % of the energy of loading [Hz]
# in which the paper finds about 86 % of the energy of the vibration [Hz]
VIBRATION_BAND = (
    250.0,
    350.0,
)

_FEWEST_CLEAR = 3
_RING_TIMES = 5.0  # decay times after which the ring counts as over
_CORNER_REACH = 3.5  # samples about the highest one in which a corner may lie
_FALL_SAMPLES = 6
_CLEAR_FALL = 0.02  # of the rise: the first sample after a corner has fallen by this at least
_TOP_SHARE = (
    0.06  # of the rise: a rounded peak is fitted where the force is within this of the highest
)
_TOP_REACH = 6e-3  # [s] at most this far from the highest sample
_FALL_AT_ONCE = 0.5  # of the rise
_ROUND_SPREAD = (
    1.3  # a cubic is not the law of a rounded peak: pulls on drags in time are wider by this
)


@dataclass(frozen=True)
class Peak:
    """Peak of the tangential force.

    Attributes
    ----------
    time : float
        Release instant [s].
    force : float
        [N].
    force_std : float
        [N].
    corner : bool
        Whether the ramp ran into the release in a corner; otherwise the peak is rounded.
    """

    time: float
    force: float
    force_std: float
    corner: bool


def find_peak(
    time: Array, force: Array, marks: Landmarks, approach: Approach, after: Aftermath
) -> Peak:
    """Find the peak: the corner of ramp and release, both fitted.

    Where the corner is rounded, it is the top of a cubic.
    """
    # the highest sample is no measure of it: noise lifts it, and the release falls between two
    # samples
    corner = None
    if approach.end >= marks.peak - 1:
        corner = (
            _find_corner(time, marks, approach, after.ring)
            if isinstance(after.ring, Ring)
            else _find_corner_of_fall(time, force, marks, approach)
        )
    return corner or _find_rounded_peak(time, force, marks, approach)


def _find_corner(time: Array, marks: Landmarks, approach: Approach, ring: Ring) -> Peak | None:
    from scipy.optimize import brentq

    top = float(time[marks.peak])
    step = float(np.median(np.diff(time)))

    def excess(instant: float) -> float:
        at = np.array([instant])
        return float(ring.curve(at)[0] - approach.line(at)[0])

    low, high = top - _CORNER_REACH * step, top + _CORNER_REACH * step
    if not excess(low) > 0.0 > excess(high):
        return None
    instant = float(brentq(excess, low, high, xtol=1e-9))
    fall = (excess(instant + 0.1 * step) - excess(instant - 0.1 * step)) / (0.2 * step)
    if fall >= 0.0:
        return None
    # the force at the corner moves along the ramp by slope * dt, dt = (errors of both) /
    # (difference of slopes)
    share = approach.slope / -fall
    force, std = approach.ramp(instant)
    return Peak(
        instant,
        force,
        math.hypot((1.0 - share) * std, share * ring.curve_std(instant)),
        corner=True,
    )


def _find_corner_of_fall(
    time: Array, force: Array, marks: Landmarks, approach: Approach
) -> Peak | None:
    # Corner of the ramp and a parabola through the first samples after it
    # noise decides which of the samples about a corner is the highest; the fall begins where the
    # line is left
    below = approach.line(time) - force
    deep = max(_CLEAR_FALL * marks.rise, 5.0 * marks.noise)
    end = marks.peak + 4
    first = next(
        (i for i in range(marks.peak - 1, end) if below[i] > deep and below[i + 1] > below[i]), end
    )
    last = first + _FALL_SAMPLES
    if last > time.size or first == end or abs(below[first - 1]) > deep:
        return None
    step = float(np.median(np.diff(time)))
    y = force[first:last] - approach.line(time[first:last])
    columns = np.vander((time[first:last] - time[first]) / step, 3, increasing=True)
    weights, covariance = fit_with_covariance(columns, y)
    grid = np.linspace(-_CORNER_REACH, 0.0, 701)
    excess = np.vander(grid, 3, increasing=True) @ weights
    above = np.flatnonzero(excess > 0.0)
    if not above.size or excess[-1] >= 0.0:
        return None
    at = float(grid[above[-1]])
    fall = (weights[1] + 2.0 * weights[2] * at) / step
    if fall >= 0.0:
        return None
    gradient = np.asarray(at ** np.arange(3), dtype=float)
    noise = max(
        propagate_std(gradient, covariance),
        propagate_std(gradient, np.asarray(np.linalg.inv(columns.T @ columns), dtype=float))
        * marks.noise,
    )
    instant = float(time[first]) + at * step
    # how a fall begins between two samples is not seen
    unseen = approach.slope * step / math.sqrt(12.0)
    top, std = approach.ramp(instant)
    return Peak(instant, top, math.hypot(std, approach.slope / -fall * noise, unseen), corner=True)


def _find_rounded_peak(time: Array, force: Array, marks: Landmarks, approach: Approach) -> Peak:
    clean = force - approach.hum(time)
    near = np.convolve(clean, np.full(5, 0.2), mode="same")
    close = near > near[marks.peak] - max(_TOP_SHARE * marks.rise, 3.0 * marks.noise)
    parts, _ = label(close & (np.abs(time - time[marks.peak]) < _TOP_REACH))
    top = np.flatnonzero(parts == parts[marks.peak])
    first, last = min(int(top[0]), marks.peak - 3), max(int(top[-1]), marks.peak + 3)
    # no cubic follows a fall between two samples, as of a simulated tip without mass
    if np.diff(clean[marks.peak : last + 1]).min() < -_FALL_AT_ONCE * marks.rise:
        last = marks.peak
    t = time[first : last + 1] - time[marks.peak]
    reach = float(np.abs(t).max())
    weights, covariance = fit_with_covariance(
        np.vander(t / reach, 4, increasing=True), clean[first : last + 1]
    )
    grid = np.linspace(t[0], t[-1], 801) / reach
    heights = np.vander(grid, 4, increasing=True) @ weights
    best = int(np.argmax(heights))
    return Peak(
        float(time[marks.peak] + grid[best] * reach),
        float(heights[best]),
        _ROUND_SPREAD
        * propagate_std(np.asarray(grid[best] ** np.arange(4), dtype=float), covariance),
        corner=False,
    )


@dataclass(frozen=True)
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
        Normal force while sliding, and its standard uncertainty [N].
    zeros : tuple[Estimate, Estimate]
        Of both gauges while nothing was loaded [N].
    speed : float
        Of the handle [m/s]; not-a-number where it is not known.
    saw : Saw | None
        What it drew before the edge where it stuck and slipped.
    """

    start: float
    approach: Approach
    peak: Peak
    load: Estimate
    zeros: tuple[Estimate, Estimate]
    speed: float
    saw: Sawtooth | None = None

    def slope(self) -> Estimate:
        """Slope of the ramp, and its standard uncertainty [N/s]."""
        return self.approach.mean_slope(self.peak.time)

    def friction(self) -> Estimate:
        """Sliding over normal force, and its standard uncertainty [1]."""
        load, load_std = self.load
        friction = self.approach.level / load if load > 0.0 else float("nan")
        own = self.approach.level_std if self.saw is None else self.saw.kinetic[1]
        return friction, float(np.hypot(own, friction * load_std) / load)


@dataclass(frozen=True, kw_only=True)
class Measurement(Loading):
    """Features of one whole trace with the fits behind them.

    Attributes
    ----------
    aftermath : Aftermath
    sympathetic : Estimate
        Amplitude of the normal force that rings along, and its standard uncertainty [N].
    shares : tuple[float, float]
        Of the energy of loading and of vibration in their bands [1].
    regime : str
        Snap, climb-down, flight, rubbing or stick-slip.
    spring_constant : float
        Of the explorer, as declared [N/m].
    """

    aftermath: Aftermath
    sympathetic: Estimate
    shares: tuple[float, float]
    regime: str
    spring_constant: float

    @cached_property
    def features(self) -> Features:
        """One value for each of `FEATURE_COLUMNS`.

        A value is not-a-number where the trace does not show it.
        """
        return _compute_features(_FIGURES, self)

    def sticking(self) -> tuple[float, ...]:
        """Amplitude and time of sticking, and static friction, from the saw before the edge.

        They are not-a-number without a saw.
        """
        if self.saw is None:
            return (math.nan,) * 6
        load, load_std = self.load
        static = self.saw.static[0] / load
        spread = math.hypot(self.saw.static[1], static * load_std) / load
        return (*self.saw.amplitude, *self.saw.stick_time, static, spread)

    def energy(self) -> tuple[float, float, float]:
        """Energy of the amplitude at the release on the declared spring [J].

        Its standard uncertainty [J] and their ratio follow.
        """
        amplitude, std = self.aftermath.amplitude
        energy = amplitude**2 / (2.0 * self.spring_constant)
        relative = 2.0 * (std / amplitude if amplitude > 0.0 else float("nan"))
        return energy, energy * relative, relative


# columns, and what stands in them
_Figures = dict[tuple[str, ...], Callable[[Any], tuple[object, ...]]]


def _compute_features(functions: _Figures, loading: Loading) -> Features:
    return {
        name: value
        for names, compute in functions.items()
        for name, value in zip(names, compute(loading), strict=True)
    }


_FIGURES: _Figures = {
    ("sliding_friction", "sliding_friction_std"): Loading.friction,
    ("normal_load_n", "normal_load_std_n"): lambda m: m.load,
    ("loading_onset_s",): lambda m: (m.approach.onset + m.start,),
    ("loading_slope_n_per_s", "loading_slope_std_n_per_s"): Loading.slope,
    ("spring_constant_n_per_m", "spring_constant_std_n_per_m"): lambda m: tuple(
        one / m.speed for one in m.slope()
    ),
    ("peak_force_n", "peak_force_std_n"): lambda m: (m.peak.force, m.peak.force_std),
    ("release_time_s",): lambda m: (m.peak.time + m.start,),
    ("release_level_n", "release_level_std_n"): lambda m: m.aftermath.level,
    ("ring_frequency_hz", "ring_frequency_std_hz"): lambda m: m.aftermath.frequency,
    ("decay_time_s", "decay_time_std_s"): lambda m: m.aftermath.decay_time,
    ("friction_decay_n_per_s", "friction_decay_std_n_per_s"): lambda m: m.aftermath.friction_decay,
    ("ring_amplitude_n", "ring_amplitude_std_n"): lambda m: m.aftermath.amplitude,
    ("vibration_energy_j", "vibration_energy_std_j", "ln_vibration_energy_std"): Measurement.energy,
    ("sympathetic_force_n", "sympathetic_force_std_n"): lambda m: m.sympathetic,
    ("loading_share_0_100hz", "vibration_share_250_350hz"): lambda m: m.shares,
    (
        "stick_slip_amplitude_n",
        "stick_slip_amplitude_std_n",
        "stick_time_s",
        "stick_time_std_s",
        "static_friction",
        "static_friction_std",
    ): Measurement.sticking,
    ("tangential_zero_n", "tangential_zero_std_n"): lambda m: m.zeros[0],
    ("normal_zero_n", "normal_zero_std_n"): lambda m: m.zeros[1],
    ("regime",): lambda m: (m.regime,),
}
# what no saturation after the peak spoils
_SPARED = ("sliding", "normal_", "loading", "spring", "peak", "release_time", "tangential")
_OF_LOADING = {
    names: features for names, features in _FIGURES.items() if names[0].startswith(_SPARED)
}
_OVER_LOAD = ("sliding", "normal_load", "static")  # what counts by the normal force of sliding
_CUT_SHARE = 0.05  # of the samples while sliding, which noise alone does not put at the very top
del _OF_LOADING["loading_share_0_100hz", "vibration_share_250_350hz"]
# of a table of features, after trial, status, reason and the covariates
FEATURE_COLUMNS = tuple(name for names in _FIGURES for name in names)


def measure_trace(
    trace: Trace, spring_constant: float, speed: float = float("nan"), tool: Tool | None = None
) -> Measurement:
    """Measure one trace."""
    loaded, zeros = find_set_down(trace)
    trace = Trace(trace.time[loaded:], trace.tangential[loaded:], trace.normal[loaded:])
    time = trace.time - trace.time[0]
    force = trace.tangential
    marks = find_landmarks(time, force)
    saw = find_saw(time, force, marks, tool or USUAL_TOOL, spring_constant)
    if saw is not None:
        force = saw.remove_saw(force)
        marks = find_landmarks(time, force)
    late = marks.peak + (time.size - marks.peak) // 4
    # the ramp of a tip that stuck begins with its last tooth
    approach = fit_approach(
        time, force, marks, tool or guess_ring(time[late:], force[late:]), straight=saw is not None
    )
    after = fit_aftermath(
        time, force, marks, approach, tool or (USUAL_TOOL if saw else None), saw=saw
    )
    peak = find_peak(time, force, marks, approach, after)
    if saw is not None:  # static friction gives way at once, and no straight ramp led up to it
        top, std, instant = find_extremum(
            time, force, marks.peak, 0.1 / after.frequency[0], marks.noise
        )
        peak = Peak(instant, top, std, corner=False)
    if peak.corner and after.damped:  # which sample is the highest is a matter of noise
        after = fit_bell(
            time, force, peak.time, approach.mains, estimate_sliding_noise(time, approach, marks)
        )
        peak = find_peak(time, force, marks, approach, after)
    if peak.corner:
        after = after.carry_to(peak.time)
    load = measure_normal_level(time, trace.normal, approach)
    clean = force - approach.hum(time)
    frequency, decay = tool or (after.frequency[0], after.decay_time[0])
    motion = Motion(
        time,
        clean,
        trace.normal,
        int(np.searchsorted(time, peak.time)),
        approach.level,
        load[0],
        approach.slope,
        marks.noise,
        frequency,
        1.0 / (2.0 * math.pi * frequency * decay),
    )
    speed = speed if speed > 0.0 else math.nan  # a handle at rest has no ramp
    return Measurement(
        *(float(trace.time[0]), approach, peak, load, zeros, speed, saw),
        aftermath=after,
        sympathetic=measure_sympathetic_force(time, trace.normal, approach, after),
        shares=_compute_band_shares(time, force, approach, after, peak),
        regime=classify_regime(motion, saw, after.damped),
        spring_constant=spring_constant,
    )


def measure_censored(trace: Trace, spring_constant: float, speed: float, reason: str) -> Features:
    """Say what a record shows whose gauge saturated or whose tip never slipped.

    Its peak force is a lower bound.
    """
    # Empty where it does not even show a ramp. What saturates after the slip, or only along the
    # normal, leaves the peak whole.
    try:
        if "normal force" in reason or "lowest" in reason:
            features = measure_trace(trace, spring_constant, speed).features
            if "normal force" not in reason:
                return {n: v for n, v in features.items() if n.startswith(_SPARED)}
            slid = np.abs(trace.normal[trace.time < features["loading_onset_s"]])
            # a level at which the gauge stood still is less than the force, and friction over it is
            # no friction
            cut = slid.size and np.mean(slid >= np.abs(trace.normal).max()) > _CUT_SHARE
            return {n: v for n, v in features.items() if not (cut and n.startswith(_OVER_LOAD))}
        loaded, zeros = find_set_down(trace)
        time = trace.time[loaded:] - trace.time[loaded]
        force = trace.tangential[loaded:]
        marks = find_bounded_landmarks(time, force)
        approach = fit_approach(time, force, marks, None)
        load = measure_normal_level(time, trace.normal[loaded:], approach)
    except (LandmarkError, ValueError, np.linalg.LinAlgError):
        return {}
    return _compute_features(
        _OF_LOADING,
        Loading(
            float(trace.time[loaded]),
            approach,
            Peak(math.nan, float(force[marks.peak]), math.nan, corner=False),
            load,
            zeros,
            speed,
        ),
    )


def _compute_band_shares(
    time: Array, force: Array, approach: Approach, after: Aftermath, peak: Peak
) -> tuple[float, float]:
    rate = (time.size - 1) / (time[-1] - time[0])
    clean = force - approach.hum(time)
    over = after.start + _RING_TIMES * after.decay_time[0]
    onset, release, begin, end = np.searchsorted(
        time, (approach.onset, peak.time, max(after.start, peak.time), over)
    )
    return (
        compute_band_share(clean[onset:release] - approach.level, rate, LOADING_BAND),
        compute_band_share(clean[begin:end] - after.level[0], rate, VIBRATION_BAND),
    )


def compute_band_share(values: Array, rate: float, band: tuple[float, float]) -> float:
    """Share of the energy of a transient that lies in a band, by Parseval's theorem.

    Figures 4 and 5 of the paper show it.
    """
    # no window: a transient ends by itself, and a window would move energy from the release into
    # the band
    from scipy.signal import periodogram

    if values.size < 2 or not np.any(values):
        return float("nan")
    size = max(1 << (4 * values.size - 1).bit_length(), 1 << int(np.ceil(np.log2(rate))))
    frequency, density = periodogram(
        values, fs=rate, window="boxcar", detrend=False, nfft=size, scaling="density"
    )
    return float(density[(frequency >= band[0]) & (frequency < band[1])].sum() / density.sum())


def average_tool(features: Iterable[dict[str, float]]) -> Tool | None:
    """Average frequency [Hz] and decay time [s] of the tool over trials that show them well.

    The result is None where too few do.
    """
    clear = [
        (row["ring_frequency_hz"], row["decay_time_s"])
        for row in features
        if row["ring_frequency_std_hz"] < 0.01 * row["ring_frequency_hz"]
        and row["decay_time_std_s"] < 0.1 * row["decay_time_s"]
    ]
    return tuple(np.median(clear, axis=0).tolist()) if len(clear) >= _FEWEST_CLEAR else None
