"""Open the traces of a session, and read one trial in SI."""

from __future__ import annotations

import numpy as np

from stepblocks.bench.session import Channel, Session
from stepblocks.bench.sources.base import TraceError, TraceSource
from stepblocks.bench.trace import Trace


def open_source(session: Session) -> TraceSource:
    """Open the traces of a session for reading."""
    kind = session.acquisition.kind
    if kind == "csv":
        from stepblocks.bench.sources.csv_files import CsvSource

        return CsvSource(session)
    if kind == "tdms":
        from stepblocks.bench.sources.tdms import TdmsSource

        return TdmsSource(session)
    if kind == "mat":
        from stepblocks.bench.sources.mat import open_mat

        return open_mat(session)
    from stepblocks.bench.sources.hdf5 import Hdf5Source

    return Hdf5Source(session)


def read_trace(source: TraceSource, session: Session, trial: str) -> Trace:
    """Read one trace in SI."""
    channels = session.acquisition.channels
    wanted: dict[str, tuple[Channel, str]] = {
        "tangential": (channels.tangential, "force"),
        "normal": (channels.normal, "force"),
    }
    if channels.time is not None:
        wanted["time"] = (channels.time, "time")
    raw = source.columns(trial, tuple(channel.column for channel, _ in wanted.values()))
    found = {
        part: raw[channel.column] * channel.scale(dimension, part) for part, (channel, dimension) in wanted.items()
    }
    sizes = {part: values.size for part, values in found.items()}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{part} {size}" for part, size in sizes.items())
        raise TraceError(f"truncated: the channels have different lengths ({listed} samples)")
    if "time" not in found:
        found["time"] = np.arange(sizes["tangential"]) / session.acquisition.sample_rate
    return Trace(found["time"], found["tangential"], found["normal"])
