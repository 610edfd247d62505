"""Write traces in the layouts that laboratories keep, one trial after the other."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from stepblocks.bench.signal.trace import Trace
from stepblocks.errors import BenchError

# Where the traces of a session lie, by format
TRACE_FILES = {"csv": "traces/{trial:04d}.csv", "hdf5": "traces.h5", "tdms": "traces.tdms", "mat": "traces.mat"}

_NAMES = ("time_s", "fx_n", "fy_n")
_MAT_HEADER = b"MATLAB 5.0 MAT-file, written by stepblocks"


class TraceWriter(Protocol):
    """Takes one trace at a time; nothing but the open file is held."""

    def write(self, trial: int, trace: Trace) -> None:
        """Append one trace."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


def open_writer(folder: Path, kind: str) -> TraceWriter:
    """Begin the traces of a session in an empty folder."""
    writers: dict[str, Any] = {"csv": _CsvWriter, "hdf5": _Hdf5Writer, "tdms": _TdmsWriter, "mat": _MatWriter}
    if kind not in writers:
        raise BenchError(f"`format` must be one of {', '.join(TRACE_FILES)}, got {kind!r}")
    writer: TraceWriter = writers[kind](folder)
    return writer


def _columns(trace: Trace) -> dict[str, np.ndarray[Any, np.dtype[np.float32]]]:
    values = (trace.time, trace.tangential, trace.normal)
    return {name: column.astype(np.float32) for name, column in zip(_NAMES, values, strict=True)}


class _CsvWriter:
    def __init__(self, folder: Path) -> None:
        self._folder = folder / "traces"
        self._folder.mkdir()

    def write(self, trial: int, trace: Trace) -> None:
        table = np.column_stack([trace.time, trace.tangential, trace.normal])
        path = self._folder / f"{trial:04d}.csv"
        np.savetxt(path, table, fmt=("%.6f", "%.6g", "%.6g"), delimiter=",", header=",".join(_NAMES), comments="")

    def close(self) -> None:
        """Every file is closed already."""


class _Hdf5Writer:
    def __init__(self, folder: Path) -> None:
        import h5py

        self._file = h5py.File(folder / TRACE_FILES["hdf5"], "w", libver="latest")

    def write(self, trial: int, trace: Trace) -> None:
        group = self._file.create_group(f"{trial:04d}")
        for name, values in _columns(trace).items():
            group.create_dataset(name, data=values, compression="gzip", track_times=False)

    def close(self) -> None:
        self._file.close()


class _TdmsWriter:
    def __init__(self, folder: Path) -> None:
        from nptdms import TdmsWriter

        self._writer = TdmsWriter(str(folder / TRACE_FILES["tdms"]))
        self._writer.__enter__()

    def write(self, trial: int, trace: Trace) -> None:
        from nptdms import ChannelObject

        group = f"{trial:04d}"
        self._writer.write_segment([ChannelObject(group, name, values) for name, values in _columns(trace).items()])

    def close(self) -> None:
        self._writer.__exit__(None, None, None)


class _MatWriter:
    def __init__(self, folder: Path) -> None:
        self._file = (folder / TRACE_FILES["mat"]).open("wb")
        # SciPy puts the date into the header; the same session must give the same bytes
        self._file.write(_MAT_HEADER.ljust(124) + b"\x00\x01IM")

    def write(self, trial: int, trace: Trace) -> None:
        from scipy.io import savemat

        buffer = io.BytesIO()
        savemat(buffer, {f"trial_{trial:04d}": _columns(trace)}, do_compression=True)
        self._file.write(buffer.getvalue()[128:])

    def close(self) -> None:
        self._file.close()
