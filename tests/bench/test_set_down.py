"""A record as a laboratory starts it: unloaded, set down, at rest; then the drag itself."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from oracles.virtual_bench import Bench, drag
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.features import measure_trace
from stepblocks.bench.signal.set_down import find_set_down_and_zeros

RATE, K = 10e3, 9810.0
TIME, FORCE, NORMAL, _ = drag(Bench(conversion=0.2), 40e-6, 0.5, 5e-3, np.random.default_rng(1))
ALONE = measure_trace(Trace(TIME, FORCE, NORMAL), K, 5e-3).features


def started(unloaded, coming, still, noise=2e-3, zero=(0.0, 0.0)):
    """Put an unloaded part, a smooth set-down and a standstill before a drag; times in s."""
    random = np.random.default_rng(5)
    counts = [round(one * RATE) for one in (unloaded, coming, still)]
    ramp = 0.5 * (1.0 - np.cos(np.pi * np.arange(counts[1]) / max(counts[1], 1)))
    load = np.concatenate([np.zeros(counts[0]), 0.5 * ramp, np.full(counts[2], 0.5)])
    # a handle that starts pulls the tip up to the sliding force at the slope of the ramp
    pull = np.linspace(0.0, float(np.median(FORCE[:200])), round(0.075 / (K * 5e-3) * RATE))
    normal = np.concatenate([load, np.full(pull.size, 0.5)])
    force = np.concatenate([np.zeros(load.size), pull])
    normal, force = (one + noise * random.standard_normal(one.size) for one in (normal, force))
    normal, force = np.append(normal, NORMAL) + zero[1], np.append(force, FORCE) + zero[0]
    return Trace(np.arange(force.size) / RATE, force, normal), load.size


@settings(max_examples=12, deadline=None)
@given(st.floats(0.05, 0.3), st.floats(0.005, 0.04), st.floats(0.02, 0.2))
def test_friction_and_peak_are_those_without_the_start(unloaded, coming, still):
    trace, size = started(unloaded, coming, still)
    set_down = find_set_down_and_zeros(trace)
    assert abs(set_down.first - size) < 0.012 * RATE
    assert set_down.tangential_zero.value == pytest.approx(0.0, abs=1e-3)
    assert set_down.normal_zero.value == pytest.approx(0.0, abs=1e-3)
    found = measure_trace(trace, K, 5e-3).features
    for name in ("sliding_friction", "peak_force_n", "spring_constant_n_per_m"):
        assert found[name] == pytest.approx(ALONE[name], rel=0.02)
    assert found["vibration_energy_j"] == pytest.approx(ALONE["vibration_energy_j"], rel=0.05)


@settings(max_examples=10, deadline=None)
@given(st.floats(-0.02, 0.02), st.floats(-0.05, 0.05))
def test_the_zeros_of_both_gauges_are_those_of_the_unloaded_part(tangential, normal):
    set_down = find_set_down_and_zeros(started(0.1, 0.03, 0.08, zero=(tangential, normal))[0])
    assert set_down.tangential_zero.value == pytest.approx(tangential, abs=1e-3)
    assert set_down.normal_zero.value == pytest.approx(normal, abs=1e-3)


def test_a_record_that_begins_while_the_tip_slides_is_used_whole():
    set_down = find_set_down_and_zeros(Trace(TIME, FORCE, NORMAL))
    assert set_down.first == 0
    assert np.isnan([set_down.tangential_zero, set_down.normal_zero]).all()


def test_a_handle_that_stands_still_under_load_is_found_without_an_unloaded_part():
    trace, size = started(0.0, 0.0, 0.08)
    set_down = find_set_down_and_zeros(trace)
    assert abs(set_down.first - size) < 0.012 * RATE
    assert np.isnan([set_down.tangential_zero, set_down.normal_zero]).all()


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_sliding_begins_where_the_five_samples_about_it_slide_whatever_spring_pulls(bend):
    # 400 samples at rest, 20 of a climb to 0.1 N, sliding, and a ramp whose time is the parabola
    # s - bend s^2 of the share s of its rise; without noise the corner is known to the sample
    share = np.linspace(0.0, 1.0, 4001)
    late = (share - bend * share**2) / (1.0 - bend)
    ramp = 0.1 + 0.9 * np.interp(np.arange(1, 501) / 500.0, late, share)
    climb = np.linspace(0.0, 0.1, 20, endpoint=False)
    force = np.concatenate([np.zeros(400), climb, np.full(300, 0.1), ramp, np.zeros(50)])
    time = np.arange(force.size) / RATE
    set_down = find_set_down_and_zeros(Trace(time, force, np.full(force.size, 0.5)))
    assert set_down.first == 420 + 2
