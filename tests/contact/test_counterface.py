"""What a slider meets: closed forms, sections.

Paths and heights of one counterface tell the same.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.tip_paths import step_path
from stepblocks.contact.counterface import (
    Groove,
    Margin,
    Profile,
    ProfiledMargin,
    Step,
    find_critical_angle_of_scan,
)
from stepblocks.contact.critical_angle import (
    compute_bevelled_margin_angles,
    find_margin_angles,
    find_step_angle,
)
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch
from stepblocks.contact.relieved_step import RelievedStep
from stepblocks.errors import ContactError

R = 117e-6
STEPS = [Step(31e-6), Step(31e-6, 12e-6)]
MARGINS = [
    Margin(62e-6, 62e-6, 0.0),
    Margin(62e-6, 62e-6, -9e-6),
    Margin(40e-6, 90e-6, 7e-6),  # bevelled
    Margin(70e-6, 30e-6, 11e-6),  # a lip that narrows the gap
    Margin(20e-6, -15e-6, 33e-6),  # a lip over the tooth
]
RELIEVED = [
    RelievedStep(31e-6, 0.0, 60e-6, 50e-6),  # not reached: it rides on the lower face
    RelievedStep(31e-6, 12e-6, 60e-6, 50e-6),
    RelievedStep(31e-6, 0.0, 150e-6, 50e-6),  # between both corners
    RelievedStep(31e-6, 12e-6, 150e-6, 50e-6),
    RelievedStep(31e-6, 0.0, 400e-6, 20e-6),  # on the floor
    RelievedStep(31e-6, 12e-6, 400e-6, 20e-6),
    RelievedStep(90e-6, 3e-6, 210e-6, 300e-6),  # leans on the riser
    RelievedStep(90e-6, 3e-6, 600e-6, 300e-6),  # falls in
    RelievedStep(200e-6, 3e-6, 100e-6, 80e-6),  # meets the riser
]


# Expected values: from the wall of the tooth the floor falls by its slope times what it runs.
@pytest.mark.parametrize(
    ("opening", "run"),
    [(62e-6, 62e-6), (90e-6, 62e-6), (30e-6, 30e-6)],
    ids=["square", "bevelled", "lip"],
)
def test_the_floor_of_a_gap_falls_by_its_slope_over_its_width(opening, run):
    x, z = Margin(62e-6, opening, 9e-6, depth=1e-3, fall=0.2).section(1e-3)
    deepest = np.argmin(z)
    assert (x[deepest], z[deepest]) == pytest.approx((run, -1e-3 - 0.2 * run), rel=1e-12)


# Expected values: the exact dilation of the section, which knows no closed form.
@pytest.mark.parametrize(
    "face", [*STEPS, *MARGINS, *RELIEVED, Groove(60e-6, 0.7), Groove(200e-6, 0.4)]
)
def test_the_closed_form_is_the_steepest_slope_of_the_path_over_the_section(face):
    path = build_profile_path(*face.section(6.0 * R), R)
    # a rounding of 12 um by 400 chords turns by a quarter of a degree at each
    tolerance = 3e-3 if getattr(face, "edge_radius", 0.0) else 1e-8
    expected = [find_steepest_catch(one).angle for one in (path, path.mirrored())]
    assert face.angles(R) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(
    "face", [*STEPS, *MARGINS, *RELIEVED, Groove(60e-6, 0.7), Groove(200e-6, 0.4)]
)
def test_the_notches_of_the_centre_path_have_the_critical_angles(face):
    path = face.centre_path(R)
    assert (path.find_notch(+1.0)[2], path.find_notch(-1.0)[2]) == pytest.approx(
        face.angles(R), abs=2e-6
    )
    assert path.x[0] == -5e-3
    assert path.x[-1] == 5e-3
    assert path.z[-1] - path.z[0] == pytest.approx(face.far_side, abs=1e-15)


@pytest.mark.parametrize("face", STEPS)
def test_the_centre_of_the_ball_runs_a_radius_above_its_lowest_point(face):
    # Origin: the closed-form path of the lowest point.
    path = face.centre_path(R)
    expected = R + step_path(path.x, face.height, R, face.edge_radius)
    assert path.z == pytest.approx(expected, rel=1e-9)


def test_magnifying_a_path_keeps_its_slopes_and_the_angle_of_its_notch():
    path, large = STEPS[0].centre_path(R), STEPS[0].centre_path(R).scaled(23.0)
    assert large.find_notch(+1.0)[2] == path.find_notch(+1.0)[2]
    assert large.find_notch(+1.0)[:2] == pytest.approx(
        [23.0 * value for value in path.find_notch(+1.0)[:2]]
    )


@pytest.mark.parametrize(
    "face", [*STEPS, *MARGINS, *RELIEVED, Groove(60e-6, 0.7), Groove(200e-6, 0.4)]
)
def test_heights_and_section_are_one_profile(face):
    x, z = face.section(1e-3)
    assert z[0] == 0.0
    assert z[-1] == pytest.approx(face.far_side)
    assert (np.diff(x) >= 0.0).all()
    inner = 0.5 * (x[1:] + x[:-1])[np.diff(x) > 1e-9]
    middle = 0.5 * (z[1:] + z[:-1])[np.diff(x) > 1e-9]
    # a chord lies up to 0.06 nm inside the arc, lower by more where that is steep
    assert face.heights(inner) == pytest.approx(middle, abs=2e-9)
    assert list(face.breakpoints) == sorted(face.breakpoints)


def test_on_an_edge_itself_the_higher_side_counts():
    assert Step(30e-6).heights(np.array([-1e-12, 0.0])).tolist() == [0.0, 30e-6]
    assert Margin(50e-6, 50e-6, -9e-6).heights(np.array([0.0, 50e-6])).tolist() == [0.0, -9e-6]
    riser = Profile(np.array([-1e-3, 0.0, 0.0, 1e-3]), np.array([0.0, 0.0, 25e-6, 25e-6]))
    assert riser.heights(np.array([-5e-4, 0.0, 5e-4])).tolist() == [0.0, 25e-6, 25e-6]


def test_arrays_of_dimensions_give_what_each_gives_alone():
    rng = np.random.default_rng(3)
    gap, wider, rise, ball = (
        rng.uniform(a, b, 40) * 1e-6 for a, b in ((5, 250), (-60, 90), (-90, 90), (40, 200))
    )
    forward, backward = MARGINS[0].angles(ball, gap=gap, opening=gap + wider, rise=rise)
    for k in range(gap.size):
        alone = compute_bevelled_margin_angles(gap[k], gap[k] + wider[k], rise[k], ball[k])
        assert (forward[k], backward[k]) == alone
    assert find_step_angle([10e-6, 500e-6], R).tolist() == [
        find_step_angle(10e-6, R),
        0.5 * math.pi,
    ]
    assert find_margin_angles([[1e-6], [2e-6]], [0.0, 3e-6, 4e-6], R)[0].shape == (2, 3)


def test_releases_over_arrays_are_those_of_each_drag():
    angles = [0.0, 0.4, 1.2, 1.5, 0.5 * math.pi]
    together = find_release(angles, 0.7, [[0.1], [0.3]], PAPER.tool)
    assert together.status.shape == together.vibration_energy.shape == (2, 5)
    for i, mu in enumerate((0.1, 0.3)):
        for k, angle in enumerate(angles):
            alone = find_release(angle, 0.7, mu)
            assert together.status[i, k] == alone.status
            for name in (
                "angle",
                "pull_force",
                "vibration_energy",
                "mean_power",
                "threshold_ratio",
            ):
                assert getattr(together, name)[i, k] == pytest.approx(
                    getattr(alone, name), rel=1e-15, nan_ok=True
                )
    assert set(together.status.ravel()) == {"no-catch", "releases", "locked", "too-high"}


def test_crown_and_tooth_change_places_when_the_drag_turns_round():
    point = OperatingPoint(R, 0.6, 0.2)
    over, under = Margin(62e-6, 62e-6, 9e-6), Margin(62e-6, 62e-6, -9e-6)
    assert (
        over.release(point).vibration_energy == under.release(point, backward=True).vibration_energy
    )
    assert over.release(point, backward=True) == under.release(point)
    assert Step(31e-6).release(point, backward=True).status is Status.NO_CATCH


def test_the_opening_of_a_square_end_follows_its_gap_and_a_stated_one_does_not():
    moved = np.array([-1e-6, 2e-6])
    square, stated = (
        MARGINS[0].deviate_dimensions({"gap": moved}),
        MARGINS[0].deviate_dimensions({"gap": moved, "opening": 0.0}),
    )
    assert (square["opening"] - square["gap"]).tolist() == pytest.approx([0.0, 0.0], abs=1e-20)
    assert np.ravel(stated["opening"]).tolist() == [62e-6]
    assert Margin(1e-6, 1e-6, 0.0).deviate_dimensions({"gap": -3e-6})["gap"] == 0.0
    assert Step(1e-6).deviate_dimensions({"height": -3e-6}) == {"height": 0.0, "edge_radius": 0.0}


def test_the_slopes_of_a_steps_angle_are_its_derivatives():
    step, tiny = Step(31e-6, 12e-6), 1e-12
    slopes = step.angle_slopes(R)
    for name in ("height", "edge_radius"):
        ends = (
            replace(step, **{name: getattr(step, name) + sign * tiny}).angles(R)[0]
            for sign in (1, -1)
        )
        assert slopes[name] == pytest.approx(
            -np.subtract(*reversed(list(ends))) / (2 * tiny), rel=1e-3
        )
    assert slopes["ball_radius"] == slopes["edge_radius"] < 0.0


def test_a_profile_answers_many_balls_at_once():
    profile = Profile(np.array([-1e-3, 0.0, 0.0, 1e-3]), np.array([0.0, 0.0, 31e-6, 31e-6]))
    balls = np.array([[60e-6, 117e-6], [200e-6, 60e-6]])
    up, down = profile.angles(balls)
    assert up == pytest.approx(find_step_angle(31e-6, balls), rel=1e-9)
    assert (down == 0.0).all()
    assert isinstance(profile.angles(R)[0], float)
    assert profile.ways == ("forward", "backward")


@pytest.mark.parametrize("before", [1e-3, 50e-6, 1e-6])
def test_an_edge_near_the_end_of_a_profile_catches_as_one_in_its_middle(before):
    # the surface is level beyond its ends, so where the record begins is no matter: cos a = 1 - H/R
    profile = Profile(np.array([-before, 0.0, 0.0, 1e-3]), np.array([0.0, 0.0, 31e-6, 31e-6]))
    angle = profile.centre_path(R).find_notch(+1.0)[2]
    assert angle == pytest.approx(math.acos(1.0 - 31e-6 / R), abs=1e-6)


@pytest.mark.parametrize("margin", MARGINS)
def test_a_margin_whose_sides_do_not_bend_is_the_margin_between_level_ones(margin):
    bent = ProfiledMargin(**vars(margin))
    assert bent.angles(R) == pytest.approx(margin.angles(R), abs=2e-5)
    assert bent.breakpoints == margin.breakpoints
    x = np.linspace(-1e-3, 1e-3, 400)
    assert bent.heights(x) == pytest.approx(margin.heights(x), abs=1e-15)


def test_the_section_of_a_margin_has_the_parabola_of_each_side():
    bent = ProfiledMargin(60e-6, 60e-6, 12e-6, 1e-3, 0.0, -150.0, 0.12, -90.0)
    x, z = np.array(bent.section(0.0))[:, np.array(bent.section(0.0))[1] > -5e-4]  # without floor
    tooth, far = x[x <= 0.0], x[x >= 60e-6] - 60e-6
    assert z[x <= 0.0] == pytest.approx(-75.0 * tooth**2, abs=1e-15)
    assert z[x >= 60e-6] == pytest.approx(12e-6 + 0.12 * far - 45.0 * far**2, abs=1e-15)
    assert min(tooth.size, far.size) > 20


def test_draws_over_a_margin_whose_sides_bend_lie_close_to_the_dilation_of_each():
    bent = ProfiledMargin(60e-6, 60e-6, 12e-6, 1e-3, 0.0, -150.0, 0.12, -90.0)
    gaps = np.array([52e-6, 57e-6, 60e-6, 66e-6])
    drawn = bent.angles(R, gap=gaps, opening=gaps)
    each = [replace(bent, gap=gap, opening=gap).angles(R) for gap in gaps.tolist()]
    assert np.transpose(drawn) == pytest.approx(np.array(each), abs=2e-3)
    # so much do they differ from the nominal
    assert np.abs(np.array(each)[0] - bent.angles(R)).max() > 0.05


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Profile(np.zeros(3), np.zeros(2)), "one equal length"),
        (lambda: Profile(np.zeros(1), np.zeros(1)), "at least 2 points"),
        (lambda: Profile(np.array([1.0, 0.0]), np.zeros(2)), "must not decrease"),
        (lambda: Step(-1e-6).angles(R), "height must be finite and not negative"),
        (lambda: Step(math.nan), "height must be finite and not negative, got nan m"),
        (lambda: Step([1e-6, 2e-6]), r"height must be one number \[m\], got list"),
        (
            lambda: Margin(-1e-6, 0.0, 0.0).angles(R),
            "gap must be finite and not negative, got -1e-06 m",
        ),
        (lambda: Margin(1e-6, math.inf, 0.0).angles(R), "opening must be finite"),
        (
            lambda: find_step_angle([1e-6, 2e-6], [R, 0.0]),
            "ball_radius must be positive and finite, got 0 m",
        ),
        (
            lambda: find_release([0.1, 3.2], 1.0, 0.1),
            "angle must lie between 0 and 90 deg, got 183",
        ),
    ],
)
def test_what_no_ball_could_meet_is_refused_with_its_name_and_value(call, message):
    with pytest.raises(ContactError, match=message):
        call()


def test_the_scanned_surface_says_what_height_and_radius_cannot_of_a_chamfered_edge():
    # a riser of 30 um below a chamfer of 45 deg up to 50 um: a ball of 125 um on the lower face
    # touches the chamfer first, at R (1 - cos 45 deg) = 36.6 um, so the critical angle is that of
    # the chamfer
    x = np.arange(-400, 400) * 1e-6
    z = np.where(x < 0.0, 0.0, np.minimum(30e-6 + x, 50e-6))
    assert np.degrees(find_critical_angle_of_scan(x, z, 125e-6)) == pytest.approx(45.0, abs=1e-6)
    assert np.degrees(find_critical_angle_of_scan(-x[::-1], z[::-1], 125e-6)) == pytest.approx(
        45.0, abs=1e-6
    )
    # a ball of 80 um meets the riser's corner first, at acos(1 - 30/80) = 51.3 deg, and that is
    # steeper than the chamfer
    assert np.degrees(find_critical_angle_of_scan(x, z, 80e-6)) == pytest.approx(
        np.degrees(np.arccos(1 - 30 / 80)), abs=0.5
    )
    assert find_critical_angle_of_scan(x, np.full_like(x, np.nan), 125e-6) is None


@pytest.mark.parametrize("face", RELIEVED[:6])
def test_the_slopes_over_a_relief_are_those_of_the_angle(face):
    # of a step that is not reached the closed form of `Step` holds, and the relief counts nothing
    slopes = face.angle_slopes(R)
    if face in RELIEVED[:2]:
        plain = Step(face.height, face.edge_radius).angle_slopes(R)
        assert {name: slopes[name] for name in plain} == pytest.approx(plain, rel=1e-5)
        assert slopes["relief_width"] == slopes["relief_depth"] == 0.0
    for name in face.dimensions:
        sizes = face.dimensions
        ahead = face.angles(R, **{**sizes, name: sizes[name] + 50e-9}).forward
        assert (ahead - face.angles(R).forward) / 50e-9 == pytest.approx(
            slopes[name], rel=0.02, abs=1.0
        )


def test_a_size_that_counts_nothing_keeps_the_shape_of_what_is_asked():
    depths = np.array([40e-6, 50e-6, 60e-6])
    forward, backward = RELIEVED[0].angles(R, relief_depth=depths)
    assert forward.shape == backward.shape == (3,)
    assert (forward == find_step_angle(31e-6, R)).all()
