"""The declaration of a session folder.

It says what the probe and the acquisition are, where traces, trials and scans lie, and how columns
are named.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from stepblocks.bench.calibration import Calibration, Frequency, Probe, Strict
from stepblocks.bench.signal import TraceError
from stepblocks.errors import BenchError, QuantityError
from stepblocks.files.text import is_file, read_document
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes, list_mistakes
from stepblocks.quantities import make_quantity_parser, parse_quantity

TraceFormat = Literal["csv", "hdf5", "tdms", "mat"]
# with the suffixes of their files
FORMATS: dict[TraceFormat, tuple[str, ...]] = {
    "csv": (".csv", ".txt", ".tsv"),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "tdms": (".tdms",),
    "mat": (".mat",),
}
_DIMENSIONS = {"speed": "speed", "load": "force", "height": "length"}  # of conditions
_FIELD = re.compile(r"\{([a-z_]+)(?::(0?)(\d{1,2})d)?\}")
_DRIVE = re.compile(r"\s*[A-Za-z]:")
# unit that a column has by the end of its name; the gram of a weight is a gram-force
_SUFFIX_UNITS = {
    "force": {
        "n": "N",
        "mn": "mN",
        "un": "uN",
        "kn": "kN",
        "gf": "gf",
        "g": "gf",
        "kg": "kgf",
        "v": "V",
        "mv": "mV",
    },
    "length": {"um": "um", "mm": "mm", "nm": "nm", "m": "m"},
    "time": {"s": "s", "ms": "ms", "us": "us"},
    "speed": {
        "mm_s": "mm/s",
        "m_s": "m/s",
        "um_s": "um/s",
        "mm_per_s": "mm/s",
        "m_per_s": "m/s",
        "um_per_s": "um/s",
    },
}
_WEIGHTS = {"g": "gf", "kg": "kgf", "mg": "mgf"}
_VOLTS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
_PER_VOLT = re.compile(r"\s*(\S.*?)\s*/\s*(V|mV|uV)\s*")
_BRACKETED = re.compile(r"[(\[]([^()\[\]]+)[)\]]\s*$")  # a unit as in ``Fx (mV)``
_TARE = re.compile(r"\s*first\s+(\S.*?)\s*")
_MOST_BYTES = 1 << 20  # a longer session.toml is none

_Time = Annotated[float, BeforeValidator(make_quantity_parser("time")), Field(ge=0.0)]
_Force = Annotated[float, BeforeValidator(make_quantity_parser("force")), Field(gt=0.0)]
_Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
_Decimal = Literal[".", ","]


def find_unit_in_name(name: str, dimension: str) -> str | None:
    """Return the unit at the end of a column name, or None."""
    if bracketed := _BRACKETED.search(name.lower()):
        return _SUFFIX_UNITS[dimension].get(bracketed[1].strip().replace("/", "_"))
    lowered = name.lower().rsplit("/", 1)[-1]
    fits = [suffix for suffix in _SUFFIX_UNITS[dimension] if f"_{lowered}".endswith(f"_{suffix}")]
    return _SUFFIX_UNITS[dimension][max(fits, key=len)] if fits else None


def _parse(text: str, dimension: str, place: str) -> float:
    try:
        return parse_quantity(text, dimension)
    except QuantityError as error:
        raise BenchError(f"`{place}` {error}") from error


def _require_finite(value: object) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("input should be a finite number")
    return value


_Gain = Annotated[float | str, BeforeValidator(_require_finite)]


class Channel(Strict):
    """One column of a trace or of the table of trials.

    Attributes
    ----------
    column : str | int
        Name, or index from 0 where the columns have no names.
    unit : str | None
        Of its numbers; by default what the end of the name says (``fx_mn``), else SI.
    factor : _Gain
        Gain or sign that the numbers are multiplied with; ``"2.35 N/V"`` of a gauge in volts.
    offset : _Gain
        What it reads at none, taken off: in the numbers' own unit, or a quantity such as ``"5
        mN"``.
    tare : str | None
        ``"first 0.1 s"``: the mean of what is recorded then counts as none.
    """

    column: str | int
    unit: str | None = None
    factor: _Gain = 1.0
    offset: _Gain = 0.0
    tare: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, value: object) -> object:
        return (
            {"column": value}
            if isinstance(value, str | int) and not isinstance(value, bool)
            else value
        )

    def scale(self, dimension: str, place: str) -> float:
        """Factor from the numbers in the file to SI."""
        unit = self.unit or find_unit_in_name(str(self.column), dimension)
        if isinstance(self.factor, str):
            found = _PER_VOLT.fullmatch(self.factor)
            if found is None or (unit or "V") not in _VOLTS:
                raise BenchError(
                    f"`{place}.factor` must be a number, or a {dimension} per volt such as "
                    f"'2.35 N/V' of a column in V or mV, got {self.factor!r}"
                )
            return (
                _parse(found[1], dimension, f"{place}.factor")
                / _VOLTS[found[2]]
                * _VOLTS[unit or "V"]
            )
        BenchError.require(
            unit not in _VOLTS,
            f"`{place}.factor` must say what a volt is, such as '2.35 N/V', for a column in {unit}",
        )
        if unit is None:
            return self.factor
        try:
            return self.factor * parse_quantity(
                f"1 {_WEIGHTS.get(unit, unit) if dimension == 'force' else unit}", dimension
            )
        except QuantityError as error:
            raise BenchError(f"`{place}` must have a unit of {dimension}, got {unit!r}") from error

    def offset_in_si(self, dimension: str, place: str) -> float:
        """Return what the channel reads at none, in SI."""
        if not isinstance(self.offset, str):
            return self.offset * self.scale(dimension, place)
        volts = re.fullmatch(r"\s*([-+.\deE]+)\s*(V|mV|uV)\s*", self.offset)
        if volts and isinstance(self.factor, str):
            own = self.unit or find_unit_in_name(str(self.column), dimension) or "V"
            return float(volts[1]) * _VOLTS[volts[2]] / _VOLTS[own] * self.scale(dimension, place)
        return _parse(self.offset, dimension, f"{place}.offset")

    def read_tare_duration(self, place: str) -> float:
        """Seconds at the begin of a record that count as none; 0 for no tare."""
        if self.tare is None:
            return 0.0
        found = _TARE.fullmatch(self.tare)
        if found is None:
            raise BenchError(
                f"`{place}.tare` must say how long, such as 'first 0.1 s', got {self.tare!r}"
            )
        return _parse(found[1], "time", f"{place}.tare")


def check_channels(channels: Mapping[str, tuple[Channel, str]]) -> None:
    """Refuse units, factors, offsets and tares that say nothing, all at once.

    Channels stand by their places, each with its dimension.
    """
    mistakes: list[Mistake] = []
    for place, (channel, dimension) in channels.items():
        with collect_mistakes(mistakes):
            channel.scale(dimension, place)
            channel.offset_in_si(dimension, place)
            BenchError.require(
                not channel.read_tare_duration(place) or not place.startswith("trials"),
                f"`{place}` has no time to take a tare from",
            )
    if mistakes:
        raise ValueError("\n".join(text for _, text in mistakes))


class Channels(Strict):
    """Columns of a trace; without `time` the sample rate gives the instants."""

    tangential: Channel
    normal: Channel
    time: Channel | None = None

    @model_validator(mode="after")
    def _units_fit(self) -> Self:
        check_channels(
            {
                f"acquisition.channels.{part}": one
                for part, one in self.pair_with_dimensions().items()
            }
        )
        return self

    def pair_with_dimensions(self) -> dict[str, tuple[Channel, str]]:
        """Return the declared channels, each with its dimension."""
        return {
            "tangential": (self.tangential, "force"),
            "normal": (self.normal, "force"),
            **({} if self.time is None else {"time": (self.time, "time")}),
        }


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
    delimiter : _Delimiter
        Of CSV traces.
    decimal : _Decimal
    skip_lines : int
        Before the header of CSV traces.
    range : _Force | None
        At which the sensor saturates [N].
    split : str, optional
        ``"drags"``: one record of all trials, cut into drags in the order of the table.
    trim : pair of times, optional
        Part of each record that is used, counted from its first sample [s].
    """

    sample_rate: Frequency
    traces: str
    format: TraceFormat | None = None
    group: str | None = None
    channels: Channels
    delimiter: _Delimiter = ","
    decimal: _Decimal = "."
    skip_lines: int = Field(default=0, ge=0, le=10_000)
    range: _Force | None = None
    split: Literal["drags"] | None = None
    trim: tuple[_Time, _Time] | None = None

    @model_validator(mode="after")
    def _can_be_read(self) -> Self:
        if self.kind is None:
            raise ValueError(
                f"`acquisition.format` must be given, {self.traces!r} has no suffix that is known"
            )
        if self.trim and not self.trim[0] < self.trim[1]:
            raise ValueError("`acquisition.trim` must be two times, the first before the second")
        if self.split and (self.per_trial or self.group):
            raise ValueError(
                "`acquisition.split` is for one record of all trials, without {trial} and group"
            )
        return self

    @property
    def kind(self) -> TraceFormat | None:
        """Format of the traces."""
        return self.format or next(
            (name for name, ends in FORMATS.items() if self.traces.lower().endswith(ends)), None
        )

    @property
    def per_trial(self) -> bool:
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
    def _units_fit(self) -> Self:
        check_channels(
            {
                f"trials.columns.{part}": (getattr(self, part), one)
                for part, one in _DIMENSIONS.items()
            }
        )
        return self


class Trials(Strict):
    """The table of trials; lines that begin with ``#`` are comments.

    Attributes
    ----------
    file, delimiter, decimal, columns
        Name of the file, how it is written, and which column plays which part.
    exclude, swap : tuple
        Trials that are not used, and pairs whose records are exchanged.
    """

    file: str = "trials.csv"
    delimiter: _Delimiter = ","
    decimal: _Decimal = "."
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


class Place(NamedTuple):
    """Where in a file a trial is to be looked for.

    Attributes
    ----------
    trial : str
    groups : tuple[str, ...]
        Names that its group may have, the likeliest first.
    own_file : bool
        The file holds this trial alone.
    is_file : bool
        The file itself is the group.
    """

    trial: str
    groups: tuple[str, ...]
    own_file: bool
    is_file: bool


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

    @property
    def table(self) -> Path:
        """File of the table of trials."""
        return resolve_inside(self.folder, self.trials.file, "trials.file")


def open_session(folder: str | Path) -> Session:
    """Read ``session.toml`` of a folder and check that all files that it names are there.

    Otherwise a `BenchError` lists all that is wrong.
    """
    folder = Path(folder)
    path = folder / "session.toml"
    BenchError.require(
        path.exists(),
        "session must be a folder with a session.toml, which 'stepblocks new session' writes, "
        f"got {str(folder)!r}",
    )
    declared = read_document(path, "session.toml", BenchError, _MOST_BYTES)
    mistakes: list[Mistake] = []
    try:
        session = Session.model_validate({**declared, "folder": folder})
        certified, _ = session.calibration.spring_constant or (session.probe.spring_constant, 0.0)
        if not 0.5 < certified / session.probe.spring_constant < 2.0:
            mistakes.append(
                (
                    "calibration",
                    "spring_constant must be within a factor of 2 of `probe.spring_constant`, "
                    f"got {certified:g} N/m and {session.probe.spring_constant:g} N/m",
                )
            )
        if not is_file(session.table):
            mistakes.append(
                (
                    "",
                    f"table of trials is missing, expected {session.trials.file} beside "
                    "session.toml",
                )
            )
    except ValidationError as error:
        mistakes += list_mistakes(error, Session, {**declared, "folder": folder})
    for name, field in (
        ("acquisition.traces", "trial"),
        ("acquisition.group", "trial"),
        ("stimuli.scans", "block"),
    ):
        table, _, key = name.partition(".")
        given = declared.get(table, {}).get(key) if isinstance(declared.get(table), dict) else None
        if isinstance(given, str):
            with collect_mistakes(mistakes):
                check_pattern(given, field, name)
                resolve_inside(folder, given, name)
                split = (declared.get("acquisition") or {}).get("split")
                BenchError.require(
                    not (
                        key == "traces"
                        and given.lower().endswith(".csv")
                        and "{" not in given
                        and not split
                    ),
                    f"`{name}` must hold {{trial}} for CSV traces, got {given!r}",
                )
    BenchError.require(not mistakes, format_mistakes(mistakes, path))
    return session


def check_pattern(pattern: str, field: str, place: str) -> None:
    """Allow no braces in `pattern` but those of `field`, such as ``{trial}`` or ``{trial:04d}``."""
    rest = _FIELD.sub(lambda m: "" if m.group(1) == field else m.group(0), pattern)
    BenchError.require(
        "{" not in rest and "}" not in rest and pattern.strip(),
        f"`{place}` may hold {{{field}}}, {{{field}:04d}} and no other braces, got {pattern!r}",
    )


def fill_pattern(pattern: str, **values: str) -> str:
    """Fill a checked pattern; `TraceError` where it wants a whole number and the value is none."""

    def fill(match: re.Match[str]) -> str:
        name, zero, width = match.groups()
        value = values[name]
        TraceError.require(
            not width or re.fullmatch(r"[+-]?\d{1,18}", value),
            f"{name} {value!r} is no whole number, as {match.group(0)} needs",
        )
        return format(int(value), f"{zero}{width}d") if width else value

    return _FIELD.sub(fill, pattern)


def resolve_inside(folder: Path, relative: str, place: str) -> Path:
    """Return a path below `folder`, whichever slashes it is written with.

    Nothing may lead out of it.
    """
    parts = PurePosixPath(relative.replace("\\", "/"))
    BenchError.require(
        not (
            parts.is_absolute() or ".." in parts.parts or "\0" in relative or _DRIVE.match(relative)
        ),
        f"`{place}` must lie inside the session, got {relative!r}",
    )
    return folder.joinpath(*parts.parts)
