"""Intervals, perceptual tolerances and sensation: derivatives, coverage, corners and inverses."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stepblocks.contact.energy import Status
from stepblocks.contact.margin_uncertainty import MarginInputs, MarginSpread, margin_interval_of
from stepblocks.contact.tolerancing import tolerances_for_energy
from stepblocks.contact.uncertainty import Inputs, Spread, interval_of, release_of, sensitivities
from stepblocks.errors import ContactError
from stepblocks.predict.perception import (
    PAPER_OBSERVER,
    Observer,
    detectable,
    discriminability,
    equally_felt_heights,
    height_of_energy,
    sensation_level,
)

NOMINAL = Inputs(27e-6, 9e-6, 131e-6, 0.17, 0.8, 8.7e3, 0.23)
SMALL = Spread(0.1e-6, 0.3e-6, 0.7e-6, 0.002, 0.004, 40.0, 0.001)


@pytest.mark.parametrize("name", list(Inputs.__dataclass_fields__))
def test_each_sensitivity_is_the_derivative(name):
    value = getattr(NOMINAL, name)
    step = 1e-5 * (value or 1e-6)
    up, down = (release_of(replace(NOMINAL, **{name: value + s * step})) for s in (1, -1))
    slopes = sensitivities(NOMINAL)[name]
    for k, channel in ((0, 1), (1, 2)):
        numeric = (math.log(up[channel]) - math.log(down[channel])) / (2 * step)
        assert slopes[k] == pytest.approx(numeric, rel=1e-6, abs=1e-9 / value)


def test_the_energy_changes_by_five_to_twenty_percent_per_micrometre():
    # Origin: project facts, d ln E / dH is 0.05 to 0.20 per um for mu 0.15, R 125 um.
    for height in (15e-6, 25e-6, 50e-6, 75e-6, 85e-6):
        slope = sensitivities(Inputs(height, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2))["height"][1] * 1e-6
        assert 0.045 < slope < 0.21


def test_drawn_and_analytic_intervals_agree_where_all_is_small():
    interval = interval_of(NOMINAL, SMALL, draws=100_000, seed=1)
    assert interval.agrees
    assert interval.energy_low == pytest.approx(interval.analytic_energy_low, rel=5e-3)
    assert interval.energy_high == pytest.approx(interval.analytic_energy_high, rel=5e-3)
    assert interval.held_probability == 0.0


def test_a_95_percent_interval_holds_95_percent_of_the_truths():
    rng = np.random.default_rng(2)
    inside = 0
    interval = interval_of(NOMINAL, SMALL, draws=20_000, seed=0)
    for _ in range(400):
        moved = {n: getattr(NOMINAL, n) + getattr(SMALL, n) * rng.standard_normal() for n in Inputs.__annotations__}
        truth = release_of(replace(NOMINAL, **moved))[2]
        inside += interval.energy_low < truth < interval.energy_high
    assert 0.92 < inside / 400 < 0.98


MARGIN = MarginInputs(62e-6, 62e-6, 9e-6, 117e-6, 0.17, 0.8, 8.7e3, 0.23)
BEVEL = replace(MARGIN, gap=40e-6, opening=90e-6)


@pytest.mark.parametrize("margin", [MARGIN, BEVEL])
@pytest.mark.parametrize("way", ["tooth-to-crown", "crown-to-tooth"])
def test_drawn_and_analytic_intervals_of_a_margin_agree_where_all_is_small(margin, way):
    opening = None if margin is MARGIN else 0.3e-6
    spread = MarginSpread(0.3e-6, opening, 0.2e-6, 0.5e-6, 0.002, 0.004, 40.0, 0.001)
    interval = margin_interval_of(margin, spread, way, draws=100_000, seed=1)
    assert interval.agrees
    assert interval.energy_low == pytest.approx(interval.analytic_energy_low, rel=0.01)
    assert interval.energy_high == pytest.approx(interval.analytic_energy_high, rel=0.01)


def test_a_margin_without_a_gap_has_the_interval_of_a_step():
    spread = MarginSpread(0.0, None, 0.1e-6, 0.7e-6, 0.002, 0.004, 40.0, 0.001)
    margin = replace(MARGIN, gap=0.0, opening=0.0, rise=27e-6)
    step = Inputs(27e-6, 0.0, 117e-6, 0.17, 0.8, 8.7e3, 0.23)
    over = margin_interval_of(margin, spread, "tooth-to-crown", draws=100_000)
    plain = interval_of(step, Spread(0.1e-6, 0.0, 0.7e-6, 0.002, 0.004, 40.0, 0.001), draws=100_000)
    assert over.energy == pytest.approx(plain.energy, rel=1e-12)
    assert over.analytic_energy_high == pytest.approx(plain.analytic_energy_high, rel=1e-6)
    assert over.energy_high == pytest.approx(plain.energy_high, rel=5e-3)
    back = margin_interval_of(margin, spread, "crown-to-tooth")
    assert (back.status, back.energy_low, back.energy_high) == (Status.NO_CATCH, 0.0, 0.0)


def test_where_the_kind_of_contact_changes_within_the_tolerance_the_analytic_interval_does_not_agree():
    # a gap as wide as the ball's reach over the step: narrower, the ball rides on the shoulder; wider, it sinks
    reach = math.sqrt(9e-6 * (2 * 117e-6 - 9e-6))
    edge = replace(MARGIN, gap=reach, opening=reach)
    assert not margin_interval_of(edge, MarginSpread(gap=4e-6), "crown-to-tooth").agrees


def test_near_locking_the_draws_say_held_and_the_analytic_interval_does_not_agree():
    near = Inputs(105e-6, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2)
    interval = interval_of(near, Spread(height=1e-6), seed=3)
    assert interval.status is Status.RELEASES
    assert 0.01 < interval.held_probability < 0.5
    assert not interval.agrees
    locked = interval_of(replace(near, friction=0.4), Spread(height=1e-6))
    assert locked.status is Status.LOCKED
    assert math.isnan(locked.energy)
    assert math.isinf(locked.energy_high)


def test_known_inputs_give_an_interval_of_no_width():
    interval = interval_of(NOMINAL, Spread())
    assert interval.energy_low == pytest.approx(interval.energy, rel=1e-12)
    assert interval.energy_high == pytest.approx(interval.energy, rel=1e-12)


def test_the_same_seed_gives_the_same_interval_and_another_nearly_so():
    a, b, c = (interval_of(NOMINAL, SMALL, seed=s) for s in (5, 5, 6))
    assert a == b
    assert a != c
    assert a.energy_high == pytest.approx(c.energy_high, rel=0.01)


def test_a_rectangular_tolerance_has_its_width_over_root_three_as_uncertainty():
    assert Spread.of_tolerances(height=1e-6).height == pytest.approx(1e-6 / math.sqrt(3))


def test_the_tolerances_found_keep_the_band_at_every_corner_and_use_it_up():
    plan = tolerances_for_energy(NOMINAL, 0.10)
    assert plan.achievable
    assert max(plan.worst_high, -plan.worst_low) == pytest.approx(0.10, rel=1e-6)
    rng = np.random.default_rng(4)
    energy = release_of(NOMINAL)[2]
    for _ in range(300):
        moved = {n: getattr(NOMINAL, n) + getattr(plan, n) * rng.uniform(-1, 1) for n in ("height", "ball_radius")}
        moved["edge_radius"] = NOMINAL.edge_radius + plan.edge_radius * rng.uniform(-1, 1)
        assert abs(release_of(replace(NOMINAL, **moved))[2] / energy - 1.0) <= 0.10 + 1e-9


def test_a_tolerance_that_is_given_is_kept_and_leaves_less_for_the_others():
    alone = tolerances_for_energy(NOMINAL, 0.10, weights={"edge_radius": 0.0, "ball_radius": 0.0})
    shared = tolerances_for_energy(NOMINAL, 0.10, fixed={"ball_radius": 1e-6, "edge_radius": 0.5e-6})
    assert shared.ball_radius == 1e-6
    assert 0 < shared.height < alone.height
    # first order: t = ln(1.1) / (d ln E / dH)
    assert alone.height == pytest.approx(math.log(1.1) / sensitivities(NOMINAL)["height"][1], rel=0.05)


def test_when_no_tolerance_will_do_it_says_why():
    friction = tolerances_for_energy(NOMINAL, 0.05, fixed={"friction": 0.05})
    assert not friction.achievable
    assert "friction alone" in friction.reason
    workshop = tolerances_for_energy(NOMINAL, 0.02, finest={"height": 1e-6})
    assert not workshop.achievable
    assert "workshop holds height to 1 um" in workshop.reason


def test_a_share_finer_than_the_workshop_holds_is_not_the_end_if_the_others_can_give_way():
    equal = tolerances_for_energy(NOMINAL, 0.05)
    moved = tolerances_for_energy(NOMINAL, 0.05, finest={"ball_radius": 1.3 * equal.ball_radius})
    assert moved.achievable
    assert moved.ball_radius == 1.3 * equal.ball_radius
    assert moved.height < equal.height
    assert max(moved.worst_high, -moved.worst_low) == pytest.approx(0.05, rel=1e-6)


def test_ten_microjoule_are_39_decibel_over_the_papers_threshold():
    # Origin: the paper, 625 uW against 0.08 uW: a factor 7812.5.
    assert sensation_level(10e-6) == pytest.approx(10 * math.log10(7812.5))
    assert detectable(10e-6)
    assert not detectable(1e-9)
    assert sensation_level(10e-6, masker_power=1e-3) < sensation_level(10e-6)


def test_one_just_noticeable_difference_is_the_weber_fraction_and_75_percent_correct():
    steps, correct = discriminability(10e-6, 10e-6 * (1 + PAPER_OBSERVER.weber_fraction))
    assert steps == pytest.approx(1.0)
    assert correct == pytest.approx(0.75)


def test_blocks_of_an_equally_felt_set_are_equally_discriminable():
    heights, spacing = equally_felt_heights(6, 12e-6, 70e-6, NOMINAL)
    energies = [release_of(replace(NOMINAL, height=float(h)))[2] for h in heights]
    steps = [discriminability(a, b)[0] for a, b in pairwise(energies)]
    assert steps == pytest.approx([spacing] * 5, rel=1e-9)
    assert heights[0] == pytest.approx(12e-6)
    assert heights[-1] == pytest.approx(70e-6)
    assert np.ptp(np.diff(heights)) > 1e-6


def test_height_and_energy_are_inverse():
    for height in (3e-6, 40e-6, 100e-6):
        energy = release_of(replace(NOMINAL, height=height))[2]
        assert height_of_energy(energy, NOMINAL) == pytest.approx(height, rel=1e-11)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Spread(height=-1.0), "uncertainty of height"),
        (lambda: MarginSpread(rise=-1.0), "uncertainty of rise"),
        (lambda: margin_interval_of(MARGIN, MarginSpread(), "up"), "direction must be"),
        (lambda: margin_interval_of(replace(MARGIN, gap=-1e-6), MarginSpread(), "crown-to-tooth"), "gap must be"),
        (lambda: interval_of(NOMINAL, SMALL, confidence=1.0), "confidence"),
        (lambda: interval_of(NOMINAL, SMALL, draws=3), "draws"),
        (lambda: sensitivities(replace(NOMINAL, friction=5.0)), "locked"),
        (lambda: tolerances_for_energy(NOMINAL, 1.5), "energy_tolerance"),
        (lambda: tolerances_for_energy(NOMINAL, 0.1, fixed={"colour": 1.0}), "must name one of"),
        (lambda: tolerances_for_energy(replace(NOMINAL, friction=5.0), 0.1), "no energy to keep"),
        (lambda: sensation_level(0.0), "energy must be positive"),
        (lambda: Observer(0.0, 1.0, 1.0, 0.0), "threshold_power"),
        (lambda: equally_felt_heights(1, 1e-6, 2e-6, NOMINAL), "at least 2 blocks"),
        (lambda: equally_felt_heights(3, 1e-6, 135e-6, NOMINAL), "locks from"),
        (lambda: height_of_energy(1e-9, NOMINAL), "no step rings so little"),
    ],
)
def test_what_cannot_be_answered_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()
