"""Every closed form against geometry, statics and integrals worked out here, with no dimensional
parameter near 1 or the paper's.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from stepblocks.contact import kernels
from stepblocks.contact.counterface import Groove, Margin, Step
from stepblocks.contact.critical_angle import find_margin_angles, find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tool
from stepblocks.contact.uncertainty import estimate_interval

TOOL = Tool(
    8.7e3,
    0.23,
    ring_duration=12e-3,
    detection_threshold=0.13e-6,
    frequency=271.0,
    decay_time=9e-3,
    limits=Limits(),
)
POINT = OperatingPoint(131e-6, 0.73, 0.17, TOOL, 7e-3)


def balance(angle, load, mu):
    """Pulling force and reaction of a ball that is about to slip up an edge whose common tangent
    rises at `angle`.
    """
    along_x = [1.0, -(math.sin(angle) + mu * math.cos(angle))]
    along_z = [0.0, math.cos(angle) - mu * math.sin(angle)]
    return np.linalg.solve([along_x, along_z], [0.0, load])


def between(width, rise, radius):
    """Centre of a ball that touches the corners (0, 0) and (`width`, `rise`), from above."""
    chord = math.hypot(width, rise)
    off = math.sqrt(radius**2 - 0.25 * chord**2)
    return 0.5 * width - off * rise / chord, 0.5 * rise + off * width / chord


@pytest.mark.parametrize(
    ("height", "ball", "edge"),
    [(27e-6, 131e-6, 9e-6), (0.8e-6, 62e-6, 0.0), (96e-6, 83e-6, 31e-6), (3e-3, 17e-3, 2e-3)],
)
def test_the_tangent_of_a_step_is_that_of_a_ball_drawn_on_face_and_edge(height, ball, edge):
    # Origin: a circle of radius R on the line z = 0 touches a circle of radius r whose top lies at
    # H.
    up = ball + edge - height
    across = math.sqrt((ball + edge) ** 2 - up**2)
    angle = find_step_angle(height, ball, edge)
    assert angle == pytest.approx(math.atan2(across, up), rel=1e-12)
    assert kernels.compute_height_at_angle(angle, ball + edge) == pytest.approx(height, rel=1e-12)
    slopes = Step(height, edge).angle_slopes(ball)
    by_height, by_radius = slopes["height"], slopes["ball_radius"]
    # dH = (R + r) sin a da, and across = (R + r) sin a
    assert by_height == pytest.approx(1.0 / across, rel=1e-12)
    assert by_radius == pytest.approx(-height / (ball + edge) / across, rel=1e-12)


@pytest.mark.parametrize(
    ("width", "rise", "ball"), [(62e-6, 4e-6, 117e-6), (140e-6, -21e-6, 83e-6), (2e-3, 1e-4, 6e-3)]
)
def test_a_ball_that_rests_on_two_corners_leaves_square_to_its_radius_at_each(width, rise, ball):
    # Origin: the centre where two circles about the corners cross; the path leaves square to the
    # radius to a corner.
    x, z = between(width, rise, ball)
    forward, backward = find_margin_angles(width, rise, ball)
    assert forward == pytest.approx(math.atan2(width - x, z - rise), rel=1e-10)
    assert backward == pytest.approx(math.atan2(x, z), rel=1e-10)
    x, z = between(width, 0.0, ball)
    assert find_margin_angles(width, 0.0, ball)[0] == pytest.approx(
        math.atan2(width - x, z), rel=1e-12
    )
    assert Groove(width, 1.2).angles(ball)[0] == pytest.approx(math.atan2(width - x, z), rel=1e-12)


@pytest.mark.parametrize(
    ("angle", "load", "mu"), [(0.62, 0.73, 0.17), (1.11, 0.021, 0.38), (0.13, 240.0, 0.0)]
)
def test_force_energy_and_power_are_those_of_statics_and_of_a_spring_let_go(angle, load, mu):
    release = find_release(angle, load, mu, TOOL)
    force, reaction = balance(angle, load, mu)
    assert release.pull_force == pytest.approx(force, rel=1e-12)
    assert math.hypot(force, load) == pytest.approx(reaction * math.hypot(1.0, mu), rel=1e-12)
    # Origin: the work that a linear spring gives back on its way to rest, of which the share C_v
    # rings.
    stored = quad(lambda x: TOOL.stiffness * x, 0.0, force / TOOL.stiffness)[0]
    assert release.vibration_energy == pytest.approx(TOOL.conversion * stored, rel=1e-12)
    assert release.mean_power == pytest.approx(TOOL.conversion * stored / 12e-3, rel=1e-12)
    assert release.threshold_ratio == pytest.approx(release.mean_power / 0.13e-6, rel=1e-12)


@pytest.mark.parametrize(("ball", "mu"), [(131e-6, 0.17), (62e-6, 0.43), (9e-3, 0.08)])
def test_a_tip_locks_where_the_reaction_of_the_edge_grows_beyond_all_bounds(ball, mu):
    # Origin: N (cos a - mu sin a) balances the load, so tan a = 1 / mu at locking.
    angle = math.atan2(1.0, mu)
    assert kernels.compute_locking_height(ball, mu) == pytest.approx(
        ball * (1.0 - math.cos(angle)), rel=1e-12
    )
    below, above = angle - 1e-9, angle + 1e-9
    assert find_release(below, 0.73, mu, TOOL).pull_force > 1e8 * 0.73
    assert find_release(above, 0.73, mu, TOOL).status is Status.LOCKED


def test_a_bevel_of_45_degrees_is_climbed_at_45_degrees_by_a_ball_that_meets_its_middle():
    # Origin: drawn so that the ball in the near corner and on the bevel touches neither end of the
    # bevel.
    for size in (1.0, 23.0):
        face = Margin(10e-6 * size, 160e-6 * size, 150e-6 * size)
        assert face.angles(83e-6 * size)[0] == pytest.approx(0.25 * math.pi, rel=1e-12)


@pytest.mark.parametrize(("length", "force", "time"), [(1e2, 1e-3, 1.0), (0.37, 5.3, 19.0)])
@pytest.mark.parametrize(
    "face", [Step(27e-6, 9e-6), Margin(62e-6, 62e-6, 4e-6), Margin(40e-6, 90e-6, 7e-6)]
)
def test_no_figure_depends_on_the_units_of_length_force_and_time(face, length, force, time):
    larger = replace(face, **{name: length * size for name, size in face.dimensions.items()})
    tool = Tool(
        TOOL.stiffness * force / length,
        TOOL.conversion,
        TOOL.ring_duration * time,
        TOOL.detection_threshold * force * length / time,
        TOOL.frequency / time,
        TOOL.decay_time * time,
    )
    point = OperatingPoint(
        POINT.ball_radius * length, POINT.normal_load * force, POINT.friction, tool, 7e-3
    )
    a, b = face.release(POINT), larger.release(point)
    assert (b.status, b.angle) == (Status.RELEASES, pytest.approx(a.angle, rel=1e-12))
    assert b.pull_force == pytest.approx(force * a.pull_force, rel=1e-11)
    assert b.vibration_energy == pytest.approx(force * length * a.vibration_energy, rel=1e-11)
    assert b.mean_power == pytest.approx(force * length / time * a.mean_power, rel=1e-11)
    assert b.threshold_ratio == pytest.approx(a.threshold_ratio, rel=1e-11)
    size = next(iter(face.dimensions))
    spread = {
        size: 0.4e-6,
        "ball_radius": 0.7e-6,
        "normal_load": 4e-3,
        "friction": 0.003,
        "stiffness": 50.0,
    }
    unit = {
        size: length,
        "ball_radius": length,
        "normal_load": force,
        "friction": 1.0,
        "stiffness": force / length,
    }
    small = estimate_interval(face, POINT, spread, draws=500)
    large = estimate_interval(
        larger, point, {name: width * unit[name] for name, width in spread.items()}, draws=500
    )
    for name in ("energy_low", "energy_high", "analytic_energy_low", "analytic_energy_high"):
        assert getattr(large, name) == pytest.approx(
            force * length * getattr(small, name), rel=1e-6
        )


def test_numbers_and_arrays_of_one_are_answered_alike_and_in_the_shape_asked_for():
    for angle, load, mu in (
        (0.62, 0.73, 0.17),
        (0.0, 0.73, 0.17),
        (0.5 * math.pi, 0.73, 0.17),
        (1.5, 0.73, 0.4),
    ):
        alone = find_release(angle, load, mu, TOOL)
        for given in (([angle], load, mu), (angle, [load], mu), (angle, load, [mu])):
            many = find_release(*given, TOOL)
            assert many.status.tolist() == [alone.status]
            assert many.pull_force.shape == many.angle.shape == (1,)
            assert many.pull_force[0] == pytest.approx(alone.pull_force, rel=1e-15, nan_ok=True)
    for gap, opening, rise in (
        (62e-6, 62e-6, 4e-6),
        (40e-6, 90e-6, -7e-6),
        (20e-6, -15e-6, 33e-6),
        (3e-4, 3e-4, 0.0),
    ):
        alone = Margin(gap, opening, rise).angles(131e-6)
        assert all(type(angle) is float for angle in alone)
        for name, value in (("gap", gap), ("opening", opening), ("rise", rise)):
            many = Margin(gap, opening, rise).angles(131e-6, **{name: np.array([value, value])})
            assert [angle.tolist() for angle in many] == [[angle] * 2 for angle in alone]


def test_a_softened_spring_hardens_back_to_its_force():
    # the root of u + c u^3 = F by Viete, put back in
    force = np.array([0.02, 0.4, 3.1, 40.0])[:, None]
    cubic = np.array([1e-7, 3e-3, 0.7, 11.0])
    spring = kernels.compute_unhardened_force(force, cubic)
    np.testing.assert_allclose(
        spring + cubic * spring**3, np.broadcast_to(force, (4, 4)), rtol=1e-9
    )
