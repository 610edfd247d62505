"""Features or whole records: those stand that a model predicts better on trials held out."""

import csv
import json

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, design_columns
from oracles.features_file import features_of
from stepblocks.cli import main
from stepblocks.errors import PipelineError
from stepblocks.lawsearch.findings import Rules
from stepblocks.loop.record_choice import compare_features_with_records, describe_record_choice
from stepblocks.loop.run import analyse_features, loop_session
from stepblocks.loop.session_table import build_session_table
from stepblocks.rehearse.run import simulate_session

_SPRING, _RADIUS = 9810.0, 125e-6
_NOISE = 0.1  # relative, of energy and peak force where a table is the worse one
PLAN = """schema = 1
seed = 5
[design]
heights = ["20 um", "40 um", "60 um"]
loads = ["0.6 N", "1 N"]
speeds = ["5 mm/s"]
repeats = 4
"""


def make_noisy(features):
    """Scatter energy and peak force by 10 %, as values that err more from trial to trial."""
    generator = np.random.default_rng(8)
    noisy = features.copy()
    for name, std_name in (
        ("vibration_energy_j", "vibration_energy_std_j"),
        ("peak_force_n", "peak_force_std_n"),
    ):
        noisy[name] *= np.exp(_NOISE * generator.standard_normal(len(noisy)))
        noisy[std_name] = np.hypot(noisy[std_name], _NOISE * noisy[name])
    return noisy


def analyse(features):
    return analyse_features(features, _SPRING, _RADIUS, rules=Rules(draws=20, fits=1))


@pytest.fixture(scope="module")
def sharp():
    features = features_of(bench_trials(design_columns(30, 40), 40))
    return features, analyse(features)


def choose(result, records):
    return compare_features_with_records(
        result, build_session_table(records, _SPRING, _RADIUS), seed=0
    )


@pytest.mark.long
def test_values_that_scatter_less_about_the_model_stand_whichever_they_are(sharp):
    features, result = sharp
    noisy = make_noisy(features)
    choice = choose(analyse(noisy), features)
    assert choice.whole_records_stand
    # peak forces scatter by 1 % about the model, energies by 8 %
    assert choice.ln_peak_force.p_better < 0.005
    assert choice.ln_energy.whole_records_rms < choice.ln_energy.features_rms
    assert "values of the whole records are used" in describe_record_choice(choice)
    # the noise that was added is most of the error: root of the sum of squares
    added = np.sqrt(
        choice.ln_peak_force.features_rms**2 - choice.ln_peak_force.whole_records_rms**2
    )
    assert added == pytest.approx(_NOISE, rel=0.3)
    choice = choose(result, noisy)
    assert not choice.whole_records_stand
    assert choice.ln_peak_force.p_worse < 0.005
    assert "the features are used" in describe_record_choice(choice)


@pytest.mark.long
def test_equal_values_are_no_reason_to_leave_the_features(sharp):
    features, result = sharp
    choice = choose(result, features)
    assert not choice.whole_records_stand
    assert choice.ln_energy.features_rms == choice.ln_energy.whole_records_rms


def test_a_table_has_no_records():
    with pytest.raises(PipelineError, match="whole records need traces"):
        loop_session(features_of(bench_trials(design_columns(45, 40), 40)), whole_record=True)


@pytest.mark.long
def test_the_loop_says_which_values_stand_and_keeps_both(tmp_path, capsys):
    (tmp_path / "plan.toml").write_text(PLAN)
    simulate_session(tmp_path / "plan.toml", tmp_path / "session")
    asked = ["loop", tmp_path / "session", "-o", tmp_path / "out", "--whole-record", "--jobs", 1]
    assert main(list(map(str, asked))) == 0
    said = capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    choice = document["record_choice"]
    stands = "The values of the whole records are used"
    if not choice["whole_records_stand"]:
        stands = "The features are used"
    assert stands in said
    assert document["headline"][-1].startswith(stands)
    assert choice["ln_energy"]["trials"] == 24
    table = (tmp_path / "out" / "whole-record.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(table.splitlines()))
    assert len(rows) == 24
