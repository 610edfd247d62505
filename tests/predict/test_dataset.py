"""Predictions as labelled arrays with units, and as a plot."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import stepblocks
from stepblocks.errors import StepblocksError

pytest.importorskip("xarray")
STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


@pytest.fixture(scope="module")
def table():
    return stepblocks.predict_set(STIMULI / "paper-ten.toml", dragged=False)


def test_a_dataset_holds_every_row_under_its_conditions(table):
    found = stepblocks.to_dataset(table)
    assert dict(found.sizes) == {"stimulus": 10, "friction": 3, "normal_load_n": 4}
    for row in table.itertuples():
        one = found.sel(
            stimulus=row.stimulus, friction=row.friction, normal_load_n=row.normal_load_n
        )
        assert float(one.peak_force_n) == pytest.approx(row.peak_force_n, nan_ok=True, rel=0.0)
        assert str(one.status.values) == row.status


def test_variables_bear_their_units(table):
    found = stepblocks.to_dataset(table)
    assert found.peak_force_n.attrs == {"long_name": "peak force", "units": "N"}
    assert found.felt_energy_uj.attrs["units"] == "µJ"
    assert found.normal_load_n.attrs["units"] == "N"
    assert "units" not in found.status.attrs


@pytest.mark.parametrize("name", ["crown-margins", "probe-tips", "paper-four", "sheaths"])
def test_every_shipped_set_fills_its_dimensions(name):
    table = stepblocks.predict_set(STIMULI / f"{name}.toml", dragged=False)
    found = stepblocks.to_dataset(table)
    assert np.prod(list(found.sizes.values())) == len(table)
    assert (
        np.sort(found.critical_angle_deg.values.ravel()).tolist()
        == np.sort(table.critical_angle_deg).tolist()
    )


def test_a_table_of_single_rows_has_one_dimension():
    table = pd.DataFrame({"height_um": [25.0, 25.0], "load_n": 1.0, "friction": 0.15})
    found = stepblocks.to_dataset(stepblocks.predict_table(table))
    assert dict(found.sizes) == {"row": 2}
    assert found.height_um.attrs["units"] == "µm"


def test_the_height_of_a_grid_is_a_dimension_and_a_random_design_has_one():
    grid = [(h, load, mu) for h in (25.0, 50.0, 75.0) for load in (0.5, 1.0) for mu in (0.1, 0.2)]
    table = pd.DataFrame(grid, columns=["height_um", "load_n", "friction"])
    found = stepblocks.to_dataset(stepblocks.predict_table(table))
    assert dict(found.sizes) == {"height_um": 3, "load_n": 2, "friction": 2}
    rng = np.random.default_rng(0)
    drawn = pd.DataFrame(rng.uniform(0.1, 0.4, (1000, 3)), columns=table.columns)
    found = stepblocks.to_dataset(stepblocks.predict_table(drawn))
    assert dict(found.sizes) == {"row": 1000}


def test_a_predicted_table_is_drawn_by_its_own_height_and_energy():
    table = pd.DataFrame({"height_um": [25.0, 50.0], "load_n": 1.0, "friction": 0.15})
    axes = stepblocks.plot_predictions(stepblocks.predict_table(table))
    assert axes.get_xlabel() == "height, µm"


def test_without_xarray_the_extra_is_named(table, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(StepblocksError, match=r"pip install 'stepblocks\[xarray\]'"):
        stepblocks.to_dataset(table)


def test_a_plot_has_a_line_for_each_condition_on_the_axes_given(table):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert stepblocks.plot_predictions(table, ax=axes) is axes
    assert len(axes.lines) == 12  # three frictions under four loads
    assert axes.get_ylabel() == "felt energy, µJ"
    heights = axes.lines[0].get_xdata()
    assert list(heights) == pytest.approx(list(range(10, 101, 10)))
    assert stepblocks.plot_predictions(table.iloc[:1]).get_xlabel() == "height, µm"


def test_what_is_no_table_or_no_column_is_refused(table):
    with pytest.raises(StepblocksError, match="table must be a pandas DataFrame, got list"):
        stepblocks.to_dataset([1])
    with pytest.raises(StepblocksError, match="'energy' must be a column of the table"):
        stepblocks.plot_predictions(table, y="energy")
    with pytest.raises(TypeError, match="draged"):
        stepblocks.predict_set(STIMULI / "paper-ten.toml", draged=True)


def test_a_table_under_its_old_names_is_read_and_drawn():
    """As `predict_set` wrote it before the same thing had one name everywhere."""
    old = pd.DataFrame(
        {
            "stimulus": ["a", "b", "a", "b"],
            "step_height_um": [25.0, 50.0, 25.0, 50.0],
            "normal_load_n": [0.5, 0.5, 1.0, 1.0],
            "pull_force_n": [0.5, 0.9, 1.0, 1.9],
            "vibration_energy_uj": [1.0, 2.0, 3.0, 4.0],
        }
    )
    found = stepblocks.to_dataset(old)
    assert float(found.peak_force_n.sel(stimulus="b", normal_load_n=1.0)) == 1.9
    axes = stepblocks.plot_predictions(old, "step_height_um", "pull_force_n")
    assert axes.get_ylabel() == "peak force, N"
    with pytest.raises(StepblocksError, match="vibration_energy_uj has taken its place"):
        stepblocks.plot_predictions(old, y="vibration_energy_j")


def test_predictions_of_all_kinds_name_the_same_thing_alike(tmp_path):
    step = stepblocks.StepBlock(id="a", height="50 um")
    stimuli = stepblocks.StimulusSet(
        name="a", title="a", stimuli=(step,), prediction={"normal_loads": ["1 N"]}
    )
    of_set = stepblocks.predict_set(stimuli, dragged=False)
    of_table = stepblocks.predict_table(
        pd.DataFrame({"height_um": [50.0], "normal_load_n": 1.0, "friction": of_set.friction[0]})
    )
    (tmp_path / "sweep.toml").write_text(
        f'[parameters]\nheight = "50 um"\nfriction = {of_set.friction[0]}\n'
    )
    of_sweep = stepblocks.run_sweep(tmp_path / "sweep.toml", tmp_path / "sweep").read()
    common = ("height_um", "normal_load_n", "friction", "status", "critical_angle_deg")
    figures = ("peak_force_n", "vibration_energy_uj")
    for name in (*common, *figures):
        values = [table[name].tolist()[0] for table in (of_set, of_table, of_sweep)]
        if isinstance(values[0], str):
            assert len(set(values)) == 1
        else:
            assert values == pytest.approx([values[0]] * 3, rel=1e-12)
    assert of_sweep.height_um[0] == 50.0


@pytest.mark.parametrize("use", [stepblocks.to_dataset, stepblocks.plot_predictions])
def test_a_table_with_a_column_twice_is_refused_by_its_name(use):
    table = pd.DataFrame([[10.0, 20.0, 0.15]], columns=["height_um", "height_um", "friction"])
    with pytest.raises(StepblocksError, match="names of their own, got 'height_um' twice"):
        use(table)
