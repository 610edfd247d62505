"""The traces of a session: read in a confined process, or given in SI."""

from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from stepblocks.bench.channel import Channel
from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.patterns import fill_file_pattern, resolve_path_inside_session
from stepblocks.bench.session import Acquisition, Session
from stepblocks.bench.signal import Trace
from stepblocks.bench.traces import columns
from stepblocks.bench.traces.reader import TextLayout, TrialPlace
from stepblocks.bench.traces.rows import TrialRow
from stepblocks.bench.traces.split import cut_drags
from stepblocks.bench.trials import open_trials
from stepblocks.contact import Array
from stepblocks.errors import BenchError
from stepblocks.files.confined import read_confined
from stepblocks.files.text import is_file

_MOST_BYTES = 1 << 30  # of the file of one trial
_RATE_TOLERANCE = 0.01
_DECADES_OF_UNITS = 3.0  # powers of ten between s, ms and us
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


class _ConfinedError(TraceError):
    """A file that its confined reader could not read, with the message of `read_confined`."""

    def __init__(self, message: str) -> None:
        super().__init__(FaultKind.WITHOUT_HEADING, message)


@dataclass(frozen=True)
class _RawColumns:
    """Columns of one trial in the units of the file.

    Attributes
    ----------
    samples : list of Array
        One for each channel, shape (n,).
    increments : Array
        Times between two samples that the file states, in units that it does not [s, ms, us].
    """

    samples: list[Array]
    increments: Array


@dataclass(frozen=True)
class Drags:
    """One record of all trials, cut into drags.

    Attributes
    ----------
    record : Trace
    cuts : dict of str to slice
        Part of the record that each trial is.
    """

    record: Trace
    cuts: dict[str, slice]


class Traces(ExitStack):
    """Traces of a session, open for reading: one open container, or one file per trial.

    Parameters
    ----------
    session : Session

    Raises
    ------
    BenchError
        If the one file of all trials is missing or cannot be read.
    """

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.session = session
        self._channels = session.acquisition.channels.map_names_to_dimensioned_channels()
        self._layout = _build_text_layout(session.acquisition)
        self.notes: dict[str, None] = {}  # what had to be found out, in its order
        self._container: Path | None = None
        if not session.acquisition.has_file_per_trial:
            self._container = self._open_container_file()

    def _open_container_file(self) -> Path:
        """Return the one file of all trials, which stays open until the traces are closed."""
        relative = self.session.acquisition.traces
        path = resolve_path_inside_session(self.session.folder, relative, "acquisition.traces")
        if not is_file(path):
            raise BenchError(f"traces are missing, expected {relative} [{self.session.folder}]")
        try:
            self._read_columns(path, TrialPlace("", (), False, True), ())
        except TraceError as error:
            raise BenchError(f"traces cannot be read: {error} [{path}]") from error
        close = f"{columns.__name__}:{columns.close_container_in_worker.__name__}"
        self.callback(read_confined, close, path, raises=_ConfinedError)
        return path

    def read(self, trial: str) -> Trace:
        """Read one trace in SI.

        Raises
        ------
        TraceError
            If the trial has no trace that can be used.
        """
        if self.session.acquisition.split:
            trace = self._cut_trial_from_record(trial)
        else:
            trace = self._read_record(trial)
        trim = self.session.acquisition.trim
        if trim is None or not trace.time.size:
            return trace
        first, last = np.searchsorted(trace.time - trace.time[0], trim)
        return _select_samples(trace, slice(first, last))

    def _cut_trial_from_record(self, trial: str) -> Trace:
        """Return the part of the one record that a trial is."""
        cuts = self.drags.cuts
        if trial not in cuts:
            raise TraceError(FaultKind.MISSING, f"trial {trial!r} is not in the table of trials")
        return _select_samples(self.drags.record, cuts[trial])

    @cached_property
    def drags(self) -> Drags:
        """The one record of all trials, cut into drags in the order of the table."""
        names = [trial.name for trial in open_trials(self.session)]
        try:
            record = self._read_record("")
        except TraceError as error:
            raise BenchError(f"traces cannot be read: {error} [{self.session.folder}]") from error
        cuts = cut_drags(record, len(names))
        return Drags(record, dict(zip(names, cuts, strict=True)))

    def _read_record(self, trial: str) -> Trace:
        """Read the record of a trial in SI; of all trials where one record holds them."""
        acquisition = self.session.acquisition
        path = self._container or _find_trial_file(self.session, trial)
        has_own_file = acquisition.has_file_per_trial or bool(acquisition.split)
        place = TrialPlace(
            trial,
            _list_possible_group_names(acquisition.group, trial),
            has_own_file=has_own_file,
            is_whole_file=has_own_file and acquisition.group is None,
            row=self._find_trial_row(trial),
        )
        names = [channel.column for channel, _ in self._channels.values()]
        raw = self._read_columns(path, place, names)
        _refuse_contradicting_intervals(raw.increments, acquisition.sample_rate)
        return self._convert_to_si(raw)

    def _find_trial_row(self, trial: str) -> TrialRow | None:
        """Return the row of a trial where each trial is a row of arrays; None for other layouts."""
        if self.session.acquisition.rows is None:
            return None
        if trial not in self._row_by_trial:
            raise TraceError(FaultKind.MISSING, f"trial {trial!r} is not in the table of trials")
        return TrialRow(self._row_by_trial[trial], len(self._row_by_trial))

    @cached_property
    def _row_by_trial(self) -> dict[str, int]:
        """Number of the row of each trial in the table, from 0, by its name."""
        names = [trial.name for trial in open_trials(self.session)]
        return {name: place for place, name in enumerate(names)}

    def _read_columns(
        self, path: Path, place: TrialPlace, names: Sequence[str | int]
    ) -> _RawColumns:
        """Read columns of one trial in a confined process."""
        found = read_confined(
            f"{columns.__name__}:{columns.read_columns_in_worker.__name__}",
            path,
            self.session.acquisition.trace_format,
            asdict(self._layout),
            asdict(place),
            names,
            raises=_ConfinedError,
        )
        if "fault" in found:
            raise TraceError(FaultKind[found["fault"]], found["details"])
        if not names:
            return _RawColumns([], np.array([]))
        self.notes |= dict.fromkeys(found["notes"])
        samples = [found[str(number)] for number in range(len(names))]
        return _RawColumns(samples, found["increments"])

    def _convert_to_si(self, raw: _RawColumns) -> Trace:
        """Return a trace in SI, with the tare taken off; its clock may be that of the rate."""
        rate = self.session.acquisition.sample_rate
        full_scale = self.session.acquisition.full_scale or 1.0
        quantities: dict[str, Array] = {}
        for samples, (name, channel) in zip(raw.samples, self._channels.items(), strict=True):
            if name != "time":
                samples = full_scale * samples
            values = samples * channel.channel.find_factor_to_si(channel.dimension, name)
            offset = channel.channel.find_offset_in_si(channel.dimension, name)
            if offset:
                values = values - offset
            quantities[name] = _subtract_channel_tare(values, channel.channel, name, rate)
        _refuse_unequal_lengths(quantities)
        tangential = quantities["tangential"]
        time = quantities.get("time")
        if time is None:
            time = np.arange(tangential.size) / rate
        return Trace(time, tangential, quantities["normal"])


def _build_text_layout(acquisition: Acquisition) -> TextLayout:
    """Return how the text of traces is written; columns given by their number have no names."""
    is_named = True
    for channel, _ in acquisition.channels.map_names_to_dimensioned_channels().values():
        if isinstance(channel.column, int):
            is_named = False
    return TextLayout(
        acquisition.delimiter,
        acquisition.decimal,
        acquisition.skip_lines,
        is_named,
        acquisition.encoding,
        acquisition.missing,
    )


def _select_samples(trace: Trace, samples: slice) -> Trace:
    """Return the part of a trace in a slice of its samples."""
    return Trace(trace.time[samples], trace.tangential[samples], trace.normal[samples])


def _refuse_contradicting_intervals(increments: Array, declared_rate: float) -> None:
    """Refuse a file that states another sampling interval than the declared rate [Hz]."""
    steps = increments * declared_rate
    # of an increment in ms or us the unit is not known, and it contradicts nothing
    powers = np.log10(steps) / _DECADES_OF_UNITS
    if np.any(np.abs(powers - np.round(powers)) > _RATE_TOLERANCE / _DECADES_OF_UNITS):
        stated_rate = declared_rate / float(steps[0])
        raise TraceError(
            FaultKind.WRONG_RATE,
            f"the file has an increment of {1e6 / stated_rate:.6g} us ({stated_rate:.6g} Hz), "
            f"`acquisition.sample_rate` is {declared_rate:.6g} Hz",
        )


def _subtract_channel_tare(
    forces: Array, channel: Channel, channel_name: str, rate: float
) -> Array:
    """Return a channel less the mean of what the record begins with, where that is its zero."""
    count = round(channel.parse_tare_duration(channel_name) * rate)
    if count >= max(forces.size, 1):
        raise TraceError(
            FaultKind.TRUNCATED,
            f"the tare of {channel_name} takes {count} samples, the record has {forces.size}",
        )
    if count == 0:
        return forces
    tared: Array = forces - forces[:count].mean()
    return tared


def _refuse_unequal_lengths(quantities: dict[str, Array]) -> None:
    """Refuse channels of different lengths."""
    sizes = {name: values.size for name, values in quantities.items()}
    if len(set(sizes.values())) != 1:
        lengths = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise TraceError(
            FaultKind.TRUNCATED, f"the channels have different lengths ({lengths} samples)"
        )


def _find_trial_file(session: Session, trial: str) -> Path:
    """Return the file of one trial inside the session."""
    relative = fill_file_pattern(session.acquisition.traces, trial=trial)
    if "/" in trial or "\\" in trial or ".." in trial:
        raise TraceError(FaultKind.WITHOUT_HEADING, f"trial {trial!r} is no part of a file name")
    path = resolve_path_inside_session(session.folder, relative, "acquisition.traces")
    if not is_file(path):
        raise TraceError(FaultKind.MISSING, f"there is no {relative}")
    if path.stat().st_size > _MOST_BYTES:
        raise TraceError(FaultKind.WITHOUT_HEADING, f"{relative} has more than {_MOST_BYTES} bytes")
    return path


def _list_possible_group_names(pattern: str | None, trial: str) -> tuple[str, ...]:
    """Return names that the group of a trial may have, the likeliest first."""
    if pattern is not None:
        return (fill_file_pattern(pattern, trial=trial),)
    names: dict[str, None] = {}
    for usual in _USUAL_GROUPS:
        with suppress(TraceError):  # a name that is no number has no four digits
            names[fill_file_pattern(usual, trial=trial)] = None
    return tuple(names)
