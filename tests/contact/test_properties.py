"""Laws that hold for every surface and condition.

Dimensions, mirrors, monotony, limits, inverses.
"""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings, strategies as st

from stepblocks.contact import kernels
from stepblocks.contact.counterface import Groove, Margin, Profile, Step
from stepblocks.contact.critical_angle import find_margin_angles, find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.contact.laws import LinearContact
from stepblocks.contact.operating_point import PAPER, Limits, OperatingPoint, Tool
from stepblocks.contact.path.profile import build_profile_path
from stepblocks.drag.probe import DragSettings, build_probe_of_tool
from stepblocks.drag.run import drag_over
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_step_track

LENGTHS, LOADS = st.floats(5e-6, 90e-6), st.floats(0.05, 3.0)
FRICTIONS, BALLS = st.floats(0.0, 0.4), st.floats(100e-6, 300e-6)
SCALES = st.floats(0.2, 20.0)
TEXTURES = st.lists(st.floats(-8e-6, 8e-6), min_size=12, max_size=40)
FEW = settings(max_examples=12, deadline=None)
MANY = settings(deadline=None)


def profile_of(heights, scale=1.0):
    return Profile(np.arange(len(heights)) * 25e-6 * scale, np.array(heights) * scale)


@MANY
@given(LENGTHS, BALLS, LOADS, FRICTIONS, SCALES)
def test_scaling_all_lengths_keeps_angle_and_force(height, ball, load, friction, scale):
    small = Step(height).release(OperatingPoint(ball, load, friction))
    large = Step(height * scale).release(OperatingPoint(ball * scale, load, friction))
    assert math.isclose(small.angle, large.angle, rel_tol=1e-12)
    np.testing.assert_allclose(small.pull_force, large.pull_force, rtol=1e-9)


@MANY
@given(LENGTHS, BALLS, LOADS, FRICTIONS, SCALES)
def test_force_goes_with_the_load_and_energy_with_its_square(height, ball, load, friction, scale):
    unlimited = Tool(limits=Limits())
    one = Step(height).release(OperatingPoint(ball, load, friction, unlimited))
    more = Step(height).release(OperatingPoint(ball, load * scale, friction, unlimited))
    np.testing.assert_allclose(more.pull_force, scale * one.pull_force, rtol=1e-12)
    np.testing.assert_allclose(more.vibration_energy, scale**2 * one.vibration_energy, rtol=1e-12)


@MANY
@given(LENGTHS, LOADS, SCALES)
def test_energy_goes_inversely_with_the_stiffness_and_with_the_conversion(height, load, scale):
    angle = find_step_angle(height, 125e-6)
    base = find_release(angle, load, 0.1, Tool(conversion=0.04))
    stiffer = find_release(angle, load, 0.1, Tool(stiffness=scale * 9.81e3, conversion=0.04))
    livelier = find_release(angle, load, 0.1, Tool(conversion=0.04 * scale))
    np.testing.assert_allclose(stiffer.vibration_energy * scale, base.vibration_energy, rtol=1e-9)
    np.testing.assert_allclose(livelier.vibration_energy, base.vibration_energy * scale, rtol=1e-9)


@MANY
@given(LENGTHS, LENGTHS, BALLS, FRICTIONS)
def test_a_higher_step_holds_no_less(first, second, ball, friction):
    low, high = sorted((first, second))
    forces = [
        np.nan_to_num(Step(h).release(OperatingPoint(ball, 1.0, friction)).pull_force, nan=math.inf)
        for h in (low, high)
    ]
    assert forces[0] <= forces[1] * (1.0 + 1e-12)


@MANY
@given(LENGTHS, BALLS, BALLS, st.floats(0.0, 50e-6))
def test_a_larger_ball_and_a_rounder_edge_climb_more_gently(height, first, second, edge):
    small, large = sorted((first, second))
    assert find_step_angle(height, large) <= find_step_angle(height, small) + 1e-12
    assert find_step_angle(height, small, edge) <= find_step_angle(height, small) + 1e-12


@MANY
@given(LENGTHS, BALLS)
def test_height_and_angle_are_inverse(height, ball):
    angle = kernels.compute_edge_contact_angle(height, ball)
    assert math.isclose(kernels.compute_height_at_angle(angle, ball), height, rel_tol=1e-9)


@MANY
@given(BALLS, st.floats(1e-3, 1.5))
def test_at_the_locking_height_angle_and_friction_make_a_right_angle(ball, friction):
    height = kernels.compute_locking_height(ball, friction)
    total = find_step_angle(height, ball) + math.atan(friction)
    assert math.isclose(total, 0.5 * math.pi, rel_tol=1e-7)


@MANY
@given(st.floats(0.0, 200e-6), st.floats(-50e-6, 50e-6), BALLS)
def test_a_margin_seen_from_the_other_side_is_its_mirror(opening, rise, ball):
    np.testing.assert_allclose(
        find_margin_angles(opening, rise, ball),
        find_margin_angles(opening, -rise, ball)[::-1],
        atol=1e-12,
    )


@MANY
@given(LENGTHS, BALLS)
def test_a_margin_without_a_gap_is_a_step(rise, ball):
    assert math.isclose(Margin(0.0, 0.0, rise).angles(ball)[0], find_step_angle(rise, ball))
    assert Margin(0.0, 0.0, rise).angles(ball)[1] == 0.0


@MANY
@given(st.floats(0.0, 1e-9), BALLS, FRICTIONS)
def test_a_step_that_vanishes_asks_the_pull_of_sliding(height, ball, friction):
    release = Step(height).release(OperatingPoint(ball, 1.0, friction))
    if release.status is Status.RELEASES:
        assert math.isclose(release.pull_force, friction, abs_tol=0.01)


@FEW
@given(TEXTURES, SCALES)
def test_scaling_a_profile_and_the_ball_keeps_every_critical_angle(heights, scale):
    small = profile_of(heights).angles(125e-6)
    large = profile_of(heights, scale).angles(125e-6 * scale)
    np.testing.assert_allclose(small, large, atol=1e-6)


@FEW
@given(TEXTURES)
def test_a_mirrored_profile_changes_its_directions(heights):
    there = profile_of(heights)
    back = Profile(-there.x[::-1], there.z[::-1])
    np.testing.assert_allclose(there.angles(125e-6), back.angles(125e-6)[::-1], atol=1e-6)


@FEW
@given(TEXTURES, st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3))
def test_where_the_origin_lies_changes_no_angle(heights, along, up):
    here = profile_of(heights)
    there = Profile(here.x + along, here.z + up)
    np.testing.assert_allclose(here.angles(125e-6), there.angles(125e-6), atol=1e-6)


@FEW
@given(TEXTURES)
def test_the_path_lies_on_or_above_the_surface_and_below_its_top(heights):
    face = profile_of(heights)
    path = build_profile_path(face.x, face.z, 125e-6)
    surface = np.interp(path.position, face.x, face.z)
    assert (path.height >= surface - 1e-12).all()
    assert path.height.max() <= face.z.max() + 1e-12


@FEW
@given(TEXTURES)
def test_a_larger_ball_meets_no_steeper_rise(heights):
    face = profile_of(heights)
    angles = [face.angles(ball)[0] for ball in (60e-6, 125e-6, 300e-6)]
    assert angles[0] >= angles[1] - 1e-6
    assert angles[1] >= angles[2] - 1e-6


@MANY
@given(st.floats(20e-6, 120e-6), st.floats(0.05, 1.5), BALLS)
def test_a_groove_holds_the_same_both_ways_and_never_more_than_its_flank(width, flank, ball):
    there, back = Groove(width, flank).angles(ball)
    assert there == back <= flank + 1e-12


@MANY
@given(LENGTHS, LENGTHS)
def test_there_and_back_the_change_of_an_energy_is_none(first, second):
    there = find_energy_change(Step(first), Step(second), PAPER)
    back = find_energy_change(Step(second), Step(first), PAPER)
    if not math.isnan(there):
        assert math.isclose((1.0 + there) * (1.0 + back), 1.0, rel_tol=1e-9)


@FEW
@given(st.floats(10e-6, 60e-6), st.floats(0.3, 1.5), st.floats(0.0, 0.25), st.floats(0.3, 5.0))
def test_the_drag_has_no_unit_of_force(height, load, friction, scale):
    # loads, stiffnesses and masses times a factor: the motion stays, forces and energies go with it
    def drag(factor):
        tool = Tool(stiffness=9.81e3 * factor)
        contact = LinearContact(3e7 * factor)
        return drag_over(
            Step(height),
            load=load * factor,
            friction=friction,
            tool=tool,
            contact=contact,
            speed=20e-3,
        ).trace

    # to the time step, which follows the stiffness of the contact
    one, more = drag(1.0), drag(scale)
    np.testing.assert_allclose(more.peak_force, one.peak_force * scale, rtol=1e-2)
    np.testing.assert_allclose(more.stored_energy, one.stored_energy * scale, rtol=2e-2)


@FEW
@given(st.floats(15e-6, 60e-6), st.floats(0.3, 1.2), st.floats(0.5, 3.0))
def test_the_drag_has_no_unit_of_length(height, load, scale):
    # lengths and speeds times s, stiffness, mass and loss per speed over s: every force stays
    def drag(s):
        tool = replace(PAPER.tool, stiffness=PAPER.tool.stiffness / s)
        probe = build_probe_of_tool(tool, 125e-6 * s, LinearContact(3e7 / s), contact_loss=5.0 / s)
        settings = DragSettings(load, 0.15, speed=20e-3 * s, lead=20e-6 * s)
        return simulate_drag(build_step_track(height * s, 125e-6 * s), probe, settings)

    one, other = drag(1.0), drag(scale)
    np.testing.assert_allclose(other.peak_force, one.peak_force, rtol=2e-3)
    np.testing.assert_allclose(other.stored_energy, one.stored_energy * scale, rtol=4e-3)


@FEW
@given(st.floats(10e-6, 60e-6), st.floats(-0.3e-3, 0.3e-3))
def test_the_drag_knows_no_origin(height, along):
    x, z = np.array([-0.5e-3, 0.0, 0.0, 0.5e-3]), np.array([0.0, 0.0, height, height])
    here, there = (drag_over(Profile(x + shift, z), speed=20e-3) for shift in (0.0, along))
    np.testing.assert_allclose(there.trace.peak_force, here.trace.peak_force, rtol=1e-3)
    np.testing.assert_allclose(there.events.x_m - along, here.events.x_m, atol=1e-9)
