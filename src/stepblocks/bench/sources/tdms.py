"""Traces in TDMS (LabVIEW), a group per trial or a file per trial."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.layout import inside
from stepblocks.bench.session import Session
from stepblocks.bench.sources.base import MOST_SAMPLES, TraceError, as_samples, group_names
from stepblocks.bench.sources.csv_files import trial_file
from stepblocks.errors import BenchError


class TdmsSource:
    """Reads channel by channel; only the index of the file is held."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._file: Any = None
        self._open_files = ExitStack()
        if not session.acquisition.per_trial:
            path = inside(session.folder, session.acquisition.traces, "acquisition.traces")
            if not path.is_file():
                raise BenchError(f"traces are missing, expected {session.acquisition.traces} [{session.folder}]")
            try:
                self._file = self._open_files.enter_context(_opened(path))
            except TraceError as error:
                raise BenchError(f"traces cannot be read: {error} [{path}]") from error

    def columns(self, trial: str, names: tuple[str | int, ...]) -> dict[str | int, NDArray[np.float64]]:
        """Read columns of one trial."""
        if self._file is not None:
            return self._read(self._file, trial, names)
        with _opened(trial_file(self._session, trial)) as file:
            return self._read(file, trial, names)

    def _read(self, file: Any, trial: str, names: tuple[str | int, ...]) -> dict[str | int, NDArray[np.float64]]:
        wanted = group_names(self._session.acquisition.group, trial)
        present = {group.name for group in file.groups()} if len(wanted) == 1 or self._file is None else None
        group = _group(file, wanted, alone=self._file is None and present is not None and len(present) == 1)
        found = {}
        for name in names:
            try:
                channel = group.channels()[name] if isinstance(name, int) else group[name]
            except (KeyError, IndexError):
                listed = ", ".join(channel.name for channel in group.channels()[:8])
                raise TraceError(f"unknown channel: no {name!r} in group {group.name!r}, it has {listed}") from None
            if len(channel) > MOST_SAMPLES:
                raise TraceError(f"channel {name!r} has {len(channel)} samples, more than {MOST_SAMPLES}")
            try:
                found[name] = as_samples(channel[:], name)
            except (OSError, ValueError, EOFError) as error:
                raise TraceError(f"unreadable: channel {name!r}: {str(error)[:120]}") from error
        return found

    def close(self) -> None:
        """Close the file."""
        self._open_files.close()


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a TDMS file; npTDMS leaves a file open whose index it could not read, so it is given an open one."""
    from nptdms import TdmsFile

    with path.open("rb") as handle:
        try:
            file = TdmsFile.open(handle)
        except Exception as error:  # npTDMS lets struct, key and value errors of a damaged index through
            raise TraceError(f"{path.name} is no readable TDMS file: {str(error)[:120]}") from error
        yield file


def _group(file: Any, names: list[str], alone: bool) -> Any:
    if alone:
        return file.groups()[0]
    for name in names:
        try:
            return file[name]
        except KeyError:
            continue
    raise TraceError(f"missing: no group {names[0]!r} among the traces")
