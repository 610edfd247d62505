"""Predictions of margins: the closed forms and the path of the tip over the section tell the same."""

import math
from pathlib import Path

import numpy as np
import pytest

from stepblocks.contact.catches import steepest
from stepblocks.contact.tip import Ball
from stepblocks.contact.tip_path import profile_path
from stepblocks.pipeline.predict import predict_set
from stepblocks.stimulus.loader import load_set
from stepblocks.stimulus.margin import MarginBlock
from stepblocks.stimulus.profile import surface_height

SET = load_set(Path(__file__).resolve().parents[2] / "stimuli" / "crown-margins.toml")


@pytest.mark.parametrize("stimulus", [s for s in SET.stimuli if isinstance(s, MarginBlock)], ids=lambda s: s.id)
def test_every_margin_block_catches_as_the_dilation_of_its_profile_says(stimulus):
    x = np.arange(-1500, 1501) * 0.2e-6 + 0.1e-6
    z = surface_height(stimulus, x)
    found = {(p.drag, p.tip_radius): p.release.angle for p in predict_set(SET) if p.stimulus == stimulus.id}
    for (drag, radius), angle in found.items():
        path = profile_path(x, z, Ball(radius), edges="flat")
        sampled = steepest(path, "forward" if drag == "tooth-to-crown" else "backward").angle
        # a riser between two samples is 0.2 um wide instead of upright: the angle moves by less than 0.2 deg
        assert math.degrees(sampled) == pytest.approx(math.degrees(angle), abs=0.2)


def test_over_and_underextension_are_mirror_images():
    angles = {(p.stimulus, p.drag): p.release.angle for p in predict_set(SET) if p.tip_radius == 125e-6}
    over, under = "gap-050-over-020", "gap-050-under-020"
    assert angles[over, "tooth-to-crown"] == pytest.approx(angles[under, "crown-to-tooth"], rel=1e-12)
    assert angles[over, "crown-to-tooth"] == angles[under, "tooth-to-crown"] == 0.0


def test_the_limits_of_a_prediction_are_the_equations_at_the_limits_of_height_and_edge():
    # Origin: equations (1) and (2) at 49 and 51 um, edge radius 2 and 0 um, by hand.
    ten = load_set(Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml")
    (found,) = [p for p in predict_set(ten) if (p.stimulus, p.normal_load, p.friction) == ("step-050", 0.5, 0.15)]
    for release, height, radius in zip(found.limits, (49e-6, 51e-6), (127e-6, 125e-6), strict=True):
        angle = math.acos(1.0 - height / radius)
        force = 0.5 * math.tan(angle + math.atan(0.15))
        assert release.pull_force == pytest.approx(force, rel=1e-12)
        assert release.vibration_energy == pytest.approx(0.2 * force**2 / (2 * 9810.0), rel=1e-12)


def test_a_block_that_may_lock_within_its_tolerance_says_so():
    from stepblocks.pipeline.predict import as_row

    ten = load_set(Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml")
    rows = [as_row(p) for p in predict_set(ten) if p.stimulus == "step-100" and p.friction == 0.2]
    # locking height at mu 0.2 is 100.49 um: 100 um releases, 101 um is locked
    assert {row["status_at_limits"] for row in rows} == {"releases/locked"}
    assert {row["vibration_energy_high_uj"] for row in rows} == {""}
