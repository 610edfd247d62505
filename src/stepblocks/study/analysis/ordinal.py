"""Ratings by an ordinal model: categories in order, not assumed to be equally far apart."""

# statsmodels has this model without levels of participants.

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats
from scipy.special import expit, logsumexp

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.lawsearch.law import correct_p_values_by_holm
from stepblocks.study.analysis.anova import Interval

_FAR = 300.0  # logits beyond which no rating lies
_LEVELS = np.linspace(-4.5, 4.5, 31)  # of participants, in their standard deviations
_TINY = 1e-300  # probability below which none of a rating is told apart
# Of ratings that do not overlap the climb ends where the slope is lost, at odds of e**27; this
# many standard deviations of a predictor in logits are no finite odds
_SEPARATED = 8.0


@dataclass(frozen=True)
class OrdinalModel:
    """What an ordinal model was asked.

    Attributes
    ----------
    rating, condition, participant : str
        Columns of the rating, of the condition that is tested, and of the participant.
    beside : tuple of str
        Columns of factors that add to the same logit.
    """

    rating: str
    condition: str
    participant: str
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class ParticipantTest:
    """An F-test with the participants as independent units.

    Attributes
    ----------
    statistic, df, df_error, p : float
        F, its degrees of freedom, and the probability of it or more under no effect.
    """

    statistic: float
    df: float
    df_error: float
    p: float


@dataclass(frozen=True)
class OrdinalFit:
    """A proportional-odds model.

    Attributes
    ----------
    effects : tuple of Interval
        ln(odds of a higher rating) of every two conditions, the later less the earlier; errors
        over participants, p after Holm's correction over all pairs.
    participants : ParticipantTest
        Of the condition.
    model : OrdinalModel
        What was asked.
    """

    effects: tuple[Interval, ...]
    participants: ParticipantTest
    model: OrdinalModel


class ProportionalOdds(NamedTuple):
    """Cumulative logits of ratings.

    Attributes
    ----------
    coefficients : ndarray, shape (n,)
        ln(odds of a higher rating) for one more of each predictor.
    covariance : ndarray, shape (n, n)
        Of the coefficients.
    log_likelihood : float
        At its maximum.
    """

    coefficients: Array
    covariance: Array
    log_likelihood: float


def fit_ordinal_model(
    frame: Table, rating: str, condition: str, participant: str, other_factors: Sequence[str] = ()
) -> OrdinalFit:
    """Fit a proportional-odds model in which participants' levels are normal.

    Parameters
    ----------
    frame : DataFrame
        One row per rating.
    rating, condition, participant : str
        Columns; the condition is tested.
    other_factors : sequence of str
        Columns of other factors, which add to the same logit.

    Returns
    -------
    OrdinalFit
        Odds of every two conditions, and the test of all of them.

    Raises
    ------
    StudyError
        If ratings or conditions do not vary, there are too few participants, or no finite odds fit.

    References
    ----------
    McCullagh, P. (1980), J. R. Statist. Soc. B 42, 109-142.
    """
    import pandas as pd

    if not frame[rating].nunique() > 1:
        raise StudyError(f"{rating} must have at least two different values, got 1")
    compared = frame[condition].nunique() - 1
    if not compared:
        raise StudyError(f"{condition} must have at least two levels")
    predictors = pd.get_dummies(frame[[condition, *other_factors]], drop_first=True).astype(float)
    participants = frame[participant].astype(str)
    people = participants.nunique()
    if people <= compared:
        raise StudyError(
            "more participants than compared conditions must have rated, got "
            f"{people} for {compared}"
        )
    clusters = np.unique(participants, return_inverse=True)[1]
    fit = fit_proportional_odds(frame[rating], predictors, clusters)
    separated = (np.abs(fit.coefficients) * predictors.std() > _SEPARATED).any()
    if not np.isfinite(fit.covariance).all() or separated:
        raise StudyError(
            f"{rating} must overlap between the levels of {condition}: no finite odds fit"
        )
    values = fit.coefficients[:compared]
    covariance = fit.covariance[:compared, :compared]
    conditions = sorted(frame[condition].unique())
    return OrdinalFit(
        _compare_condition_odds(conditions, values, covariance, people),
        _compute_hotelling_test(values, covariance, people),
        OrdinalModel(rating, condition, participant, tuple(other_factors)),
    )


def _compute_hotelling_test(
    coefficients: Array, covariance: Array, participant_count: int
) -> ParticipantTest:
    """Compute Hotelling's test of whether all coefficients, shape (n,), are zero."""
    # as many independent values as participants estimate the covariance
    number = len(coefficients)
    statistic = (
        float(coefficients @ np.linalg.solve(covariance, coefficients))
        * (participant_count - number)
        / (number * (participant_count - 1))
    )
    df_error = participant_count - number
    p = float(stats.f.sf(statistic, number, df_error))
    return ParticipantTest(statistic, float(number), float(df_error), p)


def _compare_condition_odds(
    conditions: Sequence[str], log_odds: Array, covariance: Array, participant_count: int
) -> tuple[Interval, ...]:
    """Compare every two conditions, the later less the earlier.

    `log_odds`, shape (conditions - 1,), are ln(odds) against the first condition.
    """
    rows = np.eye(len(conditions))[:, 1:]  # the first condition is the zero of the coefficients
    row_of = dict(zip(conditions, rows, strict=True))
    pairs = list(itertools.combinations(conditions, 2))
    differences, errors, p_values = [], [], []
    for earlier, later in pairs:
        contrast = row_of[later] - row_of[earlier]
        difference = float(contrast @ log_odds)
        error = math.sqrt(contrast @ covariance @ contrast)
        differences.append(difference)
        errors.append(error)
        p_values.append(2.0 * float(stats.t.sf(abs(difference) / error, participant_count - 1)))
    limit = float(stats.t.ppf(0.975, participant_count - 1))
    corrected = correct_p_values_by_holm(p_values).tolist()
    intervals = []
    for (earlier, later), difference, error, p in zip(
        pairs, differences, errors, corrected, strict=True
    ):
        intervals.append(
            Interval(
                first=later,
                second=earlier,
                difference=difference,
                low=difference - limit * error,
                high=difference + limit * error,
                p=p,
                effect_size=math.nan,
                error=error,
                df=participant_count - 1.0,
            )
        )
    return tuple(intervals)


class _CumulativeLogits:
    """Likelihood of ratings in ordered categories, with normal levels of clusters.

    A point is the n coefficients, the first cut, the logarithms of the steps between further cuts,
    and the standard deviation of the clusters' levels, in logits.

    Parameters
    ----------
    categories : ndarray of int, shape (ratings,)
        From 0.
    predictors : ndarray, shape (ratings, n)
        Of each rating.
    member : ndarray, shape (ratings, clusters)
        1 where a rating is of a cluster.
    levels : ndarray, shape (m,)
        Levels over which the likelihood of a cluster is summed, in their standard deviations.
    """

    def __init__(
        self, categories: NDArray[np.intp], predictors: Array, member: Array, levels: Array
    ) -> None:
        self.categories = categories
        self.predictors = predictors
        self.member = member
        self.levels = levels
        self.weights = np.exp(-0.5 * levels**2) / np.exp(-0.5 * levels**2).sum()
        # a cut is the first one and all later steps up to it; beyond the last there is none
        top = categories.max()
        self.rise = np.vstack([np.tri(top + 1, top, -1), np.zeros(top)])

    def compute_cluster_losses_and_slopes(self, point: Array) -> tuple[Array, Array]:
        """Return minus the log likelihood of each cluster, and its slopes.

        Returns
        -------
        losses : ndarray, shape (clusters,)
            Minus the log likelihoods.
        slopes : ndarray, shape (clusters, parameters)
            Their derivatives by the parameters.
        """
        size = self.predictors.shape[1]
        steps = np.append(point[size], np.exp(point[size + 1 : -1]))
        cuts = self.rise @ steps + np.array([-_FAR, *np.zeros(len(steps)), _FAR])
        logits = (self.predictors @ point[:size])[:, None] + point[-1] * self.levels
        below = expit(cuts[self.categories, None] - logits)
        above = expit(cuts[self.categories + 1, None] - logits)
        share = above - below + _TINY
        joint = self.member.T @ np.log(share) + np.log(self.weights)
        whole = logsumexp(joint, axis=1, keepdims=True)
        posterior = self.member @ np.exp(joint - whole)  # of the levels, of each rating's cluster
        slope = posterior * (1.0 - above - below)
        low = (posterior * below * (1.0 - below) / share).sum(axis=1)[:, None]
        high = (posterior * above * (1.0 - above) / share).sum(axis=1)[:, None]
        by_cut = self.rise[self.categories] * low - self.rise[self.categories + 1] * high
        by_step = by_cut * np.append(1.0, steps[1:])
        by_predictor = slope.sum(axis=1)[:, None] * self.predictors
        by_spread = (slope @ self.levels)[:, None]
        return -whole[:, 0], self.member.T @ np.hstack([by_predictor, by_step, by_spread])

    def compute_loss_and_slopes(self, point: Array) -> tuple[float, Array]:
        """Return minus the log likelihood of all clusters, and its slopes."""
        losses, slopes = self.compute_cluster_losses_and_slopes(point)
        return losses.sum(axis=0), slopes.sum(axis=0)

    def compute_gradient(self, point: Array) -> Array:
        """Return the slopes of minus the log likelihood of all clusters."""
        return np.asarray(self.compute_loss_and_slopes(point)[1])


def fit_proportional_odds(
    rating: ArrayLike, exog: ArrayLike, clusters: NDArray[np.intp] | None = None
) -> ProportionalOdds:
    """Fit cumulative logits.

    Parameters
    ----------
    rating : array_like, shape (ratings,)
        In the order of its values.
    exog : array_like, shape (ratings, n)
        Predictors.
    clusters : ndarray of int, shape (ratings,), optional
        Cluster of each rating, from 0. Clusters have levels that are normal, and only they are
        independent; without clusters, all ratings are.

    Returns
    -------
    ProportionalOdds
        Coefficients, their covariance, and the log likelihood.

    References
    ----------
    Hedeker, D., Gibbons, R. D. (1994), Biometrics 50, 933-944, doi:10.2307/2533433. Liang, K.-Y.,
    Zeger, S. L. (1986), Biometrika 73, 13-22, doi:10.1093/biomet/73.1.13.
    """
    categories = np.unique(rating, return_inverse=True)[1]
    predictors = np.asarray(exog, dtype=np.float64)
    size = predictors.shape[1]
    if clusters is None:
        levels, spread = np.zeros(1), 0.0
        member = np.eye(len(predictors))
    else:
        levels, spread = _LEVELS, 1.0
        member = np.eye(clusters.max() + 1)[clusters]
    likelihood = _CumulativeLogits(categories, predictors, member, levels)
    shares = np.cumsum(np.bincount(categories))[:-1] / len(predictors)
    cuts = np.log(shares / (1.0 - shares))
    found = optimize.minimize(
        likelihood.compute_loss_and_slopes,
        [*np.zeros(size), cuts[0], *np.log(np.diff(cuts)), spread],
        jac=True,
        method="BFGS",
        options={"gtol": 1e-9, "maxiter": 2000},
    )
    curvature = optimize.approx_fprime(found.x, likelihood.compute_gradient)
    covariance = np.linalg.pinv(0.5 * (curvature + curvature.T))
    if clusters is not None:  # the sandwich of Liang and Zeger
        _, slopes = likelihood.compute_cluster_losses_and_slopes(found.x)
        number = len(slopes)
        covariance = covariance @ (slopes.T @ slopes) @ covariance * number / (number - 1)
    of_predictors = np.asarray(covariance[:size, :size], dtype=np.float64)
    return ProportionalOdds(found.x[:size], of_predictors, -float(found.fun))
