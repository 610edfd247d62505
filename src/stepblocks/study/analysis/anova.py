"""The paper's analysis: an F-test on the errors of estimates, and Tukey's intervals."""

import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import stats

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.bounded import Bounded

if TYPE_CHECKING:
    from statsmodels.regression.linear_model import RegressionResultsWrapper

_NO_ERROR = 1e-20  # residual sum of squares of a standardised response that counts as none [1]


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

    @property
    def bounds(self) -> Bounded:
        """The difference with its interval."""
        return Bounded(self.difference, self.low, self.high)

    def involves(self, condition: str) -> bool:
        """Return whether a condition is one of the two."""
        return condition in (self.first, self.second)


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


class StandardisedResponse(NamedTuple):
    """A table whose response has mean 0 and standard deviation 1.

    Attributes
    ----------
    data : DataFrame
        Columns of letters for the factors, as texts, and ``y`` for the response [1].
    scale, shift : float
        Standard deviation and mean of the response, in its unit.
    """

    data: Table
    scale: float
    shift: float


class LinearEstimate(NamedTuple):
    """Parameters of a linear model of a standardised response, with their covariance [1]."""

    parameters: Array
    covariance: Array


def run_f_test(
    frame: Table,
    response: str,
    first_factor: str,
    second_factor: str = "",
    *,
    interaction: bool = True,
    intervals: bool = True,
) -> FTest:
    """Test one or two factors and compare the levels of the first.

    Parameters
    ----------
    frame : DataFrame
        One row per judgement.
    response, first_factor, second_factor : str
        Columns of the response and of the factors; without a second factor, one is tested.
    interaction : bool
        Whether the model has an interaction of the two factors.
    intervals : bool
        Whether the levels of the first factor are compared.

    Returns
    -------
    FTest
        Type II tests, and Tukey's intervals in the unit of the response.

    Raises
    ------
    StudyError
        If a factor has one level, a cell has no judgement, or the error cannot be estimated.
    """
    names = {"a": first_factor}
    if second_factor:
        names["b"] = second_factor
    standardised = standardise_response(frame, response, **names)
    data = standardised.data
    _refuse_untestable_factors(data, names)
    fit = _fit_linear_model_of_factors(data, list(names), interaction)
    terms = tuple(_iterate_terms(fit, names, standardised.scale))
    if not intervals:
        return FTest(terms, ())
    levels = sorted(data["a"].unique())
    family = iterate_pairwise_intervals(
        levels,
        build_mean_design_rows(fit.model, data, levels),
        LinearEstimate(fit.params.to_numpy(), fit.cov_params().to_numpy()),
        lambda contrast: float(fit.df_resid),
        spread=math.sqrt(fit.mse_resid),
        scale=standardised.scale,
    )
    return FTest(terms, tuple(family))


def _refuse_untestable_factors(data: Table, factors_by_letter: dict[str, str]) -> None:
    """Reject a factor of one level, and a combination of levels without a judgement."""
    cells = 1
    for letter, name in factors_by_letter.items():
        levels = data[letter].nunique()
        if levels < 2:
            raise StudyError(f"{name} must have at least two levels to be tested, got {levels}")
        cells *= levels
    counts = data.groupby(list(factors_by_letter)).size()
    if len(counts) != cells:
        combination = " and ".join(factors_by_letter.values())
        lacking = _format_first_empty_cell(data, list(factors_by_letter))
        raise StudyError(
            f"every combination of {combination} must have a judgement; {lacking} has none"
        )


def _format_first_empty_cell(data: Table, factors: list[str]) -> str:
    """Write the first combination of levels of factors, columns of `data`, without a judgement."""
    found = set(data[factors].itertuples(index=False, name=None))
    for cell in itertools.product(*(sorted(data[factor].unique()) for factor in factors)):
        if cell not in found:
            return " with ".join(map(str, cell))
    return "none"


def _fit_linear_model_of_factors(
    data: Table, letters: Sequence[str], interaction: bool
) -> "RegressionResultsWrapper":
    """Fit a linear model of ``y`` with sum contrasts; return the results of statsmodels."""
    import statsmodels.formula.api as smf

    joined = " + "
    if interaction:
        joined = " * "
    predictors = joined.join(f"C({letter}, Sum)" for letter in letters)
    fit = smf.ols(f"y ~ {predictors}", data).fit()
    if not (fit.df_resid >= 1 and fit.ssr > _NO_ERROR):
        raise StudyError(
            "the error must be estimable: more than one judgement per cell, not all alike, got "
            f"{len(data)} rows"
        )
    return fit


def _iterate_terms(
    fit: "RegressionResultsWrapper", factors_by_letter: dict[str, str], scale: float
) -> Iterator[Term]:
    """Yield the type II tests of a fit; `factors_by_letter` are the factors by their letters."""
    from statsmodels.stats.anova import anova_lm

    with warnings.catch_warnings(action="ignore", category=FutureWarning):
        table = anova_lm(fit, typ=2)
    for label, row in table.drop("Residual").iterrows():
        factors = []
        for part in str(label).split(":"):  # such as C(a, Sum):C(b, Sum)
            letter = part.removeprefix("C(")[0]
            factors.append(factors_by_letter[letter])
        squares = float(row["sum_sq"]) * scale**2
        yield make_term(":".join(factors), float(row["df"]), fit.df_resid, squares, float(row["F"]))


def standardise_response(frame: Table, response: str, **names: str) -> StandardisedResponse:
    """Rename the columns of factors to letters and standardise the response.

    `names` give the column of each letter; a letter without a column is left out.
    """
    # a large offset costs the digits of squares
    import pandas as pd

    columns = {}
    for letter, name in names.items():
        if name:
            columns[letter] = frame[name].astype(str).to_numpy()
    values = frame[response].to_numpy(dtype=np.float64)
    if not np.isfinite(values).all():
        raise StudyError(f"{response} must be finite in every row")
    scale = float(values.std(ddof=1))
    shift = float(values.mean())
    standardised = (values - shift) / (scale or 1.0)
    return StandardisedResponse(pd.DataFrame(columns).assign(y=standardised), scale, shift)


def make_term(
    name: str, df: float, df_error: float, sum_of_squares: float, f_statistic: float
) -> Term:
    """Complete a line of an analysis of variance from its statistic.

    The interval of eta squared follows Steiger, J. H. (2004), Psychological Methods 9, 164-182,
    doi:10.1037/1082-989X.9.2.164.
    """
    from statsmodels.stats.oneway import confint_noncentrality

    interval = confint_noncentrality(f_statistic, (df, df_error), alpha=0.05)
    low, high = map(float, interval)
    total = df + df_error + 1.0
    return Term(
        name=name,
        df=df,
        df_error=float(df_error),
        sum_of_squares=sum_of_squares,
        f=f_statistic,
        p=float(stats.f.sf(f_statistic, df, df_error)),
        eta_squared=df * f_statistic / (df * f_statistic + df_error),
        eta_low=low / (low + total),
        eta_high=high / (high + total),
    )


@cache
def _compute_studentized_range_limit(levels: int, df: float) -> float:
    """Return the 95 % point of the studentized range; it costs half a second."""
    return float(stats.studentized_range.ppf(0.95, levels, df))


def make_tukey_interval(
    first: str,
    second: str,
    difference: float,
    standard_error: float,
    df: float,
    *,
    levels: int,
    effect_size: float,
) -> Interval:
    """Complete a comparison, one of all pairs of some levels, from difference and error.

    All intervals of the family hold together (Tukey); with unequal numbers after Kramer, C. Y.
    (1956), Biometrics 12, 307-310.
    """
    statistic = abs(difference) / standard_error
    if levels == 2:  # no integral is needed
        limit = float(stats.t.ppf(0.975, df))
        p = float(2.0 * stats.t.sf(statistic, df))
    else:
        limit = float(_compute_studentized_range_limit(levels, df) / math.sqrt(2.0))
        p = float(stats.studentized_range.sf(statistic * math.sqrt(2.0), levels, df))
    return Interval(
        first,
        second,
        difference,
        difference - limit * standard_error,
        difference + limit * standard_error,
        min(p, 1.0),
        effect_size,
        standard_error,
        df,
    )


def iterate_pairwise_intervals(
    levels: Sequence[str],
    mean_rows: Sequence[Array],
    estimate: LinearEstimate,
    count_freedom: Callable[[Array], float],
    *,
    spread: float,
    scale: float,
) -> Iterator[Interval]:
    """Compare every two levels of a linear model so that all 95 % intervals hold together.

    Parameters
    ----------
    levels : sequence of str
        Of the first factor.
    mean_rows : sequence of ndarray, shape (n,)
        What gives the mean of each level from the `n` parameters.
    estimate : LinearEstimate
        Of the parameters.
    count_freedom : callable
        Takes a contrast of the parameters, returns its degrees of freedom.
    spread : float
        Residual standard deviation [1].
    scale : float
        Unit of all these in the unit of the response.
    """
    means = dict(zip(levels, mean_rows, strict=True))
    for first, second in itertools.combinations(levels, 2):
        contrast = means[first] - means[second]
        difference = float(contrast @ estimate.parameters)
        error = math.sqrt(contrast @ estimate.covariance @ contrast)
        yield make_tukey_interval(
            first,
            second,
            difference * scale,
            error * scale,
            count_freedom(contrast),
            levels=len(levels),
            effect_size=difference / spread,
        )


def build_mean_design_rows(model: Any, data: Table, levels: Sequence[str]) -> list[Array]:
    """Return a row of the design matrix for each level, averaged over the second factor."""
    factors = [letter for letter in ("a", "b") if letter in data]
    cells = data.reset_index(drop=True).drop_duplicates(factors)
    exog = np.asarray(model.exog)
    rows = []
    for level in levels:
        of_level = cells.index[cells["a"] == level]
        rows.append(exog[of_level].mean(axis=0))
    return rows
