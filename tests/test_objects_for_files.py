"""Promise: arrays, tables, parts and features are taken wherever a file of the same is."""

import numpy as np
import pandas as pd
import pytest

import stepblocks

X = np.arange(-500, 501) * 1e-6
Z = np.where(X < 0.0, 0.0, np.minimum(X, 30e-6))  # a ramp of 45 degrees, 30 um high


def in_polars(table):
    return pytest.importorskip("polars").from_pandas(table)


def in_xarray(table):
    xarray = pytest.importorskip("xarray")
    return xarray.DataArray(
        table["z_um"].to_numpy() * 1e-6, dims="x", coords={"x": table["x_um"].to_numpy() * 1e-6}
    )


def in_arrays(table):
    return table["x_um"].to_numpy() * 1e-6, table["z_um"].to_numpy() * 1e-6


@pytest.mark.parametrize("form", [pd.DataFrame, in_arrays, in_xarray, in_polars])
def test_a_profile_in_memory_is_dragged_over_as_its_file(form, tmp_path):
    table = pd.DataFrame({"x_um": X * 1e6, "z_um": Z * 1e6})
    table.to_csv(tmp_path / "ramp.csv", index=False)
    wanted = stepblocks.drag_over(tmp_path / "ramp.csv")
    found = stepblocks.drag_over(form(table))
    assert found.trace.peak_force == pytest.approx(wanted.trace.peak_force, rel=1e-9)
    # equations (1) and (2): the ball meets the upper corner before it lies on the ramp
    angle = np.arccos(1.0 - 30e-6 / 125e-6)
    assert found.formula.pull_force == pytest.approx(np.tan(angle + np.arctan(0.15)), rel=1e-3)


@pytest.mark.parametrize("form", [pd.DataFrame, in_arrays, in_xarray, in_polars])
def test_a_profile_in_memory_is_inspected_as_its_file(form, tmp_path):
    step = np.where(X < 0.0, 0.0, 25e-6) + 1e-9 * np.random.default_rng(1).standard_normal(X.size)
    table = pd.DataFrame({"x_um": X * 1e6, "z_um": step * 1e6})
    block = stepblocks.StepBlock(id="low", height="25 um")
    found = stepblocks.inspect_scan(form(table), block)
    assert found.evaluation.values["step_height"].value == pytest.approx(25e-6, abs=1e-9)


def test_a_part_is_dragged_over_and_has_the_events_of_its_counterface():
    block = stepblocks.StepBlock(id="low", height="25 um")
    face = block.counterface()
    for call in (stepblocks.drag_over, lambda one: stepblocks.drag_over(one, backward=True)):
        assert call(block).summary | {"subject": ""} == call(face).summary | {"subject": ""}
    assert stepblocks.drag_over(block).title == "Drag over low"
    ring, none = stepblocks.list_vibration_events(block, stepblocks.PAPER)
    assert ring == stepblocks.list_vibration_events(face, stepblocks.PAPER)[0]
    assert none.status == "no-catch"


def test_a_table_in_polars_is_predicted_as_in_pandas():
    table = pd.DataFrame({"height_um": [25.0, 50.0], "normal_load_n": 1.0, "friction": 0.15})
    pd.testing.assert_frame_equal(
        stepblocks.predict_table(in_polars(table)), stepblocks.predict_table(table)
    )
