"""Sessions in one likelihood.

What is common is fitted once, what is of a day is pooled by the rules of random effects, and the
next session is predicted before it is run.
"""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from oracles.features_file import features_of
from stepblocks.errors import PipelineError
from stepblocks.lawsearch.findings import Rules
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.loop.run import write_loop_result
from stepblocks.loop.session_table import build_session_table
from stepblocks.loop.several import (
    _pool_on_natural_scale,
    describe_day_differences,
    explain_sessions_together,
    join_tables,
    loop_sessions,
    pool_parameter,
    pool_shared_parameters,
)
from stepblocks.records.model import build_model_document, read_model
from stepblocks.rig.effects.named import list_named_laws

ROUNDED = next(law for law in list_named_laws([]) if law.id == "edge_rounding")
PLANTED = ((ROUNDED, {"edge_radius_m": 8e-6}),)


def test_sessions_that_agree_are_averaged_by_their_errors():
    errors = np.array([0.002, 0.001, 0.001])
    pooled = pool_parameter("1", {"a": 0.150, "b": 0.152, "c": 0.1515}, np.diag(errors**2))
    assert pooled.among_sessions_std == 0.0
    assert pooled.mean == pytest.approx(np.average([0.150, 0.152, 0.1515], weights=errors**-2.0))
    assert pooled.mean_std == pytest.approx(1.0 / np.sqrt(np.sum(errors**-2.0)))


def test_days_that_differ_are_drawn_to_the_mean_by_no_more_than_their_error():
    values = {"a": 0.10, "b": 0.15, "c": 0.20}
    pooled = pool_parameter("1", values, 0.001**2 * np.eye(3))
    # origin: equal errors: the variance among sessions is that of the values less that of one
    assert pooled.among_sessions_std == pytest.approx(np.sqrt(0.05**2 - 0.001**2), rel=1e-3)
    assert pooled.sessions["a"].shrunk == pytest.approx(0.10, abs=1e-4)
    assert pooled.next.low < 0.0 < 0.3 < pooled.next.high


def test_an_error_that_all_days_share_does_not_average_out():
    own, shared = 1e-3, 3e-3
    covariance = own**2 * np.eye(4) + shared**2
    pooled = pool_parameter(
        "1", dict(zip("abcd", [0.15, 0.151, 0.149, 0.15], strict=True)), covariance
    )
    # origin: the mean of four equal errors beside a common one
    assert pooled.mean_std == pytest.approx(np.sqrt(own**2 / 4.0 + shared**2))
    assert pooled.among_sessions_std == 0.0


@pytest.mark.long
def test_the_next_session_lies_in_its_interval_as_often_as_stated():
    random = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        truth = random.normal(0.15, 0.01, 5)
        seen = {str(i): v + random.normal(0, 3e-3) for i, v in enumerate(truth[:4])}
        pooled = pool_parameter("1", seen, 3e-3**2 * np.eye(4))
        inside += pooled.next.low < truth[4] < pooled.next.high
    # origin: 95 % of 400; 0.905 and 0.985 are four binomial deviations off
    assert 0.905 < inside / 400 < 0.985


def measure_days(frictions, count=80):
    """Days of one bench, its blocks and edges rounded by 8 um; trials, tables and scans."""
    columns = design_columns(count * len(frictions), 7)
    scans = {b: {"height_m": v, "height_std_m": s} for b, (v, s) in block_scans(columns, 7).items()}
    days = [
        features_of(bench_trials(columns, 7, PLANTED, truth={"friction": friction}))
        .iloc[count * day : count * (day + 1)]
        .reset_index(drop=True)
        for day, friction in enumerate(frictions)
    ]
    tables = {
        f"day-{day}": build_session_table(one, 9810.0, 125e-6, scans)
        for day, one in enumerate(days, start=1)
    }
    return days, tables, scans


def fit_rounding(table):
    return fit_with_effects(build_problem(table.model, table.trials), [ROUNDED])


@pytest.mark.long
def test_three_days_of_80_trials_give_what_one_of_240_gives():
    days, tables, scans = measure_days((0.16, 0.16, 0.16))
    whole = fit_rounding(
        build_session_table(pd.concat(days, ignore_index=True), 9810.0, 125e-6, scans)
    )
    joint, alone = fit_rounding(join_tables(tables)), fit_rounding(tables["day-1"])
    radius, stiffness = "edge_rounding.edge_radius_m", "stiffness_ratio"
    # origin: the same trials; the planted radius and spring; errors fall by the root of three
    assert joint.values[radius] == pytest.approx(whole.values[radius], abs=0.2 * whole.std[radius])
    assert joint.values[radius] == pytest.approx(8e-6, abs=2.0 * joint.std[radius])
    assert joint.std[radius] == pytest.approx(whole.std[radius], rel=0.1)
    assert joint.std[stiffness] == pytest.approx(whole.std[stiffness], rel=0.2)
    assert joint.std[stiffness] < 0.65 * alone.std[stiffness]


def test_days_of_other_friction_leave_the_radius_where_it_is_and_show_their_spread():
    _, tables, _ = measure_days((0.14, 0.16, 0.18))
    joint = fit_rounding(join_tables(tables))
    radius = "edge_rounding.edge_radius_m"
    assert joint.values[radius] == pytest.approx(8e-6, abs=2.0 * joint.std[radius])
    shared = pool_shared_parameters(joint, list(tables))
    assert [round(one.value, 2) for one in shared["friction"].sessions.values()] == [
        0.14,
        0.16,
        0.18,
    ]
    # origin: the standard deviation of the three planted values
    assert shared["friction"].among_sessions_std == pytest.approx(0.02, abs=2e-3)
    assert shared["stiffness_ratio"].among_sessions_std == 0.0
    assert set(shared["stiffness_ratio"].sessions) == set(tables)


def test_a_zero_that_one_day_knows_is_taken_off_that_day_alone():
    _, tables, _ = measure_days((0.16, 0.16))
    known = replace(tables["day-1"].model, known={"zero_n": (0.02, 1e-4)})
    other = replace(tables["day-2"].model, known={"zero_n": (0.0, 1e-4)})
    joined = join_tables(
        {
            "day-1": replace(tables["day-1"], model=known),
            "day-2": replace(tables["day-2"], model=other),
        }
    )
    start = {p.name: p.start for p in joined.model.parameters(joined.trials)}
    zero = joined.model.compute_state(joined.trials, start).zero
    first = joined.trials.covariates["session"] == "day-1"
    assert zero[first] == pytest.approx(0.02)
    assert zero[~first] == pytest.approx(0.0)


@pytest.mark.long
def test_a_model_of_several_sessions_is_read_back_and_holds_their_mean(tmp_path):
    _, tables, scans = measure_days((0.14, 0.16, 0.18), count=32)
    together, shared = explain_sessions_together(tables, scans, rules=Rules(draws=120, fits=2))
    assert [finding.effect.id for finding in together.found.findings] == ["edge_rounding"]
    assert together.document["trials_analysed"] == 96
    write_loop_result(together, tmp_path)
    learned = read_model(tmp_path / "model.json")
    assert learned.extended.values["friction"] == shared["friction"].mean
    assert learned.extended.values["friction"] == pytest.approx(0.16, abs=3e-3)
    assert (
        "friction[day-2]"
        in json.loads((tmp_path / "result.json").read_text())["extended"]["parameters"]
    )
    assert build_model_document(learned)["verdict"] == "several sessions"


def test_scans_that_make_one_name_two_blocks_are_refused_with_the_heights():
    _, tables, scans = measure_days((0.16, 0.16))
    block = next(iter(scans))
    model = tables["day-2"].model
    height, std = model.scanned[block]
    moved = {**model.scanned, block: (height + 5e-6, std)}
    tables["day-2"] = replace(tables["day-2"], model=replace(model, scanned=moved))
    with pytest.raises(PipelineError, match=f"scans of the block '{block}' must agree") as refused:
        join_tables(tables)
    assert f"{1e6 * height + 5.0:.4g} um in day-2" in str(refused.value)


def test_two_sessions_of_one_name_are_refused_before_anything_is_measured(tmp_path):
    with pytest.raises(PipelineError, match="'monday' twice"):
        loop_sessions([tmp_path / "a" / "monday", tmp_path / "b" / "monday"], tmp_path / "out")


def test_sessions_of_unlike_springs_are_refused_before_anything_is_measured(tmp_path):
    for name, spring in (("monday", "9.81 N/mm"), ("tuesday", "5 N/mm")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "trials.csv").write_text("trial,block,height_um,load_n,speed_mm_s\n")
        (tmp_path / name / "session.toml").write_text(
            f'schema = 1\n[probe]\nspring_constant = "{spring}"\ntip_radius = "125 um"\n'
            '[acquisition]\nsample_rate = "10 kHz"\ntraces = "traces.h5"\n'
            'channels = { tangential = "fx_n", normal = "fy_n" }\n'
        )
    with pytest.raises(PipelineError, match=r"9810 N/m in monday; 5000 N/m in tuesday"):
        loop_sessions([tmp_path / "monday", tmp_path / "tuesday"], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_change_between_two_days_is_said_and_the_next_friction_stays_positive():
    values = {"monday": 0.150, "tuesday": 0.170}
    pooled = _pool_on_natural_scale("friction", "1", values, 0.001**2 * np.eye(2))
    # origin: ln(0.170 / 0.150) is 0.125, 13 standard uncertainties of such a difference
    assert pooled.equal_p_value < 1e-6
    assert 0.0 < pooled.next.low < 0.150 < 0.170 < pooled.next.high
    (sentence,) = describe_day_differences({"friction": pooled})
    assert sentence.startswith(
        "friction differs between the sessions: 0.15 in monday and 0.17 in tuesday"
    )
    alike = _pool_on_natural_scale(
        "friction", "1", {"monday": 0.150, "tuesday": 0.151}, 0.001**2 * np.eye(2)
    )
    assert describe_day_differences({"friction": alike}) == []
