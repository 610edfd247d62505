"""The compiled tick: the proxy keeps the law of friction, on any path and for any hand."""

import math

import numpy as np
import pytest

from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.haptics import proxy_kernel
from stepblocks.haptics.renderer import Renderer

R, MU, LOAD = 140e-6, 0.23, 0.7
TOOL = Tool(stiffness=7.3e3, conversion=0.31, frequency=270.0, decay_time=11e-3)
POINT = OperatingPoint(R, LOAD, MU, TOOL)
WAVY = np.linspace(-8e-4, 8e-4, 300)
FACES = {
    "step": Step(60e-6),
    "rounded": Step(60e-6, 20e-6),
    "groove": Margin(90e-6, 90e-6, 0.0),
    "margin": Margin(50e-6, 50e-6, 30e-6),
    "wavy": Profile(WAVY, 15e-6 * np.sin(WAVY / 60e-6)),
}


@pytest.fixture(params=FACES)
def renderer(request):
    return Renderer(FACES[request.param].centre_path(R), POINT, wall=9.1e3, event=False)


def slopes(path, x):
    """Slopes to the left and right of a place on a path; the same within a piece."""
    at = np.searchsorted(path.x, x)
    if path.x[at] == x:
        return path.slope_end[at - 1], path.slope_start[at]
    share = (x - path.x[at - 1]) / (path.x[at] - path.x[at - 1])
    slope = path.slope_start[at - 1] + share * (path.slope_end[at - 1] - path.slope_start[at - 1])
    return slope, slope


def hands(path, seed, count=600):
    """A hand that wanders over the middle of a path, pressing with changing depth."""
    generator = np.random.default_rng(seed)
    x = np.interp(np.linspace(0, 9, count), np.arange(10), generator.uniform(-4e-4, 4e-4, 10))
    depth = np.interp(np.linspace(0, 9, count), np.arange(10), generator.uniform(2e-5, 2e-4, 10))
    return np.column_stack([x, np.zeros(count), path.z.min() - depth])


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))]
)
def test_the_proxy_never_leaves_the_cone_of_friction(renderer, seed):
    """On one side at least, the force along the path is no more than mu times that on it."""
    renderer.reset(np.array([0.0, 0.0, 1e-3]))
    for hand in hands(renderer.path, seed):
        pull, _, down = renderer.tick(hand, np.zeros(3)) * [-1.0, 1.0, 1.0]
        for direction, slope in zip(
            (-1.0, 1.0), slopes(renderer.path, renderer.proxy[0]), strict=True
        ):
            along, normal = direction * pull - down * direction * slope, down + pull * slope
            assert along <= MU * normal + 1e-6 * down


@pytest.mark.parametrize("seed", [4, 5])
def test_the_force_is_that_of_the_springs(renderer, seed):
    renderer.reset(np.array([0.0, 0.0, 1e-3]))
    for hand in hands(renderer.path, seed):
        force = renderer.tick(hand, np.zeros(3))
        x, z = (
            renderer.proxy[0],
            float(np.interp(renderer.proxy[0], renderer.path.x, renderer.path.z)),
        )
        assert force[[0, 2]] == pytest.approx(
            [-7.3e3 * (hand[0] - x), 9.1e3 * (z - hand[2])], rel=1e-9, abs=1e-12
        )


def test_a_mirrored_world_gives_mirrored_forces():
    """The margin from the other side: forces along the drag change their sign, none across."""
    face = Margin(50e-6, 50e-6, 30e-6)
    x, z = face.section(4e-3)
    there = Renderer(Profile(x, z).centre_path(R), POINT)
    back = Renderer(Profile(-x[::-1], z[::-1]).centre_path(R), POINT)
    for one in (there, back):
        one.reset(np.array([0.0, 0.0, 1e-3]))
    for hand in hands(there.path, 6):
        force = there.tick(hand, np.zeros(3)).copy()
        mirrored = back.tick(hand * [-1.0, 1.0, 1.0], np.zeros(3))
        assert mirrored == pytest.approx(force * [-1.0, 1.0, 1.0], rel=1e-6, abs=2e-5)
    assert there.events == back.events > 0


def test_a_hand_that_does_not_move_feels_a_force_that_does_not_change(renderer):
    """The proxy has come to rest after one tick: what moved once moves no more."""
    renderer.reset(np.array([0.0, 0.0, 1e-3]))
    for hand in hands(renderer.path, 7)[::40]:
        first = renderer.tick(hand, np.zeros(3)).copy()
        assert renderer.tick(hand, np.zeros(3)) == pytest.approx(first, rel=1e-7, abs=1e-7)


def test_without_friction_the_proxy_rests_where_the_force_is_square_to_the_path():
    renderer = Renderer(
        Step(60e-6, 20e-6).centre_path(R), OperatingPoint(R, LOAD, 1e-12, TOOL), event=False
    )
    renderer.reset(np.array([-1e-4, 0.0, 1e-3]))
    for x in np.linspace(-1e-4, -2e-5, 30):
        pull, _, down = renderer.tick(np.array([x, 0.0, 1e-4]), np.zeros(3)) * [-1.0, 1.0, 1.0]
        left, right = slopes(renderer.path, renderer.proxy[0])
        assert left - 1e-6 <= pull / down <= right + 1e-6


def test_damping_opposes_the_velocity_of_the_hand_in_contact_and_is_silent_in_the_air():
    renderer = Renderer(Step(60e-6).centre_path(R), POINT, damping=3.0)
    velocity = np.array([2e-3, -1e-3, 4e-3])
    renderer.reset(np.array([-6e-4, 0.0, 1e-3]))
    assert not renderer.tick(np.array([-6e-4, 0.0, 9e-4]), velocity).any()
    damped = renderer.tick(np.array([-6e-4, 0.0, R - 5e-5]), velocity).copy()
    still = renderer.tick(np.array([-6e-4, 0.0, R - 5e-5]), np.zeros(3))
    assert damped - still == pytest.approx(-3.0 * velocity)


def test_rounded_positions_are_multiples_of_the_devices_step():
    """Dragged with a step of the device of 30 um, the spring force moves in steps of k q, too."""
    renderer = Renderer(Step(60e-6).centre_path(R), POINT, event=False)
    record = renderer.drag(LOAD, 5e-5, resolution=30e-6)
    steps = np.abs(np.diff(record.pull))
    moved = steps[steps > 1e-9]
    assert moved.max() >= 0.9 * 7.3e3 * 30e-6
    smooth = renderer.drag(LOAD, 5e-5)
    assert np.abs(np.diff(smooth.pull)).max() < 0.1 * moved.max()


def test_a_release_writes_force_ring_and_count_into_the_state():
    renderer = Renderer(Step(60e-6).centre_path(R), POINT)
    force = LOAD * math.tan(math.acos(1 - 60e-6 / R) + math.atan(MU))
    record = renderer.drag(LOAD, 1.3 * force / 7.3e3)
    assert (renderer.events, record.events, record.crossed) == (1, 1, True)
    assert renderer.release_force == pytest.approx(force, rel=1e-6)
    last = int(record.pull.argmax())
    step = record.pull[last] - record.pull[last - 1]
    share = (force - record.pull[last]) / step  # of the tick, until the notch gave way
    times = 1e-4 * np.array([1.0 - share, 2.0 - share])
    swing = np.exp(-times / 11e-3) * np.sin(math.tau * 270.0 * times)
    ring = record.force[last + 1 :] + record.pull[last + 1 :]
    assert ring[:2] == pytest.approx(math.sqrt(0.31) * force * swing, rel=1e-3, abs=1e-4)


def test_falling_into_a_notch_is_no_release():
    """A hand lands in the groove and is pulled out within the tick: nothing held, no ring."""
    face = Margin(90e-6, 90e-6, 0.0)
    renderer = Renderer(face.centre_path(R), POINT)
    x, z, _ = renderer.path.find_notch(+1.0)
    renderer.reset(np.array([x, 0.0, z + 1e-6]))
    renderer.tick(np.array([x + 1e-3, 0.0, z - 1e-4]), np.zeros(3))
    assert renderer.events == 0


@pytest.mark.parametrize(("place", "at_end"), [(-1.0, 0), (1.0, -1)])
def test_a_hand_beyond_the_path_is_held_at_its_end(renderer, place, at_end):
    end = renderer.path.x[at_end]
    renderer.reset(np.array([end, 0.0, 1e-3]))
    z = renderer.path.z[at_end] - 1e-4
    assert renderer.tick(np.array([end + place, 0.0, z]), np.zeros(3)) == pytest.approx(
        [0.0, 0.0, 9.1e3 * 1e-4], abs=1e-9
    )


def test_the_records_of_the_kernel_hold_plain_numbers_only():
    """Compiled code takes no Python objects: they are counted, and a servo tick must not wait."""
    for record in (proxy_kernel.PATH, proxy_kernel.SETTING, proxy_kernel.STATE):
        assert not record.hasobject
