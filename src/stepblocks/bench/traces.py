"""The traces of a session: opened where they lie, and one read in SI."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.bench.names import fill_pattern, inside
from stepblocks.bench.session import Session
from stepblocks.bench.signal.trace import Trace
from stepblocks.bench.sources import FORMATS, Place, TextLayout, TraceError
from stepblocks.errors import BenchError

_MOST_BYTES = 1 << 30  # of the file of one trial
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


class Traces:
    """Traces of a session, open for reading: one container that stays open, or one file per trial."""

    def __init__(self, session: Session) -> None:
        self.session = session
        acquisition = session.acquisition
        self._format = FORMATS[acquisition.kind]
        self._channels = acquisition.channels.parts()
        headed = not any(isinstance(channel.column, int) for channel, _ in self._channels.values())
        self._layout = TextLayout(acquisition.delimiter, acquisition.decimal, acquisition.skip_lines, headed)
        self._open = ExitStack()
        self._container: Any = None
        if acquisition.per_trial:
            return
        path = inside(session.folder, acquisition.traces, "acquisition.traces")
        if not path.is_file():
            raise BenchError(f"traces are missing, expected {acquisition.traces} [{session.folder}]")
        try:
            self._container = self._open.enter_context(self._format.open(path, self._layout))
        except TraceError as error:
            raise BenchError(f"traces cannot be read: {error} [{path}]") from error

    def __enter__(self) -> Traces:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def read(self, trial: str) -> Trace:
        """Read one trace in SI; `TraceError` where the trial has none that can be used."""
        acquisition = self.session.acquisition
        names = tuple(channel.column for channel, _ in self._channels.values())
        with self._file_of(trial) as file:
            place = Place(
                trial, _groups(acquisition.group, trial), acquisition.per_trial, acquisition.group is not None
            )
            raw = self._format.columns(file, place, names)
        found = {part: raw[c.column] * c.scale(dimension, part) for part, (c, dimension) in self._channels.items()}
        sizes = {part: values.size for part, values in found.items()}
        if len(set(sizes.values())) > 1:
            listed = ", ".join(f"{part} {size}" for part, size in sizes.items())
            raise TraceError(f"truncated: the channels have different lengths ({listed} samples)")
        if "time" not in found:
            found["time"] = np.arange(sizes["tangential"]) / acquisition.sample_rate
        return Trace(**found)

    @contextmanager
    def _file_of(self, trial: str) -> Iterator[Any]:
        if self._container is not None:
            yield self._container
        else:
            with self._format.open(_trial_file(self.session, trial), self._layout) as file:
                yield file


def _trial_file(session: Session, trial: str) -> Path:
    try:
        relative = fill_pattern(session.acquisition.traces, trial=trial)
    except ValueError as error:
        raise TraceError(str(error)) from error
    if "/" in trial or "\\" in trial or ".." in trial:
        raise TraceError(f"trial {trial!r} is no part of a file name")
    path = inside(session.folder, relative, "acquisition.traces")
    if not path.is_file():
        raise TraceError(f"missing: there is no {relative}")
    if path.stat().st_size > _MOST_BYTES:
        raise TraceError(f"{relative} has more than {_MOST_BYTES} bytes")
    return path


def _groups(pattern: str | None, trial: str) -> tuple[str, ...]:
    """Names that the group of a trial may have, the likeliest first."""
    if pattern is not None:
        try:
            return (fill_pattern(pattern, trial=trial),)
        except ValueError as error:
            raise TraceError(str(error)) from error
    found = []
    for usual in _USUAL_GROUPS:
        with suppress(ValueError):
            found.append(fill_pattern(usual, trial=trial))
    return tuple(dict.fromkeys(found))
