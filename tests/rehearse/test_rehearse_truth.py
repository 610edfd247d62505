"""The truth behind a simulated trial.

Equations (1) and (2) where nothing is planted, and each effect in its slot.
"""

import math

import numpy as np
import pytest

from stepblocks.errors import PipelineError
from stepblocks.rehearse.plan import SessionPlan, format_block_name
from stepblocks.rehearse.truth import (
    build_drag_inputs,
    build_rig,
    compute_planted_state,
    compute_truth_by_equations,
)

HEIGHT, LOAD, SPEED = 40e-6, 0.7, 4e-3
STILL = {"energy": 0.0, "friction": 0.0, "load": 0.0, "height": "0 um"}
MODEL = {
    "friction": 0.21,
    "conversion": 0.31,
    "tip_radius": "140 um",
    "spring_constant": "7.7 N/mm",
}
ROW = {
    "block": format_block_name(HEIGHT),
    "height_um": "40",
    "load_n": str(LOAD),
    "speed_mm_s": "4",
    "run_order": "6",
    "operator": "B",
}


def plan(*effects, **changes):
    fields = {
        "schema": 1,
        "seed": 1,
        "design": {"heights": ["40 um"], "loads": [f"{LOAD} N"], "speeds": ["4 mm/s"]},
        "scatter": STILL,
        "model": MODEL,
        "effects": list(effects),
    }
    return SessionPlan.model_validate(fields | changes)


def state(declared, height=HEIGHT, seed=1):
    return compute_planted_state(declared, ROW, {HEIGHT: height}, np.random.default_rng(seed))


def force(height=HEIGHT, load=LOAD, mu=0.21, radius=140e-6):
    """Equations (1) and (2) as the paper prints them."""
    a = math.acos((radius - height) / radius)
    return load * (math.sin(a) + mu * math.cos(a)) / (math.cos(a) - mu * math.sin(a))


def test_without_effects_and_scatter_a_trial_is_what_the_paper_says():
    declared = plan()
    truth = compute_truth_by_equations(declared, state(declared))
    assert truth.peak_force == pytest.approx(force(), rel=1e-9)
    assert truth.sliding_force == pytest.approx(0.21 * LOAD, rel=1e-9)
    assert truth.load == pytest.approx(LOAD, rel=1e-12)
    assert truth.slope == pytest.approx(7700.0 * SPEED, rel=1e-9)
    # origin: E_v = C_v F^2 / 2k, and A^2 / 2k is the energy of an amplitude A
    assert truth.amplitude == pytest.approx(math.sqrt(0.31) * force(), rel=1e-9)
    assert truth.gap == 0.0


def test_a_blocks_own_height_counts_and_not_its_nominal_one():
    declared = plan()
    truth = compute_truth_by_equations(declared, state(declared, height=41.5e-6))
    assert truth.peak_force == pytest.approx(force(height=41.5e-6), rel=1e-9)


# Origin: the slot put into equations (1) and (2).
@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ({"slot": "friction", "size": 0.05}, force(mu=0.26)),
        ({"slot": "contact_geometry", "size": 20e-6}, force(radius=160e-6)),
        ({"slot": "normal_load", "change": "multiply", "size": 0.1}, force(load=1.1 * LOAD)),
        ({"slot": "drag", "size": 0.03}, force() + 0.03),
        (
            {
                "slot": "friction",
                "form": "linear",
                "covariate": "run_order",
                "size": 0.02,
                "reference": 1,
                "span": 10,
            },
            force(mu=0.22),
        ),
        (
            {"slot": "friction", "form": "levels", "covariate": "operator", "levels": {"B": 0.04}},
            force(mu=0.25),
        ),
        ({"law": "edge_rounding", "parameters": {"edge_radius_m": 20e-6}}, force(radius=160e-6)),
    ],
)
def test_an_effect_changes_its_slot_and_the_peak_follows_the_equations(effect, expected):
    declared = plan(effect)
    assert compute_truth_by_equations(declared, state(declared)).peak_force == pytest.approx(
        expected, rel=1e-9
    )


def test_a_conversion_moves_the_ring_and_not_the_peak():
    declared = plan({"slot": "conversion", "change": "multiply", "size": 3.0})
    truth = compute_truth_by_equations(declared, state(declared))
    assert truth.peak_force == pytest.approx(force(), rel=1e-9)
    assert truth.amplitude == pytest.approx(math.sqrt(4.0 * 0.31) * force(), rel=1e-9)


def test_the_gauges_gain_is_no_part_of_the_truth():
    declared = plan({"slot": "sensor", "change": "multiply", "size": 0.5})
    found = state(declared)
    assert found.gain[0] == pytest.approx(1.5)
    assert compute_truth_by_equations(declared, found).peak_force == pytest.approx(
        force(), rel=1e-9
    )


def test_scatter_is_that_of_the_plan():
    declared = plan(scatter={"energy": 0.08, "friction": 0.01, "load": 0.02, "height": "0 um"})
    states = [state(declared, seed=seed) for seed in range(400)]
    spreads = [
        np.std([np.log(s.conversion[0]) for s in states]),
        np.std([s.friction[0] for s in states]),
        np.std([s.load[0] / LOAD for s in states]),
    ]
    # origin: a standard deviation of n numbers scatters by 1 / sqrt(2n); four sigma
    np.testing.assert_allclose(spreads, [0.08, 0.01, 0.02], rtol=4.0 / math.sqrt(800))


def test_a_trial_beyond_the_locking_height_gives_no_record():
    # origin: H > R (1 - sin(atan mu))
    locking = 140e-6 * (1.0 - math.sin(math.atan(0.21)))
    declared = plan()
    assert state(declared, height=1.001 * locking) is None
    assert state(declared, height=0.9 * locking) is not None


def test_a_tip_that_rubs_turns_with_twice_its_friction():
    declared = plan(model=MODEL | {"ring": "rubbing"})
    assert compute_truth_by_equations(declared, state(declared)).gap == pytest.approx(
        2.0 * 0.21 * LOAD, rel=1e-12
    )


def test_a_step_that_hardly_catches_gives_no_record():
    declared = plan()
    assert compute_truth_by_equations(declared, state(declared, height=1e-10)) is None


def test_the_rig_has_the_corner_of_the_slower_of_gauge_and_declaration():
    lag = {"law": "sensor_bandwidth", "parameters": {"time_constant_s": 1e-4}}
    slow = plan(lag)
    found = state(slow)
    # origin: a first-order gauge of time constant T has its corner at 1 / (2 pi T)
    assert build_rig(slow, found).bandwidth == pytest.approx(1.0 / (2.0 * math.pi * 1e-4))
    ideal = plan(rig={"drift_n_per_s": 0.2, "noise": "1 mN"})
    rig = build_rig(ideal, state(ideal))
    assert (rig.bandwidth, rig.drift, rig.noise) == (math.inf, 0.2, 1e-3)


def test_the_drag_in_time_gets_the_same_trial():
    declared = plan({"slot": "contact_geometry", "size": 15e-6}, {"slot": "drag", "size": 0.02})
    step, point, pull = build_drag_inputs(declared, state(declared))
    assert (step.height, step.edge_radius) == pytest.approx((HEIGHT, 15e-6), rel=1e-9)
    assert (point.ball_radius, point.normal_load, point.friction) == pytest.approx(
        (140e-6, LOAD, 0.21)
    )
    assert (point.speed, point.tool.stiffness, pull) == pytest.approx((SPEED, 7700.0, 0.02))
    assert point.tool.decay_time == pytest.approx(declared.model.decay_time)


def test_an_effect_without_a_place_in_the_drag_in_time_is_refused():
    declared = plan({"law": "block_tilt", "parameters": {"tilt_rad": 0.01}})
    tilted = state(declared)
    with pytest.raises(PipelineError, match="an effect changes tilt"):
        build_drag_inputs(declared, tilted)
