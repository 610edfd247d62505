"""A sweep's rows depend on the plan alone: not on partitions, processes or interruptions."""

import importlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import PipelineError
from stepblocks.predict.figures import compute_margin_map_forces
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.predict.sweep.read import load_sweep
from stepblocks.predict.sweep.rows import _mark_rows_in_domain, sample_row_inputs
from stepblocks.predict.sweep.run import run_sweep

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
pq = pytest.importorskip("pyarrow.parquet")

RANDOM = """
[sweep]
kind = "random"
rows = {rows}
seed = 11
rows_per_partition = {size}
mode = "{mode}"
[parameters]
height = {{ from = "12 um", to = "80 um" }}
normal_load = ["0.3 N", "0.7 N"]
friction = {{ from = 0.1, to = 0.2 }}
edge_radius = "3 um"
speed = "30 mm/s"
[draws]
count = 3
height = "0.5 um"
"""


def plan_of(tmp_path, text):
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    return load_sweep(path)


def table(folder):
    return pq.read_table(sorted(folder.glob("part-*.parquet"))).to_pandas()


def test_rows_do_not_depend_on_the_partitioning(tmp_path):
    results = []
    for size in (7, 50, 1000):
        plan = plan_of(tmp_path, RANDOM.format(rows=40, size=size, mode="static"))
        run_sweep(plan, tmp_path / f"by-{size}")
        results.append(table(tmp_path / f"by-{size}"))
    for other in results[1:]:
        assert other.equals(results[0])
    assert len(results[0]) == 120


def test_every_row_is_equations_one_and_two(tmp_path):
    plan = plan_of(tmp_path, RANDOM.format(rows=20, size=100, mode="static"))
    run_sweep(plan, tmp_path / "out")
    for row in table(tmp_path / "out").itertuples():
        release = find_release(
            find_step_angle(row.height_um * 1e-6, 125e-6, 3e-6), row.normal_load_n, row.friction
        )
        assert row.status == str(release.status)
        assert row.vibration_energy_uj == pytest.approx(
            1e6 * release.vibration_energy, rel=1e-12, nan_ok=True
        )


def test_a_grid_holds_every_combination_once(tmp_path):
    text = """
[parameters]
height = { from = "10 um", to = "100 um", count = 10 }
friction = [0.1, 0.15, 0.3]
normal_load = ["0.5 N", "1 N"]
"""
    plan = plan_of(tmp_path, text)
    drawn = sample_row_inputs(plan, range(plan.row_count))
    rows = set(zip(drawn["height"], drawn["friction"], drawn["normal_load"], strict=True))
    assert len(rows) == plan.row_count == 60
    run_sweep(plan, tmp_path / "out")
    frame = table(tmp_path / "out")
    assert set(frame.status) == {"releases", "locked", "beyond-hand"}
    assert frame[frame.status == "beyond-hand"].vibration_energy_uj.isna().all()


def test_draws_of_one_point_scatter_by_their_uncertainty(tmp_path):
    text = (
        '[parameters]\nheight = "30 um"\nfriction = 0.2\n[draws]\ncount = 4000\nheight = "0.5 um"\n'
    )
    plan = plan_of(tmp_path, text)
    heights = sample_row_inputs(plan, range(plan.row_count))["height"]
    assert heights.mean() == pytest.approx(30e-6, abs=4 * 0.5e-6 / 4000**0.5)
    assert heights.std() == pytest.approx(0.5e-6, rel=0.05)


def test_a_sweep_in_time_agrees_with_its_static_columns_at_low_speed(tmp_path):
    text = RANDOM.format(rows=3, size=100, mode="drag").replace("30 mm/s", "2 mm/s")
    run_sweep(plan_of(tmp_path, text), tmp_path / "out")
    frame = table(tmp_path / "out")
    released = frame[frame.drag_status == "releases"]
    assert len(released) >= 6
    # the contact of steel gives up to some per cent, see docs/explanation/drag.md
    assert (released.drag_peak_force_n / released.peak_force_n - 1).abs().max() < 0.12
    assert released.drag_ledger_error.max() < 1e-3


def test_an_interrupted_sweep_resumes_from_what_is_finished(tmp_path):
    plan = plan_of(tmp_path, RANDOM.format(rows=40, size=10, mode="static"))

    def interrupt(number):
        if number == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(plan, tmp_path / "out", on_partition=interrupt)
    stamps = {p.name: p.stat().st_mtime_ns for p in (tmp_path / "out").glob("part-*.parquet")}
    assert len(stamps) == 5
    assert tuple(run_sweep(plan, tmp_path / "out")) == (7, 5)
    assert all((tmp_path / "out" / name).stat().st_mtime_ns == t for name, t in stamps.items())
    assert tuple(run_sweep(plan, tmp_path / "out")) == (0, 12)
    run_sweep(plan, tmp_path / "whole")
    for path in sorted((tmp_path / "whole").glob("part-*.parquet")):
        assert path.read_bytes() == (tmp_path / "out" / path.name).read_bytes()


@pytest.mark.long
def test_a_process_killed_in_mid_run_loses_nothing_and_changes_no_byte(tmp_path):
    plan = plan_of(tmp_path, RANDOM.format(rows=4, size=2, mode="drag"))
    run_sweep(plan, tmp_path / "alone")

    def kill_workers(_):
        from stepblocks.compute.processes import kill_child_processes

        kill_child_processes()

    with pytest.raises(PipelineError, match="run it again, and it goes on"):
        run_sweep(plan, tmp_path / "by-two", jobs=2, on_partition=kill_workers)
    computed, found = run_sweep(plan, tmp_path / "by-two", jobs=2)
    assert found >= 1
    assert computed + found == plan.partition_count == 6
    whole, again = (
        {path.name: path.read_bytes() for path in (tmp_path / name).glob("part-*")}
        for name in ("alone", "by-two")
    )
    assert whole == again


@pytest.mark.long
def test_a_script_needs_no_main_guard_for_several_processes(tmp_path):
    (tmp_path / "sweep.toml").write_text(RANDOM.format(rows=4, size=2, mode="static"))
    script = tmp_path / "script.py"
    script.write_text(
        "import stepblocks as sb\nprint(tuple(sb.run_sweep('sweep.toml', 'out', jobs=2)))\n"
    )
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == "(6, 0)\n"


def test_readers_of_tables_take_the_folder_as_it_is(tmp_path):
    import pandas as pd
    from pyarrow import dataset

    done = run_sweep(
        plan_of(tmp_path, RANDOM.format(rows=4, size=5, mode="static")), tmp_path / "out"
    )
    frame = pd.read_parquet(tmp_path / "out")
    assert len(frame) == dataset.dataset(tmp_path / "out").count_rows() == 12
    pd.testing.assert_frame_equal(done.read(), frame)
    pd.testing.assert_frame_equal(done.read(["height_um"]), frame[["height_um"]])
    with pytest.raises(PipelineError, match="columns must be of row, draw, "):
        done.read(["height"])


@pytest.mark.repeats
@pytest.mark.parametrize("library", ["polars", "dask.dataframe"])
def test_polars_and_dask_read_a_sweep_as_pandas_does(library, tmp_path):
    reader = pytest.importorskip(library)
    run_sweep(plan_of(tmp_path, RANDOM.format(rows=4, size=5, mode="static")), tmp_path / "out")
    expected = pd.read_parquet(tmp_path / "out")
    if library == "polars":  # it refuses a folder that holds anything else
        found = reader.read_parquet(tmp_path / "out" / "*.parquet").to_pandas()
    else:
        found = reader.read_parquet(tmp_path / "out").compute()
    pd.testing.assert_frame_equal(
        found.reset_index(drop=True), expected, check_dtype=False, check_categorical=False
    )


def test_a_result_draws_its_table_and_says_what_it_is(tmp_path):
    done = run_sweep(
        plan_of(tmp_path, RANDOM.format(rows=4, size=5, mode="static")), tmp_path / "out"
    )
    axes = done.plot()
    assert done.plot(y="peak_force_n", ax=axes) is axes
    assert axes.get_xlabel() == "height, µm"
    assert "12 rows in 3 partitions, 3 computed, 0 found" in repr(done)
    assert done._repr_html_().count("<tr") == 1 + 5  # names, and the first partition


def test_a_sweep_draws_into_axes_that_stand_first_as_every_result_does(tmp_path):
    done = run_sweep(
        plan_of(tmp_path, RANDOM.format(rows=4, size=5, mode="static")), tmp_path / "out"
    )
    axes = done.plot()
    assert done.plot(axes, "peak_force_n") is axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("height, µm", "peak force, N")
    assert done.plot("friction", ax=axes) is axes
    assert axes.get_xlabel().startswith("friction")
    with pytest.raises(PipelineError, match="ax must be axes of matplotlib, got 3"):
        done.plot(3)


def test_polars_reads_the_folder_of_a_sweep(tmp_path):
    polars = pytest.importorskip("polars")
    out = tmp_path / "out"
    done = run_sweep(plan_of(tmp_path, RANDOM.format(rows=12, size=5, mode="static")), out)
    table, wanted = polars.scan_parquet(out, hidden_file_prefix="_").collect(), done.read()
    assert table.columns == list(wanted.columns)
    assert table["vibration_energy_uj"].to_list() == wanted.vibration_energy_uj.tolist()


@pytest.mark.parametrize("jobs", [0, -1, "2", 1.0, True, 10**9, pd.Series([1, 2])])
def test_a_number_of_processes_that_cannot_be_is_refused(jobs, tmp_path):
    plan = plan_of(tmp_path, RANDOM.format(rows=4, size=5, mode="static"))
    with pytest.raises(PipelineError, match="jobs must be a whole number from 1 to 1024") as raised:
        run_sweep(plan, tmp_path / "out", jobs=jobs)
    assert "\n" not in str(raised.value)
    with pytest.raises(PipelineError, match="plan must be a SweepPlan or a path, got dict"):
        run_sweep({}, tmp_path / "out")


def test_random_inputs_fill_their_ranges_evenly_and_do_not_hang_together(tmp_path):
    plan = plan_of(tmp_path, RANDOM.format(rows=20_000, size=100, mode="static"))
    drawn = sample_row_inputs(plan, range(0, plan.row_count, 1))
    height, friction = drawn["height"][::3], drawn["friction"][::3]
    assert friction.mean() == pytest.approx(0.15, abs=4 * 0.1 / 12**0.5 / 20_000**0.5)
    assert (drawn["normal_load"] == 0.3).mean() == pytest.approx(0.5, abs=0.02)
    assert abs(np.corrcoef(height, friction)[0, 1]) < 4 / 20_000**0.5
    again = sample_row_inputs(plan, range(1000, 1010))
    assert all((again[name] == drawn[name][1000:1010]).all() for name in drawn)


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize(
    "damage", [lambda _: b"", lambda content: content[:-9], lambda _: b"PAR1" * 99, flipped]
)
def test_a_part_that_is_empty_cut_or_damaged_is_made_anew(damage, tmp_path):
    plan = plan_of(tmp_path, RANDOM.format(rows=12, size=9, mode="static"))
    command = ["sweep", str(tmp_path / "sweep.toml"), "-o", str(tmp_path / "out"), "--quiet"]
    assert main(command) == 0
    whole = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    part = tmp_path / "out" / "part-00000002.parquet"
    part.write_bytes(damage(whole[part.name]))
    assert main(command) == 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == whole
    part.write_bytes(damage(whole[part.name]))
    assert tuple(run_sweep(plan, tmp_path / "out")) == (1, 3)


def test_rows_of_another_version_of_the_program_are_not_mixed_with_ours(tmp_path, monkeypatch):
    plan = plan_of(tmp_path, RANDOM.format(rows=4, size=10, mode="static"))
    run_sweep(plan, tmp_path / "out")
    monkeypatch.setattr("stepblocks.__version__", "0.0.1")
    with pytest.raises(PipelineError, match="another version of stepblocks"):
        run_sweep(plan, tmp_path / "out")


def test_a_folder_of_another_sweep_is_left_alone(tmp_path):
    run_sweep(plan_of(tmp_path, RANDOM.format(rows=4, size=10, mode="static")), tmp_path / "out")
    other = plan_of(tmp_path, RANDOM.format(rows=5, size=10, mode="static"))
    before = {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()}
    with pytest.raises(PipelineError, match="another sweep"):
        run_sweep(other, tmp_path / "out")
    assert before == {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()}


def test_rows_outside_the_equations_say_why(tmp_path):
    text = '[parameters]\nheight = ["20 um", "300 um"]\nfriction = [0.1, -0.1]\n'
    run_sweep(plan_of(tmp_path, text), tmp_path / "out")
    frame = table(tmp_path / "out")
    assert sorted(frame.status) == ["invalid", "invalid", "releases", "too-high"]
    assert frame.problem.str.contains("friction must be finite and not negative").sum() == 2


MARGINS = """
[sweep]
surface = "margin"
mode = "{mode}"
[parameters]
marginal_gap = ["30 um", "70 um"]
horizontal_discrepancy = ["-15 um", "0 um", "15 um"]
direction = ["tooth-to-crown", "crown-to-tooth"]
tip_radius = "90 um"
normal_load = "0.7 N"
friction = 0.12
speed = "30 mm/s"
"""


def test_a_sweep_over_crown_margins_is_the_margin_map(tmp_path):
    run_sweep(plan_of(tmp_path, MARGINS.format(mode="static")), tmp_path / "out")
    frame = table(tmp_path / "out")
    assert len(frame) == 12
    # its discrepancy: tooth over crown
    axes = (
        np.array([30e-6, 70e-6]),
        np.array([15e-6, 0.0, -15e-6]),
    )
    to_tooth, to_crown = compute_margin_map_forces(*axes, OperatingPoint(90e-6, 0.7, 0.12))
    for _, row in frame.iterrows():
        forces = to_tooth if row.drag == "crown-to-tooth" else to_crown
        i, j = (
            [30.0, 70.0].index(row.marginal_gap_um),
            [-15.0, 0.0, 15.0].index(row.horizontal_discrepancy_um),
        )
        assert (row.peak_force_n if row.status == "releases" else 0.0) == pytest.approx(
            forces[i, j], rel=1e-12
        )
    assert frame.vertical_discrepancy_um.isna().all()  # the end of the crown is square


def test_crown_margins_are_swept_in_time(tmp_path):
    run_sweep(
        plan_of(tmp_path, MARGINS.format(mode="drag").replace("30 mm/s", "3 mm/s")),
        tmp_path / "out",
    )
    frame = table(tmp_path / "out")
    released = frame[frame.drag_status == "releases"]
    assert set(released.drag) == {"tooth-to-crown", "crown-to-tooth"}
    assert (released.drag_peak_force_n / released.peak_force_n - 1).abs().max() < 0.25
    assert released.drag_ledger_error.max() < 1e-3
    assert (frame[frame.status == "no-catch"].drag_status == "no-catch").all()


def test_a_sweep_over_a_set_draws_its_stimuli_from_their_tolerances(tmp_path):
    source = (STIMULI / "paper-ten.toml").read_text()
    (tmp_path / "paper-ten.toml").write_text(source)
    text = (
        '[sweep]\nset = "paper-ten.toml"\n[parameters]\nstimulus = ["step-030", '
        '"step-060"]\nfriction = 0.2\n'
        "[draws]\ncount = 500\ntolerances = true\n"
    )
    plan = plan_of(tmp_path, text)
    assert plan.row_count == 2 * 4 * 500  # the set declares four loads
    run_sweep(plan, tmp_path / "out")
    frame = table(tmp_path / "out")
    for name, height in (("step-030", 30.0), ("step-060", 60.0)):
        drawn = frame[frame.stimulus == name]
        # +-1 um of height and +-1 % of load as rectangular distributions, by their variance
        assert drawn.height_um.mean() == pytest.approx(height, abs=4 * 0.577 / 2000**0.5)
        assert drawn.height_um.std() == pytest.approx(1 / 3**0.5, rel=0.1)
        light = drawn[drawn.normal_load_n < 0.4]
        assert light.normal_load_n.std() == pytest.approx(0.003 / 3**0.5, rel=0.15)
    assert (frame.edge_radius_um >= 0.0).all()


def test_a_sweep_over_crowns_takes_their_discrepancies(tmp_path):
    (tmp_path / "crown-margins.toml").write_text((STIMULI / "crown-margins.toml").read_text())
    text = (
        '[sweep]\nset = "crown-margins.toml"\nkind = "random"\nrows = '
        '400\n[parameters]\ndirection = "crown-to-tooth"\n'
    )
    run_sweep(plan_of(tmp_path, text), tmp_path / "out")
    frame = table(tmp_path / "out")
    predicted = {
        (p.stimulus, 1e6 * p.point.ball_radius, p.point.normal_load, p.point.friction): p.release
        for p in predict_by_formula(load_shipped("crown-margins"))
        if p.drag_direction == "crown-to-tooth"
    }
    assert len(set(frame.stimulus)) == 12
    for _, row in frame.iterrows():
        release = predicted[row.stimulus, row.tip_radius_um, row.normal_load_n, row.friction]
        assert row.status == release.status.value
        assert row.peak_force_n == pytest.approx(release.pull_force, rel=1e-12, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not toml", "must be TOML"),
        ("[parameters]\nheight = '10 um'", "friction must be given"),
        ("[parameters]\nheight = '10 N'\nfriction = 0.1", "height must be a length"),
        ("[parameters]\nheight = 10\nfriction = 0.1", "needs its unit"),
        ("[parameters]\nheight = []\nfriction = 0.1", "must list 1"),
        ("[parameters]\nheight = '1 um'\nfriction = 0.1\ncolour = 1", "'colour' is not known"),
        ("[parameters]\nheight = {from='9 um', to='1 um', count=2}\nfriction = 0.1", "must rise"),
        ("[parameters]\nheight = {from='1 um', to='9 um'}\nfriction = 0.1", "count of height"),
        ("[sweep]\nkind = 'all'\n[parameters]\nheight='1 um'\nfriction=0.1", "kind must be"),
        (
            "[sweep]\nkind = 'random'\n[parameters]\nheight='1 um'\nfriction=0.1",
            "rows must be a whole number",
        ),
        ("[sweep]\nseed = -1\n[parameters]\nheight='1 um'\nfriction=0.1", "seed must be"),
        (
            "[parameters]\nheight='1 um'\nfriction=0.1\n[draws]\ncount=0",
            "count must be a whole number",
        ),
        (
            "[sweep]\nsurface='margin'\n[parameters]\nheight='1 um'\nfriction=0.1",
            "'height' is not known",
        ),
        ("[sweep]\nsurface='margin'\n[parameters]\nfriction=0.1", "marginal_gap must be given"),
        (
            MARGINS.format(mode="static").replace('"tooth-to-crown"', '"up"'),
            "direction must be tooth-to-crown or",
        ),
        (
            MARGINS.format(mode="static") + "[draws]\nvertical_discrepancy = '1 um'",
            "value that is not given",
        ),
        ("[sweep]\nset='no.toml'\n", "cannot be read"),
        ("[parameters]\nheight='1 um'\nfriction=0.1\n[draws]\ntolerances=true", "name it with set"),
        ("sweep = 3\n[parameters]\nheight='1 um'\nfriction=0.1", "must be a table"),
    ],
)
def test_a_malformed_sweep_is_one_line_and_exit_code_two(tmp_path, capsys, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    assert main(["sweep", str(path), "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1 or " mistakes [" in error
    assert not (tmp_path / "out").exists()


def test_the_command_writes_the_table_and_says_what_it_did(tmp_path, capsys):
    path = tmp_path / "sweep.toml"
    path.write_text(RANDOM.format(rows=4, size=5, mode="static"))
    assert main(["sweep", str(path), "-o", str(tmp_path / "out")]) == 0
    assert "12 rows in 3 partitions: 3 computed, 0 found" in capsys.readouterr().out
    assert main(["sweep", str(tmp_path / "no.toml"), "-o", str(tmp_path / "x")]) == 2
    assert Path(tmp_path / "out" / "_sweep.json").is_file()


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("part-00000001.parquet", "output must be a plain file, got a device, a pipe or a socket"),
        ("_sweep.json", "_sweep.json cannot be read; choose another folder"),
    ],
)
def test_a_pipe_in_the_folder_of_a_sweep_is_refused_and_stays(tmp_path, name, rule):
    plan = plan_of(tmp_path, RANDOM.format(rows=4, size=5, mode="static"))
    run_sweep(plan, tmp_path / "out")
    path = tmp_path / "out" / name
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(PipelineError, match=rule):
        run_sweep(plan, tmp_path / "out")
    assert path.is_fifo()


def test_a_sweep_is_the_same_in_whatever_order_its_parameters_are_named(tmp_path):
    one = plan_of(tmp_path, RANDOM.format(rows=40, size=20, mode="static"))
    other = replace(one, values=dict(reversed(one.values.items())))
    assert list(other.values) != list(one.values)
    assert other.digest == one.digest
    assert replace(one, seed=one.seed + 1).digest != one.digest


def test_a_sharp_edge_a_step_of_no_height_and_no_friction_lie_inside_the_equations():
    one = dict.fromkeys(("tip_radius", "normal_load", "stiffness", "conversion"), np.ones(4))
    sizes = {"height": np.array([20e-6, 0.0, -1e-6, np.inf]), "edge_radius": np.zeros(4)}
    inside = _mark_rows_in_domain("step", one | sizes | {"friction": np.zeros(4)})
    assert inside.tolist() == [True, True, False, False]


def test_without_pyarrow_a_sweep_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.delitem(sys.modules, "stepblocks.predict.sweep.run")
    with pytest.raises(PipelineError, match=r"pip install 'stepblocks\[sweep\]'"):
        importlib.import_module("stepblocks.predict.sweep.run")
