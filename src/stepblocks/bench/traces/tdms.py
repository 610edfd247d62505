"""Traces in TDMS (LabVIEW): channel by channel; only the index of the file is held."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.bench.session import Place
from stepblocks.bench.signal import TraceError, check_size, join_first
from stepblocks.contact import Array

if TYPE_CHECKING:
    from nptdms import TdmsFile, TdmsGroup


@contextmanager
def open_tdms(path: Path, layout: object) -> "Iterator[TdmsFile]":
    """Open a file and read its index."""
    from nptdms import TdmsFile

    # npTDMS leaves a file open whose index it could not read, so it is given an open one
    with path.open("rb") as handle:
        try:
            file = TdmsFile.open(handle)
        except (
            Exception
        ) as error:  # npTDMS lets struct, key and value errors of a damaged index through
            raise TraceError(f"{path.name} is no readable TDMS file: {str(error)[:120]}") from error
        yield file


def read_tdms_column(group: "TdmsGroup", name: str | int) -> Array:
    """Read one channel."""
    try:
        channel = group.channels()[name] if isinstance(name, int) else group[name]
    except (KeyError, IndexError):
        raise TraceError(
            f"unknown channel: no {name!r} in group {group.name!r}, it has "
            + join_first(channel.name for channel in group.channels())
        ) from None
    check_size(len(channel), name)
    try:
        return np.asarray(channel[:])
    except (OSError, ValueError, EOFError) as error:
        raise TraceError(f"unreadable: channel {name!r}: {str(error)[:120]}") from error


def find_tdms_group(file: "TdmsFile", place: Place) -> "TdmsGroup":
    """Find the group of one trial; a file of its own may call its one group anything."""
    if place.own_file and len(groups := file.groups()) == 1:
        return groups[0]
    for name in place.groups:
        with suppress(KeyError):
            return file[name]
    raise TraceError(f"missing: no group {place.groups[0]!r} among the traces")
