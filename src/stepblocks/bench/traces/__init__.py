"""The traces of a session: read in a confined process, or given in SI.

A session has them as CSV or in one of the formats of this folder.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, nullcontext, suppress
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.bench.session import Place, Session, fill_pattern, resolve_inside
from stepblocks.bench.signal import Trace, TraceError, check_size, join_first
from stepblocks.bench.traces import hdf5, mat, tdms
from stepblocks.contact import Array
from stepblocks.errors import BenchError
from stepblocks.files.confined import read_confined
from stepblocks.files.text import is_file

_MOST_BYTES = 1 << 30  # of the file of one trial
# attributes that say the time between two samples, or their rate
_INCREMENTS = {"dt": 1, "wf_increment": 1, "increment": 1, "sample_rate": -1, "fs": -1}
_RATE_TOLERANCE = 0.01
Layout = Mapping[str, Any]  # how the text of traces is written
_USUAL_GROUPS = (
    *("{trial:04d}", "trial_{trial:04d}", "{trial}", "trial_{trial}"),
    *("trial{trial:04d}", "trial{trial}", "trial-{trial:04d}", "trial {trial}"),
)


def _open_text(path: Path, layout: Layout) -> nullcontext[Any]:
    # columns without names are counted from 0
    import pandas as pd

    try:
        table = pd.read_csv(
            path,
            sep=layout["delimiter"],
            decimal=layout["decimal"],
            skiprows=layout["skip_lines"],
            header=0 if layout["named"] else None,
            skipinitialspace=True,
            float_precision="round_trip",
        )
    except (ValueError, UnicodeDecodeError, OSError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TraceError(f"unreadable: {path.name}: {reason[:120]}") from error
    table.columns = [c.strip() if isinstance(c, str) else c for c in table.columns]
    table.attrs["file"] = path.name
    return nullcontext(table)


def _read_text_column(table: Any, name: str | int) -> Any:
    TraceError.require(
        name in table.columns,
        f"unknown channel: {table.attrs['file']} has no {name!r}, it has "
        + join_first(map(str, table.columns)),
    )
    return table[name].to_numpy()


# how a file is opened, how the group of a trial is found in it, and how a column of that, of shape
# (n,), is read in the units of the file; all raise `TraceError`.
READERS: dict[str, tuple[Any, Any, Any]] = {
    "csv": (_open_text, lambda table, _: table, _read_text_column),
    "hdf5": (hdf5.open_hdf5, hdf5.find_hdf5_group, hdf5.read_hdf5_column),
    "tdms": (tdms.open_tdms, tdms.find_tdms_group, tdms.read_tdms_column),
    "mat": (mat.open_mat, mat.find_mat_group, mat.read_mat_column),
}


@lru_cache(maxsize=1)
def _open_cached(
    kind: str, path: Path, _stamp: tuple[int, ...], layout: str
) -> tuple[object, ExitStack]:
    # Open a file that stays open for the trials that follow, as long as what holds it is kept
    holder = ExitStack()
    return holder.enter_context(READERS[kind][0](path, json.loads(layout))), holder


def close_traces(path: Path) -> dict[str, object]:
    """Let a container go; called in the confined process, as the next."""
    _open_cached.cache_clear()
    return {}


def read_columns(
    path: Path, kind: str, layout: Layout, place: list[Any], names: tuple[str | int, ...]
) -> dict[str, object]:
    """Read columns of one trial, by their number.

    Without names it is only seen whether the file can be read.
    """
    where = Place(*place)
    found = path.stat()
    opened, group_of, column = READERS[kind]
    try:
        stamp = found.st_ino, found.st_size, found.st_mtime_ns
        kept = None if where.own_file else _open_cached(kind, path, stamp, json.dumps(layout))[0]
        with opened(path, layout) if where.own_file else nullcontext(kept) as file:
            group = group_of(file, where) if names else None
            return {
                **{
                    str(number): _convert_samples(column(group, name), name)
                    for number, name in enumerate(names)
                },
                "increment": _read_increments(group, names),
            }
    except (TraceError, MemoryError):
        raise
    except Exception as error:  # the readers of damaged files raise whatever they meet
        raise TraceError(
            f"unreadable: trial {where.trial}: {str(error)[:120] or type(error).__name__}"
        ) from error


def _read_increments(group: Any, names: Sequence[str | int]) -> Array:
    # Read what the attributes of a trial say of the time between two samples
    kept: dict[str, Any] = {}
    for name in (None, *names):
        with suppress(Exception):  # a group of a TDMS file knows no index, a table no columns
            holder = group if name is None else group[name]
            kept |= dict(getattr(holder, "attrs", {})) | dict(getattr(holder, "properties", {}))
    increments = [(kept[key], power) for key, power in _INCREMENTS.items() if key in kept]
    return np.array(
        [float(v) ** power for v, power in increments if np.isreal(v) and np.size(v) == 1 and v > 0]
    )


class Traces(ExitStack):
    """Traces of a session, open for reading: one open container, or one file per trial."""

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.session = session
        acquisition = session.acquisition
        self._channels = acquisition.channels.pair_with_dimensions()
        self._layout = {
            **{name: getattr(acquisition, name) for name in ("delimiter", "decimal", "skip_lines")},
            "named": not any(
                isinstance(channel.column, int) for channel, _ in self._channels.values()
            ),
        }
        self._container: Path | None = None
        if acquisition.per_trial:
            return
        path = resolve_inside(session.folder, acquisition.traces, "acquisition.traces")
        BenchError.require(
            is_file(path), f"traces are missing, expected {acquisition.traces} [{session.folder}]"
        )
        self._container = path
        try:
            self._columns(path, Place("", (), own_file=False, is_file=True), ())
        except TraceError as error:
            raise BenchError(f"traces cannot be read: {error} [{path}]") from error
        self.callback(read_confined, f"{__name__}:close_traces", path, raises=TraceError)

    def read(self, trial: str) -> Trace:
        """Read one trace in SI; `TraceError` where the trial has none that can be used."""
        trace = self._cut_trial(trial) if self.session.acquisition.split else self._read(trial)
        if (trim := self.session.acquisition.trim) is None or not trace.time.size:
            return trace
        used = slice(*np.searchsorted(trace.time - trace.time[0], trim))
        return Trace(trace.time[used], trace.tangential[used], trace.normal[used])

    def _cut_trial(self, trial: str) -> Trace:
        whole, cuts = self.drags
        TraceError.require(
            trial in cuts,
            f"missing: trial {trial!r} is not in the table of trials",
        )
        return Trace(
            whole.time[cuts[trial]], whole.tangential[cuts[trial]], whole.normal[cuts[trial]]
        )

    @cached_property
    def drags(self) -> tuple[Trace, dict[str, slice]]:
        """The one record of all trials, and which part of it each trial is."""
        from stepblocks.bench.traces.split import cut_drags
        from stepblocks.bench.trials import open_trials

        names = [one.name for one in open_trials(self.session)]
        try:
            whole = self._read("")
        except TraceError as error:
            raise BenchError(f"traces cannot be read: {error} [{self.session.folder}]") from error
        return whole, dict(zip(names, cut_drags(whole, len(names)), strict=True))

    def _read(self, trial: str) -> Trace:
        acquisition = self.session.acquisition
        path = self._container or _find_trial_file(self.session, trial)
        own = acquisition.per_trial or bool(acquisition.split)
        raw = self._columns(
            path,
            Place(
                trial,
                _list_group_names(acquisition.group, trial),
                own,
                own and acquisition.group is None,
            ),
            [one.column for one, _ in self._channels.values()],
        )
        steps = raw.pop("increment") * acquisition.sample_rate
        # of an increment in ms or us the unit is not known, and it contradicts nothing
        powers = np.log10(steps) / 3.0
        if np.any(np.abs(powers - np.round(powers)) > _RATE_TOLERANCE / 3.0):
            shown = acquisition.sample_rate / float(steps[0])
            raise TraceError(
                f"wrong rate: the file has an increment of {1e6 / shown:.6g} us ({shown:.6g} Hz), "
                f"`acquisition.sample_rate` is {acquisition.sample_rate:.6g} Hz"
            )
        found = self._in_si(raw)
        sizes = {part: values.size for part, values in found.items()}
        lengths = ", ".join(f"{part} {size}" for part, size in sizes.items())
        TraceError.require(
            len(set(sizes.values())) == 1,
            f"truncated: the channels have different lengths ({lengths} samples)",
        )
        if "time" not in found:
            found["time"] = np.arange(sizes["tangential"]) / acquisition.sample_rate
        return Trace(**found)

    def _columns(self, path: Path, place: Place, names: Sequence[str | int]) -> dict[str, Array]:
        return read_confined(
            f"{__name__}:read_columns",
            path,
            self.session.acquisition.kind,
            self._layout,
            place,
            names,
            raises=TraceError,
        )

    def _in_si(self, raw: Mapping[str, Array]) -> dict[str, Array]:
        found = {}
        for number, (part, (channel, dimension)) in enumerate(self._channels.items()):
            values = raw[str(number)] * channel.scale(dimension, part)
            values = values - off if (off := channel.offset_in_si(dimension, part)) else values
            still = round(channel.read_tare_duration(part) * self.session.acquisition.sample_rate)
            TraceError.require(
                still < max(values.size, 1),
                f"truncated: the tare of {part} takes {still} samples, the record has "
                f"{values.size}",
            )
            found[part] = values - values[:still].mean() if still else values
        return found


def _convert_samples(values: object, name: str | int) -> Array:
    array = np.asarray(values)
    TraceError.require(
        array.dtype.kind in "fiub",
        f"channel {name!r} holds no numbers but {array.dtype}",
    )
    check_size(array.size, name)
    TraceError.require(
        array.ndim <= 1 or max(array.shape) == array.size,
        f"channel {name!r} is a table of shape {array.shape}, no column",
    )
    return np.asarray(array, dtype=float).ravel()


def _find_trial_file(session: Session, trial: str) -> Path:
    relative = fill_pattern(session.acquisition.traces, trial=trial)
    TraceError.require(
        "/" not in trial and "\\" not in trial and ".." not in trial,
        f"trial {trial!r} is no part of a file name",
    )
    path = resolve_inside(session.folder, relative, "acquisition.traces")
    TraceError.require(
        is_file(path),
        f"missing: there is no {relative}",
    )
    TraceError.require(
        path.stat().st_size <= _MOST_BYTES,
        f"{relative} has more than {_MOST_BYTES} bytes",
    )
    return path


def _list_group_names(pattern: str | None, trial: str) -> tuple[str, ...]:
    # Names that the group of a trial may have, the likeliest first
    if pattern is not None:
        return (fill_pattern(pattern, trial=trial),)
    found: dict[str, None] = {}
    for usual in _USUAL_GROUPS:
        with suppress(TraceError):
            found[fill_pattern(usual, trial=trial)] = None
    return tuple(found)
