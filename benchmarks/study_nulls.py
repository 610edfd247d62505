"""Count wrong claims of studies without an effect, and intervals that hold of studies with one.

    nice python benchmarks/study_nulls.py [--nulls 1000] [--effects 500] [ANALYSIS ...]
    python benchmarks/study_nulls.py --summary

Each simulated study has participants who differ, in their level and in what a condition does to
them, lapse rates from 0 to 0.1, 3 % missing judgements and one missing cell; every second study has
one bad participant, who gives the same answer in all trials. Each outcome is a line of
out/study-nulls/ANALYSIS.jsonl, so that the same command goes on where it was stopped; delete the
file after a change of the analysis. What an interval should hold is a parameter of the simulation,
or where that has no closed form, the mean of 4,000 participants without missing judgements.
Intervals of all pairs of three or four conditions are one outcome: all of them must hold.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats
from scipy.special import ndtr
from statsmodels.stats.libqsturng import psturng, qsturng
from statsmodels.stats.proportion import proportion_confint

from stepblocks.study.analysis import accuracy, comparisons, population
from stepblocks.study.analysis.accuracy import (
    MEASURES,
    analyse_measure,
    assess_declared_factors,
    compare_participant_groups,
    compute_measure_values,
)
from stepblocks.study.analysis.anova import Interval, run_f_test
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.psychometric import compute_weber_fraction, find_root_by_stepping
from stepblocks.study.analysis.repeated import (
    compare_conditions_within_participants,
    tabulate_participant_means,
)
from stepblocks.study.experiments.registry import EXPERIMENTS

OUT = Path(__file__).parents[1] / "out" / "study-nulls"
CHUNK = 25  # studies of one analysis before the next has its turn
Random = np.random.Generator
Found = dict[str, dict[str, float]]  # "p" and "held" by headline or interval
HEIGHTS = np.array([50e-6, 70e-6, 90e-6])
LEVELS = np.array([25, 32, 40, 45, 55, 62, 75, 90]) * 1e-6
STANDARD = 50e-6
NOISE, LEVEL, RESPONSE = 6e-6, 4e-6, 3e-6  # m; of judgements, of participants, by condition
BIAS, RATIO, GAIN = 5e-6, 1.4, 1.2  # effects: bias [m], spread [1], ratings [logit]
MIDDLE, WIDTH = 0.05, math.log(0.2)  # ln(PSE / standard), ln(sigma)
SHIFTS = 0.12, 0.4  # effects on both
QUANTITIES = "point of subjective equality", "spread of comparisons"
EXPONENT, STEEPER = 0.6, 0.15


def drop(frame: pd.DataFrame, random: Random, keys: tuple[str, ...]) -> pd.DataFrame:
    """Take 3 % of the judgements away, and all of one cell of the second participant."""
    cells = frame.groupby(list(keys)).ngroup()
    own = cells[frame["participant"] == "1"].unique()
    return frame[(random.random(len(frame)) > 0.03) & (cells != random.choice(own))]


def estimates(
    random: Random,
    effect: float,
    people: int = 10,
    conditions: int = 2,
    bad: bool = False,
    whole: bool = False,
) -> pd.DataFrame:
    """Estimates of three heights, three times each; the last condition has the effect."""
    shape = (people, conditions, len(HEIGHTS), 3)
    person, setting, block, _ = (index.ravel() for index in np.indices(shape))
    last = setting == conditions - 1
    response = random.standard_normal((people, conditions))
    # no sphericity, yet one variance: where that differed, the absolute error would differ too
    response[:, 0] = 0.8 * response[:, conditions - 1] + 0.6 * response[:, 0]
    error = LEVEL * random.standard_normal(people)[person] + effect * BIAS * last
    error += RESPONSE * response[person, setting]
    noise = NOISE * np.exp(0.3 * random.standard_normal(people))[person] * RATIO ** (effect * last)
    noise *= np.exp(0.15 * random.standard_normal((people, conditions)))[person, setting]
    error += noise * random.standard_normal(len(person))
    height = HEIGHTS[block]
    lapsed = random.random(len(person)) < random.uniform(0.0, 0.1, people)[person]
    estimate = np.where(lapsed, random.choice(HEIGHTS, len(person)), height + error)
    if bad:
        estimate[person == 0] = 70e-6
    latent = 1.5 * random.standard_normal(people)[person]
    latent += (effect * GAIN + 0.5 * random.standard_normal(people)[person]) * last
    rating = np.clip(np.round(4.0 + latent + random.logistic(size=len(person))), 1, 7)
    rating[lapsed] = random.integers(1, 8, len(person))[lapsed]
    if bad:
        rating[person == 0] = 4
    frame = pd.DataFrame(
        {
            "participant": person.astype(str),
            "condition": np.array(list("abcd"))[setting],
            "stimulus": np.array(["50", "70", "90"])[block],
            "height": height,
            "estimate": estimate,
            "error": estimate - height,
            "rating": rating.astype(int),
        }
    )
    return frame if whole else drop(frame, random, ("participant", "condition", "stimulus"))


@cache
def true_changes() -> dict[str, float]:
    """Return what the effect changes of each measure of estimates."""
    frame, found = estimates(np.random.default_rng(9), 1.0, people=4000, whole=True), {}
    for name in MEASURES:
        table = tabulate_participant_means(compute_measure_values(frame, name)[0])
        found[name] = float((table["a"] - table["b"]).mean())
    return found


def judge_estimates(random: Random, effect: float, bad: bool) -> Found:
    """Two conditions: bias, absolute error and spread, and the realism of ratings."""
    frame = estimates(random, effect, bad=bad)
    analysis = EXPERIMENTS["estimates"].analyse(frame, math.nan)
    ordinal = fit_ordinal_model(frame, "rating", "condition", "participant")
    result = replace(analysis, ordinal={"realism": ordinal})
    found: Found = {"p": {one.name: one.p for one in result.summarise_findings()}, "held": {}}
    if effect:
        for one in result.measures:
            truth = true_changes()[one.name]
            for kind, family in (("differences", one.paired), ("model", one.mixed.intervals)):
                (gap,) = family
                found["held"][f"{one.name}, {kind}"] = gap.low < truth < gap.high
        (odds,) = ordinal.effects
        found["held"]["odds of ratings"] = odds.low < GAIN < odds.high
    return found


def judge_three(random: Random, effect: float, bad: bool) -> Found:
    """Three conditions whose differences have unlike variances; the last has the effect."""
    frame = estimates(random, effect, conditions=3, bad=bad)
    found: Found = {"p": {}, "held": {}}
    for name in MEASURES:
        one = analyse_measure(frame, name)
        assert one.corrected is not None
        found["p"][name] = one.corrected.p
        found["p"][f"{name}, best of all pairs"] = min(gap.p for gap in one.paired)
        if effect:
            truths = {"a": true_changes()[name], "b": true_changes()[name], "c": 0.0}
            for kind, family in (("differences", one.paired), ("model", one.mixed.intervals)):
                found["held"][f"{name}, all pairs, {kind}"] = hold_together(family, truths)
    return found


def hold_together(family: Sequence[Interval], means: Mapping[str, float]) -> bool:
    """Say whether every interval of a family holds the difference of its true means."""
    return all(gap.low < means[gap.first] - means[gap.second] < gap.high for gap in family)


def factors(
    random: Random, effect: float, people: int = 12, bad: bool = False, whole: bool = False
) -> pd.DataFrame:
    """Absolute errors of two crossed factors within, and of two groups of participants.

    The effects are on the last of the four conditions, and on the bias of the second group.
    """
    frame = estimates(random, effect, people, 4, bad, whole)
    number = frame["condition"].map({"a": 0, "b": 1, "c": 2, "d": 3})
    group = (frame["participant"].astype(int) % 2).map({0: "x", 1: "y"})
    frame["error"] += effect * BIAS * (group == "y")
    frame = frame.assign(factor_u=number // 2, factor_v=number % 2, group=group)
    return compute_measure_values(frame, "absolute error")[0]


@cache
def true_factors() -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Return the means of the conditions and of the groups, and noncentralities for one person."""
    data = factors(np.random.default_rng(9), 1.0, people=4000, whole=True)
    table = tabulate_participant_means(data)
    a, b, c, d = (table[name] for name in "abcd")
    contrasts = {"u": a + b - c - d, "v": a - b + c - d, "u:v": a - b - c + d}
    noncentral = {name: float(one.mean() ** 2 / one.var()) for name, one in contrasts.items()}
    own = table.mean(axis=1).groupby(data.groupby("participant")["group"].first())
    means = own.mean().to_dict()
    # two groups of half of the people each
    noncentral["group"] = 0.25 * (means["x"] - means["y"]) ** 2 / float(own.var().mean())
    return table.mean().to_dict(), means, noncentral


def judge_factors(random: Random, effect: float, bad: bool) -> Found:
    """Two crossed factors within, and two groups of participants."""
    data = factors(random, effect, bad=bad)
    table = tabulate_participant_means(data)
    groups, apart = compare_participant_groups(data)
    terms = [*assess_declared_factors(data, table.dropna()), *groups]
    found: Found = {"p": {f"factors, {one.name}": one.p for one in terms}, "held": {}}
    if effect:
        conditions, means, noncentral = true_factors()
        found["held"]["all pairs of conditions"] = hold_together(
            compare_conditions_within_participants(table), conditions
        )
        found["held"]["groups"] = hold_together(apart, means)
        for one in terms:
            if one.name in noncentral:  # the groups respond alike: its interval begins at zero
                size = noncentral[one.name] * table.shape[0]
                truth = size / (size + one.df + one.df_error + 1.0)
                found["held"][f"partial eta squared, {one.name}"] = (
                    one.eta_low < truth < one.eta_high
                )
    return found


def pairs(random: Random, effect: float, people: int, bad: bool) -> list[pd.DataFrame]:
    """Comparisons with a standard in two settings; one table of shares for each."""
    middles = MIDDLE + 0.12 * random.standard_normal((people, 1))
    widths = WIDTH + 0.3 * random.standard_normal((people, 1))
    lapses = random.uniform(0.0, 0.1, (people, 1))
    tables = []
    for setting in range(2):
        own = middles + effect * setting * SHIFTS[0] + 0.06 * random.standard_normal((people, 1))
        wide = widths + effect * setting * SHIFTS[1] + 0.15 * random.standard_normal((people, 1))
        p = lapses + (1.0 - 2.0 * lapses) * ndtr((np.log(LEVELS / STANDARD) - own) / np.exp(wide))
        totals = 12 - random.binomial(12, 0.03, p.shape)
        totals[1, random.integers(len(LEVELS))] *= setting
        hits = random.binomial(totals, p)
        if bad:  # always "the second": of half of the pairs that is the standard
            hits[0] = totals[0] // 2
        rows = [
            (str(who), "standard-first", LEVELS[level], STANDARD, number < hits[who, level])
            for who, level in np.ndindex(p.shape)
            for number in range(totals[who, level])
        ]
        columns = ["participant", "condition", "height", "standard", "higher"]
        tables.append(pd.DataFrame(rows, columns=columns).astype({"higher": int}))
    return tables


def judge_pairs(random: Random, effect: float, bad: bool) -> Found:
    """Give the same participants both settings."""
    # no headline within participants reads the ends of an interval
    population.find_root_by_stepping = find_root_by_stepping if effect else lambda *_: math.nan
    one, other = pairs(random, effect, 10, bad)
    frame = pd.concat([one.assign(factor_probe="a"), other.assign(factor_probe="b")])
    return judge_comparisons(frame, effect)


def judge_pairs_of_groups(random: Random, effect: float, bad: bool) -> Found:
    """Give each setting to other participants."""
    population.find_root_by_stepping = find_root_by_stepping
    one, other = pairs(random, effect, 20, bad)
    number = one["participant"].astype(int)
    later = other["participant"].astype(int)
    frame = [one[number < 10].assign(group="a"), other[later >= 10].assign(group="b")]
    return judge_comparisons(pd.concat(frame), effect)


def judge_comparisons(frame: pd.DataFrame, effect: float) -> Found:
    """Analyse comparisons; the curves of single participants are left out, the group's count."""
    result = EXPERIMENTS["constant"].analyse(frame, math.nan)
    found: Found = {"p": {one.name: one.p for one in result.summarise_findings()}, "held": {}}
    if effect:
        truths = dict(zip(QUANTITIES, SHIFTS, strict=True))
        for quantity, (gap,) in result.contrasts.items():
            found["held"][f"{quantity}, change"] = gap.low < -truths[quantity] < gap.high
        for index, one in enumerate(result.comparisons):
            assert one.equal is not None
            assert one.spread is not None
            middle, width = MIDDLE + index * SHIFTS[0], WIDTH + index * SHIFTS[1]
            found["held"][f"point of subjective equality, {index}"] = (
                one.equal.low < middle < one.equal.high
            )
            found["held"][f"spread of comparisons, {index}"] = (
                one.spread.low < width < one.spread.high
            )
            found.setdefault("weber", {})[str(index)] = compute_weber_fraction(one.spread.value)
    return found


def judge_magnitudes(random: Random, effect: float, bad: bool) -> Found:
    """Magnitudes in two conditions by the same participants."""
    shape = (10, 2, len(LEVELS), 3)
    person, setting, level, _ = (index.ravel() for index in np.indices(shape))
    exponent = EXPONENT + effect * STEEPER * np.arange(2) + 0.08 * random.standard_normal((10, 2))
    exponent += 0.15 * random.standard_normal((10, 1))
    log = exponent[person, setting] * np.log(LEVELS[level] / STANDARD)
    log += random.standard_normal(10)[person] + 0.25 * random.standard_normal(len(person))
    lapsed = random.random(len(person)) < random.uniform(0.0, 0.1, 10)[person]
    own = random.standard_normal(10)[person]
    log = np.where(lapsed, own + 0.5 * random.standard_normal(len(person)), log)
    if bad:
        log[person == 0] = 0.0
    frame = pd.DataFrame(
        {
            "participant": person.astype(str),
            "condition": np.array(["a", "b"])[setting],
            "height": LEVELS[level],
            "magnitude": np.exp(log),
        }
    )
    frame = drop(frame, random, ("participant", "condition", "height"))
    result = EXPERIMENTS["magnitude"].analyse(frame, math.nan)
    found: Found = {"p": {one.name: one.p for one in result.summarise_findings()}, "held": {}}
    if effect:  # a lapse has no exponent: on average 5 % of it are lost
        (gap,) = result.exponents
        found["held"]["exponent, change"] = gap.low < -0.95 * STEEPER < gap.high
        for index, law in enumerate(result.power_laws):
            truth = 0.95 * (EXPONENT + index * STEEPER)
            found["held"][f"exponent, {index}"] = law.low < truth < law.high
    return found


ANALYSES: dict[str, Callable[[Random, float, bool], Found]] = {
    "estimates": judge_estimates,
    "comparisons": judge_pairs,
    "magnitudes": judge_magnitudes,
    "three": judge_three,
    "factors": judge_factors,
    "groups": judge_pairs_of_groups,
}


def read(name: str) -> list[dict[str, Any]]:
    """Return the outcomes so far."""
    path = OUT / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


class Approximation:
    """The studentized range from statsmodels' approximation, to about 1e-3, 100 times faster."""

    def ppf(self, share: float, levels: int, df: float) -> float:
        return float(qsturng(share, levels, max(df, 2.0)))

    def sf(self, size: float, levels: int, df: float) -> float:
        return float(np.ravel(psturng(size, levels, max(df, 2.0)))[0])


def leave_out() -> None:
    """Leave out what no headline reads: curves of single participants, the paper's F-test."""

    def test(data: Any, response: str, first: str, second: str = "", **more: Any) -> Any:
        return None if second else run_f_test(data, response, first, second, **more)

    comparisons.try_to_fit_curve = lambda who, own: comparisons.Curve(who, (), (), (), None, "")
    accuracy.run_f_test = test
    stats.studentized_range = Approximation()


def work(names: list[str], sizes: dict[int, int]) -> Iterator[str]:
    """Simulate what is not done, in turns."""
    OUT.mkdir(parents=True, exist_ok=True)
    gc.freeze()  # statsmodels collects garbage in every correction for several tests
    leave_out()
    done = {name: {(one["effect"], one["seed"]) for one in read(name)} for name in names}
    for first in range(0, max(sizes.values()), CHUNK):
        for name in names:
            for effect, size in sizes.items():
                left = [
                    seed
                    for seed in range(first, min(first + CHUNK, size))
                    if (effect, seed) not in done[name]
                ]
                for seed in left:
                    random = np.random.default_rng([seed, effect, sorted(ANALYSES).index(name)])
                    bad = bool(seed % 2)
                    line = {"effect": effect, "seed": seed, "bad": bad}
                    line |= ANALYSES[name](random, float(effect), bad)
                    with (OUT / f"{name}.jsonl").open("a") as file:
                        file.write(json.dumps(line, default=bool) + "\n")
                if left:
                    yield f"{name}, {'effects' if effect else 'nulls'}: {left[-1] + 1}"


def summarise(names: list[str]) -> None:
    """Print a table of levels, one of intervals, and one of power."""
    kinds = ((0, "p", "Level"), (1, "held", "Intervals"), (1, "p", "Power"))
    for effect, key, title in kinds:
        print(f"## {title}\n")
        said = "claimed at 5 %" if key == "p" else "hold"
        print(f"| analysis | outcome | studies | {said} | 95 % interval | with a bad participant |")
        print("|---|---|---|---|---|---|")
        for name in names:
            lines = [line for line in read(name) if line["effect"] == effect and line[key]]
            for outcome in dict.fromkeys(label for line in lines for label in line[key]):
                print(format_outcome(name, outcome, lines, key))
        print()


def format_outcome(name: str, outcome: str, lines: list[dict[str, Any]], key: str) -> str:
    """Format the row of an outcome of an analysis: how often it is claimed, or holds."""
    without_bad = list_hits(lines, key, outcome, bad=False)
    with_bad = list_hits(lines, key, outcome, bad=True)
    hits = without_bad + with_bad
    low, high = proportion_confint(sum(hits), len(hits), method="wilson")
    share = f"{np.mean(with_bad):.3f}" if with_bad else ""
    return (
        f"| {name} | {outcome} | {len(hits)} | {np.mean(hits):.3f} | "
        f"{low:.3f} to {high:.3f} | {share} |"
    )


def list_hits(lines: list[dict[str, Any]], key: str, outcome: str, *, bad: bool) -> list[bool]:
    """List of the studies with or without a bad participant whether an outcome is claimed, holds.

    `key` is ``p``, below which it is claimed, or ``held``.
    """
    hits = []
    for line in lines:
        if line["bad"] != bad or outcome not in line[key]:
            continue
        found = line[key][outcome]
        hits.append(found < 0.05 if key == "p" else found)
    return hits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("analyses", nargs="*", help="all when left out")
    parser.add_argument("--nulls", type=int, default=1000)
    parser.add_argument("--effects", type=int, default=500)
    parser.add_argument("--summary", action="store_true", help="only count what is there")
    asked = parser.parse_args()
    names = asked.analyses or list(ANALYSES)
    if not asked.summary:
        for line in work(names, {0: asked.nulls, 1: asked.effects}):
            print(line, flush=True)
    summarise(names)


if __name__ == "__main__":
    main()
