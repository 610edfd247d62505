"""What a session folder declares: probe, acquisition, where traces, trials and scans lie, and how columns are named."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from stepblocks.bench.signal import TraceError
from stepblocks.errors import BenchError, QuantityError
from stepblocks.mistakes import Mistake, mistakes_in, noted, told
from stepblocks.quantities import parse_quantity, quantity_parser
from stepblocks.text_file import read_document

TraceFormat = Literal["csv", "hdf5", "tdms", "mat"]
# with the suffixes of their files
FORMATS: dict[TraceFormat, tuple[str, ...]] = {
    "csv": (".csv", ".txt", ".tsv"),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "tdms": (".tdms",),
    "mat": (".mat",),
}
_FIELD = re.compile(r"\{([a-z_]+)(?::(0?)(\d{1,2})d)?\}")
_DRIVE = re.compile(r"\s*[A-Za-z]:")
# unit that a column has by the end of its name; `gf` is a gram-force
_SUFFIX_UNITS = {
    "force": {"n": "N", "mn": "mN", "un": "uN", "kn": "kN", "gf": "gf"},
    "time": {"s": "s", "ms": "ms", "us": "us"},
    "speed": {"mm_s": "mm/s", "m_s": "m/s", "um_s": "um/s", "mm_per_s": "mm/s", "m_per_s": "m/s", "um_per_s": "um/s"},
}
_MOST_BYTES = 1 << 20  # a longer session.toml is none

Stiffness = Annotated[float, BeforeValidator(quantity_parser("stiffness")), Field(gt=0.0)]
Frequency = Annotated[float, BeforeValidator(quantity_parser("frequency")), Field(gt=0.0)]
_Length = Annotated[float, BeforeValidator(quantity_parser("length")), Field(gt=0.0)]
_Force = Annotated[float, BeforeValidator(quantity_parser("force")), Field(gt=0.0)]
_Delimiter = Annotated[str, Field(min_length=1, max_length=1)]
_Decimal = Literal[".", ","]


class Strict(BaseModel):
    """A table that may hold nothing but its fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class _Open(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Channel(Strict):
    """One column of a trace or of the table of trials."""

    column: str | int  # name, or index from 0 where the columns have no names
    unit: str | None = None  # of its numbers; by default what the end of the name says (``fx_mn``), else SI
    factor: float = Field(default=1.0, allow_inf_nan=False)  # gain or sign that the numbers are multiplied with

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, value: object) -> object:
        return {"column": value} if isinstance(value, str | int) and not isinstance(value, bool) else value

    def scale(self, dimension: str, place: str) -> float:
        """Factor from the numbers in the file to SI."""
        name = self.column if isinstance(self.column, str) else ""
        unit = self.unit or unit_of_name(name, dimension)
        return self.factor * (scale_of(unit, dimension, place) if unit else 1.0)


class Channels(Strict):
    """Columns of a trace; without `time` the sample rate gives the instants."""

    tangential: Channel
    normal: Channel
    time: Channel | None = None

    @model_validator(mode="after")
    def _units_fit(self) -> Channels:
        mistakes: list[Mistake] = []
        for part, (channel, dimension) in self.parts().items():
            with noted(mistakes):
                channel.scale(dimension, f"acquisition.channels.{part}")
        if mistakes:
            raise ValueError("\n".join(text for _, text in mistakes))
        return self

    def parts(self) -> dict[str, tuple[Channel, str]]:
        """Return the declared channels, each with its dimension."""
        forces = {"tangential": (self.tangential, "force"), "normal": (self.normal, "force")}
        return forces if self.time is None else forces | {"time": (self.time, "time")}


class Probe(_Open):
    """The explorer."""

    spring_constant: Stiffness  # [N/m]
    tip_radius: _Length | None = None  # [m]


class Acquisition(_Open):
    """How the forces were recorded."""

    sample_rate: Frequency  # [Hz]
    traces: str  # one file for all trials, or a pattern with ``{trial}``
    format: TraceFormat | None = None  # by default from the suffix
    group: str | None = None  # pattern of the group of a trial in a container; by default the usual ones are tried
    channels: Channels
    delimiter: _Delimiter = ","  # of CSV traces
    decimal: _Decimal = "."
    skip_lines: int = Field(default=0, ge=0, le=10_000)  # before the header of CSV traces
    range: _Force | None = None  # at which the sensor saturates [N]

    @property
    def kind(self) -> TraceFormat:
        """Format of the traces."""
        suffix = Path(self.traces).suffix.lower()
        kind = self.format or next((name for name, one in FORMATS.items() if suffix in one), None)
        if kind is None:
            raise BenchError(f"`acquisition.format` must be given, {self.traces!r} has no suffix that is known")
        return kind

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


class Trials(Strict):
    """The table of trials."""

    file: str = "trials.csv"
    delimiter: _Delimiter = ","
    decimal: _Decimal = "."
    columns: TrialColumns = TrialColumns()


class Stimuli(_Open):
    """The blocks that were crossed."""

    set: str | None = None  # name of the stimulus set
    scans: str | None = None  # pattern of their scans, with ``{block}``


class Place(NamedTuple):
    """Where in a file a trial is to be looked for."""

    trial: str
    groups: tuple[str, ...]  # names that its group may have, the likeliest first
    own_file: bool  # the file holds this trial alone
    is_file: bool  # the file itself is the group


class Session(_Open):
    """A session folder that was read and found whole."""

    folder: Path
    schema_: Literal[1] = Field(alias="schema")
    title: str = ""  # what the laboratory calls it
    probe: Probe
    acquisition: Acquisition
    trials: Trials = Trials()
    stimuli: Stimuli = Stimuli()

    @property
    def scans(self) -> str | None:
        """Pattern of the scans of the blocks, with ``{block}``."""
        return self.stimuli.scans

    @property
    def table(self) -> Path:
        """File of the table of trials."""
        return inside(self.folder, self.trials.file, "trials.file")


def open_session(folder: str | Path) -> Session:
    """Read ``session.toml`` of a folder and look whether all that it names is there; else `BenchError` with all that is wrong."""
    folder = Path(folder)
    path = folder / "session.toml"
    if not folder.is_dir():
        raise BenchError(f"session must be a folder with a session.toml, got {str(folder)!r}")
    if not path.exists():
        raise BenchError(f"session.toml is missing [{folder}]")
    declared = read_document(path, "session.toml", BenchError, _MOST_BYTES)
    mistakes: list[Mistake] = []
    try:
        session = Session.model_validate({**declared, "folder": folder})
        if not session.table.is_file():
            mistakes.append(("", f"table of trials is missing, expected {session.trials.file} beside session.toml"))
    except ValidationError as error:
        mistakes += mistakes_in(error, Session, {**declared, "folder": folder})
    for name, field in (("acquisition.traces", "trial"), ("acquisition.group", "trial"), ("stimuli.scans", "block")):
        table, _, key = name.partition(".")
        given = declared.get(table, {}).get(key) if isinstance(declared.get(table), dict) else None
        if isinstance(given, str):
            with noted(mistakes):
                check_pattern(given, field, name)
                inside(folder, given, name)
                if key == "traces" and given.lower().endswith(".csv") and "{" not in given:
                    raise BenchError(f"`{name}` must hold {{trial}} for CSV traces, got {given!r}")
    if mistakes:
        raise BenchError(told(mistakes, path))
    return session


def check_pattern(pattern: str | None, field: str, place: str) -> None:
    """Allow no braces in `pattern` but those of `field`, such as ``{trial}`` or ``{trial:04d}``; it may be missing."""
    if pattern is None:
        return
    rest = _FIELD.sub(lambda m: "" if m.group(1) == field else m.group(0), pattern)
    if "{" in rest or "}" in rest or not pattern.strip():
        raise BenchError(f"`{place}` may hold {{{field}}}, {{{field}:04d}} and no other braces, got {pattern!r}")


def fill_pattern(pattern: str, **values: str) -> str:
    """Fill a checked pattern; `TraceError` where it wants a whole number and the value is none."""

    def fill(match: re.Match[str]) -> str:
        name, zero, width = match.groups()
        value = values[name]
        if width is None:
            return value
        if not re.fullmatch(r"[+-]?\d{1,18}", value):
            raise TraceError(f"{name} {value!r} is no whole number, as {match.group(0)} needs")
        return format(int(value), f"{zero}{width}d")

    return _FIELD.sub(fill, pattern)


def inside(folder: Path, relative: str, place: str) -> Path:
    """Return a path below `folder`, whichever slashes it is written with; nothing may lead out of it."""
    parts = PurePosixPath(relative.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts or "\0" in relative or _DRIVE.match(relative):
        raise BenchError(f"`{place}` must lie inside the session, got {relative!r}")
    return folder.joinpath(*parts.parts)


def unit_of_name(name: str, dimension: str) -> str | None:
    """Return the unit at the end of a column name, or None."""
    lowered = name.lower().rsplit("/", 1)[-1]
    fits = [suffix for suffix in _SUFFIX_UNITS[dimension] if f"_{lowered}".endswith(f"_{suffix}")]
    return _SUFFIX_UNITS[dimension][max(fits, key=len)] if fits else None


def scale_of(unit: str, dimension: str, place: str) -> float:
    """Factor that turns a number in `unit` into SI."""
    try:
        return parse_quantity(f"1 {unit}", dimension)
    except QuantityError as error:
        raise BenchError(f"`{place}` must have a unit of {dimension}, got {unit!r}") from error
