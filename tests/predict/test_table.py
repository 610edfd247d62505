"""Tables predicted row by row, from a file or from memory."""

import numpy as np
import pandas as pd
import pytest

import stepblocks as sb
from stepblocks.cli import main
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.operating_point import SHIPPED_LIMITS
from stepblocks.errors import PipelineError, ReadingWarning
from stepblocks.predict.table import predict_table


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_each_row_of_a_table_gets_its_prediction_with_an_interval(tmp_path):
    source = write(
        tmp_path / "t.csv",
        "block,height_um,u_height_um,load_n,friction,tip_radius_um\n"
        "a,25,0.5,1.0,0.15,125\nb,100,0.5,1.0,0.3,125\nc,-3,0.5,1.0,0.15,125\n",
    )
    frame = predict_table(source, tmp_path / "p.csv")
    expected = find_release(find_step_angle(25e-6, 125e-6), 1.0, 0.15)
    assert frame.peak_force_n[0] == pytest.approx(expected.pull_force, rel=1e-12)
    assert (
        frame.vibration_energy_95_low_uj[0]
        < 1e6 * expected.vibration_energy
        < frame.vibration_energy_95_high_uj[0]
    )
    assert list(frame.status) == ["releases", "locked", "invalid"]
    assert np.isnan(frame.peak_force_n[1])
    assert "height must be finite and not negative" in frame.problem[2]
    again = pd.read_csv(tmp_path / "p.csv", float_precision="round_trip")
    assert again.peak_force_n[0] == frame.peak_force_n[0]
    assert list(again.block) == ["a", "b", "c"]


def test_units_of_columns_are_read_from_their_names(tmp_path):
    um = write(tmp_path / "um.csv", "height_um,normal_load_n,friction\n25,0.5,0.15\n")
    mm = write(tmp_path / "mm.csv", "step_height_mm,load_mn,friction_pct\n0.025,500,15\n")
    a, b = predict_table(um, tmp_path / "a.csv"), predict_table(mm, tmp_path / "b.csv")
    assert a.peak_force_n[0] == pytest.approx(b.peak_force_n[0], rel=1e-12)


def test_the_interval_of_a_row_does_not_depend_on_the_rows_after_it(tmp_path):
    head = "height_um,u_height_um,load_n,friction\n25,0.5,1,0.15\n"
    a = predict_table(write(tmp_path / "1.csv", head), tmp_path / "a.csv")
    b = predict_table(write(tmp_path / "2.csv", head + "30,0.5,1,0.15\n"), tmp_path / "b.csv")
    assert a.vibration_energy_95_high_uj[0] == b.vibration_energy_95_high_uj[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "table has no rows"),
        ("height_um,load_n,friction\n", "no rows"),
        ("load_n,friction\n1,0.1\n", "must have a column height_nm or height_um"),
        ("height_um,height_mm,load_n,friction\n1,1,1,0.1\n", "not both"),
        ("height_um,height_um,load_n,friction\n1,1,1,0.1\n", "twice"),
        ("height_um,load_n,friction\nten,1,0.1\n", "height_um must be a finite number, got 'ten'"),
    ],
)
def test_a_malformed_table_is_one_clear_error(tmp_path, text, message):
    with pytest.raises(PipelineError, match=message):
        predict_table(write(tmp_path / "bad.csv", text), tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


def test_a_table_in_memory_is_predicted_like_its_file(tmp_path):
    text = "height_um,u_height_um,load_n,friction,edge_radius_um\n25,0.5,1,0.15,3\n90,0.5,1,0.4,0\n"
    source = write(tmp_path / "t.csv", text)
    written = predict_table(source, tmp_path / "p.csv")
    in_memory = predict_table(pd.read_csv(source))
    pd.testing.assert_frame_equal(written, in_memory)
    again = predict_table(written)  # columns that were predicted before are predicted anew
    pd.testing.assert_frame_equal(again, in_memory)
    assert (
        predict_table(str(source)).vibration_energy_95_low_uj[0]
        == in_memory.vibration_energy_95_low_uj[0]
    )


def test_what_a_table_leaves_out_is_the_papers():
    told = {"height_um": [30.0], "load_n": [0.8], "friction": [0.15]}
    paper = {
        "tip_radius_um": [125.0],
        "stiffness_n_mm": [9.81],
        "conversion": [0.2],
        "edge_radius_um": [0.0],
    }
    short, full = predict_table(pd.DataFrame(told)), predict_table(pd.DataFrame(told | paper))
    assert short.vibration_energy_uj[0] == pytest.approx(full.vibration_energy_uj[0], rel=1e-14)
    # Origin: equation (1) by hand
    force = 0.8 * np.tan(np.arccos(1 - 30 / 125) + np.arctan(0.15))
    assert short.vibration_energy_uj[0] == pytest.approx(0.2e6 * force**2 / (2 * 9810.0), rel=1e-12)


def test_the_intervals_of_many_rows_are_those_of_the_single_edges():
    """Row by row the same draws and ends as `estimate_interval` gives one step."""
    rng = np.random.default_rng(3)
    rows = 40
    table = pd.DataFrame(
        {
            "height_um": rng.uniform(0.0, 124.0, rows),
            "edge_radius_um": rng.uniform(0.0, 10.0, rows),
            "load_n": rng.uniform(0.1, 6.0, rows),
            "friction": rng.uniform(0.0, 0.6, rows),
            "u_height_um": rng.choice([0.0, 0.5, 20.0], rows),
            "u_load_n": rng.choice([0.0, 0.05], rows),
            "u_friction": rng.choice([0.0, 0.01], rows),
            "u_conversion": rng.choice([0.0, 0.02], rows),
            "u_tip_radius_um": rng.choice([0.0, 1.0], rows),
            "u_edge_radius_um": rng.choice([0.0, 1.0], rows),
            "u_stiffness_n_m": rng.choice([0.0, 100.0], rows),
        }
    )
    found = predict_table(table)
    tool = sb.Tool(limits=SHIPPED_LIMITS)
    for row in found.itertuples():
        point = sb.OperatingPoint(125e-6, row.load_n, row.friction, tool)
        uncertainties = {
            "height": row.u_height_um * 1e-6,
            "edge_radius": row.u_edge_radius_um * 1e-6,
            "ball_radius": row.u_tip_radius_um * 1e-6,
            "friction": row.u_friction,
            "normal_load": row.u_load_n,
            "stiffness": row.u_stiffness_n_m,
            "conversion": row.u_conversion,
        }
        step = sb.Step(row.height_um * 1e-6, row.edge_radius_um * 1e-6)
        interval = sb.estimate_interval(step, point, uncertainties, draws=4000)
        assert row.status == interval.status
        forces = (row.peak_force_95_low_n, row.peak_force_95_high_n)
        assert forces == pytest.approx((interval.force_low, interval.force_high), rel=1e-9)
        assert row.held_probability == pytest.approx(interval.held_probability)
        if not interval.status.is_beyond_limit:
            energies = (row.vibration_energy_95_low_uj, row.vibration_energy_95_high_uj)
            expected = (1e6 * interval.energy_low, 1e6 * interval.energy_high)
            assert energies == pytest.approx(expected, rel=1e-9)
    assert len(set(found.status)) >= 3


@pytest.mark.parametrize(
    ("cells", "problem"),
    [
        ({"height_um": -3.0}, "height must be finite and not negative, got -3e-06 m"),
        ({"height_um": 2e6}, "height must lie between 0 and 1 m"),
        ({"load_n": 0.0}, "normal_load must be positive and finite, got 0 N"),
        ({"load_n": np.nan}, "normal_load must be positive and finite, got nan N"),
        ({"friction": -0.1}, "friction must be finite and not negative, got -0.1"),
        ({"conversion": 5.0}, "conversion must be at most 1, got 5"),
        ({"tip_radius_um": 1e9}, "ball_radius must be at most 0.05 m"),
        (
            {"u_height_um": -1.0},
            "uncertainty of height must be finite and not negative",
        ),
        (
            {"u_load_n": np.nan},
            "uncertainty of normal_load must be finite",
        ),
    ],
)
def test_a_bad_row_says_what_is_wrong_and_leaves_the_others(cells, problem):
    usual = {"height_um": 50.0, "load_n": 1.0, "friction": 0.15}
    usual |= {"conversion": 0.2, "tip_radius_um": 125.0, "u_height_um": 0.5, "u_load_n": 0.0}
    table = predict_table(pd.DataFrame([usual, usual | cells, usual]))
    assert table.status.tolist() == ["releases", "invalid", "releases"]
    assert table.problem[1].startswith(problem)
    assert table.problem[0] == table.problem[2] == ""
    assert table.peak_force_95_low_n[0] == table.peak_force_95_low_n[2]
    assert np.isnan(table.peak_force_n[1])


def test_a_row_without_a_number_is_invalid_and_leaves_the_others(tmp_path):
    rows = "height_um,load_n,friction\n50,1,\n50,1,0.15\n-9999,1,0.15\n50,1,0.15\n"
    with pytest.warns(ReadingWarning, match="-9999"):
        of_file = predict_table(write(tmp_path / "t.csv", rows))
    in_memory = pd.DataFrame(
        {
            "height_um": np.ma.masked_equal([50.0, 50.0, -9999.0, 50.0], -9999.0),
            "load_n": pd.array([1, 1, 1, 1], dtype="Int64"),
            "friction": pd.array([None, 0.15, 0.15, 0.15], dtype="Float64"),
        }
    )
    for table in (of_file, predict_table(in_memory)):
        assert table.status.tolist() == ["invalid", "releases", "invalid", "releases"]
        assert "friction must be" in table.problem[0]
        assert "height must be" in table.problem[2]
        # Origin: equation (1) by hand
        force = np.tan(np.arccos(1 - 50 / 125) + np.arctan(0.15))
        assert table.peak_force_n[1] == pytest.approx(force, rel=1e-12)


def test_no_rows_have_the_columns_of_some():
    table = pd.DataFrame({"height_um": [50.0], "load_n": 1.0, "friction": 0.15})
    assert list(predict_table(table[:0]).columns) == list(predict_table(table).columns)


def test_a_hundred_thousand_rows_take_no_draw_each(monkeypatch):
    """Without an uncertainty there is no interval to draw."""
    monkeypatch.setattr("stepblocks.predict.table.estimate_step_intervals", None)
    heights = np.linspace(1.0, 120.0, 100_000)
    table = predict_table(pd.DataFrame({"height_um": heights, "load_n": 1.0, "friction": 0.15}))
    assert len(table) == len(heights)


@pytest.mark.parametrize("suffix", [".xlsx", ".tsv"])
def test_the_command_takes_a_sheet_and_tabs(suffix, tmp_path, capsys):
    table = pd.DataFrame({"Height [µm]": [50.0], "Load (N)": 1.0, "friction": 0.15})
    path = tmp_path / f"t{suffix}"
    if suffix == ".xlsx":
        table.to_excel(path, index=False)
    else:
        table.to_csv(path, index=False, sep="\t", decimal=",", encoding="cp1252")
    assert main(["predict", str(path), "-o", str(tmp_path / "out.csv")]) == 0
    assert pd.read_csv(tmp_path / "out.csv").peak_force_n[0] == pytest.approx(1.854, abs=1e-3)
    assert ("Windows-1252" in capsys.readouterr().out) == (suffix == ".tsv")


def test_a_quantity_in_a_table_is_refused_and_not_taken_for_missing():
    """500 mN in a column of newton is neither 500 N nor no number."""
    units = pytest.importorskip("pint").UnitRegistry()
    table = pd.DataFrame({"height_um": [50.0], "friction": 0.15}).astype(object)
    table["load_n"] = pd.Series([500 * units.mN], dtype=object)
    with pytest.raises(PipelineError, match="load_n must be a finite number, got <Quantity"):
        predict_table(table)
