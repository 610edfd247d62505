"""The track of a tip: closed forms, any surface and the path of a centre lead it the same way."""

import math

import numpy as np
import pytest

from oracles.tip_paths import groove_path, step_path
from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_step_track, build_track, build_track_along_path

R = 125e-6


@pytest.mark.parametrize(
    "face", [Step(37e-6), Step(37e-6, 9e-6), Margin(60e-6, 60e-6, 5e-6), Margin(40e-6, 90e-6, 0.0)]
)
@pytest.mark.parametrize("backward", [False, True])
def test_a_track_is_as_steep_as_the_counterface_says(face, backward):
    expected = face.angles(R)[backward]
    found = build_track(face, R, backward).steepest_angle
    assert found == pytest.approx(expected, abs=5e-3 if expected == 0.0 else 1e-6)


def test_the_nodes_of_a_track_lie_on_the_closed_form():
    # Expected values: `oracles.tip_paths`.
    step, groove = build_track(Step(37e-6, 9e-6), R), build_track(Margin(60e-6, 60e-6, 5e-6), R)
    assert (
        np.abs(step.z - step_path(step.x + 9e-6, 37e-6, R, 9e-6)).max() < 1e-12
    )  # its x = 0 is where the arc ends
    assert np.abs(groove.z - groove_path(groove.x, 60e-6, R, 5e-6)).max() < 1e-12


def test_between_its_nodes_a_track_has_the_slopes_of_its_path():
    track = build_track(Margin(60e-6, 60e-6, 5e-6), R)
    left, right = track.slopes
    assert (left[1:] == track.slope_end).all()
    assert (right[:-1] == track.slope_start).all()
    smooth = np.setdiff1d(np.arange(track.x.size), track.kinks)
    assert np.abs(np.arctan(right[smooth]) - np.arctan(left[smooth])).max() < math.radians(2.0)
    assert all(right[k] > left[k] for k in track.kinks)


def test_a_path_of_the_centre_drags_like_the_track_over_its_counterface():
    settings = DragSettings(0.5, 0.15, speed=10e-3, ring_time=5e-3)
    for face, backward in ((Step(37e-6), False), (Margin(60e-6, 60e-6, 5e-6), True)):
        along = build_track_along_path(face.centre_path(R), R, backward)
        over = build_track(face, R, backward)
        peaks = [simulate_drag(track, PAPER_DRAG, settings).peak_force for track in (along, over)]
        assert peaks[0] == pytest.approx(peaks[1], rel=2e-3)
        assert along.steepest_angle == pytest.approx(over.steepest_angle, rel=1e-6)


def test_a_margin_dragged_backward_is_its_mirror_image_dragged_forward():
    over, under = Margin(60e-6, 60e-6, 5e-6), Margin(60e-6, 60e-6, -5e-6)
    settings = DragSettings(0.5, 0.15, speed=10e-3, ring_time=5e-3)
    back = simulate_drag(build_track(over, R, backward=True), PAPER_DRAG, settings)
    there = simulate_drag(build_track(under, R), PAPER_DRAG, settings)
    assert back.peak_force == pytest.approx(there.peak_force, rel=1e-6)


def test_features_lie_between_the_first_and_the_last_bend():
    first, last = build_step_track(37e-6, R).features
    assert -R <= first < last <= 0.0
    flat = build_track(Profile(np.array([-1e-3, 1e-3]), np.zeros(2)), R)
    assert flat.features[0] == flat.features[1]
    assert flat.kinks.size == 0


@pytest.mark.parametrize("count", range(6))
def test_a_notch_is_found_wherever_the_nodes_lie(count):
    # A flank of 45 degrees with noise of a nanometre: just behind the notch the path may be a
    # little steeper still. One more sample at the end moves every node; expected values: the face
    # before the notch is level, the flank behind it has 45 degrees, equation (1).
    x = np.arange(-500, 496 + count) * 1e-6
    noise = 1e-9 * np.random.default_rng(3).standard_normal(1010)[: x.size]
    face = Profile(x, np.clip(x, 0.0, 50e-6) + noise)
    track = build_track(face, R)
    (kink,) = track.kinks
    before, behind = (math.degrees(math.atan(one[kink])) for one in track.slopes)
    assert before == pytest.approx(0.0, abs=0.3)
    assert behind == pytest.approx(45.0, abs=0.3)
    trace = simulate_drag(track, PAPER_DRAG, DragSettings(1.0, 0.15, speed=1e-3, ring_time=5e-3))
    expected = find_release(math.radians(45.0), 1.0, 0.15).pull_force
    assert trace.peak_force == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("before", [300e-6, 74e-6, 50e-6, 1e-6])
def test_a_profile_goes_on_level_where_its_points_end_within_reach_of_the_ball(before):
    # Expected value: equation (2); the ball of 125 um meets a step of 25 um 75 um before it.
    face = Profile([-before, 0.0, 0.0, before], [0.0, 0.0, 25e-6, 25e-6])
    expected = find_step_angle(25e-6, R)
    assert face.release(PAPER).angle == pytest.approx(expected, rel=1e-6)
    assert build_track(face, R).steepest_angle == pytest.approx(expected, rel=1e-6)
