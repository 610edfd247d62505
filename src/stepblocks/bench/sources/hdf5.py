"""Traces in HDF5, and in MATLAB files from version 7.3 on, which are HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.layout import inside
from stepblocks.bench.session import Session
from stepblocks.bench.sources.base import MOST_SAMPLES, TraceError, as_samples, group_names
from stepblocks.bench.sources.csv_files import trial_file
from stepblocks.errors import BenchError

_CACHE = 256 * 2**10  # As much of the descriptions of groups as is kept, in their size on disk [bytes]


class Hdf5Source:
    """A group per trial with a dataset per channel, a table per trial, or one file per trial."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._file: Any = None
        if not session.acquisition.per_trial:
            path = inside(session.folder, session.acquisition.traces, "acquisition.traces")
            if not path.is_file():
                raise BenchError(f"traces are missing, expected {session.acquisition.traces} [{session.folder}]")
            try:
                self._file = _open(path)
            except TraceError as error:
                raise BenchError(f"traces cannot be read: {error} [{path}]") from error

    def columns(self, trial: str, names: tuple[str | int, ...]) -> dict[str | int, NDArray[np.float64]]:
        """Read columns of one trial."""
        if self._file is not None:
            return self._read(self._file, trial, names, whole=False)
        with _open(trial_file(self._session, trial)) as file:
            return self._read(file, trial, names, whole=self._session.acquisition.group is None)

    def _read(
        self, file: Any, trial: str, names: tuple[str | int, ...], whole: bool
    ) -> dict[str | int, NDArray[np.float64]]:
        try:
            group = file if whole else _group(file, group_names(self._session.acquisition.group, trial))
            return {name: as_samples(_column(group, name), name) for name in names}
        except (OSError, RuntimeError, ValueError) as error:
            raise TraceError(f"unreadable: trial {trial}: {str(error)[:120]}") from error

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def _open(path: Path) -> Any:
    import h5py

    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        raise TraceError(f"{path.name} is no readable HDF5 file") from error
    # the library would hold 30 MiB of descriptions of groups, each of which is read once
    cache = file.id.get_mdc_config()
    cache.set_initial_size, cache.initial_size, cache.min_size, cache.max_size = True, _CACHE, _CACHE, _CACHE
    file.id.set_mdc_config(cache)
    return file


def _group(file: Any, names: list[str]) -> Any:
    for name in names:
        if name in file:
            return file[name]
    raise TraceError(f"missing: no group {names[0]!r} among the traces")


def _column(group: Any, name: str | int) -> Any:
    """One channel of a group of datasets, of a compound table, or of a plain table of numbers."""
    import h5py

    if isinstance(group, h5py.Dataset):
        if group.size > 64 * MOST_SAMPLES:
            raise TraceError(f"table of shape {group.shape} is too large")
        if isinstance(name, int):
            if group.ndim != 2 or not 0 <= name < min(group.shape):
                raise TraceError(f"unknown channel: no column {name} in a table of shape {group.shape}")
            # MATLAB's columns are HDF5's rows
            return group[:, name] if group.shape[1] <= group.shape[0] else group[name, :]
        if group.dtype.names is None or name not in group.dtype.names:
            raise TraceError(f"unknown channel: the table has no {name!r}, it has {group.dtype.names}")
        return group[name]
    if isinstance(name, int) or name not in group:
        raise TraceError(f"unknown channel: no {name!r} in the group, it has {', '.join(list(group)[:8])}")
    dataset = group[name]
    if not isinstance(dataset, h5py.Dataset):
        raise TraceError(f"channel {name!r} is a group, no dataset")
    if dataset.size > MOST_SAMPLES:
        raise TraceError(f"channel {name!r} has {dataset.size} samples, more than {MOST_SAMPLES}")
    return dataset[()]
