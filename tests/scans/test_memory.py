"""Scans in memory have the unit that they carry, or that is given; an option that nothing would
follow is refused.
"""

import numpy as np
import pandas as pd
import pint
import pytest

from stepblocks.contact.counterface import Profile
from stepblocks.errors import MetrologyError
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.scans.memory import convert_scan_in_memory
from stepblocks.scans.scan import HeightMap, ScannedProfile

X = np.arange(-200, 200) * 1e-6  # [m]
Z = np.where(X > 0.0, 50e-6, 0.0)  # [m]
HIDDEN = Z > 40e-6
REGISTRY = pint.UnitRegistry()


def test_arrays_in_a_stated_unit_are_the_profile_in_metres():
    scan = convert_scan_in_memory((X * 1e3, Z * 1e6), "x=mm,z=um")
    np.testing.assert_allclose(scan.position, X, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(scan.height, Z, rtol=1e-12)


def test_a_verdict_does_not_hang_on_the_unit_in_which_arrays_are_given():
    part = StepBlock(id="step-050", height="50 um")
    height = Z + np.random.default_rng(0).normal(0.0, 20e-9, len(X))
    in_metres = inspect_scan((X, height), part)
    in_millimetres = inspect_scan((X * 1e3, height * 1e3), part, unit="mm")
    table = pd.DataFrame({"x": X * 1e3, "z": height * 1e3})
    of_table = inspect_scan(table, part, unit="mm")
    assert in_millimetres.statement == in_metres.statement == of_table.statement


def test_quantities_of_pint_keep_their_unit():
    scan = convert_scan_in_memory(
        (REGISTRY.Quantity(X * 1e3, "mm"), REGISTRY.Quantity(Z * 1e6, "um"))
    )
    np.testing.assert_allclose(scan.height, Z, rtol=1e-12)
    np.testing.assert_allclose(scan.position, X, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize(
    "heights",
    [
        np.ma.masked_array(Z, HIDDEN),
        pd.Series(Z).mask(pd.Series(HIDDEN)),
        pd.Series(Z).astype("Float64").mask(pd.Series(HIDDEN)),
        REGISTRY.Quantity(np.ma.masked_array(Z * 1e6, HIDDEN), "um"),
    ],
)
def test_masked_and_missing_points_were_not_measured(heights):
    np.testing.assert_array_equal(np.isnan(convert_scan_in_memory((X, heights)).height), HIDDEN)


@pytest.mark.parametrize("fill", [-9999.0, -32768.0, 32767.0, 1e30])
def test_values_that_fill_gaps_of_arrays_were_not_measured_and_this_is_said(fill):
    scan = convert_scan_in_memory((X * 1e6, np.where(HIDDEN, fill, Z * 1e6)), "um")
    np.testing.assert_array_equal(np.isnan(scan.height), HIDDEN)
    assert "stands for a missing value" in scan.scale


def test_a_labelled_array_is_read_by_its_coordinates_and_their_units():
    xarray = pytest.importorskip("xarray")
    along = ("x", X[::-1] * 1e3, {"units": "mm"})
    across = ("y", [0.0, 2.0, 4.0], {"units": "um"})
    coordinates = {"x": along, "y": across}
    heights = np.tile(Z[::-1] * 1e9, (3, 1))
    array = xarray.DataArray(heights, coordinates, ("y", "x"), attrs={"units": "nm"})
    scan = convert_scan_in_memory(array)
    assert isinstance(scan, HeightMap)
    np.testing.assert_allclose(scan.height, np.tile(Z, (3, 1)), rtol=1e-12)
    assert (scan.dx, scan.dy) == pytest.approx((1e-6, 2e-6), rel=1e-9)


@pytest.mark.parametrize(
    ("scan", "options", "rule"),
    [
        ((X, Z), {"unit": "parsec"}, "unit must be one of"),
        ((X, Z), {"unit": "z=mm"}, "unit must say that of x, too"),
        ((X, Z), {"channel": "z"}, "channel must not be given for arrays"),
        (ScannedProfile(X, Z), {"unit": "m"}, "unit must not be given for a ScannedProfile"),
        (HeightMap(np.ones((3, 3)), 1e-6, 1e-6), {"channel": "z"}, "channel must not be given"),
        (Profile(X, Z), {"unit": "mm"}, "unit must not be given for a Profile"),
        ((X, REGISTRY.Quantity(Z, "N")), {}, "z must have a unit of length"),
        ((X, REGISTRY.Quantity(Z, "m")), {"unit": "mm"}, "which carries its own"),
        ((X, ["high"] * len(X)), {}, "z must hold numbers"),
        (np.float64(3.0), {}, "scan must be a file, a table, or two rows"),
    ],
)
def test_what_cannot_be_followed_is_refused_by_name(scan, options, rule):
    with pytest.raises(MetrologyError, match=rule):
        convert_scan_in_memory(scan, **options)
