"""Traces in HDF5: a group per trial with a dataset per channel, or a table per trial."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.signal import MOST_SAMPLES, format_first_eight_names, refuse_oversized_channel
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace
from stepblocks.bench.traces.rows import TrialRow, cut_trailing_nans, describe_file_arrays

_CACHE = 256 * 2**10  # descriptions of groups that are kept, in their size on disk [bytes]
_LISTED_ITEMS = 10  # of a file, which a message may list
_MOST_COLUMNS = 64  # of a table with the most samples that a trace may have


@dataclass(frozen=True)
class RowOfFile:
    """A trial that is one row of each array of a file."""

    file: "h5py.File"
    row: TrialRow


class Hdf5Reader(TraceReader["h5py.File", "h5py.Group | h5py.Dataset | RowOfFile"]):
    """Reads groups of datasets, compound tables and plain ones, and arrays of a row per trial."""

    def open(self, path: Path, layout: TextLayout | None = None) -> "h5py.File":
        """Open a file, of a MATLAB file from version 7.3 on too."""
        try:
            file = h5py.File(path, "r", locking=False)
        except OSError as error:
            raise TraceError(
                FaultKind.WITHOUT_HEADING, f"{path.name} is no readable HDF5 file"
            ) from error
        # the library would hold 30 MiB of descriptions of groups, each of which is read once
        cache = file.id.get_mdc_config()
        cache.set_initial_size = True
        cache.initial_size = cache.min_size = cache.max_size = _CACHE
        file.id.set_mdc_config(cache)
        return file

    def find_group(
        self, file: "h5py.File", place: TrialPlace
    ) -> "h5py.Group | h5py.Dataset | RowOfFile":
        """Find the group, the table or the row of one trial."""
        if place.row is not None:
            return RowOfFile(file, place.row)
        if place.is_whole_file:
            return file
        for name in place.groups:
            if name in file:
                group = file[name]
                _refuse_external_storage(group, file)
                return group
        raise TraceError(
            FaultKind.MISSING,
            f"no group {place.groups[0]!r} among the traces; {_describe_top_level_arrays(file)}",
        )

    def read_column(
        self, group: "h5py.Group | h5py.Dataset | RowOfFile", column: str | int
    ) -> ArrayLike:
        """Read one channel of a group of datasets, of a table, or of a row of arrays."""
        if isinstance(group, RowOfFile):
            return _read_array_row(group, column)
        if isinstance(group, h5py.Dataset):
            return _read_table_column(group, column)
        if isinstance(column, int) or column not in group:
            raise TraceError(
                FaultKind.UNKNOWN_CHANNEL,
                f"no {column!r} in the group, it has {format_first_eight_names(group)}",
            )
        dataset = group[column]
        if not isinstance(dataset, h5py.Dataset):
            raise TraceError(
                FaultKind.WITHOUT_HEADING, f"channel {column!r} is a group, no dataset"
            )
        _refuse_external_storage(dataset, group)
        refuse_oversized_channel(dataset.size, column)
        return np.asarray(dataset[()])

    def read_attributes(
        self, group: "h5py.Group | h5py.Dataset | RowOfFile", names: Sequence[str | int]
    ) -> dict[str, object]:
        """Return the attributes of a trial and of its channels."""
        attributes: dict[str, object] = {}
        if isinstance(group, RowOfFile):
            group = group.file
        with suppress(Exception):  # the library raises anything on damaged attributes
            attributes |= dict(group.attrs)
        if isinstance(group, h5py.Dataset):
            return attributes
        for name in names:
            with suppress(Exception):
                attributes |= dict(group[name].attrs)
        return attributes


def _describe_top_level_arrays(file: "h5py.File") -> str:
    """Describe the arrays at the top level of a file."""
    shapes: dict[str, tuple[int, ...]] = {}
    for name in islice(file, _LISTED_ITEMS):
        with suppress(Exception):  # the library raises anything on damaged items
            shapes[name] = getattr(file[name], "shape", ())
    return describe_file_arrays(shapes)


def _read_array_row(group: RowOfFile, array_name: str | int) -> ArrayLike:
    """Read the row of one trial from an array of trials x samples."""
    if isinstance(array_name, int) or array_name not in group.file:
        raise TraceError(
            FaultKind.UNKNOWN_CHANNEL,
            f"no array {array_name!r}; {_describe_top_level_arrays(group.file)}",
        )
    array = group.file[array_name]
    if not isinstance(array, h5py.Dataset):
        raise TraceError(FaultKind.WITHOUT_HEADING, f"channel {array_name!r} is a group, no array")
    _refuse_external_storage(array, group.file)
    if max(array.shape, default=0) == array.size:
        refuse_oversized_channel(array.size, array_name)
        return np.asarray(array[()]).ravel()
    axis = group.row.find_trial_axis(array.shape, array_name)
    refuse_oversized_channel(array.shape[1 - axis], array_name)
    if axis == 0:
        return cut_trailing_nans(np.asarray(array[group.row.number, :]))
    return cut_trailing_nans(np.asarray(array[:, group.row.number]))


def _refuse_external_storage(hdf5_object: "h5py.HLObject", container: "h5py.HLObject") -> None:
    """Refuse what lies in another file, by a link or by storage outside.

    A session is what its folder holds.
    """
    is_inside = hdf5_object.file.filename == container.file.filename
    if isinstance(hdf5_object, h5py.Dataset) and (hdf5_object.external or hdf5_object.is_virtual):
        is_inside = False
    if not is_inside:
        raise TraceError(
            FaultKind.WITHOUT_HEADING, f"{hdf5_object.name} lies in another file, which is not read"
        )


def _read_table_column(table: "h5py.Dataset", column: str | int) -> ArrayLike:
    """Read a column of a table, by its name in a compound one, by its index in a plain one."""
    if table.size > _MOST_COLUMNS * MOST_SAMPLES:
        raise TraceError(FaultKind.WITHOUT_HEADING, f"table of shape {table.shape} is too large")
    if isinstance(column, int):
        return _read_plain_column(table, column)
    if column not in (table.dtype.names or ()):
        raise TraceError(
            FaultKind.UNKNOWN_CHANNEL,
            f"the table has no {column!r}, it has {table.dtype.names}",
        )
    return np.asarray(table[column])


def _read_plain_column(table: "h5py.Dataset", index: int) -> ArrayLike:
    """Read a column of a table without names by its index from 0."""
    if table.ndim != 2 or not 0 <= index < min(table.shape):
        raise TraceError(
            FaultKind.UNKNOWN_CHANNEL, f"no column {index} in a table of shape {table.shape}"
        )
    rows, columns = table.shape
    if columns > rows:  # MATLAB's columns are HDF5's rows
        return np.asarray(table[index, :])
    return np.asarray(table[:, index])
