"""Traces in MATLAB files: a struct or a matrix per trial, or a variable per channel in a file of the trial's own."""

from __future__ import annotations

import io
import struct
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.bench.session import Place
from stepblocks.bench.signal import TraceError, listed
from stepblocks.bench.traces.hdf5 import hdf5_columns, open_hdf5

_HEADER = 128
_COMPRESSED, _MATRIX = 15, 14
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_MOST_BYTES = 1 << 30  # of one variable


@dataclass(frozen=True)
class Variables:
    """A version 5 file, a row of variables, of which it is known where they lie."""

    path: Path
    places: dict[str, tuple[int, int]]  # first byte and length of each

    def load(self, names: tuple[str, ...]) -> Any:
        """Read the first of `names` that is there."""
        from scipy.io import loadmat

        name = next((name for name in names if name in self.places), None)
        if name is None:
            raise TraceError(f"missing: no variable {names[0]!r} among the traces")
        place, length = self.places[name]
        if length > _MOST_BYTES:
            raise TraceError(f"variable {name!r} has more than {_MOST_BYTES} bytes")
        with self.path.open("rb") as file:
            header = file.read(_HEADER)
            file.seek(place)
            data = io.BytesIO(header + file.read(length))
        try:
            return loadmat(data, simplify_cells=True)[name]
        except Exception as error:  # SciPy lets zlib, type and key errors of a damaged variable through
            raise TraceError(f"unreadable: variable {name!r}: {str(error)[:120]}") from error


def open_mat(path: Path, layout: Any) -> AbstractContextManager[Any]:
    """Open a file of any version."""
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(512)
        is_hdf5 = _HDF5_MARK in (head, file.read(8))
    return open_hdf5(path, layout) if is_hdf5 else nullcontext(variables_of(path))


def mat_columns(file: Any, place: Place, names: tuple[str | int, ...]) -> dict[str | int, Any]:
    """Read columns of one trial."""
    if not isinstance(file, Variables):
        return hdf5_columns(file, place, names)
    if place.is_file:
        return {name: file.load((str(name),)) for name in names}
    value = file.load(place.groups)
    return {name: _column(value, name) for name in names}


def _column(value: Any, name: str | int) -> Any:
    if isinstance(value, dict):
        if name not in value:
            raise TraceError(f"unknown channel: no {name!r} in the struct, it has {listed(value)}")
        return value[name]
    table = np.asarray(value)
    if not isinstance(name, int) or table.ndim != 2 or not 0 <= name < table.shape[1]:
        raise TraceError(f"unknown channel: no column {name!r} in a matrix of shape {table.shape}")
    return table[:, name]


def variables_of(path: Path) -> Variables:
    """Look through a version 5 file for its variables; SciPy reads through all of them to find one, so this is done once."""
    from scipy.io import whosmat

    places: list[tuple[int, int]] = []
    size, place = path.stat().st_size, _HEADER
    with path.open("rb") as file:
        mark = file.read(_HEADER)[126:128]
        if mark not in (b"IM", b"MI"):
            raise TraceError(f"{path.name} is no MATLAB file of version 5 to 7.3")
        while place + 8 <= size:
            file.seek(place)
            kind, length = struct.unpack("<II" if mark == b"IM" else ">II", file.read(8))
            if kind not in (_COMPRESSED, _MATRIX) or place + 8 + length > size:
                raise TraceError(f"{path.name} is damaged or truncated at byte {place}")
            places.append((place, 8 + length))
            place += 8 + length
    try:
        return Variables(path, dict(zip((name for name, *_ in whosmat(path)), places, strict=True)))
    except Exception as error:  # SciPy lets zlib, type and key errors of a damaged file through
        raise TraceError(f"{path.name} is damaged: {str(error)[:80]}") from error
