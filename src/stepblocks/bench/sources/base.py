"""What a format of traces is, and the fault that costs one trial and not the session."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_SAMPLES = 20_000_000  # a longer trace is refused; at 10 kHz it lasts half an hour

Array = NDArray[np.float64]
Names = tuple[str | int, ...]  # of columns, or their indices


class TraceError(Exception):
    """A trace that cannot be used; the message is the reason for its exclusion."""


@dataclass(frozen=True)
class TextLayout:
    """How a text file is to be read."""

    delimiter: str = ","
    decimal: str = "."
    skip_lines: int = 0  # before the header
    headed: bool = True  # whether columns have names


@dataclass(frozen=True)
class Place:
    """Where in a file a trial is to be looked for."""

    trial: str
    groups: tuple[str, ...]  # names that its group may have, the likeliest first
    own_file: bool  # the file holds this trial alone
    declared: bool  # the session says how groups are called

    @property
    def is_file(self) -> bool:
        """The file itself is the group."""
        return self.own_file and not self.declared


@dataclass(frozen=True)
class Format:
    """A format of traces: how a file is opened, and how columns of a trial are read out of it."""

    suffixes: tuple[str, ...]
    # a file that is no such file is a `TraceError`
    open: Callable[[Path, TextLayout], AbstractContextManager[Any]]
    # columns of one trial, each of shape (n,), in the units of the file; `TraceError` where it has none
    columns: Callable[[Any, Place, Names], dict[str | int, Array]]


def as_samples(values: object, name: str | int) -> Array:
    """Return one column as floats of shape (n,)."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise TraceError(f"channel {name!r} holds no numbers but {array.dtype}")
    check_size(array.size, name)
    if array.ndim > 1 and max(array.shape) != array.size:
        raise TraceError(f"channel {name!r} is a table of shape {array.shape}, no column")
    return np.asarray(array, dtype=float).ravel()


def check_size(count: int, name: str | int) -> None:
    """Refuse a channel before it is read into memory."""
    if count > MOST_SAMPLES:
        raise TraceError(f"channel {name!r} has {count} samples, more than {MOST_SAMPLES}")
