"""Psychometric functions by maximum likelihood: threshold, spread, Weber fraction, lapses."""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import ndtr, xlog1py, xlogy

from stepblocks.study import Array, require

# Largest lapse rate that a fit may take; Wichmann and Hill (2001) bound it so that it cannot stand
# in for the slope
MAX_LAPSE = 0.1
Z75 = 0.6744897501960817  # standard normal quantile of 0.75
Z975 = 1.959963984540054
_ROOT = math.sqrt(2.0 * math.pi)
Ends = tuple[float, float, float]  # estimate, low, high
_CHI95 = 3.841458820694124  # 95 % point of chi squared with one degree of freedom


@dataclass(frozen=True)
class Psychometric:
    """Cumulative normal in the logarithm of the level, with one lapse rate for both ends.

    Attributes
    ----------
    threshold : tuple of float
        Level in the middle between the asymptotes, in the unit of the levels, with its
        95 % interval by profile likelihood; of a comparison the point of subjective equality.
    spread : float
        Standard deviation sigma of the normal, in natural logarithms of the level [1].
    weber : tuple of float
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

    threshold: Ends
    spread: float
    weber: Ends
    lapse: float
    deviance: float
    df: int
    dispersion: float
    p_fit: float


def fit_psychometric(
    levels: Sequence[float], hits: Sequence[int], totals: Sequence[int]
) -> Psychometric:
    """Fit a psychometric function to the answers of one participant."""
    # Wichmann, F. A., Hill, N. J. (2001), Perception & Psychophysics 63, 1293-1313,
    # doi:10.3758/BF03194544. Who lapses in a comparison errs to either side: one rate for both
    # ends.

    x, k, n = _check_counts(levels, hits, totals)
    log_x = np.log(x)

    def predict(point: Array) -> tuple[Array, Array]:
        # Return the probability of a hit at each level, and its slopes
        spread = math.exp(point[1])
        away = (log_x - point[0]) / spread
        rising = ndtr(away)
        density = (1.0 - 2.0 * point[2]) * np.exp(-0.5 * away**2) / _ROOT
        p = np.clip(point[2] + (1.0 - 2.0 * point[2]) * rising, 1e-15, 1.0 - 1e-15)
        return p, np.array([-density / spread, -density * away, 1.0 - 2.0 * rising])

    def miss(p: Array) -> Array:
        return np.asarray(-np.sum(xlogy(k, p) + xlog1py(n - k, -p), axis=-1))

    def loss(point: Array) -> tuple[float, Array]:
        p, slopes = predict(point)
        return float(miss(p)), slopes @ ((n - k) / (1.0 - p) - k / p)

    reach = np.array([-2.0, 2.0]) * np.ptp(log_x) + (log_x.min(), log_x.max())
    bounds = [(reach[0], reach[1]), (-8.0, 4.0), (0.0, MAX_LAPSE)]

    def climb(start: Sequence[float], place: int = -1, value: float = 0.0) -> Any:
        return minimize(
            loss,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(value, value) if n == place else bound for n, bound in enumerate(bounds)],
            options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000},
        )

    middle, spread = _guess_start(log_x, k, n)
    found = min(
        (climb([middle, spread - shrink, 0.02]) for shrink in (0.0, 0.7)),
        key=lambda one: float(one.fun),
    )
    # what a spread of zero loses more; where that is nothing, all small spreads fit alike
    sharper = float(miss(_fit_step_functions(x, k, n)).min()) - float(found.fun)

    def find_end(place: int, side: int) -> float:
        """Return where the profile has fallen by the 95 % point of chi squared, below or above."""

        def excess(value: float) -> float:
            least = min(
                float(climb([*one[:place], value, *one[place + 1 :]], place, value).fun)
                for one in ([*found.x], [*found.x[:2], 0.02], [middle, spread, 0.02])
            )
            return 2.0 * (least - float(found.fun)) - _CHI95

        return find_crossing(
            excess,
            float(found.x[place]),
            bounds[place][side],
            (-0.2, 0.2)[side] * math.exp(min(found.x[1], 1.0)),
        )

    (low, high), (thin, wide) = ([find_end(n, side) for side in (0, 1)] for n in (0, 1))
    # a threshold that is open comes first: its spread is then unknown as well
    require(
        math.isfinite(high - low),
        f"answers leave the threshold open: it is not determined from {n.sum():.0f} trials; add "
        "trials, or levels around it",
    )
    require(
        math.isfinite(wide) and sharper > 1e-3,
        "answers jump between two of the levels: the spread is not determined from "
        f"{n.sum():.0f} trials; add levels between them",
    )
    dispersion, p_fit = assess_fit(*predict(found.x), k, n)
    return Psychometric(
        threshold=(math.exp(found.x[0]), math.exp(low), math.exp(high)),
        spread=math.exp(found.x[1]),
        weber=(
            compute_weber(found.x[1]),
            compute_weber(thin if 2.0 * sharper > _CHI95 else -math.inf),
            compute_weber(wide),
        ),
        lapse=float(found.x[2]),
        deviance=2.0 * (float(found.fun) - float(miss(k / n))),
        df=len(x) - 3,
        dispersion=dispersion,
        p_fit=p_fit,
    )


def find_crossing(excess: Callable[[float], float], start: float, end: float, step: float) -> float:
    """Step from a start, where a function is negative, to its root; infinite beyond the end.

    The sign of the step is the direction, also where the start is the end.
    """
    outer = start
    above = -1.0
    while above <= 0.0 and outer != end:
        inner = outer
        outer = min(outer + step, end) if step > 0.0 else max(outer + step, end)
        above = excess(outer)
        step *= 2.0
    return float(brentq(excess, inner, outer, xtol=1e-6)) if above > 0.0 else step * math.inf


def assess_fit(p: Array, slopes: Array, k: Array, n: Array) -> tuple[float, float]:
    """Compare Pearson's chi squared with that of answers that the fitted function gives."""
    # In place of a fit to each simulated table, what a fit would take up is projected out.
    weight = np.sqrt(n / (p * (1.0 - p)))
    taken = np.linalg.qr((weight * slopes).T)[0]
    drawn = np.random.default_rng(1).binomial(n.astype(int), p, (2000, len(p))) / n
    left = weight * (np.vstack([k / n, drawn]) - p)
    squares = np.sum((left - left @ taken @ taken.T) ** 2, axis=1)
    share = float((squares[1:] >= squares[0] * (1.0 - 1e-9)).mean())
    return float(squares[0]) / max(len(p) - 3, 1), share


def _fit_step_functions(x: Array, k: Array, n: Array) -> Array:
    # Return what functions of no spread predict, one with its step at each level: there any share
    # between the lapses. The lapse rate is that of the other levels, or of all where it jumps.
    same, below = x[:, np.newaxis] == x, x < x[:, np.newaxis]
    hits, totals = same @ k, same @ n
    wrong = np.sum(~same * np.where(below, k, n - k), axis=1)
    rate = np.clip(
        [wrong / (n.sum() - totals), (wrong + np.minimum(hits, totals - hits)) / n.sum()],
        1e-15,
        MAX_LAPSE,
    )[..., np.newaxis]
    return np.asarray(
        np.where(
            same,
            np.clip((hits / totals)[:, np.newaxis], rate, 1.0 - rate),
            np.where(below, rate, 1.0 - rate),
        )
    )


def compute_weber(log_sigma: float) -> float:
    """Return the Weber fraction of a spread, given as its logarithm."""
    return math.expm1(min(Z75 * math.exp(min(log_sigma, 20.0)), 700.0))


def _check_counts(
    levels: Sequence[float], hits: Sequence[int], totals: Sequence[int]
) -> tuple[Array, Array, Array]:
    x, k, n = (np.asarray(values, dtype=np.float64) for values in (levels, hits, totals))
    require(
        x.ndim == 1 and x.shape == k.shape == n.shape,
        f"levels, hits and totals must be lists of one length, got {x.size}, {k.size} and {n.size}",
    )
    require(np.isfinite(x).all() and (x > 0.0).all(), "levels must be positive and finite")
    whole = (n >= 0.0) & (k >= 0.0) & (k <= n) & (k == np.round(k)) & (n == np.round(n))
    require(whole.all(), "hits must be whole numbers from 0 to the number of trials of their level")
    asked = np.unique(x[n > 0]).size
    require(asked >= 3, f"a psychometric function needs trials at three levels, got {asked}")
    return x[n > 0], k[n > 0], n[n > 0]


def _guess_start(log_x: Array, k: Array, n: Array) -> tuple[float, float]:
    # Return a start, middle and ln spread of a probit; refuse answers that have none
    import statsmodels.api as sm

    link = sm.families.Binomial(sm.families.links.Probit())
    with warnings.catch_warnings(action="ignore"):  # separation is reported below
        fit = sm.GLM(np.column_stack([k, n - k]), sm.add_constant(log_x), family=link).fit(
            tol=1e-12, maxiter=200
        )
    require(
        fit.params[1] > 0.0 and np.ptp(k / n) > 0.0,
        "answers must rise with the level, got ones that do not",
    )
    require(
        np.any((k > 0.0) & (k < n)),
        "answers jump from none to all between two levels: the spread is not determined; add "
        "levels between them",
    )
    return -fit.params[0] / fit.params[1], math.log(1.0 / fit.params[1])
