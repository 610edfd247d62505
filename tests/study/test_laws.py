"""Laws that hold for any study: units, order, names."""

import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad
from scipy.stats import cauchy, nct, t as student

from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.analysis.people import describe_unusual_participants
from stepblocks.study.analysis.psychometric import fit_psychometric
from stepblocks.study.analysis.repeated import (
    assess_contrast_effect,
    compare_conditions_within_participants,
    compute_null_bayes_factor,
)
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.trials import design_trials

seeds = st.integers(0, 10_000)
bounded = settings(max_examples=4, deadline=None)


def judged(seed, people=5, conditions=("a", "b", "c")):
    random = np.random.default_rng(seed)
    index = np.indices((people, len(conditions), 2, 2)).reshape(4, -1)
    value = random.standard_normal(index.shape[1]) + random.standard_normal(people)[index[0]]
    return pd.DataFrame(
        {
            "participant": index[0].astype(str),
            "condition": np.array(conditions)[index[1]],
            "stimulus": index[2].astype(str),
            "height": 25e-6 * (1 + index[2]),
            "error": value * 1e-6,
            "value": value,
        }
    )


def fitted(frame):
    return fit_mixed_model(frame, "value", "condition", "participant", "stimulus")


@bounded
@given(seed=seeds)
def test_the_order_of_the_rows_moves_no_test(seed):
    frame = judged(seed)
    one, other = fitted(frame), fitted(frame.sample(frac=1.0, random_state=seed))
    assert other.condition.f == pytest.approx(one.condition.f, rel=1e-7)


@bounded
@given(seed=seeds)
def test_names_of_participants_move_no_test(seed):
    frame = judged(seed)
    other = frame.assign(participant=frame["participant"].map(lambda who: f"z{9 - int(who)}"))
    assert fitted(other).condition.f == pytest.approx(fitted(frame).condition.f, rel=1e-7)


@bounded
@given(seed=seeds, shift=st.floats(-50.0, 50.0))
def test_a_constant_error_of_all_moves_no_contrast(seed, shift):
    frame = judged(seed)
    table = frame.groupby(["participant", "condition"])["value"].mean().unstack()
    pairs = zip(
        compare_conditions_within_participants(table),
        compare_conditions_within_participants(table + shift),
        strict=True,
    )
    for a, b in pairs:
        assert b.difference == pytest.approx(a.difference, abs=1e-9)


@bounded
@given(seed=seeds)
def test_epsilon_lies_between_one_over_its_contrasts_and_one(seed):
    from scipy.linalg import helmert

    table = np.random.default_rng(seed).standard_normal((7, 4)) * [1.0, 2.0, 4.0, 8.0]
    term, found = assess_contrast_effect("x", table, helmert(4))
    assert 1.0 / 3.0 <= found.epsilon <= found.huynh_feldt <= 1.0
    assert term.df == pytest.approx(3.0 * found.huynh_feldt)


@bounded
@given(people=st.integers(3, 60), t=st.floats(0.0, 6.0), more=st.floats(0.1, 3.0))
def test_the_bayes_factor_of_no_difference_falls_with_student_s_t(people, t, more):
    one, other = compute_null_bayes_factor(t, people), compute_null_bayes_factor(t + more, people)
    assert one > other > 0.0
    assert compute_null_bayes_factor(-t, people) == pytest.approx(one, rel=1e-9)


@bounded
@given(seed=seeds, unit=st.sampled_from([1e-3, 1.0, 1e6]))
def test_the_unit_of_heights_scales_a_threshold_and_no_weber_fraction(seed, unit):
    levels = np.array([30.0, 40.0, 47.0, 53.0, 62.0, 80.0])
    share = 1.0 / (1.0 + np.exp(-6.0 * np.log(levels / 50.0)))
    hits = np.random.default_rng(seed).binomial(40, share)
    one, other = (fit_psychometric(levels * s, hits.tolist(), [40] * 6) for s in (1.0, unit))
    assert other.threshold[0] == pytest.approx(one.threshold[0] * unit, rel=1e-4)
    assert other.weber[0] == pytest.approx(one.weber[0], rel=1e-3)


@bounded
@given(seed=seeds, people=st.integers(2, 9), repetitions=st.integers(1, 3))
def test_a_design_holds_every_cell_as_often_for_everybody(seed, people, repetitions):
    blocks = [Item(f"s{n}", f"S{n}", n * 1e-5) for n in (2, 4, 6)]
    factors = {"probe": ("a", "b"), "load": ("x", "y")}
    design = design_trials("estimates", people, blocks, repetitions, seed, factors=factors)
    cells = pd.DataFrame(design.trials).groupby(["participant", "condition", "stimulus"]).size()
    assert len(cells) == people * 4 * 3
    assert (cells == repetitions).all()


def test_f_of_conditions_is_that_of_an_analysis_of_variance_with_repeated_measures():
    # origin: AnovaRM of statsmodels on the same table
    from scipy.linalg import helmert
    from statsmodels.stats.anova import AnovaRM

    table = np.random.default_rng(5).normal([0.0, 0.4, 0.9, 1.1], 0.7, (8, 4))
    frame = pd.DataFrame(
        [(i, j, table[i, j]) for i in range(8) for j in range(4)], columns=["who", "what", "value"]
    )
    (row,) = AnovaRM(frame, "value", "who", within=["what"]).fit().anova_table.to_dict("records")
    term, _ = assess_contrast_effect("x", table, helmert(4))
    assert term.f == pytest.approx(row["F Value"], rel=1e-9)


def test_two_participants_are_compared_and_one_is_not():
    # differences 1 and 3: mean 2, standard error 1, one degree of freedom
    table = pd.DataFrame({"a": [2.0, 5.0], "b": [1.0, 2.0]})
    (pair,) = compare_conditions_within_participants(table)
    assert (pair.difference, pair.df) == (2.0, 1.0)
    assert compare_conditions_within_participants(table[:1]) == ()


@pytest.mark.parametrize(("t", "people"), [(0.0, 10), (1.2, 10), (2.5, 6), (3.4, 25)])
def test_the_bayes_factor_is_that_of_the_noncentral_t_under_a_cauchy_prior(t, people):
    # independent: Student's noncentral t of scipy over the effect sizes of Rouder et al. 2009
    df, root = people - 1, np.sqrt(people)

    def likelihood(d):
        return nct.pdf(t, df, d * root) * cauchy.pdf(d, scale=np.sqrt(0.5))

    under_difference = quad(likelihood, -8.0, 8.0, limit=400, points=[0.0, t / root])[0]
    assert compute_null_bayes_factor(t, people) == pytest.approx(
        student.pdf(t, df) / under_difference, rel=1e-3
    )


def test_one_height_alone_gives_no_participant_a_trend():
    frame = pd.DataFrame(
        {"participant": ["1"] * 4, "height": [50e-6] * 4, "estimate_um": [40.0, 45.0, 55.0, 60.0]}
    )
    with warnings.catch_warnings(action="error"):
        assert describe_unusual_participants(frame, "estimate_um") == []


@pytest.mark.parametrize(
    ("factor", "named"), [(0.5, True), (0.9, False), (1.1, False), (2.0, True)]
)
def test_who_answers_far_below_the_others_is_named_like_who_answers_far_above(factor, named):
    # Ten others lie within 4 % of their median, 2 % in the middle: a half or a double is 23 robust
    # standard deviations of the logarithm away, a tenth more or less 3.2 to 3.6.
    steps = np.array([-4.0, -3.0, -2.0, -1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0])
    others = 50.0 * np.exp(0.01 * steps)
    estimates = [*others, 50.0 * factor]
    names = list("abcdefghijk")
    frame = pd.DataFrame({"participant": names, "height": 50e-6, "estimate_um": estimates})
    found = describe_unusual_participants(frame, "estimate_um")
    assert len(found) == named
    assert all(note.startswith("Participant k's mean answer is ") for note in found)
