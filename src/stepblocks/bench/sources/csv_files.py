"""Traces as one CSV file per trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.layout import fill_pattern, inside
from stepblocks.bench.session import Session
from stepblocks.bench.sources.base import TraceError, as_samples

_MOST_BYTES = 1 << 30


def trial_file(session: Session, trial: str) -> Path:
    """File of one trial."""
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


class CsvSource:
    """One CSV file per trial."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def columns(self, trial: str, names: tuple[str | int, ...]) -> dict[str | int, NDArray[np.float64]]:
        """Read columns of one trial."""
        import pandas as pd

        acquisition = self._session.acquisition
        path = trial_file(self._session, trial)
        by_index = any(isinstance(name, int) for name in names)
        try:
            table = pd.read_csv(
                path,
                sep=acquisition.delimiter,
                decimal=acquisition.decimal,
                skiprows=acquisition.skip_lines,
                header=None if by_index else 0,
                skipinitialspace=True,
                float_precision="round_trip",
            )
        except (ValueError, UnicodeDecodeError, OSError) as error:
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise TraceError(f"unreadable: {path.name}: {reason[:120]}") from error
        table.columns = [c.strip() if isinstance(c, str) else c for c in table.columns]
        found = {}
        for name in names:
            if name not in table.columns:
                listed = ", ".join(str(column) for column in list(table.columns)[:8])
                raise TraceError(f"unknown channel: {path.name} has no {name!r}, it has {listed}")
            found[name] = as_samples(table[name].to_numpy(), name)
        return found

    def close(self) -> None:
        """Nothing stays open between trials."""
