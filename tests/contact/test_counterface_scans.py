"""Promise: whatever takes a counterface takes a scanned profile, and a user never converts one."""

import numpy as np
import pytest

import stepblocks
from stepblocks import PAPER, Profile, ScannedProfile, Step


@pytest.fixture
def scan():
    x = np.linspace(-0.5e-3, 0.5e-3, 1001)
    z = np.where(x < 0.0, 0.0, 25e-6)
    z[100:140] = np.nan  # a dropout, which straight lines bridge
    return ScannedProfile(x, z)


@pytest.mark.parametrize("backward", [False, True])
def test_energies_over_a_scan_are_those_over_the_profile_it_shows(scan, backward):
    profile = Profile.from_scan(scan)
    for first, second in ((scan, profile), (profile, scan)):
        change = stepblocks.find_energy_change(first, second, PAPER, backward)
        # down a step nothing releases: not a number
        np.testing.assert_equal(change, np.nan if backward else 0.0)
    found = stepblocks.estimate_interval(scan, PAPER, {"friction": 0.01}, backward=backward)
    assert str(found) == str(
        stepblocks.estimate_interval(profile, PAPER, {"friction": 0.01}, backward=backward)
    )


def test_the_ring_over_a_scan_of_a_sharp_step_is_that_of_the_step(scan):
    # the scan's riser is one sample of 1 um wide, so that the ball meets its upper corner alone
    scanned = stepblocks.list_vibration_events(scan, PAPER)[0]
    declared = stepblocks.list_vibration_events(Step(25e-6), PAPER)[0]
    assert scanned.energy == pytest.approx(declared.energy, rel=1e-3)


@pytest.mark.parametrize("given", ["25 um", 3.0, None, stepblocks.HeightMap(np.eye(4), 1.0, 1.0)])
def test_what_is_neither_is_refused_with_what_it_must_be(given):
    with pytest.raises(stepblocks.StepblocksError, match="must be a counterface such as Step"):
        stepblocks.list_vibration_events(given, PAPER)
