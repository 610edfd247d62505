"""What a damping test promises is what fits of simulated releases deliver."""

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from stepblocks.contact.operating_point import Tool
from stepblocks.errors import ContactError
from stepblocks.predict.sheaths import plan_decay_test

RING = {"stiffness": 9.1e3, "frequency": 283.0, "decay_time": 11.7e-3}
RIG = {"displacement": 0.13e-3, "noise": 0.9e-6, "sample_rate": 21.3e3, "wanted_uncertainty": 0.001}


def test_a_long_record_has_the_closed_bound_of_cramer_and_rao():
    test = plan_decay_test(Tool(**RING), **RIG)
    closed = math.sqrt(
        16.0
        * RIG["noise"] ** 2
        / (RIG["displacement"] ** 2 * RIG["sample_rate"] * RING["decay_time"] ** 3)
    )
    assert test["frequency_std_hz"] == pytest.approx(closed / math.tau, rel=0.01)
    assert test["log_decrement_std"] == pytest.approx(closed / RING["frequency"], rel=0.01)
    assert test["log_decrement"] == pytest.approx(1.0 / (RING["decay_time"] * RING["frequency"]))
    assert test["holding_force_n"] == pytest.approx(RIG["displacement"] * RING["stiffness"])


def test_least_squares_fits_of_simulated_releases_scatter_by_the_bound_and_not_more():
    test = plan_decay_test(Tool(**RING), **RIG)
    time = np.arange(test["samples"]) / RIG["sample_rate"]

    def ring(t, amplitude, phase, frequency, rate):
        return amplitude * np.exp(-rate * t) * np.cos(math.tau * frequency * t + phase)

    start = (1.0, 0.0, RING["frequency"], 1.0 / RING["decay_time"])
    clean, rng = ring(time, *start), np.random.default_rng(20)
    noise = RIG["noise"] / RIG["displacement"]
    found = np.array(
        [
            curve_fit(ring, time, clean + noise * rng.standard_normal(time.size), start)[0]
            for _ in range(400)
        ]
    )
    # the standard deviation of 400 values is known to 3.5 %
    assert found[:, 2].std() == pytest.approx(test["frequency_std_hz"], rel=0.12)
    assert (found[:, 3] / found[:, 2]).std() == pytest.approx(test["log_decrement_std"], rel=0.12)
    relative = test["log_decrement_std"] / test["log_decrement"]
    assert test["releases"] == math.ceil((relative / RIG["wanted_uncertainty"]) ** 2)
    assert test["releases"] > 1


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("sample_rate", 900.0, "at least four samples"),
        ("noise", 0.1e-3, "three times the noise"),
        ("wanted_uncertainty", 0.0, "positive"),
        ("wanted_uncertainty", 1e-9, "more than 10000"),
    ],
)
def test_an_impossible_test_is_refused(name, value, rule):
    with pytest.raises(ContactError, match=rule):
        plan_decay_test(Tool(**RING), **(RIG | {name: value}))


def test_as_many_periods_stand_above_noise_as_swings_of_the_envelope_do():
    # counted one by one: periods k whose amplitude d exp(-k / (f T)) is over three times the noise
    test = plan_decay_test(Tool(**RING), **RIG)
    swings = np.arange(1, 1000) / (RING["frequency"] * RING["decay_time"])
    above = RIG["displacement"] * np.exp(-swings) > 3.0 * RIG["noise"]
    assert test["periods_above_noise"] == above.sum() == 12


def test_a_release_just_over_three_times_the_noise_is_planned_and_one_just_below_is_not():
    least = 3.0 * RIG["noise"]
    rig = RIG | {"wanted_uncertainty": 0.5}
    assert plan_decay_test(Tool(**RING), **(rig | {"displacement": 1.05 * least}))["releases"] > 0
    with pytest.raises(ContactError, match="three times the noise"):
        plan_decay_test(Tool(**RING), **(rig | {"displacement": 0.95 * least}))
