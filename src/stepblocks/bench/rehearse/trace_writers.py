"""Write traces in the layouts that laboratories keep, one trial after the other; nothing but the open file is held."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.bench.signal.trace import Trace
from stepblocks.errors import BenchError

_NAMES = ("time_s", "fx_n", "fy_n")
_MAT_HEADER = b"MATLAB 5.0 MAT-file, written by stepblocks"

Write = Callable[[int, Trace], None]  # appends the trace of a trial


def open_writer(folder: Path, kind: str) -> AbstractContextManager[Write]:
    """Begin the traces of a session in an empty folder."""
    if kind not in _WRITERS:
        raise BenchError(f"`format` must be one of {', '.join(_WRITERS)}, got {kind!r}")
    return _WRITERS[kind](folder)


@contextmanager
def _csv(folder: Path) -> Iterator[Write]:
    (folder / "traces").mkdir()

    def write(trial: int, trace: Trace) -> None:
        table = np.column_stack([trace.time, trace.tangential, trace.normal])
        path = folder / "traces" / f"{trial:04d}.csv"
        np.savetxt(path, table, fmt=("%.6f", "%.6g", "%.6g"), delimiter=",", header=",".join(_NAMES), comments="")

    yield write


@contextmanager
def _hdf5(folder: Path) -> Iterator[Write]:
    import h5py

    with h5py.File(folder / TRACE_FILES["hdf5"], "w", libver="latest") as file:

        def write(trial: int, trace: Trace) -> None:
            group = file.create_group(f"{trial:04d}")
            for name, values in _columns(trace).items():
                group.create_dataset(name, data=values, compression="gzip", track_times=False)

        yield write


@contextmanager
def _tdms(folder: Path) -> Iterator[Write]:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(str(folder / TRACE_FILES["tdms"])) as file:

        def write(trial: int, trace: Trace) -> None:
            group = f"{trial:04d}"
            file.write_segment([ChannelObject(group, name, values) for name, values in _columns(trace).items()])

        yield write


@contextmanager
def _mat(folder: Path) -> Iterator[Write]:
    from scipy.io import savemat

    with (folder / TRACE_FILES["mat"]).open("wb") as file:
        # SciPy puts the date into the header; the same session must give the same bytes
        file.write(_MAT_HEADER.ljust(124) + b"\x00\x01IM")

        def write(trial: int, trace: Trace) -> None:
            buffer = io.BytesIO()
            savemat(buffer, {f"trial_{trial:04d}": _columns(trace)}, do_compression=True)
            file.write(buffer.getvalue()[128:])

        yield write


def _columns(trace: Trace) -> dict[str, np.ndarray[Any, np.dtype[np.float32]]]:
    values = (trace.time, trace.tangential, trace.normal)
    return {name: column.astype(np.float32) for name, column in zip(_NAMES, values, strict=True)}


_WRITERS = {"csv": _csv, "hdf5": _hdf5, "tdms": _tdms, "mat": _mat}
# where the traces of a session lie, by format
TRACE_FILES = {"csv": "traces/{trial:04d}.csv", "hdf5": "traces.h5", "tdms": "traces.tdms", "mat": "traces.mat"}
