"""How far what is made is felt to be off.

Signs, inverses, and scanned edges read from either side.
"""

import math

import numpy as np
import pytest

from stepblocks.contact.counterface import Margin, Profile, Step, find_critical_angle_of_scan
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.contact.operating_point import OperatingPoint

POINT = OperatingPoint(125e-6, 0.7, 0.15)


def test_a_micrometre_more_is_felt_by_five_to_twenty_percent():
    # Origin: project facts, d ln E / dH is 0.05 to 0.20 per um.
    changes = [find_energy_change(Step(h), Step(h + 1e-6), POINT) for h in (25e-6, 50e-6, 70e-6)]
    assert all(0.045 < math.log1p(change) < 0.21 for change in changes)


def test_a_rounded_edge_is_felt_less_and_the_way_back_undoes_it():
    there, back = (
        find_energy_change(Step(40e-6), Step(40e-6, 9e-6), POINT),
        find_energy_change(Step(40e-6, 9e-6), Step(40e-6), POINT),
    )
    assert there < 0.0 < back
    assert (1.0 + there) * (1.0 + back) == pytest.approx(1.0, rel=1e-14)
    assert find_energy_change(Step(40e-6), Step(40e-6), POINT) == 0.0


def test_a_gap_changes_alike_in_both_directions_and_a_ledge_does_not():
    gap, wider, ledge = (
        Margin(50e-6, 50e-6, 0.0),
        Margin(55e-6, 55e-6, 0.0),
        Margin(50e-6, 50e-6, 3e-6),
    )
    assert (
        find_energy_change(gap, wider, POINT)
        == find_energy_change(gap, wider, POINT, backward=True)
        > 0.0
    )
    assert (
        find_energy_change(gap, ledge, POINT)
        > 0.0
        > find_energy_change(gap, ledge, POINT, backward=True)
    )


def test_without_two_releases_there_is_no_change_to_tell():
    assert math.isnan(find_energy_change(Step(40e-6), Step(120e-6), POINT))  # locks
    # nothing catches
    assert math.isnan(find_energy_change(Step(40e-6), Step(41e-6), POINT, backward=True))


@pytest.mark.parametrize("turned", [False, True])
def test_a_scanned_edge_is_read_up_the_step_whichever_way_the_scan_ran(turned):
    x = np.linspace(-1e-3, 1e-3, 2001)
    z = np.where(x < 0.0, 0.0, 40e-6)
    position, height = (-x[::-1], z[::-1]) if turned else (x, z)
    found = find_critical_angle_of_scan(position, height, 125e-6)
    # the riser is a micrometre wide between two samples
    assert found == pytest.approx(find_step_angle(40e-6, 125e-6), abs=0.01)
    by_scan = find_energy_change(
        Step(40e-6), find_release(found, POINT.normal_load, POINT.friction), POINT
    )
    assert abs(by_scan) < 0.05


def test_a_scan_that_shows_no_edge_has_no_angle():
    x = np.linspace(-1e-3, 1e-3, 2001)
    assert find_critical_angle_of_scan(x, np.zeros(2001), 125e-6) is None
    upright = np.array([-1e-3, *np.linspace(-1e-3, 0.0, 20)[1:], *np.linspace(0.0, 1e-3, 20)])
    # as high as the ball
    assert find_critical_angle_of_scan(upright, np.repeat([0.0, 200e-6], 20), 125e-6) is None
    assert find_critical_angle_of_scan(x, np.full(2001, np.nan), 125e-6) is None
    assert find_critical_angle_of_scan(x[:5], np.zeros(5), 125e-6) is None


def test_what_a_profile_of_the_made_edge_is_felt_by_is_what_its_dimensions_are_felt_by():
    made = Step(41e-6, 8e-6)
    profile = Profile(*made.section(1e-3))
    expected = find_energy_change(Step(40e-6), made, POINT)
    assert find_energy_change(Step(40e-6), profile, POINT) == pytest.approx(expected, abs=0.01)
