"""Psychometric functions by maximum likelihood: threshold, spread, Weber fraction, lapses."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study import require

# Largest lapse rate that a fit may take; Wichmann and Hill (2001) bound it so that it cannot stand in for the slope
MAX_LAPSE = 0.1
Z75 = 0.6744897501960817  # standard normal quantile of 0.75
Z975 = 1.959963984540054
# standard error of the logarithm of a spread or a threshold beyond which its interval spans a factor of fifty
_VAGUE = 1.0
# curvature of the log likelihood that counts as none [1]: a logarithm known to a standard deviation of 10 is not known
_LEAST_INFORMATION = 1e-2
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Psychometric:
    """A cumulative normal in the logarithm of the level, with guesses and lapses."""

    # level in the middle between guess and 1 - lapse, in the unit of the levels; for a comparison with a standard the
    # point of subjective equality
    threshold: float
    threshold_low: float  # ends of its 95 % interval
    threshold_high: float
    spread: float  # standard deviation sigma of the normal, in natural logarithms of the level [1]
    # just noticeable difference over threshold, ``exp(0.6745 sigma) - 1``, from the middle to three quarters of the rise
    weber: float
    weber_low: float  # ends of its 95 % interval [1]
    weber_high: float
    lapse: float  # rate [1]
    deviance: float  # twice the log likelihood that the saturated model is better by [1]
    df: int  # levels minus parameters
    trials: int


def fit_psychometric(
    levels: Sequence[float],
    hits: Sequence[int],
    totals: Sequence[int],
    guess: float | None = 0.0,
    lapse: float | None = 0.0,
) -> Psychometric:
    """Fit a psychometric function.

    Source: Wichmann, F. A., Hill, N. J. (2001), Perception & Psychophysics 63, 1293-1313, doi:10.3758/BF03194544.

    Examples
    --------
    >>> fit = fit_psychometric([20e-6, 40e-6, 60e-6, 80e-6], [2, 8, 15, 19], [20, 20, 20, 20])
    >>> f"{fit.threshold * 1e6:.1f} um, Weber fraction {fit.weber:.2f}"
    '41.6 um, Weber fraction 0.40'
    """
    x, k, n = _checked(levels, hits, totals, guess, lapse)
    start = _by_glm(np.log(x), k, n)
    if lapse == 0.0 and not guess:
        return _of_glm(start, len(x), int(n.sum()))
    return _by_likelihood(start, x, k, n, guess, lapse)


def crossing(intercept: float, slope: float, covariance: Any, quantile: float = 0.0) -> tuple[float, float]:
    """Return where a line reaches a quantile, with its standard error by the delta method."""
    x = (quantile - intercept) / slope
    gradient = np.array([-1.0 / slope, -x / slope])
    return x, math.sqrt(float(gradient @ np.asarray(covariance) @ gradient))


def _checked(
    levels: Sequence[float], hits: Sequence[int], totals: Sequence[int], guess: float | None, lapse: float | None
) -> tuple[Array, Array, Array]:
    x, k, n = (np.asarray(values, dtype=np.float64) for values in (levels, hits, totals))
    if not (x.ndim == 1 and x.shape == k.shape == n.shape):
        raise StudyError(f"levels, hits and totals must be lists of one length, got {x.size}, {k.size} and {n.size}")
    require(np.isfinite(x).all() and (x > 0.0).all(), "levels must be positive and finite")
    if not ((n >= 0.0) & (k >= 0.0) & (k <= n) & (k == np.round(k)) & (n == np.round(n))).all():
        raise StudyError("hits must be whole numbers from 0 to the number of trials of their level")
    for name, rate in (("guess", guess), ("lapse", lapse)):
        if rate is not None and not 0.0 <= rate < 1.0:
            raise StudyError(f"{name} must be a rate from 0 to below 1, got {rate:g}")
    if (guess or 0.0) + (MAX_LAPSE if lapse is None else lapse) >= 1.0:
        raise StudyError(f"guess and lapse must sum to less than 1, got {guess} and {lapse}")
    if np.unique(x[n > 0]).size < 3:
        raise StudyError(f"a psychometric function needs trials at three levels, got {np.unique(x[n > 0]).size}")
    return x[n > 0], k[n > 0], n[n > 0]


def _by_glm(log_x: Array, k: Array, n: Array) -> Any:
    import statsmodels.api as sm

    model = sm.GLM(
        np.column_stack([k, n - k]), sm.add_constant(log_x), family=sm.families.Binomial(sm.families.links.Probit())
    )
    with warnings.catch_warnings(action="ignore"):  # separation is told apart below, in words
        fit = model.fit(tol=1e-12, maxiter=200)
    share = (k / n)[np.argsort(log_x)]
    if fit.params[1] <= 0.0 or np.ptp(share) == 0.0:
        raise StudyError("answers must rise with the level, got ones that do not")
    require(
        np.any((share > 0.0) & (share < 1.0)),
        "answers jump from none to all between two levels: no spread can be told; add levels between them",
    )
    return fit


def _by_likelihood(start: Any, x: Array, k: Array, n: Array, guess: float | None, lapse: float | None) -> Psychometric:
    from scipy.optimize import minimize
    from scipy.special import ndtr, xlog1py, xlogy
    from statsmodels.tools.numdiff import approx_hess

    log_x = np.log(x)

    def loss(parameters: Array) -> float:
        rate = float(parameters[2]) if lapse is None else lapse
        low = rate if guess is None else guess
        p = low + (1.0 - low - rate) * ndtr((log_x - parameters[0]) / math.exp(parameters[1]))
        p = np.clip(p, 1e-15, 1.0 - 1e-15)
        return -float(np.sum(xlogy(k, p) + xlog1py(n - k, -p)))

    rates = [0.02] if lapse is None else []
    bounds = [(None, None), (-8.0, 4.0), *((0.0, MAX_LAPSE) for _ in rates)]
    middle, spread = -start.params[0] / start.params[1], math.log(1.0 / start.params[1])
    options = {"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000}
    starts = ([middle, spread - shrink, *rates] for shrink in (0.0, 0.7))
    fits = [minimize(loss, one, method="L-BFGS-B", bounds=bounds, options=options) for one in starts]
    found = min(fits, key=lambda one: float(one.fun))
    require(not found.x[1] <= -7.9, "answers jump between two levels: no spread can be told; add levels between them")
    rate = float(found.x[2]) if lapse is None else lapse
    free = 3 if lapse is None and 1e-6 < rate < MAX_LAPSE - 1e-6 else 2

    def around(parameters: Array) -> float:
        return loss(np.concatenate([parameters, found.x[free:]]))

    errors = np.sqrt(np.maximum(np.diag(_covariance(approx_hess(found.x[:free], around))), 0.0))
    saturated = -float(np.sum(xlogy(k, k / n) + xlogy(n - k, (n - k) / n)))
    logs = [(float(found.x[index]), float(errors[index])) for index in (0, 1)]
    deviance, df = 2.0 * (float(found.fun) - saturated), len(x) - 2 - len(rates)
    return _summary(*logs, lapse=rate, deviance=deviance, df=df, trials=int(n.sum()))


def _covariance(information: Any) -> Array:
    """Invert the information; on a plateau its curvatures are rounding of either sign, so they get a floor."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray((vectors / np.maximum(values, _LEAST_INFORMATION)) @ vectors.T)


def _of_glm(fit: Any, count: int, trials: int) -> Psychometric:
    (intercept, slope), covariance = map(float, fit.params), np.asarray(fit.cov_params())
    spread = (-math.log(slope), math.sqrt(covariance[1, 1]) / slope)
    middle = crossing(intercept, slope, covariance)
    return _summary(middle, spread, lapse=0.0, deviance=float(fit.deviance), df=count - 2, trials=trials)


def _summary(
    middle: tuple[float, float], spread: tuple[float, float], *, lapse: float, deviance: float, df: int, trials: int
) -> Psychometric:
    """Give intervals from the logarithms of threshold and spread, each with its standard error."""
    # a threshold that is open comes first: its spread is then unknown as well
    require(
        middle[1] < _VAGUE,
        f"answers leave the threshold open: it cannot be told from {trials} trials; add trials, or levels around it",
    )
    require(
        spread[1] < _VAGUE,
        f"answers jump between two of the levels: no spread can be told from {trials} trials; add levels between them",
    )

    def weber(log_sigma: float) -> float:
        return math.expm1(min(Z75 * math.exp(min(log_sigma, 20.0)), 700.0))

    reach = Z975 * middle[1]
    return Psychometric(
        threshold=math.exp(middle[0]),
        threshold_low=math.exp(middle[0] - reach),
        threshold_high=math.exp(middle[0] + reach),
        spread=math.exp(spread[0]),
        weber=weber(spread[0]),
        weber_low=weber(spread[0] - Z975 * spread[1]),
        weber_high=weber(spread[0] + Z975 * spread[1]),
        lapse=lapse,
        deviance=deviance,
        df=df,
        trials=trials,
    )
