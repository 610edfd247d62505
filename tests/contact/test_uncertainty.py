"""Intervals: derivatives, coverage, agreement of draws and sensitivities, and where they part."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, Limits, OperatingPoint, Tool
from stepblocks.contact.uncertainty import (
    compute_deviated_releases,
    compute_sensitivities,
    convert_half_widths_to_stds,
    draw_standard_normal_inputs,
    estimate_interval,
    map_inputs_to_nominal_values,
)
from stepblocks.errors import ContactError

STEP, POINT = Step(27e-6, 9e-6), OperatingPoint(131e-6, 0.8, 0.17, Tool(8.7e3, 0.23))
NAMES = (
    "height",
    "edge_radius",
    "ball_radius",
    "friction",
    "normal_load",
    "stiffness",
    "conversion",
)
SMALL = dict(zip(NAMES, (0.1e-6, 0.3e-6, 0.7e-6, 0.002, 0.004, 40.0, 0.001), strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_each_sensitivity_is_the_derivative(name):
    value = map_inputs_to_nominal_values(STEP, POINT)[name]
    step = 1e-5 * (value or 1e-6)
    up, down = compute_deviated_releases(STEP, POINT, {name: np.array([step, -step])})[1]
    numeric = (math.log(up) - math.log(down)) / (2 * step)
    assert compute_sensitivities(STEP, POINT, {name: 1.0})[name] == pytest.approx(
        numeric, rel=1e-6, abs=1e-9 / value
    )


def test_the_energy_changes_by_five_to_twenty_percent_per_micrometre():
    # Origin: project facts, d ln E / dH is 0.05 to 0.20 per um for mu 0.15, R 125 um.
    for height in (15e-6, 25e-6, 50e-6, 75e-6, 85e-6):
        slope = compute_sensitivities(Step(height), PAPER, {"height": 1e-6})["height"] * 1e-6
        assert 0.045 < slope < 0.21


def test_drawn_and_analytic_intervals_agree_where_all_is_small():
    interval = estimate_interval(STEP, POINT, SMALL, draws=100_000, seed=1)
    assert interval.agrees
    assert interval.energy_low == pytest.approx(interval.analytic_energy_low, rel=5e-3)
    assert interval.energy_high == pytest.approx(interval.analytic_energy_high, rel=5e-3)
    assert interval.held_probability == 0.0


@pytest.mark.parametrize("draws", [100, 200, 237, 400])
def test_the_ends_of_an_interval_are_quantiles_of_the_draws(draws):
    interval = estimate_interval(STEP, POINT, {"friction": 0.01}, draws=draws, seed=3)
    # origin: numpy's quantiles of the forces at the same draws
    friction = (
        0.17
        + 0.01
        * draw_standard_normal_inputs(len(map_inputs_to_nominal_values(STEP, POINT)), draws, 3)[3]
    )
    forces = [STEP.release(replace(POINT, friction=one)).pull_force for one in friction.tolist()]
    ends = np.quantile(forces, [0.025, 0.975], method="inverted_cdf")
    assert (interval.force_low, interval.force_high) == pytest.approx(tuple(ends), rel=1e-9)


def test_a_95_percent_interval_holds_95_percent_of_the_truths():
    rng = np.random.default_rng(2)
    inside = 0
    interval = estimate_interval(STEP, POINT, SMALL, draws=20_000, seed=0)
    for _ in range(400):
        truth = float(
            compute_deviated_releases(
                STEP, POINT, {n: SMALL[n] * rng.standard_normal() for n in NAMES}
            )[1]
        )
        inside += interval.energy_low < truth < interval.energy_high
    assert 0.92 < inside / 400 < 0.98


MARGIN, UNDER = Margin(62e-6, 62e-6, 9e-6), replace(POINT, ball_radius=117e-6)
BEVEL = replace(MARGIN, gap=40e-6, opening=90e-6)


@pytest.mark.parametrize("margin", [MARGIN, BEVEL])
@pytest.mark.parametrize("backward", [False, True])
def test_drawn_and_analytic_intervals_of_a_margin_agree_where_all_is_small(margin, backward):
    spread = {name: SMALL[name] for name in NAMES[3:]} | {
        "gap": 0.3e-6,
        "rise": 0.2e-6,
        "ball_radius": 0.5e-6,
    }
    if margin is BEVEL:
        spread["opening"] = 0.3e-6
    interval = estimate_interval(margin, UNDER, spread, backward=backward, draws=100_000, seed=1)
    assert interval.agrees
    assert interval.energy_low == pytest.approx(interval.analytic_energy_low, rel=0.01)
    assert interval.energy_high == pytest.approx(interval.analytic_energy_high, rel=0.01)


def test_a_margin_without_a_gap_has_the_interval_of_a_step():
    setting = {name: SMALL[name] for name in NAMES[2:]}
    margin = Margin(gap=0.0, opening=0.0, rise=27e-6)
    over = estimate_interval(margin, UNDER, setting | {"rise": 0.1e-6}, draws=100_000)
    plain = estimate_interval(Step(27e-6), UNDER, setting | {"height": 0.1e-6}, draws=100_000)
    assert over.energy == pytest.approx(plain.energy, rel=1e-12)
    assert over.analytic_energy_high == pytest.approx(plain.analytic_energy_high, rel=1e-6)
    assert over.energy_high == pytest.approx(plain.energy_high, rel=5e-3)
    back = estimate_interval(margin, UNDER, setting | {"rise": 0.1e-6}, backward=True)
    assert (back.status, back.energy_low, back.energy_high) == (Status.NO_CATCH, 0.0, 0.0)


def test_the_analytic_interval_fails_where_the_kind_of_contact_changes_within_the_tolerance():
    # a gap as wide as the ball's reach over the step: narrower, the ball rides on the shoulder;
    # wider, it sinks
    reach = math.sqrt(9e-6 * (2 * 117e-6 - 9e-6))
    edge = replace(MARGIN, gap=reach, opening=reach)
    assert not estimate_interval(edge, UNDER, {"gap": 4e-6}, backward=True).agrees


def test_near_locking_the_draws_say_held_and_the_analytic_interval_does_not_agree():
    unlimited = replace(PAPER, tool=Tool(limits=Limits()))
    interval = estimate_interval(Step(105e-6), unlimited, {"height": 1e-6}, seed=3)
    assert interval.status is Status.RELEASES
    assert 0.01 < interval.held_probability < 0.5
    assert not interval.agrees
    locked = estimate_interval(Step(105e-6), replace(PAPER, friction=0.4), {"height": 1e-6})
    assert locked.status is Status.LOCKED
    assert math.isnan(locked.energy)
    assert math.isinf(locked.energy_high)


def test_known_inputs_give_an_interval_of_no_width():
    interval = estimate_interval(STEP, POINT, {})
    assert interval.energy_low == pytest.approx(interval.energy, rel=1e-12)
    assert interval.energy_high == pytest.approx(interval.energy, rel=1e-12)


def test_the_same_seed_gives_the_same_interval_and_another_nearly_so():
    a, b, c = (estimate_interval(STEP, POINT, SMALL, seed=s) for s in (5, 5, 6))
    assert a == b
    assert a != c
    assert a.energy_high == pytest.approx(c.energy_high, rel=0.01)


@pytest.mark.parametrize("width", [1.0, 1e100, 1e293])
def test_an_uncertainty_larger_than_any_block_leaves_the_energy_unknown_and_says_so(width):
    with pytest.raises(ContactError, match="spreads as large as the values"):
        estimate_interval(STEP, POINT, {"height": width})


def test_a_rectangular_tolerance_has_its_width_over_root_three_as_uncertainty():
    assert convert_half_widths_to_stds({"height": 1e-6})["height"] == pytest.approx(
        1e-6 / math.sqrt(3)
    )


def test_a_profile_of_a_step_has_the_interval_of_the_step():
    # Origin: equation (2), reached here by dilating the profile once for every drawn ball.
    profile = Profile(np.array([-1e-3, 0.0, 0.0, 1e-3]), np.array([0.0, 0.0, 27e-6, 27e-6]))
    uncertain = {"ball_radius": 2e-6, "friction": 0.01}
    over, plain = (
        estimate_interval(face, POINT, uncertain, draws=200) for face in (profile, Step(27e-6))
    )
    assert over.energy == pytest.approx(plain.energy, rel=1e-9)
    assert over.analytic_energy_high == pytest.approx(plain.analytic_energy_high, rel=1e-5)
    assert over.agrees == plain.agrees


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: estimate_interval(STEP, POINT, {"height": -1.0}), "uncertainty of height"),
        (lambda: estimate_interval(MARGIN, UNDER, {"rise": -1.0}), "uncertainty of rise"),
        (
            lambda: estimate_interval(MARGIN, UNDER, {"height": 1e-6}),
            "uncertainty must be of gap, opening, rise, ball_radius",
        ),
        (
            lambda: estimate_interval(replace(MARGIN, gap=-1e-6), UNDER, {}, backward=True),
            "gap must be",
        ),
        (lambda: estimate_interval(STEP, POINT, SMALL, draws=3), "draws"),
        (lambda: compute_sensitivities(STEP, replace(POINT, friction=5.0), SMALL), "locked"),
    ],
)
def test_what_cannot_be_answered_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()
