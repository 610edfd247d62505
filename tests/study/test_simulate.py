"""Every kind of experiment goes round: designed, written, read back, simulated, analysed, shown."""

import numpy as np
import pytest

from oracles.designs import compared, crossed, lined
from stepblocks.errors import StudyError
from stepblocks.files.tables import format_csv
from stepblocks.study.analysis.accuracy import analyse_measure
from stepblocks.study.analysis.judgements import join_answers
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.page import render_study_report
from stepblocks.study.analysis.result_table import COLUMNS
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.read import read_answers, read_design
from stepblocks.study.design.sheet import list_sheet_columns
from stepblocks.study.design.simulate import Observer
from stepblocks.study.design.simulated_answers import simulate_answers
from stepblocks.study.design.trials import design_trials
from stepblocks.study.experiments.registry import EXPERIMENTS
from stepblocks.study.power import (
    SimulatedStudy,
    estimate_power,
    simulate_judgement_table,
    simulate_p_value,
)

BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in range(30, 75, 5)]
ENERGIES = {item.identity: item.height for item in BLOCKS}  # in proportion to the height
STILL = Observer(weber=0.0, response_noise=0.0, participant_spread=0.0)


def designed(name, participants=4, repetitions=2):
    if EXPERIMENTS[name].paired:
        return compared(participants, BLOCKS, repetitions, 1, "step-050")
    return crossed(name, participants, BLOCKS, repetitions, 1)


@pytest.mark.repeats
@pytest.mark.parametrize("name", ["estimates", "virtual", "constant", "magnitude"])
def test_every_experiment_goes_round(name, tmp_path):
    (tmp_path / "design.csv").write_text(format_csv(designed(name).trials))
    design = read_design(tmp_path / "design.csv")
    answers = simulate_answers(design, ENERGIES, {}, Observer(weber=0.5), seed=2)
    assert all(row[column] for row in answers for column in EXPERIMENTS[name].answers)
    assert tuple(answers[0]) == list_sheet_columns(name)
    (tmp_path / "answers.csv").write_text(format_csv(answers))
    table = join_answers(design, read_answers(tmp_path / "answers.csv", name))
    assert (len(table.frame), table.missing, table.left) == (len(design), (), ())
    result = table.analyse()
    assert tuple(result.table().columns) == COLUMNS
    assert not result.table()["quantity"].duplicated().all()
    assert EXPERIMENTS[name].title in render_study_report(result)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_same_seed_gives_the_same_answers_and_another_seed_others(name):
    rows = designed(name).trials
    one, again, other = (
        simulate_answers(rows, ENERGIES, {}, Observer(weber=0.5), seed) for seed in (1, 1, 2)
    )
    assert one == again
    assert one != other


def test_without_noise_estimates_are_the_heights_and_a_damper_takes_its_share():
    rows = crossed("estimates", 2, BLOCKS, 1, 1, ("bare", "soft")).trials
    for row, answer in zip(
        rows, simulate_answers(rows, ENERGIES, {"soft": 0.5}, STILL, 3), strict=True
    ):
        share = 0.5 if row["condition"] == "soft" else 1.0
        assert float(answer["estimate_um"]) == pytest.approx(
            share * float(row["height_um"]), abs=0.051
        )


def test_without_noise_the_higher_of_two_is_always_named():
    rows = compared(1, BLOCKS, 1, 1, "step-050").trials
    for row, answer in zip(rows, simulate_answers(rows, ENERGIES, {}, STILL, 3), strict=True):
        higher = float(row["height_um"]) > 50.0
        assert answer["second_is_higher"] == (
            "y" if higher == (row["condition"] == "standard-first") else "n"
        )


def test_without_noise_magnitudes_grow_with_the_square_root_of_the_energy():
    rows = crossed("magnitude", 3, BLOCKS, 1, 1).trials
    answers = simulate_answers(rows, ENERGIES, {}, STILL, 3)
    table = join_answers(rows, lined(answers))
    (law,) = table.analyse().power_laws
    assert law.exponent == pytest.approx(0.5, abs=0.01)  # three digits are written down
    assert all(
        correlation == pytest.approx(1.0, abs=1e-3) for _, _, correlation in law.by_participant
    )


def plan(**changes):
    given = {
        "participants": 3,
        "repetitions": 2,
        "heights": (20e-6, 40e-6),
        "energies": (1e-5, 2e-5),
    }
    return SimulatedStudy(
        **given
        | {"factors": (("bare", 1.0), ("soft", 0.5)), "observer": STILL, "measure": "bias"}
        | changes
    )


def test_a_simulated_study_has_every_judgement_once_and_its_errors_in_closed_form():
    frame = simulate_judgement_table(plan(), seed=1)
    assert set(frame.groupby(["participant", "condition", "stimulus"]).size()) == {2}
    soft = frame[frame["condition"] == "soft"]
    # energy in proportion to height: half of it reads as half the height
    assert soft["error"].to_numpy() == pytest.approx(-0.5 * soft["height"].to_numpy(), rel=1e-9)
    assert frame[frame["condition"] == "bare"]["error"].abs().max() < 1e-15


def test_a_study_is_decided_by_its_own_seed():
    noisy = plan(observer=Observer())
    together = [simulate_p_value(noisy, "f-test", seed) for seed in (1, 2, 3)]
    assert together == [simulate_p_value(noisy, "f-test", seed) for seed in (1, 2, 3)]
    assert len(set(together)) == 3


def test_a_difference_that_nobody_can_miss_is_always_found():
    estimate = estimate_power(plan(observer=Observer(response_noise=1e-6)), "f-test", runs=10)
    assert (estimate.power_ratio, estimate.high_95_ratio) == (1.0, 1.0)
    # Wilson's interval of n of n: n / (n + z^2)
    assert estimate.low_95_ratio == pytest.approx(10.0 / (10.0 + 1.959964**2), rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"analysis": "anova"}, "analysis must be one of f-test, mixed, got 'anova'"),
        ({"runs": 100_001}, "runs must lie between 10 and 100000, got 100001"),
        ({"jobs": 0}, "seed and jobs must be at least 0 and at least 1, got 1 and 0"),
    ],
)
def test_an_impossible_simulation_is_refused(options, message):
    with pytest.raises(StudyError, match=message):
        estimate_power(plan(), **options)


def test_simulated_ratings_have_the_odds_that_the_observers_give_them():
    frame = simulate_judgement_table(
        plan(participants=60, observer=Observer(realism_gain=1.2)), seed=3
    )
    assert set(frame["rating"]) <= set(range(1, 8))
    (found,) = fit_ordinal_model(frame, "rating", "condition", "participant").effects
    # "soft" is the last condition, which is rated up
    assert found.difference == pytest.approx(1.2, abs=3.0 * found.error)
    assert found.error < 0.3


def test_vibration_raises_ratings_also_where_other_factors_cross_it():
    factors = {"vibration": ("vibration-off", "vibration-on"), "amplitude": ("0.5", "1")}
    rows = design_trials("virtual", 8, BLOCKS, 2, 1, factors=factors).trials
    answers = simulate_answers(rows, ENERGIES, {}, Observer(realism_gain=4.0), seed=1)
    ratings = np.array([int(row["realism_rating"]) for row in answers])
    shown = np.array([row["factor_vibration"] == "vibration-on" for row in rows])
    # four logits on a scale of seven steps of one, cut off at its end
    assert ratings[shown].mean() - ratings[~shown].mean() > 2.0


@pytest.mark.long
def test_the_power_of_ratings_is_that_of_the_ordinal_model_and_the_level_without_a_gain():
    given = {"measure": "realism", "participants": 8, "repetitions": 4}
    strong = estimate_power(plan(**given, observer=Observer(realism_gain=3.0)), runs=10)
    assert strong.power_ratio == 1.0
    none = [
        simulate_p_value(plan(**given, observer=Observer(realism_gain=0.0)), "mixed", seed)
        for seed in range(40)
    ]
    # of 40 uniform values at most 7 lie below 0.05, but for one case in 1,000 (binomial)
    assert sum(p < 0.05 for p in none) <= 7
    # ratings that do not overlap have no finite odds: such a study finds nothing
    far = plan(measure="realism", participants=3, observer=Observer(realism_gain=50.0))
    assert simulate_p_value(far, "mixed", 1) == 1.0


@pytest.mark.long
def test_power_is_that_of_the_test_that_the_analysis_reads():
    three = plan(
        participants=6,
        factors=(("bare", 1.0), ("hard", 0.9), ("soft", 0.8)),
        observer=Observer(condition_spread=4e-6),
        noise=(1.0, 1.0, 20.0),
    )
    epsilons = []
    for seed in range(5):
        measure = analyse_measure(simulate_judgement_table(three, seed), "bias")
        assert simulate_p_value(three, "mixed", seed) == pytest.approx(
            measure.corrected.p, rel=1e-9
        )
        epsilons.append(measure.sphericity.huynh_feldt)
    assert min(epsilons) < 0.8  # without it another p comes out


def test_a_study_of_typical_observers_has_a_p_value():
    assert np.isfinite(simulate_p_value(plan(observer=Observer()), "mixed", 5))
