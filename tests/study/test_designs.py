"""Every design keeps its promise of balance, at every size, and says how far it does."""

from collections import Counter
from itertools import groupby

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from oracles.designs import compared, crossed
from stepblocks.errors import StudyError
from stepblocks.study.design.blocks import MAX_CODES, Item, assign_codes
from stepblocks.study.design.orders import (
    MAX_CONDITIONS,
    allocate_orders,
    make_williams_square,
    measure_balance,
)
from stepblocks.study.design.trials import design_trials
from stepblocks.study.run import analyse_study, design_study, simulate_study, write_sheets

FOUR = [Item(f"apparatus-{h:03}", f"APPARATUS-{h:03}", h * 1e-6) for h in (25, 50, 75, 100)]
TEN = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in range(10, 101, 10)]
PROBES = ("bare", "hard", "soft")


@pytest.mark.parametrize("conditions", range(1, MAX_CONDITIONS + 1))
def test_in_williams_orders_every_condition_follows_every_other_equally_often(conditions):
    balance = measure_balance(make_williams_square(conditions))
    assert balance.exact
    assert len(make_williams_square(conditions)) == (
        2 * conditions if conditions % 2 and conditions > 1 else conditions
    )


def test_williams_square_of_four_is_the_published_one_up_to_labels():
    # Williams (1949), 4 treatments: 0 1 3 2 / 1 2 0 3 / 2 3 1 0 / 3 0 2 1, here with 1 and 3
    # exchanged
    published = [[0, 1, 3, 2], [1, 2, 0, 3], [2, 3, 1, 0], [3, 0, 2, 1]]
    relabel = np.array([0, 3, 2, 1])
    assert sorted(relabel[row].tolist() for row in np.array(published)) == sorted(
        make_williams_square(4).tolist()
    )


@pytest.mark.parametrize("conditions", range(1, 13))
def test_any_number_of_participants_is_balanced_to_the_stated_bounds(conditions):
    generator = np.random.default_rng(conditions)
    for participants in range(1, 61):
        balance = measure_balance(allocate_orders(participants, conditions, generator))
        assert balance.position_spread <= 1
        assert balance.follower_spread <= (2 if conditions % 2 else 1)
        assert balance.exact == (participants % len(make_williams_square(conditions)) == 0)


def test_experiment_one_is_the_paper_s():
    design = crossed("estimates", 10, FOUR, 3, 5, PROBES)
    cells = Counter(
        (t["participant"], t["condition"], t["repetition"], t["stimulus"]) for t in design.trials
    )
    assert len(cells) == 10 * 3 * 3 * 4
    assert set(cells.values()) == {1}
    assert design.balance.position_spread == 1
    for participant in range(1, 11):
        own = [t for t in design.trials if t["participant"] == str(participant)]
        assert [t["trial"] for t in own] == [str(number) for number in range(1, 37)]
        runs = [name for name, _ in groupby(own, lambda t: t["condition"])]
        assert sorted(runs) == sorted(PROBES)
        for start in range(0, 36, 4):  # a set is complete before the next begins
            assert {t["stimulus"] for t in own[start : start + 4]} == {
                item.identity for item in FOUR
            }


def test_blocks_within_a_set_are_in_every_order_equally_often():
    trials = crossed("estimates", 200, FOUR[:3], 4, 2, PROBES).trials
    orders = Counter(
        tuple(t["stimulus"] for t in trials[i : i + 3]) for i in range(0, len(trials), 3)
    )
    expected = 200 * 3 * 4 / 6
    statistic = sum((count - expected) ** 2 / expected for count in orders.values())
    assert len(orders) == 6
    assert statistic < 20.5  # 99.9 % of chi-square with 5 degrees of freedom


def test_experiment_two_alternates_which_condition_comes_first():
    design = crossed("virtual", 10, TEN, 1, 3)
    firsts = Counter(t["condition"] for t in design.trials if t["trial"] == "1")
    assert firsts == {"vibration-off": 5, "vibration-on": 5}
    assert design.balance.exact
    assert len(design.trials) == 10 * 2 * 10


def test_groups_are_balanced_each_by_itself_and_a_design_says_when():
    factors = {"probe": ("bare", "soft"), "hand": ("left", "right")}
    design = design_trials("estimates", 6, FOUR, 1, 1, factors=factors, between=["hand"])
    assert "exact at multiples of 4 participants" in str(design.balance)
    assert design_trials(
        "estimates", 8, FOUR, 1, 1, factors=factors, between=["hand"]
    ).balance.exact


def test_constant_stimuli_put_the_standard_first_and_second_equally_often():
    design = compared(3, TEN, 4, 1, "step-050")
    cells = Counter((t["participant"], t["stimulus"], t["condition"]) for t in design.trials)
    assert set(cells.values()) == {4}
    assert len(cells) == 3 * 9 * 2
    assert all(t["standard"] == "step-050" != t["stimulus"] for t in design.trials)


def test_the_same_seed_gives_the_same_design_and_another_seed_another():
    one, again, other = (crossed("magnitude", 4, TEN, 2, s) for s in (1, 1, 2))
    assert one.trials == again.trials
    assert one.trials != other.trials


def test_a_slip_of_the_pen_is_never_another_block():
    codes = assign_codes([FOUR[0]] * MAX_CODES, np.random.default_rng(1)).judged
    assert len(codes) == MAX_CODES
    known = set(codes)
    letters = sorted({letter for code in known for letter in code})
    for code in list(known)[:40]:
        slips = {code[:i] + letter + code[i + 1 :] for i in range(3) for letter in letters} - {code}
        swaps = {code[1] + code[0] + code[2], code[0] + code[2] + code[1]} - {code}
        assert not (slips | swaps) & known


def test_codes_say_nothing_about_the_height():
    ranks = [
        list(np.argsort(list(assign_codes(TEN, np.random.default_rng(s)).judged)))
        for s in range(200)
    ]
    assert np.all(np.abs(np.mean(ranks, axis=0) - 4.5) < 4 * 2.87 / np.sqrt(200))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: crossed("estimates", 0, FOUR, 3, 1, PROBES),
            "participants must be at least 1",
        ),
        (lambda: crossed("estimates", 2, FOUR, 3, 1, ("a", "a")), "'a' twice"),
        (lambda: crossed("estimates", 2, [], 3, 1, PROBES), "blocks must be at least one"),
        (
            lambda: crossed("estimates", 2, FOUR, 0, 1, PROBES),
            "repetitions must be at least 1",
        ),
        (
            lambda: crossed("estimates", 2, FOUR, 1, -1, PROBES),
            "seed must not be negative",
        ),
        (lambda: crossed("estimates", 900, FOUR, 100, 1, PROBES), "at most 200000 trials"),
        (lambda: compared(2, TEN, 1, 1, "step-099"), "standard must be one of"),
        (lambda: Item("a", "A", float("nan")), "height must be positive"),
        (lambda: make_williams_square(27), "between 1 and 26"),
    ],
)
def test_impossible_designs_are_refused_by_name_rule_and_value(make, message):
    with pytest.raises(StudyError, match=message):
        make()


@pytest.mark.parametrize("standard", ["", "s4"])
def test_interleaved_conditions_change_within_each_repetition_and_stay_balanced(standard):
    blocks = [Item(f"s{n}", f"S{n}", n * 1e-5) for n in (2, 4, 6, 8, 10)]
    factors = {"probe": ("bare", "hard", "soft")}
    kind = "constant" if standard else "estimates"
    design = design_trials(
        kind, 4, blocks, 3, 1, factors=factors, standard=standard, interleaved=True
    )
    assert str(design.balance) == "conditions interleaved, all of them in each repetition"
    rows = pd.DataFrame(design.trials)
    cell = ["participant", "repetition", "factor_probe", "stimulus", "condition"]
    assert (rows.groupby(cell).size() == 1).all()
    for _, own in rows.groupby("participant"):
        probe, block = own["factor_probe"].to_numpy(), own["stimulus"].to_numpy()
        # of three probes in random order two of three neighbours differ; in blocks of one probe
        # there would be two changes in all
        assert (probe[1:] != probe[:-1]).mean() > 0.5
        assert (block[1:] != block[:-1]).all()
        assert own["repetition"].is_monotonic_increasing


def test_an_interleaved_study_is_designed_run_and_analysed_as_any_other(tmp_path):
    heights = tuple(h * 1e-6 for h in (25, 50, 75))
    options = {"seed": 1, "participants": 6, "interleaved": True}
    design_study(heights, tmp_path, **options)
    assert "Conditions interleaved" in (tmp_path / "preregistration.md").read_text()
    said = "interleaved is an option of estimates, virtual, constant, magnitude, not of adaptive"
    with pytest.raises(StudyError, match=said):
        design_study(heights, tmp_path / "two", experiment="adaptive", standard="a", **options)
    write_sheets(tmp_path)
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2, noise={"soft": 3.0})
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"])
    assert result.measure().corrected.p < 0.05


def test_a_preregistration_says_what_its_participants_can_show(tmp_path):
    design = design_study((30e-6, 50e-6, 80e-6), tmp_path, seed=1, participants=12)
    # scipy's noncentral t, both tails
    limit, size = stats.t.ppf(0.975, 11), design.detectable * 12**0.5
    power = stats.nct.sf(limit, 11, size) + stats.nct.cdf(-limit, 11, size)
    assert power == pytest.approx(0.8, abs=1e-6)
    text = (tmp_path / "preregistration.md").read_text()
    assert "the 12 participants' own differences finds, with a power of 80 %" in text
    assert f"a difference of {design.detectable:.2f} standard deviations" in text


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"experiment": "estimates"}, "(training) are compared by a split-plot analysis"),
        (
            {"experiment": "constant", "standard": "step-050"},
            "Welch's degrees of freedom, as are the groups (training)",
        ),
        ({"experiment": "magnitude"}, "groups (training) by their mean exponents"),
    ],
)
def test_a_preregistration_says_how_groups_of_participants_are_compared(
    tmp_path, options, expected
):
    factors = {"training": ("dentist", "student"), "probe": ("bare", "soft")}
    heights = (30e-6, 50e-6, 80e-6)
    for between, said in ((["training"], True), ([], False)):
        folder = tmp_path / str(said)
        design_study(heights, folder, seed=1, factors=factors, between=between, **options)
        assert (expected in (folder / "preregistration.md").read_text()) == said


def test_a_preregistration_without_differences_of_a_participant_plans_none(tmp_path):
    factors = {"training": ("dentist", "student")}
    design_study((30e-6, 50e-6), tmp_path, seed=1, factors=factors, between=["training"])
    text = (tmp_path / "preregistration.md").read_text()
    assert "Pairs of conditions by this model, for each participant meets one." in text
    assert "own differences" not in text.partition("## Analysis")[2]
