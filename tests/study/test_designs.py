"""Every design keeps its promise of balance, at every size, and says how far it does."""

from collections import Counter

import numpy as np
import pytest

from stepblocks.errors import StudyError
from stepblocks.study.design import (
    MAX_CODES,
    MAX_CONDITIONS,
    Item,
    allocate_orders,
    balance_of,
    blinding_codes,
    constant_stimuli,
    exact_period,
    experiment_one,
    experiment_two,
    magnitude_estimation,
    williams_square,
)
from stepblocks.study.session import QuestPlus, Staircase

FOUR = [Item(f"apparatus-{h:03}", f"APPARATUS-{h:03}", h * 1e-6) for h in (25, 50, 75, 100)]
TEN = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in range(10, 101, 10)]
PROBES = ("bare", "hard", "soft")


@pytest.mark.parametrize("conditions", range(1, MAX_CONDITIONS + 1))
def test_in_williams_orders_every_condition_follows_every_other_equally_often(conditions):
    balance = balance_of(williams_square(conditions))
    assert balance.exact
    assert exact_period(conditions) == (2 * conditions if conditions % 2 and conditions > 1 else conditions)


def test_williams_square_of_four_is_the_published_one_up_to_labels():
    # Williams (1949), 4 treatments: 0 1 3 2 / 1 2 0 3 / 2 3 1 0 / 3 0 2 1, here with 1 and 3 exchanged
    published = [[0, 1, 3, 2], [1, 2, 0, 3], [2, 3, 1, 0], [3, 0, 2, 1]]
    relabel = np.array([0, 3, 2, 1])
    assert sorted(relabel[row].tolist() for row in np.array(published)) == sorted(williams_square(4).tolist())


@pytest.mark.parametrize("conditions", range(1, 13))
def test_any_number_of_participants_is_balanced_to_the_stated_bounds(conditions):
    generator = np.random.default_rng(conditions)
    for participants in range(1, 61):
        balance = balance_of(allocate_orders(participants, conditions, generator))
        assert balance.position_spread <= 1
        assert balance.follower_spread <= (2 if conditions % 2 else 1)
        assert balance.exact == (participants % exact_period(conditions) == 0)


def test_experiment_one_is_the_paper_s():
    design = experiment_one(10, PROBES, FOUR, 3, seed=5)
    cells = Counter((t.participant, t.condition, t.repetition, t.item.identity) for t in design.trials)
    assert len(cells) == 10 * 3 * 3 * 4
    assert set(cells.values()) == {1}
    assert design.balance.position_spread == 1
    for participant in range(1, 11):
        own = [t for t in design.trials if t.participant == participant]
        assert [t.trial for t in own] == list(range(1, 37))
        runs = [
            t.condition
            for t, before in zip(own, [None, *own], strict=False)
            if before is None or before.condition != t.condition
        ]
        assert sorted(runs) == sorted(PROBES)
        for start in range(0, 36, 4):  # a set is complete before the next begins
            assert {t.item.identity for t in own[start : start + 4]} == {item.identity for item in FOUR}


def test_blocks_within_a_set_are_in_every_order_equally_often():
    trials = experiment_one(200, PROBES, FOUR[:3], 4, seed=2).trials
    orders = Counter(tuple(t.item.identity for t in trials[i : i + 3]) for i in range(0, len(trials), 3))
    expected = 200 * 3 * 4 / 6
    statistic = sum((count - expected) ** 2 / expected for count in orders.values())
    assert len(orders) == 6
    assert statistic < 20.5  # 99.9 % of chi-square with 5 degrees of freedom


def test_experiment_two_alternates_which_condition_comes_first():
    design = experiment_two(10, TEN, 1, seed=3)
    firsts = Counter(t.condition for t in design.trials if t.trial == 1)
    assert firsts == {"vibration-off": 5, "vibration-on": 5}
    assert design.balance.exact
    assert len(design.trials) == 10 * 2 * 10


def test_constant_stimuli_put_the_standard_first_and_second_equally_often():
    design = constant_stimuli(3, "step-050", TEN, 4, seed=1)
    cells = Counter((t.participant, t.item.identity, t.condition) for t in design.trials)
    assert set(cells.values()) == {4}
    assert len(cells) == 3 * 9 * 2
    assert all(t.standard.identity == "step-050" != t.item.identity for t in design.trials)


def test_the_same_seed_gives_the_same_design_and_another_seed_another():
    one, again, other = (magnitude_estimation(4, TEN, 2, seed=s) for s in (1, 1, 2))
    assert one.trials == again.trials
    assert one.trials != other.trials


def test_a_slip_of_the_pen_is_never_another_block():
    codes = blinding_codes([f"b{i}" for i in range(MAX_CODES)], np.random.default_rng(1))
    assert len(set(codes.values())) == MAX_CODES
    known = set(codes.values())
    letters = sorted({letter for code in known for letter in code})
    for code in list(known)[:40]:
        slips = {code[:i] + letter + code[i + 1 :] for i in range(3) for letter in letters} - {code}
        swaps = {code[1] + code[0] + code[2], code[0] + code[2] + code[1]} - {code}
        assert not (slips | swaps) & known


def test_codes_say_nothing_about_the_height():
    ranks = [
        list(np.argsort(list(blinding_codes([i.identity for i in TEN], np.random.default_rng(s)).values())))
        for s in range(200)
    ]
    assert np.all(np.abs(np.mean(ranks, axis=0) - 4.5) < 4 * 2.87 / np.sqrt(200))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: experiment_one(0, PROBES, FOUR, 3, 1), "participants must be at least 1"),
        (lambda: experiment_one(2, ("a", "a"), FOUR, 3, 1), "'a' twice"),
        (lambda: experiment_one(2, (), FOUR, 3, 1), "conditions must be at least one"),
        (lambda: experiment_one(2, PROBES, [], 3, 1), "blocks must be at least one"),
        (lambda: experiment_one(2, PROBES, FOUR, 0, 1), "repetitions must be at least 1"),
        (lambda: experiment_one(2, PROBES, FOUR, 1, -1), "seed must not be negative"),
        (lambda: experiment_one(900, PROBES, FOUR, 100, 1), "at most 200000 trials"),
        (lambda: constant_stimuli(2, "step-099", TEN, 1, 1), "standard must be one of"),
        (lambda: Item("a", "A", float("nan")), "height must be positive"),
        (lambda: williams_square(27), "between 1 and 26"),
        (lambda: Staircase([2.0, 1.0]), "ascend"),
        (lambda: QuestPlus([1.0], [1.0], [0.0]), "slopes must be positive"),
    ],
)
def test_impossible_designs_are_refused_by_name_rule_and_value(make, message):
    with pytest.raises(StudyError, match=message):
        make()


@pytest.mark.parametrize("hits_down", [1, 2, 3])
def test_the_staircase_converges_on_its_target(hits_down):
    from scipy.special import ndtr, ndtri

    generator = np.random.default_rng(hits_down)
    levels = np.linspace(-3.0, 3.0, 61)
    found = []
    for _ in range(60):
        stairs = Staircase(levels, hits_down, start=35)
        for _ in range(200):
            stairs.record(bool(generator.random() < ndtr(stairs.level)))
        found.append(stairs.threshold(skip=6))
    assert np.mean(found) == pytest.approx(ndtri(0.5 ** (1 / hits_down)), abs=0.08)  # Levitt (1971), table I


def test_quest_plus_recovers_threshold_and_spread_with_fewer_trials_than_constant_stimuli():
    from scipy.special import ndtr
    from scipy.stats import entropy

    generator = np.random.default_rng(4)
    levels = np.linspace(10.0, 100.0, 19)
    found = []
    for _ in range(20):
        quest = QuestPlus(levels, np.linspace(20, 90, 36), [6.0, 9.0, 12.0, 15.0, 20.0])
        before = entropy(quest.posterior)
        for _ in range(60):
            level = quest.next_level()
            quest.record(level, bool(generator.random() < 0.98 * ndtr((level - 47.0) / 12.0)))
        assert entropy(quest.posterior) < before
        found.append(quest.estimate())
    threshold, spread, _ = np.mean(found, axis=0)
    assert threshold == pytest.approx(47.0, abs=2.0)
    assert spread == pytest.approx(12.0, abs=2.5)


def test_quest_plus_asks_where_the_hypotheses_differ_most():
    quest = QuestPlus(np.arange(0.0, 11.0), [3.0, 7.0], [0.5], [0.0])
    assert quest.next_level() == 4.0 or quest.next_level() == 5.0
    quest.record(5.0, True)
    assert quest.estimate()[0] == pytest.approx(3.0, abs=1e-3)
    with pytest.raises(StudyError, match="level must be one of"):
        quest.record(5.5, True)
