"""What the judgements say, and the same as one flat table with units."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stepblocks.study.analysis.accuracy import ANSWER, Measure
from stepblocks.study.analysis.anova import Interval, Term
from stepblocks.study.analysis.ordinal import OrdinalFit
from stepblocks.study.analysis.psychometric import Z975, Psychometric
from stepblocks.tables import format_csv

if TYPE_CHECKING:
    import pandas as pd

# Columns of results.csv; the unit of estimate, low and high stands in each row
FIGURES = ("estimate", "low_95", "high_95", "statistic", "df", "df_error", "p")
COLUMNS = ("measure", "analysis", "quantity", "unit", *FIGURES)
_IN_UM = (
    "height",
    "estimate",
    "error",
    "standard",
)  # columns of the judgements that are lengths [m]

Row = dict[str, Any]
Ends = tuple[float, ...]  # estimate, low, high


@dataclass(frozen=True)
class Curve:
    """Psychometric function of one participant, or of all together."""

    who: str  # participant, or ``"all"``
    levels: tuple[float, ...]  # heights compared with the standard [m]
    hits: tuple[int, ...]  # answers "higher" per height
    totals: tuple[int, ...]  # trials per height
    fit: Psychometric | None  # None where nothing can be told
    reason: str  # why not; empty with a fit


@dataclass(frozen=True)
class PowerLaw:
    """How the felt magnitude grows with the stimulus."""

    exponent: float  # mean over participants [1]
    low: float  # ends of its 95 % interval by Student's t [1]
    high: float
    by_participant: tuple[
        tuple[str, float, float], ...
    ]  # participant, exponent, correlation of the logarithms


@dataclass(frozen=True)
class StudyResult:
    """What the judgements say; what an experiment does not have is None or empty."""

    experiment: str
    notes: tuple[str, ...]  # how many judgements, what is missing and what was done about it
    frame: Any  # the tidy table
    measures: tuple[Measure, ...] = ()  # of the accuracy of estimates: bias, absolute error, spread
    remarks: tuple[str, ...] = ()  # on what could not be analysed
    ordinal: OrdinalFit | None = None  # of the ratings of realism
    curves: tuple[Curve, ...] = ()  # of the comparisons with a standard
    power_law: PowerLaw | None = None  # of the magnitudes

    def measure(self, name: str = ANSWER) -> Measure | None:
        """Return one measure of accuracy, if it was analysed."""
        return next((one for one in self.measures if one.name == name), None)

    def table(self) -> pd.DataFrame:
        """Lay out every figure with its unit, in `COLUMNS`; not-a-number where a row has none."""
        import pandas as pd

        accuracy = [row | {"measure": one.name} for one in self.measures for row in _measure(one)]
        return pd.DataFrame(
            [*accuracy, *_ratings(self), *_curves(self), *_magnitudes(self)], columns=COLUMNS
        )

    def results_csv(self) -> str:
        """Write the table."""
        return format_csv(self.table(), float_format="%.8g")

    def judgements_csv(self) -> str:
        """Write the judgements as they were analysed, lengths in micrometres."""
        frame = self.frame.copy()
        for name in frame.columns.intersection(_IN_UM):
            frame[name] = [f"{value * 1e6:.9g}" for value in frame[name]]
        return format_csv(frame.rename(columns={name: f"{name}_um" for name in _IN_UM}))

    def _repr_html_(self) -> str:
        said = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return said + str(
            self.table().to_html(index=False, na_rep="", float_format="{:.4g}".format)
        )


def _row(analysis: str, quantity: str, unit: str = "1", **figures: float) -> Row:
    return {"measure": "", "analysis": analysis, "quantity": quantity, "unit": unit, **figures}


def _span(analysis: str, quantity: str, ends: Ends, unit: str = "1", **more: float) -> Row:
    """Lay out an estimate with its interval; what is in metres is shown in micrometres."""
    middle, low, high = (value * 1e6 for value in ends) if unit == "um" else ends
    return _row(analysis, quantity, unit, estimate=middle, low_95=low, high_95=high, **more)


def _term(analysis: str, term: Term) -> Row:
    ends, name = (
        (term.eta_squared, term.eta_low, term.eta_high),
        f"{term.name}, partial eta squared",
    )
    return _span(
        analysis, name, ends, statistic=term.f, df=term.df, df_error=term.df_error, p=term.p
    )


def _intervals(
    analysis: str, intervals: tuple[Interval, ...], df_error: float, logarithmic: bool
) -> Iterator[Row]:
    for one in intervals:
        name, ends = f"{one.first} minus {one.second}", (one.difference, one.low, one.high)
        ratio = (f"{one.first} over {one.second}", tuple(map(math.exp, ends)), "1")
        yield _span(
            analysis, *(ratio if logarithmic else (name, ends, "um")), df_error=df_error, p=one.p
        )
        yield _row(
            analysis, f"{name}, over the residual standard deviation", estimate=one.effect_size
        )


def _measure(measure: Measure) -> Iterator[Row]:
    mixed, log = measure.mixed, measure.logarithmic
    for term in measure.f_test.terms:
        yield _term("f-test", term)
    yield from _intervals("tukey", measure.f_test.intervals, measure.f_test.df_error, log)
    if mixed.condition is not None:
        yield _term("mixed model", mixed.condition)
        yield from _intervals("mixed model", mixed.intervals, mixed.condition.df_error, log)
    for name, mean, error in mixed.means:
        ends = (mean, mean - Z975 * error, mean + Z975 * error)
        said = f"mean {'error' if measure.name == 'bias' else measure.name} with {name}"
        yield _span("mixed model", said, tuple(map(math.exp, ends)) if log else ends, "um")
    unit, factor = ("1", 1.0) if log else ("um", 1e6)
    for name, spread in (
        ("participants", mixed.sd_participant),
        ("participants by condition", mixed.sd_condition),
        ("judgements", mixed.sd_residual),
    ):
        yield _row(
            "mixed model", f"standard deviation between {name}", unit, estimate=spread * factor
        )
    for one in measure.equivalence:
        name, bound = (
            f"{one.first} and {one.second}",
            math.exp(one.bound) if log else one.bound * 1e6,
        )
        said = f"{name} differ by less than{' a factor of' if log else ''}"
        yield _row("equivalence", said, unit, high_95=bound, df_error=one.df)
        if math.isfinite(one.margin):
            said = f"{name} differ by less than the margin"
            tested = {"statistic": one.statistic, "df_error": one.df, "p": one.p}
            yield _row("equivalence", said, unit, estimate=one.margin * 1e6, **tested)
    for term in measure.groups:
        yield _term("groups", term)
    df_error = measure.groups[0].df_error if measure.groups else math.nan
    yield from _intervals("groups", measure.group_intervals, df_error, log)
    for check in measure.checks:
        name = (
            f"{check.assumption} ({check.test}): "
            f"{'; '.join(filter(None, (check.verdict, check.advice)))}"
        )
        yield _row("check", name, statistic=check.statistic, p=check.p)


def _ratings(result: StudyResult) -> Iterator[Row]:
    fit, analysis = result.ordinal, "ordinal model"
    if fit is None:
        return
    yield _row(analysis, "all predictors, F over participants") | fit.participants
    for effect in fit.effects:
        yield _span(
            analysis,
            f"odds of a higher rating, {effect.name}",
            (effect.ratio, effect.low, effect.high),
        )


def _curves(result: StudyResult) -> Iterator[Row]:
    for curve in result.curves:
        analysis, name, fit = "psychometric function", f"participant {curve.who}", curve.fit
        if fit is None:
            yield _row(analysis, f"{name}: not fitted, {curve.reason}")
            continue
        equal = (fit.threshold, fit.threshold_low, fit.threshold_high)
        weber = (fit.weber, fit.weber_low, fit.weber_high)
        yield _span(analysis, f"{name}, point of subjective equality", equal, "um")
        yield _span(analysis, f"{name}, Weber fraction of the height", weber)
        yield _row(analysis, f"{name}, lapse rate", estimate=fit.lapse)
        yield _row(analysis, f"{name}, deviance", statistic=fit.deviance, df=fit.df)


def _magnitudes(result: StudyResult) -> Iterator[Row]:
    law = result.power_law
    if law is None:
        return
    yield _span(
        "power law",
        "exponent of the height, mean of participants",
        (law.exponent, law.low, law.high),
    )
    for person, exponent, correlation in law.by_participant:
        yield _row("power law", f"participant {person}, exponent", estimate=exponent)
        yield _row(
            "power law",
            f"participant {person}, correlation of the logarithms",
            estimate=correlation,
        )
