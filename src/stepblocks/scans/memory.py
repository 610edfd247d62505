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


def convert_scan_in_memory(
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
        _refuse_unit_and_channel(f"a {type(scan).__name__}, which is in metres", unit, channel)
        if isinstance(scan, Profile):
            return _make_profile_of_arrays(scan.x, scan.z, unit)
        return scan
    table: Any = scan
    if hasattr(table, "dims") and hasattr(table, "coords"):  # of xarray
        _refuse_unit_and_channel("an array, which has none", None, channel)
        return _make_scan_of_labelled_array(table, unit)
    if hasattr(table, "to_pandas"):  # of polars or Arrow
        table = table.to_pandas()
    # tables and series are told by what they have: pandas is not loaded to find out
    if hasattr(table, "columns"):
        return read_table_scan(table, unit, channel)
    _refuse_unit_and_channel("arrays, which have none", None, channel)
    if hasattr(table, "to_csv"):
        return _make_profile_of_arrays(table.index, table, unit)
    return _make_profile_of_two_rows(table, unit)


def _refuse_unit_and_channel(scan_description: str, unit: str | None, channel: str | None) -> None:
    """Refuse a unit or a channel that would have to be ignored."""
    for name, value in (("unit", unit), ("channel", channel)):
        if value is not None:
            raise MetrologyError(f"{name} must not be given for {scan_description}, got {value!r}")


def _make_profile_of_two_rows(rows: Any, unit: str | None) -> ScannedProfile:
    """Make a profile of two rows, positions and heights."""
    if _count_rows_or_zero(rows) != 2:
        raise MetrologyError(
            "scan must be a file, a table, or two rows, x and z, got "
            f"{_describe_value_briefly(rows)}"
        )
    x, z = rows
    return _make_profile_of_arrays(x, z, unit)


def _count_rows_or_zero(candidate: Any) -> int:
    """Count the rows of what may be a sequence or an array; 0 of a number."""
    try:
        return len(candidate)
    except TypeError:
        return 0


def _make_profile_of_arrays(x: Any, z: Any, unit: str | None) -> ScannedProfile:
    """Make a profile of positions and heights, each with the unit that it carries or is given."""
    units = parse_units(unit)
    position = _convert_to_metres(x, "x", units)
    fill_notes: list[str] = []
    height = _convert_to_metres(z, "z", units, fill_notes)
    return ScannedProfile(position, height, _SOURCE, _format_scale_notes(unit, fill_notes))


def _format_scale_notes(unit: str | None, fill_notes: Sequence[str]) -> str:
    """Say which unit was given, and which values were taken as missing."""
    notes = list(fill_notes)
    if unit is not None:
        notes.insert(0, f"unit {unit} as given")
    return "; ".join(notes)


def _convert_to_metres(
    values: Any,
    axis: str,
    units_by_axis: dict[str, StoredLength],
    fill_notes: list[str] | None = None,
) -> Array:
    """Convert lengths to metres, nan where a value is masked or missing.

    Where `fill_notes` is given, values that fill gaps become nan, and a note on them is appended.
    """
    if hasattr(values, "magnitude") and hasattr(values, "to"):  # of Pint
        if axis in units_by_axis:
            raise MetrologyError(
                f"unit must not be given for {axis}, which carries its own, got {values.units!s}"
            )
        return _convert_to_float_array(_convert_quantity_to_metres(values, axis), axis)
    if units_by_axis and axis not in units_by_axis:
        raise MetrologyError(f"unit must say that of {axis}, too, as x=mm,z=um, got none")
    numbers = _convert_to_float_array(values, axis)
    if fill_notes is not None:
        found = replace_fill_values_by_nan(numbers)
        numbers = found.values
        if found.count:
            fill_notes.append(found.describe_missing_values("the heights"))
    return units_by_axis.get(axis, _METRE).to_metres(numbers)


def _convert_quantity_to_metres(quantity: Any, axis: str) -> Any:
    """Return the numbers of a quantity of Pint in metres."""
    import pint

    try:
        return quantity.to("m").magnitude
    except pint.PintError as error:
        raise MetrologyError(
            f"{axis} must have a unit of length, got {shorten_value(str(quantity.units))}"
        ) from error


def _convert_to_float_array(values: Any, axis: str) -> Array:
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
            f"{axis} must hold numbers, got {_describe_value_briefly(values)}"
        ) from error


def _describe_value_briefly(value: Any) -> str:
    """Describe an array by its shape; to write a million numbers takes longer than to read them."""
    if hasattr(value, "shape"):
        return f"shape {np.shape(value)}"
    return shorten_value(value)


def _make_scan_of_labelled_array(
    labelled_array: Any, unit: str | None
) -> ScannedProfile | HeightMap:
    """Make a profile or a map of an array of xarray, by its coordinates and their units.

    The unit of heights and coordinates stands in their attribute ``units``; a map has its rows
    along y.
    """
    if len(labelled_array.dims) not in (1, 2) or any(
        name not in labelled_array.coords for name in labelled_array.dims
    ):
        raise MetrologyError(
            "labelled array must have one or two dimensions, each with coordinates, got "
            f"{shorten_value(dict(labelled_array.sizes))}"
        )
    units = parse_units(unit)
    fill_notes: list[str] = []
    height = _convert_labelled_to_metres(labelled_array, "z", units, fill_notes)
    along_x = _convert_labelled_to_metres(
        labelled_array.coords[labelled_array.dims[-1]], "x", units
    )
    scale = _format_scale_notes(unit, fill_notes)
    if len(labelled_array.dims) == 1:
        return ScannedProfile(along_x, height, _SOURCE, scale)
    along_y = _convert_labelled_to_metres(labelled_array.coords[labelled_array.dims[0]], "y", units)
    dx = _compute_equal_step(along_x, str(labelled_array.dims[-1]))
    dy = _compute_equal_step(along_y, str(labelled_array.dims[0]))
    return HeightMap(
        height[:: _get_step_sign(dy), :: _get_step_sign(dx)], abs(dx), abs(dy), _SOURCE, scale
    )


def _convert_labelled_to_metres(
    labelled_array: Any,
    axis: str,
    units_by_axis: dict[str, StoredLength],
    fill_notes: list[str] | None = None,
) -> Array:
    """Convert an array of xarray to metres, by its attribute ``units_by_axis`` where it has one.

    `fill_notes` are those of `_convert_to_metres`.
    """
    stated = labelled_array.attrs.get("units")
    values = labelled_array.data
    if stated is None:
        return _convert_to_metres(values, axis, units_by_axis, fill_notes)
    if axis in units_by_axis:
        raise MetrologyError(
            f"unit must not be given for {labelled_array.name}, which states its own, got "
            f"{stated!r}"
        )
    return _convert_to_metres(values, axis, parse_units(f"{axis}={stated}"), fill_notes)


def _compute_equal_step(positions: Array, coordinate_name: str) -> float:
    """Return the step of coordinates in equal steps [m], negative where they descend."""
    steps = np.diff(positions)
    if not len(steps):
        raise MetrologyError(
            f"coordinates {coordinate_name} must be two or more, got {len(positions)}"
        )
    step = float(np.mean(steps))
    if not np.isfinite(step) or np.any(np.abs(steps - step) > _EVEN * abs(step)):
        raise MetrologyError(
            f"coordinates {coordinate_name} must be in equal steps, got {steps.min():.4g} to "
            f"{steps.max():.4g} m"
        )
    return step


def _get_step_sign(step: float) -> int:
    """Return -1 for a step backwards, else 1."""
    return -1 if step < 0.0 else 1
