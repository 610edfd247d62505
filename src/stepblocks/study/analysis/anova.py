"""The paper's analysis: an F-test on the errors of estimates, and Tukey's intervals."""

import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import stats

from stepblocks.study import Array, Table, require


@dataclass(frozen=True)
class Term:
    """One line of an analysis of variance.

    Attributes
    ----------
    name : str
        Factor, or factors joined by a colon.
    df, df_error : float
        Degrees of freedom of numerator and denominator.
    sum_of_squares : float
        Type II, in the square of the unit of the response; not-a-number where the test has none.
    f, p : float
        Statistic, and the probability of it or more under no effect.
    eta_squared, eta_low, eta_high : float
        Partial eta squared and its 95 % interval from the noncentral F distribution [1].
    """

    name: str
    df: float
    df_error: float
    sum_of_squares: float
    f: float
    p: float
    eta_squared: float
    eta_low: float
    eta_high: float


@dataclass(frozen=True)
class Interval:
    """Difference between two conditions, first minus second.

    Attributes
    ----------
    first, second : str
        Conditions.
    difference, low, high : float
        With its 95 % interval, in the unit of the response.
    p : float
        Probability under no difference, adjusted for the family.
    effect_size : float
        Difference over the standard deviation of residuals or of differences [1].
    error, df : float
        Standard error of the difference, and its degrees of freedom.
    """

    first: str
    second: str
    difference: float
    low: float
    high: float
    p: float
    effect_size: float
    error: float
    df: float


@dataclass(frozen=True)
class FTest:
    """Analysis of variance and intervals.

    Attributes
    ----------
    terms : tuple of Term
        One per factor and interaction.
    intervals : tuple of Interval
        Tukey's family over the first factor.
    """

    terms: tuple[Term, ...]
    intervals: tuple[Interval, ...]


def run_f_test(
    frame: Table,
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
        require(
            data[letter].nunique() >= 2,
            f"{name} must have at least two levels to be tested, got {data[letter].nunique()}",
        )
    require(
        len(data.groupby(list(names))) == math.prod(data[letter].nunique() for letter in names),
        f"every combination of {first} and {second} must have a judgement; at least one has none",
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
    levels = sorted(data["a"].unique())
    family = compare_all_pairs(
        levels,
        find_mean_rows(fit.model, data, levels),
        (fit.params.to_numpy(), fit.cov_params().to_numpy()),
        lambda _: float(fit.df_resid),
        spread=math.sqrt(fit.mse_resid),
        scale=scale,
    )
    return FTest(tuple(terms), tuple(family) if intervals else ())


def standardise_response(frame: Table, response: str, **names: str) -> tuple[Table, float, float]:
    """Rename columns and standardise the response; return its scale and shift as well."""
    # a large offset costs the digits of squares
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
    from statsmodels.stats.oneway import confint_noncentrality

    low, high = (float(value) for value in confint_noncentrality(f, (df, df_error), alpha=0.05))
    total = df + df_error + 1.0
    return Term(
        name,
        df,
        float(df_error),
        squares,
        f,
        float(stats.f.sf(f, df, df_error)),
        df * f / (df * f + df_error),
        low / (low + total),
        high / (high + total),
    )


@cache
def _find_range_limit(levels: int, df: float) -> float:
    # Return the limit of a family of pairs; it costs half a second
    return float(stats.studentized_range.ppf(0.95, levels, df))


def make_interval(
    names: tuple[str, str],
    found: tuple[float, float],
    df: float,
    levels: int,
    effect_size: float,
    scale: float = 1.0,
) -> Interval:
    """Complete a comparison, one of all pairs of some levels, from difference and error."""
    # Tukey's family; with unequal numbers: Kramer, C. Y. (1956), Biometrics 12, 307-310.
    difference, error = (value * scale for value in found)
    size = abs(difference) / error
    limit, p = (
        (stats.t.ppf(0.975, df), 2.0 * stats.t.sf(size, df))  # two levels: no integral is needed
        if levels == 2
        else (
            _find_range_limit(levels, df) / math.sqrt(2.0),
            stats.studentized_range.sf(size * math.sqrt(2.0), levels, df),
        )
    )
    ends = (difference, difference - float(limit) * error, difference + float(limit) * error)
    return Interval(*names, *ends, min(float(p), 1.0), effect_size, error, df)


def compare_all_pairs(
    levels: Sequence[str],
    rows: Sequence[Array],
    parameters: tuple[Array, Array],
    count_freedom: Callable[[Array], float],
    *,
    spread: float,
    scale: float,
) -> Iterator[Interval]:
    """Compare every two levels of a linear model so that all 95 % intervals hold together."""
    # `rows` give the mean of each level from the parameters (values, covariance); `spread` is the
    # residual standard deviation, `scale` the unit of all these in that of the response.
    beta, covariance = parameters
    for one, two in itertools.combinations(range(len(levels)), 2):
        contrast = rows[one] - rows[two]
        found = (float(contrast @ beta), math.sqrt(contrast @ covariance @ contrast))
        yield make_interval(
            (levels[one], levels[two]),
            found,
            count_freedom(contrast),
            len(levels),
            found[0] / spread,
            scale,
        )


def find_mean_rows(model: Table, data: Table, levels: Sequence[str]) -> list[Array]:
    """Return a row of the design matrix for each level, averaged over the second factor."""
    first = data.reset_index(drop=True).drop_duplicates(
        [letter for letter in "ab" if letter in data]
    )
    exog = np.asarray(model.exog)
    return [exog[first.index[first["a"] == one]].mean(axis=0) for one in levels]
