"""Run sheets filled in by simulated participants."""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd

from stepblocks.study.columns import Row, collect_levels_of_trial, group_rows_by_participant
from stepblocks.study.design.adaptive import Prior, order_trials
from stepblocks.study.design.sheet import make_blinded_row
from stepblocks.study.design.simulate import Observer
from stepblocks.study.experiments.registry import EXPERIMENTS


def simulate_answers(
    design: Sequence[Row],
    energies: Mapping[str, float],
    damping: Mapping[str, float],
    observer: Observer,
    seed: int,
    noise_factors: Mapping[str, float] = MappingProxyType({}),
) -> list[dict[str, str]]:
    """Fill in the run sheets of a design by simulation.

    Parameters
    ----------
    design : sequence of mapping
        Rows of design.csv.
    energies : mapping of float
        Energy of each block [J].
    damping, noise_factors : mapping of float
        Share of the energy that a level of a factor lets through, and how many times the response
        noise it has [1]; 1 where not named.
    observer : Observer
        What participants are like.
    seed : int
        Of all chance.

    Returns
    -------
    list of dict
        Rows of blinded run sheets with answers.
    """
    planned = pd.DataFrame(design)
    shares = [_multiply_level_factors(row, damping) for row in design]
    undamped = planned["stimulus"].map(energies)
    person, _ = pd.factorize(planned["participant"])
    setting, _ = pd.factorize(planned["condition"])
    trials = planned.assign(
        person=person,
        setting=setting,
        height=planned["height_um"].astype(float) * 1e-6,
        undamped=undamped,
        # both blocks of a pair are felt with the same probe
        energy=undamped * shares,
        standard_energy=planned["standard"].map(energies) * shares,
        noisier=[_multiply_level_factors(row, noise_factors) for row in design],
    )
    kind = EXPERIMENTS[design[0]["experiment"]]
    answers = kind.simulate(trials, observer, np.random.default_rng(seed))
    rows = []
    for row, texts in zip(design, answers, strict=True):
        rows.append({**make_blinded_row(row), **dict(zip(kind.answers, texts, strict=True))})
    return rows


def _multiply_level_factors(row: Row, factors: Mapping[str, float]) -> float:
    """Return the product of the factors of all levels of a trial; 1 where not named."""
    return math.prod(factors.get(level, 1.0) for level in collect_levels_of_trial(row))


def iterate_adaptively_ordered_answers(
    design: Sequence[dict[str, str]], answers: Sequence[dict[str, str]], prior: Prior
) -> Iterator[dict[str, str]]:
    """Yield answers in the order in which an adaptive design runs the trials.

    Answers to trials that it does not run are left out.
    """
    answer_to = {(row["participant"], row["trial"]): row for row in answers}
    for who, planned in group_rows_by_participant(design).items():
        answered = list[dict[str, str]]()
        order = order_trials(planned, answered, prior)
        while len(order) > len(answered):
            following = order[len(answered)]
            answered.append(answer_to[who, following["trial"]])
            order = order_trials(planned, answered, prior)
        yield from answered
