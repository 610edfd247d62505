"""Comparisons of which each next block is the one that is expected to say most."""

# Placement by the expected entropy of threshold, spread and lapse rate: Watson, A. B. (2017),
# Journal of Vision 17(3):10, doi:10.1167/17.3.10, after Kontsevich, L. L., Tyler, C. W. (1999),
# Vision Research 39, 2729-2737, doi:10.1016/S0042-6989(98)00285-5. What is placed depends on
# answers alone, so that the analysis is that of constant stimuli. A design lists more trials than
# are run; a run takes them in another order.

import math
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from stepblocks.study import RATINGS, Array, require
from stepblocks.study.analysis.psychometric import MAX_LAPSE, Z75
from stepblocks.study.design.experiments import EXPERIMENTS, Row, read_number
from stepblocks.study.design.trials import name_setting

_LAPSES = np.linspace(0.0, MAX_LAPSE, 5)
_REACH = np.linspace(-3.0, 3.0, 25)  # of the grid, in standard deviations of the prior

# Medians of the point of subjective equality over the standard and of the Weber fraction, with the
# factors by which one standard deviation changes them; the posterior standard deviation of
# ln(spread) in every setting at which a participant is done, so small that all trials are run; and
# the most trials of each participant in each setting.
PRIOR = {
    "equal": 1.0,
    "equal_factor": 1.25,
    "weber": 0.2,
    "weber_factor": 2.0,
    "precision": 0.01,
    "trials": 60.0,
}


def complete_prior(stated: Mapping[str, object]) -> dict[str, float]:
    """Check what is known before the first trial, and complete it by `PRIOR`."""
    for name, value in stated.items():
        require(name in PRIOR, f"prior must name {', '.join(PRIOR)}, got {name!r}")
        least = 1.0 if name.endswith("factor") or name == "trials" else 0.0
        most = 10_000.0 if name == "trials" else 10.0
        require(
            least < read_number(str(value)) < most,
            f"{name} of a prior must be between {least:g} and {most:g}, got {value!r:.40}",
        )
    return PRIOR | {name: float(str(value)) for name, value in stated.items()}


@cache
def tabulate_prior(levels: tuple[float, ...], prior: tuple[float, ...]) -> tuple[Array, ...]:
    """Return the prior, and the probabilities of an answer "higher", over one grid.

    Parameters
    ----------
    levels : tuple of float
        ln(height / standard) of each block.
    prior : tuple of float
        Values of `PRIOR`, in its order.

    Returns
    -------
    prior : ndarray, shape (m, m, 5)
        Of threshold, spread and lapse rate; lapse rates from 0 to 0.1 are equally likely.
    higher : ndarray, shape (n, m, m, 5)
        Of each block.
    middles, spreads : ndarray, shape (m,)
        ln(threshold / standard) and ln(spread).
    """
    from scipy.special import ndtr

    equal, equal_factor, weber, weber_factor = prior[:4]
    middles = math.log(equal) + math.log(equal_factor) * _REACH
    spreads = math.log(math.log1p(weber) / Z75) + math.log(weber_factor) * _REACH
    away = np.subtract.outer(np.array(levels), middles)[:, :, np.newaxis]
    rising = ndtr(away / np.exp(spreads))[..., np.newaxis]
    normal = np.exp(-0.5 * _REACH**2)
    return (
        np.outer(normal, normal)[..., np.newaxis] * np.ones(len(_LAPSES)),
        _LAPSES + (1.0 - 2.0 * _LAPSES) * rising,
        middles,
        spreads,
    )


def compute_expected_entropy(posterior: Array, higher: Array) -> Array:
    """Return the expected entropy [1] of the posterior after one more answer to each block."""
    expected = np.zeros(len(higher))
    for likelihood in (higher, 1.0 - higher):
        joint = (likelihood * posterior).reshape(len(higher), -1)
        whole = joint.sum(axis=1)
        expected -= (joint * np.log(joint + 1e-300)).sum(axis=1) - whole * np.log(whole)
    # rounded, so that the least is the same on every processor
    return np.asarray(np.round(expected / posterior.sum(), 9))


def order_trials(
    planned: Sequence[Row], answers: Sequence[Row], prior: Mapping[str, float]
) -> list[Row]:
    """Put the trials of one participant in the order in which the answers so far place them.

    Parameters
    ----------
    planned : sequence of mapping
        Rows of design.csv.
    answers : sequence of mapping
        As they stand in a run's file.
    prior : mapping of float
        As `complete_prior` returns it, the same in every setting.

    Returns
    -------
    list of mapping
        The answered trials; then, unless there are as many as wanted or the answers are precise
        enough, the one that is next, and others for practice.
    """
    left = {row["trial"]: row for row in planned}
    trials = int(prior["trials"])
    done = [left.pop(row["trial"]) for row in answers if row["trial"] in left]
    names = sorted({row["height_um"] for row in planned}, key=float)
    standard = float(planned[0]["standard_height_um"])
    before, higher, _, spreads = tabulate_prior(
        tuple(math.log(float(name) / standard) for name in names), tuple(prior.values())
    )
    beliefs = {name_setting(row): before for row in planned}
    counts = dict.fromkeys(beliefs, 0)
    for row, answer in zip(done, answers, strict=False):
        setting = name_setting(row)
        given = EXPERIMENTS["adaptive"].read(row, answer, RATINGS)
        own = higher[names.index(row["height_um"])]
        beliefs[setting] = beliefs[setting] * (own if given["higher"] else 1.0 - own)
        counts[setting] += 1
    weights = [belief.sum(axis=(0, 2)) / belief.sum() for belief in beliefs.values()]
    errors = [own @ spreads**2 - (own @ spreads) ** 2 for own in weights]
    if len(done) >= trials * len(counts) or max(errors) <= prior["precision"] ** 2:
        return done
    turn = min(counts, key=lambda setting: counts[setting])  # settings take turns
    expected = dict(zip(names, compute_expected_entropy(beliefs[turn], higher), strict=True))
    best = min(
        (row for row in left.values() if name_setting(row) == turn),
        key=lambda row: (
            row["height_um"] == done[-1]["height_um"] if done else 0,
            expected[row["height_um"]],
        ),
    )
    return [*done, best, *(row for row in left.values() if row is not best)][: trials * len(counts)]
