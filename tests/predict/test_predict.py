"""Predictions of margins: the closed forms agree with the path of the tip."""

import math

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch
from stepblocks.contact.uncertainty import convert_half_widths_to_stds, estimate_interval
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.predict.predictions import predict_by_formula

SET = load_shipped("crown-margins")


@pytest.mark.repeats
@pytest.mark.parametrize(
    "stimulus", [s for s in SET.stimuli if isinstance(s, MarginBlock)], ids=lambda s: s.id
)
def test_every_margin_block_catches_as_the_dilation_of_its_profile_says(stimulus):
    x = np.arange(-1500, 1501) * 0.2e-6 + 0.1e-6
    z = stimulus.counterface().heights(x)
    found = {
        (p.drag_direction, p.point.ball_radius): p.release.angle
        for p in predict_by_formula(SET)
        if p.stimulus == stimulus.id
    }
    for (drag, radius), angle in found.items():
        path = build_profile_path(x, z, radius)
        sampled = find_steepest_catch(path if drag == "tooth-to-crown" else path.mirrored()).angle
        # a riser between two samples is 0.2 um wide instead of upright: the angle moves by less
        # than 0.2 deg
        assert math.degrees(sampled) == pytest.approx(math.degrees(angle), abs=0.2)


def test_drawn_and_analytic_intervals_of_the_shipped_blocks_agree_but_near_locking():
    # Origin: JCGM 100 against JCGM 101; d ln E / dH grows without bound towards locking, so 100 um
    # is left out.
    ten = load_shipped("paper-ten")
    seen = 0
    for p in predict_by_formula(ten):
        assert p.interval.energy_low <= p.interval.energy_high
        if (
            p.release.status is not Status.RELEASES
            or p.face.far_side > 85e-6
            or p.point.friction > 0.2
        ):
            continue
        seen += 1
        assert p.interval.agrees, (p.stimulus, p.point.friction)
        # the edge may only be rounder than drawn: the expectation lies below the nominal, but
        # within the interval
        assert p.interval.energy_low < p.release.vibration_energy < p.interval.energy_high
        assert p.interval.held_probability == 0.0
    assert seen == 8 * 4 * 2
    near = [
        p for p in predict_by_formula(ten) if p.stimulus == "step-100" and p.point.friction == 0.2
    ]
    assert all(
        p.interval.held_probability > 0.0 and math.isinf(p.interval.energy_high) for p in near
    )
    assert not any(p.interval.agrees for p in near)


def test_the_interval_of_a_prediction_is_that_of_its_stated_tolerances():
    # Origin: half-widths over the root of three (JCGM 100, 4.3.7), the edge's one-sided tolerance
    # about its middle.
    ten = load_shipped("paper-ten")
    (p,) = [
        p
        for p in predict_by_formula(ten)
        if (p.stimulus, p.point.normal_load, p.point.friction) == ("step-050", 0.5, 0.15)
    ]
    lengths = {"height": 1e-6, "edge_radius": 1e-6, "ball_radius": 2e-6}
    spread = convert_half_widths_to_stds(
        lengths | {"friction": 0.01, "normal_load": 0.005, "stiffness": 0.02 * 9810.0}
    )
    assert p.interval == estimate_interval(
        Step(50e-6, 1e-6), OperatingPoint(125e-6, 0.5, 0.15), spread, draws=2000
    )


def test_every_margin_has_an_interval_in_both_directions():
    for p in predict_by_formula(SET):
        if p.release.status is Status.RELEASES:
            assert p.interval.energy_low < p.interval.energy_high
            assert p.interval.force_low < p.interval.force_high


def test_over_and_underextension_are_mirror_images():
    angles = {
        (p.stimulus, p.drag_direction): p.release.angle
        for p in predict_by_formula(SET)
        if p.point.ball_radius == 125e-6
    }
    over, under = "gap-050-over-020", "gap-050-under-020"
    assert angles[over, "tooth-to-crown"] == pytest.approx(
        angles[under, "crown-to-tooth"], rel=1e-12
    )
    assert angles[over, "crown-to-tooth"] == angles[under, "tooth-to-crown"] == 0.0


def test_the_limits_of_a_prediction_are_the_equations_at_the_limits_of_height_and_edge():
    # Origin: equations (1) and (2) at 49 and 51 um, edge radius 2 and 0 um, by hand.
    ten = load_shipped("paper-ten")
    (found,) = [
        p
        for p in predict_by_formula(ten)
        if (p.stimulus, p.point.normal_load, p.point.friction) == ("step-050", 0.5, 0.15)
    ]
    for release, height, radius in zip(found.limits, (49e-6, 51e-6), (127e-6, 125e-6), strict=True):
        angle = math.acos(1.0 - height / radius)
        force = 0.5 * math.tan(angle + math.atan(0.15))
        assert release.pull_force == pytest.approx(force, rel=1e-12)
        assert release.vibration_energy == pytest.approx(0.2 * force**2 / (2 * 9810.0), rel=1e-12)


def test_a_block_that_may_lock_within_its_tolerance_says_so():
    from stepblocks.predict.columns import format_row_cells, make_prediction_row

    ten = load_shipped("paper-ten")
    rows = [
        format_row_cells(make_prediction_row(p))
        for p in predict_by_formula(ten)
        if p.stimulus == "step-100" and p.point.friction == 0.2
    ]
    # locking height at mu 0.2 is 100.49 um: 100 um would take 76 to 278 N, more than a hand pulls,
    # 101 um is locked
    assert {row["status_at_limits"] for row in rows} == {"beyond-hand/locked"}
    assert {row["status"] for row in rows} == {"beyond-hand"}
    assert {row["vibration_energy_uj"] for row in rows} == {""}
    assert {row["vibration_energy_high_uj"] for row in rows} == {""}
