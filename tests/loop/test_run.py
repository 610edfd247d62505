"""The orchestration: one result from the library and from the command.

And no guard asked of a script.
"""

import json
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from oracles.feature_bench import bench_trials, design_columns
from oracles.features_file import features_of
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import PipelineError
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.loop import run
from stepblocks.loop.apart_trial import ApartTrial
from stepblocks.loop.run import analyse_features, loop_session
from stepblocks.predict.learned import predict_trials
from stepblocks.records.model import build_model_document

_RULES = Rules(draws=60, fits=2)


@pytest.fixture(scope="module")
def quiet():
    features = features_of(bench_trials(design_columns(45, 40), 40))
    features.loc[2, ["status", "reason"]] = ["flagged", "mislabelled: another load"]
    said = []
    result = analyse_features(
        features, 9810.0, 125e-6, rules=_RULES, announce=lambda *one: said.append(one)
    )
    return features, result, said


@pytest.mark.long
def test_a_long_analysis_says_which_of_its_searches_runs_and_what_that_finds(quiet):
    said = quiet[2]
    assert [done for done, _, _ in said] == list(range(1, 9))  # all trials, and seven folds
    assert {of for _, of, _ in said} == {8}
    assert said[0][2].endswith("effects beside the nominal model")
    folds = (*quiet[1].within.selected, *quiet[1].between.selected)
    assert [text for _, _, text in said[1:]] == [
        f"part {n} of 7 held out: {', '.join(names) or 'nothing'}"
        for n, names in enumerate(folds, 1)
    ]


def test_a_result_is_read_without_files(quiet):
    features, result, _ = quiet
    assert result.verdict is Verdict.NONE
    assert result.document["verdict"] == "none"
    assert result.document["trials_analysed"] == len(result.table.trials)
    # what was learnt predicts at once, in memory
    found = predict_trials(
        features[["trial", "block", "height_um", "load_n", "speed_mm_s"]], result.model
    )
    wrong = np.log(found["peak_force_n"].to_numpy()) - np.log(features["peak_force_n"].to_numpy())
    assert np.sqrt(np.nanmean(wrong**2)) < 0.1


def test_none_names_the_smallest_effect_of_each_slot(quiet):
    document = quiet[1].document
    assert {entry["slot"] for entry in document["could_have_shown"]} == {
        "contact_geometry",
        "friction",
        "normal_load",
        "stiffness",
        "conversion",
        "drag",
        "sensor",
    }
    assert "No effect beyond noise was found (what would have shown: " in document["finding"]


def test_a_notebook_shows_the_verdict_and_the_errors(quiet):
    html = replace(quiet[1], title="<i>second batch")._repr_html_()
    assert "&lt;i&gt;second batch" in html
    assert "<b>none</b>" in html
    assert "ln_energy_rms_blocks_left_out" in html
    assert html.count("<table") == html.count("</table>") == 1


def test_a_trial_that_contradicts_its_row_is_listed_as_flagged_and_takes_no_part(quiet):
    document = quiet[1].document
    assert document["flagged"] == [{"trial": "3", "reason": "mislabelled: another load"}]
    assert document["flagged"] == document["excluded"]
    assert document["trials_analysed"] == len(quiet[0]) - 1


def test_every_fold_chooses_for_itself_and_every_trial_is_held_out_once_either_way(quiet):
    result = quiet[1]
    assert len(result.document["selected_in_folds"]) == 3 + 4
    for holdout in (result.within, result.between):
        assert np.array_equal(np.isfinite(holdout.nominal), result.table.trials.seen)


@pytest.mark.long
def test_workers_give_the_same_answer_and_ask_a_script_for_no_guard(quiet, tmp_path):
    features, result, _ = quiet
    features.to_csv(tmp_path / "features.csv", index=False)
    script = tmp_path / "script.py"
    script.write_text(
        "import json, pandas as pd\n"
        "from stepblocks.loop import run\n"
        "from stepblocks.loop.run import analyse_features\n"
        "from stepblocks.lawsearch.findings import Rules\n"
        "run._LEAST_TIME_SPARED = 0.0\n"  # else so few trials are searched without workers
        "features = pd.read_csv('features.csv', dtype={'trial': str, 'block': str})\n"
        "result = analyse_features(features, 9810.0, 125e-6, jobs=2, rules=Rules(draws=60, "
        "fits=2))\n"
        "print(json.dumps(result.document['nominal']['error']))\n"
    )
    done = subprocess.run(
        [sys.executable, script.name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    told, known = json.loads(done.stdout), result.document["nominal"]["error"]
    assert [told[name] for name in told if name != "noise_floor"] == pytest.approx(
        [known[name] for name in known if name != "noise_floor"], rel=1e-6
    )


@pytest.mark.parametrize(
    ("search_time", "jobs", "worth_it"),
    [(1.0, 2, False), (4.0, 2, True), (4.0, 1, False), (1.0, 32, False), (2.0, 32, True)],
)
def test_workers_are_started_where_they_spare_more_time_than_their_start(
    search_time, jobs, worth_it
):
    # seven searches; a worker loads the program in about five seconds of a processor
    assert run._are_workers_worth_it(search_time, 7, jobs) is worth_it


def test_linear_algebra_of_an_analysis_takes_one_thread_whatever_its_caller_takes(monkeypatch):
    class ReachedError(Exception):
        pass

    def stop(*_):
        raise ReachedError(
            {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}
        )

    monkeypatch.setattr(run, "_explain_and_hold_out", stop)
    features = features_of(bench_trials(design_columns(24, 1), 1))
    with threadpool_limits(2, "blas"), pytest.raises(ReachedError) as found:
        analyse_features(features, 9810.0, 125e-6)
    assert found.value.args == ({1},)


def test_what_a_session_came_to_is_the_same_after_a_pickle(worn):
    # laws hold functions without a name: a plain pickle of a result with one was refused
    _, _, result, _ = worn
    again = pickle.loads(pickle.dumps(result))
    assert repr(again.document) == repr(result.document)  # NaN is among it
    assert build_model_document(again.model) == build_model_document(result.model)
    table, fitted = again.table, again.found.extended
    predicted = table.model.predict(table.trials, fitted.values, fitted.active_effects)
    np.testing.assert_array_equal(predicted, result.found.extended.predicted)


def test_a_result_is_shown_in_a_line(quiet):
    result = quiet[1]
    before, after = (
        result.document[part]["error"]["ln_energy_rms"] for part in ("nominal", "extended")
    )
    trials = result.document["trials_analysed"]
    assert repr(result) == f"LoopResult(none, {trials} trials, E_v {before:.1%} -> {after:.1%})"
    assert len(repr(result.found)) <= 200
    assert repr(result.found).startswith("Explanation(verdict=<Verdict.NONE: 'none'>, adequate=")


def test_a_session_without_the_radius_of_its_tip_is_refused(tmp_path):
    (tmp_path / "session.toml").write_text("schema = 1\n")
    with pytest.raises(Exception, match="probe"):
        loop_session(tmp_path)


def test_a_result_draws_energies_before_and_after_into_the_axes_given(quiet):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert quiet[1].plot(axes) is axes
    nominal, extended, _ = (line.get_xydata() for line in axes.lines)
    trials, found = quiet[1].table.trials, quiet[1].found
    for drawn, fitted in ((nominal, found.nominal), (extended, found.extended)):
        assert drawn[:, 0] == pytest.approx(1e6 * np.exp(fitted.predicted[:, 0]))
        assert drawn[:, 1] == pytest.approx(1e6 * np.exp(trials.values[:, 0]), nan_ok=True)
    assert axes.get_ylabel() == "measured vibration energy, µJ"


@pytest.mark.long
def test_features_that_are_measured_already_are_explained_as_they_are(tmp_path, monkeypatch, worn):
    write_session(tmp_path / "session", Plan(trials=6), 1)
    features = measure_session(tmp_path / "session", jobs=1)
    features.loc[2, ["status", "reason"]] = ["excluded", "the bench was knocked"]
    taken = []
    monkeypatch.setattr("stepblocks.bench.measure.measure_session", None)
    monkeypatch.setattr(
        run, "analyse_features", lambda table, *_, **__: taken.append(table) or worn[2]
    )
    loop_session(tmp_path / "session", features=features, forces_only=True)
    assert taken[0]["trial"].tolist() == features["trial"].tolist()
    assert taken[0].loc[2, "reason"] == "the bench was knocked"


@pytest.mark.long
def test_blocks_are_found_under_the_name_that_a_session_gives_their_column(
    tmp_path, monkeypatch, worn
):
    folder = tmp_path / "session"
    write_session(folder, Plan(trials=6), 1)
    trials = (folder / "trials.csv").read_text(encoding="utf-8")
    renamed = trials.replace("block", "specimen", 1)
    (folder / "trials.csv").write_text(renamed, encoding="utf-8", newline="\n")
    with (folder / "session.toml").open("a", encoding="utf-8", newline="\n") as declaration:
        declaration.write('\n[trials.columns]\nblock = "specimen"\n')
    taken = []
    monkeypatch.setattr(run, "analyse_features", lambda *one, **_: taken.append(one) or worn[2])
    loop_session(folder, features=measure_session(folder, jobs=1))
    (table, _, _, scans) = taken[0]
    blocks = set(table["block"])
    assert blocks <= set(pd.read_csv(folder / "trials.csv")["specimen"])
    assert set(scans) == blocks


def test_a_table_of_features_is_explained_without_a_session(tmp_path, monkeypatch, worn):
    features = pd.DataFrame({"trial": ["1"]})
    taken = []
    monkeypatch.setattr(run, "analyse_features", lambda *one, **_: taken.append(one) or worn[2])
    point = OperatingPoint("120 um", "1 N", 0.15, Tool("9 N/mm"))
    assert loop_session(features, tmp_path / "out", point=point) is worn[2]
    assert taken[0][0] is features
    assert taken[0][1:] == (pytest.approx(9000.0), pytest.approx(120e-6), {})
    assert loop_session(features) is worn[2]  # the paper's, and nothing written
    assert taken[1][1:3] == (PAPER.tool.stiffness, PAPER.ball_radius)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    assert written["verdict"] == str(worn[2].verdict)


def test_records_that_do_not_exist_are_reported_before_anything_is_measured(tmp_path):
    with pytest.raises(PipelineError, match="at least one record"):
        loop_session(tmp_path, as_built=[tmp_path])


@pytest.mark.long
def test_traces_of_trials_held_apart_are_drawn_on_the_page(worn, tmp_path, monkeypatch):
    write_session(tmp_path / "session", Plan(trials=6), 1)
    rows = [ApartTrial(trial, 0.99, "let go early") for trial in ("2", "5")]
    shown = replace(worn[2], record=replace(worn[2].record, apart=rows))
    monkeypatch.setattr(run, "analyse_features", lambda *_, **__: shown)
    loop_session(tmp_path / "session", tmp_path / "with", jobs=1, forces_only=True)
    # the same result as it was written without trials held apart
    without, page = (
        (folder / "report.html").read_text() for folder in (worn[3], tmp_path / "with")
    )
    assert [one.count("Trace of a trial held apart") for one in (without, page)] == [0, 2]
    without, page = (one.count("data:image/png;base64,") for one in (without, page))
    assert page == without + 2
    # the page is one file: no picture lies beside it
    assert not list((tmp_path / "with").rglob("*.png"))
