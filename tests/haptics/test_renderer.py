"""The reference renderer follows the formula and gives no energy away, with and without ring."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.scenes import corner_path
from oracles.shipped import load_shipped
from stepblocks.contact.critical_angle import find_margin_angles, find_step_angle
from stepblocks.contact.event import compute_ring_energy, list_vibration_events
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.errors import ContactError, HapticsError
from stepblocks.haptics.renderer import Renderer

TEN = load_shipped("paper-ten").stimuli
MARGINS = load_shipped("crown-margins").stimuli
R = 125e-6
POINT = OperatingPoint(R, 1.0, 0.15)
# F_px at mu 0.15, F_py 1 N, R 125 um: the owner's table of the paper's equations (1) and (2).
TABLE = {"step-010": 0.615, "step-050": 1.854, "step-080": 4.48498, "step-100": 19.04}


def formula(block, point=POINT):
    angle = find_step_angle(block.height.nominal, point.ball_radius, block.edge_radius.nominal)
    return point.normal_load * math.tan(angle + math.atan(point.friction))


def drag_over(block, point=POINT, scale=1.0, resolution=0.0, direction=1.0, event=True):
    renderer = Renderer(
        block.counterface().centre_path(point.ball_radius), point, scale=scale, event=event
    )
    travel = 1.25 * scale * formula(block, point) / point.tool.stiffness
    return renderer.drag(point.normal_load, travel, direction, 1e-3 * scale, resolution), renderer


@pytest.mark.parametrize("block", TEN, ids=lambda block: block.id)
def test_notch_of_the_path_is_the_critical_angle_of_the_paper(block):
    _, _, angle = block.counterface().centre_path(R).find_notch(+1.0)
    assert angle == pytest.approx(find_step_angle(block.height.nominal, R), rel=1e-9)
    assert block.counterface().centre_path(R).find_notch(-1.0)[2] == 0.0


@pytest.mark.parametrize(
    "margin", [m for m in MARGINS if m.opening.nominal > 0], ids=lambda margin: margin.id
)
def test_notches_of_a_margin_are_its_closed_form_in_both_directions(margin):
    opening, rise = margin.opening.nominal, margin.horizontal_discrepancy.nominal
    forward, backward = find_margin_angles(opening, rise, R)
    path = margin.counterface().centre_path(R)
    assert path.find_notch(+1.0)[2] == pytest.approx(forward, rel=1e-6)
    assert path.find_notch(-1.0)[2] == pytest.approx(backward, rel=1e-6)


def test_a_rounded_edge_has_the_angle_of_the_larger_circle():
    length = type(TEN[4].edge_radius)
    rounded = TEN[4].model_copy(
        update={
            "edge_radius": TEN[4].edge_radius.__class__(
                **{**vars(TEN[4].edge_radius), "nominal": 30e-6}
            )
        }
    )
    assert isinstance(rounded.edge_radius, length)
    assert rounded.counterface().centre_path(R).find_notch(+1.0)[2] == pytest.approx(
        math.acos(1.0 - 50e-6 / (R + 30e-6)), rel=1e-9
    )


@pytest.mark.repeats
@pytest.mark.parametrize("block", TEN, ids=lambda block: block.id)
def test_peak_force_is_that_of_the_formula(block):
    record, renderer = drag_over(block)
    assert record.peak == pytest.approx(formula(block), rel=5e-3)
    if block.id in TABLE:
        assert record.peak == pytest.approx(TABLE[block.id], rel=5e-3)
    assert record.crossed
    # found between two ticks: the last pull that a tick saw is a little below
    assert renderer.release_force == pytest.approx(formula(block), rel=1e-6)
    assert renderer.release_force >= record.peak


@pytest.mark.parametrize("scale", [5.0, 20.0, 1000.0])
def test_magnifying_ball_and_step_keeps_the_force(scale):
    record, _ = drag_over(TEN[4], scale=scale)
    plain, _ = drag_over(TEN[4])
    assert record.peak == pytest.approx(plain.peak, rel=1e-9)


@pytest.mark.parametrize(
    ("scale", "resolution"), [(200.0, 55e-6), (100.0, 23e-6), (50.0, 10e-6), (5.0, 1.5e-6)]
)
def test_rounded_positions_keep_the_force_where_the_plan_magnifies_enough(scale, resolution):
    for block in (TEN[2], TEN[4], TEN[9]):
        record, _ = drag_over(block, scale=scale, resolution=resolution)
        assert record.peak == pytest.approx(formula(block), rel=5e-3)


def test_rounded_positions_spoil_an_unmagnified_step():
    # The position step of a Touch, 55 um, on 9.81 N/mm is 0.54 N: the force cannot follow.
    record, _ = drag_over(TEN[0], resolution=55e-6)
    assert abs(record.peak / formula(TEN[0]) - 1.0) > 0.05


def test_a_locked_probe_stays_locked():
    # Locking height of mu 0.3 and R 125 um: 125 (1 - sin(atan 0.3)) = 89.1 um.
    point = replace(POINT, friction=0.3)
    for block in TEN[-2:]:
        renderer = Renderer(block.counterface().centre_path(R), point)
        record = renderer.drag(1.0, 4e-3)
        assert not record.crossed
        assert record.events == 0
        assert record.pull[-1] == record.peak > 30.0


def test_dragging_down_a_step_releases_nothing():
    record, _ = drag_over(TEN[4], direction=-1.0)
    assert record.events == 0
    assert record.peak == pytest.approx(0.15, rel=0.02)  # plain Coulomb friction on the flat


def test_a_groove_is_felt_in_both_directions():
    gap = next(m for m in MARGINS if m.id == "gap-100")
    renderer = Renderer(gap.counterface().centre_path(R), POINT)
    up, down = renderer.drag(1.0, 4e-4), renderer.drag(1.0, 4e-4, -1.0)
    assert up.events == down.events == 1
    assert up.peak == pytest.approx(
        math.tan(math.asin(100e-6 / (2 * R)) + math.atan(0.15)), rel=5e-3
    )
    assert down.peak == pytest.approx(up.peak, rel=1e-6)


def test_the_event_carries_the_vibration_energy_of_the_formula_at_any_scale():
    event = list_vibration_events(TEN[4].counterface(), POINT)[0]
    expected = 0.2 * formula(TEN[4]) ** 2 / (2 * 9.81e3)
    for scale in (1.0, 20.0):
        record, _ = drag_over(TEN[4], scale=scale)
        # after the release the spring follows the hand; what remains over it is the ring
        ring = record.force - -record.pull
        extra = np.zeros(1500)
        tail = ring[record.pull.argmax() :]
        extra[: len(tail)] = tail[:1500]
        wanted = (
            event.amplitude
            * np.exp(-np.arange(1500) * 1e-4 / PAPER.tool.decay_time)
            * np.sin(math.tau * PAPER.tool.frequency * np.arange(1500) * 1e-4)
        )
        # the release lies within the tick after the peak
        step = 1e-3 * scale * 1e-4 * PAPER.tool.stiffness / scale
        late = 1e-4 * (1.0 - (formula(TEN[4]) - record.peak) / step)
        times = np.arange(min(len(tail), 1500) - 1) * 1e-4 + late
        swing = event.amplitude * np.exp(-times / PAPER.tool.decay_time)
        swing *= np.sin(math.tau * PAPER.tool.frequency * times)
        assert extra[1 : len(times) + 1] == pytest.approx(swing, abs=6e-3 * event.amplitude)
    assert event.energy == pytest.approx(expected, rel=1e-9)
    assert compute_ring_energy(wanted, 1e4, event.tool) == pytest.approx(expected, rel=0.01)


def test_without_the_event_the_spring_is_the_same_and_nothing_rings():
    with_ring, _ = drag_over(TEN[4])
    without, renderer = drag_over(TEN[4], event=False)
    assert renderer.events == 1  # counted all the same
    assert np.array_equal(with_ring.pull, without.pull)
    assert np.array_equal(without.force, -without.pull)


def test_the_wall_gives_no_energy_back_that_it_did_not_get():
    """Work of the hand on closed tours; a servo that holds its force leaks k dx^2 / 2 a tick."""
    generator = np.random.default_rng(5)
    for block in (TEN[1], TEN[6]):
        renderer = Renderer(block.counterface().centre_path(R), POINT, event=False)
        for _ in range(3):
            corners = np.column_stack(
                [
                    generator.uniform(-3e-4, 3e-4, 6),
                    generator.uniform(-2e-5, 2e-5, 6),
                    generator.uniform(6e-5, 2.2e-4, 6),
                ]
            )
            tour = np.vstack([[0.0, 0.0, 4e-4], corners, [0.0, 0.0, 4e-4]])
            steps = 3000
            position = np.vstack(
                [np.linspace(a, b, steps, endpoint=False) for a, b in itertools.pairwise(tour)]
            )
            renderer.reset(tour[0])
            work, leak, before = 0.0, 0.0, position[0]
            for here in position:
                move = here - before
                work -= float(renderer.force @ move)
                leak += 0.5 * renderer.stiffness * float(move @ move)
                renderer.tick(here, move * 1e4)
                before = here
            assert work >= -leak
            assert work > 0.0


def test_a_hand_in_the_air_feels_nothing_and_lands_on_either_side():
    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT)
    still = np.zeros(3)
    renderer.reset(np.array([-3e-4, 0.0, 3e-4]))
    assert not renderer.tick(np.array([-2e-4, 0.0, 2e-4]), still).any()
    renderer.reset(np.array([3e-4, 0.0, 3e-4]))
    low = renderer.tick(np.array([3e-4, 0.0, R + 50e-6 - 1e-5]), still).copy()
    assert low[2] == pytest.approx(9.81e3 * 1e-5, rel=1e-9)
    # 10 um over the lower path and pushed through the riser: the proxy meets the edge, climbs it
    # and drags on top
    renderer.reset(np.array([-3e-4, 0.0, R + 1e-5]))
    force = renderer.tick(np.array([1e-4, 0.0, R + 1e-5]), still)
    assert force[0] == pytest.approx(-0.15 * force[2], rel=1e-6)
    assert force[2] == pytest.approx(9.81e3 * 40e-6, rel=1e-6)
    assert 0.0 < renderer.proxy[0] < 1e-4


def test_friction_along_the_edge_is_coulombs():
    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT)
    load, still = 0.5, np.zeros(3)
    height = R - load / 9.81e3
    renderer.reset(np.array([-1e-3, 0.0, 3e-4]))
    for y in np.linspace(0.0, 1e-4, 200):
        force = renderer.tick(np.array([-1e-3, y, height]), still)
    assert force[1] == pytest.approx(-0.15 * load, rel=1e-6)


def test_a_measured_profile_is_rendered_like_the_nominal_one():
    x = np.linspace(-2e-4, 2e-4, 401)
    points = [(float(a), 0.0 if a < 0 else 50e-6) for a in x]
    path = corner_path([(-2e-3, 0.0), *points, (2e-3, 50e-6)], R)
    assert path.find_notch(+1.0)[2] == pytest.approx(find_step_angle(50e-6, R), abs=2e-3)


@pytest.mark.parametrize(
    "points", [[(0.0, 0.0)], [(0.0, 0.0), (-1.0, 0.0)], [(0.0, math.nan), (1.0, 0.0)]]
)
def test_a_malformed_profile_is_refused(points):
    with pytest.raises(ContactError, match="a profile must have"):
        corner_path(points, R)


def test_the_renderer_uses_the_constants_of_the_paper():
    assert (PAPER.tool.stiffness, PAPER.tool.conversion) == (9.81e3, 0.2)


def test_a_tick_allocates_nothing():
    """By numba's allocator: a thousand ticks take no more than ten."""
    from numba.core.runtime import _nrt_python as allocator

    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT)
    counts, step = [], 5e-7  # m a tick, at 5 mm/s
    for ticks in (10, 10, 1000):
        allocator.memsys_enable_stats()
        before = allocator.memsys_get_stats_alloc()
        renderer.drag(1.0, ticks * step - 40e-6, speed=5e-3)
        counts.append(allocator.memsys_get_stats_alloc() - before)
        allocator.memsys_disable_stats()
    assert renderer.events == 1
    assert counts[2] == counts[1]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("where", ["position", "velocity"])
def test_an_input_that_is_no_number_gives_the_last_good_force_then_none_and_is_counted(bad, where):
    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT, rate=1e3)
    hand, still = np.array([-3e-4, 0.0, R - 1e-4]), np.zeros(3)
    renderer.reset(np.add(hand, [0.0, 0.0, 1e-3]))
    good = renderer.tick(hand, still).copy()
    wrong = np.array([bad, 0.0, 0.0])
    given = (wrong, still) if where == "position" else (hand, wrong)
    forces = [renderer.tick(*given).copy() for _ in range(15)]
    assert list(forces[0]) == list(good)
    sizes = [float(np.linalg.norm(force)) for force in forces]
    assert all(after <= before for before, after in itertools.pairwise(sizes))
    assert not any(sizes[11:])
    assert renderer.faults == 15
    back = [float(np.linalg.norm(renderer.tick(hand, still))) for _ in range(15)]
    assert back[0] == 0.0
    assert all(after >= before for before, after in itertools.pairwise(back))
    assert renderer.tick(hand, still) == pytest.approx(good)


@pytest.mark.parametrize(
    "wrong", [np.zeros(2), np.zeros((3, 1)), np.zeros(4), [0.0, 0.0, 0.0], None]
)
def test_a_position_of_a_wrong_shape_is_refused(wrong):
    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT)
    with pytest.raises(HapticsError, match=r"must be arrays of shape \(3,\)"):
        renderer.tick(wrong, np.zeros(3))
    with pytest.raises(HapticsError, match=r"must be arrays of shape \(3,\)"):
        renderer.tick(np.zeros(3), wrong)


@pytest.mark.parametrize(
    ("load", "travel", "speed"),
    [
        (0.3, 200.0, 1e-3),
        (0.3, 2e-4, 0.0),
        (0.3, math.nan, 1e-3),
        (0.3, -1.0, 1e-3),
        (math.nan, 2e-4, 1e-3),
    ],
)
def test_a_drag_without_end_or_without_a_load_is_refused(load, travel, speed):
    """A travel in micrometres, off by a million, took all memory."""
    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT)
    with pytest.raises(HapticsError, match="a drag must have a load, and 1 to 20000000 ticks"):
        renderer.drag(load, travel, speed=speed)


def test_a_speed_that_is_no_real_number_is_refused_before_the_compiler_sees_it():
    renderer = Renderer(TEN[4].counterface().centre_path(R), POINT)
    with pytest.raises(TypeError, match=r"not .*complex"):
        renderer.drag(0.5, 1e-4, speed=1e-3 + 1e-3j)
