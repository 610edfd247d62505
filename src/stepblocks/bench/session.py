"""What a session folder declares: probe, acquisition, where traces, trials and scans lie, and how columns are named."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from stepblocks.bench.layout import check_pattern, inside, scale_of, unit_of_name
from stepblocks.errors import BenchError, QuantityError
from stepblocks.quantities import quantity_parser

_MOST_BYTES = 1 << 20  # a longer session.toml is none
_FORMATS = {
    ".csv": "csv",
    ".txt": "csv",
    ".tsv": "csv",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".hdf": "hdf5",
    ".tdms": "tdms",
}
_FORMATS |= {".mat": "mat"}


def _validator(dimension: str) -> BeforeValidator:
    parse = quantity_parser(dimension)

    def read(value: object) -> float:
        try:
            return parse(value)
        except QuantityError as error:
            raise ValueError(str(error)) from error

    return BeforeValidator(read)


_Stiffness = Annotated[float, _validator("stiffness"), Field(gt=0.0)]
_Length = Annotated[float, _validator("length"), Field(gt=0.0)]
_Frequency = Annotated[float, _validator("frequency"), Field(gt=0.0)]
_Force = Annotated[float, _validator("force"), Field(gt=0.0)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Open(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Channel(_Strict):
    """One column of a trace or of the table of trials."""

    column: str | int  # Name, or index from 0 where the columns have no names
    unit: str | None = None  # Unit of its numbers; by default what the end of the name says (``fx_mn``), else SI
    factor: float = Field(default=1.0, allow_inf_nan=False)  # Gain or sign that the numbers are multiplied with

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, value: object) -> object:
        return {"column": value} if isinstance(value, str | int) and not isinstance(value, bool) else value

    def scale(self, dimension: str, place: str) -> float:
        """Factor from the numbers in the file to SI."""
        name = self.column if isinstance(self.column, str) else ""
        unit = self.unit or unit_of_name(name, dimension)
        return self.factor * (scale_of(unit, dimension, place) if unit else 1.0)


class Channels(_Strict):
    """Columns of a trace; without `time` the sample rate gives the instants."""

    tangential: Channel
    normal: Channel
    time: Channel | None = None


class Probe(_Open):
    """The explorer: spring constant [N/m] and tip radius [m]."""

    spring_constant: _Stiffness
    tip_radius: _Length | None = None


class Acquisition(_Open):
    """How the forces were recorded."""

    sample_rate: _Frequency  # Samples per second [Hz]
    traces: str  # One file for all trials, or a pattern with ``{trial}``
    # ``csv``, ``hdf5``, ``tdms`` or ``mat``; by default from the suffix
    format: Literal["csv", "hdf5", "tdms", "mat"] | None = None
    group: str | None = None  # Pattern of the group of a trial in a container; by default the usual ones are tried
    channels: Channels  # Columns
    delimiter: str = Field(default=",", min_length=1, max_length=1)  # Of CSV traces
    decimal: Literal[".", ","] = "."
    skip_lines: int = Field(default=0, ge=0, le=10_000)  # Lines before the header of CSV traces
    range: _Force | None = None  # Force at which the sensor saturates [N]

    @property
    def kind(self) -> str:
        """Format of the traces."""
        kind = self.format or _FORMATS.get(Path(self.traces).suffix.lower())
        if kind is None:
            raise BenchError(f"`acquisition.format` must be given, {self.traces!r} has no suffix that is known")
        return kind

    @property
    def per_trial(self) -> bool:
        """Whether each trial has a file of its own."""
        return "{" in self.traces


class TrialColumns(_Strict):
    """Which column of the table of trials plays which part."""

    trial: Channel = Channel(column="trial")
    speed: Channel = Channel(column="speed_mm_s")
    load: Channel = Channel(column="load_n")
    block: Channel = Channel(column="block")


class _Trials(_Strict):
    file: str = "trials.csv"
    delimiter: str = Field(default=",", min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    columns: TrialColumns = TrialColumns()


class _Stimuli(_Open):
    set: str | None = None
    scans: str | None = None


class _Document(_Open):
    schema_: Literal[1] = Field(alias="schema")
    title: str = ""
    probe: Probe
    acquisition: Acquisition
    trials: _Trials = _Trials()
    stimuli: _Stimuli = _Stimuli()


class Session(BaseModel):
    """A session folder that was read and found whole."""

    model_config = ConfigDict(frozen=True)

    folder: Path  # The folder
    title: str  # What the laboratory calls it
    probe: Probe  # As declared
    acquisition: Acquisition
    columns: TrialColumns
    table: Path  # The table of trials
    delimiter: str  # Of the table
    decimal: str
    stimulus_set: str | None  # Name of the stimulus set
    scans: str | None  # Pattern of the scans, with ``{block}``


def open_session(folder: Path) -> Session:
    """Read ``session.toml`` of a folder."""
    path = folder / "session.toml"
    if not folder.is_dir():
        raise BenchError(f"session must be a folder with a session.toml, got {str(folder)!r}")
    document = _read_toml(path)
    try:
        declared = _Document.model_validate(document)
    except ValidationError as error:
        raise BenchError(_first_of(error, path)) from error
    acquisition = declared.acquisition
    check_pattern(acquisition.traces, ("trial",), "acquisition.traces")
    if acquisition.group is not None:
        check_pattern(acquisition.group, ("trial",), "acquisition.group")
    if declared.stimuli.scans is not None:
        check_pattern(declared.stimuli.scans, ("block",), "stimuli.scans")
    for name, dimension in (("time", "time"), ("tangential", "force"), ("normal", "force")):
        channel = getattr(acquisition.channels, name)
        if channel is not None:
            channel.scale(dimension, f"acquisition.channels.{name}")
    if acquisition.kind == "csv" and not acquisition.per_trial:
        raise BenchError(
            f"`acquisition.traces` must hold {{trial}} for CSV traces, got {acquisition.traces!r} [{path}]"
        )
    inside(folder, acquisition.traces, "acquisition.traces")
    table = inside(folder, declared.trials.file, "trials.file")
    if not table.is_file():
        raise BenchError(f"table of trials is missing, expected {declared.trials.file} [{folder}]")
    return Session(
        folder=folder,
        title=declared.title,
        probe=declared.probe,
        acquisition=acquisition,
        columns=declared.trials.columns,
        table=table,
        delimiter=declared.trials.delimiter,
        decimal=declared.trials.decimal,
        stimulus_set=declared.stimuli.set,
        scans=declared.stimuli.scans,
    )


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise BenchError(f"session.toml must be under {_MOST_BYTES} bytes [{path}]")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise BenchError(f"session.toml is missing [{path.parent}]") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BenchError(f"session.toml must be TOML: {error} [{path}]") from error
    except OSError as error:
        raise BenchError(f"session.toml cannot be read: {error.strerror} [{path}]") from error


def _first_of(error: ValidationError, path: Path) -> str:
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    message = str(first["msg"]).removeprefix("Value error, ")
    got = first.get("input")
    shown = f", got {got!r}" if isinstance(got, str | int | float) and "got" not in message else ""
    return f"`{place}`: {message}{shown} [{path}]"
