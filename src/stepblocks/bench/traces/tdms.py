"""Traces in TDMS (LabVIEW): channel by channel; only the index of the file is held."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.signal import format_first_eight_names, refuse_oversized_channel
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace

if TYPE_CHECKING:
    from nptdms import TdmsChannel, TdmsFile, TdmsGroup

_LONGEST_REASON = 120  # letters of a message of npTDMS


class TdmsReader(TraceReader["TdmsFile", "TdmsGroup"]):
    """Reads a group per trial with a channel per column."""

    @contextmanager
    def open(self, path: Path, layout: TextLayout) -> "Iterator[TdmsFile]":
        """Open a file and read its index."""
        from nptdms import TdmsFile

        # npTDMS leaves a file open whose index it could not read, so it is given an open one
        with path.open("rb") as handle:
            try:
                file = TdmsFile.open(handle)
            except Exception as error:  # struct, key and value errors of a damaged index
                reason = str(error)[:_LONGEST_REASON]
                raise TraceError(
                    FaultKind.WITHOUT_HEADING,
                    f"{path.name} is no readable TDMS file: {reason}",
                ) from error
            yield file

    def find_group(self, file: "TdmsFile", place: TrialPlace) -> "TdmsGroup":
        """Find the group of one trial; a file of its own may call its one group anything."""
        if place.has_own_file:
            groups = file.groups()
            if len(groups) == 1:
                return groups[0]
        for name in place.groups:
            with suppress(KeyError):
                return file[name]
        raise TraceError(FaultKind.MISSING, f"no group {place.groups[0]!r} among the traces")

    def read_column(self, group: "TdmsGroup", column: str | int) -> ArrayLike:
        """Read one channel."""
        channel = _get_tdms_channel(group, column)
        refuse_oversized_channel(len(channel), column)
        try:
            return np.asarray(channel[:])
        except (OSError, ValueError, EOFError) as error:
            reason = str(error)[:_LONGEST_REASON]
            raise TraceError(FaultKind.UNREADABLE, f"channel {column!r}: {reason}") from error

    def read_attributes(self, group: "TdmsGroup", names: Sequence[str | int]) -> dict[str, object]:
        """Return the properties of a trial and of the channels that are named."""
        properties: dict[str, object] = dict(group.properties)
        for name in names:
            if isinstance(name, str):
                with suppress(KeyError):
                    properties |= dict(group[name].properties)
        return properties


def _get_tdms_channel(group: "TdmsGroup", channel: str | int) -> "TdmsChannel":
    """Return the channel of a group by its name or index."""
    try:
        if isinstance(channel, int):
            return group.channels()[channel]
        return group[channel]
    except (KeyError, IndexError):
        known = format_first_eight_names(channel.name for channel in group.channels())
        raise TraceError(
            FaultKind.UNKNOWN_CHANNEL,
            f"no {channel!r} in group {group.name!r}, it has {known}",
        ) from None
