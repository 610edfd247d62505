"""Adaptive comparisons: each next block is the one expected to be most informative."""

# Placement by the expected entropy of threshold, spread and lapse rate: Watson, A. B. (2017),
# Journal of Vision 17(3):10, doi:10.1167/17.3.10, after Kontsevich, L. L., Tyler, C. W. (1999),
# Vision Research 39, 2729-2737, doi:10.1016/S0042-6989(98)00285-5. What is placed depends on
# answers alone, so that the analysis is that of constant stimuli. A design lists more trials than
# are run; a run takes them in another order.

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.study.analysis.psychometric import MAX_LAPSE, Z75
from stepblocks.study.columns import RATINGS, Row, format_setting_name, read_number_or_nan
from stepblocks.study.experiments.comparisons import read_comparison

_LAPSES = np.linspace(0.0, MAX_LAPSE, 5)
_REACH = np.linspace(-3.0, 3.0, 25)  # of the grid, in standard deviations of the prior
_TINY = 1e-300  # probability of which the logarithm is still finite
_MOST_TRIALS = 10_000.0
_LARGEST = 10.0  # of all other values of a prior [1]


@dataclass(frozen=True)
class Prior:
    """What is known before the first trial, the same in every setting.

    Attributes
    ----------
    equal, equal_factor : float
        Median of the point of subjective equality over the standard, and the factor by which one
        standard deviation changes it [1].
    weber, weber_factor : float
        The same of the Weber fraction [1].
    precision : float
        Posterior standard deviation of ln(spread) in every setting at which a participant is done;
        by default so small that all trials are run [1].
    trials : float
        Most trials of each participant in each setting.
    """

    equal: float = 1.0
    equal_factor: float = 1.25
    weber: float = 0.2
    weber_factor: float = 2.0
    precision: float = 0.01
    trials: float = 60.0


def parse_prior(stated_values: Mapping[str, object]) -> Prior:
    """Check what is stated about a prior, by the names of its values, and complete it.

    Raises
    ------
    StudyError
        If a name is unknown, or a value is out of range.
    """
    known = [value.name for value in fields(Prior)]
    values = {}
    for name, value in stated_values.items():
        if name not in known:
            raise StudyError(f"prior must name {', '.join(known)}, got {name!r}")
        number = read_number_or_nan(str(value))
        lowest, highest = 0.0, _LARGEST
        if name.endswith("factor"):
            lowest = 1.0
        elif name == "trials":
            lowest, highest = 1.0, _MOST_TRIALS
        if not lowest < number < highest:
            raise StudyError(
                f"{name} of a prior must be between {lowest:g} and {highest:g}, got {value!r:.40}"
            )
        values[name] = number
    return replace(Prior(), **values)


class PriorTable(NamedTuple):
    """A prior over one grid of threshold, spread and lapse rate.

    Attributes
    ----------
    probability : ndarray, shape (m, m, 5)
        Of threshold, spread and lapse rate; lapse rates from 0 to 0.1 are equally likely. It does
        not sum to one.
    higher : ndarray, shape (n, m, m, 5)
        Probability of an answer "higher" to each block.
    middles, spreads : ndarray, shape (m,)
        ln(threshold / standard) and ln(spread).
    """

    probability: Array
    higher: Array
    middles: Array
    spreads: Array


@cache
def tabulate_prior(levels: tuple[float, ...], prior: Prior) -> PriorTable:
    """Return the prior, and the probabilities of an answer "higher", over one grid.

    Parameters
    ----------
    levels : tuple of float
        ln(height / standard) of each block.
    prior : Prior
        What is known before the first trial.
    """
    from scipy.special import ndtr

    middles = math.log(prior.equal) + math.log(prior.equal_factor) * _REACH
    log_spread = math.log(math.log1p(prior.weber) / Z75)
    spreads = log_spread + math.log(prior.weber_factor) * _REACH
    distance = np.subtract.outer(np.array(levels), middles)[:, :, np.newaxis]
    rising = ndtr(distance / np.exp(spreads))[..., np.newaxis]
    normal = np.exp(-0.5 * _REACH**2)
    return PriorTable(
        np.outer(normal, normal)[..., np.newaxis] * np.ones(len(_LAPSES)),
        _LAPSES + (1.0 - 2.0 * _LAPSES) * rising,
        middles,
        spreads,
    )


def compute_expected_entropy(posterior: Array, higher: Array) -> Array:
    """Return the expected entropy of the posterior after one more answer to each block.

    Parameters
    ----------
    posterior : ndarray, shape (m, m, 5)
        Of threshold, spread and lapse rate; it need not sum to one.
    higher : ndarray, shape (n, m, m, 5)
        Probability of an answer "higher" to each block.

    Returns
    -------
    ndarray, shape (n,)
        Entropy of each block [1].
    """
    expected = np.zeros(len(higher))
    for likelihood in (higher, 1.0 - higher):
        joint = (likelihood * posterior).reshape(len(higher), -1)
        whole = joint.sum(axis=1)
        expected -= (joint * np.log(joint + _TINY)).sum(axis=1) - whole * np.log(whole)
    # rounded, so that the least is the same on every processor
    return np.asarray(np.round(expected / posterior.sum(), 9))


class _Placement:
    """Where the answers of one participant place the next trial.

    Parameters
    ----------
    planned : sequence of mapping
        Rows of design.csv.
    prior : Prior
        What is known before the first trial.
    """

    def __init__(self, planned: Sequence[Row], prior: Prior) -> None:
        standard = float(planned[0]["standard_height_um"])
        self._precision = prior.precision
        self._heights = sorted({row["height_um"] for row in planned}, key=float)
        levels = []
        for height in self._heights:
            levels.append(math.log(float(height) / standard))
        self._table = tabulate_prior(tuple(levels), prior)
        self._beliefs = {format_setting_name(row): self._table.probability for row in planned}
        self._counts = dict.fromkeys(self._beliefs, 0)  # answered trials of each setting

    @property
    def setting_count(self) -> int:
        """Number of settings."""
        return len(self._counts)

    def update_with_answer(self, row: Row, answer: Row) -> None:
        """Take the answer to a trial into account."""
        setting = format_setting_name(row)
        likelihood = self._table.higher[self._heights.index(row["height_um"])]
        if not read_comparison(row, answer, RATINGS)["higher"]:
            likelihood = 1.0 - likelihood
        self._beliefs[setting] = self._beliefs[setting] * likelihood
        self._counts[setting] += 1

    def is_precise(self) -> bool:
        """Return whether ln(spread) is known well enough in every setting."""
        spreads = self._table.spreads
        variances = []
        for belief in self._beliefs.values():
            weights = belief.sum(axis=(0, 2)) / belief.sum()
            variances.append(weights @ spreads**2 - (weights @ spreads) ** 2)
        return bool(max(variances) <= self._precision**2)

    def choose_next_trial(self, remaining_trials: Sequence[Row], last_height: str) -> Row:
        """Choose the trial that is expected to be most informative; settings take turns.

        No block follows itself where another is left; `last_height` is that of the trial before.
        """
        turn = min(self._counts, key=lambda setting: self._counts[setting])
        entropies = compute_expected_entropy(self._beliefs[turn], self._table.higher)
        expected = dict(zip(self._heights, entropies, strict=True))

        def rank_trial(row: Row) -> tuple[bool, float]:
            """Return what is least of the best trial."""
            return row["height_um"] == last_height, expected[row["height_um"]]

        in_turn = [row for row in remaining_trials if format_setting_name(row) == turn]
        return min(in_turn, key=rank_trial)


def order_trials(planned: Sequence[Row], answers: Sequence[Row], prior: Prior) -> list[Row]:
    """Put the trials of one participant in the order in which the answers so far place them.

    Parameters
    ----------
    planned : sequence of mapping
        Rows of design.csv.
    answers : sequence of mapping
        As they stand in a run's file.
    prior : Prior
        What is known before the first trial.

    Returns
    -------
    list of mapping
        The answered trials; then, unless there are as many as wanted or the answers are precise
        enough, the one that is next, and others for practice.
    """
    left = {row["trial"]: row for row in planned}
    done = []
    for answer in answers:
        if answer["trial"] in left:
            done.append(left.pop(answer["trial"]))
    placement = _Placement(planned, prior)
    for row, answer in zip(done, answers, strict=False):
        placement.update_with_answer(row, answer)
    limit = int(prior.trials) * placement.setting_count
    if len(done) >= limit or placement.is_precise():
        return done
    last_height = ""
    if done:
        last_height = done[-1]["height_um"]
    best = placement.choose_next_trial(list(left.values()), last_height)
    left.pop(best["trial"])
    return [*done, best, *left.values()][:limit]
