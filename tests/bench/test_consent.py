"""What a user says of single trials in session.toml: left out, or records exchanged.

The records come from the virtual bench, whose contact and integrator are not the program's.
"""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session
from stepblocks.errors import BenchError

_MARKS = ["peak_force_n", "sliding_friction", "normal_load_n", "vibration_energy_j"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A session of 24 trials as its log should be, and its features."""
    folder = tmp_path_factory.mktemp("consent") / "session"
    heights, loads, speeds = (20e-6, 40e-6, 60e-6), (0.5, 0.8), (5e-3, 20e-3)
    plan = Plan(Bench(conversion=0.2), 24, heights, loads, speeds, scans=False)
    write_session(folder, plan, 3)
    return folder, measure_session(folder, jobs=1)


@pytest.fixture
def session(whole, tmp_path):
    """A copy of that session to change."""
    return Path(shutil.copytree(whole[0], tmp_path / "session"))


@pytest.fixture
def exchanged(whole, session):
    """The copy with the rows of two trials exchanged in its log, and these two."""
    features = whole[1]
    far = (features["load_n"] != features["load_n"][0]) & (
        features["speed_mm_s"] != features["speed_mm_s"][0]
    )
    pair = [0, int(far.idxmax())]
    table = pd.read_csv(session / "trials.csv", dtype=str)
    conditions = [name for name in table if name not in ("trial", "run_order")]
    table.loc[pair, conditions] = table.loc[pair[::-1], conditions].to_numpy()
    table.to_csv(session / "trials.csv", index=False)
    return pair, ", ".join(table["trial"][pair])


def _declare(folder, line):
    path = folder / "session.toml"
    path.write_text(path.read_text().replace("[acquisition]", f"[trials]\n{line}\n[acquisition]"))


@pytest.mark.long
def test_exchanged_rows_are_flagged_and_the_finding_says_what_swap_and_exclude_would_change(
    session, exchanged
):
    pair, names = exchanged
    features = measure_session(session, jobs=1)
    assert features.index[features["status"] == "flagged"].tolist() == pair
    assert (features["status"].drop(pair) == "ok").all()
    for row in pair:
        said = features["reason"][row]
        shown, written = map(float, re.findall(r"is ([\d.]+) N", said))
        assert shown == pytest.approx(features["load_n"][sum(pair) - row], rel=0.05)
        assert written == features["load_n"][row]
        assert said.endswith(
            f"exchanged rows? in [trials] of session.toml `swap = [[{names}]]` makes load and ramp "
            f"agree, `exclude = [{names}]` leaves both out"
        )


def test_swapped_trials_show_what_the_session_would_show_in_order(whole, session, exchanged):
    pair, names = exchanged
    _declare(session, f"swap = [[{names}]]")
    features = measure_session(session, jobs=1)
    assert (features["status"] == "ok").all()
    # each record stands with its own conditions again; the rows of the log keep their places
    columns = ["block", "load_n", *_MARKS]
    found, right = features.loc[pair, columns], whole[1].loc[pair[::-1], columns]
    pd.testing.assert_frame_equal(
        found.reset_index(drop=True), right.reset_index(drop=True), rtol=1e-3
    )


@pytest.mark.long
def test_excluded_trials_are_left_out_and_change_no_other_row(whole, session):
    _declare(session, "exclude = [2, 7]")
    before, after = whole[1], measure_session(session, jobs=1)
    out = after["trial"].astype(int).isin([2, 7])
    assert set(after["status"][out]) == {"excluded"}
    assert set(after["reason"][out]) == {"left out by `trials.exclude` of session.toml"}
    assert after[out][_MARKS].isna().all(axis=None)
    # what tells of the tool comes from other trials now, which moves a fit of the ring by little
    pd.testing.assert_frame_equal(after[~out][_MARKS], before[~out][_MARKS], rtol=0.01)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("swap = [[1, 2], [2, 3]]", r"none of them in two pairs, got \[\[1, 2\], \[2, 3\]\]"),
        ("swap = [[1, 1]]", r"must be pairs of two trials, none of them in two .* \[\[1, 1\]\]"),
        ("swap = [1, 2]", "trials.swap.0: input should be a list in square brackets, got 1"),
        ("exclude = 1", "trials.exclude: input should be a list in square brackets, got 1"),
    ],
)
def test_an_exchange_in_which_no_trial_has_one_record_is_refused(session, line, said):
    # of 1 with 2 and 2 with 3 the record of 2 stood for two trials, and that of 3 for none
    _declare(session, line)
    with pytest.raises(BenchError, match=said) as refused:
        measure_session(session, jobs=1)
    assert "session.toml" in str(refused.value)


@pytest.mark.parametrize("line", ["exclude = [99]", "swap = [[1, 99]]"])
def test_a_trial_that_the_table_does_not_hold_is_refused(session, line):
    _declare(session, line)
    with pytest.raises(
        BenchError, match=r"must name trials of the table, got 99 \[.*session\.toml"
    ):
        measure_session(session, jobs=1)


def test_all_that_is_wrong_with_exclude_and_swap_is_said_at_once(session):
    _declare(session, "exclude = [99]\nswap = [[1, 2], [2, 98]]")
    with pytest.raises(BenchError, match=r"^3 mistakes \[.*session\.toml") as refused:
        measure_session(session, jobs=1)
    assert str(refused.value).splitlines()[1:] == [
        "  `trials.exclude` and `trials.swap` must name trials of the table, got 99",
        "  `trials.exclude` and `trials.swap` must name trials of the table, got 98",
        "  `trials.swap` must be pairs of two trials, none of them in two pairs, got "
        "[[1, 2], [2, 98]]",
    ]
