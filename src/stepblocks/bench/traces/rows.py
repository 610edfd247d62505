"""Arrays of trials x samples: one row of each array is one trial."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.faults import FaultKind, TraceError

_LISTED = 8  # arrays that a message lists


@dataclass(frozen=True)
class TrialRow:
    """A row of the arrays of a file.

    Attributes
    ----------
    number : int
        Of the row, from 0.
    count : int
        Of the rows that arrays of trials have: as many as the table has trials.
    """

    number: int
    count: int

    def find_trial_axis(self, shape: tuple[int, ...], name: str | int) -> int:
        """Return the axis of an array along which trials lie.

        Raises
        ------
        TraceError
            If the array does not have as many rows as the table has trials.
        """
        if len(shape) == 2 and shape[0] == self.count != shape[1]:
            return 0
        # MATLAB's columns are HDF5's rows
        if len(shape) == 2 and shape[1] == self.count != shape[0]:
            return 1
        raise TraceError(
            FaultKind.WITHOUT_HEADING,
            f"array {name!r} is {format_shape(shape)}: of one row for each trial it has "
            f"{self.count} rows, as many as the table of trials",
        )

    def select_samples(self, array: NDArray[np.generic], name: str | int) -> NDArray[np.generic]:
        """Return the samples of the trial; an array with a single row is common to all trials.

        Rows that are shorter than the longest are filled up with NaN, which is cut off.
        """
        if max(array.shape, default=0) == array.size and self.count > 1:
            return array.ravel()
        axis = self.find_trial_axis(array.shape, name)
        return cut_trailing_nans(np.take(array, self.number, axis=axis))


def cut_trailing_nans(samples: NDArray[np.generic]) -> NDArray[np.generic]:
    """Cut off the NaN that fill up a row of shape (n,) at its end."""
    if samples.dtype.kind != "f":
        return samples
    seen = np.flatnonzero(~np.isnan(samples))
    if not seen.size:
        return samples
    return samples[: seen[-1] + 1]


def describe_file_arrays(shapes: Mapping[str, tuple[int, ...]]) -> str:
    """Say what arrays a file holds, and how a row per trial is declared where it may be one."""
    listed = [f"{name} ({format_shape(shape)})" for name, shape in shapes.items()]
    text = ", ".join(listed[:_LISTED])
    if len(listed) > _LISTED:
        text = f"{text}, ..."
    if not listed:
        return "the file holds nothing"
    tables = [shape for shape in shapes.values() if len(shape) == 2]
    if not tables:
        return f"the file holds {text}"
    return (
        f"the file holds {text}; where each row is a trial, in the order of the table of trials, "
        'declare `rows = "trials"` under [acquisition]'
    )


def format_shape(shape: tuple[int, ...]) -> str:
    """Write the shape of an array as people say it."""
    if not shape:
        return "a number or a group"
    return " x ".join(str(size) for size in shape)
