"""One session whose friction runs in, analysed and written once for all tests of the loop."""

import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from oracles.features_file import features_of
from stepblocks.lawsearch.findings import Rules
from stepblocks.loop.bench_model import list_candidate_laws, list_covariate_ranges
from stepblocks.loop.run import analyse_features, write_loop_result


def _running_in(columns):
    table = bench_trials(columns, 0)
    return next(
        e for e in list_candidate_laws(table, list_covariate_ranges(table)) if e.id == "running_in"
    )


def _analyse(folder):
    columns = design_columns(120, 3)
    effect = _running_in(columns)
    truth = ((effect, {"excess": 0.6, "settling_trials": 30.0}),)
    features = features_of(bench_trials(columns, 3, truth))
    features.loc[5, ["status", "reason"]] = ["excluded", "truncated"]
    scans = {b: {"height_m": v, "height_std_m": s} for b, (v, s) in block_scans(columns, 3).items()}
    result = analyse_features(features, 9810.0, 125e-6, scans, rules=Rules(draws=200, fits=2))
    write_loop_result(result, folder)
    return columns, truth, result


@pytest.fixture(scope="session")
def worn(make_once):
    """A session of 120 drags whose friction runs in, analysed and written."""
    folder, made = make_once("worn", _analyse)
    return *made, folder
