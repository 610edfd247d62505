"""A session that contradicts session.toml as a whole is refused, and the likely slip is named."""

import shutil

import numpy as np
import pandas as pd
import pytest

from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session, measure_session_to_file
from stepblocks.errors import BenchError, PipelineError
from stepblocks.loop.run import loop_session

CHANNELS = 'tangential = "fx_n", normal = "fy_n"'


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("declared") / "session"
    plan = Plan(
        bench=Bench(conversion=0.2),
        trials=9,
        heights=(20e-6, 40e-6, 60e-6),
        loads=(0.5, 0.8),
        speeds=(5e-3, 10e-3),
        scans=False,
    )
    write_session(folder, plan, 3)
    return folder


@pytest.fixture
def session(whole):
    path = whole / "session.toml"
    declared = path.read_text()
    yield whole, path, declared
    path.write_text(declared)


def test_a_session_that_agrees_is_measured(session):
    assert (measure_session(session[0], jobs=1)["status"] == "ok").all()


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("old", "new", "slip"),
    [
        ('"fx_n"', '{ column = "fx_n", factor = -1.0 }', "sign of `acquisition.channels.tangent"),
        ('"fy_n"', '{ column = "fy_n", factor = -1.0 }', "sign of `acquisition.channels.normal"),
        (CHANNELS, 'tangential = "fy_n", normal = "fx_n"', "normal are exchanged"),
        ('"fx_n"', '{ column = "fx_n", factor = 3.0 }', "tangential.factor` is 3 times the right"),
        ('"fy_n"', '{ column = "fy_n", factor = 3.0 }', "normal force is 3 times the load"),
        ("9810.0 N/m", "98100 N/m", "one of them is 10 times the right one"),
        (
            "[stimuli]",
            '[trials.columns]\nspeed = { column = "speed_mm_s", unit = "m/s" }\n[stimuli]',
            "unit of `trials.columns.speed`, which is 1000 times the right one",
        ),
    ],
)
def test_each_slip_is_refused_before_the_session_is_measured(session, old, new, slip):
    folder, path, declared = session
    assert old in declared
    path.write_text(declared.replace(old, new))
    with pytest.raises(BenchError, match=slip):
        measure_session(folder, jobs=1)


@pytest.mark.long
@pytest.mark.parametrize(("declared_rate", "times"), [("5 kHz", "0.5"), ("20 kHz", "2")])
def test_a_rate_that_is_off_by_two_is_named_with_the_ring_that_speaks_for_it(
    session, declared_rate, times
):
    # origin: the bench records 300 Hz at 10 kHz; a slope per second goes with the declared rate
    folder, path, declared = session
    without_clock = declared.replace('time = "time_s", ', "").replace("10 kHz", declared_rate)
    assert without_clock.count(declared_rate) == 1
    path.write_text(without_clock)
    slip = rf"`acquisition.sample_rate` is {times} times the right one, for which the ring speaks"
    with pytest.raises(BenchError, match=slip):
        measure_session(folder, jobs=1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "slip"),
    [
        ("gain3", "tangential.factor` is 3 times the right one"),
        ("k10", "`probe.spring_constant` is 98.1 N/mm: .* 10 times the right one"),
        ("nofactor", "tangential.factor` must say what a volt is"),
        ("rate10", r"increment of 50 us \(20000 Hz\), `acquisition.sample_rate` is 10000 Hz"),
        ("signT", "sign of `acquisition.channels.tangential.factor` is reversed"),
        ("speedm", "unit of `trials.columns.speed`, which is 1000 times the right one"),
        ("swap", "tangential and normal are exchanged"),
    ],
)
@pytest.mark.filterwarnings("ignore::stepblocks.errors.ReadingWarning")
def test_each_slip_of_an_engineer_s_records_is_refused_and_no_table_is_written(
    shared_bench, tmp_path, name, slip
):
    # the README of these records tells the slip of each
    with pytest.raises(BenchError, match=slip):
        measure_session_to_file(
            shared_bench / "lab" / "slips" / name, tmp_path / "features.csv", jobs=1
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_slip_is_said_before_heights_that_are_missing(session, tmp_path, monkeypatch):
    folder, _, declared = session
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    table = pd.read_csv(copy / "trials.csv").drop(columns="height_um")
    table.to_csv(copy / "trials.csv", index=False)
    monkeypatch.chdir(tmp_path)  # no stimulus set lies here
    with pytest.raises(BenchError, match="must have a column 'height_um'"):
        loop_session(copy)
    (copy / "session.toml").write_text(
        declared.replace('"fx_n"', '{ column = "fx_n", factor = 3.0 }')
    )
    with pytest.raises(BenchError, match=r"or `acquisition.channels.tangential.factor` is 3 times"):
        loop_session(copy)


def test_a_radius_that_the_labels_of_the_tips_contradict_is_refused_before_the_session(session):
    folder, path, declared = session
    assert 'tip_radius = "125 um"' in declared
    path.write_text(declared.replace('tip_radius = "125 um"', 'tip_radius = "62 um"'))
    told = []
    with pytest.raises(PipelineError, match=r"62 um: their labels say 125 um; .*trials.csv"):
        measure_session(folder, jobs=1, progress=lambda done, _: told.append(done))
    assert not told


def test_a_rate_that_contradicts_the_increment_of_the_file_is_refused(tmp_path):
    import h5py

    (tmp_path / "session.toml").write_text(
        'schema = 1\n[probe]\nspring_constant = "9810 N/m"\n[acquisition]\nsample_rate = "10 kHz"\n'
        'traces = "all.h5"\nchannels = { tangential = "x", normal = "y" }\n'
    )
    (tmp_path / "trials.csv").write_text("trial\n1\n2\n3\n")
    with h5py.File(tmp_path / "all.h5", "w") as file:
        for trial in "123":
            group = file.create_group(trial)
            group["x"], group["y"] = np.zeros(500), np.ones(500)
            group.attrs["dt"] = 5e-5
    with pytest.raises(BenchError, match=r"increment of 50 us \(20000 Hz\)"):
        measure_session(tmp_path, jobs=1)


def test_a_column_that_says_volts_needs_to_say_what_a_volt_is(session):
    folder, path, declared = session
    path.write_text(declared.replace('"fx_n"', '"Fx tip (V)"'))
    with pytest.raises(BenchError, match="must say what a volt is"):
        measure_session(folder, jobs=1)
