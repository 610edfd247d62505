"""The renderer over height maps: the formula on any surface, a round cone of friction, no energy from the wall."""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from stepblocks.contact.event import ring_energy, vibration_events
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.path.profile import profile_path
from stepblocks.contact.path.tip import Ball
from stepblocks.declare import load_set
from stepblocks.errors import HapticsError
from stepblocks.simulators.renderer.height_map import height_map, map_of
from stepblocks.simulators.renderer.map_servo import MapRenderer, drag_over_map

ROOT = Path(__file__).resolve().parents[2]
TEN = load_set(ROOT / "stimuli" / "paper-ten.toml").stimuli
MARGINS = {s.id: s for s in load_set(ROOT / "stimuli" / "crown-margins.toml").stimuli}
R, MU, K = 125e-6, 0.15, 9.81e3
CONDITION = OperatingPoint(R, 1.0, MU)


def formula(angle, mu=MU):
    return math.tan(angle + math.atan(mu))


def over(stimulus, scale=1.0, resolution=0.0, condition=CONDITION, direction=0.0, event=True, farther=1.0):
    renderer = MapRenderer(map_of(stimulus, R), condition, scale, event=event)
    sign = math.copysign(1.0, math.cos(direction))
    expected = vibration_events(stimulus.id, stimulus.counterface(), condition)[0 if sign > 0 else 1]
    force = expected.critical_force if math.isfinite(expected.critical_force) else 10.0
    travel = (20e-6 + 1.25 * force / K) / abs(math.cos(direction)) * farther * scale
    start = (scale * (expected.trigger_position - sign * 20e-6), 0.0)
    return drag_over_map(renderer, 1.0, start, travel, direction, 1e-3 * scale, resolution), renderer


@pytest.mark.parametrize("block", TEN, ids=lambda block: block.id)
def test_peak_force_over_the_height_field_of_a_block_is_that_of_the_formula(block):
    record, renderer = over(block)
    assert record.peak == pytest.approx(formula(math.acos(1 - block.height.nominal / R)), rel=5e-3)
    assert (record.events, record.crossed) == (1, True)
    assert renderer.release_force == pytest.approx(record.peak, rel=1e-9)


@pytest.mark.parametrize(("scale", "resolution"), [(20.0, 0.0), (200.0, 55e-6), (5.0, 1.5e-6)])
def test_magnified_and_rounded_the_force_stays(scale, resolution):
    record, _ = over(TEN[4], scale, resolution)
    assert record.peak == pytest.approx(formula(math.acos(1 - 50 / 125)), rel=5e-3)


@pytest.mark.parametrize("direction", [0.0, math.pi])
def test_a_round_crown_is_felt_as_its_gap(direction):
    """Equal shoulders 50 um apart: sin a = g / 2R, along the path of draw, from tooth to crown and back."""
    record, _ = over(MARGINS["crown-shoulder"], direction=direction)
    assert record.peak == pytest.approx(formula(math.asin(50e-6 / (2 * R))), rel=5e-3)
    assert record.events == 1


def test_a_locked_probe_stays_locked():
    record, _ = over(TEN[9], condition=replace(CONDITION, friction=0.3))
    assert not record.crossed
    assert record.events == 0


@pytest.mark.parametrize("degrees", [1.0, 2.0, 3.0, 5.0])
def test_an_oblique_drag_that_sticks_obeys_the_cone_about_the_edges_normal(degrees):
    """At the release the force on the edge lies on the cone: |f_t| = mu f_n with F_y = F_x tan(phi)."""
    a, phi = math.acos(1 - 50 / 125), math.radians(degrees)

    def beyond(force):
        tangential = math.hypot(force * math.cos(a) - math.sin(a), force * math.tan(phi))
        return tangential - MU * (force * math.sin(a) + math.cos(a))

    record, _ = over(TEN[4], direction=phi)
    assert record.peak == pytest.approx(brentq(beyond, math.tan(a), formula(a)), rel=5e-3)
    assert record.events == 1


def test_an_oblique_drag_that_slides_along_the_edge_releases_between_no_friction_and_all_of_it():
    """Sliding along the notch turns friction away from the climb: the component across lies in tan(a) .. tan(a + atan mu)."""
    a, before = math.acos(1 - 50 / 125), formula(math.acos(1 - 50 / 125))
    for degrees in (20.0, 45.0, 70.0):
        record, renderer = over(TEN[4], direction=math.radians(degrees))
        assert math.tan(a) < record.peak < before
        assert record.events == 1
        assert renderer.proxy[1] > 20e-6  # it slid along the edge
        before = record.peak


@pytest.mark.parametrize("degrees", [0.0, 30.0, 77.0, 180.0, 250.0])
def test_friction_on_the_flat_is_coulombs_in_every_direction(degrees):
    flat = height_map(np.zeros((60, 60)), (10e-6, 10e-6), R, (-300e-6, -300e-6))
    renderer = MapRenderer(flat, CONDITION)
    record = drag_over_map(renderer, 0.5, (0.0, 0.0), 1e-4, math.radians(degrees))
    way = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    assert record.force[-1] == pytest.approx(-MU * 0.5 * way, abs=1e-5)  # the tip swings in behind the hand
    assert np.hypot(*record.force[-1]) == pytest.approx(MU * 0.5, rel=1e-9)


def test_the_ball_rests_where_exact_dilation_puts_it():
    """On a wavy ridge, between samples too, against the profile's exact envelope from another module."""
    x = np.arange(-150, 151) * 2e-6
    z = 20e-6 * np.exp(-((x / 60e-6) ** 2)) + 3e-6 * np.sin(x / 15e-6)
    renderer = MapRenderer(height_map(np.tile(z, (3, 1)), (2e-6, 300e-6), R, (x[0], -300e-6)), CONDITION)
    places = np.linspace(-120e-6, 120e-6, 97)
    wanted = profile_path(x, z, Ball(R), positions=places).height + R
    excess = np.array([renderer.height(place, 1e-5) for place in places]) - wanted
    assert excess.max() < 1e-12
    assert excess.min() > -3e-9  # where the contact runs ahead of the nodes, in a hollow almost as round as the ball


def test_the_ring_carries_the_energy_of_the_formula_along_the_drag():
    renderer = MapRenderer(map_of(TEN[4], R), CONDITION)
    force = formula(math.acos(1 - 50 / 125))
    record = drag_over_map(renderer, 1.0, (-120e-6, 0.0), 20e-6 + 1.6 * force / K, speed=1e-3)
    first = int(record.pull[:, 0].argmax()) + 1
    ring = (record.force + record.pull)[first:, 0]
    expected = 0.2 * force**2 / (2 * K)
    spent = 1.0 - math.exp(-2 * len(ring) * 1e-4 / PAPER.tool.decay_time)
    event = vibration_events(TEN[4].id, TEN[4].counterface(), CONDITION)[0]
    assert ring_energy(ring, 1e4, event) == pytest.approx(expected * spent, rel=0.02)
    assert np.argmax(np.abs(np.fft.rfft(ring, 20_000))) / 2 == pytest.approx(PAPER.tool.frequency, abs=2.0)
    silent, renderer = over(TEN[4], event=False)
    assert renderer.events == 0
    assert np.array_equal(silent.force, -silent.pull)


@pytest.mark.parametrize("name", ["step", "crown-shoulder"])
def test_the_wall_gives_no_energy_back_that_it_did_not_get(name):
    """Work of the hand on closed tours in all directions, seeded; a servo that holds its force over a tick leaks k ds^2 / 2."""
    generator = np.random.default_rng(11)
    renderer = MapRenderer(map_of(TEN[6] if name == "step" else MARGINS[name], R), CONDITION, event=False)
    for _ in range(4):
        corners = generator.uniform([-3e-4, -4e-5, 6e-5], [3e-4, 4e-5, 2.2e-4], (6, 3))
        tour = np.vstack([[0.0, 0.0, 4e-4], corners, [0.0, 0.0, 4e-4]])
        position = np.vstack([np.linspace(a, b, 1500, endpoint=False) for a, b in itertools.pairwise(tour)])
        renderer.reset(tour[0])
        work, leak, before = 0.0, 0.0, position[0]
        for here in position:
            move = here - before
            work -= float(renderer.force @ move)
            leak += 0.5 * renderer.stiffness * float(move @ move)
            renderer.tick(here, move * 1e4)
            before = here
        assert not renderer.force.any()
        assert work >= -leak
        assert work > 0.0


def test_over_missing_samples_the_hand_feels_nothing():
    z = np.zeros((80, 80))
    z[:, 40:] = np.nan
    renderer = MapRenderer(height_map(z, (10e-6, 10e-6), R), CONDITION)
    renderer.reset(np.array([7e-4, 4e-4, 1e-3]))
    assert not renderer.tick(np.array([7e-4, 4e-4, 0.0]), np.zeros(3)).any()
    renderer.reset(np.array([1e-4, 4e-4, 1e-3]))
    assert renderer.tick(np.array([1e-4, 4e-4, R - 1e-5]), np.zeros(3))[2] == pytest.approx(K * 1e-5, rel=1e-9)


def test_a_map_for_another_ball_is_refused():
    with pytest.raises(HapticsError, match="ball_radius of the map"):
        MapRenderer(map_of(TEN[0], 60e-6), CONDITION)


def test_ticks_allocate_nothing_and_are_short():
    """Counted by numba's own allocator; the median bears other work on the machine, benchmarks/renderer_ticks.py has the tail."""
    import time

    from numba.core.runtime import _nrt_python as allocator

    renderer = MapRenderer(map_of(TEN[4], R), CONDITION)
    start, counts = np.array([-2e-4, 0.0, R]), []
    for ticks in (10, 10, 1000):
        renderer.reset(np.array([-2e-4, 0.0, 3e-4]))
        allocator.memsys_enable_stats()
        before = allocator.memsys_get_stats_alloc()
        renderer.drag(start, (5e-7, 1e-7), 1.0, 0.0, ticks)
        counts.append(allocator.memsys_get_stats_alloc() - before)
        allocator.memsys_disable_stats()
    assert renderer.events == 1
    assert counts[2] == counts[1]
    position, velocity, times = np.array([-2e-4, 0.0, R - 1e-4]), np.zeros(3), []
    for x in np.linspace(-2e-4, 3e-4, 3000):
        position[0] = x
        begin = time.perf_counter_ns()
        renderer.tick(position, velocity)
        times.append(time.perf_counter_ns() - begin)
    assert np.median(times) < 5_000
