"""The public face of a measurement.

A table, from a script or a notebook, for any number of processes.
"""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from stepblocks.bench.conditions import read_conditions, replace_columns_by_conditions
from stepblocks.bench.measure import measure_session, measure_session_to_file
from stepblocks.bench.session import open_session
from stepblocks.bench.signal.features import FEATURE_COLUMNS, estimate_tool_from_features
from stepblocks.errors import PipelineError

SCRIPT = """
from stepblocks.bench.measure import measure_session
from stepblocks.rehearse.run import simulate_session
print("loaded")
simulate_session({plan!r}, {session!r})
table = measure_session({session!r}, jobs=2)
print(len(table), (table.status == "ok").sum())
"""
PLAN = """schema = 1
seed = 3
[design]
heights = ["20 um", "40 um"]
loads = ["0.5 N"]
speeds = ["10 mm/s"]
trials = 18
"""


def test_a_table_comes_back_with_its_conditions_and_features(session, tmp_path):
    table = measure_session(session, jobs=1)
    assert list(table.columns[:3]) == ["trial", "status", "reason"]
    assert tuple(table.columns[-len(FEATURE_COLUMNS) :]) == FEATURE_COLUMNS
    assert set(table.status) == {"ok"}
    assert set(table.reason) == {""}
    # origin: the load that each trial was made with
    np.testing.assert_allclose(table.normal_load_n, table.load_n, rtol=5e-3)
    assert [path.name for path in tmp_path.iterdir()] == ["session"]


def test_the_table_and_the_file_say_the_same(session, tmp_path):
    table = measure_session(str(session), str(tmp_path / "f.csv"), jobs=1)
    summary = measure_session_to_file(session, tmp_path / "g.csv", jobs=1)
    assert (tmp_path / "f.csv").read_bytes() == (tmp_path / "g.csv").read_bytes()
    written = pd.read_csv(tmp_path / "f.csv", dtype={"trial": str})
    # to the last bit: the table holds the rounded values of the file
    names = [name for name in table if name != "reason"]
    pd.testing.assert_frame_equal(table[names], written[names], check_exact=True)
    assert (summary.total, summary.excluded, summary.reasons) == (6, 0, {})


def test_the_linear_algebra_measures_with_one_thread_and_has_its_own_again(session):
    seen = []

    def look(done, total):
        seen.append(count_threads())

    with threadpool_limits(limits=2, user_api="blas"):
        before = count_threads()
        measure_session(session, jobs=1, progress=look)
        assert count_threads() == before
    assert max(before) == 2
    assert {threads for counts in seen for threads in counts} == {1}


def count_threads():
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.long
def test_a_script_without_a_main_guard_may_measure_over_processes(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    script = tmp_path / "script.py"
    script.write_text(
        SCRIPT.format(plan=str(tmp_path / "plan.toml"), session=str(tmp_path / "session"))
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    # a worker that loaded the script again would say so
    assert done.stdout == "loaded\n18 18\n"


def test_an_excluded_trial_keeps_its_row_its_conditions_and_its_reason(session):
    (session / "traces" / "0003.csv").unlink()
    table = measure_session(session, jobs=1)
    row = table[table.status == "excluded"].iloc[0]
    assert (row.trial, row.block, row.reason) == (
        "3",
        "step-020",
        "missing: there is no traces/0003.csv",
    )
    assert row[list(FEATURE_COLUMNS)].isna().all()


def test_nothing_in_the_table_of_features_is_a_formula_to_a_spreadsheet(session):
    trials = session / "trials.csv"
    trials.write_text(
        trials.read_text().replace("operator", "@operator").replace("\n3,", "\n=cmd|x,")
    )
    table = measure_session(session, jobs=1)
    # origin: OWASP, CSV injection: an apostrophe before what begins with =, +, -, @, a tab or a
    # return
    assert table.trial[2] == "'=cmd|x"
    assert "'@operator" in table
    assert {name[0] for name in table.columns} & set("=+-@\t\r") == set()


def test_a_block_column_that_a_spreadsheet_would_run_is_still_the_block(session):
    trials, said = session / "trials.csv", session / "session.toml"
    trials.write_text(trials.read_text().replace("block", "=block", 1))
    said.write_text(said.read_text() + '\n[trials]\ncolumns = { block = "=block" }\n')
    table = replace_columns_by_conditions(
        measure_session(session, jobs=1), read_conditions(open_session(session))
    )
    assert set(table.block) == {"step-020", "step-040"}
    assert "'=block" not in table


def test_progress_is_reported_trial_by_trial(session, tmp_path):
    told = []
    measure_session_to_file(
        session, tmp_path / "f.csv", jobs=1, progress=lambda done, total: told.append((done, total))
    )
    assert told == [(n, 6) for n in range(1, 7)]


@pytest.mark.parametrize("jobs", [0, -1, 257])
def test_the_number_of_processes_has_bounds(jobs, session, tmp_path):
    with pytest.raises(PipelineError, match="`jobs` must lie between 1 and 256"):
        measure_session_to_file(session, tmp_path / "f.csv", jobs=jobs)


def test_an_output_that_cannot_be_is_refused_before_anything_is_measured(session, tmp_path):
    with pytest.raises(PipelineError, match="output must be a file, got the folder"):
        measure_session_to_file(session, tmp_path)


def test_the_folder_of_the_output_is_made_where_there_is_none(session, tmp_path):
    measure_session_to_file(session, tmp_path / "new" / "features" / "f.csv", jobs=1)
    assert len((tmp_path / "new" / "features" / "f.csv").read_text().splitlines()) == 7


def test_the_tool_is_the_median_of_trials_that_show_it_clearly():
    def row(frequency, decay, doubt=1e-4):
        stds = {
            "ring_frequency_std_hz": doubt * frequency,
            "decay_time_std_s": 10.0 * doubt * decay,
        }
        return {"ring_frequency_hz": frequency, "decay_time_s": decay, **stds}

    clear = [row(300.0, 14e-3), row(301.0, 15e-3), row(290.0, 16e-3)]
    doubtful = [row(120.0, 1e-3, doubt=0.1)] * 9
    assert estimate_tool_from_features([*clear, *doubtful]) == (300.0, 15e-3)
    assert estimate_tool_from_features([*clear[:2], *doubtful]) is None
