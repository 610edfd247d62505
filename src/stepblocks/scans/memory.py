"""Scans that lie in memory: arrays, series, tables and objects of this package.

Numbers are metres unless a unit is given or they carry one themselves. What cannot be followed is
refused: an option that is ignored would make a false verdict.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepblocks.contact.counterface import Profile
from stepblocks.errors import MetrologyError
from stepblocks.files.missing import replace_fill_values_by_nan
from stepblocks.mistakes import shorten_value
from stepblocks.scans.scan import Array, HeightMap, ScannedProfile
from stepblocks.scans.text import read_table_scan
from stepblocks.scans.units import StoredLength, parse_units

if TYPE_CHECKING:
    import pandas as pd

# A scan that is no file: the table of one, an object, or positions and heights
ScanInMemory: TypeAlias = (
    "pd.DataFrame | ScannedProfile | HeightMap | Profile | tuple[ArrayLike, ArrayLike]"
)

_METRE = StoredLength(1.0, 1.0)
_EVEN = 0.02  # scatter of the steps of a grid, as a part of the step [1]
_SOURCE = "arrays"


def convert_scan(
    scan: ScanInMemory, unit: str | None = None, channel: str | None = None
) -> ScannedProfile | HeightMap:
    """Return a scan in memory as an object.

    Parameters
    ----------
    scan : table, ScannedProfile, HeightMap, Profile or arrays
        Arrays are two, one of two rows, or a series or labelled array over its positions; masked
        points and missing numbers are points that were not measured.
    unit : str, optional
        Unit of numbers that carry none, as `parse_units` reads it; metres where it is not given.
    channel : str, optional
        Of a table, the column of heights.

    Returns
    -------
    ScannedProfile or HeightMap
        Heights and positions [m].

    Raises
    ------
    MetrologyError
        If it is none of these, or says its unit or has no channels where one is given.
    """
    if isinstance(scan, ScannedProfile | HeightMap | Profile):
        _refuse_options(f"a {type(scan).__name__}, which is in metres", unit, channel)
        if isinstance(scan, Profile):
            return _make_profile(scan.x, scan.z, unit)
        return scan
    table: Any = scan
    if hasattr(table, "dims") and hasattr(table, "coords"):  # of xarray
        _refuse_options("an array, which has none", None, channel)
        return _convert_labelled_array(table, unit)
    if hasattr(table, "to_pandas"):  # of polars or Arrow
        table = table.to_pandas()
    # tables and series are told by what they have: pandas is not loaded to find out
    if hasattr(table, "columns"):
        return read_table_scan(table, unit, channel)
    _refuse_options("arrays, which have none", None, channel)
    if hasattr(table, "to_csv"):
        return _make_profile(table.index, table, unit)
    return _convert_pair(table, unit)


def _refuse_options(what: str, unit: str | None, channel: str | None) -> None:
    """Refuse a unit or a channel that would have to be ignored."""
    for name, value in (("unit", unit), ("channel", channel)):
        if value is not None:
            raise MetrologyError(f"{name} must not be given for {what}, got {value!r}")


def _convert_pair(arrays: Any, unit: str | None) -> ScannedProfile:
    """Make a profile of two rows, positions and heights."""
    if _count_rows(arrays) != 2:
        raise MetrologyError(
            f"scan must be a file, a table, or two rows, x and z, got {_describe_argument(arrays)}"
        )
    x, z = arrays
    return _make_profile(x, z, unit)


def _count_rows(arrays: Any) -> int:
    """Count the rows of what may be a sequence or an array; 0 of a number."""
    try:
        return len(arrays)
    except TypeError:
        return 0


def _make_profile(x: Any, z: Any, unit: str | None) -> ScannedProfile:
    """Make a profile of positions and heights, each with the unit that it carries or is given."""
    units = parse_units(unit)
    position = _convert_to_metres(x, "x", units)
    fill_notes: list[str] = []
    height = _convert_to_metres(z, "z", units, fill_notes)
    return ScannedProfile(position, height, _SOURCE, _describe_unit(unit, fill_notes))


def _describe_unit(unit: str | None, fill_notes: Sequence[str]) -> str:
    """Say which unit was given, and which values were taken as missing."""
    notes = list(fill_notes)
    if unit is not None:
        notes.insert(0, f"unit {unit} as given")
    return "; ".join(notes)


def _convert_to_metres(
    values: Any, axis: str, units: dict[str, StoredLength], fill_notes: list[str] | None = None
) -> Array:
    """Convert lengths to metres, nan where a value is masked or missing.

    Where `fill_notes` is given, values that fill gaps become nan, and a note on them is appended.
    """
    if hasattr(values, "magnitude") and hasattr(values, "to"):  # of Pint
        if axis in units:
            raise MetrologyError(
                f"unit must not be given for {axis}, which carries its own, got {values.units!s}"
            )
        return _convert_numbers(_convert_quantity_to_metres(values, axis), axis)
    if units and axis not in units:
        raise MetrologyError(f"unit must say that of {axis}, too, as x=mm,z=um, got none")
    numbers = _convert_numbers(values, axis)
    if fill_notes is not None:
        found = replace_fill_values_by_nan(numbers)
        numbers = found.values
        if found.count:
            fill_notes.append(found.describe_missing_values("the heights"))
    return units.get(axis, _METRE).to_metres(numbers)


def _convert_quantity_to_metres(values: Any, axis: str) -> Any:
    """Return the numbers of a quantity of Pint in metres."""
    import pint

    try:
        return values.to("m").magnitude
    except pint.PintError as error:
        raise MetrologyError(
            f"{axis} must have a unit of length, got {shorten_value(str(values.units))}"
        ) from error


def _convert_numbers(values: Any, axis: str) -> Array:
    """Return numbers as float64, nan where one is masked or missing."""
    # truth values, complex numbers, times
    if getattr(getattr(values, "dtype", None), "kind", None) in ("b", "c", "m", "M"):
        raise MetrologyError(f"{axis} must hold numbers, got {values.dtype}")
    try:
        if isinstance(values, np.ma.MaskedArray):
            return np.asarray(np.ma.filled(values.astype(np.float64), np.nan))
        if hasattr(values, "to_numpy") and hasattr(values, "isna"):  # of pandas
            return np.asarray(values.astype("Float64").to_numpy(dtype=np.float64, na_value=np.nan))
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise MetrologyError(
            f"{axis} must hold numbers, got {_describe_argument(values)}"
        ) from error


def _describe_argument(value: Any) -> str:
    """Describe an array by its shape; to write a million numbers takes longer than to read them."""
    if hasattr(value, "shape"):
        return f"shape {np.shape(value)}"
    return shorten_value(value)


def _convert_labelled_array(array: Any, unit: str | None) -> ScannedProfile | HeightMap:
    """Make a profile or a map of an array of xarray, by its coordinates and their units.

    The unit of heights and coordinates stands in their attribute ``units``; a map has its rows
    along y.
    """
    if len(array.dims) not in (1, 2) or any(name not in array.coords for name in array.dims):
        raise MetrologyError(
            "labelled array must have one or two dimensions, each with coordinates, got "
            f"{shorten_value(dict(array.sizes))}"
        )
    units = parse_units(unit)
    fill_notes: list[str] = []
    height = _convert_labelled_to_metres(array, "z", units, fill_notes)
    along_x = _convert_labelled_to_metres(array.coords[array.dims[-1]], "x", units)
    scale = _describe_unit(unit, fill_notes)
    if len(array.dims) == 1:
        return ScannedProfile(along_x, height, _SOURCE, scale)
    along_y = _convert_labelled_to_metres(array.coords[array.dims[0]], "y", units)
    dx = _find_step(along_x, str(array.dims[-1]))
    dy = _find_step(along_y, str(array.dims[0]))
    return HeightMap(height[:: _find_sign(dy), :: _find_sign(dx)], abs(dx), abs(dy), _SOURCE, scale)


def _convert_labelled_to_metres(
    array: Any, axis: str, units: dict[str, StoredLength], fill_notes: list[str] | None = None
) -> Array:
    """Convert an array of xarray to metres, by its attribute ``units`` where it has one.

    `fill_notes` are those of `_convert_to_metres`.
    """
    stated = array.attrs.get("units")
    values = array.data
    if stated is None:
        return _convert_to_metres(values, axis, units, fill_notes)
    if axis in units:
        raise MetrologyError(
            f"unit must not be given for {array.name}, which states its own, got {stated!r}"
        )
    return _convert_to_metres(values, axis, parse_units(f"{axis}={stated}"), fill_notes)


def _find_step(positions: Array, name: str) -> float:
    """Return the step of coordinates in equal steps [m], negative where they descend."""
    steps = np.diff(positions)
    if not len(steps):
        raise MetrologyError(f"coordinates {name} must be two or more, got {len(positions)}")
    step = float(np.mean(steps))
    if not np.isfinite(step) or np.any(np.abs(steps - step) > _EVEN * abs(step)):
        raise MetrologyError(
            f"coordinates {name} must be in equal steps, got {steps.min():.4g} to "
            f"{steps.max():.4g} m"
        )
    return step


def _find_sign(step: float) -> int:
    """Return -1 for a step backwards, else 1."""
    return -1 if step < 0.0 else 1
