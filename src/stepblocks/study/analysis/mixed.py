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
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import linalg, optimize
from statsmodels.tools.numdiff import approx_fprime_cs, approx_hess_cs

from stepblocks.study import Array, Table, require
from stepblocks.study.analysis.anova import (
    Interval,
    Term,
    compare_all_pairs,
    find_mean_rows,
    make_term,
    standardise_response,
)

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class MixedFit:
    """A mixed model fitted by restricted maximum likelihood.

    Attributes
    ----------
    means : tuple of (str, float, float)
        Condition, its mean over the blocks with equal weight, and the standard error.
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
    """

    means: tuple[tuple[str, float, float], ...]
    condition: Term | None
    intervals: tuple[Interval, ...]
    sd_participant: float
    sd_condition: float
    sd_residual: float
    log_likelihood: float
    remarks: tuple[str, ...]


class _Likelihood:
    # Restricted likelihood of a table whose rows belong to cells, and cells to participants
    # Every step is analytic, so that a complex step differentiates it to the last digits.

    def __init__(self, y: Array, x: Array, cell: Indices, owner: Indices) -> None:
        both = np.column_stack([x, y])
        self.free, self.squares = len(y) - x.shape[1], both.T @ both
        self.sizes = np.bincount(cell).astype(float)
        self.persons = np.eye(owner.max() + 1)[owner]
        self.sums = np.zeros((len(owner), both.shape[1]))
        np.add.at(self.sums, cell, both)

    def variances(self, point: Array) -> tuple[Any, Any, Array, Array]:
        # Return both variances over the residual one, and the weights of cells and persons
        # exponentials keep the covariance positive; a parameter of zero is a variance of zero
        response = np.expm1(point[1]) / self.sizes.max() if len(point) > 2 else 0.0
        shrunk = 1.0 / (1.0 + response * self.sizes)
        weights = self.persons.T @ (self.sizes * shrunk)
        return np.expm1(point[0]) / weights.max(), response, shrunk, weights

    def products(self, point: Array) -> tuple[Array, Any]:
        # Return the products of predictors and response, weighted, and ln |V|
        person, response, shrunk, weights = self.variances(point)
        own = self.persons.T @ (self.sums * shrunk[:, np.newaxis])
        found = self.squares - (self.sums.T * (response * shrunk)) @ self.sums
        found = found - (own.T * (person / (1.0 + person * weights))) @ own
        return found, np.log(1.0 + person * weights).sum() - np.log(shrunk).sum()

    def loss(self, point: Array) -> Any:
        # Return minus the restricted log likelihood; a point ends with ln residual variance
        found, log_det = self.products(point)
        factors = linalg.lu_factor(found[:-1, :-1], check_finite=False)
        diagonal = np.diag(factors[0])
        # of a singular matrix infinite, not an error: a line search may pass by one
        left = found[-1, -1] - found[-1, :-1] @ linalg.lu_solve(
            factors, found[:-1, -1], check_finite=False
        )
        whole = self.free * (math.log(2.0 * math.pi) + point[-1]) + left * np.exp(-point[-1])
        return 0.5 * (whole + log_det + np.log(diagonal * np.sign(diagonal.real)).sum())

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")  # beyond the bounds
    def fit(self, repeated: bool) -> tuple[Array, Array]:
        # Return the optimum and the covariance of its parameters
        with warnings.catch_warnings(action="ignore", category=linalg.LinAlgWarning):
            point = optimize.minimize(
                lambda at: float(self.loss(at)),
                [1.0, 0.3, -0.5] if repeated else [1.0, -0.5],
                jac=lambda at: approx_fprime_cs(at, self.loss).ravel(),
                method="BFGS",
            ).x
        for _ in range(3):  # Newton's steps: a line search ends at half the digits
            slope = approx_fprime_cs(point, self.loss).ravel()
            # where the likelihood is no number, zeros: some solvers stop at what is no number
            spread = np.linalg.pinv(
                np.nan_to_num(approx_hess_cs(point, self.loss), posinf=0.0, neginf=0.0),
                hermitian=True,
            )
            point = point - spread @ slope if np.abs(slope).max() < 1e-2 else point
        require(
            np.isfinite(point).all() and spread.any() and np.abs(slope).max() < 1e-3,
            f"the mixed model cannot be fitted to these {self.free} degrees of freedom: its "
            "likelihood has no maximum",
        )
        return np.asarray(point), np.asarray(spread)

    def covariance(self, point: Array) -> Array:
        # Return the covariance of the fixed effects
        return np.asarray(np.linalg.inv(self.products(point)[0][:-1, :-1]) * np.exp(point[-1]))

    def count_freedom(self, point: Array, spread: Array, contrast: Array) -> float:
        # Return Satterthwaite's degrees of freedom of a contrast of the fixed effects
        # Fai, A. H.-T., Cornelius, P. L. (1996), J. Statist. Comput. Simul. 54, 363-378.

        slope = approx_fprime_cs(
            point, lambda at: np.log(contrast @ self.covariance(at) @ contrast)
        ).ravel()
        return round(float(2.0 / max(slope @ spread @ slope, 2.0 / self.free)), 6)


def fit_mixed_model(
    frame: Table,
    response: str,
    condition: str,
    participant: str,
    block: str = "",
    intervals: bool = True,
) -> MixedFit:
    """Fit conditions, and blocks where given, as fixed and participants as random effects."""
    # Laird, N. M., Ware, J. H. (1982), Biometrics 38, 963-974, doi:10.2307/2529876.
    import statsmodels.formula.api as smf

    data, scale, shift = standardise_response(frame, response, a=condition, b=block, g=participant)
    people = data["g"].nunique()
    conditions = sorted(data["a"].unique())
    require(
        people >= 2, f"{participant}: a mixed model needs at least two participants, got {people}"
    )
    require(scale > 0.0, f"{response} must not be the same in all {len(data)} rows")
    compared = len(conditions) > 1
    factors = [
        f"C({letter}, Sum)" for letter in "ab" if letter in data and data[letter].nunique() > 1
    ]
    model = smf.ols(f"y ~ {' * '.join(factors) or '1'}", data)
    cells = data.groupby(["g", "a"])
    x, y = np.asarray(model.exog), np.asarray(model.endog)
    likelihood = _Likelihood(y, x, cells.ngroup().to_numpy(), pd.factorize(cells["g"].first())[0])
    require(
        likelihood.free > 1, f"more judgements than cells of a mixed model are needed, got {len(y)}"
    )
    # a response to conditions is only apart from single judgements where these are repeated, and
    # from the participant where one meets several conditions
    repeated = compared and likelihood.sizes.max() > 1 and len(likelihood.sizes) > people
    point, spread = likelihood.fit(repeated)
    products, _ = likelihood.products(point)
    covariance = likelihood.covariance(point)
    beta: Array = np.asarray(np.linalg.solve(products[:-1, :-1], products[:-1, -1]), dtype=float)
    person, response_, _, _ = likelihood.variances(point)
    residual = math.exp(0.5 * point[-1])
    rows = find_mean_rows(model, data, conditions)
    count = partial(likelihood.count_freedom, point, spread)
    family = compare_all_pairs(
        conditions, rows, (beta, covariance), count, spread=residual, scale=scale
    )
    variances = {
        "between participants": person,
        "of participants' response to the condition": response_ if repeated else 1.0,
    }
    return MixedFit(
        means=tuple(
            (name, float(row @ beta) * scale + shift, math.sqrt(row @ covariance @ row) * scale)
            for name, row in zip(conditions, rows, strict=True)
        ),
        condition=_test_conditions(condition, rows, beta, covariance, count) if compared else None,
        intervals=tuple(family) if intervals else (),
        sd_participant=math.sqrt(max(person, 0.0)) * residual * scale,
        sd_condition=math.sqrt(max(response_, 0.0)) * residual * scale,
        sd_residual=residual * scale,
        log_likelihood=-float(likelihood.loss(point)) - likelihood.free * math.log(scale),
        remarks=tuple(
            f"The variance {name} is estimated as zero."
            for name, value in variances.items()
            if value < 1e-6
        ),
    )


def _test_conditions(
    name: str,
    rows: Sequence[Array],
    beta: Array,
    covariance: Array,
    count: Callable[[Array], float],
) -> Term:
    # Test all conditions at once, with the degrees of freedom of lmerTest
    contrasts = np.array([row - rows[0] for row in rows[1:]])
    sizes, axes = np.linalg.eigh(contrasts @ covariance @ contrasts.T)
    turned = axes.T @ contrasts
    free = np.array([count(one) for one in turned])
    spent = float((free[free > 2.0] / (free[free > 2.0] - 2.0)).sum())
    alike = np.ptp(free) < 1e-6 * free.mean() or spent <= len(free)
    return make_term(
        name,
        float(len(free)),
        float(free.mean()) if alike else 2.0 * spent / (spent - len(free)),
        math.nan,
        float(np.mean((turned @ beta) ** 2 / sizes)),
    )
