"""The vibration as an event: what equations (1) and (2) say of both drags, and the ring that
carries exactly that energy.
"""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    LearnedPrediction,
    Waveform,
    build_event_record,
    compute_ring_energy,
    compute_ring_force,
    list_vibration_events,
)
from stepblocks.contact.operating_point import OperatingPoint, Tool

# nothing is 1 here, and nothing is the paper's
TOOL = Tool(stiffness=7.3e3, conversion=0.31, frequency=270.0, decay_time=11e-3)
POINT = OperatingPoint(140e-6, 0.7, 0.23, TOOL)
R, MU, LOAD = 140e-6, 0.23, 0.7


def paper_force(angle, load=LOAD, friction=MU):
    """Equation (1) as printed: a fraction of sines and cosines."""
    a = angle
    return load * (math.sin(a) + friction * math.cos(a)) / (math.cos(a) - friction * math.sin(a))


@pytest.mark.parametrize("height", [5e-6, 40e-6, 90e-6])
def test_force_and_energy_are_those_of_the_paper(height):
    up, down = list_vibration_events(Step(height), POINT, "block")
    force = paper_force(math.acos((R - height) / R))
    assert up.critical_force == pytest.approx(force, rel=1e-9)
    assert up.energy == pytest.approx(0.31 * 0.5 * force**2 / 7.3e3, rel=1e-9)
    assert up.amplitude == pytest.approx(math.sqrt(0.31) * force, rel=1e-9)
    assert (up.stimulus, up.drag, up.status, down.drag, down.status) == (
        "block",
        "+x",
        Status.RELEASES,
        "-x",
        Status.NO_CATCH,
    )


def test_the_trigger_is_where_the_ball_rests_on_the_lower_face_against_the_edge():
    # (R - H)^2 + x^2 = R^2
    up, _ = list_vibration_events(Step(40e-6), POINT)
    assert up.trigger_position == pytest.approx(-math.sqrt(2 * R * 40e-6 - 40e-6**2), rel=1e-9)
    assert up.trigger_height == pytest.approx(R, rel=1e-12)


def test_a_rounded_edge_is_met_by_the_larger_circle():
    up, _ = list_vibration_events(Step(40e-6, 25e-6), POINT)
    assert up.critical_angle == pytest.approx(math.acos(1 - 40e-6 / (R + 25e-6)), rel=1e-9)


def test_a_groove_between_equal_shoulders_rings_alike_in_both_directions():
    up, down = list_vibration_events(Margin(gap=60e-6, opening=60e-6, rise=0.0), POINT)
    assert up.critical_angle == pytest.approx(math.asin(60e-6 / (2 * R)), rel=1e-6)
    assert down.energy == pytest.approx(up.energy, rel=1e-9)
    assert (up.direction, down.direction) == (1, -1)
    # both: the ball hangs in the middle
    assert up.trigger_position + down.trigger_position == pytest.approx(60e-6, rel=1e-6)


def test_a_mirrored_profile_swaps_the_drags():
    x, z = np.array([-1e-3, 0.0, 0.0, 1e-3]), np.array([0.0, 0.0, 30e-6, 30e-6])
    up, _ = list_vibration_events(Profile(x, z), POINT)
    _, back = list_vibration_events(Profile(-x[::-1], z[::-1]), POINT)
    assert (back.energy, back.trigger_position) == pytest.approx((up.energy, -up.trigger_position))


def test_the_energy_grows_with_the_square_of_the_load_and_falls_with_the_spring():
    event = list_vibration_events(Step(40e-6), POINT)[0]
    twice = list_vibration_events(Step(40e-6), replace(POINT, normal_load=1.4))[0]
    stiff = list_vibration_events(
        Step(40e-6), replace(POINT, tool=replace(TOOL, stiffness=2 * 7.3e3))
    )[0]
    assert twice.energy == pytest.approx(4.0 * event.energy)
    assert stiff.energy == pytest.approx(0.5 * event.energy)
    assert stiff.critical_force == event.critical_force


def test_a_locked_probe_has_no_ring_and_its_record_is_json_all_the_same():
    # locking height of this ball and friction: 140 (1 - sin(atan 0.23)) = 108.6 um
    locked = list_vibration_events(Step(112e-6), POINT)[0]
    assert locked.status is Status.LOCKED
    assert math.isnan(locked.energy)
    record = json.loads(json.dumps(build_event_record(locked), allow_nan=False))
    assert [
        record[name]
        for name in ("critical_force_n", "energy_j", "amplitude_n", "amplitude_m_per_s2")
    ] == [None] * 4
    assert record["critical_angle_deg"] == pytest.approx(math.degrees(math.acos(1 - 112e-6 / R)))


@pytest.mark.parametrize("rate", [4e3, 10e3, 48e3, 96e3])
def test_the_ring_carries_the_energy_of_the_event_at_any_rate(rate):
    event = list_vibration_events(Step(40e-6), POINT)[0]
    assert compute_ring_energy(compute_ring_force(event, rate), rate, TOOL) == pytest.approx(
        event.energy, rel=0.01
    )


def test_the_energy_rule_is_the_integral_of_a_decaying_sine():
    # integral of A^2 exp(-2t/T) sin^2(wt) = A^2 T/4 (wT)^2 / (1 + (wT)^2), with A^2 = 2 k E
    amplitude, phase = 2.7, math.tau * TOOL.frequency * TOOL.decay_time
    time = np.arange(0.0, 12 * TOOL.decay_time, 1e-6)
    force = amplitude * np.exp(-time / TOOL.decay_time) * np.sin(math.tau * TOOL.frequency * time)
    square = amplitude**2 * TOOL.decay_time / 4.0 * phase**2 / (1.0 + phase**2)
    assert np.sum(force**2) * 1e-6 == pytest.approx(square, rel=1e-6)
    assert compute_ring_energy(force, 1e6, TOOL) == pytest.approx(
        amplitude**2 / (2.0 * TOOL.stiffness), rel=1e-6
    )


def test_the_ring_starts_at_rest_and_swings_first_along_the_drag():
    samples = compute_ring_force(list_vibration_events(Step(40e-6), POINT)[0], 48e3)
    half = round(48e3 / 270 / 2)
    assert samples[0] == 0.0
    assert (samples[1:half] > 0.0).all()
    assert abs(samples[-1]) < 1e-3 * samples.max()


def test_a_simulated_waveform_stands_for_the_exponential():
    force = np.sin(np.linspace(0.0, 30.0, 961)) * 1.5
    event = replace(
        list_vibration_events(Step(40e-6), POINT)[0],
        waveform=Waveform(force, 96e3, 1e-4, 3.0, 2e-5, 0.8),
    )
    assert compute_ring_force(event, 96e3) == pytest.approx(force)
    assert compute_ring_force(event, 48e3) == pytest.approx(force[::2])
    record = build_event_record(event)
    assert (
        record["simulated_peak_force_n"],
        record["simulated_energy_j"],
        record["simulated_factor"],
    ) == (
        3.0,
        2e-5,
        0.8,
    )
    assert "time-domain drag" in record["waveform"]


def test_what_was_learnt_stands_beside_with_its_interval():
    told = LearnedPrediction("ok", (1.0, 0.9, 1.1), (2e-6, 1e-6, math.inf))
    record = build_event_record(
        replace(list_vibration_events(Step(40e-6), POINT)[0], learned=told)
    )["learned"]
    assert record == {
        "status": "ok",
        "peak_force_n": 1.0,
        "peak_force_low_n": 0.9,
        "peak_force_high_n": 1.1,
        "energy_j": 2e-6,
        "energy_low_j": 1e-6,
        "energy_high_j": None,
    }


def test_a_scene_moves_the_trigger_and_nothing_that_is_felt():
    one, five = (
        build_event_record(list_vibration_events(Step(40e-6), POINT)[0], scale)
        for scale in (1.0, 5.0)
    )
    moved = {name for name in one if one[name] != five[name]}
    assert moved == {"trigger_position_m", "trigger_height_m", "scale"}
    assert five["trigger_position_m"] == pytest.approx(5.0 * one["trigger_position_m"])


def test_the_band_of_a_frequency_reaches_as_far_below_it_as_above():
    tool = replace(TOOL, frequency_deviation=12.0)
    record = build_event_record(list_vibration_events(Step(40e-6), replace(POINT, tool=tool))[0])
    assert (record["frequency_low_hz"], record["frequency_high_hz"]) == (258.0, 282.0)
