"""Trials that went wrong: a second component of the likelihood, six times as wide, with a share."""

import numpy as np
from scipy import stats

from stepblocks.lawsearch.fit import Fit, Problem
from stepblocks.lawsearch.forward_model import Floats

_WIDTH = 6.0  # of the second component in scatters of the first
_ROUNDS = 50
_MOST = 0.2  # share of the trials, beyond which it is the model that is wrong


def find_bad_trials(problem: Problem, fitted: Fit) -> tuple[Floats, float]:
    """Estimate the chance that each trial went wrong, and the share of such trials.

    Parameters
    ----------
    problem : Problem
        Model, trials and noise.
    fitted : Fit
        The model about which the trials scatter.

    Returns
    -------
    chance : array of shape (n,)
        Posterior probability by expectation maximisation (Dempster et al. 1977), zero of all where
        the share comes to more than a fifth.
    share : float
        Estimated share of the wide component.
    """
    trials, factors = problem.trials, problem.noise.factors
    # what trials share makes none of them a bad one
    difference = problem.noise.subtract_shared(
        np.where(trials.seen, trials.values - fitted.predicted, 0.0)
    )
    square = np.sum(np.einsum("nij,nj->ni", factors, difference) ** 2, axis=1)
    freedom = trials.seen.sum(axis=1)
    known = freedom > 0
    # bad trials have widened the scatter that the noise was built from
    square = square / max(1.0, float(np.median(square[known] / stats.chi2.median(freedom[known]))))
    share = 0.05
    for _ in range(_ROUNDS):
        odds = np.log(share / (1.0 - share)) - freedom * np.log(_WIDTH)
        odds = odds + 0.5 * square * (1.0 - _WIDTH**-2)
        chance = np.where(known, 1.0 / (1.0 + np.exp(-np.clip(odds, -500.0, 500.0))), 0.0)
        share = float(np.clip(chance[known].mean(), 0.5 / len(trials), 0.5))
    return (chance, share) if share <= _MOST else (np.zeros(len(trials)), 0.0)
