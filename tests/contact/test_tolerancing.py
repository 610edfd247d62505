"""Perceptual tolerances: kept at every corner, used up, and refused with a reason."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.uncertainty import (
    compute_deviated_releases,
    compute_sensitivities,
    find_tolerances_for_energy,
)
from stepblocks.errors import ContactError

STEP, POINT = Step(27e-6, 9e-6), OperatingPoint(131e-6, 0.8, 0.17, Tool(8.7e3, 0.23))


def test_the_tolerances_found_keep_the_band_at_every_corner_and_use_it_up():
    plan = find_tolerances_for_energy(STEP, POINT, 0.10)
    assert plan.achievable
    assert max(plan.worst_high, -plan.worst_low) == pytest.approx(0.10, rel=1e-6)
    rng = np.random.default_rng(4)
    names = ("height", "ball_radius", "edge_radius")
    moved = {name: getattr(plan, name) * rng.uniform(-1, 1, 300) for name in names}
    energies = (
        compute_deviated_releases(STEP, POINT, moved)[1] / STEP.release(POINT).vibration_energy
    )
    assert np.abs(energies - 1.0).max() <= 0.10 + 1e-9


def test_a_tolerance_that_is_given_is_kept_and_leaves_less_for_the_others():
    alone = find_tolerances_for_energy(
        STEP, POINT, 0.10, fixed={"edge_radius": 0.0, "ball_radius": 0.0}
    )
    shared = find_tolerances_for_energy(
        STEP, POINT, 0.10, fixed={"ball_radius": 1e-6, "edge_radius": 0.5e-6}
    )
    assert shared.ball_radius == 1e-6
    assert 0 < shared.height < alone.height
    # first order: t = ln(1.1) / (d ln E / dH)
    assert alone.height == pytest.approx(
        math.log(1.1) / compute_sensitivities(STEP, POINT, {"height": 1e-6})["height"], rel=0.05
    )


def test_when_no_tolerance_will_do_it_says_why():
    friction = find_tolerances_for_energy(STEP, POINT, 0.05, fixed={"friction": 0.05})
    assert not friction.achievable
    assert "friction alone" in friction.reason
    workshop = find_tolerances_for_energy(STEP, POINT, 0.02, finest={"height": 1e-6})
    assert not workshop.achievable
    assert "workshop holds height to 1 um" in workshop.reason


def test_a_share_finer_than_the_workshop_holds_is_not_the_end_if_the_others_can_give_way():
    equal = find_tolerances_for_energy(STEP, POINT, 0.05)
    moved = find_tolerances_for_energy(
        STEP, POINT, 0.05, finest={"ball_radius": 1.3 * equal.ball_radius}
    )
    assert moved.achievable
    assert moved.ball_radius == 1.3 * equal.ball_radius
    assert moved.height < equal.height
    assert max(moved.worst_high, -moved.worst_low) == pytest.approx(0.05, rel=1e-6)


def test_a_step_that_holds_the_tip_has_no_energy_to_keep():
    with pytest.raises(ContactError, match="no energy to keep"):
        find_tolerances_for_energy(STEP, replace(POINT, friction=5.0), 0.1)
