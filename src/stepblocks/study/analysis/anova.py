"""The paper's analysis: an F-test on the errors of the estimates, Tukey's family of intervals, and what both take for granted."""

import itertools
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study import require

_DOUBT = 0.05
_ADVICE = {
    "residuals are normal": "the tests of means bear it with many judgements; read the quantile plot, or analyse "
    "logarithms",
    "conditions have one residual spread": "intervals are too wide for some conditions and too narrow for "
    "others",
    "participants are a normal sample": "look for one participant who differs from all others",
}


@dataclass(frozen=True)
class Term:
    """One line of an analysis of variance."""

    name: str  # factor, or factors joined by a colon
    df: float  # degrees of freedom
    df_error: float  # those of its denominator
    # type II, in the square of the unit of the response; not-a-number where the test is not one of
    # sums
    sum_of_squares: float
    f: float
    p: float  # probability of this F or more under no effect
    eta_squared: float  # partial eta squared
    eta_low: float  # ends of its 95 % interval from the noncentral F distribution
    eta_high: float


@dataclass(frozen=True)
class Interval:
    """Difference between two conditions, first minus second."""

    first: str
    second: str
    difference: float  # in the unit of the response
    low: float
    high: float
    p: float  # probability under no difference, adjusted for the family
    effect_size: float  # difference over the residual standard deviation
    error: float  # standard error of the difference


@dataclass(frozen=True)
class FTest:
    """Analysis of variance and intervals."""

    terms: tuple[Term, ...]  # one per factor and interaction
    df_error: float  # residual degrees of freedom
    intervals: tuple[Interval, ...]  # Tukey's family over the first factor


@dataclass(frozen=True)
class Check:
    """One assumption of a linear model and its test."""

    assumption: str  # what the model takes for granted
    test: str
    statistic: float  # not-a-number where the data are too few for the test
    p: float
    verdict: str  # "no objection" (which is no proof), "in doubt" or "not tested"
    advice: str  # what a doubt means for the reader


def run_f_test(
    frame: Any,
    response: str,
    first: str,
    second: str = "",
    *,
    interaction: bool = True,
    intervals: bool = True,
) -> FTest:
    """Test one or two factors and compare the levels of the first."""
    import statsmodels.formula.api as smf
    from statsmodels.stats.anova import anova_lm

    names = {letter: name for letter, name in (("a", first), ("b", second)) if name}
    data, scale, _ = standardise_response(frame, response, **names)
    for letter, name in names.items():
        if data[letter].nunique() < 2:
            raise StudyError(
                f"{name} must have at least two levels to be tested, got {data[letter].nunique()}"
            )
    if len(data.groupby(list(names))) != math.prod(data[letter].nunique() for letter in names):
        raise StudyError(
            f"every combination of {first} and {second} must have a judgement; at "
            "least "
            "one "
            "has "
            "none"
        )
    formula = "y ~ " + (" * " if interaction else " + ").join(
        f"C({letter}, Sum)" for letter in names
    )
    fit = smf.ols(formula, data).fit()
    require(
        fit.df_resid >= 1 and fit.ssr > 1e-20,
        "the error must be estimable: more than one judgement per cell, not all alike, got "
        f"{len(data)} rows",
    )
    with warnings.catch_warnings(action="ignore", category=FutureWarning):
        table = anova_lm(fit, typ=2)
    terms = []
    for label, row in table.drop("Residual").iterrows():
        name = ":".join(names[part.split("(")[1][0]] for part in str(label).split(":"))
        df, squares, f = (float(row[column]) for column in ("df", "sum_sq", "F"))
        terms.append(make_term(name, df, fit.df_resid, squares * scale**2, f))
    family = []
    if intervals:
        levels, parameters = (
            sorted(data["a"].unique()),
            (fit.params.to_numpy(), fit.cov_params().to_numpy()),
        )
        spread, rows = math.sqrt(fit.mse_resid), find_mean_rows(fit, data, levels)
        family = compare_all_pairs(
            levels, rows, parameters, fit.df_resid, spread=spread, scale=scale
        )
    return FTest(tuple(terms), float(fit.df_resid), tuple(family))


def standardise_response(frame: Any, response: str, **names: str) -> tuple[Any, float, float]:
    """Rename columns, and take scale and shift, also returned, off the response: a large offset costs the digits of squares."""
    import pandas as pd

    data = pd.DataFrame(
        {letter: frame[name].astype(str).to_numpy() for letter, name in names.items() if name}
    )
    values = frame[response].to_numpy(dtype=np.float64)
    require(np.isfinite(values).all(), f"{response} must be finite in every row")
    scale, shift = float(values.std(ddof=1)), float(values.mean())
    return data.assign(y=(values - shift) / (scale or 1.0)), scale, shift


def make_term(name: str, df: float, df_error: float, squares: float, f: float) -> Term:
    """Complete a line of an analysis of variance from its statistic."""
    # Steiger, J. H. (2004), Psychological Methods 9, 164-182, doi:10.1037/1082-989X.9.2.164.
    from scipy import stats
    from statsmodels.stats.oneway import confint_noncentrality

    low, high = (float(value) for value in confint_noncentrality(f, (df, df_error), alpha=0.05))
    total = df + df_error + 1.0
    p, share = float(stats.f.sf(f, df, df_error)), df * f / (df * f + df_error)
    return Term(
        name, df, float(df_error), squares, f, p, share, low / (low + total), high / (high + total)
    )


def compare_all_pairs(
    levels: Sequence[str],
    rows: Sequence[Any],
    parameters: tuple[Any, Any],
    df_error: float,
    *,
    spread: float,
    scale: float,
) -> list[Interval]:
    """Compare every two levels so that all 95 % intervals hold together."""
    # `rows` give the mean of each level from the parameters (values, covariance); `spread` is the
    # residual standard deviation, `scale` the unit of all these in that of the response. Source,
    # with unequal numbers: Kramer, C. Y. (1956), Biometrics 12, 307-310.
    from scipy.stats import studentized_range

    beta, covariance = parameters
    quantile = float(studentized_range.ppf(0.95, len(levels), df_error))
    found = []
    for one, two in itertools.combinations(range(len(levels)), 2):
        contrast = rows[one] - rows[two]
        difference, error = (
            float(contrast @ beta),
            math.sqrt(0.5 * float(contrast @ covariance @ contrast)),
        )
        p = float(studentized_range.sf(abs(difference) / error, len(levels), df_error))
        reach = quantile * error
        ends = (difference * scale, (difference - reach) * scale, (difference + reach) * scale)
        apart = math.sqrt(2.0) * error * scale
        found.append(Interval(levels[one], levels[two], *ends, p, difference / spread, apart))
    return found


def find_mean_rows(fit: Any, data: Any, levels: Sequence[str]) -> list[Any]:
    """Rows of the design matrix, one per level of the first factor, averaged over the second with equal weight."""
    letters = [letter for letter in "ab" if letter in data]
    first = data.reset_index(drop=True).drop_duplicates(letters)
    exog = np.asarray(fit.model.exog)
    return [exog[first.index[first["a"] == one]].mean(axis=0) for one in levels]


def check_residuals(residuals: Any, groups: Sequence[str], participant_effects: Any) -> list[Check]:
    """Test the residuals of a linear model."""
    from scipy import stats

    values, names = np.asarray(residuals, dtype=np.float64), np.asarray(groups)
    sample = (
        values
        if values.size <= 5000
        else np.sort(values)[np.linspace(0, values.size - 1, 5000).astype(int)]
    )
    parts = [values[names == name] for name in dict.fromkeys(names.tolist())]
    enough = len(parts) > 1 and min(len(part) for part in parts) > 2
    levene = stats.levene(*parts, center="median") if enough else (math.nan, math.nan)
    checks = []
    for assumption, test, (statistic, p) in (
        ("residuals are normal", "Shapiro-Wilk", _shapiro(sample)),
        ("conditions have one residual spread", "Levene (median)", levene),
        (
            "participants are a normal sample",
            "Shapiro-Wilk",
            _shapiro(np.asarray(participant_effects)),
        ),
    ):
        verdict = "not tested" if math.isnan(p) else "in doubt" if p < _DOUBT else "no objection"
        advice = _ADVICE[assumption] if verdict == "in doubt" else ""
        checks.append(Check(assumption, test, float(statistic), float(p), verdict, advice))
    return checks


def _shapiro(values: Any) -> tuple[float, float]:
    from scipy import stats

    if values.size < 4 or float(np.ptp(values)) <= 0.0:
        return math.nan, math.nan
    statistic, p = stats.shapiro(values / np.abs(values).max())
    return float(statistic), float(p)
