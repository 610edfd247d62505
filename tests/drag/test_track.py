"""The track of a tip: closed forms, any surface and the path of a centre lead it the same way."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.signal import find_peaks

from oracles.tip_paths import groove_path, step_path
from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.laws import LinearContact
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag import kernels
from stepblocks.drag.catches import find_catch_places
from stepblocks.drag.kernels.peaks import find_prominent_peaks
from stepblocks.drag.plan import build_integrator_model
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.run import drag_over
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_step_track, build_track
from stepblocks.scans.read import read_scan

SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[2] / ".." / "shared"))
R = 125e-6


@pytest.mark.parametrize(
    "face", [Step(37e-6), Step(37e-6, 9e-6), Margin(60e-6, 60e-6, 5e-6), Margin(40e-6, 90e-6, 0.0)]
)
@pytest.mark.parametrize("backward", [False, True])
def test_a_track_is_as_steep_as_the_counterface_says(face, backward):
    expected = face.angles(R)[backward]
    found = build_track(face, R, backward).find_notch(+1.0)[2]
    assert found == pytest.approx(expected, abs=5e-3 if expected == 0.0 else 1e-6)


def test_the_nodes_of_a_track_lie_on_the_closed_form():
    # Expected values: `oracles.tip_paths`.
    step, groove = build_track(Step(37e-6, 9e-6), R), build_track(Margin(60e-6, 60e-6, 5e-6), R)
    assert np.abs(step.z - step_path(step.x, 37e-6, R, 9e-6)).max() < 1e-12
    assert np.abs(groove.z - groove_path(groove.x, 60e-6, R, 5e-6)).max() < 1e-12


def test_between_its_nodes_a_track_has_the_slopes_of_its_path():
    track = build_track(Margin(60e-6, 60e-6, 5e-6), R)
    left, right = track.one_sided_slopes
    assert (left[1:] == track.slope_end).all()
    assert (right[:-1] == track.slope_start).all()
    smooth = np.setdiff1d(np.arange(track.x.size), track.kinks)
    assert np.abs(np.arctan(right[smooth]) - np.arctan(left[smooth])).max() < math.radians(2.0)
    assert all(right[k] > left[k] for k in track.kinks)


def test_a_track_is_as_steep_as_the_path_of_the_centre():
    # two ways to one figure: exact dilation, and the envelope of discs and lines
    for face, backward in ((Step(37e-6), False), (Margin(60e-6, 60e-6, 5e-6), True)):
        angle = face.centre_path(R).find_notch(-1.0 if backward else 1.0)[2]
        assert build_track(face, R, backward).find_notch(+1.0)[2] == pytest.approx(angle, rel=1e-6)


def test_a_margin_dragged_backward_is_its_mirror_image_dragged_forward():
    over, under = Margin(60e-6, 60e-6, 5e-6), Margin(60e-6, 60e-6, -5e-6)
    settings = DragSettings(0.5, 0.15, speed=10e-3, ring_time=5e-3)
    back = simulate_drag(build_track(over, R, backward=True), PAPER_DRAG, settings)
    there = simulate_drag(build_track(under, R), PAPER_DRAG, settings)
    assert back.peak_force == pytest.approx(there.peak_force, rel=1e-6)


def test_features_lie_between_the_first_and_the_last_bend():
    first, last = build_step_track(37e-6, R).feature_range
    assert -R <= first < last <= 0.0
    flat = build_track(Profile(np.array([-1e-3, 1e-3]), np.zeros(2)), R)
    assert flat.feature_range[0] == flat.feature_range[1]
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
    before, behind = (math.degrees(math.atan(one[kink])) for one in track.one_sided_slopes)
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
    assert build_track(face, R).find_notch(+1.0)[2] == pytest.approx(expected, rel=1e-6)


def test_where_a_contact_presses_a_rough_track_flat_its_energy_has_no_jump():
    # conservative forces need a potential without jumps: off the kinks that are kept the normal
    # turns steadily, and the second contact at a kink has parted before the next one takes over
    rng = np.random.default_rng(3)
    x = np.arange(-0.2e-3, 0.2e-3, 1e-6)
    track = build_track(Profile(x, np.cumsum(rng.normal(0.0, 0.15e-6, x.size))), R)
    depth, window = 0.7e-6, 37e-6
    kept = track.list_kinks_with_two_contacts(depth, window)
    pressed = track.flatten_kinks(kept, 9e-6)
    branches = track.compute_branch_cubics(kept, 2.5e-6, window)
    assert 0 < kept.size < track.kinks.size
    left, right = pressed.one_sided_slopes
    smooth = np.setdiff1d(np.arange(pressed.x.size), pressed.kinks)
    assert np.abs(right - left)[smooth].max() < math.radians(2.1)
    assert (
        np.abs(
            pressed.find_height_and_slope(track.x)[0] - track.find_height_and_slope(track.x)[0]
        ).max()
        < depth
    )
    places = pressed.x[pressed.kinks]
    assert places == pytest.approx(track.x[track.kinks[kept]], abs=1e-15)
    half = np.diff(places).clip(max=2.0 * window) / 2.0
    for reach, one, side in ((half, branches[:-1, 0], 0), (-half, branches[1:, 1], 1)):
        end = sum(one[:, power] * reach**power for power in range(4))
        at = track.find_height_and_slope((places[:-1] if side == 0 else places[1:]) + reach)[0]
        assert (at - end).min() > 2.499e-6


@pytest.mark.long
@pytest.mark.parametrize(("number", "hard"), [(44, True), (89, False), (179, False)])
def test_over_real_ground_texture_the_ledger_closes_where_it_did_not(number, hard):
    # Origin: profiles 44, 89 and 179 of benchmarks/drag_profiles.py, refused before: 2 to 6 % open
    path = SHARED / "real" / "surfacetopography" / "sur-2.sur"
    if not path.exists():
        pytest.skip("shared real data is not here")
    scan = read_scan(path)
    row = scan.height[scan.height.shape[0] // 2]
    known = np.isfinite(row)
    heights = np.interp(scan.x, scan.x[known], row[known])
    rng = np.random.default_rng([1, number])
    x, height = np.arange(-0.35e-3, 0.35e-3, 1e-6), rng.uniform(10e-6, 45e-6)
    length = math.ceil((x[-1] - x[0]) / scan.dx) + 2
    part = heights[rng.integers(0, max(heights.size - length, 1)) :][:length]
    texture = np.interp(x - x[0], scan.dx * np.arange(part.size), part)
    texture -= np.polyval(np.polyfit(x, texture, 1), x)
    texture *= rng.uniform(0.1e-6, 0.6e-6) / np.abs(texture).mean()
    done = drag_over(
        Profile(x, np.where(x > 0.0, height, 0.0) + texture),
        load=1.0,
        friction=0.15,
        speed=5e-3,
        contact=LinearContact(3e8) if hard else None,
    )
    assert done.events.ledger_error.max() < 0.02
    assert done.trace.peak_force == pytest.approx(done.formula.pull_force, rel=0.03)


def test_a_place_that_does_not_catch_the_tip_says_whether_it_flew_or_slid():
    # at 20 mm/s the tip is over a step of 30 nm, 30 um behind one, before the spring is loaded; at
    # 0.5 mm/s it asks for the pull of equation (1). 80 um throw the tip over an edge 10 um behind
    # them, which was asked about and is no bound on the pull before it
    x = np.array([-0.2e-3, -1e-9, 0.0, 30e-6, 30.001e-6, 0.2e-3])
    z = np.array([0.0, 0.0, 30e-9, 30e-9, 62e-9, 62e-9])
    slow = drag_over(Profile(x, z), load=0.5, speed=0.5e-3)
    assert slow.events.status.tolist() == ["releases", "releases"]
    assert slow.trace.peak_force == pytest.approx(slow.formula.pull_force, rel=0.03)
    slid = drag_over(Profile(x, z), load=0.5, speed=20e-3).trace
    assert slid.status == "run-over"
    assert "slides" in slid.reason
    assert slid.column("normal_n").min() > 0.0
    x = np.array([-0.2e-3, -1e-9, 0.0, 10e-6, 10.001e-6, 0.3e-3])
    z = np.array([0.0, 0.0, 80e-6, 80e-6, 81e-6, 81e-6])
    flown = drag_over(Profile(x, z), load=0.5, x_range=(5e-6, 15e-6)).trace
    assert [str(one.status) for one in flown.events] == ["releases", "run-over"]
    assert flown.events[0].pull_n == pytest.approx(
        find_release(find_step_angle(80e-6, R), 0.5, 0.15).pull_force, rel=0.05
    )
    assert "in flight" in flown.reason
    assert (
        flown.column("normal_n")[flown.column("time_s") > flown.events[0].released_s].min() == 0.0
    )


def test_both_branches_at_the_notch_of_a_groove_bend_as_the_arcs_about_its_rims():
    # closed form: the centre goes on an arc of R about either rim, z'' = -(1 + s^2)^1.5 / R
    track = build_track(
        Profile([-1e-3, -1e-4, -1e-4, 1e-4, 1e-4, 1e-3], [0, 0, -1e-3, -1e-3, 0, 0]), R
    )
    assert track.x[track.kinks] == pytest.approx([0.0], abs=1e-12)
    slope = 100.0 / math.sqrt(125.0**2 - 100.0**2)
    (left, right), bend = track.branch_coefficients[0], -0.5 * (1.0 + slope**2) ** 1.5 / R
    assert [left[1], right[1]] == pytest.approx([-slope, slope], rel=1e-5)
    assert [left[2], right[2]] == pytest.approx([bend, bend], rel=0.02)


def test_over_a_face_that_is_its_own_mirror_image_a_tip_is_pulled_left_as_it_is_pulled_right():
    # four slots of 60 um, in each of which both rims share the load; symmetry alone is asked for
    edges = np.array([-1e3, -330, -270, -130, -70, 70, 130, 270, 330, 1e3]) * 1e-6
    x, z = (
        np.repeat(edges, 2)[1:-1],
        np.repeat([0.0, -1.0, 0.0, -1.0, 0.0, -1.0, 0.0, -1.0, 0.0], 2),
    )
    track = build_track(Profile(x, z * 50e-6), R)
    assert track.x[track.kinks] == pytest.approx(np.array([-300, -100, 100, 300]) * 1e-6, abs=1e-12)
    window, depth = 0.3 * R, PAPER_DRAG.compute_indentation(1.0)
    branches = track.compute_branch_cubics(np.arange(4), 1e-6, window)
    path = kernels.Path(track.x, track.cubics, track.kinks, branches)
    settings = DragSettings(1.0, 0.15, speed=0.0, pulling_force=1.0, handle_mass=0.05)
    model = build_integrator_model(PAPER_DRAG, settings, window, 1e6)
    none = np.zeros(0)
    rows = {}
    for way in (1.0, -1.0):
        outcome = kernels.integrate(
            path,
            model._replace(handle=model.handle._replace(pull=way)),
            np.empty((0, 3)),
            kernels.Start(-way * 0.5e-3, -depth, 0.0),
            kernels.Pace(1e-7, 150_000, 100),
            kernels.Places(none, none, none, np.zeros(0, dtype=bool), none),
            kernels.Stop(float(track.x[0]), float(track.x[-1]), 1e9, settings.ring_time, 1e-6),
            None,
        )
        rows[way] = dict(zip(kernels.COLUMNS, outcome.rows.T, strict=True))
    right, left = rows[1.0], rows[-1.0]
    assert right["x_m"][-1] > 1e-3
    for name, sign, close in (("x_m", -1, 1e-12), ("y_m", 1, 1e-12), ("fx_n", -1, 1e-6)):
        assert sign * left[name] == pytest.approx(right[name], abs=close)
    for name, sign in (("normal_n", 1), ("friction_n", -1)):
        assert sign * left[name] == pytest.approx(right[name], abs=1e-6)


@pytest.mark.parametrize("height", [10e-6, 25e-6, 60e-6])
def test_a_tip_has_left_a_sharp_step_where_its_path_is_half_as_steep(height):
    # Expected value: the ball rolls over the edge, its centre sin(slope) radii before it, and flat
    # ground follows: half the critical angle is left at -R sin(a / 2).
    angle = find_step_angle(height, R)
    places = find_catch_places(build_step_track(height, R), R)
    assert places.last / R == pytest.approx([-math.sin(angle)], abs=1e-3)
    assert places.behind / R == pytest.approx([-math.sin(0.5 * angle)], abs=3e-3)


@given(st.lists(st.integers(min_value=-3, max_value=4), max_size=40))
def test_peaks_are_those_that_scipy_finds(levels):
    """Whole numbers make plateaus and equal peaks."""
    values = np.array(levels, dtype=np.float64)
    expected, _ = find_peaks(values, height=1.5, prominence=1.5)
    assert find_prominent_peaks(values, 1.5).tolist() == expected.tolist()
