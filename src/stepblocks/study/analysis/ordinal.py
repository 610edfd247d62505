"""Ratings by an ordinal model: categories in order, not assumed to be equally far apart."""

# The fit is that of statsmodels, with its derivatives in closed form and a sandwich over
# participants.

import itertools
import math
import warnings
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study import Array, Table, require

if TYPE_CHECKING:
    import pandas as pd
    from statsmodels.miscmodels.ordinal_model import OrderedModel, OrderedResults


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
    from scipy.stats import f, t
    from statsmodels.stats.multitest import multipletests

    frame = frame.reset_index(drop=True)
    ordered = pd.Series(pd.Categorical(frame[rating], ordered=True)).cat.remove_unused_categories()
    if len(ordered.cat.categories) < 2:
        raise StudyError(
            f"{rating} must have at least two different values, got {len(ordered.cat.categories)}"
        )
    exog = pd.get_dummies(frame[[condition]], prefix="", prefix_sep="", drop_first=True).astype(
        float
    )
    require(exog.shape[1], f"{condition} must have at least two levels")
    who, names = frame[participant].astype(str), list(exog.columns)
    levels = pd.get_dummies(who, prefix="participant", prefix_sep=" ", drop_first=True).astype(
        float
    )
    fit = fit_proportional_odds(ordered, exog.join(levels))
    if (
        not np.isfinite(fit.bse[names]).all()
        or (np.abs(fit.params[names]) * exog.std() > 15.0).any()
    ):
        raise StudyError(
            f"{rating} must overlap between the levels of {condition}: no finite odds fit"
        )
    people, number = who.nunique(), len(names)
    require(
        people > number,
        f"more participants than compared conditions must have rated, got {people} for {number}",
    )
    covariance = compute_cluster_covariance(fit, np.unique(who, return_inverse=True)[1])[
        :number, :number
    ]
    values = fit.params[names].to_numpy()
    # Hotelling: as many independent values as participants estimate the covariance
    statistic = (
        float(values @ np.linalg.solve(covariance, values))
        * (people - number)
        / (number * (people - 1))
    )
    tail, left = float(f.sf(statistic, number, people - number)), float(people - number)
    wald = {"statistic": statistic, "df": float(number), "df_error": left, "p": tail}
    reach = float(t.ppf(0.975, people - 1))
    conditions = sorted(frame[condition].unique())
    pairs = list(itertools.combinations(range(len(conditions)), 2))
    rows = np.eye(len(conditions))[:, 1:]  # the first condition is the zero of the coefficients
    contrasts = [rows[two] - rows[one] for one, two in pairs]
    logs = [float(row @ values) for row in contrasts]
    errors = [math.sqrt(row @ covariance @ row) for row in contrasts]
    single = [2.0 * float(t.sf(abs(a) / b, people - 1)) for a, b in zip(logs, errors, strict=True)]
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


@cache
def _model() -> "type[OrderedModel]":
    from statsmodels.miscmodels.ordinal_model import OrderedModel
    from statsmodels.tools.numdiff import approx_fprime

    class ProportionalOdds(OrderedModel):  # type: ignore[misc]
        """The model of statsmodels with derivatives in closed form.

        statsmodels takes them numerically, which is ten times slower and right to six digits.
        """

        def score_obs(self, params: Array) -> Array:
            low, high = self._bounds(params)
            share = np.maximum(self.prob(low, high), 1e-300)
            above, below = self.pdf(high) / share, self.pdf(low) / share
            steps = np.asarray(params)[-(self.k_levels - 1) :]
            columns = []
            for index in range(
                len(steps)
            ):  # cut j is the first step and the exponentials of all later ones up to j
                moved = above * (self.endog >= index) - below * (self.endog - 1 >= index)
                columns.append(moved * (1.0 if index == 0 else np.exp(steps[index])))
            return np.column_stack([-(above - below)[:, np.newaxis] * self.exog, *columns])

        def score(self, params: Array) -> Array:
            return np.asarray(self.score_obs(params).sum(axis=0))

        def hessian(self, params: Array) -> Array:
            found = approx_fprime(np.asarray(params), self.score, centered=True)
            return np.asarray(0.5 * (found + found.T))

    return ProportionalOdds


def fit_proportional_odds(ordered: "pd.Series", exog: "pd.DataFrame") -> "OrderedResults":
    """Fit cumulative logits by maximum likelihood."""
    with warnings.catch_warnings(action="ignore"):  # what went wrong is read from the result
        try:
            return _model()(ordered, exog, distr="logit").fit(
                method="bfgs", disp=0, gtol=1e-9, maxiter=2000
            )
        except (np.linalg.LinAlgError, ValueError) as error:
            raise StudyError(
                f"the ordinal model cannot be fitted to these {len(ordered)} ratings: {error}"
            ) from error


def compute_cluster_covariance(fit: "OrderedResults", clusters: NDArray[np.intp]) -> Array:
    """Return the covariance of the parameters when only whole clusters are independent."""
    # Liang, K.-Y., Zeger, S. L. (1986), Biometrika 73, 13-22, doi:10.1093/biomet/73.1.13.
    params = np.asarray(fit.params)
    scores = fit.model.score_obs(params)
    count = int(clusters.max()) + 1
    summed = np.zeros((count, scores.shape[1]))
    np.add.at(summed, clusters, scores)
    bread = np.linalg.pinv(-fit.model.hessian(params))
    return np.asarray(bread @ (summed.T @ summed) @ bread * count / (count - 1))
