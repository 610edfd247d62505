"""The path of the ball's centre over corners and discs: a corner is a disc of no radius, and a ball
grows every disc.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.scenes import corner_path
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.path.centre import Disc, FeatureRange, Line, build_envelope_path
from stepblocks.errors import ContactError

R = 90e-6
STEP = [(-1e-3, 0.0), (0.0, 0.0), (0.0, 30e-6), (1e-3, 30e-6)]


def test_over_a_plane_the_centre_runs_a_radius_above_it():
    level = corner_path([(-1e-3, 5e-6), (1e-3, 5e-6)], R)
    assert level.z == pytest.approx(np.full(level.x.size, 5e-6 + R))
    assert level.find_notch(+1.0)[2] == level.find_notch(-1.0)[2] == 0.0


def test_over_a_slope_the_centre_runs_a_radius_beside_it():
    slope = math.tan(math.radians(20.0))
    path = corner_path([(-1e-3, -1e-3 * slope), (1e-3, 1e-3 * slope)], R)
    middle = np.abs(path.x) < 0.5e-3
    assert path.z[middle] == pytest.approx(
        path.x[middle] * slope + R / math.cos(math.radians(20.0)), rel=1e-9
    )
    assert path.find_notch(+1.0)[2] == pytest.approx(math.radians(20.0), rel=1e-9)


def test_a_corner_is_a_disc_of_no_radius():
    lines = [Line((-1e-3, 0.0), (0.0, 0.0)), Line((0.0, 30e-6), (1e-3, 30e-6))]
    path, same = corner_path(STEP, R), build_envelope_path([Disc(0.0, 30e-6, 0.0)], lines, R)
    assert same.find_notch(+1.0) == pytest.approx(path.find_notch(+1.0), abs=1e-12)
    x, z, angle = path.find_notch(+1.0)
    assert angle == pytest.approx(find_step_angle(30e-6, R), rel=1e-9)
    assert (x, z) == pytest.approx((-R * math.sin(angle), R), rel=1e-9)


def test_a_rounding_and_a_ball_exchange_their_radii():
    # seen from the centre of the arc, a ball of R over a rounding of r is a ball of R + r over a
    # sharp edge
    lines = [Line((-1e-3, 0.0), (0.0, 0.0)), Line((12e-6, 30e-6), (1e-3, 30e-6))]
    rounded = build_envelope_path([Disc(12e-6, 18e-6, 12e-6)], lines, R)
    assert rounded.find_notch(+1.0)[2] == pytest.approx(find_step_angle(30e-6, R + 12e-6), rel=1e-9)


def test_a_wall_as_high_as_the_ball_is_vertical():
    wall = corner_path([(-1e-3, 0.0), (0.0, 0.0), (0.0, 2 * R), (1e-3, 2 * R)], R)
    assert wall.find_notch(+1.0)[2] == 0.5 * math.pi


def test_more_corners_than_can_be_compared_are_refused():
    x = np.linspace(0.0, 1e-3, 2001)
    with pytest.raises(ContactError, match="2 to 2000 finite points"):
        corner_path(np.column_stack([x, 0.0 * x]), R)


def test_a_catch_is_looked_for_where_the_ball_touches_and_not_where_its_centre_is():
    # a low step at 0 and a high one 1 mm on, up; the same from the other side
    low, high = 12e-6, 30e-6
    corners = [(-1e-3, 0.0), (0.0, 0.0), (0.0, low), (1e-3, low), (1e-3, low + high)]
    corners.append((2e-3, low + high))
    path = corner_path(corners, R)
    mirrored = corner_path([(-x, z) for x, z in reversed(corners)], R)
    angles = {0.0: find_step_angle(low, R), 1e-3: find_step_angle(high, R)}
    assert path.find_notch(+1.0)[2] == pytest.approx(angles[1e-3], rel=1e-6)
    for edge, angle in angles.items():
        near = replace(path, feature=FeatureRange(edge - 2e-6, edge + 2e-6, R))
        assert near.find_notch(+1.0)[2] == pytest.approx(angle, rel=1e-6)
        back = replace(mirrored, feature=FeatureRange(-edge - 2e-6, -edge + 2e-6, R))
        assert back.find_notch(-1.0)[2] == pytest.approx(angle, rel=1e-6)
