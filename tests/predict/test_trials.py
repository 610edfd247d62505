"""Trials that were not measured: equations (1) and (2), with uncertainty and limits."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from oracles.learned import CONSTANTS, make_learned_model
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.errors import PipelineError
from stepblocks.predict.learned import predict_trials
from stepblocks.rig.effects.grammar.compose import list_composed_laws

_NUMBERS = ["peak_force_n", "vibration_energy_j"]


def _table(**columns):
    rows = {
        "block": "step-050",
        "height_um": 50.0,
        "load_n": 0.8,
        "speed_mm_s": 5.0,
        "tip": "tip-110",
    } | columns
    count = (
        max(len(column) for column in rows.values() if isinstance(column, list)) if columns else 1
    )
    return pd.DataFrame({"trial": [f"t{i + 1}" for i in range(count)]} | rows)


def test_without_effects_a_trial_is_equations_one_and_two():
    table = _table(load_n=[0.3, 0.8, 1.1], tip=["tip-110", "tip-125", "blue"])
    found = predict_trials(table, make_learned_model())
    # a name without a number has the probe's
    for row, radius in zip(range(3), (110e-6, 125e-6, 120e-6), strict=True):
        one = find_release(
            find_step_angle(50e-6, radius), float(table["load_n"][row]), CONSTANTS["friction"]
        )
        assert found["peak_force_n"][row] == pytest.approx(one.pull_force, rel=1e-12)
        energy = 0.23 * one.pull_force**2 / 2.0 / (1.05 * 9500.0)
        assert found["vibration_energy_j"][row] == pytest.approx(energy, rel=1e-12, abs=0.0)
    assert list(found["status"]) == ["ok"] * 3


def test_certain_constants_and_trials_without_scatter_leave_no_interval():
    found = predict_trials(_table(), make_learned_model()).iloc[0]
    assert found["peak_force_low_n"] == found["peak_force_n"] == found["peak_force_high_n"]


def test_scatter_of_single_trials_alone_is_a_factor_either_way():
    found = predict_trials(_table(), make_learned_model(scatter=0.05)).iloc[0]
    # origin: 1.96 standard deviations of 5 % on a logarithm
    assert found["vibration_energy_high_j"] / found["vibration_energy_j"] == pytest.approx(
        math.exp(0.098), rel=1e-4
    )
    assert found["vibration_energy_j"] / found["vibration_energy_low_j"] == pytest.approx(
        math.exp(0.098), rel=1e-4
    )


def test_doubt_about_a_constant_widens_by_its_derivative():
    found = predict_trials(_table(), make_learned_model(std=1e-4)).iloc[0]
    angle = find_step_angle(50e-6, 110e-6) + math.atan(0.17)
    # d ln tan(a + atan mu) / d mu
    slope = 1.0 / (math.sin(angle) * math.cos(angle)) / (1.0 + 0.17**2)
    width = math.log(found["peak_force_high_n"] / found["peak_force_n"]) / 1.959964
    assert width == pytest.approx(slope * 1e-4, rel=1e-2)


def test_a_block_that_nobody_measured_is_as_uncertain_as_its_height():
    table = _table(block=["step-050", "step-new"])
    found = predict_trials(table, make_learned_model())
    angle = find_step_angle(50e-6, 110e-6)
    slope = 1.0 / (110e-6 * math.sin(angle))  # da/dH
    total = angle + math.atan(0.17)
    expected = slope * 1e-6 / (math.sin(total) * math.cos(total))
    width = np.log(found["peak_force_high_n"] / found["peak_force_n"]) / 1.959964
    assert width[0] == 0.0
    assert width[1] == pytest.approx(expected, rel=1e-2)


def test_effects_act_in_the_extended_model_alone():
    learned = make_learned_model({"edge_rounding": {"edge_radius_m": 14e-6}})
    found = predict_trials(_table(), learned).iloc[0]
    rounded = find_release(find_step_angle(50e-6, 110e-6, 14e-6), 0.8, 0.17)
    sharp = find_release(find_step_angle(50e-6, 110e-6), 0.8, 0.17)
    assert found["peak_force_n"] == pytest.approx(rounded.pull_force, rel=1e-12)
    assert found["nominal_peak_force_n"] == pytest.approx(sharp.pull_force, rel=1e-12)


def test_a_table_and_its_file_are_predicted_alike_and_the_file_is_what_is_returned(tmp_path):
    table = _table(load_n=[0.3, 0.8], run_order=[1, 2], operator=["A", "B"])
    table.to_csv(tmp_path / "trials.csv", index=False)
    learned = make_learned_model(
        {"running_in": {"excess": 0.5, "settling_trials": 30.0}}, std=0.01, scatter=0.02
    )
    from_file = predict_trials(
        str(tmp_path / "trials.csv"), learned, str(tmp_path / "new" / "p.csv")
    )
    pd.testing.assert_frame_equal(from_file, predict_trials(table, learned))
    written = pd.read_csv(tmp_path / "new" / "p.csv")
    pd.testing.assert_frame_equal(written, from_file, check_dtype=False, rtol=1e-8)


def test_every_reason_is_named_and_the_gravest_is_shown():
    learned = make_learned_model({"running_in": {"excess": 0.5, "settling_trials": 30.0}})
    table = _table(
        height_um=[50.0, 50.0, 115.0, 50.0, -1.0, 50.0],
        load_n=[0.8, 3.0, 0.8, "heavy", float("inf"), 0.8],
        run_order=[5, 500, 5, 5, 5, None],
        operator=["A", "C", "A", "A", "C", "A"],
        block="step-050",
    )
    found = predict_trials(table, learned)
    assert list(found["status"]) == [
        "ok",
        "outside-range(load_n; operator; run_order)",
        "locked",
        "invalid(load_n)",
        "invalid(height_um; load_n)",
        "invalid(run_order)",
    ]
    blank = found[_NUMBERS].isna().all(axis=1)
    assert list(blank) == [False, False, True, True, True, True]


def test_the_columns_that_a_model_needs_are_asked_for_by_name():
    learned = make_learned_model({"running_in": {"excess": 0.5, "settling_trials": 30.0}})
    with pytest.raises(PipelineError, match="columns load_n, run_order, which the model needs"):
        predict_trials(_table().drop(columns="load_n"), learned)


def test_a_model_that_follows_its_own_quantities_needs_no_column_for_them():
    learned = make_learned_model({"hardening_spring": {"cubic_per_n2": 0.2, "pitch_share": 0.1}})
    found = predict_trials(_table(), learned).iloc[0]
    assert found["status"] == "ok"
    # a hardening spring stores less for the same force, and shows a swing of more force for what it
    # stores
    assert found["vibration_energy_j"] != found["nominal_vibration_energy_j"]
    assert found["peak_force_n"] == pytest.approx(found["nominal_peak_force_n"])


def test_files_that_cannot_be_read_or_written_are_named(tmp_path):
    with pytest.raises(PipelineError, match="table cannot be read"):
        predict_trials(tmp_path / "none.csv", make_learned_model())
    (tmp_path / "blocked").write_text("a file where a folder should be")
    with pytest.raises(PipelineError, match="cannot be written"):
        predict_trials(_table(), make_learned_model(), tmp_path / "blocked" / "p.csv")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_model_whose_figures_are_out_of_all_measure_is_refused_and_never_ok_without_an_energy():
    with pytest.raises(PipelineError, match="is not finite: its conditions or the model"):
        predict_trials(_table(), replace(make_learned_model(), channel_std=np.full(7, 1e300)))


def test_trials_without_a_tip_are_those_of_the_tip_that_the_model_was_measured_with():
    learned = make_learned_model()
    own = f"tip-{learned.tip_radius_um:g}"
    named = predict_trials(_table(load_n=[0.3, 0.8], tip=own), learned)
    plain = predict_trials(_table(load_n=[0.3, 0.8]).drop(columns="tip"), learned)
    assert plain[_NUMBERS].to_numpy() == pytest.approx(named[_NUMBERS].to_numpy(), rel=1e-12)


@pytest.mark.parametrize("name", ["height_um", "load_n", "speed_mm_s"])
def test_a_trial_without_height_load_or_speed_is_invalid_and_has_no_figures(name):
    found = predict_trials(_table(**{name: [0.0, 1.0]}), make_learned_model())
    assert found["status"][0] == f"invalid({name})"
    assert found.loc[0, _NUMBERS].isna().all()
    assert not found["status"][1].startswith("invalid")


def test_a_setting_that_is_the_same_to_three_digits_is_no_extrapolation():
    learned = make_learned_model()
    (place,) = [one for one in learned.ranges if one.name == "load_n"]
    # 15.3 g are 0.15004 N, and people write 0.15
    loads = [place.low * (0.15 / 0.15004), place.low * 0.99, place.high * 1.0005, place.high * 1.01]
    found = predict_trials(_table(load_n=loads), learned)
    outside = "outside-range(load_n)"
    assert list(found["status"]) == ["ok", outside, "ok", outside]


def _with_law(model, name, **values):
    """Put one smooth law over a column of the session into a model, its values certain."""
    (law,) = (law for law in list_composed_laws(model.ranges) if law.id == name)
    known = model.extended
    found = known.values | {f"{name}.{key}": value for key, value in values.items()}
    fitted = replace(
        known,
        values=found,
        units=("1",) * len(found),
        covariance=np.zeros((len(found), len(found))),
        laws=(law,),
    )
    return replace(model, extended=fitted)


def test_a_label_that_the_session_had_not_is_as_uncertain_as_those_it_had_differ():
    model = _with_law(make_learned_model(), "smooth_conversion_operator", **{"g[B]": 0.2})
    found = predict_trials(_table(operator=["A", "B", "C"]), model)
    assert list(found["status"]) == ["ok", "ok", "outside-range(operator)"]
    a, b, c = np.log(found["vibration_energy_j"])
    assert (b - a, c - a) == pytest.approx((0.2, 0.1))
    width = np.log(found["vibration_energy_high_j"] / found["vibration_energy_j"])
    # origin: two levels 0.2 apart lie 0.1 from their mean
    assert width.to_list() == pytest.approx([0.0, 0.0, 1.959964 * 0.1], abs=1e-12)


def test_an_hour_after_the_run_is_as_uncertain_as_the_run_changed():
    values = {"step": 0.2, "at_trial": 60.5}
    model = _with_law(make_learned_model(), "step_conversion_run_order", **values)
    found = predict_trials(_table(run_order=[30.0, 90.0, 200.0]), model)
    before, after, later = np.log(found["vibration_energy_j"])
    assert (after - before, later - before) == pytest.approx((0.2, 0.2))
    width = np.log(found["vibration_energy_high_j"] / found["vibration_energy_j"])
    # origin: half of the run lies 0.2 below the last level, half at it
    assert width.to_list() == pytest.approx([0.0, 0.0, 1.959964 * 0.2 / math.sqrt(2.0)], abs=1e-4)
