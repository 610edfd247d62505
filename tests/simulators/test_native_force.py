"""What libstepblocks gives a hand: a limited force, and none where something is wrong."""

import itertools
import math

import pytest


def press(world, name="step-050", x=-3e-4, depth=1e-4):
    """A hand that rests on the lower face."""
    hand = (x, 0.0, world.path_height(name, x) - depth)
    world.choose(name)
    return hand, list(world.tick(hand).force)


def test_a_position_that_is_no_number_gives_the_last_good_force_then_none_and_is_counted(world):
    hand, good = press(world)
    world.configure("ramp_s", 0.01)
    forces = []
    for bad in [math.nan, math.inf, -math.inf] * 5:
        found = world.tick((bad, 0.0, hand[2]))
        forces.append(list(found.force))
        assert found.state == 1
    assert forces[0] == good
    sizes = [math.hypot(*force) for force in forces]
    assert all(after <= before for before, after in itertools.pairwise(sizes))
    assert sizes[10:] == pytest.approx([0.0] * 5, abs=1e-12)
    assert found.faults == 15
    back = [math.hypot(*world.tick(hand).force) for _ in range(15)]
    assert back[0] == 0.0
    assert all(after >= before for before, after in itertools.pairwise(back))
    assert back[-1] == pytest.approx(math.hypot(*good))


@pytest.mark.parametrize("dt", [math.nan, -1.0])
def test_a_time_that_runs_backwards_is_a_fault(world, dt):
    hand, good = press(world)
    assert list(world.tick(hand, dt=dt).force) == good
    assert world.output.faults == 1


def test_a_loop_that_is_faster_than_its_clock_feels_its_block_all_the_same(world):
    """10 kHz on a clock of 1 ms: nine ticks of ten come in no time."""
    hand, good = press(world)
    for tick in range(200):
        found = world.tick(hand, dt=0.0 if tick % 10 else 1e-3)
        assert list(found.force) == pytest.approx(good)
    assert (found.faults, found.state) == (0, 0)


def test_the_force_limit_keeps_the_direction_and_is_counted(world):
    hand, good = press(world, depth=5e-4)
    world.configure("force_limit_n", 0.5 * math.hypot(*good))
    found = world.tick(hand)
    assert list(found.force) == pytest.approx([0.5 * value for value in good])
    assert found.limited == 1


def test_a_hand_is_given_3_n_at_most_where_nothing_is_configured(binding, folder):
    """Pressed 1 mm into the lower face: the wall of 9.81 N/mm means 9.81 N."""
    with binding.World(folder / "blocks.txt") as world:
        world.configure("rise_s", 0.0)
        found = world.tick((-3e-4, 0.0, world.path_height("step-010", -3e-4) - 1e-3))
        assert list(found.force) == pytest.approx([0.0, 0.0, 3.0])
        assert found.load == pytest.approx(9.81)
        assert found.limited == 1


def test_a_late_tick_switches_the_force_off_until_the_hand_has_let_go(world):
    hand, good = press(world)
    assert list(world.tick(hand, dt=0.06).force) == [0.0, 0.0, 0.0]
    assert (world.output.state, world.output.late) == (2, 1)
    assert not any(world.tick(hand).force)
    world.tick((hand[0], 0.0, hand[2] + 1e-3))
    forces = [list(world.tick(hand).force) for _ in range(20)]
    assert math.hypot(*forces[0]) < 0.2 * math.hypot(*good)
    assert forces[-1] == pytest.approx(good)
    assert world.output.late == 1


def test_the_first_tick_of_a_hand_inside_a_block_gives_no_force(binding, folder):
    """The force grows within a tenth of a second where nothing is configured."""
    with binding.World(folder / "blocks.txt") as world:
        _, first = press(world, depth=6e-4)
        assert not any(first)


def test_the_force_grows_slowly_after_the_start(world):
    world.configure("rise_s", 0.1)
    hand, first = press(world)
    assert first == [0.0, 0.0, 0.0]
    sizes = [world.tick(hand).force[2] for _ in range(120)]
    assert sizes[49] == pytest.approx(0.5 * 9.81e3 * 1e-4, rel=0.03)
    assert sizes[-1] == pytest.approx(9.81e3 * 1e-4)
