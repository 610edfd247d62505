"""What the judgements say, and the same as one flat table with units."""

import html
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property

import pandas as pd

from stepblocks.errors import StudyError
from stepblocks.files.figures import Axes
from stepblocks.files.tables import format_csv
from stepblocks.lawsearch.law import correct_by_holm
from stepblocks.study import Table
from stepblocks.study.analysis.accuracy import ANSWER, Measure, assess_equivalence
from stepblocks.study.analysis.anova import Interval, Term
from stepblocks.study.analysis.ordinal import OrdinalFit, fit_ordinal_model
from stepblocks.study.analysis.population import (
    Comparisons,
    Curve,
    compare_settings,
    leave_out,
)
from stepblocks.study.analysis.psychometric import Z975, compute_weber
from stepblocks.study.analysis.repeated import (
    approximate_bayes_factor,
    average_participants,
    compare_participants,
    compute_bayes_factor,
)

# Columns of results.csv; the unit of estimate, low and high stands in each row
_CURVE = "psychometric function"
# what an effect size is over, but for residuals
_SCALES = {"participants' differences": "standard deviation of the differences"}
FIGURES = ("estimate", "low_95", "high_95", "statistic", "df", "df_error", "p")
COLUMNS = ("measure", "analysis", "quantity", "unit", *FIGURES)
# columns of the judgements that are lengths [m]
_IN_UM = (
    "height",
    "estimate",
    "error",
    "standard",
)

EXPONENT = "exponent"  # of magnitudes; all other quantities of contrasts are logarithms

Row = Mapping[str, str | float]
Ends = tuple[float, ...]  # estimate, low, high


@dataclass(frozen=True)
class PowerLaw:
    """How the perceived magnitude grows with the stimulus.

    Attributes
    ----------
    exponent, low, high : float
        Mean over participants, with its 95 % interval by Student's t [1].
    by_participant : tuple of (str, float, float)
        Participant, exponent, correlation of the logarithms.
    condition : str
        In which it was measured.
    """

    exponent: float
    low: float
    high: float
    by_participant: tuple[tuple[str, float, float], ...]
    condition: str = ""


@dataclass(frozen=True)
class Finding:
    """One planned test.

    Attributes
    ----------
    name : str
        The measure that is tested.
    p, corrected : float
        Probability under no effect, and after Holm's correction over all but the primary outcome.
    primary : bool
        Whether it is the outcome that the design names.
    """

    name: str
    p: float
    corrected: float
    primary: bool


@dataclass(frozen=True)
class StudyResult:
    """What the judgements say; what an experiment does not have is None or empty.

    Attributes
    ----------
    experiment : str
        One of `stepblocks.study.design.experiments.EXPERIMENTS`.
    notes, remarks : tuple of str
        On missing judgements and on participants who differ; on what could not be analysed.
    frame : DataFrame
        Judgements, one a row.
    measures : tuple of Measure
        Bias, absolute error and spread of estimates.
    ordinal : mapping of OrdinalFit
        By outcome: ratings of realism over all conditions, and by each of several factors.
    comparisons : tuple of Comparisons
        Psychometric functions by setting.
    contrasts : dict of tuple of Interval
        By quantity, differences of its logarithm between settings.
    power_laws : tuple of PowerLaw
        Of the magnitudes, by condition.
    exponents : tuple of Interval
        Differences of exponents between conditions.
    primary, reference : str
        Outcome that the design names, and the condition that others are compared with.
    """

    experiment: str
    notes: tuple[str, ...]
    frame: Table
    measures: tuple[Measure, ...] = ()
    remarks: tuple[str, ...] = ()
    ordinal: Mapping[str, OrdinalFit] = field(default_factory=dict)
    comparisons: tuple[Comparisons, ...] = ()
    contrasts: Mapping[str, tuple[Interval, ...]] = field(default_factory=dict)
    power_laws: tuple[PowerLaw, ...] = ()
    exponents: tuple[Interval, ...] = ()
    primary: str = ""
    reference: str = ""

    def measure(self, name: str = ANSWER) -> Measure | None:
        """Return one measure of accuracy, if it was analysed."""
        return next((one for one in self.measures if one.name == name), None)

    def differences(self) -> dict[str, Interval]:
        """Return the planned tests of two settings by their names."""
        return {
            name_contrast(quantity, one.first, one.second): one
            for quantity, family in {**self.contrasts, EXPONENT: self.exponents}.items()
            for one in family
        }

    def findings(self) -> tuple[Finding, ...]:
        """Return the planned tests, the primary one first."""
        tests = {
            **{one.name: one.corrected.p for one in self.measures if one.corrected},
            **{name: fit.participants["p"] for name, fit in self.ordinal.items()},
            **{name: one.p for name, one in self.differences().items()},
        }
        first = next((name for name in (self.primary, ANSWER, *tests) if name in tests), "")
        rest = {name: p for name, p in tests.items() if name != first and math.isfinite(p)}
        holm = correct_by_holm(list(rest.values())).tolist()
        found = [Finding(first, tests[first], tests[first], True)] if first else []
        others = zip(rest.items(), holm, strict=True)
        return (*found, *(Finding(name, p, adjusted, False) for (name, p), adjusted in others))

    def table(self) -> pd.DataFrame:
        """Lay out every figure with its unit, in `COLUMNS`; not-a-number where a row has none."""
        return pd.DataFrame(self._rows, columns=COLUMNS)

    @cached_property
    def _rows(self) -> list[Row]:
        # fits of all but one participant are among them: they are made once
        accuracy = [
            {**row, "measure": one.name} for one in self.measures for row in _list_measure(one)
        ]
        tests = [
            _make_row(
                "primary outcome" if one.primary else "secondary outcome, Holm",
                one.name,
                p=one.corrected,
            )
            for one in self.findings()
        ]
        parts = (_list_ratings, _list_comparisons, _list_magnitudes, _list_influence)
        return [*tests, *accuracy, *(row for list_rows in parts for row in list_rows(self))]

    def results_csv(self) -> str:
        """Write the table."""
        return format_csv(self.table(), float_format="%.8g")

    def judgements_csv(self) -> str:
        """Write the judgements as they were analysed, lengths in micrometres."""
        lengths = self.frame[[*self.frame.columns.intersection(_IN_UM)]].map(
            lambda value: f"{value * 1e6:.9g}"
        )
        return format_csv(
            self.frame.assign(**lengths).rename(columns={name: f"{name}_um" for name in _IN_UM})
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the main figure of the study.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; by default a new figure.

        Returns
        -------
        matplotlib Axes
            That were drawn on.
        """
        from stepblocks.study.analysis.figures import draw_main_figure

        return draw_main_figure(self, ax)

    def __repr__(self) -> str:
        first = self.findings()[:1]
        outcome = f", {first[0].name}: p = {first[0].p:.3g}" if first else ""
        return (
            f"<StudyResult {self.experiment}: {self.frame['participant'].nunique()} participants, "
            f"{len(self.frame)} judgements{outcome}>"
        )

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(note)}</p>" for note in self.notes) + str(
            self.table().to_html(index=False, na_rep="", float_format="{:.4g}".format)
        )


def name_contrast(quantity: str, first: str, second: str) -> str:
    """Name the planned test of a quantity between two settings."""
    return f"{quantity}, {first} {'minus' if quantity == EXPONENT else 'over'} {second}"


def _make_row(analysis: str, quantity: str, unit: str = "1", **figures: float) -> Row:
    return {"measure": "", "analysis": analysis, "quantity": quantity, "unit": unit, **figures}


def _make_interval_row(
    analysis: str, quantity: str, ends: Ends, unit: str = "1", **more: float
) -> Row:
    # Lay out an estimate with its interval; what is in metres is shown in micrometres
    middle, low, high = (value * 1e6 for value in ends) if unit == "um" else ends
    return _make_row(analysis, quantity, unit, estimate=middle, low_95=low, high_95=high, **more)


def _format_term(analysis: str, term: Term) -> Row:
    return _make_interval_row(
        analysis,
        f"{term.name}, partial eta squared",
        (term.eta_squared, term.eta_low, term.eta_high),
        statistic=term.f,
        df=term.df,
        df_error=term.df_error,
        p=term.p,
    )


def _format_interval(
    analysis: str,
    one: Interval,
    logarithmic: bool,
    unit: str = "um",
    names: tuple[str, str] = ("", ""),
    **more: float,
) -> Row:
    # Lay out a difference, named before and after; of logarithms it is a ratio
    ends: Ends = (one.difference, one.low, one.high)
    if logarithmic:
        ends = tuple(map(math.exp, ends))
        unit = "1"
    pair = f"{one.first} {'over' if logarithmic else 'minus'} {one.second}"
    return _make_interval_row(analysis, names[0] + pair + names[1], ends, unit, p=one.p, **more)


def _list_intervals(
    analysis: str, intervals: tuple[Interval, ...], logarithmic: bool
) -> Iterator[Row]:
    for one in intervals:
        yield _format_interval(analysis, one, logarithmic, df_error=one.df)
        yield _make_row(
            analysis,
            f"{one.first} minus {one.second}, over the "
            f"{_SCALES.get(analysis, 'residual standard deviation')}",
            estimate=one.effect_size,
        )


def _list_measure(measure: Measure) -> Iterator[Row]:
    mixed, log = measure.mixed, measure.logarithmic
    for term in measure.f_test.terms:
        yield _format_term("f-test", term)
    yield from _list_intervals("tukey", measure.f_test.intervals, log)
    if mixed.condition is not None:
        yield _format_term("mixed model", mixed.condition)
        yield from _list_intervals("mixed model", mixed.intervals, log)
    if measure.corrected is not None and measure.sphericity is not None:
        yield _format_term("mixed model, Huynh and Feldt", measure.corrected)
        for name, epsilon in (
            ("Greenhouse and Geisser", measure.sphericity.epsilon),
            ("Huynh and Feldt", measure.sphericity.huynh_feldt),
        ):
            yield _make_row("sphericity", f"epsilon of {name}", estimate=epsilon)
        yield _make_row(
            "sphericity",
            "W of Mauchly",
            statistic=measure.sphericity.statistic,
            p=measure.sphericity.p,
        )
    yield from _list_intervals("participants' differences", measure.paired, log)
    for one in measure.paired:
        yield _make_row(
            "Bayes factor",
            f"{one.first} and {one.second}, no difference over a difference",
            estimate=compute_bayes_factor(one.difference / one.error, one.df + 1.0),
        )
    for term in measure.factors:
        yield _format_term("declared factors", term)
        factor = (  # of two levels, F is the square of Student's t
            compute_bayes_factor(math.sqrt(term.f), term.df_error + 1.0)
            if math.isclose(term.df, 1.0)
            else approximate_bayes_factor(term)
        )
        yield _make_row("Bayes factor", f"{term.name}, no effect over an effect", estimate=factor)
    for name, mean, error in mixed.means:
        ends = (mean, mean - Z975 * error, mean + Z975 * error)
        yield _make_interval_row(
            "mixed model",
            f"mean {'error' if measure.name == 'bias' else measure.name} with {name}",
            tuple(map(math.exp, ends)) if log else ends,
            "um",
        )
    unit, factor = ("1", 1.0) if log else ("um", 1e6)
    for name, spread in (
        ("participants", mixed.sd_participant),
        ("participants by condition", mixed.sd_condition),
        ("judgements", mixed.sd_residual),
    ):
        yield _make_row(
            "mixed model", f"standard deviation between {name}", unit, estimate=spread * factor
        )
    for one in (*mixed.intervals, *measure.group_intervals):
        yield from _list_equivalence(one, log, "um", margin=measure.margin)
    for term in measure.groups:
        yield _format_term("groups", term)
    yield from _list_intervals("groups", measure.group_intervals, log)


def _list_equivalence(
    one: Interval,
    logarithmic: bool,
    unit: str = "1",
    before: str = "",
    margin: float = math.nan,
) -> Iterator[Row]:
    # Say by how little two settings differ; logarithms as a ratio
    bound, statistic, p = assess_equivalence(one, margin)
    label = f"{before}{one.first} and {one.second} differ by less than"
    if logarithmic:
        label = f"{label} a factor of"
        unit = "1"
        bound = math.exp(bound)
    yield _make_interval_row(
        "equivalence", label, (math.nan, math.nan, bound), unit, df_error=one.df
    )
    if math.isfinite(margin):
        yield _make_interval_row(
            "equivalence",
            f"{label} the margin",
            (margin, math.nan, math.nan),
            unit,
            statistic=statistic,
            df_error=one.df,
            p=p,
        )


def _list_ratings(result: StudyResult) -> Iterator[Row]:
    for name, fit in result.ordinal.items():
        yield {**_make_row("ordinal model", f"{name}, F over participants"), **fit.participants}
        before = f"{name}: odds of a higher rating, "
        for one in fit.effects:
            yield _format_interval("ordinal model", one, True, names=(before, ""))
            yield from _list_equivalence(one, True, before=before)


def _list_comparisons(result: StudyResult) -> Iterator[Row]:
    for found in result.comparisons:
        where = f"{found.setting}: " if found.setting else ""
        if found.equal and found.spread:
            equal, wide = found.equal, found.spread
            heights = tuple(
                found.standard * math.exp(v) for v in (equal.value, equal.low, equal.high)
            )
            fractions = tuple(compute_weber(v) for v in (wide.value, wide.low, wide.high))
            name = f"{where}population"
            yield _make_interval_row(
                _CURVE, f"{name}, point of subjective equality", heights, "um", p=equal.p
            )
            yield _make_interval_row(_CURVE, f"{name}, Weber fraction of the height", fractions)
            for name, one in (("points of subjective equality", equal), ("spreads", wide)):
                yield _make_row(
                    _CURVE,
                    f"{where}standard deviation of ln({name}) between participants",
                    estimate=one.spread,
                )
        for curve in found.curves:
            yield from _list_curve(curve, f"{where}participant {curve.who}")
        for who, equal_at, weber in found.people:
            name = f"{where}participant {who}, in the group"
            yield _make_row(
                _CURVE, f"{name}, point of subjective equality", "um", estimate=equal_at * 1e6
            )
            yield _make_row(_CURVE, f"{name}, Weber fraction of the height", estimate=weber)
    for quantity, family in result.contrasts.items():
        for gap in family:
            names = (f"{quantity}, ", "")
            yield _format_interval("contrast of settings", gap, logarithmic=True, names=names)
            yield from _list_equivalence(gap, logarithmic=True, before=names[0])


def _list_curve(curve: Curve, name: str) -> Iterator[Row]:
    if (fit := curve.fit) is None:
        yield _make_row(_CURVE, f"{name}: not fitted, {curve.reason}")
        return
    yield _make_interval_row(_CURVE, f"{name}, point of subjective equality", fit.threshold, "um")
    yield _make_interval_row(_CURVE, f"{name}, Weber fraction of the height", fit.weber)
    yield _make_row(_CURVE, f"{name}, lapse rate", estimate=fit.lapse)
    yield _make_row(_CURVE, f"{name}, deviance", statistic=fit.deviance, df=fit.df)
    yield _make_row(
        _CURVE, f"{name}, dispersion of the answers", estimate=fit.dispersion, p=fit.p_fit
    )


def _list_magnitudes(result: StudyResult) -> Iterator[Row]:
    for law in result.power_laws:
        where = f"{law.condition}: " if len(result.power_laws) > 1 else ""
        yield _make_interval_row(
            "power law",
            f"{where}exponent of the height, mean of participants",
            (law.exponent, law.low, law.high),
        )
        for person, exponent, correlation in law.by_participant:
            name = f"{where}participant {person}"
            yield _make_row("power law", f"{name}, exponent", estimate=exponent)
            yield _make_row(
                "power law", f"{name}, correlation of the logarithms", estimate=correlation
            )
    for one in result.exponents:
        yield _format_interval("power law", one, False, "1", ("exponent, ", ""), df_error=one.df)
        yield from _list_equivalence(one, False, before="exponent, ")


def _list_influence(result: StudyResult) -> Iterator[Row]:
    # Say what each difference is without each participant
    people = sorted(result.frame["participant"].unique())
    names = [one.name for one in result.findings()]
    leave = cache(leave_out)  # one fit of the others serves every pair of settings
    for name, who in itertools.product(names, people if len(people) > 2 else ()):
        measure = result.measure(name)
        log, unit = (measure.logarithmic, "um") if measure else (not result.power_laws, "1")
        before = "" if measure else f"{name.partition(',')[0]}, "
        if name in result.ordinal:
            before = f"{name}: odds of a higher rating, "
        with suppress(StudyError):  # the others may not carry the analysis
            for one in _compare_without(result, name, who, leave):
                yield {
                    **_format_interval(
                        "leaving each participant out", one, log, unit, (before, f", without {who}")
                    ),
                    "measure": measure.name if measure else "",
                }


def _compare_without(
    result: StudyResult, name: str, who: str, leave: Callable[[Comparisons, str], Comparisons]
) -> Sequence[Interval]:
    # Return the differences of an outcome by all other participants
    if name in result.ordinal:
        return fit_ordinal_model(
            result.frame[result.frame["participant"] != who], *result.ordinal[name].asked
        ).effects
    if found := result.differences().get(name) if result.contrasts else None:
        pair = [
            leave(one, who)
            for one in result.comparisons
            if one.setting in (found.first, found.second)
        ]
        return (compare_settings(name.partition(",")[0], *pair),)
    laws = {
        one.condition: {who: e for who, e, _ in one.by_participant} for one in result.power_laws
    }
    measure = result.measure(name)
    table = average_participants(measure.frame) if measure else pd.DataFrame(laws)
    return [
        one
        for one in compare_participants(table.drop(who, errors="ignore"))
        if measure or name == name_contrast(EXPONENT, one.first, one.second)
    ]
