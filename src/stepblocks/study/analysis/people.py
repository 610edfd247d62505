"""Participants who answer unlike the others: constant, the wrong way round, in haste, alone."""

import itertools
from collections.abc import Iterator

import numpy as np

from stepblocks.study import Table

HASTE = 0.3  # median reaction time below which nobody can have dragged over an edge [s]


def describe_unlike_participants(frame: Table, answer: str) -> list[str]:
    """Say which participants answer unlike the others, and how.

    Parameters
    ----------
    frame : DataFrame
        participant, height, the answers, and ``reaction_s`` where it was recorded.
    answer : str
        Column of the answers.
    """
    from scipy.stats import spearmanr

    found, middles = list[str](), {}
    for name, own in frame.groupby("participant", sort=False):
        values, heights = own[answer].to_numpy(float), own["height"].to_numpy(float)
        middles[name] = float(np.mean(values))
        if np.ptp(values) == 0.0 and len(values) > 2:
            found.append(f"Participant {name} gave the same answer in all {len(values)} trials.")
        elif np.ptp(heights) > 0.0:
            trend = spearmanr(heights, values)
            if trend.statistic < 0.0 and trend.pvalue < 1e-3:
                found.append(
                    f"Participant {name} gave lower answers to higher blocks (rank correlation "
                    f"{trend.statistic:.2f}): are the answers or the blocks swapped?"
                )
        answers = own.filter(["condition", "height", answer]).to_numpy().tolist()
        half = len(answers) // 2
        if half > 2 and answers == answers[:half] * 2:
            found.append(
                f"Participant {name} gave {half} answers twice, in the same order: were they "
                "copied?"
            )
        if "reaction_s" in own and (haste := float(own["reaction_s"].median())) < HASTE:
            found.append(f"Participant {name} answered in haste: median {haste:.2f} s.")
    level = np.array(list(middles.values()))
    apart = np.abs(level - np.median(level))
    # Iglewicz, B., Hoaglin, D. C. (1993): 3.5 robust standard deviations
    wide = 1.4826 * float(np.median(apart))
    return found + [
        f"Participant {name}'s mean answer is {far / wide:.1f} robust standard deviations from "
        "the median of all."
        for name, far in zip(middles, apart, strict=True)
        if len(level) > 4 and far > 3.5 * wide > 0.0
    ]


def find_swapped_conditions(table: Table, outcome: str) -> Iterator[str]:
    """Say who differs between two conditions (columns) as all others do the other way round."""
    for first, second in itertools.combinations(table.columns, 2):
        apart = (table[first] - table[second]).dropna()
        middle = apart.median()
        wide = 1.4826 * (apart - middle).abs().median()
        turned = (apart - middle).abs() > 5.0 * wide
        for who in apart.index[turned & ((apart + middle).abs() < 2.0 * wide)]:
            yield (
                f"Participant {who}'s {outcome} differs between {first} and {second} as that of "
                "the others, the other way round: are the conditions swapped?"
            )
