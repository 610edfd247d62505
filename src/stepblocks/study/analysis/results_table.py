"""What an analysis says as one flat table with units."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator

from stepblocks.study.analysis.analysis import StudyResult
from stepblocks.study.analysis.anova import Interval

# Columns of results.csv; the unit of estimate, low and high stands in each row
COLUMNS = ("analysis", "quantity", "unit", "estimate", "low_95", "high_95", "statistic", "df", "df_error", "p")

Row = dict[str, str]


def results_csv(result: StudyResult) -> str:
    """Write the results as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(results_rows(result))
    return text.getvalue()


def results_rows(result: StudyResult) -> list[Row]:
    """Lay the results out in rows."""
    return [*_estimates(result), *_ratings(result), *_curves(result), *_magnitudes(result)]


def _row(analysis: str, quantity: str, unit: str, **figures: float) -> Row:
    row = dict.fromkeys(COLUMNS, "") | {"analysis": analysis, "quantity": quantity, "unit": unit}
    return row | {name: f"{value:.8g}" for name, value in figures.items() if not math.isnan(value)}


def _estimates(result: StudyResult) -> Iterator[Row]:
    if result.f_test is None or result.mixed is None:
        return
    for term in result.f_test.terms:
        yield _row(
            "f-test",
            f"{term.name}, partial eta squared",
            "1",
            estimate=term.eta_squared,
            low_95=term.eta_low,
            high_95=term.eta_high,
            statistic=term.f,
            df=term.df,
            df_error=term.df_error,
            p=term.p,
        )
    yield from _intervals("tukey", result.f_test.intervals, result.f_test.df_error)
    mixed = result.mixed
    if mixed.condition is not None:
        term = mixed.condition
        yield _row(
            "mixed model",
            f"{term.name}, partial eta squared",
            "1",
            estimate=term.eta_squared,
            low_95=term.eta_low,
            high_95=term.eta_high,
            statistic=term.f,
            df=term.df,
            df_error=term.df_error,
            p=term.p,
        )
        yield from _intervals("mixed model", mixed.intervals, term.df_error)
    for name, mean, error in mixed.means:
        reach = 1.959963984540054 * error
        yield _row(
            "mixed model",
            f"mean error with {name}",
            "um",
            estimate=mean * 1e6,
            low_95=(mean - reach) * 1e6,
            high_95=(mean + reach) * 1e6,
        )
    spreads = (
        ("participants", mixed.sd_participant),
        ("participants by condition", mixed.sd_condition),
        ("judgements", mixed.sd_residual),
    )
    for name, spread in spreads:
        yield _row("mixed model", f"standard deviation between {name}", "um", estimate=spread * 1e6)
    for check in result.checks:
        yield _row(
            "check", f"{check.assumption} ({check.test}): {check.verdict}", "1", statistic=check.statistic, p=check.p
        )


def _intervals(analysis: str, intervals: tuple[Interval, ...], df_error: float) -> Iterator[Row]:
    for one in intervals:
        name = f"{one.first} minus {one.second}"
        yield _row(
            analysis,
            name,
            "um",
            estimate=one.difference * 1e6,
            low_95=one.low * 1e6,
            high_95=one.high * 1e6,
            df_error=df_error,
            p=one.p,
        )
        yield _row(analysis, f"{name}, over the residual standard deviation", "1", estimate=one.effect_size)


def _ratings(result: StudyResult) -> Iterator[Row]:
    if result.ordinal is None:
        return
    yield _row(
        "ordinal model",
        "all predictors, likelihood ratio",
        "1",
        statistic=result.ordinal.statistic,
        df=result.ordinal.df,
        p=result.ordinal.p,
    )
    wald = result.ordinal.participants
    if wald is not None:
        yield _row(
            "ordinal model",
            "all predictors, F over participants",
            "1",
            statistic=wald.statistic,
            df=wald.df,
            df_error=wald.df_error,
            p=wald.p,
        )
    for effect in result.ordinal.effects:
        yield _row(
            "ordinal model",
            f"odds of a higher rating, {effect.name}",
            "1",
            estimate=effect.ratio,
            low_95=effect.low,
            high_95=effect.high,
        )
        for cut, value in enumerate(effect.by_cut, start=1):
            yield _row("check", f"log odds at cut {cut} alone, {effect.name}", "1", estimate=value)


def _curves(result: StudyResult) -> Iterator[Row]:
    for curve in result.curves:
        fit = curve.fit
        if fit is None:
            yield _row("psychometric function", f"participant {curve.who}: not fitted, {curve.reason}", "1")
            continue
        name = f"participant {curve.who}"
        yield _row(
            "psychometric function",
            f"{name}, point of subjective equality",
            "um",
            estimate=fit.threshold * 1e6,
            low_95=fit.threshold_low * 1e6,
            high_95=fit.threshold_high * 1e6,
        )
        yield _row(
            "psychometric function",
            f"{name}, Weber fraction of the height",
            "1",
            estimate=fit.weber,
            low_95=fit.weber_low,
            high_95=fit.weber_high,
        )
        yield _row("psychometric function", f"{name}, lapse rate", "1", estimate=fit.lapse)
        yield _row("psychometric function", f"{name}, deviance", "1", statistic=fit.deviance, df=fit.df)


def _magnitudes(result: StudyResult) -> Iterator[Row]:
    law = result.power_law
    if law is None:
        return
    yield _row(
        "power law",
        "exponent of the height, mean of participants",
        "1",
        estimate=law.exponent,
        low_95=law.low,
        high_95=law.high,
    )
    for person, exponent, correlation in law.by_participant:
        yield _row("power law", f"participant {person}, exponent", "1", estimate=exponent)
        yield _row("power law", f"participant {person}, correlation of the logarithms", "1", estimate=correlation)


_UNITS = {
    "height": ("height_um", 1e6),
    "estimate": ("estimate_um", 1e6),
    "error": ("error_um", 1e6),
    "standard": ("standard_um", 1e6),
}


def judgements_csv(result: StudyResult) -> str:
    """Write the judgements as they were analysed."""
    frame = result.frame.copy()
    for name, (_, factor) in _UNITS.items():
        if name in frame:
            frame[name] = [f"{value * factor:.9g}" for value in frame[name]]
    named = frame.rename(columns={name: shown for name, (shown, _) in _UNITS.items()})
    return str(named.to_csv(index=False, lineterminator="\n"))
