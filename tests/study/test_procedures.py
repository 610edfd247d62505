"""The adaptive procedures trial by trial: a staircase by hand, QUEST+ by Bayes' rule."""

import math

import pytest
from scipy.special import ndtr
from scipy.stats import entropy

from stepblocks.errors import StudyError
from stepblocks.study.session import QuestPlus, Staircase


def walked(stairs, answers):
    seen = []
    for hit in answers:
        seen.append(stairs.level)
        stairs.record(hit == "+")
    return seen


def test_two_down_one_up_by_hand():
    stairs = Staircase([1.0, 2.0, 3.0, 4.0])
    assert walked(stairs, "++-++++-+") == [4.0, 4.0, 3.0, 4.0, 4.0, 3.0, 3.0, 2.0, 3.0]
    # down from 4, up from 3 (a reversal), down from 4 (a reversal) and on from 3, up from 2 (a
    # reversal)
    assert stairs.reversals == [3.0, 4.0, 2.0]
    assert stairs.level == 3.0


def test_a_staircase_stays_on_the_blocks_that_exist():
    stairs = Staircase([1.0, 2.0], hits_down=1)
    assert walked(stairs, "++++") == [2.0, 1.0, 1.0, 1.0]
    assert walked(stairs, "----") == [1.0, 2.0, 2.0, 2.0]
    assert stairs.reversals == [1.0]


def test_the_threshold_is_the_mean_of_an_even_number_of_late_reversals():
    stairs = Staircase([1.0, 2.0, 3.0], hits_down=1)
    stairs.reversals = [3.0, 3.0, 3.0, 1.0, 2.0]
    assert stairs.threshold(skip=2) == 1.5  # of the three late ones the first is left out
    with pytest.raises(StudyError, match="needs two reversals after the first 4, got 5 in all"):
        stairs.threshold(skip=4)


def test_quest_plus_is_bayes_rule_on_two_hypotheses():
    quest = QuestPlus([1.0, 2.0, 3.0], thresholds=[1.5, 2.5], slopes=[0.8], lapses=[0.04])

    def hit(level, threshold):
        return 0.04 + 0.92 * ndtr((level - threshold) / 0.8)

    weights = [1.0, 1.0]
    for level, right in ((2.0, True), (3.0, True), (1.0, False)):
        quest.record(level, right)
        shares = [hit(level, threshold) for threshold in (1.5, 2.5)]
        weights = [w * (p if right else 1.0 - p) for w, p in zip(weights, shares, strict=True)]
    first = weights[0] / sum(weights)
    assert quest.posterior == pytest.approx([first, 1.0 - first], rel=1e-12)
    assert entropy(quest.posterior) == pytest.approx(
        -first * math.log(first) - (1.0 - first) * math.log(1.0 - first), rel=1e-12
    )


def test_before_the_first_answer_everything_is_as_likely():
    quest = QuestPlus([1.0, 2.0], thresholds=[1.0, 2.0, 3.0, 4.0], slopes=[0.5, 1.0], lapses=[0.02])
    assert entropy(quest.posterior) == pytest.approx(math.log(8.0))
    assert quest.quantile(0, 0.5) == pytest.approx(2.5)
    assert quest.quantile(0, 0.025) <= quest.quantile(0, 0.975)


@pytest.mark.parametrize(
    ("make", "message"), [(lambda: Staircase([1.0]), "levels must be at least two")]
)
def test_an_impossible_procedure_is_refused(make, message):
    with pytest.raises(StudyError, match=message):
        make()
