"""Psychometric functions of a group, in which every participant has a threshold and a spread."""

# The likelihood of each participant is computed once, on a grid of threshold, spread and lapse
# rate; a fit of the population to these tables then costs little. Logarithms of threshold and
# spread are normal over participants, lapse rates normal but for their limits. Source of the model:
# Moscatelli, Mezzetti, Lacquaniti (2012), Journal of Vision 12(11):26, doi:10.1167/12.11.26; of
# lapse rates with a distribution: Kuss, Jaekel, Wichmann (2005), Journal of Vision 5, 478-492,
# doi:10.1167/5.5.8.

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult, minimize
from scipy.special import gammainccinv, gammaincinv, ndtr
from scipy.stats import t

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.study.analysis.bounded import Bounded
from stepblocks.study.analysis.psychometric import MAX_LAPSE, find_root_by_stepping

_LAPSES = np.linspace(0.0, MAX_LAPSE, 6)
_TINY = 1e-300  # probability of which the logarithm is still finite

# Grid of a likelihood
_MIDDLES, _SPREADS = 80, 40  # values of the threshold and of the spread
_MOST_VALUES = 301
_TRIALS_OF_GRID = 150.0  # of a participant; more trials make a finer grid

# Mean over participants
_ON_BOUND = 0.01  # distance of ln(spread) from its lower bound that counts as none
_LIKELY = 0.05  # probability at the ends of a 95 % interval


@dataclass(frozen=True)
class Estimate:
    """A mean over participants, of a logarithm, or a difference of two, with its 95 % interval.

    Attributes
    ----------
    value, low, high : float
        Natural logarithm of the quantity [1]; an end that the answers leave open is infinite.
    spread : float
        Standard deviation between participants, of the same logarithm [1].
    p : float
        Probability of a value at least this far from zero if it is zero.
    df : float
        Degrees of freedom of its Student's t.
    """

    value: float
    low: float
    high: float
    spread: float
    p: float
    df: float

    @property
    def bounds(self) -> Bounded:
        """The mean with its interval."""
        return Bounded(self.value, self.low, self.high)


class Grid:
    """Likelihood of each participant over threshold, spread and lapse rate.

    Parameters
    ----------
    levels : array_like, shape (n,)
        Natural logarithm of each level.
    hits, totals : array_like, shape (participants, n)
        Answers "higher", and trials, of each participant at each level.

    Attributes
    ----------
    middles, spreads : ndarray
        ln(threshold) and ln(spread), equally spaced.
    axes : tuple of ndarray
        `middles`, `spreads` and lapse rates.
    likelihood : ndarray, shape (participants, middles, spreads, lapses)
        Over its largest value of each participant.

    Raises
    ------
    StudyError
        If there are fewer than three levels.
    """

    def __init__(self, levels: ArrayLike, hits: ArrayLike, totals: ArrayLike) -> None:
        x = np.asarray(levels, dtype=np.float64)
        k = np.asarray(hits, dtype=np.float64)
        n = np.asarray(totals, dtype=np.float64)
        if len(x) < 3:
            raise StudyError(f"a psychometric function needs three levels, got {len(x)}")
        finer = math.sqrt(max(float(n.sum(axis=1).max()) / _TRIALS_OF_GRID, 1.0))
        middles = min(int(_MIDDLES * finer), _MOST_VALUES)
        spreads = min(int(_SPREADS * finer), _MOST_VALUES)
        span = float(np.ptp(x))
        gap = float(np.diff(np.sort(x)).min())
        self.middles = np.linspace(x.min() - 0.3 * span, x.max() + 0.3 * span, middles)
        self.spreads = np.linspace(math.log(0.25 * gap), math.log(3.0 * span), spreads)
        self.axes = (self.middles, self.spreads, _LAPSES)
        rising = ndtr((x - self.middles[:, None, None]) / np.exp(self.spreads)[:, None])
        lapse = _LAPSES[:, None]
        p = np.clip(lapse + (1.0 - 2.0 * lapse) * rising[:, :, None, :], 1e-12, 1.0 - 1e-12)
        log = np.tensordot(k, np.log(p), (1, 3)) + np.tensordot(n - k, np.log1p(-p), (1, 3))
        self.likelihood: Array = np.exp(log - log.max(axis=(1, 2, 3), keepdims=True))


class _Moments(NamedTuple):
    """Moments of a population and of its participants, in spreads from the middle.

    Attributes
    ----------
    likelihood : ndarray, shape (participants,)
        Of each participant.
    posterior : ndarray, shape (axes, 2, participants)
        Mean and mean square along each axis, of each participant.
    prior : ndarray, shape (axes, 2, 1)
        The same of the distribution of all.
    """

    likelihood: Array
    posterior: Array
    prior: Array


class _Informants(NamedTuple):
    """Effective number of participants behind a mean, and their share in its variance.

    Attributes
    ----------
    people : float
        Effective number of participants, at least two.
    share : float
        Share of the observed variance that lies between participants [1]; the remainder is the
        uncertainty of their answers.
    """

    people: float
    share: float


class Population:
    """Independent normal distributions of the participants along the axes of their likelihoods.

    A point is the middle and ln(spread) of the distribution along each axis.

    Parameters
    ----------
    likelihood : ndarray, shape (participants, n, ...)
        One axis for each of `axes`.
    axes : sequence of ndarray
        Equally spaced values.

    Attributes
    ----------
    best : OptimizeResult
        Maximum of the likelihood.
    estimate : callable
        Takes the index of an axis and returns the mean over participants along it, an `Estimate`.

    Raises
    ------
    StudyError
        If there are fewer than two participants.
    """

    def __init__(self, likelihood: Array, axes: Sequence[Array]) -> None:
        if len(likelihood) < 2:
            raise StudyError("a population must have at least two participants, got one")
        self.likelihood = likelihood
        self.axes = axes
        # Participants come last: each axis is then summed over long rows of memory
        self._rows = np.ascontiguousarray(np.moveaxis(likelihood, 0, -1))
        start = list[float]()
        bounds = list[tuple[float, float]]()
        for index, axis in enumerate(axes):
            means = self._average_along_axis(index)
            step = float(axis[1] - axis[0])
            start += [float(means.mean()), math.log(max(means.std(), 2.0 * step))]
            # a narrower normal would fall between the points of the grid
            narrowest, widest = math.log(0.6 * step), math.log(np.ptp(axis))
            bounds += [(axis[0], axis[-1]), (narrowest, widest)]
        self._bounds = np.array(bounds)
        self.best = self.maximise_likelihood(np.array(start))
        # the table, the contrasts and the page ask for the same means
        self.estimate: Callable[[int], Estimate] = cache(self._estimate_mean)

    def _average_along_axis(self, axis_index: int) -> Array:
        """Return the mean of each participant's likelihood along an axis, shape (participants,)."""
        summed = list(range(1, self.likelihood.ndim))
        summed.remove(axis_index + 1)
        profiles = self.likelihood.sum(axis=tuple(summed))
        return np.asarray(profiles @ self.axes[axis_index] / profiles.sum(axis=1))

    def _compute_distribution_weights(self, point: Array, axis_index: int) -> Array:
        """Return the weights of the distribution along an axis, shape (3, n).

        They are multiplied by the powers 0, 1 and 2 of the distance from the middle, in spreads.
        """
        distance = (self.axes[axis_index] - point[2 * axis_index]) / math.exp(
            point[2 * axis_index + 1]
        )
        weight = np.exp(0.5 * (np.min(distance**2) - distance**2))
        powers = [np.ones_like(distance), distance, distance**2]
        return np.asarray(powers * (weight / weight.sum()))

    def _compute_moments(self, point: Array) -> _Moments:
        """Return likelihoods and moments of the participants, and moments of the distribution."""
        weights = [
            self._compute_distribution_weights(point, index) for index in range(len(self.axes))
        ]
        sums = self._rows
        for index, rows in enumerate(weights):
            sums = np.tensordot(rows, sums, (1, index))
        # the last axis stands first, so that the powers of each axis are 3 times as far apart
        places = 3 ** np.arange(len(weights))[:, np.newaxis] * np.arange(3)
        along = sums.reshape(3 ** len(weights), -1)[places]
        likelihood = along[0, 0]
        prior = [rows[1:].sum(axis=1, keepdims=True) for rows in weights]
        return _Moments(likelihood, along[:, 1:] / likelihood, np.array(prior))

    def _compute_loss(self, point: Array) -> tuple[float, Array]:
        """Return minus the log likelihood, and its gradient, shape (2 axes,)."""
        moments = self._compute_moments(point)
        slopes = (moments.posterior - moments.prior).sum(axis=2)
        slopes[:, 0] /= np.exp(point[1::2])
        return -float(np.log(moments.likelihood).sum()), -slopes.ravel()

    def maximise_likelihood(
        self, start: Array, held_index: int = -1, held_value: float = 0.0
    ) -> OptimizeResult:
        """Maximise the likelihood, with one parameter held at a value where a place is given."""
        bounds = self._bounds.copy()
        if held_index >= 0:
            bounds[held_index] = held_value
        best: OptimizeResult = minimize(
            self._compute_loss,
            np.clip(start, bounds[:, 0], bounds[:, 1]),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(bounds[:, 0].tolist(), bounds[:, 1].tolist(), strict=True)),
            options={"ftol": 1e-11, "gtol": 1e-6},
        )
        return best

    def _estimate_mean(self, axis_index: int) -> Estimate:
        """Return the mean over participants along an axis."""
        place = 2 * axis_index
        point = self.best.x
        middle = float(point[place])
        spread = math.exp(point[place + 1])
        compute_p_value = self._make_p_value_function(axis_index)

        def compute_log_excess(value: float) -> float:
            """Return a number that is positive outside the 95 % interval."""
            return math.log(_LIKELY / max(compute_p_value(value), _TINY))

        informants = self._estimate_effective_participants(point, axis_index)
        error = spread / math.sqrt(informants.people * informants.share)
        lowest, highest = self._bounds[place]
        low = find_root_by_stepping(compute_log_excess, middle, lowest, -2.5 * error)
        high = find_root_by_stepping(compute_log_excess, middle, highest, 2.5 * error)
        p = math.nan
        if lowest < 0.0 < highest:
            p = compute_p_value(0.0)
        return Estimate(middle, low, high, spread, p, informants.people - 1.0)

    def _make_p_value_function(self, axis_index: int) -> Callable[[float], float]:
        """Return a function of the mean along an axis.

        It gives the probability of a likelihood ratio as large as the observed one if that is the
        mean.
        """
        place = 2 * axis_index
        middle = float(self.best.x[place])
        spread = math.exp(self.best.x[place + 1])
        climbed = {middle: self.best.x}  # points of the profile by their mean

        @cache
        def compute_p_value(value: float) -> float:
            """Return the probability of a likelihood ratio as large if the mean is `value`."""
            nearest = min(climbed, key=lambda known: abs(known - value))
            found = self.maximise_likelihood(climbed[nearest], place, value)
            if found.x[place + 1] < self._bounds[place + 1, 0] + _ON_BOUND:
                # participants who seem alike may lie on another hill than ones who differ
                start = found.x.copy()
                start[place + 1] = math.log(math.hypot(spread, value - middle))
                wider = self.maximise_likelihood(start, place, value)
                found = min(found, wider, key=lambda fit: fit.fun)
            climbed[value] = found.x
            informants = self._estimate_effective_participants(found.x, axis_index)
            ratio = 2.0 * (float(found.fun) - float(self.best.fun))
            return compute_tail_probability(ratio, informants.people, informants.share)

        return compute_p_value

    def _estimate_effective_participants(self, point: Array, axis_index: int) -> _Informants:
        """Return the effective number of participants along an axis, and their share."""
        moments = self._compute_moments(point)
        prior_mean, prior_square = moments.prior[axis_index]
        mean, square = moments.posterior[axis_index]
        shares = prior_square - prior_mean**2 - square + mean**2
        shares = np.clip(shares, 1e-6, 1.0 - 1e-6)
        total = float(shares.sum())
        squares = float((shares**2).sum())
        return _Informants(max(total**2 / squares, 2.0), squares / total)

    def predict_participant_means(self, axis_index: int) -> Array:
        """Return the mean of each participant's posterior along an axis, shape (participants,)."""
        middle = self.best.x[2 * axis_index]
        spread = math.exp(self.best.x[2 * axis_index + 1])
        means = self._compute_moments(self.best.x).posterior[axis_index, 0]
        return np.asarray(middle + spread * means)

    def compute_axis_likelihoods(self, axis_index: int) -> Array:
        """Return the likelihood of each participant along one of two axes and the lapse rates.

        Returns
        -------
        ndarray, shape (participants, n, lapses)
            Summed over the other axis, weighted by its distribution.
        """
        weights = self._compute_distribution_weights(self.best.x, 1 - axis_index)[0]
        return np.tensordot(self.likelihood, weights, (2 - axis_index, 0))


def compute_tail_probability(
    likelihood_ratio: float, participant_count: float, share_between: float
) -> float:
    """Return the probability of a larger likelihood ratio of the mean of normal participants.

    Each has a known error; `share_between` of the variance of what they show is between
    participants, who never vary by less than nothing. With a share of one it is Student's t, of
    zero nearly normal.
    """
    # The ratio follows from the mean and the variance of a sample, which are independent. The
    # spread is the one that fits the tested mean: what the sample has by itself is too narrow.
    half = 0.5 * (participant_count - 1.0)
    known = 1.0 - share_between
    squares = 2.0 * np.geomspace(gammaincinv(half, 1e-13), gammainccinv(half, 1e-13), 300)
    weight = np.exp(half * np.log(squares) - 0.5 * squares)
    variance = squares / participant_count
    fitted = np.maximum(variance, known)
    least = likelihood_ratio / participant_count + np.log(fitted / known) + variance / fitted
    square = known * np.where(least < 1.0, least, np.exp(np.minimum(least - 1.0, 700.0)))
    distance = np.sqrt(participant_count * np.maximum(square - variance, 0.0))
    return float(weight @ (2.0 * ndtr(-distance)) / weight.sum())


def compare_within_participants(first: Array, second: Array, axis: Array) -> Estimate:
    """Compare two conditions by the same participants, `first` minus `second`.

    Parameters
    ----------
    first, second : ndarray, shape (participants, n, lapses)
        Likelihoods along an axis and lapse rates, as `Population.compute_axis_likelihoods`
        returns them.
    axis : ndarray, shape (n,)
        Equally spaced values.
    """
    # The mean of a participant's two values is free: it is summed over the whole axis. A lapse rate
    # is the participant's in both conditions: with one for each condition, what that of all takes
    # in one of them from the spread of everybody would count as a difference.
    correlated = []
    for of_first, of_second in zip(first, second, strict=True):
        correlated.append(_compute_difference_likelihoods(of_first, of_second))
    likelihood = np.array(correlated).swapaxes(1, 2)
    steps = (axis[1] - axis[0]) * np.arange(1 - len(axis), len(axis))
    scaled = likelihood / likelihood.max(axis=(1, 2), keepdims=True)
    return Population(scaled, (steps, _LAPSES)).estimate(0)


def _compute_difference_likelihoods(first: Array, second: Array) -> list[Array]:
    """Return the likelihood of the difference of one participant's values, for each lapse rate.

    Both likelihoods have the shape (n, lapses); each result has the shape (2 n - 1,).
    """
    pairs = zip(first.T, second.T, strict=True)
    return [np.correlate(likelihood, facing, "full") for likelihood, facing in pairs]


def compare_between_groups(first: Estimate, second: Estimate) -> Estimate:
    """Compare two groups of participants, `first` minus `second`.

    Half widths of both intervals follow Zou, G. Y., Donner, A. (2008), Statistics in Medicine 27,
    1693-1702, doi:10.1002/sim.3095, taken as errors with the degrees of freedom of Welch, B. L.
    (1947), Biometrika 34, 28-35, doi:10.1093/biomet/34.1-2.28: of means this is his test. They go
    by participants; more, for the share of the error that is known, claim too few differences.
    """
    difference = first.value - second.value
    freedom = np.array([first.df, second.df])
    widths = [
        (first.value - first.low, second.high - second.value),
        (first.high - first.value, second.value - second.low),
    ]
    squares = (np.array(widths) / t.ppf(0.975, freedom)) ** 2
    with np.errstate(invalid="ignore"):  # an end that the answers leave open has all of the error
        shares = np.nan_to_num(squares / squares.sum(axis=1, keepdims=True), nan=1.0)
    errors = np.sqrt(squares.sum(axis=1))
    df = 1.0 / (shares**2 @ (1.0 / freedom))
    below, above = (errors * t.ppf(0.975, df)).tolist()
    facing_zero = 0 if difference > 0.0 else 1  # the end on the side of zero
    statistic = abs(difference) / errors[facing_zero]
    return Estimate(
        difference,
        difference - below,
        difference + above,
        math.nan,
        2.0 * float(t.sf(statistic, df[facing_zero])),
        float(df[facing_zero]),
    )
