"""Conditions under any names and units, gauges in volts, and one long record of many drags."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from oracles.virtual_bench import Bench, drag
from stepblocks.bench.conditions import read_conditions, replace_columns_by_conditions
from stepblocks.bench.figures import draw_trials
from stepblocks.bench.measure import measure_session
from stepblocks.bench.session import open_session
from stepblocks.bench.traces import Traces
from stepblocks.cli import main
from stepblocks.errors import BenchError

STIMULI = Path(__file__).parents[2] / "stimuli" / "paper-ten.toml"


def rewrite(session, table, columns, decimal=".", delimiter=",", more=""):
    table.to_csv(session / "trials.csv", index=False, decimal=decimal, sep=delimiter)
    path = session / "session.toml"
    told = (
        f'[trials]\ndecimal = "{decimal}"\ndelimiter = '
        f'"{delimiter}"\n[trials.columns]\n{columns}\n{more}'
    )
    path.write_text(path.read_text() + told)


def features_of(session):
    declared = open_session(session)
    return replace_columns_by_conditions(
        measure_session(session, jobs=1), read_conditions(declared)
    )


def test_a_table_in_the_usual_words_stays_as_it_is(session):
    assert read_conditions(open_session(session)) == {}
    plain = measure_session(session, jobs=1)
    pd.testing.assert_frame_equal(replace_columns_by_conditions(plain, {}), plain)


def test_other_names_units_decimal_commas_and_stamps_come_to_the_same_conditions(session):
    usual = measure_session(session, jobs=1)
    table = pd.read_csv(session / "trials.csv")
    other = pd.DataFrame(
        {
            "run": table.trial,
            "specimen": table.block,
            "step_height_mm": table.height_um / 1e3,
            # origin: standard gravity
            "weight_g": (table.load_n / 9.80665e-3).round(9),
            "v": table.speed_mm_s / 1e3,
            "taken": [f"2026-03-01 10:{5 + n:02d}:30" for n in range(len(table))],
            "temperature_c": 21.5 + 0.25 * np.arange(len(table)),
        }
    )
    columns = (
        'trial = "run"\nblock = "specimen"\nload = "weight_g"\nspeed = { column = "v", unit = '
        '"m/s" }'
    )
    rewrite(session, other, columns, ",", ";")
    found = features_of(session)
    for name in ("load_n", "speed_mm_s", "height_um"):
        np.testing.assert_allclose(found[name], usual[name], rtol=1e-8)
    assert list(found.block) == list(usual.block)
    np.testing.assert_allclose(found.taken_elapsed_s, 60.0 * np.arange(len(table)))
    np.testing.assert_allclose(found.temperature_c, other.temperature_c)
    assert {"specimen", "weight_g", "v", "step_height_mm", "taken"}.isdisjoint(found.columns)
    np.testing.assert_allclose(found.peak_force_n, usual.peak_force_n)


def test_heights_come_from_the_stimulus_set_where_the_table_has_none(session):
    table = pd.read_csv(session / "trials.csv")
    table.drop(columns="height_um").to_csv(session / "trials.csv", index=False)
    with pytest.raises(
        BenchError, match="must have a column 'height_um' or another length that begins with height"
    ):
        read_conditions(open_session(session))
    shutil.copy(STIMULI, session)
    path = session / "session.toml"
    path.write_text(path.read_text() + '[stimuli]\nset = "paper-ten"\nfile = "paper-ten.toml"\n')
    np.testing.assert_allclose(features_of(session).height_um, table.height_um)


def test_loop_says_what_is_missing_before_it_measures(session, tmp_path, capsys):
    table = pd.read_csv(session / "trials.csv").rename(columns={"block": "specimen"})
    table.to_csv(session / "trials.csv", index=False)
    assert main(["loop", str(session), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "must have a column 'block' for the block, it has 'trial', 'specimen'" in said
    assert "measured" not in said


def channels(session, text):
    path = session / "session.toml"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("channels")]
    path.write_text("\n".join(lines) + f"\n[acquisition.channels]\ntime = 'time_s'\n{text}\n")


def test_a_gauge_in_volts_with_offset_and_tare_comes_to_newtons(session):
    forces = Traces(open_session(session)).read("2")
    path = session / "traces" / "0002.csv"
    trace = pd.read_csv(path)
    trace["u_v"], trace["w_mv"] = trace.fx_n / 2.35 + 0.12, 1e3 * (trace.fy_n + 0.05) / -4.0
    trace.to_csv(path, index=False)
    channels(
        session,
        'tangential = { column = "u_v", factor = "2.35 N/V", offset = "0.12 V" }\n'
        'normal = { column = "w_mv", factor = "-4 N/V", offset = "50 mN" }',
    )
    volts = Traces(open_session(session)).read("2")
    np.testing.assert_allclose(volts.tangential, forces.tangential, atol=1e-9)
    np.testing.assert_allclose(volts.normal, forces.normal, atol=1e-9)


def test_a_tare_is_the_mean_of_the_first_part(session):
    forces = Traces(open_session(session)).read("1")
    channels(session, 'tangential = { column = "fx_n", tare = "first 10 ms" }\nnormal = "fy_n"')
    tared = Traces(open_session(session)).read("1")
    np.testing.assert_allclose(tared.tangential, forces.tangential - forces.tangential[:100].mean())
    np.testing.assert_allclose(tared.normal, forces.normal)


@pytest.mark.parametrize(
    ("channel", "said"),
    [
        ('{ column = "u_v" }', "`acquisition.channels.tangential.factor` must say what a volt is"),
        (
            '{ column = "u", factor = "2 N" }',
            "must be a number, or a force per volt such as '2.35 N/V'",
        ),
        ('{ column = "fx_n", tare = "0.1 s" }', "must say how long, such as 'first 0.1 s'"),
        (
            '{ column = "fx_n", offset = "3 um" }',
            "`acquisition.channels.tangential.offset` must be a force",
        ),
    ],
)
def test_a_gauge_that_is_declared_wrongly_is_refused_in_one_line(channel, said, session):
    channels(session, f'tangential = {channel}\nnormal = "fy_n"')
    with pytest.raises(BenchError) as error:
        open_session(session)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.long
@pytest.mark.parametrize("unloaded", [0.0, 0.06])
def test_one_long_record_is_cut_into_its_drags_and_the_cuts_are_drawn(unloaded, session, tmp_path):
    # a step of one block after the other under two loads, the tip lifted between the drags or not
    table, pieces, peaks = pd.read_csv(session / "trials.csv"), [], []
    for n, row in enumerate(table.itertuples()):
        bench = Bench(unloaded=unloaded, conversion=0.2)
        made = drag(
            bench, row.height_um * 1e-6, 0.8, row.speed_mm_s * 1e-3, np.random.default_rng(n)
        )
        pieces.append(np.column_stack(made[1:3]))
        peaks.append(made[3]["peak_n"])
    table.assign(load_n=0.8).to_csv(session / "trials.csv", index=False)
    np.savetxt(
        session / "long.csv",
        np.vstack(pieces),
        delimiter=",",
        header="fx_n,fy_n",
        comments="",
        fmt="%.5f",
    )
    path = session / "session.toml"
    text = (
        path.read_text()
        .replace("traces/{trial:04d}.csv", "long.csv")
        .replace('time = "time_s", ', "")
    )
    path.write_text(text.replace("[acquisition]", '[acquisition]\nsplit = "drags"'))
    found = measure_session(session, jobs=1)
    assert set(found.status) == {"ok"}
    np.testing.assert_allclose(found.peak_force_n, peaks, rtol=0.02)
    drawn = draw_trials(session, tmp_path / "plots", ["1"])
    assert [one.name for one in drawn] == ["cuts.png", "trial-1.png"]
    pd.concat([table, table.tail(1).assign(trial=99)]).to_csv(session / "trials.csv", index=False)
    with pytest.raises(
        BenchError,
        match="one drag for each of the 7 trials of the table, the record shows 6 releases",
    ):
        measure_session(session, jobs=1)
