"""The findings of an analysis as one flat table with units: the rows of results.csv."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum

from scipy import stats

from stepblocks.study.analysis.accuracy import BIAS, Measure, assess_equivalence
from stepblocks.study.analysis.anova import Interval, Term
from stepblocks.study.analysis.bounded import Bounded
from stepblocks.study.analysis.comparisons import Comparisons, Curve, GroupMember
from stepblocks.study.analysis.findings import (
    EXPONENT,
    Analysis,
    Finding,
    MeasureTest,
    PlannedTest,
    RatingTest,
)
from stepblocks.study.analysis.influence import Influence, iterate_influences
from stepblocks.study.analysis.log_error import LogError
from stepblocks.study.analysis.magnitudes import PowerLaw
from stepblocks.study.analysis.mixed import MixedFit, Slope
from stepblocks.study.analysis.psychometric import Z975, compute_weber_fraction
from stepblocks.study.analysis.repeated import (
    Sphericity,
    approximate_null_bayes_factor,
    compute_effect_size_interval,
    compute_null_bayes_factor,
)

RowIterator = Iterator["ResultRow"]

_UPPER = 0.975  # of a 95 % interval


class AnalysisName(StrEnum):
    """What gives the figures of a row."""

    PRIMARY = "primary outcome"
    SECONDARY = "secondary outcome, Holm"
    F_TEST = "f-test"
    TUKEY = "tukey"
    MIXED = "mixed model"
    CORRECTED = "mixed model, Huynh and Feldt"
    SPHERICITY = "sphericity"
    PAIRED = "participants' differences"
    BAYES = "Bayes factor"
    FACTORS = "declared factors"
    EQUIVALENCE = "equivalence"
    LOGARITHM = "error of the logarithm"
    ORDER = "mixed model, order of trials"
    GROUPS = "groups"
    ORDINAL = "ordinal model"
    CURVE = "psychometric function"
    CONTRAST = "contrast of settings"
    POWER_LAW = "power law"
    INFLUENCE = "leaving each participant out"

    @property
    def effect_scale(self) -> str:
        """What an effect size of this analysis is over."""
        if self is AnalysisName.PAIRED:
            return "standard deviation of the differences"
        return "residual standard deviation"


class Unit(StrEnum):
    """Unit in which an estimate and its interval are written."""

    NONE = "1"
    MICROMETRES = "um"

    @property
    def units_per_si_unit(self) -> float:
        """How many of the unit make one SI unit."""
        return 1e6 if self is Unit.MICROMETRES else 1.0


@dataclass(frozen=True)
class ResultRow:
    """One row of results.csv; a figure that the row does not have is not-a-number.

    Attributes
    ----------
    measure : str
        Measure of accuracy; empty where there is none.
    analysis : AnalysisName
        What gives the figures.
    quantity : str
        What is estimated or tested.
    unit : Unit
        Of estimate, low and high.
    estimate, low_95, high_95 : float
        With the 95 % interval.
    statistic, df, df_error, p : float
        Of a test.
    """

    measure: str
    analysis: AnalysisName
    quantity: str
    unit: Unit = Unit.NONE
    estimate: float = math.nan
    low_95: float = math.nan
    high_95: float = math.nan
    statistic: float = math.nan
    df: float = math.nan
    df_error: float = math.nan
    p: float = math.nan

    def list_cells(self) -> list[str | float]:
        """Return the cells of the row, in `COLUMNS`."""
        figures: list[float] = [getattr(self, name) for name in FIGURES]
        return [self.measure, self.analysis.value, self.quantity, self.unit.value, *figures]


COLUMNS = tuple(column.name for column in fields(ResultRow))
FIGURES = COLUMNS[4:]


def iterate_result_rows(analysis: Analysis, findings: Sequence[Finding]) -> RowIterator:
    """Yield every figure of an analysis; `findings` are its planned tests."""
    for finding in findings:
        name = AnalysisName.PRIMARY if finding.primary else AnalysisName.SECONDARY
        yield ResultRow("", name, finding.name, p=finding.corrected)
    for measure in _sort_measures(analysis, findings):
        for row in _iterate_measure_rows(measure):
            yield replace(row, measure=measure.name)
    for log_error in analysis.log_errors:
        yield from _iterate_log_error_rows(log_error)
    yield from _iterate_rating_test_rows(analysis)
    for setting in analysis.comparisons:
        yield from _iterate_curve_rows_of_setting(setting)
    yield from _iterate_contrast_rows(analysis)
    for law in analysis.power_laws:
        yield from _iterate_power_law_rows(law, names_condition=len(analysis.power_laws) > 1)
    for interval in analysis.exponents:
        difference = _format_difference_name(interval)
        yield _make_estimate_row(
            AnalysisName.POWER_LAW,
            f"{EXPONENT}, {difference}",
            interval.bounds,
            df_error=interval.df,
            p=interval.p,
        )
        yield from _iterate_equivalence_rows(interval, False, quantity_prefix=f"{EXPONENT}, ")
    for influence in iterate_influences(analysis, findings):
        yield _make_row_without_participant(influence)


def _sort_measures(analysis: Analysis, findings: Sequence[Finding]) -> list[Measure]:
    """Sort measures of accuracy: the primary outcome first, the others as they are."""
    first = [finding.name for finding in findings if finding.primary]
    return sorted(analysis.measures, key=lambda measure: measure.name not in first)


def _make_estimate_row(
    analysis: AnalysisName,
    quantity: str,
    bounds: Bounded,
    unit: Unit = Unit.NONE,
    *,
    statistic: float = math.nan,
    df: float = math.nan,
    df_error: float = math.nan,
    p: float = math.nan,
) -> ResultRow:
    """Lay out an estimate with its interval, in SI units, and the test beside it."""
    if unit is Unit.MICROMETRES:
        bounds = bounds.transform(lambda length: length * unit.units_per_si_unit)
    return ResultRow(
        "",
        analysis,
        quantity,
        unit,
        estimate=bounds.value,
        low_95=bounds.low,
        high_95=bounds.high,
        statistic=statistic,
        df=df,
        df_error=df_error,
        p=p,
    )


def _make_term_row(analysis: AnalysisName, term: Term) -> ResultRow:
    """Lay out a line of an analysis of variance."""
    return _make_estimate_row(
        analysis,
        f"{term.name}, partial eta squared",
        Bounded(term.eta_squared, term.eta_low, term.eta_high),
        statistic=term.f,
        df=term.df,
        df_error=term.df_error,
        p=term.p,
    )


def _format_difference_name(interval: Interval, logarithmic: bool = False) -> str:
    """Name a difference; of logarithms it is a ratio."""
    if logarithmic:
        return f"{interval.first} over {interval.second}"
    return f"{interval.first} minus {interval.second}"


def _iterate_interval_rows(
    analysis: AnalysisName, intervals: Sequence[Interval], logarithmic: bool
) -> RowIterator:
    """Lay out differences of a measure, each with its effect size."""
    for interval in intervals:
        quantity = _format_difference_name(interval, logarithmic)
        bounds, unit = interval.bounds, Unit.MICROMETRES
        if logarithmic:
            bounds, unit = bounds.transform(math.exp), Unit.NONE
        t = interval.difference / interval.error
        yield _make_estimate_row(
            analysis, quantity, bounds, unit, statistic=t, df_error=interval.df, p=interval.p
        )
        low, high = math.nan, math.nan
        if analysis is AnalysisName.PAIRED:
            low, high = compute_effect_size_interval(t, interval.df + 1.0)
        yield ResultRow(
            "",
            analysis,
            f"{_format_difference_name(interval)}, over the {analysis.effect_scale}",
            estimate=interval.effect_size,
            low_95=low,
            high_95=high,
        )


def _iterate_equivalence_rows(
    interval: Interval,
    logarithmic: bool,
    unit: Unit = Unit.NONE,
    quantity_prefix: str = "",
    margin: float = math.nan,
) -> RowIterator:
    """Yield the bound of a difference between two settings; of logarithms, a ratio."""
    equivalence = assess_equivalence(interval, margin)
    quantity = f"{quantity_prefix}{interval.first} and {interval.second} differ by less than"
    bound = equivalence.bound
    if logarithmic:
        quantity = f"{quantity} a factor of"
        unit = Unit.NONE
        bound = math.exp(bound)
    upper = Bounded(math.nan, math.nan, bound)
    yield _make_estimate_row(AnalysisName.EQUIVALENCE, quantity, upper, unit, df_error=interval.df)
    if math.isfinite(margin):
        yield _make_estimate_row(
            AnalysisName.EQUIVALENCE,
            f"{quantity} the margin",
            Bounded(margin, math.nan, math.nan),
            unit,
            statistic=equivalence.statistic,
            df_error=interval.df,
            p=equivalence.p,
        )


def _iterate_measure_rows(measure: Measure) -> RowIterator:
    """Yield the figures of a measure of accuracy."""
    logarithmic = measure.is_logarithmic
    for term in measure.f_test.terms:
        yield _make_term_row(AnalysisName.F_TEST, term)
    yield from _iterate_interval_rows(AnalysisName.TUKEY, measure.f_test.intervals, logarithmic)
    if measure.mixed.condition is not None:
        yield _make_term_row(AnalysisName.MIXED, measure.mixed.condition)
        yield from _iterate_interval_rows(AnalysisName.MIXED, measure.mixed.intervals, logarithmic)
    if measure.corrected is not None and measure.sphericity is not None:
        yield _make_term_row(AnalysisName.CORRECTED, measure.corrected)
        yield from _iterate_sphericity_rows(measure.sphericity)
    yield from _iterate_interval_rows(AnalysisName.PAIRED, measure.paired, logarithmic)
    yield from _iterate_bayes_factor_rows(measure.paired)
    for term in measure.factors:
        yield from _iterate_factor_test_rows(term)
    yield from _iterate_mean_rows(measure)
    yield from _iterate_deviation_rows(measure.mixed, logarithmic)
    if measure.mixed.slope is not None:
        yield _make_slope_row(measure.mixed.slope)
    for interval in (*measure.mixed.intervals, *measure.group_intervals):
        yield from _iterate_equivalence_rows(
            interval, logarithmic, Unit.MICROMETRES, margin=measure.margin
        )
    for term in measure.groups:
        yield _make_term_row(AnalysisName.GROUPS, term)
    yield from _iterate_interval_rows(AnalysisName.GROUPS, measure.group_intervals, logarithmic)


def _make_slope_row(slope: Slope) -> ResultRow:
    """Lay out by how much a measure changes over ten trials."""
    reach = slope.error * float(stats.t.ppf(_UPPER, slope.df))
    return _make_estimate_row(
        AnalysisName.ORDER,
        "change over 10 trials",
        Bounded(slope.value, slope.value - reach, slope.value + reach),
        Unit.MICROMETRES,
        statistic=slope.value / slope.error,
        df_error=slope.df,
        p=slope.p,
    )


def _iterate_sphericity_rows(sphericity: Sphericity) -> RowIterator:
    """Yield both epsilons and Mauchly's test."""
    name = AnalysisName.SPHERICITY
    yield ResultRow("", name, "epsilon of Greenhouse and Geisser", estimate=sphericity.epsilon)
    yield ResultRow("", name, "epsilon of Huynh and Feldt", estimate=sphericity.huynh_feldt)
    yield ResultRow("", name, "W of Mauchly", statistic=sphericity.statistic, p=sphericity.p)


def _iterate_bayes_factor_rows(intervals: Sequence[Interval]) -> RowIterator:
    """Yield the Bayes factor of each paired difference."""
    for interval in intervals:
        yield ResultRow(
            "",
            AnalysisName.BAYES,
            f"BF01, {interval.first} and {interval.second}, no difference over a difference",
            estimate=compute_null_bayes_factor(
                interval.difference / interval.error, interval.df + 1.0
            ),
        )


def _iterate_factor_test_rows(term: Term) -> RowIterator:
    """Yield the test of a declared factor, and its Bayes factor."""
    yield _make_term_row(AnalysisName.FACTORS, term)
    if math.isclose(term.df, 1.0):  # of two levels, F is the square of Student's t
        factor = compute_null_bayes_factor(math.sqrt(term.f), term.df_error + 1.0)
    else:
        factor = approximate_null_bayes_factor(term)
    yield ResultRow(
        "", AnalysisName.BAYES, f"{term.name}, no effect over an effect", estimate=factor
    )


def _iterate_mean_rows(measure: Measure) -> RowIterator:
    """Yield the mean of each condition; of logarithms it is the geometric mean."""
    name = "error" if measure.name == BIAS else measure.name
    for condition, mean, error in measure.mixed.means:
        bounds = Bounded(mean, mean - Z975 * error, mean + Z975 * error)
        if measure.is_logarithmic:
            bounds = bounds.transform(math.exp)
        yield _make_estimate_row(
            AnalysisName.MIXED, f"mean {name} with {condition}", bounds, Unit.MICROMETRES
        )


def _iterate_deviation_rows(mixed: MixedFit, logarithmic: bool) -> RowIterator:
    """Yield the standard deviations of a mixed model."""
    unit = Unit.NONE if logarithmic else Unit.MICROMETRES
    deviations = {
        "participants": mixed.sd_participant,
        "participants by condition": mixed.sd_condition,
        "judgements": mixed.sd_residual,
    }
    for name, deviation in deviations.items():
        yield ResultRow(
            "",
            AnalysisName.MIXED,
            f"standard deviation between {name}",
            unit,
            estimate=deviation * unit.units_per_si_unit,
        )


def _iterate_log_error_rows(error: LogError) -> RowIterator:
    """Yield mean and root mean square of ln(estimate / height)."""
    where = f" with {error.condition}" if error.condition else ""
    name = "ln(estimate / height)"
    for quantity, bounds in (("mean", error.mean), ("root mean square", error.rms)):
        yield _make_estimate_row(
            AnalysisName.LOGARITHM,
            f"{quantity} of {name}{where}",
            bounds,
            df_error=float(error.people - 1),
        )


def _iterate_rating_test_rows(analysis: Analysis) -> RowIterator:
    """Yield, for each rating, its test over participants and the odds of its effects."""
    for name, fit in analysis.ordinal.items():
        test = fit.participants
        yield ResultRow(
            "",
            AnalysisName.ORDINAL,
            f"{name}, F over participants",
            statistic=test.statistic,
            df=test.df,
            df_error=test.df_error,
            p=test.p,
        )
        before = f"{name}: odds of a higher rating, "
        for effect in fit.effects:
            yield _make_ratio_row(AnalysisName.ORDINAL, before, effect)
            yield from _iterate_equivalence_rows(effect, True, quantity_prefix=before)


def _make_ratio_row(analysis: AnalysisName, quantity_prefix: str, interval: Interval) -> ResultRow:
    """Lay out a difference of logarithms as a ratio."""
    quantity = quantity_prefix + _format_difference_name(interval, logarithmic=True)
    return _make_estimate_row(analysis, quantity, interval.bounds.transform(math.exp), p=interval.p)


def _iterate_curve_rows_of_setting(setting: Comparisons) -> RowIterator:
    """Yield the psychometric functions of the group and of each participant in one setting."""
    where = f"{setting.setting}: " if setting.setting else ""
    yield from _iterate_population_rows(setting, where)
    for curve in setting.curves:
        yield from _iterate_curve_rows(curve, f"{where}participant {curve.who}")
    for member in setting.people:
        yield from _iterate_member_rows(
            member, f"{where}participant {member.participant}, in the group"
        )


def _iterate_population_rows(setting: Comparisons, quantity_prefix: str) -> RowIterator:
    """Yield the means over participants, if there are any."""
    equal, spread = setting.equal, setting.spread
    if equal is None or spread is None:
        return
    name = AnalysisName.CURVE
    heights = equal.bounds.transform(lambda log: setting.standard * math.exp(log))
    yield _make_estimate_row(
        name,
        f"{quantity_prefix}population, point of subjective equality",
        heights,
        Unit.MICROMETRES,
        p=equal.p,
    )
    fractions = spread.bounds.transform(compute_weber_fraction)
    yield _make_estimate_row(
        name, f"{quantity_prefix}population, Weber fraction of the height", fractions
    )
    for quantity, estimate in (("points of subjective equality", equal), ("spreads", spread)):
        yield ResultRow(
            "",
            name,
            f"{quantity_prefix}standard deviation of ln({quantity}) between participants",
            estimate=estimate.spread,
        )


def _iterate_curve_rows(curve: Curve, quantity_prefix: str) -> RowIterator:
    """Yield the psychometric function of a participant, or why there is none."""
    analysis = AnalysisName.CURVE
    fit = curve.fit
    if fit is None:
        yield ResultRow("", analysis, f"{quantity_prefix}: not fitted, {curve.reason}")
        return
    yield _make_estimate_row(
        analysis,
        f"{quantity_prefix}, point of subjective equality",
        fit.threshold,
        Unit.MICROMETRES,
    )
    yield _make_estimate_row(
        analysis, f"{quantity_prefix}, Weber fraction of the height", fit.weber
    )
    yield ResultRow("", analysis, f"{quantity_prefix}, lapse rate", estimate=fit.lapse)
    yield ResultRow("", analysis, f"{quantity_prefix}, deviance", statistic=fit.deviance, df=fit.df)
    yield ResultRow(
        "",
        analysis,
        f"{quantity_prefix}, dispersion of the answers",
        estimate=fit.dispersion,
        p=fit.p_fit,
    )


def _iterate_member_rows(member: GroupMember, quantity_prefix: str) -> RowIterator:
    """Yield the psychometric function of a participant as drawn towards the group."""
    unit = Unit.MICROMETRES
    yield ResultRow(
        "",
        AnalysisName.CURVE,
        f"{quantity_prefix}, point of subjective equality",
        unit,
        estimate=member.equality * unit.units_per_si_unit,
    )
    yield ResultRow(
        "",
        AnalysisName.CURVE,
        f"{quantity_prefix}, Weber fraction of the height",
        estimate=member.weber,
    )


def _iterate_contrast_rows(analysis: Analysis) -> RowIterator:
    """Yield the differences of comparisons between settings."""
    for quantity, family in analysis.contrasts.items():
        before = f"{quantity}, "
        for interval in family:
            yield _make_ratio_row(AnalysisName.CONTRAST, before, interval)
            yield from _iterate_equivalence_rows(interval, True, quantity_prefix=before)


def _iterate_power_law_rows(law: PowerLaw, names_condition: bool) -> RowIterator:
    """Yield the exponents of one condition, which is named where there are several."""
    where = f"{law.condition}: " if names_condition else ""
    analysis = AnalysisName.POWER_LAW
    yield _make_estimate_row(
        analysis, f"{where}exponent of the height, mean of participants", law.bounds
    )
    for person, exponent, correlation in law.by_participant:
        name = f"{where}participant {person}"
        yield ResultRow("", analysis, f"{name}, exponent", estimate=exponent)
        yield ResultRow(
            "", analysis, f"{name}, correlation of the logarithms", estimate=correlation
        )


def _make_row_without_participant(influence: Influence) -> ResultRow:
    """Lay out a difference without one participant."""
    interval = influence.interval
    logarithmic = _is_logarithmic(influence.test)
    measure, before = "", ""
    bounds, unit = interval.bounds, Unit.NONE
    if isinstance(influence.test, MeasureTest):
        measure, unit = influence.test.name, Unit.MICROMETRES
    elif isinstance(influence.test, RatingTest):
        before = f"{influence.test.name}: odds of a higher rating, "
    else:
        before = f"{influence.test.quantity}, "
    if logarithmic:
        bounds, unit = bounds.transform(math.exp), Unit.NONE
    difference = _format_difference_name(interval, logarithmic)
    row = _make_estimate_row(
        AnalysisName.INFLUENCE,
        f"{before}{difference}, without {influence.participant}",
        bounds,
        unit,
        p=interval.p,
    )
    return replace(row, measure=measure)


def _is_logarithmic(test: PlannedTest) -> bool:
    """Return whether the differences of a test are logarithms of ratios."""
    if isinstance(test, MeasureTest):
        return test.measure.is_logarithmic
    if isinstance(test, RatingTest):
        return True
    return test.is_logarithmic
