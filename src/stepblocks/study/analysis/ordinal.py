"""Ratings by an ordinal model: categories in order, not assumed to be equally far apart."""

# statsmodels has this model, but differentiates it by differences: slower, and to six digits.

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats

from stepblocks.study import Array, Table, require

_FAR = 300.0  # logits beyond which no rating lies


@dataclass(frozen=True)
class OddsRatio:
    """Odds of a higher rating in one condition over those in another.

    Attributes
    ----------
    first, second : str
        Conditions.
    log_odds, error : float
        Difference of coefficients, and its standard error over participants [1].
    ratio, low, high : float
        Ratio of the odds, with its 95 % interval [1].
    p : float
        Probability under equal odds, Holm's correction over all pairs.
    """

    first: str
    second: str
    log_odds: float
    error: float
    ratio: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class OrdinalFit:
    """A proportional-odds model.

    Attributes
    ----------
    effects : tuple of OddsRatio
        Of every two conditions.
    participants : dict
        statistic, df, df_error and p of an F-test with the participants as independent units.
    """

    effects: tuple[OddsRatio, ...]
    participants: dict[str, float]


def fit_ordinal_model(frame: Table, rating: str, condition: str, participant: str) -> OrdinalFit:
    """Fit a proportional-odds model in which each participant has an own level."""
    # McCullagh, P. (1980), J. R. Statist. Soc. B 42, 109-142.
    import pandas as pd
    from statsmodels.stats.multitest import multipletests

    frame = frame.reset_index(drop=True)
    count = frame[rating].nunique()
    require(count > 1, f"{rating} must have at least two different values, got {count}")
    exog = pd.get_dummies(frame[[condition]], prefix="", prefix_sep="", drop_first=True).astype(
        float
    )
    require(exog.shape[1], f"{condition} must have at least two levels")
    who, names = frame[participant].astype(str), list(exog.columns)
    levels = pd.get_dummies(who, prefix="participant", prefix_sep=" ", drop_first=True).astype(
        float
    )
    people, number = who.nunique(), len(names)
    require(
        people > number,
        f"more participants than compared conditions must have rated, got {people} for {number}",
    )
    found, spread, _ = fit_proportional_odds(
        frame[rating], exog.join(levels), np.unique(who, return_inverse=True)[1]
    )
    values, covariance = found[:number], spread[:number, :number]
    require(
        # of ratings that do not overlap the climb ends where the slope is lost, at odds of e**27
        np.isfinite(covariance).all() and not ((np.abs(values) * exog.std() > 8.0).any()),
        f"{rating} must overlap between the levels of {condition}: no finite odds fit",
    )
    # Hotelling: as many independent values as participants estimate the covariance
    statistic = (
        float(values @ np.linalg.solve(covariance, values))
        * (people - number)
        / (number * (people - 1))
    )
    wald = {
        "statistic": statistic,
        "df": float(number),
        "df_error": float(people - number),
        "p": float(stats.f.sf(statistic, number, people - number)),
    }
    reach = float(stats.t.ppf(0.975, people - 1))
    conditions = sorted(frame[condition].unique())
    pairs = list(itertools.combinations(range(len(conditions)), 2))
    rows = np.eye(len(conditions))[:, 1:]  # the first condition is the zero of the coefficients
    contrasts = [rows[two] - rows[one] for one, two in pairs]
    logs = [float(row @ values) for row in contrasts]
    errors = [math.sqrt(row @ covariance @ row) for row in contrasts]
    single = [
        2.0 * float(stats.t.sf(abs(a) / b, people - 1)) for a, b in zip(logs, errors, strict=True)
    ]
    effects = [
        OddsRatio(
            first=conditions[two],
            second=conditions[one],
            log_odds=value,
            error=error,
            ratio=math.exp(value),
            low=math.exp(value - reach * error),
            high=math.exp(min(value + reach * error, 700.0)),
            p=float(p),
        )
        for (one, two), value, error, p in zip(
            pairs, logs, errors, multipletests(single, method="holm")[1], strict=True
        )
    ]
    return OrdinalFit(tuple(effects), wald)


def fit_proportional_odds(
    rating: ArrayLike, exog: ArrayLike, clusters: NDArray[np.intp] | None = None
) -> tuple[Array, Array, float]:
    """Fit cumulative logits: coefficients, their covariance, and the log likelihood.

    With clusters only these are independent: Liang, K.-Y., Zeger, S. L. (1986), Biometrika 73,
    13-22, doi:10.1093/biomet/73.1.13.
    """
    from statsmodels.tools.numdiff import approx_fprime, approx_fprime_cs

    steps, x = np.unique(rating, return_inverse=True)[1], np.asarray(exog, dtype=np.float64)
    size = x.shape[1]

    def predict(point: Array) -> Array:
        # a cut is the first one and the exponentials of all later steps up to it
        cuts = np.cumsum(np.concatenate([point[size : size + 1], np.exp(point[size + 1 :])]))
        ends = np.concatenate([[-_FAR], cuts, [_FAR]])
        below, above = (1.0 / (1.0 + np.exp(x @ point[:size] - ends[steps + n])) for n in (0, 1))
        return np.asarray(np.log(above - below + 1e-300))

    def slope(point: Array) -> Array:
        return np.asarray(approx_fprime_cs(point, predict).reshape(len(x), -1))

    shares = np.cumsum(np.bincount(steps))[:-1] / len(x)
    first = np.log(shares / (1.0 - shares))
    found = optimize.minimize(
        lambda at: -float(predict(at).sum()),
        np.concatenate([np.zeros(size), first[:1], np.log(np.diff(first))]),
        jac=lambda at: -slope(at).sum(axis=0),
        method="BFGS",
        options={"gtol": 1e-9, "maxiter": 2000},
    )
    bread = approx_fprime(found.x, lambda at: -slope(at).sum(axis=0), centered=True)
    covariance = np.linalg.pinv(0.5 * (bread + bread.T))
    if clusters is not None:
        own = np.eye(clusters.max() + 1)[clusters].T @ slope(found.x)
        covariance = covariance @ (own.T @ own) @ covariance * len(own) / (len(own) - 1)
    return found.x[:size], covariance[:size, :size], -float(found.fun)
