"""What a notebook hands over is taken right, or refused by name: masked, nullable, with units."""

import numpy as np
import pandas as pd
import pytest

import stepblocks as sb
from stepblocks.errors import StepblocksError

X = np.arange(-300.0, 300.0) * 1e-6
Z = np.where(X > 0.0, 50e-6, 0.0)
HIDDEN = (X > 100e-6) & (X < 120e-6)


@pytest.fixture
def units():
    return pytest.importorskip("pint").UnitRegistry()


@pytest.fixture
def xarray():
    return pytest.importorskip("xarray")


@pytest.mark.parametrize("value", [np.array(50e-6), np.float64(50e-6), "50 um"])
def test_steps_blocks_and_angles_take_the_same_length(value, units, xarray):
    of_pint = 0.05 * units.mm
    of_xarray = xarray.DataArray(50.0, attrs={"units": "um"})
    for height in (value, of_pint, of_xarray):
        assert sb.Step(height).height == pytest.approx(50e-6, rel=1e-12)
        assert sb.StepBlock(id="a", height=height).height.nominal == pytest.approx(50e-6, rel=1e-12)
        angle = sb.find_step_angle(height, 125e-6)
        assert float(angle) == pytest.approx(np.arccos(1 - 50 / 125))  # equation (2) by hand


@pytest.mark.parametrize("value", [True, np.array([True, False])])
def test_a_truth_value_is_no_length(value):
    for call in (sb.Step, lambda height: sb.find_step_angle(height, 125e-6)):
        with pytest.raises(StepblocksError, match="height must be"):
            call(value)
    if isinstance(value, np.ndarray):
        with pytest.raises(StepblocksError, match="z must hold numbers, got bool"):
            sb.drag_over((X, Z > 0.0))


def test_a_force_is_no_length_and_the_message_shows_it(units):
    with pytest.raises(StepblocksError, match="must be a length, got the unit millinewton"):
        sb.find_step_angle(5 * units.mN, 125e-6)


def test_a_profile_may_be_masked_nullable_or_have_units(units):
    wrong = np.where(HIDDEN, 9e-4, Z)
    with_nothing = np.where(HIDDEN, None, Z)
    gapped = [
        np.ma.masked_array(wrong, HIDDEN),
        pd.Series(np.where(HIDDEN, np.nan, Z)).astype("Float64"),
        units.Quantity(np.ma.masked_array(wrong * 1e6, HIDDEN), "um"),
        pd.Series(with_nothing, dtype=object),
    ]
    for height in gapped:
        scan = sb.ScannedProfile(X, height)
        assert isinstance(scan.height, np.ndarray)
        assert not np.ma.isMaskedArray(scan.height)
        assert np.isnan(scan.height).tolist() == HIDDEN.tolist()
        assert np.nanmax(scan.height) == pytest.approx(50e-6)
    assert sb.ScannedProfile(list(X), [f"{1e6 * z} um" for z in Z]).height.max() == pytest.approx(
        50e-6
    )
    with pytest.raises(StepblocksError, match="height must be a length, got the unit"):
        sb.ScannedProfile(X, Z * units.mN)


def test_a_map_may_be_masked_and_have_units(units):
    mask = np.eye(4, 5, dtype=bool)
    heights = units.Quantity(np.ma.masked_array(np.ones((4, 5)), mask), "um")
    scan = sb.HeightMap(heights, 1 * units.um, "2 um")
    assert np.isnan(scan.height).tolist() == mask.tolist()
    assert (scan.dx, scan.dy, np.nanmax(scan.height)) == pytest.approx((1e-6, 2e-6, 1e-6))


def test_heights_of_a_study_may_have_units(units, xarray, tmp_path):
    for number, heights in enumerate(
        (
            [20e-6, 50e-6],
            [20 * units.um, "50 um"],
            np.array([20.0, 50.0]) * units.um,
            xarray.DataArray([20.0, 50.0], attrs={"units": "um"}),
        )
    ):
        plan = sb.design_study(heights, tmp_path / str(number), seed=1, participants=1)
        assert {row["height_um"] for row in plan.trials} == {"20", "50"}
    with pytest.raises(StepblocksError, match="heights must be"):
        sb.design_study(["20 N"], tmp_path / "no", seed=1)


def test_a_dataset_is_predicted_by_the_units_that_it_states(xarray):
    def make(name, unit):
        return xarray.Dataset(
            {
                name: ("row", [50.0, 50.0], {"units": unit}),
                "load_n": ("row", [1.0, 0.5]),
                "friction": ("row", [0.15, 0.15]),
            }
        )

    # equation (1) by hand
    force = np.tan(np.arccos(1 - 50 / 125) + np.arctan(0.15))
    for name in ("height_um", "height"):
        found = sb.predict_table(make(name, "um"))
        assert found.peak_force_n.tolist() == pytest.approx([force, 0.5 * force])
    with pytest.raises(StepblocksError, match="height_um must have one unit, got 'mm'"):
        sb.predict_table(make("height_um", "mm"))


def test_the_coordinates_of_a_grid_are_columns(xarray):
    loads = xarray.DataArray(
        [[1.0, 0.5], [0.5, 1.0]],
        dims=("height_um", "friction"),
        coords={"height_um": [25.0, 50.0], "friction": [0.1, 0.2]},
    )
    found = sb.predict_table(xarray.Dataset({"load_n": loads}))
    assert len(found) == 4
    assert set(found.status) == {"releases"}


@pytest.mark.parametrize(
    "column", [[True, False], [1 + 0j, 2 + 0j], pd.to_datetime(["2026-01-01", "2026-01-02"])]
)
def test_a_column_of_other_things_than_numbers_is_refused_by_name(column):
    table = pd.DataFrame({"height_um": [50.0, 50.0], "load_n": column, "friction": 0.15})
    with pytest.raises(StepblocksError, match="load_n must hold numbers, got"):
        sb.predict_table(table)
