"""Thirty kinds of damaged sessions.

Each ends in one clear line or in a reasoned exclusion, and the rest goes on.
"""

import csv
import shutil

import h5py
import numpy as np
import pandas as pd
import pytest

from oracles.trace_files import turned
from stepblocks.bench.measure import measure_session_to_file
from stepblocks.cli import main
from stepblocks.errors import StepblocksError


def run(folder, tmp_path):
    output = tmp_path / "features.csv"
    summary = measure_session_to_file(folder, output, jobs=1)
    with output.open(newline="") as file:
        return summary, list(csv.DictReader(file))


def edit(path, old, new, count=-1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def change_trace(folder, change, trial=3):
    path = folder / "traces" / f"{trial:04d}.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)


def set_rows(folder, change):
    path = folder / "trials.csv"
    change(pd.read_csv(path, dtype=str)).to_csv(path, index=False)


def with_nan(table):
    table.loc[100:102, "fx_n"] = np.nan
    return table


def clipped(table):
    table["fx_n"] = table["fx_n"].clip(upper=0.8 * table["fx_n"].max())
    return table


def stopped(table):
    return table.iloc[: int(table["fx_n"].argmax()) - 5]


def cut_after_slip(table):
    return table.iloc[: int(table["fx_n"].argmax()) + 20]


def frozen(table):
    table["fx_n"] = 0.12
    return table


def backwards(table):
    table.loc[50, "time_s"] = 0.0
    return table


def gap(table):
    return table.drop(index=range(100, 130))


SESSION_DAMAGE = {
    "no folder": (lambda f: shutil.rmtree(f), "must be a folder"),
    "no session.toml": (lambda f: (f / "session.toml").unlink(), "a folder with a session.toml"),
    "session.toml is no TOML": (lambda f: (f / "session.toml").write_text("= ="), "must be TOML"),
    "session.toml without a probe": (
        lambda f: edit(f / "session.toml", "[probe]", "[notes.probe]"),
        "probe is missing",
    ),
    "spring constant without unit": (
        lambda f: edit(f / "session.toml", '"9810 N/m"', "9810"),
        "spring_constant",
    ),
    "sample rate is a length": (
        lambda f: edit(f / "session.toml", "10 kHz", "10 mm"),
        "sample_rate",
    ),
    "no normal channel declared": (
        lambda f: edit(f / "session.toml", ', normal = "fy_n"', ""),
        "channels.normal",
    ),
    "a misspelt channel": (
        lambda f: edit(f / "session.toml", "normal =", "norml ="),
        "norml|channels.normal",
    ),
    "unknown format": (lambda f: edit(f / "session.toml", ".csv", ".xyz"), "acquisition.format"),
    "code in the pattern": (
        lambda f: edit(f / "session.toml", "{trial:04d}", "{trial.__class__}"),
        "no other braces",
    ),
    "traces outside the session": (
        lambda f: edit(f / "session.toml", "traces/", "../traces/"),
        "inside the session",
    ),
    "a table with a name of 5,000 letters": (
        lambda f: edit(
            f / "session.toml", "[probe]", f'[trials]\nfile = "{"a" * 5000}.csv"\n[probe]', 1
        ),
        "table of trials is missing",
    ),
    "no trials.csv": (lambda f: (f / "trials.csv").unlink(), "table of trials is missing"),
    "empty trials.csv": (lambda f: (f / "trials.csv").write_text(""), "is empty"),
    "trials.csv without rows": (
        lambda f: (f / "trials.csv").write_text("trial,load_n\n"),
        "has no rows",
    ),
    "trials.csv is binary": (
        lambda f: (f / "trials.csv").write_bytes(b"\xff\xfe\x00\x01" * 50),
        "must have a column 'trial'",
    ),
    "no trial column": (
        lambda f: edit(f / "trials.csv", "trial,", "id,", 1),
        "must have a column 'trial'",
    ),
    "a column twice": (
        lambda f: edit(f / "trials.csv", "operator", "block", 1),
        "must not name a column twice, got 'block'",
    ),
    "a column named like a feature": (
        lambda f: edit(f / "trials.csv", "operator", "peak_force_n"),
        "name that features use",
    ),
    "all traces missing": (
        lambda f: shutil.rmtree(f / "traces"),
        "no trial of 6 could be measured",
    ),
    "unknown channel": (
        lambda f: edit(f / "session.toml", '"fx_n"', '"force"'),
        r"6 times unknown channel: .* no 'force'.* it has .*fx_n",
    ),
    "sample rate of another session": (
        lambda f: edit(f / "session.toml", "10 kHz", "20 kHz"),
        "wrong rate",
    ),
    "normal channel in other units": (
        lambda f: edit(
            f / "session.toml", 'normal = "fy_n"', 'normal = { column = "fy_n", unit = "mN" }'
        ),
        "units",
    ),
}


@pytest.mark.repeats
@pytest.mark.parametrize("name", SESSION_DAMAGE)
def test_a_session_that_cannot_be_read_ends_in_one_line(name, session, tmp_path, capsys):
    damage, message = SESSION_DAMAGE[name]
    damage(session)
    with pytest.raises(StepblocksError, match=message) as caught:
        measure_session_to_file(session, tmp_path / "out.csv", jobs=1)
    assert "\n" not in str(caught.value)
    assert (
        main(["measure", str(session), "-o", str(tmp_path / "out.csv"), "--jobs", "1", "--quiet"])
        == 2
    )
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out.csv").exists()


TRIAL_DAMAGE = {
    "missing trace": (lambda f: (f / "traces/0003.csv").unlink(), "missing"),
    "a name too long for a file": (
        lambda f: (
            edit(f / "session.toml", "{trial:04d}", "000{trial}"),
            edit(f / "trials.csv", "\n3,", f"\n{'a' * 5000},"),
        ),
        "missing: there is no",
    ),
    "a name of 5,000 letters": (
        lambda f: edit(f / "trials.csv", "\n3,", f"\n{'a' * 5000},"),
        "is no whole number",
    ),
    "a name of 5,000 digits": (
        lambda f: edit(f / "trials.csv", "\n3,", f"\n{'9' * 5000},"),
        "is no whole number",
    ),
    "empty file": (lambda f: (f / "traces/0003.csv").write_text(""), "unreadable"),
    "header only": (
        lambda f: (f / "traces/0003.csv").write_text("time_s,fx_n,fy_n\n"),
        "truncated|no numbers|no samples",
    ),
    "text among numbers": (
        lambda f: edit(f / "traces/0003.csv", "0.0100", "oops", 1),
        "must be a number, got 'oops",
    ),
    "another header": (lambda f: edit(f / "traces/0003.csv", "fx_n", "force"), "unknown channel"),
    "not-a-number": (lambda f: change_trace(f, with_nan), "not-a-number: 3 of"),
    "saturated": (lambda f: change_trace(f, clipped), "saturated"),
    "recording stopped before the slip": (
        lambda f: change_trace(f, stopped),
        "no release|truncated",
    ),
    "recording stopped after the slip": (lambda f: change_trace(f, cut_after_slip), "truncated"),
    "few samples": (lambda f: change_trace(f, lambda t: t.iloc[:100]), "truncated"),
    "half the rate": (lambda f: change_trace(f, lambda t: t.iloc[::2]), "wrong rate"),
    "clock runs back": (lambda f: change_trace(f, backwards), "wrong clock"),
    "samples lost": (lambda f: change_trace(f, gap), "gap"),
    "dead channel": (lambda f: change_trace(f, frozen), "dead channel"),
    "forces in another unit": (
        lambda f: change_trace(f, lambda t: t.assign(fy_n=1e3 * t.fy_n)),
        "units changed",
    ),
    "no slip": (
        lambda f: change_trace(f, lambda t: t.assign(fx_n=0.1 + 0.001 * np.sin(t.time_s * 3e4))),
        "no slip",
    ),
    "a row with a cell too few": (
        lambda f: edit(f / "trials.csv", "3,step-020,20,0.8,5.0,A", "3,step-020,20"),
        "cells",
    ),
    "speed is text": (
        lambda f: edit(f / "trials.csv", "0.8,5.0,A", "0.8,fast,A", 1),
        "speed_mm_s must be a number",
    ),
    "load is negative": (
        lambda f: edit(f / "trials.csv", "20,0.8,5.0", "20,-0.8,5.0"),
        "load_n must be positive",
    ),
    "trial without a name": (lambda f: edit(f / "trials.csv", "\n3,", "\n,"), "names no trial"),
    "load of another trial": (
        lambda f: edit(f / "trials.csv", "20,0.8,5.0", "20,0.3,5.0"),
        "mislabelled: the normal",
    ),
    "speed of another trial": (
        lambda f: edit(f / "trials.csv", "20,0.8,5.0", "20,0.8,20.0"),
        "mislabelled: the ramp",
    ),
}


@pytest.mark.repeats
@pytest.mark.parametrize("name", TRIAL_DAMAGE)
def test_a_damaged_trial_is_reported_with_its_reason_and_the_rest_goes_on(name, session, tmp_path):
    damage, reason = TRIAL_DAMAGE[name]
    damage(session)
    summary, rows = run(session, tmp_path)
    bad = [row for row in rows if row["status"] != "ok"]
    assert len(bad) == 1
    assert pd.Series(bad[0]["reason"]).str.contains(reason).all(), bad[0]["reason"]
    # what may carry an effect stays in the table: a label that does not fit, a force that reached
    # the end of its range
    status = {"saturated": "censored", "recording stopped before the slip": "censored"}.get(
        name, "excluded"
    )
    status = "flagged" if "of another trial" in name else status
    assert bad[0]["status"] == status
    assert summary.excluded == (status == "excluded")
    assert (bad[0]["peak_force_n"] == "") == (status == "excluded")
    assert (bad[0]["vibration_energy_j"] == "") == (status != "flagged")
    assert all(row["peak_force_n"] for row in rows if row["status"] == "ok")


def test_a_trial_named_twice_with_other_conditions_is_out_both_times(session, tmp_path):
    edit(session / "trials.csv", "\n4,", "\n3,")
    _, rows = run(session, tmp_path)
    reasons = [row["reason"] for row in rows if row["status"] != "ok"]
    assert reasons == ["duplicate: another row has this trial with other conditions"] * 2


def test_a_row_that_stands_twice_counts_once(session, tmp_path):
    path = session / "trials.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[-1]]) + "\n")
    summary, rows = run(session, tmp_path)
    assert summary.excluded == 1
    assert rows[-1]["reason"].startswith("duplicate: an earlier row")


def test_the_same_samples_under_two_trials_are_out_both_times(session, tmp_path):
    # trials 1 and 1' have the same conditions, so nothing else could tell
    set_rows(
        session,
        lambda t: t.assign(load_n="0.5", speed_mm_s="5.0", block="step-020", height_um="20"),
    )
    for trial in (2, 3, 4, 5, 6):
        shutil.copy(session / "traces/0001.csv", session / f"traces/{trial:04d}.csv")
        change_trace(
            session,
            lambda t, trial=trial: t.assign(fx_n=t.fx_n + 1e-4 * (trial if trial != 6 else 5)),
            trial,
        )
    _, rows = run(session, tmp_path)
    assert [
        row["trial"] for row in rows if row["reason"].startswith("duplicate: the same samples")
    ] == ["5", "6"]


@pytest.mark.long
def test_a_trace_of_another_block_is_found_by_its_angle(make_session, tmp_path):
    folder = make_session(tmp_path / "s", count=36)
    rows = pd.read_csv(folder / "trials.csv", dtype=str)
    (low,) = rows.index[
        (rows.block == "step-020") & (rows.load_n == "0.5") & (rows.speed_mm_s == "5.0")
    ][:1]
    rows.loc[low, ["block", "height_um"]] = ["step-060", "60"]
    rows.to_csv(folder / "trials.csv", index=False)
    _, found = run(folder, tmp_path)
    bad = [row for row in found if row["status"] != "ok"]
    assert [row["trial"] for row in bad] == [str(low + 1)]
    assert "forces are those of block step-020, the row says step-060" in bad[0]["reason"]


def test_a_session_of_one_block_or_one_speed_is_measured_and_said_to_be_so(make_session, tmp_path):
    folder = make_session(tmp_path / "s", count=6)
    rows = pd.read_csv(folder / "trials.csv", dtype=str)
    rows[(rows.speed_mm_s == "5.0") & (rows.block == "step-020")].to_csv(
        folder / "trials.csv", index=False
    )
    summary, found = run(folder, tmp_path)
    assert summary.excluded == 0
    assert found
    assert {"all trials have one block", "all trials have one speed"} <= set(summary.notes)


@pytest.mark.parametrize("kind", ["hdf5", "tdms", "mat"])
def test_a_container_that_is_cut_off_or_missing_is_one_clear_error(kind, make_session, tmp_path):
    folder = turned(make_session(tmp_path / "s", kind="hdf5"), kind)
    (path,) = folder.glob("traces.*")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3] if kind != "tdms" else b"nonsense" * 40)
    with pytest.raises(StepblocksError, match=r"traces cannot be read|no trial of"):
        measure_session_to_file(folder, tmp_path / "out.csv", jobs=1)
    path.unlink()
    with pytest.raises(StepblocksError, match="traces are missing"):
        measure_session_to_file(folder, tmp_path / "out.csv", jobs=1)


def test_a_damaged_group_of_an_hdf5_file_costs_its_own_trial(make_session, tmp_path):
    folder = make_session(tmp_path / "s", kind="hdf5")
    (path,) = folder.glob("traces.*")
    with h5py.File(path) as file:
        group = next(one for name, one in file.items() if name.endswith("3"))
        at = h5py.h5o.get_info(group.id).addr
    data = bytearray(path.read_bytes())
    data[at : at + 16] = b"\xff" * 16  # the header of its object
    path.write_bytes(data)
    summary, rows = run(folder, tmp_path)
    assert summary.excluded == 1
    assert [row["trial"] for row in rows if row["status"] != "ok"] == ["3"]


def test_nothing_of_the_users_is_written_to(session, tmp_path):
    before = {path: path.read_bytes() for path in session.rglob("*") if path.is_file()}
    run(session, tmp_path)
    assert {path: path.read_bytes() for path in session.rglob("*") if path.is_file()} == before
    with pytest.raises(StepblocksError, match="must not replace a file of the session"):
        measure_session_to_file(session, session / "trials.csv", jobs=1)
