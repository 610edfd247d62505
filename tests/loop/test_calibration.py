"""What is known of the gauges beforehand: read with all its mistakes told, and held against what the trials say."""

import math

import numpy as np
import pandas as pd
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from oracles.features_file import features_of
from stepblocks.errors import PipelineError
from stepblocks.loop.bench_model import candidates, covariate_ranges
from stepblocks.loop.calibration import read_calibration, unloaded_zeros
from stepblocks.loop.search.explain import Rules, Verdict, explain
from stepblocks.loop.session_table import trials_of


def _session(tmp_path, text: str):
    (tmp_path / "session.toml").write_text("schema = 1\n" + text)
    return tmp_path


def test_certificates_are_read_in_their_units_and_gains_as_logarithms(tmp_path):
    text = '[calibration]\ntangential_zero = ["3 mN", "0.5 mN"]\nnormal_gain = ["0.98", "0.5 %"]\n'
    known = read_calibration(_session(tmp_path, text))
    assert known["zero_n"] == pytest.approx((3e-3, 0.5e-3))
    assert known["normal_ln_gain"] == pytest.approx((math.log(0.98), 0.005 / 0.98))
    assert read_calibration(_session(tmp_path, "")) == {}


def test_every_mistake_of_a_certificate_is_told_in_a_line_of_its_own(tmp_path):
    text = '[calibration]\ntangential_zero = ["3 mm", "1 mN"]\nnormal_zero = ["1 mN", "-1 mN"]\nbandwith = 3\n'
    with pytest.raises(PipelineError) as caught:
        read_calibration(_session(tmp_path, text))
    said, *lines = str(caught.value).splitlines()
    assert said.startswith("3 mistakes")
    assert len(lines) == 3
    assert ["bandwith" in lines[0], "tangential_zero" in lines[1], "normal_zero" in lines[2]] == [True] * 3


def test_unloaded_samples_give_the_zeros_where_there_are_enough():
    zeros = pd.DataFrame(
        {"tangential_zero_n": [0.011, 0.012, 0.013, 0.012, 0.012], "normal_zero_n": [0.01] + [np.nan] * 4}
    )
    assert unloaded_zeros(zeros) == {"zero_n": (0.012, pytest.approx(1e-4))}
    assert unloaded_zeros(pd.DataFrame({"trial": ["1"]})) == {}


@pytest.fixture(scope="module")
def shifted():
    columns = design_columns(96, 12)
    empty = bench_trials(columns, 0)
    law = next(law for law in candidates(empty, covariate_ranges(empty)) if law.id == "tangential_zero")
    scans = {b: {"height_m": v, "height_std_m": s} for b, (v, s) in block_scans(columns, 12).items()}
    return features_of(bench_trials(columns, 12, ((law, {"zero_n": 0.02}),))), scans


def _explained(shifted, known):
    features, scans = shifted
    table = trials_of(features, 9810.0, 125e-6, scans, known)
    return explain(table.model, table.trials, table.model.candidates(table.trials), Rules(draws=150))


def test_a_zero_is_found_as_a_zero_and_never_as_a_geometry(shifted):
    found = _explained(shifted, None)
    assert [f.effect.id for f in found.findings] == ["tangential_zero"]
    assert found.extended.values["tangential_zero.zero_n"] == pytest.approx(0.02, abs=2e-3)


def test_a_zero_that_is_known_is_no_finding_and_one_that_is_ruled_out_is_not_named(shifted):
    assert _explained(shifted, {"zero_n": (0.02, 1e-3)}).verdict is Verdict.NONE
    ruled_out = _explained(shifted, {"zero_n": (0.0, 1e-4)})
    assert "tangential_zero" not in [f.effect.id for f in ruled_out.findings]
