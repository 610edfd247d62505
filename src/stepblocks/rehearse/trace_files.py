"""Traces of a simulated session in the layouts of laboratories."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from stepblocks.bench.signal import Trace
from stepblocks.contact import Array

if TYPE_CHECKING:
    from nptdms import TdmsWriter

_NAMES = ("time_s", "fx_n", "fy_n")
# where the traces of a session lie, by format
TRACE_FILES = {
    "csv": "traces/{trial:04d}.csv",
    "hdf5": "traces.h5",
    "mat": "traces/{trial:04d}.mat",
    "tdms": "traces.tdms",
}
# the text that opens a MAT file of version 5, padded to its length; SciPy writes the hour into it
_MAT_HEADING = b"MATLAB 5.0 MAT-file, written by stepblocks".ljust(116)

WriteTrace = Callable[[int, Trace], None]  # appends the trace of a trial


@contextmanager
def open_trace_writer(folder: Path, trace_format: str) -> Iterator[WriteTrace]:
    """Begin the traces of a session in an empty folder; `trace_format` is one of `TRACE_FILES`."""
    path = folder / TRACE_FILES[trace_format]
    if trace_format == "csv":
        path.parent.mkdir()
        yield lambda trial, trace: _write_csv_trial(folder, trial, trace)
    elif trace_format == "mat":
        path.parent.mkdir()
        yield lambda trial, trace: _write_mat_trial(folder, trial, trace)
    elif trace_format == "tdms":
        from nptdms import TdmsWriter

        with TdmsWriter(path) as writer:
            yield lambda trial, trace: _write_tdms_group(writer, f"{trial:04d}", trace)
    else:
        # the first layout of HDF5, since an older library writes the time into later ones
        with h5py.File(path, "w") as file:
            yield lambda trial, trace: _write_hdf5_group(file.create_group(f"{trial:04d}"), trace)


def _write_csv_trial(folder: Path, trial_number: int, trace: Trace) -> None:
    """Write a trial as a text file of three columns."""
    path = folder / TRACE_FILES["csv"].format(trial=trial_number)
    np.savetxt(
        path,
        np.column_stack([trace.time, trace.tangential, trace.normal]),
        fmt=("%.6f", "%.6g", "%.6g"),
        delimiter=",",
        header=",".join(_NAMES),
        comments="",
    )


def _pair_names_with_columns(trace: Trace) -> Iterator[tuple[str, Array]]:
    """Yield each column of a trace under the name that it has in every format."""
    return zip(_NAMES, (trace.time, trace.tangential, trace.normal), strict=True)


def _write_hdf5_group(group: "h5py.Group", trace: Trace) -> None:
    """Write a trial as a group of HDF5, a dataset for each column."""
    for name, values in _pair_names_with_columns(trace):
        group.create_dataset(
            name, data=values.astype(np.float32), compression="gzip", track_times=False
        )


def _write_mat_trial(folder: Path, trial_number: int, trace: Trace) -> None:
    """Write a trial as a MAT file of version 5, a variable for each column."""
    from scipy.io import savemat

    variables = {}
    for name, values in _pair_names_with_columns(trace):
        variables[name] = values.astype(np.float32)
    stream = BytesIO()
    opened: Any = stream  # the stubs know paths alone
    savemat(opened, variables, do_compression=True, oned_as="column")
    content = stream.getvalue()
    path = folder / TRACE_FILES["mat"].format(trial=trial_number)
    path.write_bytes(_MAT_HEADING + content[len(_MAT_HEADING) :])


def _write_tdms_group(writer: "TdmsWriter", group: str, trace: Trace) -> None:
    """Append a trial as a group of TDMS, a channel for each column."""
    from nptdms import ChannelObject

    channels = []
    for name, values in _pair_names_with_columns(trace):
        channels.append(ChannelObject(group, name, values.astype(np.float32)))
    writer.write_segment(channels)
