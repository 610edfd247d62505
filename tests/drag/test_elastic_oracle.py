"""A ball that presses and grips every face and corner by itself gives the same drag.

Expected values: `oracles.elastic_drag`, its own geometry and integrator with the same contact law.
"""

import math

import numpy as np
import pytest

from oracles.elastic_drag import elastic_drag
from stepblocks.contact.counterface import Profile, Step
from stepblocks.contact.laws import LinearContact
from stepblocks.drag.run import Drag, drag_over


def follow_an_elastic_ball(done: Drag, corners: list[tuple[float, float]]) -> np.ndarray:
    """Rows of time, pull, x and y of the oracle under the conditions of a drag."""
    probe, settings = done.trace.probe, done.trace.settings
    damper = 2.0 * probe.damping_ratio * math.sqrt(probe.stiffness * probe.mass)
    return elastic_drag(
        corners,
        radius=done.ball_radius,
        contact=(probe.contact_stiffness, probe.contact_power, probe.contact_loss),
        friction=settings.friction,
        modes=[(probe.stiffness, probe.mass, damper)],
        load=settings.normal_load,
        speed=settings.speed,
        start=float(done.frame.x_m.iloc[0]),
        end=float(done.frame.handle_m.iloc[-1]),
    )


@pytest.mark.long
@pytest.mark.parametrize("load", [0.25, 1.0])
@pytest.mark.parametrize("height", [0.05e-6, 0.1e-6, 0.3e-6, 0.5e-6, 1e-6, 10e-6])
def test_a_step_of_any_height_on_steel_asks_the_pull_of_floor_and_edge_together(height, load):
    # under 1 N steel gives way by 0.7 um: the equation of a rigid contact ends there
    done = drag_over(Step(height), load=load)
    corners = [(-1e-3, 0.0), (-1e-12, 0.0), (0.0, height), (1e-3, height)]
    time, pull = follow_an_elastic_ball(done, corners)[:, :2].T
    # behind an edge of 50 nm it lands with as much pull again
    near = np.abs(time - done.summary["release_time_s"]) < 2e-3
    assert done.summary["peak_force_n"] == pytest.approx(pull[near].max(), rel=2e-3)
    top = int(np.argmax(np.where(near, pull, 0.0)))
    swing = 0.15 * load - pull[top : top + 133].min()  # of two periods
    ring = 0.5 * max(swing, 0.0) ** 2 / done.tool.stiffness
    assert done.summary["vibration_energy_j"] == pytest.approx(
        ring, abs=0.012 * done.summary["stored_energy_j"]
    )


@pytest.mark.long
@pytest.mark.parametrize("load", [0.3, 1.0])
@pytest.mark.parametrize("face", [5.0, 10.0, 20.0, -5.0, -10.0, -20.0])
def test_behind_an_edge_the_ring_goes_about_the_force_of_sliding_on_the_face_where_it_lands(
    face, load
):
    # Expected level: N tan(slope + atan mu) of the declared face; down a face that falls, the slope
    # at which the ball has come to lie round the corner, -asin(x / R)
    height, rise = 10e-6, math.tan(math.radians(face))
    corners = [(-1e-3, 0.0), (-1e-9, 0.0), (0.0, height), (2e-3, height + 2e-3 * rise)]
    corners.append((3e-3, corners[-1][1]))
    done = drag_over(Profile(*np.transpose(corners)), load=load)
    time, pull, x = follow_an_elastic_ball(done, corners)[:, :3].T
    event = done.events.iloc[0]
    assert (event.status, event.belongs_to) == ("releases", "feature")
    near = np.abs(time - event.released_s) < 2e-3
    assert event.pull_n == pytest.approx(pull[near].max(), rel=3e-3)
    top = int(np.argmax(np.where(near, pull, 0.0)))
    lowest = top + int(np.argmin(pull[top : top + 133]))  # of two periods
    turned = math.degrees(math.asin(max(x[lowest], 0.0) / done.ball_radius))
    slope = math.radians(max(face, -turned) if face < 0.0 else face)
    level = load * math.tan(slope + math.atan(0.15))
    assert event.sliding_force_n == pytest.approx(level, abs=5e-3 * load)
    ring = 0.5 * max(level - pull[lowest], 0.0) ** 2 / done.tool.stiffness
    assert event.vibration_energy_j == pytest.approx(ring, abs=3e-3 * event.stored_energy_j)


@pytest.mark.long
def test_where_a_tip_lands_in_a_notch_the_grip_of_the_contact_decides_and_not_a_rigid_blow():
    # profile 186 of benchmarks/drag_profiles.py: a rigid blow gives 1.0535 N, 1.5 % more, because
    # the grip of an elastic contact gives back what a rigid one loses along the face
    low, high = 17.3592336e-6, 41.3112168e-6
    corners = [(-3.5e-4, 0.0), (-1e-6, 0.0), (0.0, low), (43e-6, low), (44e-6, high)]
    corners.append((3.49e-4, high))
    done = drag_over(Profile(*np.transpose(corners)), contact=LinearContact(3e8))
    rows = follow_an_elastic_ball(done, corners)
    first, second = done.events.itertuples()
    before = rows[:, 0] < second.caught_s
    assert first.pull_n == pytest.approx(rows[before, 1].max(), rel=2e-3)
    assert second.pull_n == pytest.approx(rows[~before, 1].max(), rel=3e-3)
    behind = rows[rows[:, 0] > second.released_s, 1]
    ring = 0.5 * (0.15 - behind.min()) ** 2 / done.tool.stiffness
    assert second.vibration_energy_j == pytest.approx(ring, rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize(
    ("height", "width", "deep", "friction"),
    [(3e-6, 5e-6, 200e-6, 0.05), (8e-6, 20e-6, 200e-6, 0.15), (8e-6, 20e-6, 60e-6, 0.15)],
)
def test_down_a_wall_higher_than_the_ball_the_tip_swings_as_far_as_an_elastic_ball(
    height, width, deep, friction
):
    # the foot of a wall was rounded, and the tip fell 24 um below its floor: 6 % too far
    corners = [(-1e-3, 0.0), (0.0, 0.0), (0.0, height), (width, height), (width, height - deep)]
    corners.append((1e-3, height - deep))
    done = drag_over(Profile(*np.transpose(corners)), friction=friction)
    rows = follow_an_elastic_ball(done, corners)
    assert done.frame.fx_n.max() == pytest.approx(rows[:, 1].max(), rel=2e-3)
    swing, expected = (friction - one.min() for one in (done.frame.fx_n, rows[:, 1]))
    assert swing == pytest.approx(expected, rel=0.02)
    assert done.frame.y_m.min() > height - deep - 12e-6
