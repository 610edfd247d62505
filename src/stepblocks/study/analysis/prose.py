"""The headline of a report: its findings in sentences."""

import math
from collections.abc import Iterable, Iterator, Sequence

from stepblocks.quantities import format_units
from stepblocks.study.analysis.accuracy import Measure, assess_equivalence
from stepblocks.study.analysis.anova import Interval, Term
from stepblocks.study.analysis.bounded import Bounded
from stepblocks.study.analysis.comparisons import Comparisons
from stepblocks.study.analysis.findings import (
    ContrastTest,
    Finding,
    MeasureTest,
    RatingTest,
)
from stepblocks.study.analysis.magnitudes import PowerLaw
from stepblocks.study.analysis.psychometric import compute_weber_fraction
from stepblocks.study.analysis.repeated import compute_null_bayes_factor
from stepblocks.study.analysis.results import StudyResult

_LEVEL = 0.05
_LARGEST_LOG_ODDS = 700.0  # of which the exponential is still finite


def format_headline(result: StudyResult) -> str:
    """Write the primary outcome in a sentence; secondary ones only where it shows a difference."""
    # Only the primary test may claim a difference first, so that the level of the headline is 5 %.
    sentences = [*_describe_comparisons_and_magnitudes(result)]
    for finding in result.findings():
        if finding.primary:
            text = _describe_finding(finding, result.reference)
            sentences.append(f"primary outcome, {finding.name}: {text}")
            sentences += _describe_factors(finding)
            if not finding.p < _LEVEL:
                break
        elif finding.corrected < _LEVEL:
            text = _describe_finding(finding, result.reference)
            sentences.append(f"secondary, corrected for their number, {finding.name}: {text}")
    begun = [f"{text[0].upper()}{text[1:]}." for text in sentences]
    return format_units(" ".join(begun))


def _describe_finding(finding: Finding, reference: str) -> str:
    """Describe what one planned test found, against a reference condition if there is one."""
    if isinstance(finding.test, MeasureTest):
        return _describe_measure(finding.test.measure, finding, reference)
    if isinstance(finding.test, RatingTest):
        return _describe_ratings(finding.test, finding, reference)
    return _describe_contrast(finding.test, finding)


def _describe_factors(finding: Finding) -> Iterator[str]:
    """Describe the tests of several crossed factors, each beside the others."""
    if not isinstance(finding.test, MeasureTest):
        return
    tests = [f"{term.name}, {format_f_test(term)}" for term in finding.test.measure.factors]
    if tests:
        yield f"of its factors: {'; '.join(tests)}"


def _describe_contrast(test: ContrastTest, finding: Finding) -> str:
    """Describe how a quantity differs between two settings."""
    p = _format_finding_p(finding)
    bounds, times = test.interval.bounds, ""
    if test.is_logarithmic:
        bounds, times = bounds.transform(math.exp), " times"
    return f"{bounds.value:.3g}{times} (95 % {bounds.low:.3g} to {bounds.high:.3g}, {p})"


def _describe_ratings(test: RatingTest, finding: Finding, reference: str) -> str:
    """Describe which conditions raise ratings, and by what odds."""
    effects = test.fit.effects
    ratios = []
    for effect in effects:
        significant = len(effects) == 1 or effect.p < _LEVEL
        if significant and _is_against_reference(effect, reference):
            ratios.append(_describe_odds(effect))
    text = "; ".join(ratios) or "no pair differs"
    return f"odds ratios of a higher rating of realism: {text} ({_format_finding_p(finding)})"


def _describe_odds(effect: Interval) -> str:
    """Describe by what odds one condition is rated higher than another."""
    ratio = math.exp(effect.difference)
    low = math.exp(effect.low)
    high = math.exp(min(effect.high, _LARGEST_LOG_ODDS))
    names = f"{effect.first} over {effect.second}"
    return f"{ratio:.2g} (95 % {low:.2g} to {high:.2g}) with {names}"


def _is_against_reference(interval: Interval, reference: str) -> bool:
    """Return whether a difference is one against the reference; without one, all are."""
    return not reference or interval.involves(reference)


def _select_compared_intervals(intervals: Iterable[Interval], reference: str) -> list[Interval]:
    """List the differences against the reference; without one, all of them."""
    return [interval for interval in intervals if _is_against_reference(interval, reference)]


def _format_finding_p(finding: Finding) -> str:
    """Format the corrected probability of a finding in the style of the APA."""
    return f"p {format_apa_p(finding.corrected)}"


def _describe_measure(measure: Measure, finding: Finding, reference: str) -> str:
    """Describe how conditions differ in a measure, or by how little."""
    paired = _select_compared_intervals(measure.paired, reference)
    modelled = _select_compared_intervals(measure.mixed.intervals, reference)
    p = _format_finding_p(finding)
    if not finding.corrected < _LEVEL:
        return _describe_no_difference(measure, paired, modelled, p)
    differences = []
    # where each condition has its own participants, nobody has differences
    for interval in paired or modelled:
        if interval.p < _LEVEL:
            differences.append(_describe_pair_difference(interval, measure.is_logarithmic))
    tested = p
    if measure.corrected is not None:
        tested = format_f_test(measure.corrected, finding.corrected)
    text = "; ".join(differences) or "no single pair does"
    return f"conditions differ, {tested}; {text}"


def _describe_no_difference(
    measure: Measure, paired: Sequence[Interval], modelled: Sequence[Interval], p: str
) -> str:
    """Describe by how little conditions differ, and the Bayes factor for no difference.

    The bound is of the model's differences, the Bayes factor of the participants' own.
    """
    bounds = [assess_equivalence(interval).bound for interval in modelled]
    bound = max(bounds, default=math.nan)
    if measure.is_logarithmic:
        less = f"a factor of {math.exp(bound):.2g}"
    else:
        less = f"{bound * 1e6:.2g} um"
    text = f"no difference between conditions was found ({p}); they differ by less than {less}"
    if not paired:
        return text
    factors = []
    for interval in paired:
        t = interval.difference / interval.error
        factors.append(compute_null_bayes_factor(t, interval.df + 1.0))
    smallest, largest = f"{min(factors):.2g}", f"{max(factors):.2g}"
    times = smallest
    if largest != smallest:
        times = f"{smallest} to {largest}"
    return f"{text}; no difference is {times} times as likely as one"


def _describe_pair_difference(interval: Interval, logarithmic: bool) -> str:
    """Describe how the condition with the larger value differs from the other, with its own p."""
    tested = f"p {format_apa_p(interval.p)}"
    if interval.difference > 0.0:
        larger, smaller = interval.first, interval.second
        bounds = interval.bounds
    else:
        larger, smaller = interval.second, interval.first
        bounds = Bounded(-interval.difference, -interval.high, -interval.low)
    if logarithmic:
        ratio, low, high = bounds.transform(math.exp)
        size = f"a factor of {ratio:#.2g} (95 % {low:#.2g} to {high:#.2g}, {tested})"
    else:
        length, low, high = bounds.transform(lambda metres: metres * 1e6)
        size = f"{length:.2g} um (95 % {low:.2g} to {high:.2g}, {tested})"
    return f"with {larger} it is larger by {size} than with {smaller}"


def _describe_comparisons_and_magnitudes(result: StudyResult) -> Iterator[str]:
    """Describe levels of comparisons and magnitudes, which claims no difference."""
    for setting in result.comparisons:
        yield from _describe_setting(setting)
    for law in result.power_laws:
        yield _describe_power_law(law, names_condition=len(result.power_laws) > 1)


def _describe_setting(setting: Comparisons) -> Iterator[str]:
    """Describe the comparisons in one setting, of the group or of each participant."""
    where = f"with {setting.setting}, " if setting.setting else ""
    equal, spread = setting.equal, setting.spread
    if equal is None or spread is None:
        for curve in setting.curves:
            reason = curve.reason or "see the table"
            yield f"{where}comparisons of participant {curve.who}: {reason}"
        return
    height, low, high = equal.bounds.transform(lambda log: setting.standard * math.exp(log) * 1e6)
    weber, low_weber, high_weber = spread.bounds.transform(
        lambda log: 100.0 * compute_weber_fraction(log)
    )
    yield (
        f"{where}a block of {height:.3g} um feels as high as the standard (95 % {low:.3g} "
        f"to {high:.3g}), and a height must differ by {weber:.2g} % to be told apart "
        f"(95 % {low_weber:.2g} to {high_weber:.2g}), means over {len(setting.people)} participants"
    )


def _describe_power_law(law: PowerLaw, names_condition: bool) -> str:
    """Describe how magnitudes grow in a condition, which is named where there are several."""
    where = f"with {law.condition}, " if names_condition else ""
    return (
        f"{where}the perceived magnitude grows with the height to the power of "
        f"{law.exponent:.2g} (95 % {law.low:.2g} to {law.high:.2g})"
    )


def format_f_test(term: Term, p: float = math.nan) -> str:
    """Write an F test in the style of the APA; `p` is a corrected probability."""
    shown = term.p if math.isnan(p) else p
    df, df_error = format_df(term.df), format_df(term.df_error)
    return f"F({df}, {df_error}) = {term.f:.2f}, p {format_apa_p(shown)}"


def format_df(df: float) -> str:
    """Write degrees of freedom: whole where they are, else with two digits."""
    if math.isclose(df, round(df), rel_tol=1e-6):
        return f"{df:.0f}"
    return f"{df:.2f}"


def format_apa_p(p: float) -> str:
    """Write a probability in APA style: three digits without the zero before the point."""
    if p < 0.001:
        return "< .001"
    return f"= {p:.3f}".replace("0.", ".", 1)
