"""Psychometric functions by maximum likelihood: threshold, spread, Weber fraction, lapses."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study import require

# Largest lapse rate that a fit may take; Wichmann and Hill (2001) bound it so that it cannot stand
# in for the slope
MAX_LAPSE = 0.1
Z75 = 0.6744897501960817  # standard normal quantile of 0.75
Z975 = 1.959963984540054
# standard error of the logarithm of a spread or a threshold beyond which its interval spans a
# factor of fifty
_VAGUE = 1.0
# curvature of the log likelihood that counts as none [1]: a logarithm known to a standard deviation
# of 10 is not known
_LEAST_INFORMATION = 1e-2
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Psychometric:
    """A cumulative normal in the logarithm of the level, with guesses and lapses."""

    # level in the middle between guess and 1 - lapse, in the unit of the levels; for a comparison
    # with a standard the point of subjective equality
    threshold: float
    threshold_low: float  # ends of its 95 % interval
    threshold_high: float
    spread: float  # standard deviation sigma of the normal, in natural logarithms of the level [1]
    # just noticeable difference over threshold, ``exp(0.6745 sigma) - 1``, from the middle to three
    # quarters of the rise
    weber: float
    weber_low: float  # ends of its 95 % interval [1]
    weber_high: float
    lapse: float  # rate [1]
    deviance: float  # twice the log likelihood that the saturated model is better by [1]
    df: int  # levels minus parameters
    trials: int


def fit_psychometric(
    levels: Sequence[float], hits: Sequence[int], totals: Sequence[int]
) -> Psychometric:
    """Fit a psychometric function; who lapses in a comparison errs to either side, so one rate bounds both ends."""
    # Wichmann, F. A., Hill, N. J. (2001), Perception & Psychophysics 63, 1293-1313,
    # doi:10.3758/BF03194544.
    from scipy.optimize import minimize
    from scipy.special import ndtr, xlog1py, xlogy
    from statsmodels.tools.numdiff import approx_hess

    x, k, n = _checked(levels, hits, totals)
    log_x = np.log(x)

    def loss(parameters: Array) -> float:
        rate = float(parameters[2])
        p = rate + (1.0 - rate - rate) * ndtr((log_x - parameters[0]) / math.exp(parameters[1]))
        p = np.clip(p, 1e-15, 1.0 - 1e-15)
        return -float(np.sum(xlogy(k, p) + xlog1py(n - k, -p)))

    bounds = [(None, None), (-8.0, 4.0), (0.0, MAX_LAPSE)]
    middle, spread = _without_lapses(log_x, k, n)
    options = {"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000}
    starts = ([middle, spread - shrink, 0.02] for shrink in (0.0, 0.7))
    fits = [
        minimize(loss, one, method="L-BFGS-B", bounds=bounds, options=options) for one in starts
    ]
    found = min(fits, key=lambda one: float(one.fun))
    require(
        not found.x[1] <= -7.9,
        "answers jump between two levels: no spread can be told; add levels between them",
    )
    rate = float(found.x[2])
    free = 3 if 1e-6 < rate < MAX_LAPSE - 1e-6 else 2

    def around(parameters: Array) -> float:
        return loss(np.concatenate([parameters, found.x[free:]]))

    errors = np.sqrt(np.maximum(np.diag(_covariance(approx_hess(found.x[:free], around))), 0.0))
    saturated = -float(np.sum(xlogy(k, k / n) + xlogy(n - k, (n - k) / n)))
    middle, spread = float(found.x[0]), float(found.x[1])
    # a threshold that is open comes first: its spread is then unknown as well
    said, told = (
        "answers leave the threshold open: it cannot be told",
        f"from {n.sum():.0f} trials; add",
    )
    require(errors[0] < _VAGUE, f"{said} {told} trials, or levels around it")
    said = "answers jump between two of the levels: no spread can be told"
    require(errors[1] < _VAGUE, f"{said} {told} levels between them")
    lows, highs = (
        (middle + reach * errors[0], spread + reach * errors[1]) for reach in (-Z975, Z975)
    )
    return Psychometric(
        threshold=math.exp(middle),
        threshold_low=math.exp(lows[0]),
        threshold_high=math.exp(highs[0]),
        spread=math.exp(spread),
        weber=_weber(spread),
        weber_low=_weber(lows[1]),
        weber_high=_weber(highs[1]),
        lapse=rate,
        deviance=2.0 * (float(found.fun) - saturated),
        df=len(x) - 3,
        trials=int(n.sum()),
    )


def _weber(log_sigma: float) -> float:
    return math.expm1(min(Z75 * math.exp(min(log_sigma, 20.0)), 700.0))


def _checked(
    levels: Sequence[float], hits: Sequence[int], totals: Sequence[int]
) -> tuple[Array, Array, Array]:
    x, k, n = (np.asarray(values, dtype=np.float64) for values in (levels, hits, totals))
    if not (x.ndim == 1 and x.shape == k.shape == n.shape):
        raise StudyError(
            f"levels, hits and totals must be lists of one length, got {x.size}, {k.size} and "
            f"{n.size}"
        )
    require(np.isfinite(x).all() and (x > 0.0).all(), "levels must be positive and finite")
    if not ((n >= 0.0) & (k >= 0.0) & (k <= n) & (k == np.round(k)) & (n == np.round(n))).all():
        raise StudyError("hits must be whole numbers from 0 to the number of trials of their level")
    if np.unique(x[n > 0]).size < 3:
        raise StudyError(
            f"a psychometric function needs trials at three levels, got {np.unique(x[n > 0]).size}"
        )
    return x[n > 0], k[n > 0], n[n > 0]


def _without_lapses(log_x: Array, k: Array, n: Array) -> tuple[float, float]:
    """Return where to begin: middle and logarithm of the spread of a probit; what tells none is refused."""
    import statsmodels.api as sm

    link = sm.families.Binomial(sm.families.links.Probit())
    with warnings.catch_warnings(action="ignore"):  # separation is told apart below, in words
        fit = sm.GLM(np.column_stack([k, n - k]), sm.add_constant(log_x), family=link).fit(
            tol=1e-12, maxiter=200
        )
    share = (k / n)[np.argsort(log_x)]
    flat = fit.params[1] <= 0.0 or np.ptp(share) == 0.0
    require(not flat, "answers must rise with the level, got ones that do not")
    said = (
        "answers jump from none to all between two levels: no spread can be told; add levels "
        "between them"
    )
    require(np.any((share > 0.0) & (share < 1.0)), said)
    return -fit.params[0] / fit.params[1], math.log(1.0 / fit.params[1])


def _covariance(information: Any) -> Array:
    """Invert the information; on a plateau its curvatures are rounding of either sign, so they get a floor."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray((vectors / np.maximum(values, _LEAST_INFORMATION)) @ vectors.T)
