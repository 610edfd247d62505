"""The model of repeated measures: participants, and their responses to conditions, are random."""

# Its covariance has two variances beside the residual one, so that the restricted likelihood has
# a closed form for each participant (Woodbury). Both may be negative, as in the analysis of
# variance: a bound at zero would move the level of the test (SAS, PROC MIXED, NOBOUND; Stroup and
# Littell (2002), Applied Statistics in Agriculture, doi:10.4148/2475-7772.1198).

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import linalg, optimize, stats
from statsmodels.tools.numdiff import approx_fprime_cs, approx_hess_cs

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.anova import (
    Interval,
    LinearEstimate,
    Term,
    build_mean_design_rows,
    iterate_pairwise_intervals,
    make_term,
    standardise_response,
)

if TYPE_CHECKING:
    from statsmodels.regression.linear_model import OLS

Indices = NDArray[np.int64]

_NEWTON_STEPS = 3
_NEAR_OPTIMUM = 1e-2  # slope of the loss below which Newton's step is taken
_AT_OPTIMUM = 1e-3  # largest slope of the loss at what counts as an optimum
_NO_VARIANCE = 1e-6  # variance over the residual one below which it counts as zero [1]
_ALIKE = 1e-6  # relative range of degrees of freedom that count as equal


class ConditionMean(NamedTuple):
    """Mean of a condition over the blocks with equal weight, and its standard error."""

    condition: str
    mean: float
    error: float


class Slope(NamedTuple):
    """Change of the response with a covariate.

    Attributes
    ----------
    value, error : float
        Change by one unit of the covariate, and its standard error, in the unit of the response.
    df, p : float
        Satterthwaite's degrees of freedom, and the probability under no change.
    """

    value: float
    error: float
    df: float
    p: float


@dataclass(frozen=True)
class MixedFit:
    """A mixed model fitted by restricted maximum likelihood.

    Attributes
    ----------
    means : tuple of ConditionMean
        In the unit of the response.
    condition : Term or None
        F-test of the conditions, with Satterthwaite's degrees of freedom; None where there is one.
    intervals : tuple of Interval
        Differences of conditions, a Tukey family.
    sd_participant, sd_condition, sd_residual : float
        Standard deviations between participants, of their responses to conditions, and of single
        judgements, in the unit of the response; zero where a variance is estimated as negative.
    log_likelihood : float
        Restricted, in the unit of the response.
    remarks : tuple of str
        On variances that are estimated as zero or less.
    slope : Slope or None
        Of the covariate; means and differences are at its mean.
    """

    means: tuple[ConditionMean, ...]
    condition: Term | None
    intervals: tuple[Interval, ...]
    sd_participant: float
    sd_condition: float
    sd_residual: float
    log_likelihood: float
    remarks: tuple[str, ...]
    slope: Slope | None = None


class _Variances(NamedTuple):
    """Variances of a mixed model, and what they make of its cells.

    Attributes
    ----------
    person, response : float or complex
        Between participants, and of their responses to conditions, over the residual variance [1].
    shrunk : ndarray, shape (cells,)
        Residual variance over that of a judgement of the cell [1].
    weights : ndarray, shape (participants,)
        Judgements of each participant, as far as they are independent.
    """

    person: Any
    response: Any
    shrunk: Array
    weights: Array


class _Products(NamedTuple):
    """What a likelihood needs of a table, at given variances.

    Attributes
    ----------
    matrix : ndarray, shape (n + 1, n + 1)
        Weighted products of the n predictors and the response, which comes last.
    log_det : float or complex
        ln |V| of the covariance of the judgements.
    """

    matrix: Array
    log_det: Any


class _Optimum(NamedTuple):
    """Parameters at the maximum of a likelihood, with their covariance."""

    point: Array
    covariance: Array


class _MixedLikelihood:
    """Restricted likelihood of a table whose rows belong to cells, and cells to participants.

    A point is ln(1 + variance) between participants and, where judgements are repeated, of their
    responses, both scaled, then the logarithm of the residual variance. Every step is analytic, so
    that a complex step differentiates it to the last digits.

    Parameters
    ----------
    y : ndarray, shape (judgements,)
        Standardised response [1].
    x : ndarray, shape (judgements, n)
        Design matrix of the fixed effects.
    cell : ndarray of int, shape (judgements,)
        Cell of each judgement.
    owner : ndarray of int, shape (cells,)
        Participant of each cell.
    """

    def __init__(self, y: Array, x: Array, cell: Indices, owner: Indices) -> None:
        columns = np.column_stack([x, y])
        self.free = len(y) - x.shape[1]
        self.squares = columns.T @ columns
        self.sizes = np.bincount(cell).astype(float)
        self.persons = np.eye(owner.max() + 1)[owner]
        self.sums = np.zeros((len(owner), columns.shape[1]))
        np.add.at(self.sums, cell, columns)

    def compute_variances(self, point: Array) -> _Variances:
        """Return the variances at a point, and the weights of cells and participants."""
        # exponentials keep the covariance positive; a parameter of zero is a variance of zero
        response = 0.0
        if len(point) > 2:
            response = np.expm1(point[1]) / self.sizes.max()
        shrunk = 1.0 / (1.0 + response * self.sizes)
        weights = self.persons.T @ (self.sizes * shrunk)
        person = np.expm1(point[0]) / weights.max()
        return _Variances(person, response, shrunk, weights)

    def compute_products(self, point: Array) -> _Products:
        """Return the weighted products of predictors and response, and ln |V|."""
        person, response, shrunk, weights = self.compute_variances(point)
        by_person = self.persons.T @ (self.sums * shrunk[:, np.newaxis])
        matrix = self.squares - (self.sums.T * (response * shrunk)) @ self.sums
        matrix = matrix - (by_person.T * (person / (1.0 + person * weights))) @ by_person
        log_det = np.log(1.0 + person * weights).sum() - np.log(shrunk).sum()
        return _Products(matrix, log_det)

    def compute_loss(self, point: Array) -> Any:
        """Return minus the restricted log likelihood; a point ends with ln residual variance."""
        matrix, log_det = self.compute_products(point)
        predictors = matrix[:-1, :-1]
        factors = linalg.lu_factor(predictors, check_finite=False)
        # of a singular matrix infinite, not an error: a line search may pass by one
        explained = matrix[-1, :-1] @ linalg.lu_solve(factors, matrix[:-1, -1], check_finite=False)
        residual = matrix[-1, -1] - explained
        normal = self.free * (math.log(2.0 * math.pi) + point[-1]) + residual * np.exp(-point[-1])
        triangular, _ = factors
        diagonal = np.diag(triangular)
        log_predictors = np.log(diagonal * np.sign(diagonal.real)).sum()
        return 0.5 * (normal + log_det + log_predictors)

    def compute_loss_gradient(self, point: Array) -> Array:
        """Return the derivative of the loss by each parameter."""
        return np.asarray(approx_fprime_cs(point, self.compute_loss)).ravel()

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")  # beyond the bounds
    def find_maximum(self, has_response_variance: bool) -> _Optimum:
        """Maximise the likelihood, with `has_response_variance` also over a response's variance.

        Raises
        ------
        StudyError
            If the likelihood has no maximum.
        """
        start = [1.0, -0.5]
        if has_response_variance:
            start = [1.0, 0.3, -0.5]
        with warnings.catch_warnings(action="ignore", category=linalg.LinAlgWarning):
            # the stubs know no derivative that is a method
            point = optimize.minimize(  # type: ignore[call-overload]
                lambda trial: float(self.compute_loss(trial)),
                np.array(start, dtype=np.float64),
                jac=self.compute_loss_gradient,
                method="BFGS",
            ).x
        for _ in range(_NEWTON_STEPS):  # a line search ends at half the digits
            slope = self.compute_loss_gradient(point)
            covariance = self._invert_curvature(point)
            if np.abs(slope).max() < _NEAR_OPTIMUM:
                point = point - covariance @ slope
        found = np.isfinite(point).all() and covariance.any()
        if not (found and np.abs(slope).max() < _AT_OPTIMUM):
            raise StudyError(
                f"the mixed model cannot be fitted to these {self.free} degrees of freedom: its "
                "likelihood has no maximum"
            )
        return _Optimum(np.asarray(point), np.asarray(covariance))

    def _invert_curvature(self, point: Array) -> Array:
        """Return the inverse of the second derivatives of the loss."""
        # where the likelihood is no number, zeros: some solvers stop at what is no number
        curvature = np.nan_to_num(approx_hess_cs(point, self.compute_loss), posinf=0.0, neginf=0.0)
        return np.asarray(np.linalg.pinv(curvature, hermitian=True))

    def estimate_effects(self, point: Array) -> Array:
        """Return the fixed effects, shape (n,)."""
        matrix = self.compute_products(point).matrix
        return np.asarray(np.linalg.solve(matrix[:-1, :-1], matrix[:-1, -1]), dtype=float)

    def compute_effect_covariance(self, point: Array) -> Array:
        """Return the covariance of the fixed effects, shape (n, n)."""
        predictors = self.compute_products(point).matrix[:-1, :-1]
        return np.asarray(np.linalg.inv(predictors) * np.exp(point[-1]))

    def compute_contrast_dof(self, optimum: _Optimum, contrast: Array) -> float:
        """Return Satterthwaite's degrees of freedom of a contrast of the fixed effects.

        Fai, A. H.-T., Cornelius, P. L. (1996), J. Statist. Comput. Simul. 54, 363-378.
        """
        slope = approx_fprime_cs(
            optimum.point,
            lambda trial: np.log(contrast @ self.compute_effect_covariance(trial) @ contrast),
        ).ravel()
        variance = max(slope @ optimum.covariance @ slope, 2.0 / self.free)
        return round(float(2.0 / variance), 6)


def fit_mixed_model(
    frame: Table,
    response: str,
    condition: str,
    participant: str,
    block: str = "",
    *,
    intervals: bool = True,
    covariate: str = "",
) -> MixedFit:
    """Fit conditions, and blocks where given, as fixed and participants as random effects.

    Parameters
    ----------
    frame : DataFrame
        One row per judgement.
    response, condition, participant, block : str
        Columns; without a block, conditions are the only fixed effect.
    intervals : bool
        Whether every two conditions are compared.
    covariate : str
        Column of a number that the response may change with, the same in all conditions; none by
        default.

    Returns
    -------
    MixedFit
        In the unit of the response.

    Raises
    ------
    StudyError
        If there are fewer than two participants, the response is the same in all rows, or the
        likelihood has no maximum.

    References
    ----------
    Laird, N. M., Ware, J. H. (1982), Biometrics 38, 963-974, doi:10.2307/2529876.
    """
    data, scale, shift = standardise_response(frame, response, a=condition, b=block, g=participant)
    people = data["g"].nunique()
    conditions = sorted(data["a"].unique())
    if people < 2:
        raise StudyError(
            f"{participant}: a mixed model needs at least two participants, got {people}"
        )
    if not scale > 0.0:
        raise StudyError(f"{response} must not be the same in all {len(data)} rows")
    if covariate:
        values = frame[covariate].to_numpy(dtype=np.float64)
        data["t"] = values - values.mean()
    model = _build_fixed_effects_model(data)
    likelihood = _build_likelihood(model, data)
    compared = len(conditions) > 1
    # a response to conditions is only apart from single judgements where these are repeated, and
    # from the participant where one meets several conditions
    several_cells = len(likelihood.sizes) > people
    fits_response = compared and likelihood.sizes.max() > 1 and several_cells
    optimum = likelihood.find_maximum(fits_response)
    effects = LinearEstimate(
        likelihood.estimate_effects(optimum.point),
        likelihood.compute_effect_covariance(optimum.point),
    )
    rows = build_mean_design_rows(model, data, conditions)
    for row in rows if covariate else ():
        row[-1] = 0.0  # at the mean of the covariate, which is the last predictor
    count = partial(likelihood.compute_contrast_dof, optimum)
    variances = likelihood.compute_variances(optimum.point)
    residual = math.exp(0.5 * optimum.point[-1])
    family: tuple[Interval, ...] = ()
    if intervals:
        family = tuple(
            iterate_pairwise_intervals(
                conditions, rows, effects, count, spread=residual, scale=scale
            )
        )
    means = []
    for name, row in zip(conditions, rows, strict=True):
        mean = float(row @ effects.parameters) * scale + shift
        error = math.sqrt(row @ effects.covariance @ row) * scale
        means.append(ConditionMean(name, mean, error))
    test = None
    if compared:
        test = _make_condition_test(condition, rows, effects, count)
    slope = None
    if covariate:
        slope = _make_slope_test(effects, count, scale)
    standardised_loss = float(likelihood.compute_loss(optimum.point))
    log_likelihood = -standardised_loss - likelihood.free * math.log(scale)
    person_share = math.sqrt(max(variances.person, 0.0))
    response_share = math.sqrt(max(variances.response, 0.0))
    return MixedFit(
        means=tuple(means),
        condition=test,
        intervals=family,
        sd_participant=person_share * residual * scale,
        sd_condition=response_share * residual * scale,
        sd_residual=residual * scale,
        log_likelihood=log_likelihood,
        remarks=_describe_zero_variances(variances, fits_response),
        slope=slope,
    )


def _make_slope_test(
    effects: LinearEstimate, compute_dof: Callable[[Array], float], scale: float
) -> Slope:
    """Test the last fixed effect, that of the covariate.

    `compute_dof` takes a contrast and returns its degrees of freedom; `scale` is that of the
    response.
    """
    contrast = np.zeros(len(effects.parameters))
    contrast[-1] = 1.0
    value = float(effects.parameters[-1])
    error = math.sqrt(effects.covariance[-1, -1])
    df = compute_dof(contrast)
    p = 2.0 * float(stats.t.sf(abs(value) / error, df))
    return Slope(value * scale, error * scale, df, p)


def _build_fixed_effects_model(data: Table) -> "OLS":
    """Return the linear model of statsmodels whose design matrix has the fixed effects."""
    import statsmodels.formula.api as smf

    factors = []
    for letter in ("a", "b"):
        if letter in data and data[letter].nunique() > 1:
            factors.append(f"C({letter}, Sum)")
    formula = f"y ~ {' * '.join(factors) or '1'}"
    if "t" in data:
        formula += " + t"
    return smf.ols(formula, data)


def _build_likelihood(model: "OLS", data: Table) -> _MixedLikelihood:
    """Return the likelihood of a table; refuse one with as many fixed effects as judgements."""
    cells = data.groupby(["g", "a"])
    owner, _ = pd.factorize(cells["g"].first())
    response = np.asarray(model.endog)
    cell = np.asarray(cells.ngroup(), dtype=np.int64)
    likelihood = _MixedLikelihood(response, np.asarray(model.exog), cell, owner)
    if likelihood.free <= 1:
        raise StudyError(
            f"more judgements than cells of a mixed model are needed, got {len(response)}"
        )
    return likelihood


def _describe_zero_variances(variances: _Variances, fits_response: bool) -> tuple[str, ...]:
    """Return a remark for each variance that is estimated as zero."""
    remarks = []
    if variances.person < _NO_VARIANCE:
        remarks.append("The variance between participants is estimated as zero.")
    if fits_response and variances.response < _NO_VARIANCE:
        remarks.append(
            "The variance of participants' response to the condition is estimated as zero."
        )
    return tuple(remarks)


def _make_condition_test(
    term_name: str,
    mean_rows: Sequence[Array],
    effects: LinearEstimate,
    compute_dof: Callable[[Array], float],
) -> Term:
    """Test all conditions at once, with the degrees of freedom of lmerTest.

    Parameters
    ----------
    term_name : str
        Of the term.
    mean_rows : sequence of ndarray, shape (n,)
        What gives the mean of each condition from the fixed effects.
    effects : LinearEstimate
        The n fixed effects.
    compute_dof : callable
        Takes a contrast of the fixed effects, returns its degrees of freedom.
    """
    contrasts = np.array([row - mean_rows[0] for row in mean_rows[1:]])
    variances, axes = np.linalg.eigh(contrasts @ effects.covariance @ contrasts.T)
    independent = axes.T @ contrasts
    free = np.array([compute_dof(contrast) for contrast in independent])
    f = float(np.mean((independent @ effects.parameters) ** 2 / variances))
    return make_term(term_name, float(len(free)), _pool_contrast_dof(free), math.nan, f)


def _pool_contrast_dof(contrast_dof: Array) -> float:
    """Return the denominator's degrees of freedom of an F-test of independent contrasts.

    `contrast_dof`, shape (contrasts,), are those of each contrast.
    """
    known = contrast_dof[contrast_dof > 2.0]
    expected = float((known / (known - 2.0)).sum())
    if np.ptp(contrast_dof) < _ALIKE * contrast_dof.mean() or expected <= len(contrast_dof):
        return float(contrast_dof.mean())
    return 2.0 * expected / (expected - len(contrast_dof))
