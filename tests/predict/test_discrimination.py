"""Distances between rings in just noticeable differences, against Weber's and Fechner's laws."""

import math

import numpy as np
import pandas as pd
import pytest

from stepblocks.errors import StepblocksError
from stepblocks.predict.perception import (
    LITERATURE,
    Discrimination,
    WeberFraction,
    compute_jnd_distance,
    read_discrimination,
)

KNOWN = Discrimination((WeberFraction(0.25, 0.25, 0.25),), "test")


def test_one_difference_is_the_weber_fraction_and_three_of_four_judgements():
    # Weber's law: E (1 + w) is one difference from E; its definition: 75 % correct
    distance = compute_jnd_distance(8e-6, 10e-6, KNOWN)
    assert distance.jnd == pytest.approx(1.0)
    assert distance.correct_share == pytest.approx(0.75)
    assert (distance.low, distance.high) == pytest.approx((1.0, 1.0))
    assert compute_jnd_distance(10e-6, 8e-6, KNOWN).jnd == pytest.approx(-1.0)


def test_distances_add_up_and_the_literature_has_one_and_a_half_decibels():
    steps = [compute_jnd_distance(a, b).jnd for a, b in ((1e-6, 3e-6), (3e-6, 7e-6), (1e-6, 7e-6))]
    assert steps[0] + steps[1] == pytest.approx(steps[2])
    assert compute_jnd_distance(1e-6, 10 ** (0.15) * 1e-6).jnd == pytest.approx(1.0)


def test_a_fraction_that_grows_with_energy_is_integrated_as_fechner_did():
    # Reference: the integral of d ln E / ln(1 + w(E)), by quadrature of SciPy
    quad = pytest.importorskip("scipy.integrate").quad
    table = pd.DataFrame({"energy_uj": [1.0, 100.0], "weber_fraction_pct": [20.0, 60.0]})
    measured = read_discrimination(table)
    slope = math.log(3.0) / math.log(100.0)

    def density(log_energy):
        return 1.0 / math.log1p(0.2 * math.exp(slope * log_energy))

    expected = quad(density, math.log(2.0), math.log(50.0))[0]
    assert compute_jnd_distance(2e-6, 50e-6, measured).jnd == pytest.approx(expected, rel=2e-3)


def test_the_interval_holds_what_the_person_and_the_blocks_leave_open():
    # the interval of the person alone: the distance at both ends of that of the fraction
    fraction = LITERATURE.fractions[0]
    distance = compute_jnd_distance(5e-6, 20e-6)
    ends = [math.log(4.0) / math.log1p(w) for w in (fraction.high, fraction.low)]
    assert (distance.low, distance.high) == pytest.approx(ends, rel=0.05)
    # the interval of the blocks alone: 1.96 standard uncertainties of the logarithm of the ratio
    draws = math.log(4.0) + 0.1 * np.random.default_rng(3).standard_normal(50_000)
    blocks = compute_jnd_distance(5e-6, 20e-6, KNOWN, log_ratios=draws)
    assert blocks.high - blocks.jnd == pytest.approx(0.196 / math.log(1.25), rel=0.03)
    both = compute_jnd_distance(5e-6, 20e-6, log_ratios=draws[:2000])
    assert both.low < distance.low < distance.high < both.high


def test_every_impossible_row_of_a_table_is_named(tmp_path):
    path = tmp_path / "people.csv"
    path.write_text(
        "energy_uj,weber_fraction,weber_fraction_low,weber_fraction_high\n"
        "1,0.3,0.2,0.5\n10,-0.3,0.2,0.5\n20,0.3,0.4,0.5\n30,0.3,,0.5\n"
    )
    with pytest.raises(StepblocksError) as error:
        read_discrimination(path)
    message = str(error.value)
    assert all(f"line {line}" in message for line in (3, 4, 5))
    assert "line 2" not in message
    path.write_text("energy_uj,weber_fraction\n1,0.3\n1,0.4\n")
    with pytest.raises(StepblocksError, match="rising energies"):
        read_discrimination(path)
    path.write_text("energy_uj\n1\n")
    with pytest.raises(StepblocksError, match="weber_fraction"):
        read_discrimination(path)


@pytest.mark.parametrize(
    ("draws", "rule"),
    [
        ([0.6, 0.7, 0.8], "100 or more numbers, got 3"),
        ([[0.6] * 100], "a row of numbers, got an array of 2 dimensions"),
        ([0.6] * 99 + [math.nan], r"finite numbers, got nan \[place 99\]"),
        (np.ma.masked_less([0.6] * 99 + [0.1], 0.2), "finite numbers, got masked ones"),
    ],
)
def test_draws_of_a_ratio_that_give_no_interval_are_refused_by_their_own_name(draws, rule):
    with pytest.raises(StepblocksError, match=f"^log_ratios must be {rule}"):
        compute_jnd_distance(5e-6, 10e-6, log_ratios=draws)
