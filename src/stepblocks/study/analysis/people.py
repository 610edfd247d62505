"""Participants whose answers stand out: constant, reversed, copied, hasty or far off."""

import itertools
from collections.abc import Iterator, Mapping
from functools import cache

import numpy as np

from stepblocks.files.tables import Table

HASTE = 0.3  # median reaction time below which nobody can have dragged over an edge [s]
_SURE = 1e-3  # probability of a rank correlation that is no chance
_ROBUST = 1.4826  # standard deviations in a median absolute deviation of normal values
# share of studies of participants alike in which nobody's mean answer stands out
_NOBODY_ALONE = 0.98
_DRAWS = 20_000  # studies by which that bound is found
_FEWEST_OF_GROUP = 5  # participants of whom one may be alone
_OTHER_SCALE = 100.0  # times the heights, from which estimates are of another unit
_SWAPPED_FAR = 5.0  # robust standard deviations of a swapped difference from the others
_SWAPPED_NEAR = 2.0  # ... and from theirs with its sign changed


def describe_unusual_participants(frame: Table, answer: str) -> list[str]:
    """Describe participants whose answers stand out.

    Parameters
    ----------
    frame : DataFrame
        participant, height [m], the answers, and ``reaction_s`` where it was recorded.
    answer : str
        Column of the answers.
    """
    remarks = list[str]()
    means = {}
    for name, judgements in frame.groupby("participant", sort=False):
        means[str(name)] = float(np.mean(judgements[answer].to_numpy(float)))
        remarks += _describe_constant_or_falling_answers(name, judgements, answer)
        remarks += _describe_copied_answers(name, judgements, answer)
        remarks += _describe_haste(name, judgements)
    remarks += _describe_similar_names(list(means))
    if answer == "estimate":
        remarks += _describe_estimates_of_other_scale(frame)
    return remarks + _describe_distant_means(means)


def _describe_similar_names(names: list[str]) -> Iterator[str]:
    """Report names of participants that differ in case or blanks alone."""
    first_by_letters: dict[str, str] = {}
    for name in names:
        letters = "".join(name.lower().split())
        first = first_by_letters.setdefault(letters, name)
        if first != name:
            yield f"Participants {first!r} and {name!r} count as two: are they one person?"


def _describe_estimates_of_other_scale(frame: Table) -> Iterator[str]:
    """Report estimates that are of another order than the heights, as of another unit."""
    ratio = float(np.median(frame["estimate"].to_numpy(float) / frame["height"].to_numpy(float)))
    if not 1.0 / _OTHER_SCALE < ratio < _OTHER_SCALE:
        yield (
            f"Estimates are about {ratio:.2g} times the heights: is the unit of their column right?"
        )


def _describe_constant_or_falling_answers(
    name: object, judgements: Table, answer: str
) -> Iterator[str]:
    """Report a participant who always gives one answer, or lower answers to higher blocks."""
    from scipy.stats import spearmanr

    values = judgements[answer].to_numpy(float)
    heights = judgements["height"].to_numpy(float)
    if np.ptp(values) == 0.0 and len(values) > 2:
        yield f"Participant {name} gave the same answer in all {len(values)} trials."
        return
    if not np.ptp(heights) > 0.0:
        return
    trend = spearmanr(heights, values)
    if trend.statistic < 0.0 and trend.pvalue < _SURE:
        yield (
            f"Participant {name} gave lower answers to higher blocks (rank correlation "
            f"{trend.statistic:.2f}): are the answers or the blocks swapped?"
        )


def _describe_copied_answers(name: object, judgements: Table, answer: str) -> Iterator[str]:
    """Report a participant whose second half of answers repeats the first."""
    answers = judgements.filter(["condition", "height", answer]).to_numpy().tolist()
    half = len(answers) // 2
    if half > 2 and answers == answers[:half] * 2:
        yield (
            f"Participant {name} gave {half} answers twice, in the same order: were they copied?"
        )


def _describe_haste(name: object, judgements: Table) -> Iterator[str]:
    """Report a participant who answered faster than anybody can feel."""
    if "reaction_s" not in judgements:
        return
    median = float(judgements["reaction_s"].median())
    if median < HASTE:
        yield f"Participant {name} answered in haste: median {median:.2f} s."


def _describe_distant_means(means: Mapping[str, float]) -> list[str]:
    """Report participants whose mean answer is far from the median; `means` are by participant."""
    if len(means) < _FEWEST_OF_GROUP:
        return []
    levels = np.array(list(means.values()))
    if (levels > 0.0).all():  # judgements of sizes scatter by factors
        levels = np.log(levels)
    distances = np.abs(levels - np.median(levels))
    wide = _ROBUST * float(np.median(distances))
    if not wide > 0.0:
        return []
    remarks = []
    bound = compute_outlier_distance(len(levels))
    for name, distance in zip(means, distances, strict=True):
        if distance > bound * wide:
            remarks.append(
                f"Participant {name}'s mean answer is {distance / wide:.1f} robust standard "
                "deviations from the median of all."
            )
    return remarks


@cache
def compute_outlier_distance(participant_count: int) -> float:
    """Compute the distance from the median, in robust standard deviations, beyond chance.

    In 98 of 100 studies of so many participants, whose levels are normal, the farthest lies nearer.
    The bound grows where they are few, for the median distance then is uncertain itself.
    """
    levels = np.random.default_rng(0).standard_normal((_DRAWS, participant_count))
    distances = np.abs(levels - np.median(levels, axis=1, keepdims=True))
    farthest = distances.max(axis=1) / (_ROBUST * np.median(distances, axis=1))
    return float(np.quantile(farthest, _NOBODY_ALONE))


def describe_swapped_conditions(table: Table, outcome: str) -> Iterator[str]:
    """Report participants whose difference between two conditions has the opposite sign.

    Parameters
    ----------
    table : DataFrame
        An outcome of each participant (rows) in each condition (columns).
    outcome : str
        Its name.
    """
    for first, second in itertools.combinations(table.columns, 2):
        differences = (table[first] - table[second]).dropna()
        middle = differences.median()
        wide = _ROBUST * (differences - middle).abs().median()
        far = (differences - middle).abs() > _SWAPPED_FAR * wide
        turned = (differences + middle).abs() < _SWAPPED_NEAR * wide
        for who in differences.index[far & turned]:
            yield (
                f"Participant {who}'s {outcome} differs between {first} and {second} as that of "
                "the others, the other way round: are the conditions swapped?"
            )
