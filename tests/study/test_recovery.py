"""What is put into simulated participants comes out of the analysis; no effect is found 5 times in
100.
"""

import math

import numpy as np
import pytest

from oracles.designs import compared, crossed, lined
from oracles.noncentral_f import closed_form_power
from stepblocks.errors import StudyError
from stepblocks.study.analysis.judgements import join_answers
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.psychometric import (
    MAX_LAPSE,
    compute_weber_fraction,
    fit_psychometric,
)
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.simulate import Observer, interpolate_heights
from stepblocks.study.design.simulated_answers import simulate_answers
from stepblocks.study.power import SimulatedStudy, estimate_power, simulate_p_value

HEIGHTS = np.arange(30, 75, 5)
BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in HEIGHTS]
FLAT = {"heights": (20e-6, 40e-6), "energies": (1e-5, 2e-5)}


@pytest.mark.long
def test_a_known_weber_fraction_is_recovered_without_bias():
    # Energy in proportion to height, so that the Weber fraction of the energy is that of the
    # height; 60 fits of 1440 pairs (of 360, as docs/explanation/studies.md says, it comes out low:
    # a lapse rate
    # that cannot be below zero takes what is not its own)
    from scipy.special import ndtr

    generator = np.random.default_rng(11)
    sigma = math.log1p(0.2) / 0.6744897501960817
    totals = np.full(9, 160)
    found = []
    for _ in range(60):
        hits = generator.binomial(totals, ndtr(np.log(HEIGHTS / 50.0) / sigma))
        fit = fit_psychometric(HEIGHTS * 1e-6, hits, totals)
        found.append(
            (math.log(fit.threshold[0] / 50e-6), fit.weber[0], fit.weber[1] < 0.2 < fit.weber[2])
        )
    middle, weber, covered = np.mean(found, axis=0)
    error = np.std(found, axis=0) / math.sqrt(len(found))
    assert abs(middle) < 3 * error[0]
    assert abs(weber - 0.2) < 0.01
    # three standard deviations of a binomial of 60 below 95 %
    assert 0.865 < covered < 0.99


@pytest.mark.long
def test_simulated_pairs_carry_the_weber_fraction_through_sheets_and_table():
    design = compared(8, BLOCKS, 6, 1, "step-050").trials
    energies = {item.identity: item.height for item in BLOCKS}
    table = join_answers(
        design, lined(simulate_answers(design, energies, {}, Observer(weber=0.15), seed=5))
    )
    (found,) = table.analyse().comparisons
    assert sum(sum(curve.totals) for curve in found.curves) == 8 * 8 * 12
    spread = found.spread
    assert compute_weber_fraction(spread.low) < 0.15 < compute_weber_fraction(spread.high)
    assert math.exp(found.equal.value) == pytest.approx(1.0, rel=0.04)


def test_a_lapse_rate_is_distinguished_from_a_shallow_slope():
    from scipy.special import ndtr

    levels, total = np.geomspace(10e-6, 200e-6, 15), 4000
    p = 0.04 + 0.92 * ndtr(np.log(levels / 45e-6) / 0.3)
    hits, totals = np.round(total * p).astype(int), [total] * 15
    fit = fit_psychometric(levels, hits, totals)
    assert (fit.lapse, fit.spread) == (pytest.approx(0.04, abs=2e-3), pytest.approx(0.3, rel=0.02))
    assert fit.threshold[0] == pytest.approx(45e-6, rel=0.01)
    assert fit.lapse <= MAX_LAPSE


@pytest.mark.parametrize(
    ("hits", "message"),
    [
        ([10, 5, 0], "must rise"),
        ([5, 5, 5], "must rise"),
        ([0, 0, 10], "jump from none to all"),
        ([0, 11, 10], "from 0 to the number"),
    ],
)
def test_answers_that_tell_no_threshold_are_refused(hits, message):
    with pytest.raises(StudyError, match=message):
        fit_psychometric([1.0, 2.0, 3.0], hits, [10, 10, 10])


def test_a_spread_that_a_lapse_explains_away_is_not_reported():
    # one slip at 30 um and a jump between 50 and 70 um: with a lapse rate any steep function fits
    levels = [10e-6, 20e-6, 30e-6, 40e-6, 60e-6, 70e-6, 80e-6, 90e-6, 100e-6]
    with pytest.raises(StudyError, match="spread is not determined from 72 trials"):
        fit_psychometric(levels, [0, 0, 1, 0, 6, 8, 8, 8, 8], [8] * 9)


def test_height_of_energy_inverts_the_prediction():
    from stepblocks.contact.critical_angle import find_step_angle
    from stepblocks.contact.energy import find_release

    heights = np.array([25e-6, 50e-6, 75e-6])
    energies = np.array(
        [find_release(find_step_angle(h, 125e-6), 1.0, 0.15).vibration_energy for h in heights]
    )
    assert interpolate_heights(energies, heights, energies) == pytest.approx(heights, rel=1e-12)
    assert interpolate_heights([energies[0] / 2], heights, energies)[0] < heights[0]
    with pytest.raises(StudyError, match="rise with the height"):
        interpolate_heights([1.0], heights, energies[::-1])


def binomial_band(runs, rate=0.05):
    """Share that 99.9 % of simulations stay within when the true rate is `rate`."""
    from scipy.stats import binom

    low, high = binom.interval(0.999, runs, rate)
    return low / runs, high / runs


@pytest.mark.long
@pytest.mark.parametrize(
    ("analysis", "runs", "participants"), [("f-test", 200, 3), ("mixed", 100, 8)]
)
def test_no_effect_is_found_in_five_of_a_hundred_studies(analysis, runs, participants):
    # participants differ in nothing for the F-test, which assumes so; in level and in their
    # response to a condition for the mixed model
    spread = 0.0 if analysis == "f-test" else 6e-6
    observer = Observer(
        weber=0.1, response_noise=6e-6, participant_spread=spread, condition_spread=spread
    )
    plan = SimulatedStudy(
        participants,
        2,
        (60e-6, 80e-6),
        (3e-5, 4e-5),
        (("a", 1.0), ("b", 1.0)),
        observer,
        measure="bias",
    )
    low, high = binomial_band(runs)
    p = np.array([simulate_p_value(plan, analysis, seed) for seed in range(runs)])
    assert low <= np.mean(p < 0.05) <= high


def test_closed_form_power_is_the_textbook_s_and_begins_at_the_level():
    # Cohen (1988), table 2.3.5: two groups of 64, d = 0.5, two-sided 5 %: power 0.80 (0.8015 by
    # G*Power and R's power.t.test)
    assert closed_form_power({"a": 0.0, "b": 0.5}, 64, 1.0, 126) == pytest.approx(0.8015, abs=5e-5)
    assert closed_form_power({"a": 0.0, "b": 0.0}, 64, 1.0, 126) == 0.05
    assert closed_form_power({"a": 0.0, "b": 1e-4}, 64, 1.0, 126) == pytest.approx(0.05, abs=1e-5)


@pytest.mark.long
def test_power_of_the_f_test_is_that_of_the_noncentral_f():
    # Energy in proportion to height without sensory noise: condition "b" lowers every estimate by a
    # tenth
    noise = 8e-6
    observer = Observer(weber=0.0, response_noise=noise, participant_spread=0.0)
    plan = SimulatedStudy(
        4, 2, (80e-6,), (1e-5,), (("a", 1.0), ("b", 0.9)), observer, measure="bias"
    )
    plan = SimulatedStudy(
        4, 2, (70e-6, 90e-6), (0.7e-5, 0.9e-5), plan.factors, observer, measure="bias"
    )
    exact = closed_form_power({"a": 0.0, "b": 8e-6}, 4 * 2 * 2, noise, 32 - 4)
    assert 0.5 < exact < 0.95
    found = np.mean([simulate_p_value(plan, "f-test", seed) < 0.05 for seed in range(150)])
    low, high = binomial_band(150, exact)
    assert low <= found <= high


@pytest.mark.long
def test_power_of_the_mixed_model_is_that_of_the_noncentral_f():
    # Differences within participants have the variance 2 (condition_spread^2 + noise^2 / judgements
    # per cell), on participants - 1 degrees of freedom
    observer = Observer(
        weber=0.0, response_noise=6e-6, participant_spread=5e-6, condition_spread=6e-6
    )
    plan = SimulatedStudy(
        8, 2, (70e-6, 90e-6), (0.7e-5, 0.9e-5), (("a", 1.0), ("b", 0.9)), observer, measure="bias"
    )
    exact = closed_form_power({"a": 0.0, "b": 8e-6}, 8, math.hypot(6e-6, 6e-6 / 2), 7)
    assert 0.4 < exact < 0.9
    found = np.mean([simulate_p_value(plan, "mixed", seed) < 0.05 for seed in range(80)])
    low, high = binomial_band(80, exact)
    assert low <= found <= high


@pytest.mark.long
def test_power_is_the_same_in_one_process_and_in_two():
    plan = SimulatedStudy(
        3, 1, *FLAT.values(), (("a", 1.0), ("b", 0.5)), Observer(), measure="bias"
    )
    one, two = (estimate_power(plan, "f-test", runs=12, seed=4, jobs=jobs) for jobs in (1, 2))
    assert one == two
    assert one.low_95_ratio <= one.power_ratio <= one.high_95_ratio


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Observer(weber=-0.1), "weber must be finite"),
        (lambda: Observer(lapse=1.0), "lapse must be a rate"),
        (
            lambda: SimulatedStudy(1, 1, *FLAT.values(), (("a", 1.0), ("b", 1.0)), Observer()),
            "at least 2 participants",
        ),
        (
            lambda: SimulatedStudy(2, 1, *FLAT.values(), (("a", 1.0),), Observer()),
            "at least two conditions",
        ),
        (
            lambda: SimulatedStudy(2, 1, *FLAT.values(), (("a", 1.0), ("b", 0.0)), Observer()),
            "must be positive and finite",
        ),
        (
            lambda: estimate_power(
                SimulatedStudy(2, 1, *FLAT.values(), (("a", 1.0), ("b", 1.0)), Observer()), runs=3
            ),
            "runs must lie",
        ),
    ],
)
def test_impossible_plans_are_refused(make, message):
    with pytest.raises(StudyError, match=message):
        make()


def test_realism_gain_is_recovered_by_the_ordinal_model():
    design = crossed("virtual", 16, BLOCKS, 3, 2).trials
    energies = {item.identity: item.height for item in BLOCKS}
    observer = Observer(realism_gain=1.0)
    table = join_answers(design, lined(simulate_answers(design, energies, {}, observer, seed=8)))
    effect = fit_ordinal_model(table.frame, "rating", "condition", "participant").effects[0]
    assert (effect.first, effect.second) == ("vibration-on", "vibration-off")
    assert effect.low < 1.0 < effect.high
    assert effect.difference > math.log(1.5)


def test_answers_that_leave_the_threshold_open_are_said_to_and_give_no_infinite_interval():
    with pytest.raises(StudyError, match="threshold open: it is not determined from 32 trials"):
        fit_psychometric([10.0, 20.0, 30.0, 40.0], [3, 3, 5, 4], [8] * 4)


def test_two_answers_a_level_that_a_step_with_lapses_fits_as_well_give_no_spread():
    heights = [10.0, 20.0, 30.0, 40.0, 60.0, 70.0, 80.0, 90.0, 100.0]
    with pytest.raises(StudyError, match="spread is not determined from 18 trials"):
        fit_psychometric(heights, [1, 0, 0, 0, 2, 1, 2, 2, 2], [2] * 9)


@pytest.mark.parametrize("level", [math.inf, math.nan, 0.0, -1e-6])
def test_a_level_that_no_block_can_have_is_refused(level):
    with pytest.raises(StudyError, match="levels must be positive and finite"):
        fit_psychometric([10e-6, 20e-6, 30e-6, level], [1, 4, 7, 8], [8] * 4)
