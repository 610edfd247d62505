"""Records of known truth: the rig adds what it says.

And the course is the closed form of an independent oracle.
"""

import math

import numpy as np
import pytest

from oracles.traces import Course
from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.rehearse.record import Rig, Truth, record_trial_by_drag, record_trial_by_equations

TRUTH = Truth(0.8, 0.12, 98.1, 1.2, 0.53, 287.0, 17e-3)
IDEAL = Rig(noise=0.0, quantum=0.0, hum=0.0)


def made(rig=IDEAL, truth=TRUTH, seed=5, gain=1.0):
    return record_trial_by_equations(truth, rig, np.random.default_rng(seed), gain)


def test_an_ideal_rig_writes_the_closed_form():
    trace, onset, release = made()
    course = Course(onset=onset)
    assert course.release == pytest.approx(release, abs=1e-12)
    np.testing.assert_allclose(trace.tangential, course.force(trace.time), atol=1e-9)


def test_the_normal_force_is_the_load_until_the_slip_and_rings_along_after_it():
    trace, _, release = made()
    before = trace.time < release
    np.testing.assert_allclose(trace.normal[before], 0.8, rtol=1e-12)
    ring = Course(onset=0.0, amplitude=0.25 * 0.53, phase=0.25 * np.pi).ring(
        trace.time - release + Course(onset=0).release
    )
    np.testing.assert_allclose(trace.normal - 0.8, ring, atol=1e-9)


def test_the_record_ends_five_decay_times_after_the_slip():
    trace, _, release = made()
    assert trace.time[-1] - release == pytest.approx(5.0 * 17e-3, abs=2e-4)
    np.testing.assert_allclose(np.diff(trace.time), 1e-4, rtol=1e-6)


def test_noise_hum_and_drift_are_as_large_as_declared():
    rig = Rig(noise=2e-3, quantum=0.0, hum=9e-3, mains=60.0, drift=0.4)
    disturbed, onset, _ = made(rig)
    added = disturbed.tangential - Course(onset=onset).force(disturbed.time)
    phase = 2.0 * np.pi * 60.0 * disturbed.time
    columns = np.column_stack([disturbed.time, np.cos(phase), np.sin(phase)])
    (drift, cosine, sine), *_ = np.linalg.lstsq(columns, added, rcond=None)
    assert drift == pytest.approx(0.4, abs=5e-3)
    assert np.hypot(cosine, sine) == pytest.approx(9e-3, rel=0.05)
    assert np.std(added - columns @ [drift, cosine, sine]) == pytest.approx(2e-3, rel=0.1)


def test_a_converter_writes_whole_steps_and_is_never_off_by_more_than_half_a_one():
    coarse, fine = made(Rig(noise=0.0, hum=0.0, quantum=7e-3))[0], made()[0]
    steps = coarse.tangential / 7e-3
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(coarse.tangential - fine.tangential).max() <= 3.5e-3 + 1e-12


def test_a_gauge_of_first_order_is_late_by_its_time_constant_on_a_ramp():
    corner = 800.0
    slow, onset, release = made(Rig(noise=0.0, hum=0.0, quantum=0.0, bandwidth=corner))
    lag = 1.0 / (2.0 * math.pi * corner)
    # origin: behind a ramp s (t - t0) a first-order filter follows with s T
    settled = (slow.time > onset + 10.0 * lag) & (slow.time < release - 1e-4)
    expected = Course(onset=onset).force(slow.time) - 98.1 * lag
    np.testing.assert_allclose(slow.tangential[settled], expected[settled], atol=2e-3)


def test_the_ring_of_the_start_dies_before_the_edge_and_is_there_only_if_asked_for():
    with_ring, onset, _ = made(Rig(noise=0.0, hum=0.0, quantum=0.0, start_up=60e-3))
    extra = with_ring.tangential - Course(onset=onset).force(with_ring.time)
    envelope = 60e-3 * np.exp(-with_ring.time / 17e-3)
    assert np.all(np.abs(extra) <= envelope + 1e-9)
    assert np.abs(extra[:60]).max() > 40e-3
    np.testing.assert_allclose(extra[with_ring.time >= onset], 0.0, atol=1e-9)


def test_a_gain_belongs_to_the_tangential_gauge_alone():
    plain, gained = made()[0], made(gain=1.5)[0]
    np.testing.assert_allclose(gained.tangential, 1.5 * plain.tangential, rtol=1e-12)
    np.testing.assert_allclose(gained.normal, plain.normal, rtol=1e-12)


def test_a_tip_that_rubs_loses_its_gap_every_half_cycle():
    truth = Truth(0.8, 0.12, 20.0, 1.2, 1.08, 287.0, 1e3, gap=0.1)
    trace, _, release = made(Rig(noise=0.0, hum=0.0, quantum=0.0, tail=2e-5), truth)
    since = trace.time - release
    lows = [
        trace.tangential[(since > n / 287.0) & (since < (n + 1) / 287.0)].min() for n in range(3)
    ]
    # origin: undamped, each half cycle costs the gap
    np.testing.assert_allclose(np.diff(lows), 0.2, atol=5e-3)


POINT = OperatingPoint(125e-6, 0.8, 0.15, Tool(decay_time=21e-3), 2e-3)


def test_a_drag_in_time_pulls_as_much_as_equation_1():
    trial = record_trial_by_drag(Step(40e-6), POINT, IDEAL, np.random.default_rng(1))
    angle = math.acos(1.0 - 40.0 / 125.0)
    # origin: equation (1); the elastic contact and the speed take a little from it
    assert trial.peak_force == pytest.approx(0.8 * math.tan(angle + math.atan(0.15)), rel=0.02)
    assert trial.trace.tangential.max() == pytest.approx(trial.peak_force, rel=1e-3)
    assert 0.0 < trial.amplitude < trial.peak_force


def test_a_tip_that_is_held_gives_no_record():
    # origin: the locking height is R (1 - sin(atan mu)), 53 um at mu 0.7
    sticky = OperatingPoint(125e-6, 0.8, 0.7, Tool(decay_time=21e-3), 10e-3)
    assert record_trial_by_drag(Step(110e-6), sticky, IDEAL, np.random.default_rng(1)) is None


def test_a_steady_pull_lifts_the_whole_record():
    plain = record_trial_by_drag(Step(40e-6), POINT, IDEAL, np.random.default_rng(1))
    pulled = record_trial_by_drag(
        Step(40e-6), POINT, IDEAL, np.random.default_rng(1), added_pull=0.05
    )
    np.testing.assert_allclose(pulled.trace.tangential - plain.trace.tangential, 0.05, atol=1e-12)
    assert pulled.peak_force == pytest.approx(plain.peak_force + 0.05, rel=1e-12)
