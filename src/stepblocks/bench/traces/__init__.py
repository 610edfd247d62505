"""The traces of a session: opened where they lie, as CSV or in any of the formats beside, and one read in SI."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.session import Acquisition, Place, Session, fill_pattern, inside
from stepblocks.bench.signal import Trace, TraceError, check_size, listed
from stepblocks.bench.traces import hdf5, mat, tdms
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


def _open_text(path: Path, layout: Acquisition) -> nullcontext[Any]:
    # columns without names are counted from 0
    import pandas as pd

    try:
        table = pd.read_csv(
            path,
            sep=layout.delimiter,
            decimal=layout.decimal,
            skiprows=layout.skip_lines,
            header=None if any(isinstance(c.column, int) for c, _ in layout.channels.parts().values()) else 0,
            skipinitialspace=True,
            float_precision="round_trip",
        )
    except (ValueError, UnicodeDecodeError, OSError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TraceError(f"unreadable: {path.name}: {reason[:120]}") from error
    table.columns = [c.strip() if isinstance(c, str) else c for c in table.columns]
    table.attrs["file"] = path.name
    return nullcontext(table)


def _text_columns(table: Any, place: Place, names: tuple[str | int, ...]) -> dict[str | int, Any]:
    for name in names:
        if name not in table.columns:
            raise TraceError(
                f"unknown channel: {table.attrs['file']} has no {name!r}, it has {listed(map(str, table.columns))}"
            )
    return {name: table[name].to_numpy() for name in names}


# how a file is opened, and how columns of a trial, each of shape (n,), are read out of it in the units of the file;
# both raise `TraceError`
READERS: dict[str, tuple[Any, Any]] = {
    "csv": (_open_text, _text_columns),
    "hdf5": (hdf5.open_hdf5, hdf5.hdf5_columns),
    "tdms": (tdms.open_tdms, tdms.tdms_columns),
    "mat": (mat.open_mat, mat.mat_columns),
}


class Traces(ExitStack):
    """Traces of a session, open for reading: one container that stays open, or one file per trial."""

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.session = session
        acquisition = session.acquisition
        self._open_file, self._columns = READERS[acquisition.kind]
        self._channels = acquisition.channels.parts()
        self._container: Any = None
        if acquisition.per_trial:
            return
        path = inside(session.folder, acquisition.traces, "acquisition.traces")
        if not path.is_file():
            raise BenchError(f"traces are missing, expected {acquisition.traces} [{session.folder}]")
        try:
            self._container = self.enter_context(self._open_file(path, acquisition))
        except TraceError as error:
            raise BenchError(f"traces cannot be read: {error} [{path}]") from error

    def read(self, trial: str) -> Trace:
        """Read one trace in SI; `TraceError` where the trial has none that can be used."""
        acquisition = self.session.acquisition
        if self._container is None:
            opened = self._open_file(_trial_file(self.session, trial), acquisition)
        else:
            opened = nullcontext(self._container)
        with opened as file:
            own = acquisition.per_trial
            place = Place(trial, _groups(acquisition.group, trial), own, own and acquisition.group is None)
            raw = self._columns(file, place, tuple(channel.column for channel, _ in self._channels.values()))
        found = {
            part: _samples(raw[c.column], c.column) * c.scale(dimension, part)
            for part, (c, dimension) in self._channels.items()
        }
        sizes = {part: values.size for part, values in found.items()}
        if len(set(sizes.values())) > 1:
            told = ", ".join(f"{part} {size}" for part, size in sizes.items())
            raise TraceError(f"truncated: the channels have different lengths ({told} samples)")
        if "time" not in found:
            found["time"] = np.arange(sizes["tangential"]) / acquisition.sample_rate
        return Trace(**found)


def _samples(values: object, name: str | int) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise TraceError(f"channel {name!r} holds no numbers but {array.dtype}")
    check_size(array.size, name)
    if array.ndim > 1 and max(array.shape) != array.size:
        raise TraceError(f"channel {name!r} is a table of shape {array.shape}, no column")
    return np.asarray(array, dtype=float).ravel()


def _trial_file(session: Session, trial: str) -> Path:
    relative = fill_pattern(session.acquisition.traces, trial=trial)
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
        return (fill_pattern(pattern, trial=trial),)
    found = []
    for usual in _USUAL_GROUPS:
        with suppress(TraceError):
            found.append(fill_pattern(usual, trial=trial))
    return tuple(dict.fromkeys(found))
