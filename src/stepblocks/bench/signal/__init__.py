"""One trace: whether it can be measured, where things happen in it, and its figures."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.faults import FaultKind, TraceError

Array = NDArray[np.float64]

MOST_SAMPLES = 20_000_000  # a longer trace is refused; at 10 kHz it lasts half an hour
_LISTED_NAMES = 8  # of channels that a message lists


class Estimate(NamedTuple):
    """A value and its standard uncertainty, in one unit; NaN where unknown."""

    value: float
    std: float


class Tool(NamedTuple):
    """The ring of a tool: frequency [Hz] and decay time [s]."""

    frequency: float
    decay_time: float


# where nothing is known of the ring yet
USUAL_TOOL = Tool(300.0, 21e-3)


@dataclass(frozen=True)
class Trace:
    """A record of both forces.

    Attributes
    ----------
    time : Array
        Shape (n,), instants of the samples [s].
    tangential : Array
        Shape (n,), force along the drag F_x [N].
    normal : Array
        Shape (n,), force into the block F_y [N].
    """

    time: Array
    tangential: Array
    normal: Array


def refuse_oversized_channel(sample_count: int, channel: str | int) -> None:
    """Refuse a channel of too many samples before it is read into memory.

    Raises
    ------
    TraceError
        If it has more than `MOST_SAMPLES` samples.
    """
    if sample_count > MOST_SAMPLES:
        raise TraceError(
            FaultKind.WITHOUT_HEADING,
            f"channel {channel!r} has {sample_count} samples, more than {MOST_SAMPLES}",
        )


def format_first_eight_names(names: Iterable[str]) -> str:
    """Return the first eight names as a text, separated by commas."""
    return ", ".join(islice(names, _LISTED_NAMES))
