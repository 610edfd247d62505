"""Traces in MATLAB files: a struct or a matrix per trial.

A file of one trial may also hold a variable per channel.
"""

import io
import struct
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import h5py
import numpy as np
from numpy.typing import ArrayLike
from scipy.io import loadmat, whosmat

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.signal import format_first_eight_names
from stepblocks.bench.traces.hdf5 import Hdf5Reader
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace
from stepblocks.bench.traces.rows import TrialRow, describe_file_arrays

_HEADER = 128  # bytes of a version 5 file before its first variable
_MARK = slice(126, 128)  # of the header, which tells the order of bytes
_BYTE_ORDERS = {b"IM": "<", b"MI": ">"}  # of the `struct` module, by the mark
_TAG = 8  # bytes before a variable, with its type and length
_NAMED = 4096  # bytes of a variable in which its name lies
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK = 512  # bytes before the HDF5 part of a MATLAB file
_LISTED_ITEMS = 10  # of a file, which a message may list
_MOST_BYTES = 1 << 30  # of one variable
_LONGEST_REASON = 120  # letters of a message of SciPy
_LONGEST_REASON_OF_DAMAGE = 80


class Extent(NamedTuple):
    """Where a variable lies in a file [bytes]."""

    start: int
    length: int


@dataclass(frozen=True)
class Variables:
    """A version 5 file, a row of variables, of which it is known where they lie.

    Attributes
    ----------
    path : Path
    extents : dict[str, Extent]
        Of each variable.
    """

    path: Path
    extents: dict[str, Extent]

    def load_first_variable(self, names: tuple[str, ...]) -> object:
        """Read the first of `names` that is there: a struct as a dict, else an array."""
        for name in names:
            if name in self.extents:
                return self._load_variable(name, self.extents[name])
        raise TraceError(
            FaultKind.MISSING,
            f"no variable {names[0]!r} among the traces; {self._describe_variables()}",
        )

    def _describe_variables(self) -> str:
        """Describe the variables of the file by name and shape."""
        shapes: dict[str, tuple[int, ...]] = {}
        for name, extent in islice(self.extents.items(), _LISTED_ITEMS):
            begin = Extent(extent.start, min(extent.length, _NAMED))
            with suppress(Exception):  # SciPy raises anything on damaged variables
                opened: Any = _extract_variable(self.path, begin)  # the stubs know paths alone
                ((_, shape, _kind),) = whosmat(opened)
                shapes[name] = tuple(shape)
        return describe_file_arrays(shapes)

    def _load_variable(self, variable_name: str, extent: Extent) -> object:
        """Read one variable."""
        if extent.length > _MOST_BYTES:
            raise TraceError(
                FaultKind.WITHOUT_HEADING,
                f"variable {variable_name!r} has more than {_MOST_BYTES} bytes",
            )
        try:
            opened: Any = _extract_variable(self.path, extent)  # the stubs know paths alone
            variables = loadmat(opened, simplify_cells=True)
            return variables[variable_name]
        except MemoryError:
            raise
        except Exception as error:  # zlib, type and key errors of a damaged variable
            reason = str(error)[:_LONGEST_REASON]
            raise TraceError(
                FaultKind.UNREADABLE, f"variable {variable_name!r}: {reason}"
            ) from error


def _extract_variable(path: Path, extent: Extent) -> io.BytesIO:
    """Return a file of one variable alone."""
    with path.open("rb") as file:
        header = file.read(_HEADER)
        file.seek(extent.start)
        return io.BytesIO(header + file.read(extent.length))


@dataclass(frozen=True)
class RowOfVariables:
    """A trial that is one row of each variable of a file of version 5."""

    variables: Variables
    row: TrialRow


class MatReader(TraceReader[Any, Any]):
    """Reads files of any version; those from 7.3 on are HDF5."""

    def __init__(self) -> None:
        self._hdf5 = Hdf5Reader()

    def open(self, path: Path, layout: TextLayout) -> AbstractContextManager[object]:
        """Open a file; of a version 5 file the variables are listed."""
        if _is_hdf5(path):
            file: AbstractContextManager[object] = self._hdf5.open(path, layout)
            return file
        return nullcontext(list_mat_variables(path))

    def find_group(self, file: object, place: TrialPlace) -> object:
        """Find the struct or the matrix of one trial; a file of its own is the group itself."""
        if not isinstance(file, Variables):
            return self._hdf5.find_group(file, place)
        if place.row is not None:
            return RowOfVariables(file, place.row)
        if place.is_whole_file:
            return file
        value = file.load_first_variable(place.groups)
        if isinstance(value, dict):
            return value
        return np.asarray(value)

    def read_column(self, group: object, column: str | int) -> ArrayLike:
        """Read one channel."""
        if isinstance(group, RowOfVariables):
            array = np.asarray(group.variables.load_first_variable((str(column),)))
            return group.row.select_samples(array, column)
        if isinstance(group, Variables):
            return np.asarray(group.load_first_variable((str(column),)))
        if isinstance(group, dict):
            return np.asarray(_get_struct_field(group, column))
        if isinstance(group, np.ndarray):
            return _get_matrix_column(group, column)
        return self._hdf5.read_column(group, column)

    def read_attributes(self, group: object, names: Sequence[str | int]) -> Mapping[str, object]:
        """Return the attributes of an HDF5 group; other groups have none."""
        if isinstance(group, h5py.HLObject):
            return self._hdf5.read_attributes(group, names)
        return {}


def _is_hdf5(path: Path) -> bool:
    """Tell whether a file is HDF5, with or without the block that MATLAB puts before it."""
    length = len(_HDF5_MARK)
    with path.open("rb") as file:
        begin = file.read(length)
        file.seek(_USER_BLOCK)
        after_block = file.read(length)
    return _HDF5_MARK in (begin, after_block)


def _get_struct_field(fields: Mapping[str, object], field: str | int) -> object:
    """Return a field of a struct; refuse a name that the struct lacks."""
    if field not in fields:
        raise TraceError(
            FaultKind.UNKNOWN_CHANNEL,
            f"no {field!r} in the struct, it has {format_first_eight_names(fields)}",
        )
    return fields[str(field)]


def _get_matrix_column(matrix: "np.ndarray[Any, Any]", column: str | int) -> ArrayLike:
    """Return a column of a matrix by its index from 0."""
    is_matrix = matrix.ndim == 2
    if not isinstance(column, int) or not is_matrix or not 0 <= column < matrix.shape[1]:
        raise TraceError(
            FaultKind.UNKNOWN_CHANNEL,
            f"no column {column!r} in a matrix of shape {matrix.shape}",
        )
    return np.asarray(matrix[:, column])


def list_mat_variables(path: Path) -> Variables:
    """Look through a version 5 file for the names of its variables, once.

    SciPy reads through all of them to find one.

    Raises
    ------
    TraceError
        If the file is none, damaged or truncated.
    """
    extents: dict[str, Extent] = {}
    size = path.stat().st_size
    with path.open("rb") as file:
        mark = file.read(_HEADER)[_MARK]
        if mark not in _BYTE_ORDERS:
            raise TraceError(
                FaultKind.WITHOUT_HEADING,
                f"{path.name} is no MATLAB file of version 5 to 7.3",
            )
        start = _HEADER
        while start + _TAG <= size:
            length = _read_variable_length(file, start, _BYTE_ORDERS[mark])
            extent = Extent(start, length)
            name = _read_variable_name(path, extent)
            if start + length > size:
                raise TraceError(
                    FaultKind.WITHOUT_HEADING,
                    f"{path.name} is damaged or truncated at byte {start}",
                )
            extents[name] = extent
            start += length
    return Variables(path, extents)


def _read_variable_length(file: BinaryIO, start: int, byte_order: str) -> int:
    """Return the length of the variable at a place, with its tag [bytes]."""
    file.seek(start)
    _, length = struct.unpack(f"{byte_order}II", file.read(_TAG))
    return _TAG + int(length)


def _read_variable_name(path: Path, extent: Extent) -> str:
    """Return the name of a variable from its first bytes."""
    begin = Extent(extent.start, min(extent.length, _NAMED))
    try:
        opened: Any = _extract_variable(path, begin)  # the stubs know paths alone
        ((name, _shape, _kind),) = whosmat(opened)
    except Exception as error:  # zlib, type and key errors of a damaged variable
        reason = str(error)[:_LONGEST_REASON_OF_DAMAGE]
        raise TraceError(
            FaultKind.WITHOUT_HEADING,
            f"{path.name} is damaged at byte {extent.start}: {reason}",
        ) from error
    return str(name)
