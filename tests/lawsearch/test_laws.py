"""Laws of the search on a toy: mirror, order, labels and units leave what it finds as it is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from oracles.toy_model import Toy, toy_effects, toy_trials
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.gate import Gate, score_candidates
from stepblocks.lawsearch.law import Law, Parameter

FEW = settings(max_examples=8, deadline=None, derandomize=True)
SEEDS, SIZES = st.integers(1, 1000), st.floats(0.1, 0.4)


def score(trials, effects=None, draws=0) -> Gate:
    problem = build_problem(Toy(), trials)
    return score_candidates(
        problem, fit_with_effects(problem), effects or toy_effects(), draws=draws
    )


def gains(gate: Gate) -> dict[str, float]:
    return {one.effect.id: one.gain for one in gate.scores}


def turn_over(trials):
    """Turn the deviations from a + b x, which the model fits exactly, over."""
    nominal = 1.0 + 2.0 * trials.covariates["x"]
    return replace(
        trials, values=2.0 * np.stack([nominal, np.full(len(trials), 2.0)], 1) - trials.values
    )


def only_adds() -> Law:
    """A law of the square of z whose size may not be negative."""
    law = toy_effects()[0]
    return replace(law, parameters=(Parameter("size", "1", 0.0, 0.0, 10.0, 0.1),))


@FEW
@given(SEEDS, SIZES)
def test_a_law_of_either_sign_is_scored_alike_where_the_deviations_are_turned_over(seed, size):
    trials = toy_trials(48, seed, square=size)
    one, other = score(trials, draws=100), score(turn_over(trials), draws=100)
    assert gains(other) == pytest.approx(gains(one), rel=1e-6, abs=1e-9)
    assert gains(one)["square_of_z"] > 0.0
    # noise is as likely to lie on either side
    assert other.p_value == pytest.approx(one.p_value, abs=0.05)


@FEW
@given(SEEDS)
def test_a_law_that_only_adds_gains_nothing_where_something_is_missing(seed):
    trials = toy_trials(96, seed, square=0.5)
    more, less = (gains(score(one, [only_adds()])) for one in (trials, turn_over(trials)))
    assert more["square_of_z"] > 10.0
    assert less == {"square_of_z": 0.0}
    either = gains(score(trials, toy_effects()[:1]))
    assert more == pytest.approx(either)


@FEW
@given(SEEDS, st.randoms(use_true_random=False))
def test_the_order_of_the_trials_moves_no_score(seed, random):
    trials = toy_trials(48, seed, square=0.3)
    rows = np.array(random.sample(range(48), 48))
    assert gains(score(trials.take(rows))) == pytest.approx(gains(score(trials)), rel=1e-6)


@FEW
@given(SEEDS, st.permutations(["p", "q", "r", "s"]))
def test_the_names_of_the_blocks_move_no_score(seed, names):
    trials = toy_trials(48, seed, square=0.3)
    renamed = dict(zip(["p", "q", "r", "s"], names, strict=True))
    block = np.array([renamed[one] for one in trials.block.tolist()])
    assert gains(score(replace(trials, block=block))) == pytest.approx(
        gains(score(trials)), rel=1e-6
    )


@FEW
@given(SEEDS, st.floats(1e-6, 1e6))
def test_the_unit_of_a_covariate_moves_no_score(seed, factor):
    trials = toy_trials(48, seed, square=0.3)
    columns = {**trials.covariates, "w": trials.covariates["w"] * factor}
    lines = toy_effects()[2:3]
    size = replace(lines[0].parameters[0], scale=0.1 / factor, low=-1e9, high=1e9)
    (other,) = gains(
        score(replace(trials, covariates=columns), [replace(lines[0], parameters=(size,))])
    ).values()
    (one,) = gains(score(trials, lines)).values()
    assert other == pytest.approx(one, rel=1e-6, abs=1e-9)


@FEW
@given(SEEDS, st.permutations(range(4)))
def test_the_order_of_the_candidates_moves_no_score(seed, order):
    trials, laws = toy_trials(48, seed, square=0.3), toy_effects()
    one, other = score(trials, laws), score(trials, [laws[place] for place in order])
    assert gains(other) == pytest.approx(gains(one), rel=1e-9)
    assert [found.effect.id for found in other.scores[:1]] == [
        found.effect.id for found in one.scores[:1]
    ]
