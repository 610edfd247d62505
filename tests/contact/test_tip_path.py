"""The dilation of profiles equals closed forms, brute force and its own symmetries."""

import math

import numpy as np
import pytest

from oracles import tip_paths
from stepblocks.contact.critical_angle import (
    compute_bevelled_margin_angles,
    find_margin_angles,
    find_step_angle,
)
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch
from stepblocks.drag.catches import find_catch_places
from stepblocks.drag.track import build_profile_track
from stepblocks.errors import ContactError

R = 137e-6
RUN = 1.3e-3


def sharp_step(height):
    return np.array([-RUN, 0.0, 0.0, RUN]), np.array([0.0, 0.0, height, height])


def groove(width, rise, depth):
    return np.array([-RUN, 0, 0, width, width, RUN]), np.array([0, 0, -depth, -depth, rise, rise])


def brute(x, z, positions, radius):
    across = x[None, :] - positions[:, None]
    below = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    return np.max(
        np.where(np.abs(across) <= radius, z[None, :] - (radius - below), -np.inf), axis=1
    )


# Origin of every expected value here: equation (2) and the closed forms of `oracles.tip_paths`.
@pytest.mark.parametrize("height", [0.9e-6, 25e-6, 61e-6, 100e-6, 136e-6])
def test_a_sharp_step_has_the_path_and_the_angle_of_equation_two(height):
    path = build_profile_path(*sharp_step(height), R)
    assert path.height == pytest.approx(
        tip_paths.step_path(path.position, height, R), rel=1e-11, abs=1e-12 * height
    )
    assert find_steepest_catch(path).angle == pytest.approx(find_step_angle(height, R), rel=1e-9)
    assert find_steepest_catch(path).contact == 0.0
    assert find_steepest_catch(path.mirrored()).angle == 0.0


@pytest.mark.parametrize("height", [1.001 * R, 2.4 * R])
def test_a_step_as_high_as_the_ball_is_met_at_a_right_angle(height):
    catch = find_steepest_catch(build_profile_path(*sharp_step(height), R))
    assert catch.angle == 0.5 * math.pi
    assert find_release(catch.angle, 1.0, 0.15).status is Status.TOO_HIGH


@pytest.mark.parametrize(
    ("height", "radius"), [(40e-6, 11e-6), (40e-6, 40e-6), (25e-6, 90e-6), (13e-6, 300e-6)]
)
def test_a_rounded_step_follows_its_closed_form_also_where_the_face_cuts_the_arc(height, radius):
    x, z = tip_paths.rounded_step_profile(height, radius, RUN)
    path = build_profile_path(x, z, R)
    expected = tip_paths.step_path(path.position, height, R, radius)
    assert np.abs(path.height - expected).max() < 1e-6 * height
    # the polyline's chords turn by pi/2/4000 per point
    assert find_steepest_catch(path).angle == pytest.approx(
        find_step_angle(height, R, radius), abs=4e-4
    )


@pytest.mark.parametrize(
    ("width", "rise", "depth"),
    [
        (60e-6, 0.0, 1e-3),
        (60e-6, 5e-6, 1e-3),
        (60e-6, -5e-6, 1e-3),
        (70e-6, 30e-6, 1e-3),
        (400e-6, 9e-6, 31e-6),
    ],
)
def test_a_groove_with_or_without_discrepancy_and_floor_equals_its_closed_form(width, rise, depth):
    path = build_profile_path(*groove(width, rise, depth), R)
    expected = tip_paths.groove_path(path.position, width, R, rise, depth)
    assert np.abs(path.height - expected).max() < 1e-11 * R
    forward, backward = tip_paths.groove_angles(width, R, rise, depth)
    assert find_steepest_catch(path).angle == pytest.approx(forward, rel=1e-8)
    assert find_steepest_catch(path.mirrored()).angle == pytest.approx(backward, rel=1e-8)


def test_a_groove_without_a_near_floor_is_the_papers_junction():
    assert tip_paths.groove_angles(60e-6, R, 5e-6) == find_margin_angles(60e-6, 5e-6, R)


def test_a_ridge_is_felt_alike_both_ways():
    height, width = 21e-6, 0.5e-3
    x, z = np.array([-RUN, 0, 0, width, width, 2 * RUN]), np.array([0, 0, height, height, 0, 0])
    path = build_profile_path(x, z, R)
    assert path.height == pytest.approx(
        tip_paths.ridge_path(path.position, height, width, R), abs=1e-11 * height
    )
    up, down = find_steepest_catch(path), find_steepest_catch(path.mirrored())
    assert up.angle == pytest.approx(down.angle, rel=1e-9)
    assert up.angle == pytest.approx(find_step_angle(height, R), rel=1e-9)
    assert (up.contact, down.contact) == (0.0, -width)


def test_the_angle_does_not_depend_on_where_the_path_is_asked_for():
    x, z = sharp_step(33e-6)
    for positions in (np.linspace(-1e-3, 1e-3, 7), np.linspace(-1e-3, 1e-3, 4001)):
        angle = find_steepest_catch(build_profile_path(x, z, R, positions=positions)).angle
        assert angle == pytest.approx(find_step_angle(33e-6, R), rel=1e-9)


def test_a_path_that_is_asked_for_up_to_its_climb_has_the_angle_of_the_whole_step():
    # the tip meets the edge in the last interval alone
    reach = math.sqrt(33e-6 * (2.0 * R - 33e-6))
    positions = np.array([-1e-3, -0.9e-3, -0.5 * reach])
    catch = find_steepest_catch(build_profile_path(*sharp_step(33e-6), R, positions=positions))
    assert catch.angle == pytest.approx(find_step_angle(33e-6, R), rel=1e-9)
    assert catch.position == pytest.approx(-reach, rel=1e-6)


def test_a_polyline_is_never_below_its_samples_and_equals_a_dense_resampling():
    rng = np.random.default_rng(8)
    x = np.linspace(0, 1.7e-3, 80)
    z = rng.normal(size=x.size) * 6e-6
    path = build_profile_path(x, z, R, positions=np.linspace(0.4e-3, 1.3e-3, 91))
    dense = np.linspace(0, 1.7e-3, 79 * 1000 + 1)
    expected = brute(dense, np.interp(dense, x, z), path.position, R)
    assert (path.height >= expected - 1e-15).all()
    assert np.abs(path.height - expected).max() < 1e-12  # spacing^2 / 8R is 0.4 pm


def test_the_slope_of_a_path_is_its_derivative():
    x = np.linspace(-1e-3, 1e-3, 40_001)
    where = np.linspace(-0.9e-3, 0.9e-3, 1201)
    path = build_profile_path(x, 20e-6 * np.sin(x / 90e-6), 60e-6, positions=where)
    smooth = np.abs(np.diff(path.slope)) < 0.02
    mean = 0.5 * (path.slope[1:] + path.slope[:-1])
    rise = np.diff(path.height) / np.diff(path.position)
    assert rise[smooth] == pytest.approx(mean[smooth], abs=2e-3)


def test_mirroring_the_surface_exchanges_the_directions():
    rng = np.random.default_rng(9)
    x = np.linspace(0, 2e-3, 700)
    z = np.cumsum(rng.normal(size=x.size)) * 2e-7
    there, back = build_profile_path(x, z, R), build_profile_path(-x[::-1], z[::-1], R)
    assert find_steepest_catch(there.mirrored()).angle == pytest.approx(
        find_steepest_catch(back).angle, rel=1e-9
    )


def test_every_step_of_a_staircase_is_a_catch_with_its_own_angle():
    heights = [12e-6, 30e-6, 55e-6]
    x, z, level = [-RUN], [0.0], 0.0
    for k, h in enumerate(heights):
        x += [k * 1e-3, k * 1e-3]
        z += [level, level + h]
        level += h
    there, back = (
        find_catch_places(build_profile_track([*x, 4e-3], [*z, level], R, backward=way), R)
        for way in (False, True)
    )
    assert there.angle == pytest.approx([find_step_angle(h, R) for h in heights], rel=1e-8)
    assert there.contact == pytest.approx([0.0, 1e-3, 2e-3], abs=1e-9)
    assert back.angle.size == 0


def test_missing_samples_are_bridged_by_the_tip():
    x = np.linspace(-RUN, RUN, 2601)
    z = np.where(x < 0, 0.0, 25e-6)
    z[1290:1296] = np.nan
    path = build_profile_path(x, z, R)
    assert np.isfinite(path.height).all()
    wide = z.copy()
    wide[400:1000] = np.nan
    assert np.isnan(build_profile_path(x, wide, R).height).any()


def test_scaling_surface_and_tip_alike_scales_the_path():
    x, z = sharp_step(25e-6)
    small, large = build_profile_path(x, z, R), build_profile_path(37 * x, 37 * z, 37 * R)
    assert large.height == pytest.approx(37 * small.height, rel=1e-9, abs=1e-15)
    assert find_steepest_catch(large).angle == pytest.approx(
        find_steepest_catch(small).angle, rel=1e-9
    )


def test_a_surface_far_from_the_origin_keeps_its_angle():
    x, z = sharp_step(25e-6)
    assert find_steepest_catch(build_profile_path(x + 0.04, z + 0.02, R)).angle == pytest.approx(
        find_step_angle(25e-6, R), rel=1e-7
    )


def test_a_flat_surface_has_no_catch():
    path = build_profile_path(np.linspace(0, 1e-3, 50), np.full(50, 3e-6), R)
    assert find_steepest_catch(path).angle == 0.0
    assert find_release(find_steepest_catch(path).angle, 1.0, 0.2).status is Status.NO_CATCH


def test_force_and_energy_over_a_profile_are_those_of_equation_one():
    release = find_release(
        find_steepest_catch(build_profile_path(*sharp_step(25e-6), 125e-6)).angle, 1.0, 0.15
    )
    # Origin: project facts, H 25 um, mu 0.15, 1 N.
    assert release.pull_force == pytest.approx(1.014, rel=1e-3)
    assert release.vibration_energy == pytest.approx(10.5e-6, rel=4e-3)


@pytest.mark.parametrize(
    ("x", "z", "kwargs", "message"),
    [
        ([], [], {}, "at least 2 points"),
        ([0.0], [0.0], {}, "at least 2 points"),
        ([0, 1], [0, 1, 2], {}, "one equal length"),
        ([0, np.nan, 1], [0, 0, 0], {}, "positions must be finite"),
        ([0, 1, 2], [0, np.inf, 0], {}, "NaN for missing, got an infinity"),
        ([0, 1, 2], [0, np.nan, np.nan], {}, "at least 2 heights"),
        ([0, 2, 1], [0, 0, 0], {}, "must not decrease"),
        ([0, 0], [0, 1], {}, "extend along x"),
    ],
)
def test_a_malformed_profile_is_one_clear_error(x, z, kwargs, message):
    with pytest.raises(ContactError, match=message):
        build_profile_path(np.array(x, float), np.array(z, float), R, **kwargs)


@pytest.mark.parametrize("ball_radius", [-1e-6, math.nan])
def test_a_malformed_tip_is_one_clear_error(ball_radius):
    with pytest.raises(ContactError, match="ball radius must be positive"):
        build_profile_path(*sharp_step(25e-6), ball_radius)


def _section(gap, opening, rise, radius):
    """A margin with a gap that the ball never finds the floor of, its far side bevelled at 45
    degrees.
    """
    floor = -4 * radius - abs(rise) - opening
    foot = rise - (opening - gap)
    points = [
        (-4 * radius, 0),
        (0, 0),
        (0, floor),
        (gap, floor),
        (gap, foot),
        (opening, rise),
        (opening + 4 * radius, rise),
    ]
    return np.array(points).T


def test_margins_square_or_bevelled_are_their_closed_forms_wherever_the_ball_touches():
    # Origin: the dilation of the section against the geometry of a ball between two corners, a
    # bevel and a wall.
    rng = np.random.default_rng(8)
    kinds = set()
    for _ in range(300):
        radius, gap = rng.uniform(40e-6, 200e-6), rng.uniform(5e-6, 250e-6)
        opening, rise = gap + max(rng.uniform(-80e-6, 150e-6), 0.0), rng.uniform(-150e-6, 150e-6)
        path = build_profile_path(*_section(gap, opening, rise, radius), radius)
        expected = [find_steepest_catch(one).angle for one in (path, path.mirrored())]
        found = compute_bevelled_margin_angles(gap, opening, rise, radius)
        assert found == pytest.approx(expected, abs=1e-6)
        kinds.add(
            (
                opening > gap,
                *(
                    round(math.degrees(a)) if round(math.degrees(a)) in (0, 45, 90) else -1
                    for a in found
                ),
            )
        )
    assert len(kinds) >= 8  # riding, hung, leaning on a wall, on the bevel, in either direction


@pytest.mark.parametrize("spacing", [0.31, 0.11, 0.019])
def test_no_two_places_of_a_path_lie_farther_apart_than_a_25th_of_the_ball(spacing):
    x = np.arange(0.0, 4.0, spacing) * 2.0 * R
    path = build_profile_path(x, 0.0 * x, R)
    assert np.diff(path.position).max() <= 0.04 * 2.0 * R * (1.0 + 1e-9)


@pytest.mark.parametrize("slope", [0.5, 2.0, 5.0])
def test_a_ramp_longer_than_the_ball_is_as_steep_as_it_is(slope):
    # the centre runs beside a straight flank on a line of the same slope
    path = build_profile_path([-1e-3, 0.0, 1e-3 / slope, 2e-3], [0.0, 0.0, 1e-3, 1e-3], R)
    assert find_steepest_catch(path).angle == pytest.approx(math.atan(slope), rel=1e-9)
