"""The peak from the samples about it, averaged over the shapes that its release may have.

The ramp runs up to an instant that is looked for. From there on the force leaves it by a
polynomial: in a corner, with a level top like a cosine, or smoothly, as a slow gauge shows a
corner. Every shape at every instant counts by its marginal likelihood (Kass and Raftery 1995,
doi:10.1080/01621459.1995.10476572), so that the uncertainty holds the choice of the shape.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal import Array
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.landmarks import Landmarks

_BEFORE, _AFTER = 8, 12  # samples before the highest one, and after it at most
_FEWEST_AFTER = 2
_ON_RAMP = 5  # first samples of the window, which lie on the ramp
_CLEAR_MISS = 2.0  # standard deviations of the noise by which noise alone does not miss there
_FALL_SHARE = 0.35  # of the rise, down to which the fall is followed
_EARLIEST, _LATEST = -9.0, 2.5  # where the fall may begin, in samples from the highest one
_PER_SAMPLE = 8  # instants that are tried per sample
# in samples, how long a fall of the whole rise may take: polynomials have coefficients of that size
_DURATIONS = (1.0, 3.0, 10.0, 30.0)
_TOP_REACH = 10.0  # samples after the begin of the fall, within which the top lies
_TOP_STEPS = 81  # of the search for it
_LEAST_NOISE = 2e-4  # of the rise, to which no fall is a polynomial
_SURE = 60.0  # difference of log likelihoods beyond which a shape counts for nothing


class Shape(Enum):
    """How the force leaves the ramp."""

    CORNER = "corner"
    LEVEL = "level"
    SMOOTH = "smooth"

    @property
    def log_prior(self) -> float:
        """Logarithm of the share of the shape beforehand: as many gauges round as do not."""
        if self is Shape.SMOOTH:
            return math.log(0.5)
        return math.log(0.25)

    def build_columns(self, time_since_fall: Array) -> Array:
        """Return the powers of the time since the begin of the fall, shape (..., 2 or 3)."""
        powers = [time_since_fall**2, time_since_fall**3]
        if self is Shape.CORNER:
            powers.insert(0, time_since_fall)
        return np.stack(powers, axis=-1)

    def list_coefficient_scales(self, fall_duration: float) -> Array:
        """Return the sizes of the coefficients of a fall by one in a duration, shape (2 or 3,)."""
        powers = [2.0, 3.0]
        if self is Shape.CORNER:
            powers.insert(0, 1.0)
        return np.asarray(fall_duration ** -np.array(powers))


@dataclass(frozen=True)
class Window:
    """Samples about the peak, in units in which a sample lasts 1.

    Attributes
    ----------
    since : Array
        Shape (n,), of the samples from the highest one [samples].
    excess : Array
        Shape (n,), force over the line of the ramp [N].
    climb : float
        Of the ramp per sample [N].
    rise : float
        Of the peak over sliding [N].
    noise : float
        Standard deviation of a sample [N].
    sample : float
        Time between two samples [s].
    """

    since: Array
    excess: Array
    climb: float
    rise: float
    noise: float
    sample: float

    def compute_log_likelihood(self, expected: Array) -> float:
        """Compute the log likelihood of the samples about what is expected of `excess` [N].

        The constant of the normal distribution is left out, as in `average_peak_over_shapes`.
        """
        misses = (self.excess - expected) / self.noise
        return -0.5 * float(misses @ misses)

    @classmethod
    def cut_around_peak(
        cls, time: Array, force: Array, marks: Landmarks, approach: Approach, noise: float
    ) -> "Window":
        """Cut the samples from the ramp to where a part of the fall is done."""
        step = float(np.median(np.diff(time)))
        top = float(time[marks.peak])
        first = max(marks.peak - _BEFORE, 0)
        last = min(marks.peak + _AFTER, time.size - 1)
        excess = force - approach.compute_ramp_line(time)
        low = force[marks.peak] - _FALL_SHARE * marks.rise
        below = force[marks.peak : last + 1] < low
        fallen = last
        if below.any():
            fallen = marks.peak + int(np.argmax(below))
        last = min(max(fallen, marks.peak + _FEWEST_AFTER), last)
        part = slice(first, last + 1)
        # where the line misses the ramp itself, it is known no better than that
        on_ramp = excess[first : first + _ON_RAMP]
        miss = float(np.sqrt(np.mean(on_ramp**2)))
        if miss > _CLEAR_MISS * noise:
            noise = miss
        ramp_at_top = approach.compute_ramp_force(top).value
        ramp_before_top = approach.compute_ramp_force(top - step).value
        return cls(
            since=(time[part] - top) / step,
            excess=excess[part],
            climb=ramp_at_top - ramp_before_top,
            rise=marks.rise,
            noise=max(noise, _LEAST_NOISE * marks.rise),
            sample=step,
        )


@dataclass(frozen=True)
class ShapedTops:
    """Tops by one shape of the fall, for every instant at which it may begin.

    Attributes
    ----------
    log_likelihood : Array
        Shape (m,), marginal.
    height : Array
        Shape (m,), top over the line of the ramp where it is at the highest sample [N].
    variance : Array
        Shape (m,), of `height` [N^2].
    instant : Array
        Shape (m,), of the top from the highest sample [samples].
    """

    log_likelihood: Array
    height: Array
    variance: Array
    instant: Array


@dataclass(frozen=True)
class LocalPeak:
    """A peak that the samples about it show.

    Attributes
    ----------
    height : float
        Over the line of the ramp where it is at the highest sample [N].
    std : float
        [N].
    since : float
        Instant from the highest sample [samples].
    log_likelihood : float
        Marginal, of all shapes together.
    """

    height: float
    std: float
    since: float
    log_likelihood: float


def average_peak_over_shapes(window: Window) -> LocalPeak:
    """Average the top over all shapes, durations and instants by their likelihood."""
    begins = np.arange(_EARLIEST, _LATEST, 1.0 / _PER_SAMPLE)
    tops = []
    for shape in Shape:
        for duration in _DURATIONS:
            tops.append(_fit_tops_for_begins(window, shape, duration, begins))
    log_likelihood = np.concatenate([top.log_likelihood for top in tops])
    height = np.concatenate([top.height for top in tops])
    variance = np.concatenate([top.variance for top in tops])
    instant = np.concatenate([top.instant for top in tops])
    best = float(log_likelihood.max())
    weights = np.exp(np.maximum(log_likelihood - best, -_SURE))
    total = float(weights.sum())
    weights = weights / total
    mean = float(weights @ height)
    # between two instants that are tried the begin may lie anywhere
    grid = (window.climb / _PER_SAMPLE) ** 2 / 12.0
    squares = variance + (height - mean) ** 2
    spread = float(weights @ squares) + grid
    evidence = best + float(np.log(total / log_likelihood.size))
    mean_instant = float(weights @ instant)
    return LocalPeak(mean, float(np.sqrt(spread)), mean_instant, evidence)


def _fit_tops_for_begins(
    window: Window, shape: Shape, duration: float, begins: Array
) -> ShapedTops:
    """Fit the fall of one shape from every instant in `begins`, shape (m,), and find its top.

    The coefficients have a normal prior about zero, but for the level top, whose first coefficient
    takes the climb of the ramp away.
    """
    since = np.maximum(window.since[None, :] - begins[:, None], 0.0)
    columns = shape.build_columns(since)
    target = np.broadcast_to(window.excess, since.shape)
    if shape is Shape.LEVEL:
        target = target + window.climb * since
    prior = (window.rise * shape.list_coefficient_scales(duration)) ** 2
    fitted = _fit_with_prior(columns, target, prior, window.noise)
    reach = np.linspace(0.0, _TOP_REACH, _TOP_STEPS)
    shown = shape.build_columns(reach)
    curves = fitted.weights @ shown.T
    if shape is not Shape.LEVEL:
        curves = curves + window.climb * reach
    top = _find_first_top_indices(curves)
    rows = np.arange(begins.size)
    gradient = shown[top]
    variance = np.einsum("mi,mij,mj->m", gradient, fitted.covariance, gradient)
    # a force that leaves its ramp upwards is no fall
    falls = fitted.weights[:, 0] <= 0.0
    log_likelihood = np.where(falls, fitted.log_likelihood + shape.log_prior, -np.inf)
    height = window.climb * begins + curves[rows, top]
    return ShapedTops(
        log_likelihood=log_likelihood,
        height=height,
        variance=np.asarray(variance),
        instant=begins + reach[top],
    )


def _find_first_top_indices(curves: Array) -> NDArray[np.intp]:
    """Return where each curve of shape (m, t) first stops climbing."""
    stops = np.diff(curves, axis=1) <= 0.0
    is_end = np.ones(len(curves), dtype=bool)
    stops_by_end = np.column_stack([stops, is_end])
    return np.asarray(np.argmax(stops_by_end, axis=1))


@dataclass(frozen=True)
class _Regression:
    """Weights (m, k), their covariance (m, k, k), and marginal log likelihood (m,)."""

    weights: Array
    covariance: Array
    log_likelihood: Array


def _fit_with_prior(columns: Array, target: Array, prior: Array, noise: float) -> _Regression:
    """Fit columns of shape (m, n, k) to targets of shape (m, n), with prior variances (k,)."""
    # in units of the prior, so that all matrices are well conditioned
    scaled = columns * np.sqrt(prior) / noise
    white = target / noise
    precision = np.eye(prior.size) + scaled.transpose(0, 2, 1) @ scaled
    pulled = np.einsum("mnk,mn->mk", scaled, white)
    covariance = np.linalg.inv(precision)
    weights = np.einsum("mij,mj->mi", covariance, pulled)
    _, log_determinant = np.linalg.slogdet(precision)
    square = np.sum(white**2, axis=1) - np.sum(pulled * weights, axis=1)
    size = np.sqrt(prior)
    return _Regression(
        weights=weights * size,
        covariance=covariance * np.outer(size, size),
        log_likelihood=-0.5 * (square + log_determinant),
    )
