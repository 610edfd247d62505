"""Sensation: levels over threshold, telling blocks apart, and height as the inverse of energy."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import ContactError
from stepblocks.predict.perception import (
    PAPER_OBSERVER,
    Observer,
    choose_energies,
    compute_discriminability,
    compute_sensation_level,
    find_equally_spaced_heights,
    find_height_of_energy,
)
from stepblocks.predict.predictions import predict_one

POINT, EDGE = OperatingPoint(131e-6, 0.8, 0.17, Tool(8.7e3, 0.23)), 9e-6


def energy(height):
    return Step(height, EDGE).release(POINT).vibration_energy


def test_ten_microjoule_are_39_decibel_over_the_papers_threshold():
    # Origin: the paper, 625 uW against 0.08 uW: a factor 7812.5.
    assert compute_sensation_level(10e-6) == pytest.approx(10 * math.log10(7812.5))
    assert compute_sensation_level(10e-6) > 0
    assert compute_sensation_level(1e-9) < 0
    assert compute_sensation_level(10e-6, masker_power=1e-3) < compute_sensation_level(10e-6)


def test_one_just_noticeable_difference_is_the_weber_fraction_and_75_percent_correct():
    steps, correct = compute_discriminability(
        10e-6, 10e-6 * 10 ** (0.1 * PAPER_OBSERVER.level_difference)
    )
    assert steps == pytest.approx(1.0)
    assert correct == pytest.approx(0.75)


def test_blocks_of_an_equally_felt_set_are_equally_discriminable():
    # on 20 to 33 um both models agree; up to 70 um the drag rings twice as much as the formula
    # keeps, and speaks for all
    for top, who, rel in ((33e-6, "formula", 1e-9), (70e-6, "drag", 0.05)):
        heights, spacing, by = find_equally_spaced_heights(6, 20e-6, top, POINT, EDGE)
        energies, said = choose_energies(
            [predict_one(Step(float(h), EDGE), POINT) for h in heights]
        )
        assert (by, said) == (who, who)
        steps = [compute_discriminability(a, b)[0] for a, b in pairwise(energies)]
        assert steps == pytest.approx([spacing] * 5, rel=rel)
        assert heights[0] == pytest.approx(20e-6)
        assert heights[-1] == pytest.approx(top)
        assert np.ptp(np.diff(heights)) > 0.1e-6


def test_a_set_whose_lowest_block_does_not_ring_in_time_cannot_be_equally_felt():
    with pytest.raises(ContactError, match=r"25 um does not ring in time under 0\.25 N"):
        find_equally_spaced_heights(4, 25e-6, 75e-6, replace(PAPER, normal_load=0.25))


def test_height_and_energy_are_inverse():
    for height in (3e-6, 40e-6, 100e-6):
        assert find_height_of_energy(energy(height), POINT, EDGE) == pytest.approx(
            height, rel=1e-11
        )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: compute_sensation_level(0.0), "energy must be positive"),
        (lambda: Observer(0.0, 1.0, 1.0, 0.0), "threshold_power"),
        (lambda: find_equally_spaced_heights(1, 1e-6, 2e-6, POINT, EDGE), "at least 2 blocks"),
        (lambda: find_equally_spaced_heights(3, 1e-6, 135e-6, POINT, EDGE), "locks from"),
        (lambda: find_height_of_energy(1e-9, POINT, EDGE), "no step rings so little"),
    ],
)
def test_what_nobody_could_feel_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()
