"""Trials that went wrong: a second, wider component of the likelihood, with its share."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.problem import Fit, Problem

_WIDTH = 6.0  # of the second component, in standard deviations of the first
_ROUNDS = 50
_FIRST_SHARE = 0.05
_LARGEST_SHARE = 0.5  # of the second component while it is estimated
_MOST_BAD = 0.2  # share of the trials, beyond which it is the model that is wrong
_LARGEST_LOG_ODDS = 500.0  # beyond which the exponential overflows


@dataclass(frozen=True)
class BadTrials:
    """Trials that went wrong.

    Attributes
    ----------
    chance : Floats
        Shape (n,), posterior probability that each trial went wrong.
    share : float
        Estimated share of such trials.
    """

    chance: Floats
    share: float


def estimate_bad_trial_chances(problem: Problem, fitted: Fit) -> BadTrials:
    """Estimate the chance that each trial went wrong, and the share of such trials.

    Parameters
    ----------
    problem : Problem
        Model, trials and noise.
    fitted : Fit
        The model about which the trials scatter.

    Returns
    -------
    BadTrials
        By expectation maximisation (Dempster et al. 1977); all chances are zero where the share
        comes to more than a fifth.
    """
    trials = problem.trials
    square = _compute_squared_distances(problem, fitted)
    freedom = trials.seen.sum(axis=1)
    known = freedom > 0
    # bad trials have widened the scatter that the noise was built from
    typical = np.median(square[known] / stats.chi2.median(freedom[known]))
    square = square / max(1.0, float(typical))
    share = _FIRST_SHARE
    for _ in range(_ROUNDS):
        log_odds = np.log(share / (1.0 - share)) - freedom * np.log(_WIDTH)
        log_odds = log_odds + 0.5 * square * (1.0 - _WIDTH**-2)
        log_odds = np.clip(log_odds, -_LARGEST_LOG_ODDS, _LARGEST_LOG_ODDS)
        chance = np.where(known, 1.0 / (1.0 + np.exp(-log_odds)), 0.0)
        share = float(np.clip(chance[known].mean(), 0.5 / len(trials), _LARGEST_SHARE))
    if share > _MOST_BAD:
        return BadTrials(np.zeros(len(trials)), 0.0)
    return BadTrials(chance, share)


def _compute_squared_distances(problem: Problem, fitted: Fit) -> Floats:
    """Compute the squared whitened distance of each trial from the model, shape (n,)."""
    trials = problem.trials
    difference = np.where(trials.seen, trials.values - fitted.predicted, 0.0)
    # errors that trials share make none of them a bad one
    alone = problem.noise.subtract_shared_errors(difference)
    white = np.einsum("nij,nj->ni", problem.noise.factors, alone)
    return np.asarray(np.sum(white**2, axis=1))
