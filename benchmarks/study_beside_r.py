"""Put the analyses of studies beside R: how far figures are apart, for each function of R.

    python benchmarks/study_beside_r.py [--every]

R's figures are data, by tests/study/data/beside.R with the versions that beside.json names; those
of psignifit, a program in Python, by beside_psignifit.py there. A row
holds a statistic, an estimate or an end of an interval; it is apart by a share of R's figure or,
where that may be near zero, of half an interval. `TOLERANCES` says what is allowed for each
analysis and why; tests/study/test_beside_r.py holds it. With --every all figures are printed.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import t

from stepblocks.study.analysis.accuracy import compare_participant_groups, correct_condition_test
from stepblocks.study.analysis.anova import Interval, Term, run_f_test
from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.analysis.ordinal import fit_ordinal_model, fit_proportional_odds
from stepblocks.study.analysis.population import Grid, Population
from stepblocks.study.analysis.psychometric import Z75, find_root_by_stepping, fit_psychometric
from stepblocks.study.analysis.repeated import (
    compare_conditions_within_participants,
    compute_null_bayes_factor,
    iterate_factor_tests,
)

DATA = Path(__file__).resolve().parents[1] / "tests" / "study" / "data"
R = json.loads((DATA / "beside.json").read_text())
PSIGNIFIT = json.loads((DATA / "psignifit.json").read_text())
R |= PSIGNIFIT | {"origin": f"{R['origin']}; {PSIGNIFIT['origin']}"}
LAPSED = [25, 32, 40, 45, 55, 62, 75, 90], [3, 2, 9, 14, 24, 33, 37, 37], [40] * 8

# what is compared, R's figure, ours, and the scale on which they may be apart
Row = tuple[str, str, float, float, float]

TOLERANCES = {
    "analysis of variance": 1e-6,
    "mixed model": 1e-5,  # lme4 stops at a tolerance of its optimiser
    "studentized range": 1e-4,  # of which scipy and R integrate each its own
    "Bayes factor": 1e-5,
    "ordinal model": 1e-5,
    # adaptive quadrature there, 31 fixed points here
    "levels of participants": 2e-5,
    "psychometric function": 1e-4,
    # its search ends earlier, where the likelihood is flat
    "psychometric function beside psignifit": 5e-3,
    # likelihoods on a grid, of which a step is a tenth of the interval; shares of that
    "population": 0.03,
    # slopes normal over participants, with a correlation and no lapses: another model
    "population beside glmer": 0.25,
}


def compare(analysis: str, quantity: str, ours: list[float], scale: float = 0.0) -> Iterator[Row]:
    """Put the figures of R by that name beside ours."""
    for theirs, own in zip(R[quantity], ours, strict=True):
        yield analysis, quantity, theirs, own, scale or abs(theirs)


def list_term(term: Term) -> list[float]:
    return [term.f, term.p, term.df, term.df_error]


def compare_family(
    found: tuple[Interval, ...], name: str, df: bool = False, turned: bool = False
) -> Iterator[Row]:
    """Put intervals of all pairs beside R's, as shares of half an interval."""
    for one in found:
        ours = [one.difference, one.low, one.high, one.p, *([one.df] if df else [])]
        key = f"{name} {one.first} - {one.second}"
        if turned:
            key = f"{name} {one.second}-{one.first}"
            ours = [-one.difference, -one.high, -one.low, one.p]
        # near 1 and near 0 the integrals for p end at an absolute error
        scales = [(one.high - one.low) / 2.0] * 3 + [1.0, one.df]
        for (_, _, theirs, own, _), scale in zip(compare("", key, ours), scales, strict=False):
            yield "studentized range", key, theirs, own, scale


def compare_repeated_measures() -> Iterator[Row]:
    """Two factors within participants: afex, aov, lmer, emmeans, ptukey and BayesFactor."""
    rows = pd.read_csv(DATA / "reactions.csv", dtype={"id": str, "angle": str})
    cells = rows.pivot(index="id", columns=["noise", "angle"], values="rt")
    levels = {"noise": ["absent", "present"], "angle": ["0", "4", "8"]}
    for term in iterate_factor_tests(cells, levels):
        yield from compare("analysis of variance", f"afex {term.name}", list_term(term))
    table = rows.groupby(["id", "angle"])["rt"].mean()
    fit = fit_mixed_model(table.reset_index(), "rt", "angle", "id")
    assert fit.condition is not None
    for name in ("aov angle, uncorrected", "lmer angle, one judgement a cell"):
        yield from compare("mixed model", name, list_term(fit.condition))
    yield from compare("mixed model", "lmer angle, logLik by REML", [fit.log_likelihood])
    yield from compare_family(fit.intervals, "emmeans", df=True)
    pairs = compare_conditions_within_participants(table.unstack())
    yield from compare_family(pairs, "ptukey")
    for one in pairs:
        factor = compute_null_bayes_factor(one.difference / one.error, one.df + 1.0)
        yield from compare("Bayes factor", f"ttestBF {one.first} - {one.second}", [factor])


def compare_unequal_groups() -> Iterator[Row]:
    """Compare groups of 5, 4 and 7: afex, TukeyHSD, and Anova and emmeans of an unbalanced lm."""
    rows = pd.read_csv(DATA / "treatments.csv", dtype={"id": str})
    names = {"id": "participant", "treatment": "group", "phase": "condition"}
    data = rows.rename(columns=names)
    means = data.groupby(["participant", "group", "condition"])["value"].mean().reset_index()
    (group, within), family = compare_participant_groups(means)
    yield from compare("analysis of variance", "afex treatment", list_term(group))
    yield from compare("analysis of variance", "afex treatment:phase", list_term(within))
    phases = fit_mixed_model(means, "value", "condition", "participant").condition
    _, sphericity = correct_condition_test(means, phases)
    assert sphericity is not None
    name = "afex phase, epsilons of Geisser, and of Huynh and Feldt"
    ours = [sphericity.epsilon, sphericity.huynh_feldt]
    yield from compare("analysis of variance", name, ours)
    order = {"control": 0, "A": 1, "B": 2}  # R's order of the levels
    turned = [flip(one) if order[one.first] > order[one.second] else one for one in family]
    yield from compare_family(tuple(turned), "TukeyHSD", turned=True)
    found = run_f_test(rows, "value", "treatment", "phase")
    for term in found.terms:
        yield from compare("analysis of variance", f"Anova of lm {term.name}", list_term(term))
    turned = [flip(one) if order[one.first] > order[one.second] else one for one in found.intervals]
    yield from compare_family(tuple(turned), "emmeans of lm")


def flip(one: Interval) -> Interval:
    """Turn a difference round."""
    ends = (-one.difference, -one.high, -one.low)
    return Interval(one.second, one.first, *ends, one.p, -one.effect_size, one.error, one.df)


def compare_ratings() -> Iterator[Row]:
    """Ratings of wine: clm, and clmm."""
    rows = pd.read_csv(DATA / "wine.csv", dtype={"judge": str})
    exog = pd.DataFrame({name: rows[name].isin(["warm", "yes"]) for name in ("temp", "contact")})
    values, covariance, log_likelihood = fit_proportional_odds(rows["rating"], exog.astype(float))
    errors = np.sqrt(np.diag(covariance))
    for name, value, error in zip(("tempwarm", "contactyes"), values, errors, strict=True):
        yield from compare("ordinal model", f"clm {name}", [value, error])
    yield from compare("ordinal model", "clm, logLik", [log_likelihood])
    levels = pd.get_dummies(rows["judge"], prefix="judge", drop_first=True)
    both = exog[["temp"]].join(levels).astype(float)
    values, covariance, _ = fit_proportional_odds(rows["rating"], both)
    ours = [values[0], math.sqrt(covariance[0, 0])]
    yield from compare("ordinal model", "clm tempwarm, level of each judge", ours)
    judges = rows["judge"].astype(int).to_numpy() - 1
    values, _, log_likelihood = fit_proportional_odds(rows["rating"], exog.astype(float), judges)
    yield from compare("levels of participants", "clmm tempwarm, contactyes", [*values])
    yield from compare("levels of participants", "clmm, logLik", [log_likelihood])
    two = rows.assign(rating=(rows["rating"] > 2).astype(int))
    for name, frame in (("clmm tempwarm", rows), ("glmer tempwarm of two categories", two)):
        (effect,) = fit_ordinal_model(frame, "rating", "temp", "judge").effects
        assert (effect.first, effect.second) == ("warm", "cold")
        yield from compare("levels of participants", name, [effect.difference])


def compare_curves() -> Iterator[Row]:
    """Psychometric functions of one participant: psyphy, psignifit, and profiles by optim."""
    rows = pd.read_csv(DATA / "comparisons.csv")
    tables = {
        str(who): (own["height_um"], own["hits"], own["totals"])
        for who, own in rows[rows["participant"].isin([2, 3, 7])].groupby("participant")
    }
    for who, (heights, hits, totals) in (tables | {"who lapses": LAPSED}).items():
        fit = fit_psychometric([h / 50.0 for h in heights], list(hits), list(totals))
        ours = [math.log(fit.threshold[0]), fit.spread, fit.lapse, fit.deviance]
        for row, scale in zip(
            compare("psychometric function", f"psyphy participant {who}", ours),
            (fit.spread, fit.spread, 0.1, fit.deviance),
            strict=True,
        ):
            yield *row[:4], scale
        for row, scale in zip(
            compare(
                "psychometric function beside psignifit", f"psignifit participant {who}", ours[:3]
            ),
            (fit.spread, fit.spread, 0.1),
            strict=True,
        ):
            yield *row[:4], scale
        ends = [*fit.threshold[1:], 1.0 + fit.weber[1], 1.0 + fit.weber[2]]
        logs = [math.log(end) for end in ends]
        ours = [*logs[:2], *(math.log(value / Z75) for value in logs[2:])]
        name = f"optim participant {who}"
        yield from compare("psychometric function", name, ours, scale=fit.spread)


def find_ends(model: Population, index: int) -> list[float]:
    """Find where the profile loses what Student's t would: R's limit, for any spread."""
    place, people = 2 * index, len(model.likelihood)
    limit = people * math.log1p(float(t.ppf(0.975, people - 1)) ** 2 / (people - 1))
    middle = float(model.best.x[place])

    def excess(value: float) -> float:
        held = model.maximise_likelihood(model.best.x, place, value)
        return float(2.0 * (held.fun - model.best.fun) - limit)

    low, high = model.axes[index][[0, -1]]
    return [
        find_root_by_stepping(excess, middle, end, step) for end, step in ((low, -0.1), (high, 0.1))
    ]


def compare_population() -> Iterator[Row]:
    """Psychometric functions of a group: the same model by nlminb, and glmer."""
    rows = pd.read_csv(DATA / "comparisons.csv")
    hits, totals = (
        rows.pivot(index="participant", columns="height_um", values=name)
        for name in ("hits", "totals")
    )
    grid = Grid(np.log(hits.columns.to_numpy(float) / 50.0), hits, totals)
    # without lapses, as R has it here
    bare = Population(grid.likelihood[..., 0], (grid.middles, grid.spreads))
    equal, spread = bare.estimate(0), bare.estimate(1)
    name = "nlminb means and standard deviations of thresholds and ln(spread)"
    halves = [(one.high - one.low) / 2.0 for one in (equal, spread)]
    ours = [equal.value, equal.spread, spread.value, spread.spread]
    for row, scale in zip(compare("population", name, ours), np.repeat(halves, 2), strict=True):
        yield *row[:4], scale
    for index, label in enumerate(("threshold", "ln(spread)")):
        name = f"nlminb ends of the mean {label}"
        yield from compare("population", name, find_ends(bare, index), scale=halves[index])
    whole = Population(grid.likelihood, grid.axes)
    equal, spread = whole.estimate(0), whole.estimate(1)
    name = "glmer probit, standard errors of threshold and ln(spread)"
    scales = [1.96 * R[name][0], 1.96 * R[name][1]]
    theirs = R["glmer probit, threshold, spread"]
    kind = "population beside glmer"
    yield kind, "glmer probit, threshold", theirs[0], equal.value, scales[0]
    yield kind, "glmer probit, ln(spread)", math.log(theirs[1]), spread.value, scales[1]


def compare_all() -> Iterator[Row]:
    """Every row of the table."""
    for part in (
        compare_repeated_measures,
        compare_unequal_groups,
        compare_ratings,
        compare_curves,
        compare_population,
    ):
        yield from part()


def main() -> None:
    print(f"{R['origin']}\n")
    rows = [
        (analysis, quantity.partition(" ")[0].rstrip(","), quantity, theirs, ours, scale)
        for analysis, quantity, theirs, ours, scale in compare_all()
    ]
    if "--every" in sys.argv:
        print("| analysis | quantity | R | ours | apart |\n" + "|---" * 5 + "|")
        for analysis, _, quantity, theirs, ours, scale in rows:
            apart = abs(ours - theirs) / scale
            print(f"| {analysis} | {quantity} | {theirs:.7g} | {ours:.7g} | {apart:.1e} |")
        return
    print("## Beside R")
    print("| analysis | function of R | figures | farthest apart | allowed |\n" + "|---" * 5 + "|")
    found: dict[tuple[str, str], list[float]] = {}
    for analysis, function, _, theirs, ours, scale in rows:
        found.setdefault((analysis, function), []).append(abs(ours - theirs) / scale)
    for (analysis, function), all_apart in found.items():
        print(
            f"| {analysis} | `{function}` | {len(all_apart)} | {max(all_apart):.1e} | "
            f"{TOLERANCES[analysis]:g} |"
        )


if __name__ == "__main__":
    main()
