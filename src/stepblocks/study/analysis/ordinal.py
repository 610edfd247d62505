"""Ratings by an ordinal model: categories in order, with no claim that they are equally far apart."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study.analysis.proportional_odds import cluster_covariance, fit_proportional_odds

_Z975 = 1.959963984540054


@dataclass(frozen=True)
class OddsRatio:
    """Effect of one predictor."""

    name: str  # Predictor, or condition against the first one
    log_odds: float  # Coefficient and its standard error, over participants where they are given [1]
    error: float
    ratio: float  # Odds of a higher rating, and 95 % interval [1]
    low: float
    high: float
    # The log odds at each cut between categories, fitted one by one; alike if the odds are proportional
    by_cut: tuple[float, ...]


@dataclass(frozen=True)
class Wald:
    """A test of all predictors with the participants as the units that are independent."""

    statistic: float  # F [1]
    df: float  # Predictors, and participants less predictors
    df_error: float
    p: float  # Probability of it or more under no effect [1]


@dataclass(frozen=True)
class OrdinalFit:
    """A proportional-odds model."""

    effects: tuple[OddsRatio, ...]  # One per predictor
    # Likelihood ratio test of the predictors; it keeps its level only where participants take to them alike
    statistic: float
    df: int
    p: float
    # The test that lets participants differ in how they take to the predictors; None without participants
    participants: Wald | None
    log_likelihood: float  # At the optimum
    converged: bool  # Whether the optimiser ended at a flat point


def ordinal_model(frame: Any, rating: str, predictors: Sequence[str], participant: str = "") -> OrdinalFit:
    """Fit a proportional-odds model.

    Source: McCullagh, P. (1980), J. R. Statist. Soc. B 42, 109-142.
    """
    ordered, exog, names, people = _matrices(frame, rating, predictors, participant)
    full = fit_proportional_odds(ordered, exog.join(people))
    base_likelihood = float(fit_proportional_odds(ordered, people).llf) if people.shape[1] else _alone(ordered)
    if not np.isfinite(full.bse[names]).all() or (np.abs(full.params[names]) > 15.0 * _per_unit(exog)).any():
        raise StudyError(f"{rating} must overlap between the levels of {', '.join(predictors)}: no finite odds fit")
    from scipy.stats import chi2

    statistic = 2.0 * (float(full.llf) - base_likelihood)
    errors, reach, wald = _errors(full, len(names), frame[participant].to_numpy() if people.shape[1] else None)
    cuts = _by_cut(ordered, exog.join(people), names)
    effects = tuple(
        OddsRatio(
            name,
            value,
            error,
            math.exp(value),
            math.exp(value - reach * error),
            math.exp(min(value + reach * error, 700.0)),
            cuts[name],
        )
        for name, value, error in zip(names, full.params[names].tolist(), errors, strict=True)
    )
    p = float(chi2.sf(statistic, len(names)))
    return OrdinalFit(effects, statistic, len(names), p, wald, float(full.llf), bool(full.mle_retvals["converged"]))


def _errors(fit: Any, number: int, participants: Any) -> tuple[list[float], float, Wald | None]:
    """Return standard errors of the predictors, how many of them make a 95 % interval, and the test over participants."""
    from scipy.stats import f, t

    if participants is None:
        return [float(error) for error in fit.bse.iloc[:number]], _Z975, None
    codes = np.unique(participants.astype(str), return_inverse=True)[1]
    people = int(codes.max()) + 1
    if people <= number:
        raise StudyError(f"more participants than compared conditions must have rated, got {people} for {number}")
    covariance = cluster_covariance(fit, codes)[:number, :number]
    values = fit.params.iloc[:number].to_numpy()
    # Hotelling: as many independent values as participants estimate the covariance
    statistic = float(values @ np.linalg.solve(covariance, values)) * (people - number) / (number * (people - 1))
    wald = Wald(statistic, float(number), float(people - number), float(f.sf(statistic, number, people - number)))
    return np.sqrt(np.diag(covariance)).tolist(), float(t.ppf(0.975, people - 1)), wald


def _matrices(frame: Any, rating: str, predictors: Sequence[str], participant: str) -> tuple[Any, Any, list[str], Any]:
    import pandas as pd

    values = frame[rating].reset_index(drop=True)
    ordered = (
        values if isinstance(values.dtype, pd.CategoricalDtype) else pd.Series(pd.Categorical(values, ordered=True))
    )
    ordered = ordered.cat.remove_unused_categories()
    if len(ordered.cat.categories) < 2:
        raise StudyError(f"{rating} must have at least two different values, got {len(ordered.cat.categories)}")
    columns = []
    for name in predictors:
        column = frame[name].reset_index(drop=True)
        if pd.api.types.is_numeric_dtype(column):
            columns.append(column.astype(float).to_frame())
        else:
            columns.append(pd.get_dummies(column.astype(str), drop_first=True, dtype=float))
    exog = pd.concat(columns, axis=1)
    if not exog.shape[1] or (exog.std() == 0.0).any():
        raise StudyError(f"{', '.join(predictors)} must have at least two levels")
    people = pd.DataFrame(index=exog.index)
    if participant:
        people = pd.get_dummies(frame[participant].reset_index(drop=True).astype(str), drop_first=True, dtype=float)
        people = people.add_prefix("participant ")
    return ordered, exog, list(exog.columns), people


def _per_unit(exog: Any) -> Any:
    return 1.0 / np.maximum(exog.std(), 1e-300)


def _alone(ordered: Any) -> float:
    """Log likelihood of the shares of the categories."""
    counts = ordered.value_counts().to_numpy(dtype=np.float64)
    return float(np.sum(counts * np.log(counts / counts.sum())))


def _by_cut(ordered: Any, exog: Any, names: Sequence[str]) -> dict[str, tuple[float, ...]]:
    import statsmodels.api as sm

    found: dict[str, list[float]] = {name: [] for name in names}
    for cut in range(1, len(ordered.cat.categories)):
        above = (ordered.cat.codes >= cut).to_numpy(dtype=np.float64)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fit = sm.GLM(above, sm.add_constant(exog, has_constant="add"), family=sm.families.Binomial()).fit()
        for name in names:
            found[name].append(float(fit.params[name]) if abs(float(fit.params[name])) < 15.0 else math.nan)
    return {name: tuple(values) for name, values in found.items()}
