"""Ramp, release and ring fitted to a record in one likelihood, with a free shape of the release.

The features of a trace come from fits of its parts. Here one model holds the whole record about the
release, once for each shape that the fall of the force may have; the shapes count by their
likelihood, and what they leave open is part of the uncertainty (Buckland, Burnham and Augustin
1997, doi:10.2307/2533961).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool, Trace
from stepblocks.bench.signal.separable import (
    SeparableFit,
    build_damped_wave_columns,
    compute_correlation_inflation,
    fit_separable,
)

_LEAST_SAMPLES = 40  # of a record about its release
_RAMP_SHARE = 0.6  # of the ramp before the release that is fitted: further back it may be bent
_LONGEST_RAMP = 0.05  # [s]
_DECAYS = 3.0  # decay times of the ring that are fitted
_LONGEST_FALL = 6e-3  # [s]
_FIRST_FALLS = (2e-4, 8e-4, 2.5e-3)  # [s] from which a search for the length of the fall begins
_SAMPLES_OF_DRIFT = 3.0  # about the stated release in which the release is looked for
# the columns of the basis, by their places
_LEVEL, _SLOPE, _DRIFT, _COSINE, _SINE, _REST = range(6)


class ReleaseShape(StrEnum):
    """How the force leaves its peak.

    What the ring does not hold of the peak falls in some shape; the force is continuous.
    """

    CORNER = "corner"  # the ring begins at the peak itself, and nothing is left of it
    EXPONENTIAL = "exponential"
    HALF_COSINE = "half cosine"
    PARABOLA = "parabola"  # slowly at first


@dataclass(frozen=True)
class WholeRecord:
    """What the whole record shows.

    Attributes
    ----------
    shape : ReleaseShape
        The likeliest shape of the release.
    probability : float
        Of that shape, among the shapes that were fitted [1].
    fall_time : float
        Length of the fall in that shape [s]; zero for a corner.
    peak_force, ring_amplitude : Estimate
        [N], averaged over the shapes. The amplitude is that at the release.
    release_time : Estimate
        [s]
    slope : Estimate
        Of the ramp [N/s].
    frequency, decay_time : Estimate
        Of the ring [Hz], [s].
    noise : float
        Root mean square of the residuals of the likeliest shape [N].
    """

    shape: ReleaseShape
    probability: float
    fall_time: float
    peak_force: Estimate
    ring_amplitude: Estimate
    release_time: Estimate
    slope: Estimate
    frequency: Estimate
    decay_time: Estimate
    noise: float


@dataclass(frozen=True)
class _ShapeFit:
    """The record fitted with one shape of the release.

    Attributes
    ----------
    shape : ReleaseShape
    fitted : SeparableFit
        Its last three nonlinear parameters are release [s], frequency [Hz] and decay time [s].
    fall_time : float
        [s]
    """

    shape: ReleaseShape
    fitted: SeparableFit
    fall_time: float

    def get_release_time(self) -> Estimate:
        """Return the instant of the release, from the one that was stated [s]."""
        return self._get_shape_parameter(-3)

    def get_frequency(self) -> Estimate:
        """Return the frequency of the ring [Hz]."""
        return self._get_shape_parameter(-2)

    def get_decay_time(self) -> Estimate:
        """Return the decay time of the ring [s]."""
        return self._get_shape_parameter(-1)

    def get_ramp_slope(self) -> Estimate:
        """Return the slope of the ramp [N/s]."""
        index = self.fitted.shape.size + _SLOPE
        slope = float(self.fitted.weights[_SLOPE])
        return Estimate(slope, self.fitted.get_std(index))

    def estimate_peak_force(self) -> Estimate:
        """Estimate the force at the release [N], the sum of level, ring and rest."""
        parts = [_LEVEL, _COSINE]
        if self.shape in _FALLS:
            parts.append(_REST)
        peak = float(self.fitted.weights[parts].sum())
        return Estimate(peak, self._compute_std_of_weighted_sum(parts, np.ones(len(parts))))

    def estimate_ring_amplitude(self) -> Estimate:
        """Estimate the amplitude of the ring at the release from its cosine and sine [N]."""
        parts = self.fitted.weights[[_COSINE, _SINE]]
        amplitude = float(np.hypot(*parts))
        if amplitude == 0.0:
            return Estimate(0.0, math.nan)
        return Estimate(
            amplitude, self._compute_std_of_weighted_sum([_COSINE, _SINE], parts / amplitude)
        )

    def _get_shape_parameter(self, from_end: int) -> Estimate:
        """Return a nonlinear parameter by its negative index, -1 for the last one."""
        index = self.fitted.shape.size + from_end
        return Estimate(float(self.fitted.shape[index]), self.fitted.get_std(index))

    def _compute_std_of_weighted_sum(self, weight_indices: list[int], slopes: Array) -> float:
        """Return the standard uncertainty of a sum of weights, each times its slope."""
        at = self.fitted.shape.size + np.array(weight_indices)
        covariance = self.fitted.covariance[np.ix_(at, at)]
        return math.sqrt(max(float(slopes @ covariance @ slopes), 0.0))


def fit_whole_record(trace: Trace, onset: float, release: float, tool: Tool) -> WholeRecord | None:
    """Fit ramp, release and ring of a trace together.

    Parameters
    ----------
    trace : Trace
    onset, release : float
        Instants at which the ramp begins and ends, as its features have them [s].
    tool : Tool
        Frequency [Hz] and decay time [s] from which the fit of the ring begins.

    Returns
    -------
    WholeRecord or None
        None where too little of a ramp or a ring is recorded.

    Examples
    --------
    >>> time = np.arange(-0.05, 0.08, 1e-4)
    >>> after = np.maximum(time, 0.0)
    >>> ring = 0.2 * np.cos(2 * np.pi * 300.0 * after) * np.exp(-after / 0.02)
    >>> fall = 0.5 * np.exp(-after / 5e-4)
    >>> force = 0.3 + ring + fall + 12.0 * np.minimum(time, 0.0)
    >>> force += 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    >>> trace = Trace(time, force, np.full(time.size, 0.5))
    >>> found = fit_whole_record(trace, -0.05, 0.0, Tool(300.0, 0.02))
    >>> str(found.shape), round(found.peak_force.value, 2), round(found.ring_amplitude.value, 2)
    ('exponential', 1.0, 0.2)
    """
    begin = release - min(_RAMP_SHARE * (release - onset), _LONGEST_RAMP)
    end = release + _DECAYS * tool.decay_time
    inside = (trace.time >= begin) & (trace.time <= end)
    time, force = trace.time[inside] - release, trace.tangential[inside]
    samples_before, samples_after = np.sum(time < 0.0), np.sum(time > 0.0)
    if min(samples_before, samples_after) < 0.5 * _LEAST_SAMPLES:
        return None
    fits = [_fit_corner_shape(time, force, tool)]
    for shape in _FALLS:
        fits.append(_fit_fall_shape(shape, time, force, tool))
    return _average_shape_fits(fits, release)


def _compute_exponential_fall(time_over_fall: Array) -> Array:
    """Fall from 1 by 1/e; the time counts from the release."""
    return np.asarray(np.exp(-time_over_fall))


def _compute_half_cosine_fall(time_over_fall: Array) -> Array:
    """Fall from 1 to 0 along half a cosine."""
    return np.asarray(0.5 * (1.0 + np.cos(np.pi * np.minimum(time_over_fall, 1.0))))


def _compute_parabolic_fall(time_over_fall: Array) -> Array:
    """Return the fall from 1 to 0 along a parabola that begins level, as time goes on."""
    return np.asarray(1.0 - np.minimum(time_over_fall, 1.0) ** 2)


_FALLS: dict[ReleaseShape, Callable[[Array], Array]] = {
    ReleaseShape.EXPONENTIAL: _compute_exponential_fall,
    ReleaseShape.HALF_COSINE: _compute_half_cosine_fall,
    ReleaseShape.PARABOLA: _compute_parabolic_fall,
}


def _build_corner_columns(time: Array, parameters: Array) -> Array:
    """Build the columns of level, ramp, drift, cosine and sine of a record, shape (n, 5).

    `parameters` are release [s], frequency [Hz] and decay time [s]. Before the release all but the
    ramp keep the value that they have at it, so that the force is continuous.
    """
    release, frequency, decay_time = parameters
    since = time - release
    before, after = np.minimum(since, 0.0), np.maximum(since, 0.0)
    ring = build_damped_wave_columns(after, frequency, decay_time)
    return np.column_stack([np.ones_like(time), before, after, ring])


def _build_fall_columns(release_shape: ReleaseShape, time: Array, parameters: Array) -> Array:
    """Build the columns of a corner, and that of the rest of the peak; shape (n, 6).

    `parameters` are the length of the fall [s], then those of a corner.
    """
    fall, release = parameters[:2]
    after = np.maximum(time - release, 0.0)
    falling = _FALLS[release_shape](after / fall)
    corner = _build_corner_columns(time, parameters[1:])
    return np.column_stack([corner, falling])


def _fit_corner_shape(time: Array, force: Array, tool: Tool) -> _ShapeFit:
    """Fit a ring that begins at the peak itself."""
    build = partial(_build_corner_columns, time)
    fitted = _fit_release_and_ring(build, time, force, tool)
    return _ShapeFit(ReleaseShape.CORNER, fitted, 0.0)


def _fit_fall_shape(
    release_shape: ReleaseShape, time: Array, force: Array, tool: Tool
) -> _ShapeFit:
    """Fit a fall of some shape, from the length that does best."""
    step = float(np.median(np.diff(time)))
    build = partial(_build_fall_columns, release_shape, time)
    best: SeparableFit | None = None
    for fall in _FIRST_FALLS:
        shortest = min(0.3 * fall, 0.5 * step)
        longest = min(3.0 * fall, _LONGEST_FALL)
        length = (fall, shortest, longest, 0.2 * fall)
        fitted = _fit_release_and_ring(build, time, force, tool, length)
        if best is None or _compute_sum_of_squares(fitted) < _compute_sum_of_squares(best):
            best = fitted
    assert best is not None
    return _ShapeFit(release_shape, best, float(best.shape[0]))


def _fit_release_and_ring(
    build_columns: Callable[[Array], Array],
    time: Array,
    force: Array,
    tool: Tool,
    fall_bounds: tuple[float, ...] = (),
) -> SeparableFit:
    """Fit instant of the release, frequency and decay of the ring, from where they are stated.

    `fall_bounds` has start, bounds and scale of the length of the fall, where there is one [s].
    """
    step = float(np.median(np.diff(time)))
    reach = _SAMPLES_OF_DRIFT * step
    rows = [fall_bounds] if fall_bounds else []
    frequency, decay = tool
    rows.append((0.0, -reach, reach, step))
    rows.append((frequency, 0.7 * frequency, 1.4 * frequency, 1.0))
    rows.append((decay, 0.2 * decay, 5.0 * decay, 0.1 * decay))
    start, lower, upper, scale = np.array(rows).T
    return fit_separable(build_columns, force, start, lower, upper, scale)


def _compute_sum_of_squares(fitted: SeparableFit) -> float:
    """Compute the sum of squares that a fit leaves [N^2]."""
    return float(fitted.residuals @ fitted.residuals)


def _compute_schwarz_criterion(fit: _ShapeFit, independent_count: float) -> float:
    """Compute Schwarz's criterion for a number of independent residuals."""
    power = max(_compute_sum_of_squares(fit.fitted), 1e-30)
    free = fit.fitted.shape.size + fit.fitted.weights.size
    misfit = independent_count * math.log(power / independent_count)
    price_of_freedom = free * math.log(independent_count)
    return misfit + price_of_freedom


def _average_shape_fits(fits: list[_ShapeFit], release: float) -> WholeRecord:
    """Average what the shapes show by their likelihood; the times count from the `release` [s]."""
    closest = min((fit.fitted for fit in fits), key=_compute_sum_of_squares).residuals
    # residuals that are correlated count as fewer, and for all shapes as equally many
    independent = closest.size / compute_correlation_inflation(closest)
    criteria = np.array([_compute_schwarz_criterion(fit, independent) for fit in fits])
    odds = np.exp(-0.5 * (criteria - criteria.min()))
    shares = odds / odds.sum()
    best = fits[int(np.argmin(criteria))]

    def average_over_shapes(estimate: Callable[[_ShapeFit], Estimate]) -> Estimate:
        """Average an estimate over the shapes by their shares."""
        return _average_estimates([estimate(fit) for fit in fits], shares)

    since_release = average_over_shapes(_ShapeFit.get_release_time)
    release_time = Estimate(release + since_release.value, since_release.std)
    peak_force = average_over_shapes(_ShapeFit.estimate_peak_force)
    ring_amplitude = average_over_shapes(_ShapeFit.estimate_ring_amplitude)
    noise = np.sqrt(np.mean(best.fitted.residuals**2))
    return WholeRecord(
        shape=best.shape,
        probability=float(shares.max()),
        fall_time=best.fall_time,
        peak_force=peak_force,
        ring_amplitude=ring_amplitude,
        release_time=release_time,
        slope=average_over_shapes(_ShapeFit.get_ramp_slope),
        frequency=average_over_shapes(_ShapeFit.get_frequency),
        decay_time=average_over_shapes(_ShapeFit.get_decay_time),
        noise=float(noise),
    )


def _average_estimates(estimates: list[Estimate], shares: Array) -> Estimate:
    """Average estimates by their shares; their spread is part of the uncertainty."""
    values = np.array([estimate.value for estimate in estimates])
    variances = np.array([estimate.std**2 for estimate in estimates])
    mean = float(shares @ values)
    squares = variances + (values - mean) ** 2
    return Estimate(mean, math.sqrt(float(shares @ squares)))
