"""What a study says in words: the sentence that its report opens with, the paragraph on methods, and the table of a journal."""

import math
from collections.abc import Iterator
from importlib.metadata import version

from stepblocks.quantities import format_units
from stepblocks.study.analysis.accuracy import ANSWER, Measure
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.results import StudyResult

_LEVEL = 0.05


def write_headline(result: StudyResult) -> str:
    """Say what was found in one sentence, or one for the estimates and one for the ratings."""
    said = [*_estimates(result), *_others(result)]
    return format_units(" ".join(f"{text[0].upper()}{text[1:]}." for text in said))


def _facing(measure: Measure, first: str, second: str) -> Interval:
    """Difference between two conditions, first minus second, by the mixed model."""
    one = next(one for one in measure.mixed.intervals if {one.first, one.second} == {first, second})
    if one.first == first:
        return one
    ends = (-one.difference, -one.high, -one.low)
    return Interval(first, second, *ends, one.p, -one.effect_size, one.error)


def _estimates(result: StudyResult) -> Iterator[str]:
    absolute, bias, spread = (result.measure(name) for name in (ANSWER, "bias", "spread"))
    if absolute is None or bias is None:
        return
    best, *others = sorted(absolute.mixed.means, key=lambda mean: mean[1])
    clauses = list[str]()
    for name, _, _ in others:
        said = []
        scatter = None if spread is None else _facing(spread, name, best[0])
        if scatter is not None and scatter.p < _LEVEL:
            ratio, low, high = (
                math.exp(v) for v in (scatter.difference, scatter.low, scatter.high)
            )
            said.append(f"scatter {ratio:#.2g} times as much (95 % {low:#.2g} to {high:#.2g})")
        farther, moved = _facing(absolute, name, best[0]), _facing(bias, name, best[0])
        if farther.p < _LEVEL:
            said.append(f"are farther from the height by {_um(farther)}")
        if moved.p < _LEVEL:
            said.append(
                f"are {'higher' if moved.difference > 0.0 else 'lower'} by "
                f"{_um(moved, abs(moved.difference))}"
            )
        if said:
            listed = f"{', '.join(said[:-1])}{' and ' if said[:-1] else ''}{said[-1]}"
            clauses.append(
                f"{'those' if clauses else f'compared with {best[0]}, estimates'} with {name} "
                f"{listed}"
            )
    by_pair = {frozenset((one.first, one.second)): one for one in bias.equivalence}
    for one in absolute.equivalence:
        families = [
            _facing(part, one.first, one.second).p
            for part in (absolute, bias, spread)
            if part is not None
        ]
        if min(families) >= _LEVEL:
            bound = max(one.bound, by_pair[frozenset((one.first, one.second))].bound)
            clauses.append(
                f"no difference was found between {one.first} and {one.second}, which "
                "differ "
                "by "
                f"less than {bound * 1e6:.2g} um"
            )
    yield "; ".join(clauses)


def _um(one: Interval, shown: float | None = None) -> str:
    low, high = (
        sorted((abs(one.low), abs(one.high))) if one.low * one.high > 0.0 else (one.low, one.high)
    )
    difference = one.difference if shown is None else shown
    return f"{difference * 1e6:.2g} um (95 % {low * 1e6:.2g} to {high * 1e6:.2g})"


def _others(result: StudyResult) -> Iterator[str]:
    for effect in result.ordinal.effects if result.ordinal else ():
        ends = f"(95 % {effect.low:.2g} to {effect.high:.2g})"
        yield f"the odds of a higher rating of realism are {effect.ratio:.2g} times those without {effect.name} {ends}"
    for curve in result.curves[-1:]:
        fit = curve.fit
        if fit is None:
            yield f"the comparisons of {curve.who} tell no threshold: {curve.reason}"
            continue
        yield (
            f"a block of {fit.threshold * 1e6:.3g} um feels as high as the standard (95 % "
            f"{fit.threshold_low * 1e6:.3g} to "
            f"{fit.threshold_high * 1e6:.3g}), and a height must differ by "
            f"{fit.weber * 100.0:.2g} % to be told apart "
            f"(95 % {fit.weber_low * 100.0:.2g} to {fit.weber_high * 100.0:.2g})"
        )
    if law := result.power_law:
        yield f"the felt magnitude grows with the height to the power of {law.exponent:.2g} (95 % {law.low:.2g} to {law.high:.2g})"


def write_methods(result: StudyResult) -> str:
    """Write the paragraph on the analysis, with what was run and in which version."""
    frame = result.frame
    people, conditions = frame["participant"].nunique(), frame["condition"].nunique()
    said = [
        f"{people} participants gave {len(frame)} judgements of {frame['stimulus'].nunique()} "
        "blocks in "
        f"{conditions} condition{'s' if conditions > 1 else ''} "
        f"({', '.join(sorted(frame['condition'].unique()))})."
    ]
    if result.measures:
        names = ", ".join(one.name for one in result.measures).capitalize()
        said.append(
            "The error of an estimate is the estimate less the height of the block. "
            f"{names} "
            "were "
            "analysed; the absolute error "
            "answers whether heights are estimated less accurately, the bias, which noise "
            "leaves "
            "where it is, is the mean signed "
            "error, and the spread the logarithm of a participant's standard deviation "
            "about "
            "the "
            "mean of each block. Each was tested "
            "by an analysis of variance, condition by block, with Tukey's family of intervals, "
            "which takes judgements of one "
            "participant for independent, and by a linear mixed model, which does not: it was "
            "fitted by restricted maximum "
            "likelihood with condition, block and their interaction as fixed effects and "
            "random "
            "intercepts of participants and of "
            "participants by condition; its test has (participants - 1)(conditions - 1) "
            "degrees "
            "of freedom, its intervals hold "
            "together with 95 %. Equivalence was tested by two one-sided tests at the 5 % "
            "level "
            "on the contrasts of the mixed model."
        )
    if any(one.groups for one in result.measures):
        said.append(
            "Groups of participants were compared by a split-plot analysis of the "
            "participants' "
            "means."
        )
    if result.ordinal:
        said.append(
            "Ratings were analysed by a proportional-odds model with a level for each "
            "participant "
            "and errors clustered by participant, "
            "and tested by an F-test over participants."
        )
    if result.curves:
        said.append(
            "Cumulative normals in the logarithm of the height with one lapse rate for "
            "both "
            "ends "
            "were fitted by maximum likelihood; "
            "the Weber fraction is the step from the middle to three quarters of the rise."
        )
    if result.power_law:
        said.append(
            "A power law was fitted to each participant; its mean exponent has an interval by "
            "Student's t."
        )
    tools = ", ".join(f"{name} {version(name)}" for name in ("stepblocks", "statsmodels", "scipy"))
    return " ".join([*said, f"Computed with {tools}."])


def make_journal_table(result: StudyResult) -> list[dict[str, str]]:
    """Lay out means and tests as the Publication Manual of the APA (7th ed., 6.36, 6.43, 7.21) asks for."""
    rows = []
    for measure in result.measures:
        factor, shift = (1.0, math.log(1e6)) if measure.logarithmic else (1e6, 0.0)
        means = (
            measure.frame.groupby(["condition", "participant"])["value"].mean().groupby("condition")
        )
        row = {"measure": measure.label}
        for name, own in means:
            row[name] = f"{own.mean() * factor + shift:.2f} ({own.std() * factor:.2f})"
        if (term := measure.mixed.condition) is not None:
            ends = f"[{term.eta_low:.2f}, {term.eta_high:.2f}]".replace("0.", ".")
            row["F"] = f"F({term.df:g}, {term.df_error:g}) = {term.f:.2f}"
            row |= {
                "p": format_apa_p(term.p),
                "eta": f"{term.eta_squared:.2f}".lstrip("0") + f" {ends}",
            }
        rows.append(row)
    return rows


def format_apa_p(p: float) -> str:
    """Write a probability as the APA asks for: three digits without the zero that it cannot exceed."""
    return "< .001" if p < 0.001 else f"= {p:.3f}".replace("0.", ".", 1)
