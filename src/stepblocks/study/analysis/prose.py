"""What a study says in words: the sentence that its report opens with, and a journal's table."""

import math
from collections.abc import Iterator

from stepblocks.quantities import format_units
from stepblocks.study.analysis.accuracy import Measure, assess_equivalence
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.psychometric import compute_weber
from stepblocks.study.analysis.repeated import compute_bayes_factor
from stepblocks.study.analysis.results import EXPONENT, Finding, StudyResult

_LEVEL = 0.05


def write_headline(result: StudyResult) -> str:
    """Say what the primary outcome is; the others only where it shows a difference."""
    # Only the primary test may claim a difference first, so that the level of the headline is 5 %.
    sentences = [*_describe_levels(result)]
    for finding in result.findings():
        text = _describe_finding(result, finding)
        if finding.primary:
            sentences.append(f"primary outcome, {finding.name}: {text}")
            if not finding.p < _LEVEL:
                break
        elif finding.corrected < _LEVEL:
            sentences.append(f"secondary, corrected for their number, {finding.name}: {text}")
    return format_units(" ".join(f"{text[0].upper()}{text[1:]}." for text in sentences))


def _describe_finding(result: StudyResult, finding: Finding) -> str:
    # Say what one planned test found
    p = f"p {format_apa_p(finding.corrected)}"
    if (measure := result.measure(finding.name)) is not None:
        return _describe_measure(measure, finding, result.reference, p)
    if finding.name in result.ordinal:
        pairs = result.ordinal[finding.name].effects
        ratios = "; ".join(
            f"{math.exp(one.difference):.2g} (95 % {math.exp(one.low):.2g} to "
            f"{math.exp(min(one.high, 700.0)):.2g}) with {one.first} over {one.second}"
            for one in pairs
            if result.reference in ("", one.first, one.second)
            and (len(pairs) == 1 or one.p < _LEVEL)
        )
        return f"odds ratios of a higher rating of realism: {ratios or 'no pair differs'} ({p})"
    one = result.differences()[finding.name]
    convert = float if finding.name.startswith(EXPONENT) else math.exp
    middle, low, high = (convert(value) for value in (one.difference, one.low, one.high))
    return (
        f"{middle:.3g}{' times' if convert is math.exp else ''} (95 % {low:.3g} to {high:.3g}, {p})"
    )


def _describe_measure(measure: Measure, finding: Finding, reference: str, p: str) -> str:
    pairs, modelled = (
        [one for one in family if reference in ("", one.first, one.second)]
        for family in (measure.paired, measure.mixed.intervals)
    )
    if finding.corrected < _LEVEL:
        # where each condition has its own participants, nobody has differences
        found = [_describe_pair(measure, one) for one in pairs or modelled if one.p < _LEVEL]
        return "; ".join(found or ["conditions differ, no single pair does"]) + f" ({p})"
    bound = max((assess_equivalence(one)[0] for one in modelled), default=math.nan)
    less = f"a factor of {math.exp(bound):.2g}" if measure.logarithmic else f"{bound * 1e6:.2g} um"
    factors = sorted(
        compute_bayes_factor(one.difference / one.error, one.df + 1.0) for one in pairs
    )
    ends = " to ".join(dict.fromkeys(f"{value:.2g}" for value in (*factors[:1], *factors[-1:])))
    return f"no difference between conditions was found ({p}); they differ by less than {less}" + (
        f"; no difference is {ends} times as likely as one" if factors else ""
    )


def _describe_pair(measure: Measure, one: Interval) -> str:
    # Say how the condition with the larger value differs from the other
    sign = 1.0 if one.difference > 0.0 else -1.0
    names = (one.first, one.second)[:: int(sign)]
    ends = (sign * one.difference, *sorted((sign * one.low, sign * one.high)))
    if measure.logarithmic:
        ratio, low, high = (math.exp(value) for value in ends)
        size = f"a factor of {ratio:#.2g} (95 % {low:#.2g} to {high:#.2g})"
    else:
        size = f"{ends[0] * 1e6:.2g} um (95 % {ends[1] * 1e6:.2g} to {ends[2] * 1e6:.2g})"
    return f"with {names[0]} it is larger by {size} than with {names[1]}"


def _describe_levels(result: StudyResult) -> Iterator[str]:
    # Say what comparisons and magnitudes measured, which claims no difference
    for found in result.comparisons:
        where = f"with {found.setting}, " if found.setting else ""
        if found.equal and found.spread:
            middle, low, high = (
                found.standard * math.exp(value) * 1e6
                for value in (found.equal.value, found.equal.low, found.equal.high)
            )
            weber, least, most = (
                100.0 * compute_weber(value)
                for value in (found.spread.value, found.spread.low, found.spread.high)
            )
            yield (
                f"{where}a block of {middle:.3g} um feels as high as the standard (95 % {low:.3g} "
                f"to {high:.3g}), and a height must differ by {weber:.2g} % to be told apart "
                f"(95 % {least:.2g} to {most:.2g}), means over {len(found.people)} participants"
            )
        for curve in found.curves if not found.equal else ():
            yield (
                f"{where}comparisons of participant {curve.who}: {curve.reason or 'see the table'}"
            )
    for law in result.power_laws:
        where = f"with {law.condition}, " if len(result.power_laws) > 1 else ""
        yield (
            f"{where}the perceived magnitude grows with the height to the power of "
            f"{law.exponent:.2g} (95 % {law.low:.2g} to {law.high:.2g})"
        )


def format_apa_p(p: float) -> str:
    """Write a probability as the APA asks for: three digits without the zero before the point."""
    return "< .001" if p < 0.001 else f"= {p:.3f}".replace("0.", ".", 1)
