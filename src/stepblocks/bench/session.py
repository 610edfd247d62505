"""The declaration of a session folder.

It says what the probe and the acquisition are, where traces, trials and scans lie, and how columns
are named.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from stepblocks.bench.calibration import Calibration, Frequency, Probe, Strict
from stepblocks.bench.channel import Channel, DimensionedChannel, check_channel_settings
from stepblocks.bench.patterns import check_file_pattern, resolve_path_inside_session
from stepblocks.errors import BenchError
from stepblocks.files.decode import normalise_encoding_name
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.text import Document, is_file, read_document
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes, list_mistakes
from stepblocks.quantities import make_quantity_parser

TraceFormat = Literal["csv", "hdf5", "tdms", "mat", "wav"]
# with the suffixes of their files
FORMATS: dict[TraceFormat, tuple[str, ...]] = {
    "csv": (".csv", ".txt", ".tsv"),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "tdms": (".tdms",),
    "mat": (".mat",),
    "wav": (".wav",),
}
_DIMENSIONS = {"speed": "speed", "load": "force", "height": "length"}  # of conditions
_MOST_BYTES = 1 << 20  # a longer session.toml is none
_SPRING_FACTOR = 2.0  # by which a certificate may differ from the declared spring constant

_Time = Annotated[float, BeforeValidator(make_quantity_parser("time")), Field(ge=0.0)]
_Force = Annotated[float, BeforeValidator(make_quantity_parser("force")), Field(gt=0.0)]
_VOLTS = {"V": 1.0, "mV": 1e-3}
_FULL_SCALE = re.compile(r"(?P<number>[-+.\deE]+)\s*(?P<unit>V|mV)?")


def _convert_full_scale_to_volts(full_scale: object) -> object:
    """Turn a full scale into volts, or a plain number in the unit of the channels."""
    if not isinstance(full_scale, str):
        return full_scale
    match = _FULL_SCALE.fullmatch(full_scale.strip())
    if match is None:
        raise ValueError(f'must be a number or a voltage such as "10 V", got {full_scale!r}')
    return float(match["number"]) * _VOLTS[match["unit"] or "V"]


_FullScale = Annotated[float, BeforeValidator(_convert_full_scale_to_volts), Field(gt=0.0, le=1e9)]
_Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
_Decimal = Literal[".", ","]
_Encoding = Annotated[str, AfterValidator(normalise_encoding_name)]


class Channels(Strict):
    """Columns of a trace; without `time` the sample rate gives the instants."""

    tangential: Channel
    normal: Channel
    time: Channel | None = None

    @model_validator(mode="after")
    def _check_units(self) -> Self:
        """Refuse units, factors and tares of the channels that cannot be read."""
        places = {}
        for name, channel in self.map_names_to_dimensioned_channels().items():
            places[f"acquisition.channels.{name}"] = channel
        check_channel_settings(places, have_time=True)
        return self

    def map_names_to_dimensioned_channels(self) -> dict[str, DimensionedChannel]:
        """Return the declared channels by their names, each with its dimension."""
        channels = {
            "tangential": DimensionedChannel(self.tangential, "force"),
            "normal": DimensionedChannel(self.normal, "force"),
        }
        if self.time is not None:
            channels["time"] = DimensionedChannel(self.time, "time")
        return channels


class Acquisition(Strict):
    """How the forces were recorded.

    Attributes
    ----------
    sample_rate : Frequency
        [Hz].
    traces : str
        One file for all trials, or a pattern with ``{trial}``.
    format : TraceFormat | None
        By default from the suffix.
    group : str | None
        Pattern of the group of a trial in a container; by default the usual ones are tried.
    channels : Channels
    delimiter, decimal, encoding : str, optional
        Of CSV traces; what is not declared is found.
    skip_lines : int
        Before the header of CSV traces.
    missing : tuple of float or str, optional
        What stands for a missing sample in CSV traces; by default the numbers that stand out.
    range : _Force | None
        At which the sensor saturates [N].
    split : str, optional
        ``"drags"``: one record of all trials, cut into drags in the order of the table.
    trim : pair of times, optional
        Part of each record that is used, counted from its first sample [s].
    rows : str, optional
        ``"trials"``: arrays of trials x samples, a row for each trial in the order of the table.
    full_scale : float or str, optional
        Of WAV files: what a sample of 1 is, in volts (``"10 V"``) where a factor says what a volt
        is, else as a number in the unit of the channels.
    """

    sample_rate: Frequency
    traces: str
    format: TraceFormat | None = None
    group: str | None = None
    channels: Channels
    delimiter: _Delimiter | None = None
    decimal: _Decimal | None = None
    encoding: _Encoding | None = None
    missing: tuple[float | str, ...] | None = None
    skip_lines: int = Field(default=0, ge=0, le=10_000)
    range: _Force | None = None
    split: Literal["drags"] | None = None
    trim: tuple[_Time, _Time] | None = None
    rows: Literal["trials"] | None = None
    full_scale: _FullScale | None = None

    @model_validator(mode="after")
    def _check_fields(self) -> Self:
        """Refuse fields that contradict each other."""
        if self.trace_format is None:
            raise ValueError(
                f"`acquisition.format` must be given ({', '.join(FORMATS)}), {self.traces!r} has "
                "no suffix that is known"
            )
        if self.trace_format == "wav" and self.full_scale is None:
            raise ValueError(
                "`acquisition.full_scale` must say what full scale of a WAV file is, such as "
                '"10 V" beside a factor of "5 N/V"'
            )
        if self.full_scale is not None and self.trace_format != "wav":
            raise ValueError("`acquisition.full_scale` is for WAV files alone")
        if self.trim and not self.trim[0] < self.trim[1]:
            raise ValueError("`acquisition.trim` must be two times, the first before the second")
        return self

    @model_validator(mode="after")
    def _check_files(self) -> Self:
        """Refuse ways to keep trials in files that contradict each other."""
        if self.rows and (self.has_file_per_trial or self.group or self.split):
            raise ValueError(
                "`acquisition.rows` is for one file of all trials, without {trial}, group and split"
            )
        if self.rows and self.trace_format not in ("hdf5", "mat"):
            raise ValueError("`acquisition.rows` is for HDF5 and MATLAB files")
        if self.split and (self.has_file_per_trial or self.group):
            raise ValueError(
                "`acquisition.split` is for one record of all trials, without {trial} and group"
            )
        return self

    @property
    def trace_format(self) -> TraceFormat | None:
        """Format of the traces."""
        if self.format:
            return self.format
        for name, suffixes in FORMATS.items():
            if self.traces.lower().endswith(suffixes):
                return name
        return None

    @property
    def has_file_per_trial(self) -> bool:
        """Whether each trial has a file of its own."""
        return "{" in self.traces


class TrialColumns(Strict):
    """Which column of the table of trials plays which part."""

    trial: Channel = Channel(column="trial")
    speed: Channel = Channel(column="speed_mm_s")
    load: Channel = Channel(column="load_n")
    block: Channel = Channel(column="block")
    height: Channel = Channel(column="height_um")

    @model_validator(mode="after")
    def _check_units(self) -> Self:
        """Refuse units and factors of the columns of conditions that cannot be read."""
        places = {}
        for name, dimension in _DIMENSIONS.items():
            channel = getattr(self, name)
            places[f"trials.columns.{name}"] = DimensionedChannel(channel, dimension)
        check_channel_settings(places, have_time=False)
        return self


class Trials(Strict):
    """The table of trials; lines that begin with ``#`` are comments.

    Attributes
    ----------
    file : str
        Name of the file: CSV, or a workbook of Excel or LibreOffice.
    delimiter, decimal, encoding : str, optional
        How it is written; what is not declared is found.
    missing : tuple of float or str, optional
        What stands for a missing value; by default words as ``NA``.
    columns : TrialColumns
        Which column plays which part.
    exclude, swap : tuple
        Trials that are not used, and pairs whose records are exchanged.
    """

    file: str = "trials.csv"
    delimiter: _Delimiter | None = None
    decimal: _Decimal | None = None
    encoding: _Encoding | None = None
    missing: tuple[float | str, ...] | None = None
    columns: TrialColumns = TrialColumns()
    exclude: tuple[str | int, ...] = ()
    swap: tuple[tuple[str | int, str | int], ...] = ()


class Stimuli(Strict):
    """The blocks that were crossed.

    Attributes
    ----------
    set : str | None
        Name of the stimulus set.
    file : str | None
        Its file, from the session; by default ``stimuli/<set>.toml`` beside where one works.
    scans : str | None
        Pattern of their scans, with ``{block}``.
    """

    set: str | None = None
    file: str | None = None
    scans: str | None = None


class Session(Strict):
    """A session folder that was read and found whole.

    Attributes
    ----------
    folder : Path
    schema_ : Literal[1]
    title : str
        What the laboratory calls it.
    probe : Probe
    acquisition : Acquisition
    trials : Trials
    stimuli : Stimuli
    calibration : Calibration
    notes : dict
        Whatever the laboratory wants to note.
    """

    folder: Path = Field(exclude=True)  # not of the file
    schema_: Literal[1] = Field(alias="schema")
    title: str = ""
    probe: Probe
    acquisition: Acquisition
    trials: Trials = Trials()
    stimuli: Stimuli = Stimuli()
    calibration: Calibration = Calibration()
    notes: dict[str, object] = Field(default={})
    _layout: TableLayout = PrivateAttr(UNDECLARED)

    @property
    def layout(self) -> TableLayout:
        """What was declared beside the file; it stands in `acquisition` and `trials`, too."""
        return self._layout

    @property
    def table(self) -> Path:
        """File of the table of trials."""
        return resolve_path_inside_session(self.folder, self.trials.file, "trials.file")

    def apply_text_layout(self, layout: TableLayout) -> "Session":
        """Return the session with what is declared of its texts in place of what the file says."""
        fields = {
            "delimiter": layout.separator,
            "decimal": layout.decimal,
            "encoding": layout.encoding,
            "missing": layout.missing,
        }
        declared = {name: value for name, value in fields.items() if value is not None}
        session = self.model_copy(
            update={
                "acquisition": self.acquisition.model_copy(update=declared),
                "trials": self.trials.model_copy(update=declared),
            }
        )
        session._layout = layout
        return session


def open_session(folder: str | Path, layout: TableLayout = UNDECLARED) -> Session:
    """Read ``session.toml`` of a folder and check that all files that it names are there.

    What `layout` declares of the table of trials and of traces in text counts before the file.

    Raises
    ------
    BenchError
        With all that is wrong, each mistake with its place.
    """
    folder = Path(folder)
    path = folder / "session.toml"
    if not path.exists():
        raise BenchError(
            "session must be a folder with a session.toml, which 'stepblocks new session' writes, "
            f"got {str(folder)!r}"
        )
    declared = read_document(path, "session.toml", BenchError, _MOST_BYTES)
    fields = {**declared, "folder": folder}
    mistakes: list[Mistake] = []
    session = None
    try:
        session = Session.model_validate(fields)
        mistakes += _iterate_contradictions(session)
    except ValidationError as error:
        mistakes += list_mistakes(error, Session, fields)
    mistakes += _list_file_pattern_mistakes(declared, folder)
    if mistakes or session is None:
        raise BenchError(format_mistakes(mistakes, path))
    return session.apply_text_layout(layout)


def _iterate_contradictions(session: Session) -> Iterator[Mistake]:
    """Yield what is wrong with a session whose fields are sound one by one."""
    spring = session.probe.spring_constant
    calibrated = session.calibration.spring_constant
    if calibrated is not None:
        certified, _ = calibrated
        if not 1.0 / _SPRING_FACTOR < certified / spring < _SPRING_FACTOR:
            yield (
                "calibration",
                "spring_constant must be within a factor of 2 of `probe.spring_constant`, "
                f"got {certified:g} N/m and {spring:g} N/m",
            )
    if not is_file(session.table):
        yield (
            "",
            f"table of trials is missing, expected {session.trials.file} beside session.toml",
        )


def _list_file_pattern_mistakes(declared: Document, folder: Path) -> list[Mistake]:
    """List what is wrong with the patterns of file names, also where other fields are unsound."""
    mistakes: list[Mistake] = []
    traces = _find_unvalidated_text(declared, "acquisition", "traces")
    if traces is not None:
        place = "acquisition.traces"
        with collect_mistakes(mistakes):
            check_file_pattern(traces, "trial", place)
            resolve_path_inside_session(folder, traces, place)
            is_split = bool((declared.get("acquisition") or {}).get("split"))
            holds_all_trials = traces.lower().endswith(".csv") and "{" not in traces
            if holds_all_trials and not is_split:
                raise BenchError(f"`{place}` must hold {{trial}} for CSV traces, got {traces!r}")
    group = _find_unvalidated_text(declared, "acquisition", "group")
    if group is not None:
        with collect_mistakes(mistakes):
            check_file_pattern(group, "trial", "acquisition.group")
            resolve_path_inside_session(folder, group, "acquisition.group")
    scans = _find_unvalidated_text(declared, "stimuli", "scans")
    if scans is not None:
        with collect_mistakes(mistakes):
            check_file_pattern(scans, "block", "stimuli.scans")
            resolve_path_inside_session(folder, scans, "stimuli.scans")
    return mistakes


def _find_unvalidated_text(declared: Document, table: str, key: str) -> str | None:
    """Return a text of a document before its validation; None where no text is given."""
    fields = declared.get(table)
    if not isinstance(fields, dict):
        return None
    value = fields.get(key)
    if not isinstance(value, str):
        return None
    return value
