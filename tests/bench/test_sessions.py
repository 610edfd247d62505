"""Layouts: four formats say the same, any mapping is read, workers change nothing.

Shared sessions come out right.
"""

import time
import tomllib

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from oracles.trace_files import turned
from stepblocks.bench.measure import measure_session_to_file
from stepblocks.bench.session import open_session
from stepblocks.bench.signal.features import FEATURE_COLUMNS
from stepblocks.bench.traces import Traces
from stepblocks.cli import main
from stepblocks.rehearse.run import simulate_session

PLAN = """schema = 1
seed = 11
format = "{format}"
[design]
heights = ["20 um", "40 um", "60 um"]
loads = ["0.5 N", "1.1 N"]
speeds = ["5 mm/s", "20 mm/s"]
trials = {trials}
"""


def simulate(tmp_path, kind="hdf5", trials=12, extra=""):
    plan = tmp_path / f"plan-{kind}.toml"
    plan.write_text(PLAN.format(format=kind, trials=trials) + extra)
    simulate_session(plan, tmp_path / f"session-{kind}")
    return tmp_path / f"session-{kind}"


def measure(folder, tmp_path, jobs=1, name="features.csv"):
    measure_session_to_file(folder, tmp_path / name, jobs=jobs)
    return pd.read_csv(tmp_path / name)


@pytest.mark.long
def test_four_formats_of_one_session_say_the_same(tmp_path):
    tables = [
        measure(simulate(tmp_path, "csv"), tmp_path),
        measure(simulate(tmp_path, "hdf5"), tmp_path),
    ]
    for kind in ("tdms", "mat"):
        (tmp_path / kind).mkdir()
        tables.append(measure(turned(simulate(tmp_path / kind, "hdf5"), kind), tmp_path))
    for table in tables[1:]:
        # origin: float32 holds 7 digits, the forces of the CSV 6: mostly nothing against the noise,
        # and sometimes a tie for the highest sample falls the other way
        for name in ("peak_force_n", "ring_amplitude_n", "normal_load_n", "ring_frequency_hz"):
            std = name.replace("_n", "_std_n").replace("_hz", "_std_hz")
            assert (abs(table[name] - tables[0][name]) < 1.5 * table[std] + 1e-5).all(), name
            assert (abs(table[name] - tables[0][name]) < 0.02 * table[std] + 1e-5).mean() > 0.5, (
                name
            )
    assert list(tables[0].columns[:3]) == ["trial", "status", "reason"]
    assert tuple(tables[0].columns[-len(FEATURE_COLUMNS) :]) == FEATURE_COLUMNS


@pytest.mark.long
def test_any_number_of_workers_writes_the_same_bytes(tmp_path):
    folder = simulate(tmp_path, "hdf5", trials=20)  # a worker takes 16 at a time
    measure(folder, tmp_path, jobs=1, name="one.csv")
    measure(folder, tmp_path, jobs=2, name="two.csv")
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()


@pytest.mark.repeats
@pytest.mark.parametrize("kind", ["csv", "hdf5"])
def test_the_same_plan_gives_the_same_bytes(kind, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first = simulate(tmp_path / "a", kind)
    time.sleep(1.1)  # HDF5 counts time in seconds
    second = simulate(tmp_path / "b", kind)
    for path in sorted(first.rglob("*")):
        if path.is_file():
            assert path.read_bytes() == (second / path.relative_to(first)).read_bytes(), path.name


def test_a_laboratorys_own_names_units_and_separators_are_read(make_session, tmp_path):
    plain = make_session(tmp_path / "plain")
    own = tmp_path / "own"
    (own / "raw").mkdir(parents=True)
    for path in sorted((plain / "traces").iterdir()):
        table = pd.read_csv(path)
        mapped = pd.DataFrame(
            {"t/ms": table.time_s * 1e3, "Fx": -1e3 * table.fx_n, "Fz": table.fy_n}
        )
        text = mapped.to_csv(index=False, sep=";", decimal=",")
        (own / "raw" / f"run{int(path.stem)}.dat").write_text("Rig 3\n" + text)
    trials = pd.read_csv(plain / "trials.csv")
    renamed = trials.rename(columns={"trial": "Versuch", "speed_mm_s": "v", "load_n": "Last"})
    renamed.to_csv(own / "liste.txt", index=False, sep="\t")
    (own / "session.toml").write_text(
        """schema = 1
[probe]
spring_constant = "9.81 N/mm"
[acquisition]
sample_rate = "10 kHz"
traces = "raw/run{trial}.dat"
format = "csv"
delimiter = ";"
decimal = ","
skip_lines = 1
[acquisition.channels]
time = { column = "t/ms", unit = "ms" }
tangential = { column = "Fx", unit = "mN", factor = -1 }
normal = { column = "Fz", unit = "N" }
[trials]
file = "liste.txt"
delimiter = "\\t"
[trials.columns]
trial = "Versuch"
speed = { column = "v", unit = "mm/s" }
load = { column = "Last", unit = "N" }
"""
    )
    ours, theirs = measure(plain, tmp_path), measure(own, tmp_path)
    for name in (
        "peak_force_n",
        "ring_amplitude_n",
        "spring_constant_n_per_m",
        "normal_load_n",
        "decay_time_s",
    ):
        np.testing.assert_allclose(theirs[name], ours[name], rtol=2e-4)
    assert {"v", "Last"} <= set(theirs.columns)


def test_matrices_compound_tables_and_new_matlab_files_are_read(make_session, tmp_path):
    plain = make_session(tmp_path / "plain", count=2)
    session = open_session(plain)
    trace = Traces(session).read("2")
    table = np.column_stack([trace.time, trace.tangential, trace.normal])
    with h5py.File(tmp_path / "plain" / "compound.h5", "w") as file:
        kinds = [("t", "f8"), ("x", "f8"), ("y", "f8")]
        file["run 2"] = np.array([tuple(row) for row in table], dtype=kinds)
        file["matrix2"] = table
    savemat(tmp_path / "plain" / "old.mat", {"trial_2": table})
    with h5py.File(tmp_path / "plain" / "new.mat", "w", userblock_size=512) as file:
        for name, column in zip(("time_s", "fx_n", "fy_n"), table.T, strict=True):
            file[f"trial_2/{name}"] = column[None, :]
    text = (plain / "session.toml").read_text()
    named = 'channels = { time = "time_s", tangential = "fx_n", normal = "fy_n" }'
    compound = 'group = "run {trial}"\nchannels = { time = "t", tangential = "x", normal = "y" }'
    indexed = "channels = { time = 0, tangential = 1, normal = 2 }"
    for file_name, channels in (
        ("compound.h5", compound),
        ("compound.h5", f'group = "matrix{{trial}}"\n{indexed}'),
        ("old.mat", indexed),
        ("new.mat", named),
    ):
        (plain / "session.toml").write_text(
            text.replace("traces/{trial:04d}.csv", file_name).replace(named, channels)
        )
        with Traces(open_session(plain)) as traces:
            other = traces.read("2")
        np.testing.assert_array_equal(other.tangential, trace.tangential)
        np.testing.assert_array_equal(other.normal, trace.normal)


def test_without_a_time_channel_the_sample_rate_is_the_clock(make_session, tmp_path):
    folder = make_session(tmp_path / "s", count=2)
    text = (folder / "session.toml").read_text()
    before = measure(folder, tmp_path)
    (folder / "session.toml").write_text(text.replace('time = "time_s", ', ""))
    np.testing.assert_allclose(
        measure(folder, tmp_path).peak_force_n, before.peak_force_n, rtol=1e-6
    )


def test_a_planted_edge_radius_stands_in_the_forces_and_in_the_scans(tmp_path):
    effect = (
        '[scatter]\nheight = "0 um"\nfriction = 0\n[[effects]]\nslot = "contact_geometry"\nsize '
        "= 14e-6\n"
    )
    folder = simulate(tmp_path, trials=12, extra=effect)
    table = measure(folder, tmp_path)
    angle = np.arctan(table.peak_force_n / table.normal_load_n) - np.arctan(table.sliding_friction)
    # origin: 1 - cos a = H / (R + r), equation (2) with a rounded edge
    radius = table.height_um / (1.0 - np.cos(angle)) - 125.0
    assert np.median(radius) == pytest.approx(14.0, abs=1.0)
    scan = pd.read_csv(folder / "scans" / "step-040.csv")
    left, right = scan[scan.x_um < -50], scan[(scan.x_um > 50)]
    top = np.polyval(np.polyfit(right.x_um, right.z_um, 1), 0.0)
    assert top - np.polyval(np.polyfit(left.x_um, left.z_um, 1), 0.0) == pytest.approx(
        40.0, abs=0.2
    )
    # at x = r - r sqrt(1/2) the quarter circle has fallen by the same
    depth = 14.0 * (1.0 - np.sqrt(0.5))
    assert float(np.interp(depth, scan.x_um, scan.z_um)) == pytest.approx(top - depth, abs=0.4)


def test_locked_trials_are_left_out_and_reported(tmp_path):
    folder = simulate(tmp_path, extra="[model]\nfriction = 0.9\n")
    told = pd.read_csv(folder / "truth.csv")
    assert (told.status == "locked").any()
    assert len(pd.read_csv(folder / "trials.csv")) == (told.status == "ok").sum()


@pytest.mark.long
def test_the_drag_in_time_is_a_source_of_sessions_and_features_find_what_it_did(tmp_path):
    plan = tmp_path / "drag.toml"
    text = PLAN.format(format="hdf5", trials=12).replace("seed", 'source = "drag"\nseed')
    own = '[model]\ndecay_time = "21.2 ms"\n[scatter]\nheight = "0 um"\n'
    plan.write_text(text.replace("5 mm/s", "10 mm/s") + own)
    simulate_session(plan, tmp_path / "session")
    table = measure(tmp_path / "session", tmp_path)
    truth = pd.read_csv(tmp_path / "session" / "truth.csv")
    assert (table.status == "ok").all()
    # origin: the force of the simulated spring itself, before gauge and noise
    assert (
        abs(table.peak_force_n - truth.peak_force_n)
        < 4.0 * table.peak_force_std_n + 0.005 * truth.peak_force_n
    ).all()
    np.testing.assert_allclose(table.vibration_energy_j, truth.vibration_energy_j, rtol=0.12)


def test_a_law_of_the_catalogue_can_be_planted_by_its_name(tmp_path):
    law = '[scatter]\nheight = "0 um"\nfriction = 0\nload = 0\n[[effects]]\nlaw = "running_in"\n'
    folder = simulate(tmp_path, extra=law + "parameters = { excess = 1.0, settling_trials = 4 }\n")
    truth = pd.read_csv(folder / "truth.csv")
    # origin: mu (1 + s exp(-n / n0)) at the default friction of 0.15
    np.testing.assert_allclose(
        truth.sliding_friction, 0.15 * (1.0 + np.exp(-truth.trial / 4.0)), rtol=1e-6
    )


def test_operators_can_be_distinguished(tmp_path):
    levels = (
        '[scatter]\nenergy = 0\nfriction = 0\nload = 0\nheight = "0 um"\n[[effects]]\nslot = '
        '"conversion"\n'
    )
    levels += 'change = "multiply"\nform = "levels"\ncovariate = "operator"\nlevels = { B = 0.5 }\n'
    folder = simulate(tmp_path, extra=levels)
    truth, trials = pd.read_csv(folder / "truth.csv"), pd.read_csv(folder / "trials.csv")
    share = truth.vibration_energy_j * 2.0 * 9810.0 / truth.peak_force_n**2
    # origin: E_v = C_v F^2 / 2k with the default conversion of 0.2, and half as much again for B
    np.testing.assert_allclose(share, np.where(trials.operator == "B", 0.3, 0.2), rtol=1e-6)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("trials = 12", None),
        ('[[effects]]\nslot = "spring"', "effects.0.slot"),
        (
            '[[effects]]\nslot = "friction"\nform = "linear"\ncovariate = "moon"',
            "covariate of effect 1",
        ),
        ('[[effects]]\nslot = "friction"\nform = "linear"', "must have a covariate"),
        ('[model]\nspring_constant = "9 N"', "model.spring_constant"),
        ("[model]\nfrction = 0.2", "model.frction"),
        ('[[effects]]\nlaw = "gravity"', "law of effect 1 must be one of"),
        (
            '[[effects]]\nlaw = "running_in"\nparameters = { speed = 1.0 }',
            "must be among excess, settling_trials",
        ),
    ],
)
def test_a_plan_that_asks_for_the_impossible_is_one_line(line, message, tmp_path, capsys):
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN.format(format="csv", trials=4) + ("" if message is None else line))
    code = main(["simulate-session", str(plan), "-o", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert code == (0 if message is None else 2)
    assert (message or "") in error
    assert error.count("\n") == (0 if message is None else 1)
    if message is None:
        assert tomllib.loads((tmp_path / "out" / "session.toml").read_text())["schema"] == 1


@pytest.mark.long
def test_figures_show_any_trial_even_an_excluded_one(make_session, tmp_path, capsys):
    folder = make_session(tmp_path / "s", count=3)
    trace = pd.read_csv(folder / "traces/0002.csv")
    trace.iloc[:900].to_csv(folder / "traces/0002.csv", index=False)
    arguments = [
        "measure",
        str(folder),
        "-o",
        str(tmp_path / "f.csv"),
        "--jobs",
        "1",
        "--plots",
        str(tmp_path / "p"),
    ]
    assert main([*arguments, "--trials", "1,2"]) == 0
    assert sorted(path.name for path in (tmp_path / "p").iterdir()) == [
        "trial-1.png",
        "trial-2.png",
    ]
    assert "excluded 1" in capsys.readouterr().out
    first = (tmp_path / "p" / "trial-1.png").read_bytes()
    assert main([*arguments, "--trials", "1", "--quiet"]) == 0
    assert (tmp_path / "p" / "trial-1.png").read_bytes() == first
    assert main([*arguments, "--trials", "99"]) == 2
    capsys.readouterr()
    assert main([*arguments[:-2], "--trials", "1"]) == 2
    assert "--trials says which trials --plots draws: give --plots" in capsys.readouterr().err


# Origin: the shared sessions as their README declares them: k = 9810 N/m, normal load set by
# weights.
@pytest.mark.long
def test_a_shared_session_is_read_whole(shared_bench, tmp_path):
    table = measure(shared_bench / "quiet", tmp_path, jobs=1)
    assert len(table) == 45
    assert (table.status == "ok").all()
    assert table.spring_constant_n_per_m.median() == pytest.approx(9810.0, rel=1e-3)
    np.testing.assert_allclose(table.normal_load_n, table.load_n, rtol=0.02)
    assert table.ring_frequency_hz.median() == pytest.approx(300.0, abs=0.1)
    written = pd.read_csv(tmp_path / "features.csv", dtype=str)
    declared = pd.read_csv(shared_bench / "quiet" / "trials.csv", dtype=str)
    pd.testing.assert_frame_equal(written[list(declared.columns)], declared)


@pytest.mark.long
def test_a_rig_whose_tip_rubs_is_measured(shared_bench, tmp_path):
    folder = tmp_path / "part"
    folder.mkdir()
    for path in (shared_bench / "unexplained-b").iterdir():
        if path.is_file() and path.name != "trials.csv":
            (folder / path.name).symlink_to(path)
    lines = (shared_bench / "unexplained-b" / "trials.csv").read_text().splitlines()
    (folder / "trials.csv").write_text("\n".join(lines[:1] + lines[1:50:6]) + "\n")
    table = measure(folder, tmp_path)
    assert (table.status == "ok").all()
    strong = table[table.ring_amplitude_n > 0.5]
    assert len(strong) >= 3
    np.testing.assert_allclose(strong.ring_frequency_hz, 270.0, atol=1.5)
    # origin: dry friction turns with the tip, so the amplitude loses four times the sliding force
    # per period
    loss = 4.0 * strong.sliding_friction * strong.normal_load_n * strong.ring_frequency_hz
    known = strong.friction_decay_std_n_per_s < 0.05 * loss
    assert known.sum() >= 3
    np.testing.assert_allclose(strong.friction_decay_n_per_s[known], loss[known], rtol=0.1)
    assert (
        abs(strong.friction_decay_n_per_s - loss)
        < 0.1 * loss + 3.0 * strong.friction_decay_std_n_per_s
    ).all()
    assert strong.ln_vibration_energy_std.max() < 0.5
