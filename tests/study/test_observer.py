"""Simulated participants do what they are said to do, in numbers that a closed form gives."""

import math

import numpy as np
import pandas as pd
import pytest

from stepblocks.errors import StudyError
from stepblocks.study.design.simulate import (
    Observer,
    interpolate_heights,
    simulate_comparison,
    simulate_estimates,
    simulate_felt_energies,
)

HEIGHTS = np.array([20e-6, 40e-6, 80e-6])
KNOWN = (HEIGHTS, 0.5 * HEIGHTS)  # energy in proportion to height
STILL = Observer(weber=0.0, response_noise=0.0, participant_spread=0.0)


def trials(people=4, settings=2, each=50, share=1.0):
    person, setting, block, _ = (i.ravel() for i in np.indices((people, settings, 3, each)))
    energy = share * KNOWN[1][block]
    return pd.DataFrame(
        {"person": person, "setting": setting, "height": HEIGHTS[block], "energy": energy}
    )


def estimated(observer, seed=1, **size):
    table = trials(**size)
    return table, simulate_estimates(table, KNOWN, observer, np.random.default_rng(seed))


def test_who_has_no_noise_reads_the_true_height_and_a_share_of_it_through_a_damper():
    table, heights = estimated(STILL)
    assert heights == pytest.approx(table["height"].to_numpy(), rel=1e-12)
    table, heights = estimated(STILL, share=0.5)
    assert heights == pytest.approx(0.5 * table["height"].to_numpy(), rel=1e-12)


@pytest.mark.parametrize("weber", [0.1, 0.5])
def test_a_difference_of_one_weber_fraction_is_judged_right_three_times_in_four(weber):
    generator, observer, runs = np.random.default_rng(3), Observer(weber=weber), 8000
    right = sum(simulate_comparison(1.0 + weber, 1.0, observer, generator) for _ in range(runs))
    assert right / runs == pytest.approx(0.75, abs=4.0 * math.sqrt(0.75 * 0.25 / runs))


def test_equal_blocks_are_distinguished_by_chance_and_lapses_are_a_coin():
    generator, runs = np.random.default_rng(4), 4000
    assert sum(
        simulate_comparison(1.0, 1.0, Observer(), generator) for _ in range(runs)
    ) / runs == pytest.approx(0.5, abs=0.032)
    lapsing = Observer(weber=0.0, lapse=0.4)
    # without noise the higher block is always told, but in the 40 % where a coin decides
    assert sum(
        simulate_comparison(2.0, 1.0, lapsing, generator) for _ in range(runs)
    ) / runs == pytest.approx(0.8, abs=0.026)


def test_two_felt_energies_differ_by_the_noise_of_one_comparison():
    observer = Observer(weber=0.3)
    felt = np.log(simulate_felt_energies(np.ones(40_000), observer, np.random.default_rng(5)))
    # sigma of a comparison is ln(1.3) / z(0.75); each of the two sensations has its share of the
    # variance
    assert felt.std() * math.sqrt(2.0) == pytest.approx(
        math.log(1.3) / 0.6744897501960817, rel=0.02
    )


def test_every_spread_is_seen_where_it_belongs():
    noisy = Observer(weber=0.0, response_noise=4e-6, participant_spread=0.0)
    table, heights = estimated(noisy, each=400)
    assert np.std(heights - table["height"]) == pytest.approx(4e-6, rel=0.05)
    apart = Observer(weber=0.0, response_noise=0.0, participant_spread=1e-6)
    table, heights = estimated(apart, people=400, each=1)
    errors = (heights - table["height"]).groupby(table["person"])
    assert errors.std().max() < 1e-15
    assert errors.mean().std() == pytest.approx(1e-6, rel=0.15)
    taken = Observer(weber=0.0, response_noise=0.0, participant_spread=0.0, condition_spread=1e-6)
    table, heights = estimated(taken, people=400, each=1)
    errors = (heights - table["height"]).groupby([table["person"], table["setting"]])
    assert errors.std().max() < 1e-15
    assert errors.mean().std() == pytest.approx(1e-6, rel=0.15)


def test_a_lapse_is_the_height_of_some_block_and_no_estimate_is_negative():
    table, heights = estimated(
        Observer(weber=0.0, response_noise=0.0, participant_spread=0.0, lapse=0.5)
    )
    wrong = ~np.isclose(heights, table["height"], rtol=1e-9, atol=0.0)
    # half lapse, of which two thirds get the height of another block
    assert np.mean(wrong) == pytest.approx(1.0 / 3.0, abs=0.05)
    assert all(np.isclose(heights[wrong, np.newaxis], HEIGHTS, rtol=1e-9, atol=0.0).any(axis=1))
    assert estimated(Observer(response_noise=1e-4))[1].min() == 0.0


def test_reading_off_goes_through_what_is_known_and_on_in_straight_lines_of_logarithms():
    curved = HEIGHTS**2.0
    assert interpolate_heights(curved, HEIGHTS, curved) == pytest.approx(HEIGHTS, rel=1e-12)
    assert interpolate_heights([4.0 * curved[-1]], HEIGHTS, curved) == pytest.approx(
        [2.0 * HEIGHTS[-1]], rel=1e-12
    )
    assert interpolate_heights(curved, HEIGHTS[::-1], curved[::-1]) == pytest.approx(
        HEIGHTS, rel=1e-12
    )
    with pytest.raises(StudyError, match="at least two, positive, and rise"):
        interpolate_heights([1.0], HEIGHTS[:1], curved[:1])


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("weber", math.nan, "weber must be finite and not negative, got nan"),
        ("response_noise", -1e-6, "response_noise must be finite"),
        ("participant_spread", math.inf, "participant_spread must be finite"),
        ("condition_spread", -1.0, "condition_spread must be finite"),
        ("lapse", 1.0, "lapse must be a rate from 0 to below 1, got 1"),
        ("realism_gain", math.inf, "realism_gain must be finite, got inf"),
    ],
)
def test_an_impossible_participant_is_refused(field, value, message):
    with pytest.raises(StudyError, match=message):
        Observer(**{field: value})
