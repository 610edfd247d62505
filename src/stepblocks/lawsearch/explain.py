"""Explain trials: find what a model lacks, with trials that went wrong held apart."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from stepblocks.lawsearch.adequacy import depends_on_covariates
from stepblocks.lawsearch.findings import BadTrial, Explanation, Rules
from stepblocks.lawsearch.fit import build_problem
from stepblocks.lawsearch.forward_model import ForwardModel, Trials
from stepblocks.lawsearch.judge import judge_search
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.mixture import estimate_bad_trial_chances
from stepblocks.lawsearch.scatter import mark_outliers
from stepblocks.lawsearch.search import DeployedErrorFunction, search_effects_and_structure

_BAD = 0.5  # chance that a trial went wrong, from which it is held apart
_ROUNDS = 3
_MOST_APART = 0.2  # share of the trials


def explain(
    model: ForwardModel,
    trials: Trials | pd.DataFrame,
    candidates: Sequence[Law],
    rules: Rules | None = None,
    deployed: DeployedErrorFunction | None = None,
    announce: Callable[[str], None] | None = None,
) -> Explanation:
    """Find what a model lacks, with trials that went wrong held apart.

    Parameters
    ----------
    model : ForwardModel
        Predicts all channels of a table, and names its parameters and what scatters among trials.
    trials : Trials or DataFrame
        What was set and what was measured; a table as `Trials.from_table` takes it.
    candidates : sequence of Law
        Effects that are tried.
    rules : Rules, optional
        When to claim what.
    deployed : callable, optional
        Error of a fit where it is to be used; the search ends where it no longer falls.
    announce : callable, optional
        Receives what is tried, in words.

    Returns
    -------
    Explanation
        Verdict, findings, nominal and extended fit.

    Raises
    ------
    PipelineError
        If there are fewer than 12 trials.
    """
    rules = rules or Rules()
    if not isinstance(trials, Trials):
        trials = Trials.from_table(trials)
    trials, wild_rows = _remove_wild_readings(trials, rules.wild)
    problem = build_problem(model, trials)
    found = search_effects_and_structure(problem, candidates, rules, deployed, announce)
    apart: dict[int, float] = {}
    for _ in range(_ROUNDS):
        chance = estimate_bad_trial_chances(found.problem, found.extended).chance
        bad = np.flatnonzero(chance > _BAD)
        if not bad.size or len(apart) + bad.size > _MOST_APART * len(trials):
            break
        # what goes wrong under some settings alone is what the model lacks
        if depends_on_covariates(chance, trials):
            break
        apart |= dict(zip(bad.tolist(), chance[bad].tolist(), strict=True))
        trials = trials.without(list(apart))
        problem = build_problem(model, trials)
        found = search_effects_and_structure(problem, candidates, rules, deployed, announce)
    explanation = judge_search(found, candidates, rules)
    for row in wild_rows:
        apart.setdefault(row, 1.0)
    bad_trials = []
    for row in sorted(apart):
        bad_trials.append(BadTrial(row, apart[row]))
    return replace(explanation, apart=tuple(bad_trials))


def _remove_wild_readings(trials: Trials, threshold: float) -> tuple[Trials, list[int]]:
    """Leave out single readings far from any smooth function of the conditions.

    The other readings of their trials count. What is wild under some settings alone is what a
    model lacks, and stays.

    Parameters
    ----------
    trials : Trials
    threshold : float
        Robust standard deviations from which a reading is left out.

    Returns
    -------
    trials : Trials
    rows : list of int
        Trials with such a reading.
    """
    wild = mark_outliers(trials, threshold)
    is_wild = np.asarray(wild.any(axis=1), dtype=np.float64)
    rows = np.flatnonzero(is_wild)
    if not rows.size or depends_on_covariates(is_wild, trials):
        return trials, []
    return replace(trials, values=np.where(wild, np.nan, trials.values)), rows.tolist()
