"""Psychometric functions by maximum likelihood: threshold, spread, Weber fraction, lapses."""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, brentq, minimize
from scipy.special import ndtr, xlog1py, xlogy

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.study.analysis.bounded import Bounded

# Largest lapse rate that a fit may take; Wichmann and Hill (2001) bound it so that it cannot stand
# in for the slope
MAX_LAPSE = 0.1
Z75 = 0.6744897501960817  # standard normal quantile of 0.75
Z975 = 1.959963984540054
_ROOT = math.sqrt(2.0 * math.pi)
_CHI95 = 3.841458820694124  # 95 % point of chi squared with one degree of freedom

_PARAMETERS = 3  # middle, ln(spread), lapse rate
_MIDDLE, _LOG_SPREAD = 0, 1  # their places in a point
_START_LAPSE = 0.02
_LOG_SPREADS = (-8.0, 4.0)  # bounds of ln(spread)
_PROFILE_STEP = 0.2  # first step along a profile, in spreads of at most e
_CERTAIN = 1e-15  # distance of a predicted probability from 0 and 1
_SHARPER = 1e-3  # log likelihood by which a spread must be better than none
_SIMULATED_TABLES = 2000  # answers drawn to assess a fit


@dataclass(frozen=True)
class Psychometric:
    """Cumulative normal in the logarithm of the level, with one lapse rate for both ends.

    Attributes
    ----------
    threshold : Bounded
        Level in the middle between the asymptotes, in the unit of the levels, with its
        95 % interval by profile likelihood; of a comparison the point of subjective equality.
    spread : float
        Standard deviation sigma of the normal, in natural logarithms of the level [1].
    weber : Bounded
        Just noticeable difference over threshold, ``exp(0.6745 sigma) - 1``, from the middle to
        three quarters of the rise, with its interval [1]; an end that the answers leave open is
        0 or infinite.
    lapse : float
        Rate of errors that do not depend on the level [1].
    deviance : float
        Twice the log likelihood by which the saturated model is better [1].
    df : int
        Levels minus parameters.
    dispersion, p_fit : float
        Pearson's chi squared over its degrees of freedom [1], and the share of simulated tables
        of the fitted function with a larger one; small where the function does not fit.
    """

    threshold: Bounded
    spread: float
    weber: Bounded
    lapse: float
    deviance: float
    df: int
    dispersion: float
    p_fit: float


class FitQuality(NamedTuple):
    """Pearson's chi squared over its degrees of freedom [1], and its probability."""

    dispersion: float
    p: float


class _Counts(NamedTuple):
    """Answers of one participant.

    Attributes
    ----------
    levels, hits, totals : ndarray, shape (n,)
        Levels with trials, in their unit; answers "higher", and trials.
    """

    levels: Array
    hits: Array
    totals: Array


class _Start(NamedTuple):
    """Middle and spread of a probit, as logarithms."""

    middle: float
    log_spread: float


class _CurveLikelihood:
    """Likelihood of the answers of one participant.

    A point is the logarithm of the threshold, that of the spread, and the lapse rate.
    """

    def __init__(self, counts: _Counts) -> None:
        self.counts = counts
        self.log_levels = np.log(counts.levels)
        span = np.ptp(self.log_levels)
        lowest = -2.0 * span + self.log_levels.min()
        highest = 2.0 * span + self.log_levels.max()
        self.bounds = [(lowest, highest), _LOG_SPREADS, (0.0, MAX_LAPSE)]

    def predict_with_slopes(self, point: Array) -> tuple[Array, Array]:
        """Return the probability of a hit at each level, shape (n,), and its slopes (3, n)."""
        middle, log_spread, lapse = point
        spread = math.exp(log_spread)
        distance = (self.log_levels - middle) / spread
        rising = ndtr(distance)
        density = (1.0 - 2.0 * lapse) * np.exp(-0.5 * distance**2) / _ROOT
        p = np.clip(lapse + (1.0 - 2.0 * lapse) * rising, _CERTAIN, 1.0 - _CERTAIN)
        return p, np.array([-density / spread, -density * distance, 1.0 - 2.0 * rising])

    def compute_loss_of_probabilities(self, probabilities: Array) -> Array:
        """Return minus the log likelihood of predicted probabilities, shape (..., n)."""
        _, hits, totals = self.counts
        return np.asarray(
            -np.sum(xlogy(hits, probabilities) + xlog1py(totals - hits, -probabilities), axis=-1)
        )

    def compute_loss_and_slopes(self, point: Array) -> tuple[float, Array]:
        """Return minus the log likelihood of a point, and its slopes, shape (3,)."""
        _, hits, totals = self.counts
        p, slopes = self.predict_with_slopes(point)
        return float(self.compute_loss_of_probabilities(p)), slopes @ (
            (totals - hits) / (1.0 - p) - hits / p
        )

    def maximise_likelihood(
        self, start: Sequence[float], held_index: int = -1, held_value: float = 0.0
    ) -> OptimizeResult:
        """Maximise the likelihood; a parameter at `held_index`, if any, stays at `held_value`."""
        bounds = list(self.bounds)
        if held_index >= 0:
            bounds[held_index] = (held_value, held_value)
        return minimize(
            self.compute_loss_and_slopes,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000},
        )


def fit_psychometric(
    levels: Sequence[float], hits: Sequence[int], totals: Sequence[int]
) -> Psychometric:
    """Fit a psychometric function to the answers of one participant.

    Who lapses in a comparison errs to either side: one rate for both ends.

    Parameters
    ----------
    levels : sequence of float
        Positive; in any unit.
    hits, totals : sequence of int
        Answers "higher", and trials, at each level.

    Returns
    -------
    Psychometric
        With 95 % intervals by profile likelihood.

    Raises
    ------
    StudyError
        If the answers do not rise with the level, or do not determine threshold and spread.

    References
    ----------
    Wichmann, F. A., Hill, N. J. (2001), Perception & Psychophysics 63, 1293-1313,
    doi:10.3758/BF03194544.

    Examples
    --------
    >>> fit = fit_psychometric([30, 40, 50, 60, 80], [1, 4, 10, 15, 20], [20] * 5)
    >>> 45 < fit.threshold.value < 55
    True
    """
    counts = _select_tried_levels(levels, hits, totals)
    likelihood = _CurveLikelihood(counts)
    start = _estimate_start_by_probit(likelihood.log_levels, counts)
    best = _maximise_from_starts(likelihood, start)
    # what a spread of zero loses more; where that is nothing, all small spreads fit alike
    sharper = float(
        likelihood.compute_loss_of_probabilities(_predict_step_functions(counts)).min()
    ) - float(best.fun)
    middle = _estimate_by_profile(likelihood, best, _MIDDLE, start)
    log_spread = _estimate_by_profile(likelihood, best, _LOG_SPREAD, start)
    trials = f"{counts.totals.sum():.0f} trials"
    # a threshold that is open comes first: its spread is then unknown as well
    if not math.isfinite(middle.high - middle.low):
        raise StudyError(
            f"answers leave the threshold open: it is not determined from {trials}; add "
            "trials, or levels around it"
        )
    if not (math.isfinite(log_spread.high) and sharper > _SHARPER):
        raise StudyError(
            "answers jump between two of the levels: the spread is not determined from "
            f"{trials}; add levels between them"
        )
    lowest = log_spread.low
    if not 2.0 * sharper > _CHI95:
        lowest = -math.inf
    predicted, slopes = likelihood.predict_with_slopes(best.x)
    quality = assess_goodness_of_fit(predicted, slopes, counts.hits, counts.totals)
    saturated = float(likelihood.compute_loss_of_probabilities(counts.hits / counts.totals))
    lapse = float(best.x[-1])
    return Psychometric(
        threshold=middle.transform(math.exp),
        spread=math.exp(log_spread.value),
        weber=log_spread._replace(low=lowest).transform(compute_weber_fraction),
        lapse=lapse,
        deviance=2.0 * (float(best.fun) - saturated),
        df=len(counts.levels) - _PARAMETERS,
        dispersion=quality.dispersion,
        p_fit=quality.p,
    )


class CurveEstimate(NamedTuple):
    """A psychometric function without intervals.

    Attributes
    ----------
    middle, log_spread : float
        ln(threshold) and ln(spread), of the logarithm of the level.
    lapse : float
        Rate of errors at either end [1].
    """

    middle: float
    log_spread: float
    lapse: float


def estimate_psychometric(levels: Array, hits: Array, totals: Array) -> CurveEstimate:
    """Return the curve that `fit_psychometric` finds, without intervals.

    Parameters and errors are its own, but for a spread that the answers leave open, which is here
    the smallest that fits.
    """
    counts = _select_tried_levels(levels, hits, totals)
    likelihood = _CurveLikelihood(counts)
    best = _maximise_from_starts(
        likelihood, _estimate_start_by_probit(likelihood.log_levels, counts)
    )
    return CurveEstimate(*(float(value) for value in best.x))


def _maximise_from_starts(likelihood: _CurveLikelihood, start: _Start) -> OptimizeResult:
    """Maximise a likelihood from a start and from one of half the spread; return the better."""
    starts = [
        [start.middle, start.log_spread, _START_LAPSE],
        [start.middle, start.log_spread - 0.7, _START_LAPSE],
    ]
    return min(
        (likelihood.maximise_likelihood(point) for point in starts), key=lambda fit: float(fit.fun)
    )


def _estimate_by_profile(
    likelihood: _CurveLikelihood, best: OptimizeResult, parameter_index: int, start: _Start
) -> Bounded:
    """Estimate a parameter with the ends of its interval by profile likelihood, at 95 %.

    `best` is the maximum of the likelihood, `parameter_index` that of the parameter in a point.
    """

    def compute_profile_excess(value: float) -> float:
        """Return by how much the profile lies beyond its 95 % limit at a value."""
        points = [
            [*best.x],
            [best.x[_MIDDLE], best.x[_LOG_SPREAD], _START_LAPSE],
            [start.middle, start.log_spread, _START_LAPSE],
        ]
        losses = []
        for point in points:
            point[parameter_index] = value
            losses.append(float(likelihood.maximise_likelihood(point, parameter_index, value).fun))
        return 2.0 * (min(losses) - float(best.fun)) - _CHI95

    value = float(best.x[parameter_index])
    lowest, highest = likelihood.bounds[parameter_index]
    step = _PROFILE_STEP * math.exp(min(best.x[_LOG_SPREAD], 1.0))
    return Bounded(
        value,
        find_root_by_stepping(compute_profile_excess, value, lowest, -step),
        find_root_by_stepping(compute_profile_excess, value, highest, step),
    )


def find_root_by_stepping(
    function: Callable[[float], float], start: float, end: float, step: float
) -> float:
    """Step from a start, where a function is negative, to its root; infinite beyond the end.

    The sign of the step is the direction, also where the start is the end.
    """
    limit: Callable[[float, float], float] = min if step > 0.0 else max
    outer = start
    above = -1.0
    while above <= 0.0 and outer != end:
        inner = outer
        outer = limit(outer + step, end)
        above = function(outer)
        step *= 2.0
    if not above > 0.0:
        return step * math.inf
    return float(brentq(function, inner, outer, xtol=1e-6))


def assess_goodness_of_fit(
    probabilities: Array, slopes: Array, hits: Array, totals: Array
) -> FitQuality:
    """Compare Pearson's chi squared with that of answers that the fitted function gives.

    Parameters
    ----------
    probabilities : ndarray, shape (n,)
        Predicted probability of a hit at each level.
    slopes : ndarray, shape (parameters, n)
        Derivatives of `probabilities` by the parameters.
    hits, totals : ndarray, shape (n,)
        Answers "higher", and trials, at each level.
    """
    # In place of a fit to each simulated table, what a fit would take up is projected out.
    weight = np.sqrt(totals / (probabilities * (1.0 - probabilities)))
    fitted = np.linalg.qr((weight * slopes).T)[0]
    shape = (_SIMULATED_TABLES, len(probabilities))
    drawn = np.random.default_rng(1).binomial(totals.astype(int), probabilities, shape) / totals
    residuals = weight * (np.vstack([hits / totals, drawn]) - probabilities)
    squares = np.sum((residuals - residuals @ fitted @ fitted.T) ** 2, axis=1)
    observed, simulated = squares[0], squares[1:]
    share = float((simulated >= observed * (1.0 - 1e-9)).mean())
    return FitQuality(float(observed) / max(len(probabilities) - _PARAMETERS, 1), share)


def _predict_step_functions(counts: _Counts) -> Array:
    """Return what functions of no spread predict, shape (2, n, n), one with a step at each level.

    At the step there is any share between the lapses. The lapse rate is that of the other levels
    (first), or of all where the function jumps (second).
    """
    levels, hits, totals = counts
    same = levels[:, np.newaxis] == levels
    below = levels < levels[:, np.newaxis]
    hits_here = same @ hits
    totals_here = same @ totals
    wrong = np.sum(~same * np.where(below, hits, totals - hits), axis=1)
    rate_elsewhere = wrong / (totals.sum() - totals_here)
    wrong_here = np.minimum(hits_here, totals_here - hits_here)
    rate_everywhere = (wrong + wrong_here) / totals.sum()
    rate = np.clip([rate_elsewhere, rate_everywhere], _CERTAIN, MAX_LAPSE)[..., np.newaxis]
    at_step = np.clip((hits_here / totals_here)[:, np.newaxis], rate, 1.0 - rate)
    away_from_step = np.where(below, rate, 1.0 - rate)
    return np.asarray(np.where(same, at_step, away_from_step))


def compute_weber_fraction(log_spread: float) -> float:
    """Return the Weber fraction of a spread, given as its logarithm."""
    return math.expm1(min(Z75 * math.exp(min(log_spread, 20.0)), 700.0))


def _select_tried_levels(
    levels: Sequence[float] | Array, hits: Sequence[int] | Array, totals: Sequence[int] | Array
) -> _Counts:
    """Return the answers of a participant at levels with trials; refuse impossible counts."""
    x = np.asarray(levels, dtype=np.float64)
    k = np.asarray(hits, dtype=np.float64)
    n = np.asarray(totals, dtype=np.float64)
    if not (x.ndim == 1 and x.shape == k.shape == n.shape):
        raise StudyError(
            "levels, hits and totals must be lists of one length, got "
            f"{x.size}, {k.size} and {n.size}"
        )
    if not (np.isfinite(x).all() and (x > 0.0).all()):
        raise StudyError("levels must be positive and finite")
    whole = (k == np.round(k)) & (n == np.round(n))
    if not (whole & (n >= 0.0) & (k >= 0.0) & (k <= n)).all():
        raise StudyError("hits must be whole numbers from 0 to the number of trials of their level")
    tried = n > 0
    distinct = np.unique(x[tried]).size
    if distinct < _PARAMETERS:
        raise StudyError(f"a psychometric function needs trials at three levels, got {distinct}")
    return _Counts(x[tried], k[tried], n[tried])


def _estimate_start_by_probit(log_levels: Array, counts: _Counts) -> _Start:
    """Return the middle and ln(spread) of a probit; refuse answers that have none."""
    _, hits, totals = counts
    intercept, slope = _fit_probit(log_levels, hits, totals)
    if not (slope > 0.0 and np.ptp(hits / totals) > 0.0):
        raise StudyError("answers must rise with the level, got ones that do not")
    if not np.any((hits > 0.0) & (hits < totals)):
        raise StudyError(
            "answers jump from none to all between two levels: the spread is not determined; add "
            "levels between them"
        )
    return _Start(-intercept / slope, math.log(1.0 / slope))


def _fit_probit(log_levels: Array, hits: Array, totals: Array) -> Array:
    """Return intercept and slope of a probit regression, shape (2,)."""
    import statsmodels.api as sm

    link = sm.families.Binomial(sm.families.links.Probit())
    answers = np.column_stack([hits, totals - hits])
    model = sm.GLM(answers, sm.add_constant(log_levels), family=link)
    with warnings.catch_warnings(action="ignore"):  # separation is reported by the caller
        coefficients: Array = model.fit(tol=1e-12, maxiter=200).params
    return coefficients
