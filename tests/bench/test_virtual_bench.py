"""The bench of the tests: it is another bench than the program's.

And it does what mechanics says.
"""

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oracles import virtual_bench, virtual_session
from oracles.virtual_bench import Bench, drag
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session

SILENT = Bench(noise=0.0, hum=0.0, quantum=0.0)


def made(bench=SILENT, height=40e-6, load=0.8, speed=5e-3, seed=3):
    return drag(bench, height, load, speed, np.random.default_rng(seed))


def test_it_shares_no_line_with_what_it_tests():
    trees = [
        ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
        for module in (virtual_bench, virtual_session)
    ]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
    assert not [name for name in names if name.split(".")[0] == "stepblocks"]


@pytest.mark.parametrize("edge", [1.0, 1.3])
@pytest.mark.parametrize("hardening", [0.0, 9810.0 * 1.5e7])
def test_the_tip_leaves_at_the_force_that_lifts_it_over_the_edge(edge, hardening):
    truth = made(replace(SILENT, edge_friction_ratio=edge, hardening=hardening))[3]
    # origin: equilibrium of weight, pull and friction on a face at the critical angle; the damper
    # pulls along with c v
    angle = math.acos(1.0 - 40e-6 / 125.3e-6) + math.atan(0.15 * edge)
    damper = 2.0 * 0.025 * 9810.0 / (2.0 * math.pi * 300.0) * 5e-3
    assert truth["left_n"] + damper == pytest.approx(0.8 * math.tan(angle), rel=1e-3)
    # a heavy tip leaves slowly, so that the pull still grows a little
    assert 1.0 < truth["peak_n"] / truth["left_n"] < 1.04


def test_the_ramp_has_the_stiffness_of_the_spring_and_a_hard_spring_bends_it():
    time, force, _, truth = made()
    ramp = (force > 0.3) & (force < 1.0) & (time < truth["release_s"])
    assert np.polyfit(time[ramp], force[ramp], 1)[0] == pytest.approx(9810.0 * 5e-3, rel=1e-6)
    time, force, _, truth = made(replace(SILENT, hardening=9810.0 * 1.5e7))
    ramp = (force > 0.3) & (force < 1.0) & (time < truth["release_s"])
    stretch = 5e-3 * (time[ramp] - time[ramp][0])
    start = next(
        r.real
        for r in np.roots([9810.0 * 1.5e7, 0.0, 9810.0, -force[ramp][0]])
        if abs(r.imag) < 1e-12
    )
    np.testing.assert_allclose(
        force[ramp], 9810.0 * ((start + stretch) + 1.5e7 * (start + stretch) ** 3), rtol=1e-6
    )


def test_a_tip_that_only_slides_forward_rings_with_the_tool_s_own_frequency_and_decay():
    time, force, _, truth = made(height=20e-6, load=0.3, speed=20e-3)
    since = time - truth["release_s"]
    late = since > 12e-3
    swing = (force[late] - truth["level_n"]) * np.exp(since[late] * 0.025 * 2.0 * math.pi * 300.0)
    basis = 2.0 * math.pi * 300.0 * math.sqrt(1.0 - 0.025**2) * since[late]
    columns = np.column_stack([np.cos(basis), np.sin(basis)])
    left = swing - columns @ np.linalg.lstsq(columns, swing, rcond=None)[0]
    assert np.std(left) < 0.03 * np.std(swing)


def test_no_release_gives_more_than_was_stored():
    for height in (10e-6, 40e-6, 80e-6):
        for load in (0.3, 1.1):
            assert 0.0 <= made(height=height, load=load)[3]["conversion"] < 1.0


def test_gauges_show_their_zeros_unloaded_and_their_gains_and_cross_talk_under_load():
    odd = replace(
        SILENT, tangential_zero=-18e-3, normal_zero=25e-3, normal_gain=0.96, unloaded=30e-3
    )
    time, force, normal, _ = made(odd)
    still = time < 30e-3
    np.testing.assert_allclose(force[still], -18e-3)
    np.testing.assert_allclose(normal[still], 25e-3)
    assert normal[500] == pytest.approx(0.96 * 0.8 + 25e-3)
    crossed = made(replace(SILENT, normal_in_tangential=0.025))[1]
    np.testing.assert_allclose(crossed[:300] - made()[1][:300], 0.025 * 0.8, rtol=1e-6)


def test_static_friction_makes_the_tip_stick_and_slip_before_the_edge():
    truth = made(replace(SILENT, static_ratio=2.0), height=20e-6, load=1.1, speed=3e-3)[3]
    assert truth["regime"] == "stick-slip"
    assert made(height=80e-6, load=0.5)[3]["regime"] == "flight"
    assert made(height=30e-6, load=0.3, speed=2e-3)[3]["regime"] == "climb-down"
    assert made(height=20e-6, load=1.1, speed=10e-3)[3]["regime"] == "rubbing"
    assert made(height=10e-6, load=0.3, speed=10e-3)[3]["regime"] == "snap"


@pytest.mark.long
def test_a_session_is_one_that_the_program_reads_and_the_same_seed_gives_the_same(tmp_path):
    plan = Plan(Bench(conversion=0.2), trials=24, operator_load={"B": 0.07})
    told = write_session(tmp_path / "a", plan, 5)
    assert told == write_session(tmp_path / "b", plan, 5)
    table = measure_session(tmp_path / "a", jobs=1)
    assert (table.status == "ok").sum() >= 20
    assert set(table.operator) == {"A", "B"}
    good = table[table.status == "ok"]
    true = {str(row["trial"]): row["peak_n"] for row in told}
    # a ramp of 200 N/s climbs 20 mN from sample to sample; 3 mN of noise are 1.6 % of the least
    np.testing.assert_allclose(good.peak_force_n, [true[name] for name in good.trial], rtol=0.016)


def test_a_deleted_operator_leaves_no_column(tmp_path):
    write_session(
        tmp_path / "s", Plan(Bench(conversion=0.2), trials=4, hide_operator=True, scans=False), 5
    )
    assert "operator" not in (tmp_path / "s" / "trials.csv").read_text().splitlines()[0]
    assert not (tmp_path / "s" / "scans").exists()


@pytest.mark.long
def test_what_a_gauge_could_not_show_is_a_bound_without_an_uncertainty_and_the_rest_of_it_stands(
    tmp_path,
):
    plan = Plan(Bench(limit=0.9), trials=24, scans=False, loads=(0.5, 0.8), speeds=(2e-3, 10e-3))
    true = np.array([row["peak_n"] for row in write_session(tmp_path / "s", plan, 5)])
    table = measure_session(tmp_path / "s", jobs=1)
    beyond = (table.status == "censored").to_numpy()
    np.testing.assert_array_equal(beyond, true > 0.9)
    assert 5 < beyond.sum() < 20
    # the loop takes such a peak for what the true one exceeds
    np.testing.assert_allclose(table.peak_force_n[beyond], 0.9)
    assert table[["peak_force_std_n", "vibration_energy_j"]][beyond].isna().all(axis=None)
    assert table.sliding_friction[beyond].between(0.13, 0.17).all()
