"""Sensation: levels over threshold, and telling blocks apart."""

import math

import pytest

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.errors import ContactError
from stepblocks.predict.perception import (
    PAPER_OBSERVER,
    Observer,
    choose_energies,
    compute_discriminability,
    compute_sensation_level,
)
from stepblocks.predict.predictions import predict_one

POINT, EDGE = OperatingPoint(131e-6, 0.8, 0.17, Tool(8.7e3, 0.23)), 9e-6


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


def test_where_drag_and_formula_differ_for_one_block_the_drag_speaks_for_all():
    # from 20 to 33 um both agree; at 70 um the drag rings twice as much as the formula keeps
    for top, by in ((33e-6, "formula"), (70e-6, "drag")):
        made = [predict_one(Step(height, EDGE), POINT) for height in (20e-6, top)]
        energies, said = choose_energies(made)
        assert said == by
        one = made[0]
        kept = one.release.vibration_energy if by == "formula" else one.in_time.energy
        assert energies[0] == kept


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: compute_sensation_level(0.0), "energy must be positive"),
        (lambda: Observer(0.0, 1.0, 1.0, 0.0), "threshold_power"),
    ],
)
def test_what_nobody_could_feel_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()
