"""Traces of a simulated session in the layouts of laboratories."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from stepblocks.bench.signal import Trace

_NAMES = ("time_s", "fx_n", "fy_n")
# where the traces of a session lie, by format
TRACE_FILES = {
    "csv": "traces/{trial:04d}.csv",
    "hdf5": "traces.h5",
}

Write = Callable[[int, Trace], None]  # appends the trace of a trial


@contextmanager
def open_writer(folder: Path, kind: str) -> Iterator[Write]:
    """Begin the traces of a session in an empty folder; `kind` is one of `TRACE_FILES`."""
    if kind == "csv":
        (folder / TRACE_FILES["csv"]).parent.mkdir()
        yield lambda trial, trace: _write_text(folder, trial, trace)
    else:
        # the first layout of HDF5, since an older library writes the time into later ones
        with h5py.File(folder / TRACE_FILES[kind], "w") as file:
            yield lambda trial, trace: _write_group(file.create_group(f"{trial:04d}"), trace)


def _write_text(folder: Path, trial: int, trace: Trace) -> None:
    path = folder / TRACE_FILES["csv"].format(trial=trial)
    np.savetxt(
        path,
        np.column_stack([trace.time, trace.tangential, trace.normal]),
        fmt=("%.6f", "%.6g", "%.6g"),
        delimiter=",",
        header=",".join(_NAMES),
        comments="",
    )


def _write_group(group: "h5py.Group", trace: Trace) -> None:
    for name, values in zip(_NAMES, (trace.time, trace.tangential, trace.normal), strict=True):
        group.create_dataset(
            name, data=values.astype(np.float32), compression="gzip", track_times=False
        )
