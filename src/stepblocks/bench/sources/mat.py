"""Traces in MATLAB files: a struct or a matrix per trial.

A version 5 file is a row of variables. SciPy reads through all of them to find one, so the places of the variables are
noted once, and then only the bytes of the wanted variable are handed to SciPy.
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.layout import inside
from stepblocks.bench.session import Session
from stepblocks.bench.sources.base import TraceError, TraceSource, as_samples, group_names
from stepblocks.bench.sources.csv_files import trial_file
from stepblocks.bench.sources.hdf5 import Hdf5Source
from stepblocks.errors import BenchError

_HEADER = 128
_COMPRESSED, _MATRIX = 15, 14
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_MOST_BYTES = 1 << 30  # of one variable


def open_mat(session: Session) -> TraceSource:
    """Open MATLAB traces of either kind."""
    if session.acquisition.per_trial:
        return MatSource(session)
    path = inside(session.folder, session.acquisition.traces, "acquisition.traces")
    if not path.is_file():
        raise BenchError(f"traces are missing, expected {session.acquisition.traces} [{session.folder}]")
    return Hdf5Source(session) if _is_hdf5(path) else MatSource(session)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(512)
        return _HDF5_MARK in (head, file.read(8))


class MatSource:
    """A version 5 file with a variable per trial, or one file per trial."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._path: Path | None = None
        self._places: dict[str, tuple[int, int]] = {}
        if not session.acquisition.per_trial:
            self._path = inside(session.folder, session.acquisition.traces, "acquisition.traces")
            try:
                self._places = variables_of(self._path)
            except TraceError as error:
                raise BenchError(f"traces cannot be read: {error} [{self._path}]") from error

    def columns(self, trial: str, names: tuple[str | int, ...]) -> dict[str | int, NDArray[np.float64]]:
        """Read columns of one trial."""
        if self._path is not None:
            value = self._variable(self._path, self._places, group_names(self._session.acquisition.group, trial))
            return {name: _column(value, name) for name in names}
        path = trial_file(self._session, trial)
        if _is_hdf5(path):
            return Hdf5Source(self._session).columns(trial, names)
        places = variables_of(path)
        if self._session.acquisition.group is not None:
            value = self._variable(path, places, group_names(self._session.acquisition.group, trial))
            return {name: _column(value, name) for name in names}
        return {name: _column(self._variable(path, places, [str(name)]), name, bare=True) for name in names}

    def _variable(self, path: Path, places: dict[str, tuple[int, int]], names: list[str]) -> Any:
        for name in names:
            if name in places:
                return _load(path, name, *places[name])
        raise TraceError(f"missing: no variable {names[0]!r} among the traces")

    def close(self) -> None:
        """Nothing stays open between trials."""


def variables_of(path: Path) -> dict[str, tuple[int, int]]:
    """Place and length in bytes of every variable of a version 5 file."""
    places: dict[str, tuple[int, int]] = {}
    size = path.stat().st_size
    with path.open("rb") as file:
        order = _byte_order(file.read(_HEADER), path)
        place = _HEADER
        while place + 8 <= size:
            file.seek(place)
            kind, length = struct.unpack(order + "II", file.read(8))
            if kind not in (_COMPRESSED, _MATRIX) or place + 8 + length > size:
                raise TraceError(f"{path.name} is damaged or truncated at byte {place}")
            places[_name(file.read(min(length, 4096)), kind, order, path)] = (place, 8 + length)
            place += 8 + length
    return places


def _byte_order(header: bytes, path: Path) -> str:
    mark = header[126:128]
    if len(header) < _HEADER or mark not in (b"IM", b"MI"):
        raise TraceError(f"{path.name} is no MATLAB file of version 5 to 7.3")
    return "<" if mark == b"IM" else ">"


def _name(head: bytes, kind: int, order: str, path: Path) -> str:
    """Name of a variable from the first bytes of its element: flags, dimensions, name."""
    try:
        if kind == _COMPRESSED:
            head = zlib.decompressobj().decompress(head, 4096)[8:]
        place = 16  # past the array flags
        _, length = struct.unpack_from(order + "II", head, place)
        place += 8 + (length + 7) // 8 * 8
        kind_and_length, length = struct.unpack_from(order + "II", head, place)
        if kind_and_length >> 16:  # a small element holds its data in its own tag
            length = kind_and_length >> 16
            return head[place + 4 : place + 4 + length].decode("ascii")
        return head[place + 8 : place + 8 + length].decode("ascii")
    except (zlib.error, struct.error, UnicodeDecodeError) as error:
        raise TraceError(f"{path.name} is damaged: {str(error)[:80]}") from error


def _load(path: Path, name: str, place: int, length: int) -> Any:
    from scipy.io import loadmat

    if length > _MOST_BYTES:
        raise TraceError(f"variable {name!r} has more than {_MOST_BYTES} bytes")
    with path.open("rb") as file:
        header = file.read(_HEADER)
        file.seek(place)
        data = io.BytesIO(header + file.read(length))
    try:
        return loadmat(data, simplify_cells=True)[name]
    except Exception as error:  # SciPy lets zlib, type and key errors of a damaged variable through
        raise TraceError(f"unreadable: variable {name!r}: {str(error)[:120]}") from error


def _column(value: Any, name: str | int, bare: bool = False) -> NDArray[np.float64]:
    if isinstance(value, dict):
        if name not in value:
            raise TraceError(f"unknown channel: no {name!r} in the struct, it has {', '.join(list(value)[:8])}")
        return as_samples(value[name], name)
    if bare:
        return as_samples(value, name)
    table = np.asarray(value)
    if not isinstance(name, int) or table.ndim != 2 or not 0 <= name < table.shape[1]:
        raise TraceError(f"unknown channel: no column {name!r} in a matrix of shape {table.shape}")
    return as_samples(table[:, name], name)
