"""Lengths and forces in the forms that Python has for them: taken right, or refused by name."""

import math

import numpy as np
import pandas as pd
import pint
import pytest

import stepblocks as sb
from stepblocks.errors import QuantityError, StepblocksError
from stepblocks.quantities import read_array

UNITS = pint.UnitRegistry()
# Origin: equation (2) by hand
ANGLE = math.acos(1.0 - 50.0 / 125.0)


@pytest.mark.parametrize(
    "height",
    [
        50e-6,
        "50 um",
        "0.05 mm",
        50 * UNITS.um,
        0.05 * UNITS.mm,
        np.float64(50e-6),
        np.array(50e-6),
        np.ma.array(50e-6),
    ],
)
def test_one_length_is_the_same_in_every_form(height):
    assert sb.find_step_angle(height, "125 um") == pytest.approx(ANGLE, rel=1e-14)
    if not isinstance(height, np.ma.MaskedArray):
        assert sb.Step(height) == sb.Step(50e-6)


def test_single_precision_is_the_number_that_it_holds():
    assert sb.find_step_angle(np.float32(50e-6), 125e-6) == pytest.approx(ANGLE, rel=1e-6)


@pytest.mark.parametrize(
    "heights",
    [
        [50e-6, 25e-6],
        ["50 um", "25 um"],
        np.array([50.0, 25.0]) * UNITS.um,
        [50 * UNITS.um, 0.025 * UNITS.mm],
        pd.Series([50e-6, 25e-6], dtype="Float64"),
        np.array([50e-6, 25e-6], dtype=object),
    ],
)
def test_many_lengths_are_the_same_in_every_form(heights):
    angles = sb.find_step_angle(heights, 125 * UNITS.um)
    assert angles == pytest.approx([ANGLE, math.acos(1.0 - 25.0 / 125.0)], rel=1e-14)


def test_a_force_in_millinewton_is_no_force_in_newton():
    force = sb.find_release(ANGLE, 500 * UNITS.mN, 0.15).pull_force
    assert force == pytest.approx(0.5 * math.tan(ANGLE + math.atan(0.15)), rel=1e-14)
    assert sb.OperatingPoint("125 um", 500 * UNITS.mN, 0.15).normal_load == 0.5
    assert sb.StepBlock(id="a", height=50 * UNITS.um).height.nominal == 50e-6


@pytest.mark.parametrize(
    "wrong", ["50 N", 50 * UNITS.N, [50 * UNITS.N], ["fifty"], [None, object()]]
)
def test_another_dimension_is_refused_by_name(wrong):
    with pytest.raises(StepblocksError, match="height must be"):
        sb.find_step_angle(wrong, 125e-6)


def test_what_is_masked_or_missing_is_no_number():
    masked = np.ma.masked_equal([25e-6, -9999.0], -9999.0)
    for values in (masked, pd.Series([25e-6, None], dtype="Float64"), [25e-6, pd.NA]):
        read = read_array(values, "length")
        assert read[0] == 25e-6
        assert np.isnan(read[1])
        with pytest.raises(StepblocksError, match="height must be finite"):
            sb.find_step_angle(values, 125e-6)


def test_an_array_of_xarray_states_its_unit():
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray([25.0, 50.0], attrs={"units": "um"})
    assert read_array(array, "length").tolist() == [25e-6, 50e-6]
    with pytest.raises(QuantityError, match="must be a length"):
        read_array(array.assign_attrs(units="N"), "length")


def test_the_mask_of_a_scan_is_kept():
    """Where the mask is dropped, a spike of the instrument is dragged over."""
    from stepblocks.scans.read import load_scan

    x = np.linspace(-1e-3, 1e-3, 2001)
    z = np.where(x < 0.0, 0.0, 50e-6)
    spoiled = np.ma.array(z, mask=np.abs(x + 0.5e-3) < 5e-6)
    spoiled.data[spoiled.mask] = 90e-6
    scan = load_scan((x, spoiled))
    assert np.isnan(scan.height[spoiled.mask]).all()
    assert np.nanmax(scan.height) == 50e-6
    in_units = load_scan((x * 1e3 * UNITS.mm, UNITS.Quantity(spoiled * 1e6, "um")))
    assert np.nanmax(in_units.height) == pytest.approx(50e-6, rel=1e-14)


def test_limits_are_public_and_what_is_none_is_refused():
    tool = sb.Tool(limits=sb.Limits(hand="9.87 N"))
    release = sb.Step(100e-6).release(sb.OperatingPoint(125e-6, 1.0, 0.15, tool=tool))
    assert release.status.value == "beyond-hand"  # as a set says of it, whose limits are these
    with pytest.raises(StepblocksError, match="limits must be Limits"):
        sb.Tool(limits={"hand": 9.87})
