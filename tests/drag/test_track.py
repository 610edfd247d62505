"""The track of a tip: closed forms, any surface and the path of a centre lead it the same way."""

import math

import numpy as np
import pytest

from oracles.tip_paths import groove_path, step_path
from stepblocks.contact.counterface import Margin, Profile, Step
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
