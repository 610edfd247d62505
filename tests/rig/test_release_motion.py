"""What a release leaves to the ring: limits in closed form, and a bench that integrates it."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from oracles.virtual_bench import Bench, drag
from stepblocks.rig.effects.release_motion import compute_log_excess_and_ring_share


def test_a_fast_release_rings_with_more_than_a_slow_one_and_peaks_higher() -> None:
    speeds = np.array([0.01, 0.05, 0.3])
    same = np.ones(3)
    excess, share = compute_log_excess_and_ring_share(
        0.3 * same, 0.16 * same, 2.0 * same, speeds, 0.025 * same, 0.0 * same
    )
    assert np.all(np.diff(excess) > 0.0)
    assert np.all(np.diff(share) > 0.0)


def test_a_tip_moves_alone_as_it_does_among_others() -> None:
    # they are moved side by side, a few at a time, and each takes its own number of steps
    draw = np.random.default_rng(5)
    cases = (
        *(draw.uniform(0.02, 0.9, 21), draw.uniform(0.02, 0.4, 21), draw.uniform(0.3, 30.0, 21)),
        *(np.exp(draw.uniform(-6.0, 0.0, 21)), draw.uniform(0.01, 0.1, 21), np.zeros(21)),
    )
    together = np.array(compute_log_excess_and_ring_share(*cases))
    alone = [
        compute_log_excess_and_ring_share(*(column[[n]] for column in cases)) for n in range(21)
    ]
    assert np.allclose(together, np.squeeze(alone, axis=2).T, rtol=0.0, atol=1e-12)


def test_replicates_release_alike_in_whichever_order_they_stand() -> None:
    draw = np.random.default_rng(6)
    ends = [(0.02, 0.9), (0.02, 0.4), (0.3, 30.0), (0.01, 0.5), (0.01, 0.1), (0.0, 0.0)]
    settings = np.array([draw.uniform(low, high, 5) for low, high in ends])
    trials = draw.integers(0, 5, 40)
    of_settings = np.array(compute_log_excess_and_ring_share(*settings))
    of_trials = np.array(compute_log_excess_and_ring_share(*settings[:, trials]))
    assert np.allclose(of_trials, of_settings[:, trials], rtol=0.0, atol=1e-12)


def test_a_stiff_release_of_a_slow_handle_keeps_energy() -> None:
    # stored energy less the work of lifting and rubbing, quasi-static limit, soft spring (F R k / N
    # small): with k R / N = 0.4 and H / R = 0.4 the drop of the force over the climb is small
    # against the force itself
    height, friction, stiffness = 0.4, 0.1, 0.4
    angle = math.acos(1.0 - height)
    force = math.tan(angle + math.atan(friction))
    reach = math.sin(angle)
    x = np.linspace(0.0, reach, 200001)
    resist = np.tan(np.arcsin(reach - x) + math.atan(friction))
    pull = force - stiffness * x
    # on the upper face the spring rings about the sliding friction
    kinetic = float(np.trapezoid(pull - resist, x))
    potential = (pull[-1] - friction) ** 2 / (2.0 * stiffness)
    expected = 2.0 * stiffness * (kinetic + potential) / force**2
    _, share = compute_log_excess_and_ring_share(
        *(np.array([v]) for v in (height, friction, stiffness, 0.006, 0.0, 0.0))
    )
    assert math.exp(float(share[0])) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("height", "load", "speed", "bent"),
    [
        *[
            (10e-6, 0.5, 2e-3, 0.0),
            (20e-6, 0.3, 20e-3, 0.0),
            (40e-6, 0.3, 5e-3, 0.0),
            (50e-6, 0.3, 2e-3, 0.0),
        ],
        *[
            (30e-6, 0.8, 10e-3, 0.0),
            (70e-6, 0.5, 20e-3, 0.0),
            (80e-6, 0.3, 2e-3, 0.0),
            (80e-6, 1.1, 20e-3, 0.0),
        ],
        *[
            (60e-6, 1.1, 5e-3, 0.0),
            (60e-6, 1.1, 5e-3, 1.5e7),
            (80e-6, 0.8, 20e-3, 1.5e7),
            (50e-6, 0.5, 5e-3, 3e7),
        ],
    ],
)
def test_a_release_rings_as_that_of_the_bench_which_integrates_it(
    height: float, load: float, speed: float, bent: float
) -> None:
    # origin: tests/oracles/virtual_bench.py, along the path of the tip at 200 kHz; snaps, flights,
    # a climb down; F = k (x + bent x^3)
    bench = Bench(hardening=9810.0 * bent)
    done = drag(bench, height, load, speed, np.random.default_rng(0))
    assert done is not None
    radius = bench.tip_radius + bench.edge_radius
    momentum = bench.stiffness / (2.0 * math.pi * bench.frequency)
    asked = (
        height / radius,
        bench.friction,
        bench.stiffness * radius / load,
        speed * momentum / load,
    )
    cubic = bent * (load / bench.stiffness) ** 2
    excess, share = compute_log_excess_and_ring_share(
        *(np.array([v]) for v in (*asked, bench.damping_ratio, cubic))
    )
    angle = math.acos(1.0 - height / radius) + math.atan(bench.friction)
    # the damper pulls along while the tip is held
    start = load * math.tan(angle) - 2.0 * bench.damping_ratio * momentum * speed
    assert math.exp(excess[0]) * start == pytest.approx(done[3]["peak_n"], rel=1e-3)
    # energy of the first swing about the force of sliding, in closed form from how far down the
    # integrated force went
    forces = np.array([done[3]["level_n"], done[3]["trough_n"]]) / bench.stiffness
    level, low = (brentq(lambda x, f=f: x + bent * x**3 - f, -1e-3, 1e-3) for f in forces)
    swing = (
        0.5 * (low**2 - level**2) + 0.25 * bent * (low**4 - level**4) - forces[0] * (low - level)
    )
    rung = bench.stiffness * swing * math.exp(2.0 * math.pi * bench.damping_ratio)
    assert share[0] == pytest.approx(math.log(rung / done[3]["stored_j"]), abs=0.03)
