"""A table of features as the search takes it.

Every number in its channel, every trial that is left out with its reason.
"""

import json
import math

import numpy as np
import pandas as pd
import pytest

from oracles.learned import make_learned_model
from stepblocks.cli import main
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import PipelineError
from stepblocks.loop.block_scans import ScannedBlocks, measure_block_scans
from stepblocks.loop.session_table import build_session_table, read_trial_table
from stepblocks.predict.learned import predict_trials
from stepblocks.records.model import build_model_document
from stepblocks.rig.state import CHANNELS


@pytest.fixture
def features():
    """Forty good drags, each other than the rest, with the uncertainties of a good bench."""
    n = 40
    rows = np.arange(n)
    return pd.DataFrame(
        {
            "trial": [str(i + 1) for i in rows],
            "status": "ok",
            "reason": "",
            "block": np.where(rows % 2, "step-020", "step-050"),
            "height_um": np.where(rows % 2, 20.0, 50.0),
            "load_n": 0.5 + 0.01 * rows,
            "speed_mm_s": 5.0,
            "tip": "tip-125",
            "temperature_c": 21.0 + 0.1 * rows,
            "operator": np.where(rows % 3, "A", "B"),
            "sliding_friction": 0.15 + 1e-3 * np.sin(rows),
            "sliding_friction_std": 1e-3,
            "normal_load_n": 1.01 * (0.5 + 0.01 * rows),
            "normal_load_std_n": 1e-3,
            "spring_constant_n_per_m": 9800.0 + rows,
            "spring_constant_std_n_per_m": 20.0,
            "peak_force_n": 0.6 * np.exp(0.01 * np.cos(rows)),
            "peak_force_std_n": 6e-3,
            "vibration_energy_j": 4e-6 * np.exp(0.02 * np.cos(rows)),
            "vibration_energy_std_j": 8e-8,
            "ring_frequency_hz": 300.0 + np.sin(rows),
            "ring_frequency_std_hz": 0.3,
            "decay_time_s": 0.02 + 1e-5 * rows,
            "decay_time_std_s": 4e-4,
        }
    )


def _table(features, **keywords):
    return build_session_table(features, 9810.0, 125e-6, **keywords)


def test_every_figure_becomes_its_channel(features):
    trials = _table(features).trials
    row = features.iloc[3]
    expected = {
        "ln_energy": (math.log(row["vibration_energy_j"]), 8e-8 / row["vibration_energy_j"]),
        "ln_peak_force": (math.log(row["peak_force_n"]), 6e-3 / row["peak_force_n"]),
        "sliding_friction": (row["sliding_friction"], 1e-3),
        "spring_constant": (9803.0 / 9810.0, 20.0 / 9810.0),
        "ln_ring_frequency": (math.log(row["ring_frequency_hz"]), 0.3 / row["ring_frequency_hz"]),
        "ln_decay_time": (math.log(row["decay_time_s"]), 4e-4 / row["decay_time_s"]),
        "normal_load_ratio": (1.01, 1e-3 / row["load_n"]),
    }
    assert trials.channels == CHANNELS == tuple(expected)
    assert trials.values[3] == pytest.approx([value for value, _ in expected.values()])
    assert trials.std[3] == pytest.approx([std for _, std in expected.values()])


def test_what_was_set_or_read_is_a_covariate_and_no_figure_is(features):
    covariates = _table(features).trials.covariates
    assert list(covariates) == [
        *("height_um", "load_n", "speed_mm_s", "tip", "temperature_c", "operator"),
        *("previous_load_n", "previous_height_um", "passes_of_block"),
        "tip_radius_um",
    ]
    assert covariates["operator"].tolist()[:3] == ["B", "A", "A"]


def test_a_reading_missed_now_and_then_lies_between_its_neighbours_or_in_the_middle(features):
    slow = np.linspace(20.0, 24.0, 40)
    slow[7] = np.nan
    features["temperature_c"] = slow
    table = _table(features)
    # a reading that drifts along the run, and one that jumps from trial to trial
    assert table.trials.covariates["temperature_c"][7] == pytest.approx(20.0 + 7 * 4.0 / 39.0)
    features["temperature_c"] = [np.nan, *([20.0, 24.0] * 19), 22.0]
    table = _table(features)
    assert table.trials.covariates["temperature_c"][0] == pytest.approx(22.0)
    assert "1 of 40 trials have no temperature: they speak about all else" in table.notes


def test_a_fifth_of_blank_cells_leaves_a_column_of_numbers(features):
    humidity = np.linspace(40.0, 60.0, 40)
    humidity[::5] = np.nan
    features["temperature_c"] = humidity
    column = _table(features).trials.covariates["temperature_c"]
    assert np.issubdtype(column.dtype, np.floating)
    np.testing.assert_allclose(column[5:], np.linspace(40.0, 60.0, 40)[5:])


@pytest.mark.parametrize(("jump", "words"), [(-3600.0, "back by 6"), (3600.0, "ahead by 60 min")])
def test_a_jump_of_the_clock_is_said(features, jump, words):
    clock = 90.0 * np.arange(40.0)
    clock[21:] += jump
    features.insert(4, "when_elapsed_s", clock)
    (note,) = _table(features).notes
    assert f"the clock jumps {words}" in note
    assert "between the trials" in note


def test_a_column_of_which_much_is_missing_is_one_of_labels(features):
    features["humidity_pct"] = features["temperature_c"].where(features.index > 32)
    order = [name for name in features if name != "humidity_pct"]
    at = order.index("sliding_friction")
    column = _table(features[[*order[:at], "humidity_pct", *order[at:]]]).trials.covariates[
        "humidity_pct"
    ]
    assert column[0] == "unknown"
    assert len(set(column.tolist())) == 8


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"status": "excluded", "reason": "clipped"}, "clipped"),
        ({"status": "failed"}, "failed"),
        ({"load_n": 0.0}, "load_n must be a positive number"),
        ({"speed_mm_s": np.nan}, "speed_mm_s must be a positive number"),
        ({"height_um": 125.0}, "the step is as high as the ball"),
        ({"tip": "tip-40"}, "the step is as high as the ball"),
        # a record of a clipped converter once had a spring of 0.1 N/m
        ({"spring_constant_n_per_m": 981.0}, "spring_constant_n_per_m is impossible: over 3 times"),
        ({"spring_constant_n_per_m": 98100.0}, "spring_constant_n_per_m is impossible: over 3 tim"),
        ({"normal_load_n": 0.1}, "normal_load_n is impossible: over 3 times off what is declared"),
        (
            {"peak_force_n": np.nan, "vibration_energy_j": np.nan},
            "neither a peak force nor a vibration energy",
        ),
    ],
)
def test_a_trial_that_cannot_be_used_is_left_out_for_its_reason(features, changes, reason):
    for name, value in changes.items():
        features[name] = features[name].astype(object)
        features.loc[4, name] = value
    table = _table(features)
    assert len(table.trials) == 39
    assert "5" not in table.names
    ((trial, said),) = table.excluded
    assert trial == "5"
    assert said.startswith(reason)


def test_a_saturated_normal_gauge_leaves_the_peak_and_a_saturated_peak_is_a_bound(
    features,
):
    features["status"] = "censored"
    features.loc[features.index % 2 == 0, "peak_force_std_n"] = np.nan  # the peak itself was cut
    trials = _table(features).trials
    whole = np.arange(40) % 2 == 1
    assert np.isfinite(trials.values[:, :2]).all(axis=1).tolist() == whole.tolist()
    assert np.isfinite(trials.floor[:, 1]).tolist() == (~whole).tolist()
    assert trials.floor[~whole, 1] == pytest.approx(
        np.log(features["peak_force_n"].to_numpy()[~whole])
    )


def test_each_copy_is_named_with_the_trial_that_it_copies(features):
    forces = ["peak_force_n", "vibration_energy_j", "sliding_friction", "spring_constant_n_per_m"]
    features.loc[[7, 11], forces] = features.loc[2, forces].to_numpy()
    assert _table(features).excluded == [
        ("8", "the same forces as trial 3"),
        ("12", "the same forces as trial 3"),
    ]


def test_a_trial_already_left_out_is_no_original(features):
    forces = ["peak_force_n", "vibration_energy_j", "sliding_friction", "spring_constant_n_per_m"]
    features.loc[[2, 7], forces] = features.loc[2, forces].to_numpy()
    features.loc[2, ["status", "reason"]] = ["excluded", "clipped"]
    assert _table(features).excluded == [("3", "clipped")]


def test_a_value_known_to_no_better_than_a_factor_of_two_says_nothing(features):
    features.loc[1, "vibration_energy_std_j"] = 0.8 * features.loc[1, "vibration_energy_j"]
    features.loc[2, "decay_time_s"] = -1.0
    trials = _table(features).trials
    assert not trials.seen[1, CHANNELS.index("ln_energy")]
    assert not trials.seen[2, CHANNELS.index("ln_decay_time")]
    assert trials.seen.sum() == 40 * 7 - 2


def test_tips_whose_labels_contradict_the_declared_radius_are_refused_with_both(features):
    with pytest.raises(PipelineError, match=r"`probe.tip_radius`, 62 um: their labels say 125 um"):
        build_session_table(features, 9810.0, 62e-6)
    # one tip among others may be another, and keeps its own radius
    features.loc[3, "tip"] = "tip-90"
    radius = _table(features).trials.covariates["tip_radius_um"]
    assert radius.tolist() == [125.0] * 3 + [90.0] + [125.0] * 36


def test_a_trial_whose_record_contradicts_its_row_takes_no_part_and_says_why(features):
    features.loc[4, ["status", "reason"]] = ["flagged", "mislabelled: the load is another"]
    table = _table(features)
    assert table.excluded == [("5", "mislabelled: the load is another")]
    assert "5" not in table.names


def test_a_single_wild_value_goes_and_its_trial_stays(features):
    features.loc[6, "ring_frequency_hz"] = 600.0
    table = _table(features)
    assert ("7", "ln_ring_frequency lies far from all other trials") in table.excluded
    assert len(table.trials) == 40


def test_the_fit_of_the_ring_begins_in_the_middle_of_the_data(features):
    tool = _table(features).model.tool
    assert tool.stiffness == 9810.0
    assert tool.frequency == pytest.approx(features["ring_frequency_hz"].median(), rel=1e-6)
    assert tool.decay_time == pytest.approx(features["decay_time_s"].median(), rel=1e-6)


def test_where_no_trial_rang_the_ring_is_that_of_the_paper(features):
    model = _table(features.assign(ring_frequency_hz=np.nan, decay_time_s=np.nan)).model
    assert (model.tool.frequency, model.tool.decay_time) == (
        PAPER.tool.frequency,
        PAPER.tool.decay_time,
    )


def test_scans_give_heights_and_the_mean_of_the_edges(features):
    scans = {
        "step-020": {
            "height_m": 20.4e-6,
            "height_std_m": 15e-9,
            "edge_radius_m": 12e-6,
            "edge_radius_std_m": 1e-7,
        },
        "step-050": {"height_m": 49.7e-6, "height_std_m": 20e-9},
    }
    model = _table(features, scans=scans).model
    assert model.scanned == {"step-020": (20.4e-6, 15e-9), "step-050": (49.7e-6, 20e-9)}
    assert model.scanned_radius == (12e-6, 1e-7)
    assert _table(features).model.scanned is None


@pytest.mark.parametrize("name", ["block", "height_um", "speed_mm_s"])
def test_a_column_without_which_nothing_goes_is_asked_for(features, name):
    with pytest.raises(PipelineError, match=f"missing {name}"):
        _table(features.drop(columns=name))


def test_a_scan_is_evaluated_line_by_line_and_what_fails_is_named(tmp_path):
    x = np.arange(-400, 400) * 1e-6
    height = np.where(x > 0.0, 50e-6, 0.0) + 5e-9 * np.random.default_rng(1).standard_normal(800)
    (tmp_path / "scans").mkdir()
    np.savetxt(
        tmp_path / "scans/b.csv",
        np.stack([x, height], axis=1) * 1e6,
        "%.4f",
        ",",
        header="x_um,z_um",
        comments="",
    )
    (tmp_path / "scans/c.csv").write_text("x_um,z_um\n0,0\n")
    scanned = measure_block_scans(tmp_path, "scans/{block}.csv", ["b", "c", "d"])
    found, unused = scanned.scans, scanned.unused
    assert list(found) == ["b"]
    assert found["b"]["height_m"] == pytest.approx(50e-6, abs=20e-9)
    assert set(found["b"]) == {"height_m", "height_std_m", "edge_radius_m", "edge_radius_std_m"}
    assert unused["d"] == "no file scans/d.csv"
    assert "c.csv" in unused["c"]


def test_a_session_without_scans_has_none_and_none_is_missed(tmp_path):
    assert measure_block_scans(tmp_path, None, ["b"]) == ScannedBlocks({}, {})


def test_a_night_between_two_trials_begins_a_day_and_a_numbered_day_is_a_label(features):
    clock = 600.0 * np.arange(40.0) + 40000.0 * (np.arange(40) >= 25)
    late = features.copy()
    late.insert(5, "clock_elapsed_s", clock)
    days = _table(late).trials.covariates["day"]
    assert days.tolist() == ["1"] * 25 + ["2"] * 15
    numbered = features.copy()
    numbered.insert(5, "day", np.repeat([3, 4], 20))
    trials = _table(numbered).trials
    assert trials.numeric("day") is None
    assert set(trials.covariates["day"]) == {"3", "4"}


def test_trials_are_counted_from_each_pause_over_three_times_the_usual(features):
    gaps = np.where(np.isin(np.arange(40), [10, 28]), 400.0, 60.0 + np.arange(40) % 7)
    clocked = features.copy()
    clocked.insert(5, "clock_elapsed_s", np.cumsum(gaps))
    since = _table(clocked).trials.covariates["trials_since_rest"]
    assert since.tolist() == [*range(10), *range(18), *range(12)]
    # one rest alone says no more than the order of the run
    clocked["clock_elapsed_s"] = np.cumsum(np.where(np.arange(40) == 28, 60.0, gaps))
    assert "trials_since_rest" not in _table(clocked).trials.covariates


@pytest.fixture
def log(tmp_path):
    """The folder of a session whose log has names, units and decimals of its own."""
    (tmp_path / "session.toml").write_text(
        'schema = 1\n[probe]\nspring_constant = "9810 N/m"\n[acquisition]\nsample_rate = "10 kHz"\n'
        'traces = "traces.h5"\nchannels = { time = "t_s", tangential = "x_n", normal = "y_n" }\n'
        '[trials]\nfile = "log.csv"\ndelimiter = ";"\ndecimal = ","\n[trials.columns]\n'
        'trial = "run"\nblock = "specimen"\nload = { column = "weight g", unit = "gf" }\n'
        'speed = { column = "v", unit = "mm/s" }\nheight = { column = "step", unit = "um" }\n'
    )
    (tmp_path / "log.csv").write_text(
        "run;specimen;step;weight g;v;clock\n1;a;20;50,0;2,0;2026-11-20 08:00:00\n"
        "2;b;50;80,0;5,0;2026-11-20 08:02:00\n3;a;20;50,0;2,0;2026-11-21 08:02:00\n"
    )
    return tmp_path


def test_the_log_of_a_session_is_a_table_that_its_model_predicts_from(log):
    table = read_trial_table(log)
    assert table["trial"].tolist() == ["1", "2", "3"]
    assert table["load_n"].to_numpy() == pytest.approx(9.80665e-3 * np.array([50.0, 80.0, 50.0]))
    assert table["previous_load_n"].to_numpy()[1:] == pytest.approx(table["load_n"].to_numpy()[:2])
    assert table["passes_of_block"].tolist() == [0.0, 0.0, 1.0]
    assert table["pause_s"].tolist() == [86400.0, 120.0, 86400.0]
    assert table["day"].tolist() == ["1", "1", "2"]


def test_a_prediction_from_the_folder_is_that_of_its_trials_in_si_units(log):
    found = predict_trials(read_trial_table(log), make_learned_model())
    plain = pd.DataFrame(
        {
            "trial": ["1", "2", "3"],
            "block": ["a", "b", "a"],
            "height_um": [20.0, 50.0, 20.0],
            "load_n": 9.80665e-3 * np.array([50.0, 80.0, 50.0]),
            "speed_mm_s": [2.0, 5.0, 2.0],
        }
    )
    wanted = predict_trials(plain, make_learned_model())
    pd.testing.assert_frame_equal(found[wanted.columns], wanted)


def test_the_command_predicts_the_trials_of_a_folder_from_its_own_log(log, tmp_path, capsys):
    model, output = tmp_path / "model.json", tmp_path / "out.csv"
    model.write_text(json.dumps(build_model_document(make_learned_model())))
    assert main(["predict", str(log), "--model", str(model), "-o", str(output)]) == 0
    assert "3 trials predicted, 0 of them not ok" in capsys.readouterr().out
    found = pd.read_csv(output, dtype={"trial": str})
    wanted = predict_trials(read_trial_table(log), make_learned_model())
    assert found["trial"].tolist() == ["1", "2", "3"]
    for name in ("peak_force_n", "vibration_energy_j"):
        assert found[name].to_numpy() == pytest.approx(wanted[name].to_numpy(), rel=1e-6)
    # a folder without a log, and a folder without a model
    (log / "log.csv").unlink()
    assert main(["predict", str(log), "--model", str(model), "-o", str(output), "--force"]) == 2
    assert "table of trials is missing, expected log.csv" in capsys.readouterr().err
