"""The drag in time fitted to traces of another bench.

It finds what that bench was, and says where it was another.
"""

import numpy as np
import pandas as pd
import pytest

from oracles.virtual_bench import Bench, drag
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.features import FEATURE_COLUMNS, measure_trace
from stepblocks.bench.waveform import WAVEFORM_COLUMNS, fit_waveform, predict_energies
from stepblocks.contact.operating_point import PAPER

K, TOOL = 9810.0, (300.0, 1.0 / (0.025 * 2.0 * np.pi * 300.0))


def fitted(bench, height, load, speed, seed=1):
    time, force, normal, truth = drag(bench, height, load, speed, np.random.default_rng(seed))
    trace = Trace(time, force, normal)
    measured = measure_trace(trace, K, speed, TOOL)
    return fit_waveform(trace, measured, height, 125e-6, PAPER.tool), truth


@pytest.mark.parametrize("condition", [(50e-6, 0.8, 2e-3), (30e-6, 0.5, 20e-3), (40e-6, 0.3, 5e-3)])
def test_mass_damping_friction_and_radius_of_another_bench_come_back_from_its_waveform(condition):
    found, truth = fitted(Bench(), *condition)
    friction, stiffness, frequency, damping, radius, _ = found.values
    # origin: the constants that bench integrates with; a contact that gives and one that does not
    # differ by some percent
    assert friction == pytest.approx(0.15, rel=0.03)
    assert stiffness == pytest.approx(K, rel=0.03)
    assert frequency == pytest.approx(300.0, rel=0.02)
    assert damping == pytest.approx(0.025, abs=0.006)
    assert radius == pytest.approx(125.3e-6, rel=0.03)
    assert found.energy[0] == pytest.approx(truth["vibration_energy_j"], rel=0.04)
    assert found.misfit < 1.3


def test_a_record_that_no_drag_of_this_kind_draws_is_said_to_be_none():
    # the ring of a bell, which no friction takes anything from: the predictive check must refuse it
    found, _ = fitted(Bench(conversion=0.2), 40e-6, 0.8, 5e-3)
    assert found is None or found.p < 0.01
    good, _ = fitted(Bench(), 40e-6, 0.3, 5e-3)
    assert good.p > 0.01
    assert good.misfit < 1.3


def test_one_drag_foretells_the_rings_of_trials_it_was_not_fitted_to(tmp_path):
    write_session(
        tmp_path / "s",
        Plan(trials=24, heights=(20e-6, 30e-6, 40e-6), loads=(0.5, 0.8), scans=False),
        3,
    )
    plain = measure(tmp_path / "s", jobs=1)
    table = measure(tmp_path / "s", jobs=1, waveform=True)
    assert tuple(table.columns[-len(WAVEFORM_COLUMNS) :]) == WAVEFORM_COLUMNS
    pd.testing.assert_frame_equal(table[list(FEATURE_COLUMNS)], plain[list(FEATURE_COLUMNS)])
    said = predict_energies(table, K)
    assert said["fitted"] >= 20
    assert said["ln_energy_error_of_drag"] < 0.15
    # C_v is no constant where the motion decides what rings
    assert said["ln_energy_error_of_equation_1"] > 2.0 * said["ln_energy_error_of_drag"]
