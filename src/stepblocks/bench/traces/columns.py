"""Columns of one trial, read in a process of its own.

The functions of this module are called by `stepblocks.files.confined`: their arguments are what
JSON holds, and so are their results, but for arrays.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, nullcontext
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.bench.faults import FaultKind, TraceError, TrialFault
from stepblocks.bench.signal import refuse_oversized_channel
from stepblocks.bench.traces.formats import READERS
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace
from stepblocks.bench.traces.rows import TrialRow
from stepblocks.contact import Array

# attributes that say the time between two samples, or their rate, with the power of the time
_INCREMENTS = {"dt": 1, "wf_increment": 1, "increment": 1, "sample_rate": -1, "fs": -1}
_LONGEST_REASON = 120  # letters of a message of a library
_LONGEST_FAULT = 300  # letters of a message, of names in the file too


def read_columns_in_worker(
    path: Path,
    kind: str,
    layout: Mapping[str, Any],
    place: Mapping[str, Any],
    names: Sequence[str | int],
) -> dict[str, object]:
    """Read columns of one trial in the confined process.

    Parameters
    ----------
    path : Path
    kind : str
        Format of the file, one of `READERS`.
    layout, place : mapping
        Fields of `TextLayout` and `TrialPlace`.
    names : sequence of str or int
        Columns; without any it is only seen whether the file can be read.

    Returns
    -------
    dict
        Each column, shape (n,), by its number in `names`; the array ``increments`` of times between
        two samples that the file states; and ``notes``, what had to be found out. Or else ``fault``
        and ``details`` of a `TraceError`.
    """
    row = None
    if place["row"] is not None:
        row = TrialRow(**place["row"])
    trial_place = TrialPlace(
        place["trial"], tuple(place["groups"]), place["has_own_file"], place["is_whole_file"], row
    )
    try:
        return _read_columns(path, kind, TextLayout(**layout), trial_place, names)
    except TraceError as error:
        fault = error.fault
    except MemoryError:
        raise
    except Exception as error:  # the readers of damaged files raise whatever they meet
        reason = str(error)[:_LONGEST_REASON] or type(error).__name__
        fault = TrialFault(FaultKind.UNREADABLE, f"trial {trial_place.trial}: {reason}")
    excess = max(len(str(fault)) - _LONGEST_FAULT, 0)
    return {
        "fault": fault.kind.name,
        "details": fault.details[: len(fault.details) - excess],
    }


def close_container_in_worker(path: Path) -> dict[str, object]:
    """Close the container that this worker keeps open."""
    _open_cached_container.cache_clear()
    return {}


def _read_columns(
    path: Path,
    trace_format: str,
    layout: TextLayout,
    place: TrialPlace,
    asked_columns: Sequence[str | int],
) -> dict[str, object]:
    """Read columns and increments; see `read_columns_in_worker`."""
    reader = READERS[trace_format]
    if place.has_own_file:
        opened = reader.open(path, layout)
    else:
        opened = nullcontext(_open_current_container(path, trace_format, layout))
    with opened as file:
        if not asked_columns:
            return {}
        group = reader.find_group(file, place)
        columns: dict[str, object] = {}
        for number, name in enumerate(asked_columns):
            columns[str(number)] = _convert_samples(reader.read_column(group, name), name)
        columns["increments"] = _read_sample_intervals(reader, group, asked_columns)
        columns["notes"] = reader.list_notes(group, asked_columns)
        return columns


def _open_current_container(path: Path, trace_format: str, layout: TextLayout) -> object:
    """Return a container, opened anew where the file has changed."""
    status = path.stat()
    stamp = (status.st_ino, status.st_size, status.st_mtime_ns)
    file, _ = _open_cached_container(trace_format, path, stamp, layout)
    return file


@lru_cache(maxsize=1)
def _open_cached_container(
    trace_format: str, path: Path, _stamp: tuple[int, ...], layout: TextLayout
) -> tuple[object, ExitStack]:
    """Open a file that stays open for the trials that follow, as long as its holder is kept."""
    holder = ExitStack()
    file = holder.enter_context(READERS[trace_format].open(path, layout))
    return file, holder


def _convert_samples(raw_samples: object, channel: str | int) -> Array:
    """Return the samples of one channel, shape (n,); refuse anything but a row of numbers."""
    array = np.asarray(raw_samples)
    if array.dtype.kind not in "fiub":
        raise TraceError(
            FaultKind.WITHOUT_HEADING,
            f"channel {channel!r} holds no numbers but {array.dtype}",
        )
    refuse_oversized_channel(array.size, channel)
    if array.ndim > 1 and max(array.shape) != array.size:
        raise TraceError(
            FaultKind.WITHOUT_HEADING,
            f"channel {channel!r} is a table of shape {array.shape}, no column",
        )
    return np.asarray(array, dtype=float).ravel()


def _read_sample_intervals(
    reader: TraceReader[Any, Any], group: object, columns: Sequence[str | int]
) -> Array:
    """Return the times between two samples that the attributes of a trial state."""
    attributes = reader.read_attributes(group, columns)
    increments = []
    for key, power in _INCREMENTS.items():
        value: Any = attributes.get(key)
        if value is not None and np.isreal(value) and np.size(value) == 1 and value > 0:
            increments.append(float(value) ** power)
    return np.array(increments)
