"""Adaptive sessions: resumable from the answers alone, blinded, unbiased where the blocks can tell."""

import math

import numpy as np
import pytest
from scipy.special import ndtr

from stepblocks.errors import StudyError
from stepblocks.study.session import METHODS, Plan, QuestPlus, Session

HEIGHTS = {f"B{height}": height * 1e-6 for height in range(20, 81, 4)}


def plan(method="quest", **changes):
    given = {
        "method": method,
        "heights": HEIGHTS,
        "standard": "B48",
        "trials": 50,
        "reversals": 12,
        "seed": 3,
    }
    return Plan(**(given | changes))


def answered(session, spread, seed, equal=48e-6):
    generator = np.random.default_rng(seed)
    while (pair := session.next_pair()) is not None:
        compared = pair.first if pair.second == session.plan.standard else pair.second
        higher = bool(generator.random() < ndtr(math.log(HEIGHTS[compared] / equal) / spread))
        session.record(pair.trial, higher == (compared == pair.second))
    return session


@pytest.mark.parametrize("method", METHODS)
def test_a_session_played_again_from_its_answers_goes_on_with_the_same_pair(method):
    whole = answered(Session(plan(method), 2), 0.25, 9)
    again = Session(plan(method), 2)
    for pair, second in whole.answers[:17]:
        assert again.next_pair() == pair
        again.record(pair.trial, second)
    assert again.next_pair() == whole.answers[17][0]


def test_the_standard_comes_first_about_as_often_as_second_and_others_see_another_order():
    first = [
        pair.first == "B48" for pair, _ in answered(Session(plan(trials=60), 1), 0.25, 1).answers
    ]
    other = [
        pair.first == "B48" for pair, _ in answered(Session(plan(trials=60), 2), 0.25, 1).answers
    ]
    assert 15 <= sum(first) <= 45  # beyond 4 standard deviations of a fair coin
    assert first != other


def test_quest_recovers_a_shifted_observer_and_its_intervals_hold():
    # 24 observers of PSE 52 um, sigma 0.25; 95 % intervals that hold miss more than 4 of 24 once in
    # 200 times
    found = [
        answered(Session(plan(trials=70), n), 0.25, 100 + n, 52e-6).estimate() for n in range(1, 25)
    ]
    true = math.expm1(0.6744897501960817 * 0.25)
    logs = np.log([one["weber_ratio"] / true for one in found])
    assert abs(logs.mean()) < 3.0 * logs.std(ddof=1) / math.sqrt(24) + 0.05
    assert np.mean([one["equal_um"] for one in found]) == pytest.approx(52.0, rel=0.02)
    assert (
        sum(not one["weber_low_95_ratio"] < true < one["weber_high_95_ratio"] for one in found) <= 4
    )
    assert sum(not one["equal_low_95_um"] < 52.0 < one["equal_high_95_um"] for one in found) <= 4


def test_a_staircase_finds_the_threshold_that_its_blocks_straddle_and_says_when_they_do_not():
    found = [
        answered(Session(plan("staircase", trials=400, reversals=24), n), 0.6, n).estimate()
        for n in range(1, 21)
    ]
    logs = np.log([one["weber_ratio"] / math.expm1(0.6744897501960817 * 0.6) for one in found])
    assert abs(logs.mean()) < 0.15
    with pytest.raises(StudyError, match="rests on its lowest block"):
        answered(Session(plan("staircase", trials=400), 1), 0.05, 1).estimate()


def test_a_guess_tied_to_lapses_makes_the_two_answers_mirror_images():
    # who lapses errs to either side: P(hit at -x) = 1 - P(hit at x), so opposite answers give
    # opposite thresholds
    grid = ([-1.0, 0.0, 1.0], np.linspace(-1.0, 1.0, 21), [0.3, 0.6], [0.0, 0.1])
    one, two = QuestPlus(*grid), QuestPlus(*grid)
    for level, hit in ((1.0, True), (0.0, True), (-1.0, False), (1.0, False)):
        one.record(level, hit)
        two.record(-level, not hit)
    assert one.quantile(0, 0.3) == pytest.approx(-two.quantile(0, 0.7), abs=1e-12)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: plan("guess"), "method must be one of quest, staircase"),
        (lambda: plan(standard="B99"), "standard must be one of the blocks"),
        (
            lambda: plan("staircase", standard="B76"),
            "needs at least 2 blocks higher than the standard, got 1",
        ),
        (lambda: plan(trials=0), "trials, reversals and seed must be at least 1, 4 and 0"),
        (lambda: plan(heights=HEIGHTS | {"C": HEIGHTS["B20"]}), "must differ in height"),
        (
            lambda: Session(plan(), 1).record(2, True),
            "trial must be 1, the next of participant 1, got 2",
        ),
        (
            lambda: answered(Session(plan(trials=3), 1), 0.2, 1).record(4, True),
            "is done after 3 trials, got trial 4",
        ),
    ],
)
def test_an_impossible_session_is_refused(make, said):
    with pytest.raises(StudyError, match=said):
        make()


def test_training_keeps_a_trainee_at_three_of_four():
    """Kaernbach's weighted up-down: one step down for a right answer, three up for a wrong one, rest where p = 3/4."""
    generator = np.random.default_rng(5)
    ease = {
        f"B{n:02}": 0.05 * n for n in range(1, 41)
    }  # fine levels, so that no end of the list is reached
    heights = {code: 50e-6 + (n % 2 * 2 - 1) * 1e-6 * (n + 1) for n, code in enumerate(ease)} | {
        "S": 50e-6
    }
    plan = Plan("training", heights, "S", trials=4000, reversals=4, seed=1, ease=ease)
    assert plan.compared == tuple(
        ease
    )  # in the order of the predicted discriminability, whichever side of the standard
    session, right = Session(plan, 1), []
    while (pair := session.next_pair()) is not None:
        code = pair.beside("S")
        known = generator.random() < 0.5 + 0.5 * (1.0 - np.exp(-ease[code]))
        truth = (heights[code] > heights["S"]) == (code == pair.second)
        session.record(pair.trial, truth if known else not truth)
        right.append(known)
        assert session.right == known
    assert len(right) == 4000  # it does not end by reversals
    assert np.mean(right[500:]) == pytest.approx(0.75, abs=0.02)
    with pytest.raises(StudyError, match="training keeps a trainee at 75 %"):
        session.estimate()
