"""The paper's analysis: an F-test on the errors of the estimates, then Tukey's family of intervals."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError


@dataclass(frozen=True)
class Term:
    """One line of an analysis of variance."""

    name: str  # Factor, or factors joined by a colon
    df: float  # Degrees of freedom
    df_error: float  # Those of its denominator
    # Type II, in the square of the unit of the response; not-a-number where the test is not one of sums
    sum_of_squares: float
    f: float  # Statistic and probability under no effect
    p: float
    eta_squared: float  # Partial eta squared and its 95 % interval from the noncentral F distribution
    eta_low: float
    eta_high: float


@dataclass(frozen=True)
class Interval:
    """Difference between two conditions."""

    first: str  # The difference is first minus second
    second: str
    difference: float  # Estimate and interval, in the unit of the response
    low: float
    high: float
    p: float  # Probability under no difference, adjusted for the family
    effect_size: float  # Difference over the residual standard deviation


@dataclass(frozen=True)
class FTest:
    """Analysis of variance and intervals."""

    terms: tuple[Term, ...]  # One per factor and interaction
    df_error: float  # Residual degrees of freedom
    mean_square: float  # Residual mean square
    intervals: tuple[Interval, ...]  # Tukey's family over the first factor
    fitted: Any  # shape (n,); For the checks
    residuals: Any


def f_test(
    frame: Any,
    response: str,
    factors: Sequence[str],
    interaction: bool = True,
    level: float = 0.95,
    intervals: bool = True,
) -> FTest:
    """Test factors and compare the levels of the first.

    Source: Tukey's intervals with Kramer's adjustment for unequal numbers: Kramer, C. Y. (1956), Biometrics 12, 307-310.
    """
    import statsmodels.formula.api as smf
    from statsmodels.stats.anova import anova_lm

    data, names = _renamed(frame, response, factors)
    shift, scale = float(data["y"].mean()), float(data["y"].std()) or 1.0
    data["y"] = (data["y"] - shift) / scale  # a large common offset would cost the digits of the squares
    formula = "y ~ " + (" * " if interaction else " + ").join(f"C({letter}, Sum)" for letter in names)
    fit = smf.ols(formula, data).fit()
    if fit.df_resid < 1 or fit.ssr <= 1e-20:
        raise StudyError(
            f"the error must be estimable: more than one judgement per cell, not all alike, got {len(data)} rows"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        table = anova_lm(fit, typ=2)
    terms = tuple(
        effect_of(
            _readable(str(label), names),
            float(row["df"]),
            fit.df_resid,
            float(row["sum_sq"]) * scale**2,
            float(row["F"]),
        )
        for label, row in table.iterrows()
        if label != "Residual"
    )
    family = _tukey(fit, data, level, scale) if intervals else ()
    return FTest(
        terms,
        float(fit.df_resid),
        float(fit.mse_resid) * scale**2,
        family,
        np.asarray(fit.fittedvalues) * scale + shift,
        np.asarray(fit.resid) * scale,
    )


def _renamed(frame: Any, response: str, factors: Sequence[str]) -> tuple[Any, dict[str, str]]:
    import pandas as pd

    if not 1 <= len(factors) <= 2:
        raise StudyError(f"one or two factors can be tested, got {len(factors)}")
    names = dict(zip("ab", factors, strict=False))
    data = pd.DataFrame({letter: frame[name].astype(str).to_numpy() for letter, name in names.items()})
    data["y"] = frame[response].to_numpy(dtype=np.float64)
    if not np.isfinite(data["y"]).all():
        raise StudyError(f"{response} must be finite in every row")
    for letter, name in names.items():
        if data[letter].nunique() < 2:
            raise StudyError(f"{name} must have at least two levels to be tested, got {data[letter].nunique()}")
    if len(data.groupby(list(names))) != math.prod(data[letter].nunique() for letter in names):
        raise StudyError(f"every combination of {' and '.join(factors)} must have a judgement; at least one has none")
    return data, names


def _readable(label: str, names: dict[str, str]) -> str:
    return ":".join(names[part.split("(")[1][0]] for part in label.split(":"))


def effect_of(name: str, df: float, df_error: float, squares: float, f: float) -> Term:
    """Complete a line of an analysis of variance from its statistic.

    Source: Steiger, J. H. (2004), Psychological Methods 9, 164-182, doi:10.1037/1082-989X.9.2.164.
    """
    from scipy import stats
    from statsmodels.stats.oneway import confint_noncentrality

    low, high = (float(value) for value in confint_noncentrality(f, (df, df_error), alpha=0.05))
    total = df + df_error + 1.0
    p, share = float(stats.f.sf(f, df, df_error)), df * f / (df * f + df_error)
    return Term(name, df, float(df_error), squares, f, p, share, low / (low + total), high / (high + total))


def _tukey(fit: Any, data: Any, level: float, scale: float) -> tuple[Interval, ...]:
    from scipy.stats import studentized_range

    levels = sorted(data["a"].unique())
    rows = _mean_rows(fit, data, levels)
    quantile = float(studentized_range.ppf(level, len(levels), fit.df_resid))
    covariance = fit.cov_params().to_numpy()
    found = []
    for one, two in itertools.combinations(range(len(levels)), 2):
        contrast = rows[one] - rows[two]
        difference = float(contrast @ fit.params.to_numpy())
        error = math.sqrt(0.5 * float(contrast @ covariance @ contrast))
        p = float(studentized_range.sf(abs(difference) / error, len(levels), fit.df_resid))
        reach = quantile * error
        found.append(
            Interval(
                levels[one],
                levels[two],
                difference * scale,
                (difference - reach) * scale,
                (difference + reach) * scale,
                p,
                difference / math.sqrt(fit.mse_resid),
            )
        )
    return tuple(found)


def _mean_rows(fit: Any, data: Any, levels: Sequence[str]) -> list[Any]:
    """Rows of the design matrix, one per level of the first factor, averaged over the second with equal weight."""
    letters = [letter for letter in "ab" if letter in data]
    first = data.reset_index(drop=True).drop_duplicates(letters)
    exog = np.asarray(fit.model.exog)
    return [exog[first.index[first["a"] == one]].mean(axis=0) for one in levels]
