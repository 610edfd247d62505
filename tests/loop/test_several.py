"""Sessions in one hierarchy: pooled by the rules of random effects.

The next predicted before it is run.
"""

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from oracles.features_file import features_of
from stepblocks.artefacts.model_file import build_model_document, read_model
from stepblocks.errors import PipelineError
from stepblocks.loop.run import analyse_features
from stepblocks.loop.search.explain import Rules
from stepblocks.loop.several import fit_hierarchy, loop_sessions, pool_parameter


def test_sessions_that_agree_are_averaged_by_their_errors():
    pooled = pool_parameter(
        "friction", "1", {"a": (0.150, 0.002), "b": (0.152, 0.001), "c": (0.1515, 0.001)}
    )
    weights = np.array([1 / 0.002**2, 1 / 0.001**2, 1 / 0.001**2])
    assert pooled["among_sessions_std"] == 0.0
    assert pooled["mean"] == pytest.approx(np.average([0.150, 0.152, 0.1515], weights=weights))
    assert pooled["mean_std"] == pytest.approx(1.0 / np.sqrt(weights.sum()))


def test_days_that_differ_are_drawn_to_the_mean_by_no_more_than_their_error():
    pooled = pool_parameter(
        "friction", "1", {"a": (0.10, 0.001), "b": (0.15, 0.001), "c": (0.20, 0.001)}
    )
    # origin: equal errors: the variance among sessions is that of the values less that of one
    assert pooled["among_sessions_std"] == pytest.approx(np.sqrt(0.05**2 - 0.001**2), rel=1e-3)
    assert pooled["sessions"]["a"]["shrunk"] == pytest.approx(0.10, abs=1e-4)
    assert pooled["next"]["low"] < 0.0 < 0.3 < pooled["next"]["high"]


def test_the_next_session_lies_in_its_interval_as_often_as_stated():
    random = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        truth = random.normal(0.15, 0.01, 5)
        pooled = pool_parameter(
            "friction",
            "1",
            {str(i): (v + random.normal(0, 3e-3), 3e-3) for i, v in enumerate(truth[:4])},
        )
        inside += pooled["next"]["low"] < truth[4] < pooled["next"]["high"]
    # origin: 95 % of 400; 0.905 and 0.985 are four binomial deviations off
    assert 0.905 < inside / 400 < 0.985


def test_the_height_of_a_block_is_one_number_and_what_one_session_alone_has_predicts_nothing():
    assert (
        pool_parameter("height_error[step-010]", "m", {"a": (0.0, 1e-7), "b": (1e-6, 1e-7)})[
            "among_sessions_std"
        ]
        == 0.0
    )
    alone = pool_parameter("tip_wear.growth_m_per_trial", "m", {"a": (1e-7, 1e-9)})
    assert alone["next"] == {"low": None, "high": None}


def test_a_model_of_several_sessions_is_read_back_and_holds_their_mean(tmp_path):
    import json

    results = {}
    for day, friction in enumerate((0.14, 0.16, 0.18)):
        columns = design_columns(48, 50 + day)
        trials = bench_trials(columns, 50 + day, truth={"friction": friction})
        scans = {
            b: {"height_m": v, "height_std_m": s}
            for b, (v, s) in block_scans(columns, 50 + day).items()
        }
        results[f"day-{day}"] = analyse_features(
            features_of(trials), 9810.0, 125e-6, scans, rules=Rules(draws=60, fits=2)
        )
    shared, model = fit_hierarchy(results)
    assert shared["friction"]["mean"] == pytest.approx(0.16, abs=2e-3)
    assert shared["friction"]["among_sessions_std"] == pytest.approx(0.02, abs=4e-3)
    assert shared["stiffness_ratio"]["among_sessions_std"] < 2e-3
    (tmp_path / "model.json").write_text(json.dumps(build_model_document(model)))
    assert (
        read_model(tmp_path / "model.json").extended.values["friction"]
        == shared["friction"]["mean"]
    )


def test_two_sessions_of_one_name_are_refused_before_anything_is_measured(tmp_path):
    with pytest.raises(PipelineError, match="'monday' twice"):
        loop_sessions([tmp_path / "a" / "monday", tmp_path / "b" / "monday"], tmp_path / "out")
