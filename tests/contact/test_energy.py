"""Equations (1) and (2): the paper's figures, limits, symmetries and locking."""

import math

import pytest

from stepblocks.contact.critical_angle import find_margin_angles, find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.kernels import compute_locking_height
from stepblocks.contact.operating_point import PAPER, Limits, Tool
from stepblocks.errors import ContactError

R = 125e-6
UNLIMITED = Tool(limits=Limits())  # the equations alone


# Origin: evaluated by hand from equations (1) and (2) for mu 0.15, F_py 1 N, R 125 um (project
# facts).
@pytest.mark.parametrize(
    ("height_um", "force_n", "energy_uj"),
    [
        (10, 0.615, 3.86),
        (25, 1.014, 10.5),
        (50, 1.854, 35.0),
        (75, 3.720, 141.0),
        (100, 19.04, 3696.0),
    ],
)
def test_the_papers_constants_give_the_papers_forces_and_energies(height_um, force_n, energy_uj):
    release = find_release(find_step_angle(height_um * 1e-6, R), 1.0, 0.15, UNLIMITED)
    assert release.status is Status.RELEASES
    assert release.pull_force == pytest.approx(force_n, rel=1e-3)
    assert release.vibration_energy * 1e6 == pytest.approx(energy_uj, rel=4e-3)


def test_equation_one_as_printed_equals_the_tangent_of_a_sum():
    a, mu, load = find_step_angle(40e-6, R), 0.21, 0.7
    printed = load * (math.sin(a) + mu * math.cos(a)) / (math.cos(a) - mu * math.sin(a))
    assert find_release(a, load, mu).pull_force == pytest.approx(printed, rel=1e-14)


def test_ten_to_twenty_microjoule_over_sixteen_milliseconds_is_the_papers_power():
    # The paper: E_v 10-20 uJ over 16 ms = 625-1250 uW, detected from 0.08 uW.
    for energy, power in ((10e-6, 625e-6), (20e-6, 1250e-6)):
        assert energy / PAPER.tool.ring_duration == pytest.approx(power, rel=1e-12)
    assert 625e-6 / PAPER.tool.detection_threshold == pytest.approx(7812.5)


def test_each_of_the_papers_four_blocks_rings_with_ten_to_twenty_microjoule_at_some_load():
    # E_v goes with the square of the load, so each block and friction has one window of loads; all
    # overlap 10-20 uJ.
    for mu in (0.1, 0.15, 0.2):
        for height in (25e-6, 50e-6, 75e-6):
            unit = find_release(find_step_angle(height, R), 1.0, mu).vibration_energy
            low, high = math.sqrt(10e-6 / unit), math.sqrt(20e-6 / unit)
            assert find_release(
                find_step_angle(height, R), low, mu
            ).vibration_energy == pytest.approx(10e-6)
            assert find_release(
                find_step_angle(height, R), high, mu
            ).vibration_energy == pytest.approx(20e-6)
            assert 0.1 < low < high < 2.0


@pytest.mark.parametrize(("mu", "height"), [(0.3, 100e-6), (0.15, 120e-6)])
def test_a_locked_probe_has_a_status_and_no_energy(mu, height):
    release = find_release(find_step_angle(height, R), 1.0, mu)
    assert release.status is Status.LOCKED
    assert math.isnan(release.pull_force)
    assert math.isnan(release.vibration_energy)


@pytest.mark.parametrize("mu", [0.05, 0.15, 0.3, 0.6])
def test_locking_begins_at_the_locking_height(mu):
    limit = compute_locking_height(R, mu)
    below, above = (find_step_angle(limit * (1 + part), R) for part in (-1e-9, 1e-9))
    assert find_release(below, 1.0, mu, UNLIMITED).status is Status.RELEASES
    assert find_release(below, 1.0, mu).status is Status.BEYOND_HAND
    assert find_release(above, 1.0, mu).status is Status.LOCKED


@pytest.mark.parametrize("height", [R, 1.5 * R])
def test_a_step_as_high_as_the_ball_is_a_status(height):
    assert find_release(find_step_angle(height, R), 1.0, 0.15).status is Status.TOO_HIGH


def test_scaling_ball_and_step_alike_keeps_the_angle():
    assert find_step_angle(37 * 25e-6, 37 * R, 37 * 4e-6) == pytest.approx(
        find_step_angle(25e-6, R, 4e-6), rel=1e-14
    )


def test_an_edge_radius_that_vanishes_gives_the_sharp_step():
    sharp = find_step_angle(25e-6, R)
    assert find_step_angle(25e-6, R, 1e-18) == pytest.approx(sharp, rel=1e-12)
    assert find_step_angle(25e-6, R, 14e-6) < sharp


def test_a_nanometre_step_keeps_its_digits():
    # Origin: sin(a) = sqrt(2 H/R - (H/R)^2), expanded in H/R.
    h = 1e-9
    assert math.sin(find_step_angle(h, R)) == pytest.approx(
        math.sqrt(2 * h / R - (h / R) ** 2), rel=1e-12
    )


def test_tilting_the_block_is_the_same_as_more_friction():
    a, mu, tilt = find_step_angle(30e-6, R), 0.17, math.radians(3)
    tilted = find_release(a + tilt, 0.8, mu)
    rougher = find_release(a, 0.8, math.tan(math.atan(mu) + tilt))
    assert tilted.pull_force == pytest.approx(rougher.pull_force, rel=1e-12)


def test_a_gap_is_felt_alike_both_ways_and_a_discrepancy_is_not():
    forward, backward = find_margin_angles(60e-6, 0.0, R)
    assert forward == backward == pytest.approx(math.asin(60e-6 / (2 * R)))
    up, down = find_margin_angles(60e-6, 5e-6, R)
    assert up > find_margin_angles(60e-6, 0.0, R)[0] > down > 0
    assert find_margin_angles(60e-6, -5e-6, R) == (down, up)


def test_a_margin_passes_continuously_from_gap_to_step():
    rise = 20e-6
    reach = math.sqrt(rise * (2 * R - rise))
    below, above = (
        find_margin_angles(reach * (1 - 1e-9), rise, R)[0],
        find_margin_angles(reach * (1 + 1e-9), rise, R)[0],
    )
    assert below == pytest.approx(above, rel=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: find_step_angle(-1e-6, R), "height must be finite and not negative"),
        (lambda: find_step_angle(math.nan, R), "height"),
        (lambda: find_step_angle(1e-6, 0.0), "ball_radius must be positive"),
        (lambda: find_margin_angles(-1e-6, 0.0, R), "opening"),
        (lambda: find_release(0.5, -1.0, 0.15), "normal_load must be positive"),
        (lambda: find_release(0.5, 1.0, -0.1), "friction"),
        (lambda: find_release(2.0, 1.0, 0.1), "angle must lie between"),
        (lambda: Tool(0.0, 0.2, 16e-3, 8e-8), "stiffness must be positive"),
    ],
)
def test_what_lies_outside_the_equations_is_refused_with_its_name(call, message):
    with pytest.raises(ContactError, match=message):
        call()


def test_no_comparison_of_these_tests_is_met_by_an_absolute_tolerance():
    assert pytest.approx(2e-13) != 1e-13
    assert pytest.approx([2e-13]) != [1e-13]
