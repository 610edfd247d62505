"""Traces in MATLAB files: a struct or a matrix per trial.

A file of one trial may also hold a variable per channel.
"""

import io
import struct
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat, whosmat

from stepblocks.bench.session import Place
from stepblocks.bench.signal import TraceError, join_first
from stepblocks.bench.traces.hdf5 import find_hdf5_group, open_hdf5, read_hdf5_column

_HEADER = 128
_NAMED = 4096  # bytes of a variable in which its name lies
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_MOST_BYTES = 1 << 30  # of one variable


@dataclass(frozen=True)
class Variables:
    """A version 5 file, a row of variables, of which it is known where they lie.

    Attributes
    ----------
    path : Path
    places : dict[str, tuple[int, int]]
        First byte and length of each.
    """

    path: Path
    places: dict[str, tuple[int, int]]

    def load(self, names: tuple[str, ...]) -> object:
        """Read the first of `names` that is there."""
        name = next((name for name in names if name in self.places), None)
        if name is None:
            raise TraceError(f"missing: no variable {names[0]!r} among the traces")
        place, length = self.places[name]
        TraceError.require(
            length <= _MOST_BYTES,
            f"variable {name!r} has more than {_MOST_BYTES} bytes",
        )
        try:
            return loadmat(_extract_variable(self.path, place, length), simplify_cells=True)[name]
        except MemoryError:
            raise
        except (
            Exception
        ) as error:  # SciPy lets zlib, type and key errors of a damaged variable through
            raise TraceError(f"unreadable: variable {name!r}: {str(error)[:120]}") from error


def _extract_variable(path: Path, place: int, length: int) -> io.BytesIO:
    # Return a file of one variable alone
    with path.open("rb") as file:
        header = file.read(_HEADER)
        file.seek(place)
        return io.BytesIO(header + file.read(length))


def open_mat(path: Path, layout: object) -> AbstractContextManager[object]:
    """Open a file of any version."""
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(512)
        is_hdf5 = _HDF5_MARK in (head, file.read(8))
    return open_hdf5(path, layout) if is_hdf5 else nullcontext(find_mat_variables(path))


def find_mat_group(file: object, place: Place) -> object:
    """Find the struct or the matrix of one trial; a file of its own is the group itself."""
    if not isinstance(file, Variables):
        return find_hdf5_group(file, place)
    value = file if place.is_file else file.load(place.groups)
    return value if isinstance(value, dict | Variables) else np.asarray(value)


def read_mat_column(group: object, name: str | int) -> object:
    """Read one channel."""
    if isinstance(group, Variables):
        return group.load((str(name),))
    if isinstance(group, dict):
        TraceError.require(
            name in group,
            f"unknown channel: no {name!r} in the struct, it has {join_first(group)}",
        )
        return group[name]
    if not isinstance(group, np.ndarray):
        return read_hdf5_column(group, name)
    if not isinstance(name, int) or group.ndim != 2 or not 0 <= name < group.shape[1]:
        raise TraceError(f"unknown channel: no column {name!r} in a matrix of shape {group.shape}")
    return group[:, name]


def find_mat_variables(path: Path) -> Variables:
    """Look through a version 5 file for the names of its variables, once.

    SciPy reads through all of them to find one.
    """
    places: dict[str, tuple[int, int]] = {}
    size = path.stat().st_size
    place = _HEADER
    with path.open("rb") as file:
        mark = file.read(_HEADER)[126:]
        TraceError.require(
            mark in (b"IM", b"MI"),
            f"{path.name} is no MATLAB file of version 5 to 7.3",
        )
        while place + 8 <= size:
            file.seek(place)
            _, length = struct.unpack("<II" if mark == b"IM" else ">II", file.read(8))
            try:
                ((name, *_),) = whosmat(_extract_variable(path, place, min(8 + length, _NAMED)))
            except Exception as error:  # as above
                raise TraceError(
                    f"{path.name} is damaged at byte {place}: {str(error)[:80]}"
                ) from error
            TraceError.require(
                place + 8 + length <= size,
                f"{path.name} is damaged or truncated at byte {place}",
            )
            places[name] = place, 8 + length
            place += 8 + length
    return Variables(path, places)
