"""Ratings by an ordinal model: categories in order, not assumed to be equally far apart."""

# statsmodels has this model without levels of participants.

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats
from scipy.special import expit, logsumexp

from stepblocks.lawsearch.law import correct_by_holm
from stepblocks.study import Array, Table, require
from stepblocks.study.analysis.anova import Interval

_FAR = 300.0  # logits beyond which no rating lies
_LEVELS = np.linspace(-4.5, 4.5, 31)  # of participants, in their standard deviations


@dataclass(frozen=True)
class OrdinalFit:
    """A proportional-odds model.

    Attributes
    ----------
    effects : tuple of Interval
        ln(odds of a higher rating) of every two conditions, the later less the earlier; errors
        over participants, p after Holm's correction over all pairs.
    participants : dict
        statistic, df, df_error and p of an F-test with the participants as independent units.
    asked : tuple
        Columns of the rating, the condition, the participant, and of factors beside the condition.
    """

    effects: tuple[Interval, ...]
    participants: dict[str, float]
    asked: tuple[str, str, str, Sequence[str]]


def fit_ordinal_model(
    frame: Table, rating: str, condition: str, participant: str, beside: Sequence[str] = ()
) -> OrdinalFit:
    """Fit a proportional-odds model in which participants' levels are normal.

    The condition is tested; other factors `beside` it add to the same logit.
    """
    # McCullagh, P. (1980), J. R. Statist. Soc. B 42, 109-142.
    import pandas as pd

    require(frame[rating].nunique() > 1, f"{rating} must have at least two different values, got 1")
    number = frame[condition].nunique() - 1
    require(number, f"{condition} must have at least two levels")
    exog = pd.get_dummies(frame[[condition, *beside]], drop_first=True).astype(float)
    who = frame[participant].astype(str)
    people = who.nunique()
    require(
        people > number,
        f"more participants than compared conditions must have rated, got {people} for {number}",
    )
    values, covariance, _ = fit_proportional_odds(
        frame[rating], exog, np.unique(who, return_inverse=True)[1]
    )
    require(
        # of ratings that do not overlap the climb ends where the slope is lost, at odds of e**27
        np.isfinite(covariance).all() and not ((np.abs(values) * exog.std() > 8.0).any()),
        f"{rating} must overlap between the levels of {condition}: no finite odds fit",
    )
    values, covariance = values[:number], covariance[:number, :number]
    # Hotelling: as many independent values as participants estimate the covariance
    statistic = (
        float(values @ np.linalg.solve(covariance, values))
        * (people - number)
        / (number * (people - 1))
    )
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
    return OrdinalFit(
        tuple(
            Interval(
                conditions[two],
                conditions[one],
                value,
                value - reach * error,
                value + reach * error,
                p,
                math.nan,
                error,
                people - 1.0,
            )
            for (one, two), value, error, p in zip(
                pairs, logs, errors, correct_by_holm(single).tolist(), strict=True
            )
        ),
        {
            "statistic": statistic,
            "df": float(number),
            "df_error": float(people - number),
            "p": float(stats.f.sf(statistic, number, people - number)),
        },
        (rating, condition, participant, beside),
    )


def fit_proportional_odds(
    rating: ArrayLike, exog: ArrayLike, clusters: NDArray[np.intp] | None = None
) -> tuple[Array, Array, float]:
    """Fit cumulative logits: coefficients, their covariance, and the log likelihood.

    Clusters have levels that are normal (Hedeker, D., Gibbons, R. D. (1994), Biometrics 50,
    933-944, doi:10.2307/2533433), and only they are independent: Liang, K.-Y., Zeger, S. L. (1986),
    Biometrika 73, 13-22, doi:10.1093/biomet/73.1.13.
    """
    steps = np.unique(rating, return_inverse=True)[1]
    x = np.asarray(exog, dtype=np.float64)
    size = x.shape[1]
    alone = clusters is None
    levels = np.zeros(1) if alone else _LEVELS
    weights = np.exp(-0.5 * levels**2) / np.exp(-0.5 * levels**2).sum()
    own = np.eye(len(x)) if clusters is None else np.eye(clusters.max() + 1)[clusters]
    # a cut is the first one and all later steps up to it; beyond the last there is none
    rise = np.vstack([np.tri(steps.max() + 1, steps.max(), -1), np.zeros(steps.max())])

    def score(point: Array) -> tuple[Array, Array]:
        # Return minus the log likelihood of each cluster, and its slopes
        grown = np.append(point[size], np.exp(point[size + 1 : -1]))
        cuts = rise @ grown + np.array([-_FAR, *np.zeros(len(grown)), _FAR])
        at = (x @ point[:size])[:, None] + point[-1] * levels
        below, above = (expit(cuts[steps + n, None] - at) for n in (0, 1))
        share = above - below + 1e-300
        joint = own.T @ np.log(share) + np.log(weights)
        whole = logsumexp(joint, axis=1, keepdims=True)
        likely = own @ np.exp(joint - whole)
        slope = likely * (1.0 - above - below)
        low, high = (
            (likely * end * (1.0 - end) / share).sum(axis=1)[:, None] for end in (below, above)
        )
        by_step = (rise[steps] * low - rise[steps + 1] * high) * np.append(1.0, grown[1:])
        return -whole[:, 0], own.T @ np.hstack(
            [slope.sum(axis=1)[:, None] * x, by_step, (slope @ levels)[:, None]]
        )

    shares = np.cumsum(np.bincount(steps))[:-1] / len(x)
    first = np.log(shares / (1.0 - shares))
    found = optimize.minimize(
        lambda at: tuple(part.sum(axis=0) for part in score(at)),
        [*np.zeros(size), first[0], *np.log(np.diff(first)), 0.0 if alone else 1.0],
        jac=True,
        method="BFGS",
        options={"gtol": 1e-9, "maxiter": 2000},
    )
    bread = optimize.approx_fprime(found.x, lambda at: score(at)[1].sum(axis=0))
    covariance = np.linalg.pinv(0.5 * (bread + bread.T))
    if not alone:
        slopes = score(found.x)[1]
        covariance = covariance @ (slopes.T @ slopes) @ covariance * len(slopes) / (len(slopes) - 1)
    return found.x[:size], covariance[:size, :size], -float(found.fun)
