"""What every source of traces offers, and the fault that costs one trial and not the session."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.layout import fill_pattern

MOST_SAMPLES = 20_000_000  # A longer trace is refused; at 10 kHz it lasts half an hour

_USUAL_GROUPS = (
    "{trial:04d}",
    "trial_{trial:04d}",
    "{trial}",
    "trial_{trial}",
    "trial{trial:04d}",
    "trial{trial}",
    "trial-{trial:04d}",
    "trial {trial}",
)


class TraceError(Exception):
    """A trace that cannot be used; the message is the reason for its exclusion."""


class TraceSource(Protocol):
    """A place that traces are read from."""

    def columns(self, trial: str, names: tuple[str | int, ...]) -> dict[str | int, NDArray[np.float64]]:
        """Read columns of one trial, each of shape (n,), in the units of the file; `TraceError` where it has none."""
        ...

    def close(self) -> None:
        """Give the file back."""
        ...


def group_names(pattern: str | None, trial: str) -> list[str]:
    """Names that the group of a trial may have, the likeliest first."""
    found = []
    for candidate in (pattern,) if pattern is not None else _USUAL_GROUPS:
        try:
            name = fill_pattern(candidate, trial=trial)
        except ValueError as error:
            if pattern is not None:
                raise TraceError(str(error)) from error
            continue
        if name not in found:
            found.append(name)
    return found


def as_samples(values: object, name: str | int) -> NDArray[np.float64]:
    """Return one column as floats of shape (n,)."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise TraceError(f"channel {name!r} holds no numbers but {array.dtype}")
    if array.size > MOST_SAMPLES:
        raise TraceError(f"channel {name!r} has {array.size} samples, more than {MOST_SAMPLES}")
    if array.ndim > 1 and max(array.shape) != array.size:
        raise TraceError(f"channel {name!r} is a table of shape {array.shape}, no column")
    return np.asarray(array, dtype=float).ravel()
