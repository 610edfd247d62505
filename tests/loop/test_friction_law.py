"""A law of friction that is known beforehand belongs to the nominal model of the loop.

The truth is Stribeck's curve, written out here; the tip is at rest when it releases.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from oracles.feature_bench import bench_trials, design_columns, noise_free
from oracles.features_file import features_of
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.law import Law
from stepblocks.loop.run import analyse_features, write_loop_result
from stepblocks.predict.learned import predict_trials
from stepblocks.records.model import read_model

_RULES = Rules(draws=100, fits=2)
_COLUMNS = design_columns(60, 3)
_DECLARED = {"law": "stribeck", "sliding": 0.14, "static": 0.21, "speed": "6 mm/s"}


def _rub_by_stribeck(state, _, __):
    share = (0.14 + (0.21 - 0.14) * np.exp(-state.speed / 6e-3)) / 0.21
    return state.changed(friction=state.friction * share, edge_factor=1.0 / share)


_TRUTH = ((Law("stribeck", "mu(v)", (), _rub_by_stribeck, "friction"), {}),)


@pytest.fixture(scope="module")
def features():
    return features_of(bench_trials(_COLUMNS, 3, _TRUTH))


@pytest.fixture(scope="module")
def declared(features):
    return analyse_features(features, 9810.0, 125e-6, rules=_RULES, laws={"friction": _DECLARED})


@pytest.mark.long
def test_nothing_is_missing_where_the_law_is_declared_and_unseen_blocks_are_twice_as_near(
    features, declared
):
    assert declared.verdict is Verdict.NONE
    assert declared.found.nominal.values["friction"] == pytest.approx(0.16, rel=0.02)
    # one effect in its place is enough to say that something is missing
    without = analyse_features(features, 9810.0, 125e-6, rules=replace(_RULES, most=2))
    assert without.verdict is not Verdict.NONE
    assert without.found.nominal.cost > declared.found.nominal.cost + 100.0
    with_law, constant = (
        result.document["nominal"]["error"]["ln_energy_rms_blocks_left_out"]
        for result in (declared, without)
    )
    assert with_law < 0.5 * constant


@pytest.mark.long
def test_the_model_that_is_written_predicts_by_the_law_without_the_session(declared, tmp_path):
    write_loop_result(declared, tmp_path)
    learned = read_model(tmp_path / "model.json")
    assert learned.known_laws == {"friction": _DECLARED}
    table = pd.DataFrame(_COLUMNS).assign(trial=np.arange(60))
    predicted = predict_trials(table, learned)["peak_force_n"].to_numpy()
    true = np.exp(noise_free(_COLUMNS, 3, _TRUTH)[:, 1])
    known = np.isfinite(predicted)
    assert known.sum() > 45
    assert np.abs(predicted[known] / true[known] - 1.0).max() < 0.03
