"""Traces in HDF5: a group per trial with a dataset per channel, or a table per trial."""

from pathlib import Path

import h5py

from stepblocks.bench.session import Place
from stepblocks.bench.signal import MOST_SAMPLES, TraceError, check_size, join_first

_CACHE = 256 * 2**10  # descriptions of groups that are kept, in their size on disk [bytes]


def open_hdf5(path: Path, layout: object) -> "h5py.File":
    """Open a file, of a MATLAB file from version 7.3 on too."""
    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        raise TraceError(f"{path.name} is no readable HDF5 file") from error
    # the library would hold 30 MiB of descriptions of groups, each of which is read once
    cache = file.id.get_mdc_config()
    cache.set_initial_size = True
    cache.initial_size = cache.min_size = cache.max_size = _CACHE
    file.id.set_mdc_config(cache)
    return file


def find_hdf5_group(file: "h5py.File", place: Place) -> "h5py.Group | h5py.Dataset":
    """Find the group or the table of one trial."""
    group = (
        file if place.is_file else next((file[name] for name in place.groups if name in file), None)
    )
    if group is None:
        raise TraceError(f"missing: no group {place.groups[0]!r} among the traces")
    _require_own(group, file)
    return group


def read_hdf5_column(group: "h5py.Group | h5py.Dataset", name: str | int) -> "h5py.Dataset":
    """Read one channel of a group of datasets, of a compound table or of a plain one."""
    if isinstance(group, h5py.Dataset):
        return _read_table_column(group, name)
    if isinstance(name, int) or name not in group:
        raise TraceError(f"unknown channel: no {name!r} in the group, it has {join_first(group)}")
    dataset = group[name]
    TraceError.require(
        isinstance(dataset, h5py.Dataset), f"channel {name!r} is a group, no dataset"
    )
    _require_own(dataset, group)
    check_size(dataset.size, name)
    return dataset[()]


def _require_own(item: "h5py.HLObject", container: "h5py.HLObject") -> None:
    # Refuse what lies in another file, by a link or by storage outside. A session is what its
    # folder holds.
    TraceError.require(
        item.file.filename == container.file.filename
        and not (isinstance(item, h5py.Dataset) and (item.external or item.is_virtual)),
        f"{item.name} lies in another file, which is not read",
    )


def _read_table_column(table: "h5py.Dataset", name: str | int) -> "h5py.Dataset":
    TraceError.require(
        table.size <= 64 * MOST_SAMPLES,
        f"table of shape {table.shape} is too large",
    )
    if isinstance(name, int):
        TraceError.require(
            table.ndim == 2 and 0 <= name < min(table.shape),
            f"unknown channel: no column {name} in a table of shape {table.shape}",
        )
        # MATLAB's columns are HDF5's rows
        return table[:, name] if table.shape[1] <= table.shape[0] else table[name, :]
    TraceError.require(
        name in (table.dtype.names or ()),
        f"unknown channel: the table has no {name!r}, it has {table.dtype.names}",
    )
    return table[name]
