"""Budgets.

What the instrument owes, what the scatter of profiles says, and what nobody has stated.
"""

import math

import numpy as np
import pytest

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    Bound,
    Component,
    Instrument,
    Measured,
    ScalePowers,
    average_profiles,
    make_measured_with_instrument,
)
from stepblocks.inspect.conformity import Outcome, judge_measured_conformity
from stepblocks.inspect.noise import Estimate


def quiet(values, std=10e-9):
    return [Estimate(value, std, 60.0) for value in values]


def parts(measured):
    return {part.name: part.std for part in measured.components}


@pytest.mark.parametrize(
    ("axes", "named"),
    [
        ((1.0, 0.0), {"calibration": 50e-9}),  # a height
        ((0.0, 1.0), {"lateral calibration": 100e-9}),  # a width
        (
            (1.0, 2.0),
            {"calibration": 50e-9, "lateral calibration": 200e-9},
        ),  # a radius: width squared over height
    ],
)
def test_a_calibration_counts_with_the_power_in_which_the_value_goes_with_its_axis(axes, named):
    budget = parts(
        make_measured_with_instrument(
            "x", -50e-6, [], Instrument(1e-3, 2e-9, 2e-3), scale_powers=ScalePowers(*axes)
        )
    )
    # a rectangle one count wide
    assert budget.pop("resolution") == pytest.approx(2e-9 / math.sqrt(12.0))
    assert budget == pytest.approx(named)


def test_components_stand_in_the_order_own_calibration_others_resolution():
    measured = make_measured_with_instrument(
        "x", 1e-6, [Component("noise", 1e-9)], Instrument(1e-3), [Component("form", 2e-9)]
    )
    assert [part.name for part in measured.components] == [
        "noise",
        "calibration",
        "form",
        "resolution",
    ]


def test_a_calibration_that_nobody_states_is_named_and_counts_by_its_default():
    measured = make_measured_with_instrument("x", 1e-6, [Component("noise", 3e-9)], Instrument())
    assert measured.unstated == ("calibration",)
    assert measured.std == pytest.approx(math.hypot(3e-9, 0.02 * 1e-6))  # 2 %: Haitjema 1998


def test_one_more_stated_component_never_narrows_an_interval():
    few = Component("repeatability", 10e-9, 2.0)
    widths = [
        Measured("x", 0.0, (few, Component("calibration", std))).compute_expanded_uncertainty()
        for std in (0.0, 2e-9, 5e-9, 10e-9, 30e-9, 100e-9)
    ]
    assert widths == sorted(widths)


def test_of_a_bound_only_its_own_side_is_proven_and_of_no_stated_uncertainty_nothing():
    part = (Component("noise", 10e-9),)
    for value, bound, verdict in (
        (1e-6, Bound.AT_MOST, Outcome.CONFORMS),
        (3e-6, Bound.AT_MOST, Outcome.NOT_PROVEN),
        (3e-6, Bound.AT_LEAST, Outcome.DOES_NOT_CONFORM),
        (1e-6, Bound.AT_LEAST, Outcome.NOT_PROVEN),
    ):
        assert (
            judge_measured_conformity(Measured("x", value, part, bound), 0.0, 0.0, 2e-6).verdict
            is verdict
        )
    unknown = (Component("as stated", math.nan, decisive=True),)
    for value in (1e-6, 9e-6):
        assert (
            judge_measured_conformity(Measured("x", value, unknown), 0.0, 0.0, 2e-6).verdict
            is Outcome.NOT_PROVEN
        )


def test_the_interval_is_normal_where_nothing_was_estimated_from_few_values():
    # tables of the normal law
    assert Measured(
        "x", 0.0, (Component("a", 1.0),)
    ).compute_expanded_uncertainty() == pytest.approx(1.959964)
    # Student, 4 degrees
    assert Measured(
        "x", 0.0, (Component("a", 1.0, 4.0),)
    ).compute_expanded_uncertainty() == pytest.approx(2.776445)


def test_a_rectangle_alone_ends_and_beside_a_normal_law_their_sum_is_that_of_draws():
    half = math.sqrt(3.0)  # of a rectangle with a standard deviation of 1
    alone = Measured("x", 0.0, (Component("a", 1.0, bounded=True),))
    assert alone.compute_expanded_uncertainty() == pytest.approx(
        0.95 * half, rel=1e-3
    )  # EA-4/02, S9.14: 1.65
    assert alone.guard == pytest.approx(1.65)  # the guard band of ISO 14253-1 stays
    random = np.random.default_rng(1)
    for normal in (0.3, 1.0, 3.0):
        both = Measured("x", 0.0, (Component("a", 1.0, bounded=True), Component("b", normal)))
        draws = random.uniform(-half, half, 400_000) + random.normal(0.0, normal, 400_000)
        assert both.compute_expanded_uncertainty() == pytest.approx(
            np.quantile(np.abs(draws), 0.95), rel=5e-3
        )


def test_profiles_that_differ_by_no_more_than_their_noise_show_no_repeatability():
    random = np.random.default_rng(1)
    measured = average_profiles("x", quiet(random.normal(1e-5, 10e-9, 12), 1e-6), Instrument(0.0))
    assert parts(measured)["repeatability"] == 0.0
    assert measured.std < 10e-9  # the scatter itself, not the larger noise that was claimed


@pytest.mark.parametrize("count", [3, 12, 60])
def test_the_mean_of_independent_profiles_is_uncertain_by_their_scatter_over_root_n(
    count,
):
    variances = []
    for seed in range(400):
        values = np.random.default_rng(seed).normal(1e-5, 50e-9, count)
        variances.append(average_profiles("x", quiet(values), Instrument(0.0)).std ** 2)
    assert np.sqrt(np.mean(variances)) == pytest.approx(50e-9 / math.sqrt(count), rel=0.06)


def test_profiles_that_wander_together_are_fewer_than_they_look():
    slow = 1e-5 + 50e-9 * np.cos(np.pi * (np.arange(60) + 0.5) / 60)  # one half wave over the map
    mixed = np.random.default_rng(2).permutation(slow)
    together, apart = (
        average_profiles("x", quiet(values), Instrument(0.0)).std for values in (slow, mixed)
    )
    assert together > 1.5 * apart


@pytest.mark.parametrize("values", [[], [math.nan], [1e-5, math.inf]])
def test_a_mean_over_nothing_is_refused_by_name(values):
    with pytest.raises(MetrologyError, match="step height must come from at least one profile"):
        average_profiles("step height", quiet(values), Instrument())
