"""Options that several commands share, and how their values are read.

An option is an annotated type: a command that takes one names it in its signature and gives the
default there. An option of several values (``list[...]``) may be repeated, or be followed by all
of them. A metavar in brackets says that the value may be left out; ``show_default`` is used then.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.models import OptionInfo

from stepblocks.errors import PipelineError
from stepblocks.files.layout import parse_missing_value
from stepblocks.quantities import parse_quantity

_MOST_DIGITS = 18  # of a whole number on the command line
_LARGEST_IN_RANGE = 10**15
_EVERYWHERE = "In every command"


def make_quantity_reader(dimension: str, *, above_zero: bool = False) -> Callable[[str], float]:
    """Return a reader of quantities of one dimension."""

    def read_quantity(text: str) -> float:
        """Read a quantity in SI."""
        value = parse_quantity(text, dimension)
        if above_zero and value <= 0.0:
            raise ValueError(f"must be positive, got {text}")
        return value

    return read_quantity


def make_quantity_option(
    dimension: str,
    *names: str,
    help: str,
    above_zero: bool = False,
    show_default: str | bool = True,
    rich_help_panel: str | None = None,
) -> OptionInfo:
    """Return an option whose value is a quantity of one dimension."""
    option: OptionInfo = typer.Option(
        *names,
        metavar=dimension.upper(),
        parser=make_quantity_reader(dimension, above_zero=above_zero),
        help=help,
        show_default=show_default,
        rich_help_panel=rich_help_panel,
    )
    return option


def make_whole_number_reader(least: int, most: int) -> Callable[[str | int], int]:
    """Return a reader of whole numbers within limits."""

    def read_whole_number(written: str | int) -> int:
        """Read a whole number from `least` to `most`."""
        text = str(written)  # Typer reads a default, too
        is_whole = text.isdecimal() and len(text) <= _MOST_DIGITS
        if not is_whole or not least <= int(text) <= most:
            raise ValueError(f"must be a whole number from {least} to {most}, got {text!r:.40}")
        return int(text)

    return read_whole_number


class Numbers(tuple[int, ...]):
    """Whole numbers, separated by commas on the command line."""


def split_at_commas(text: str) -> list[str]:
    """Split a text at its commas, without the blanks around its parts."""
    return list(map(str.strip, text.split(",")))


def read_whole_numbers(text: str) -> Numbers:
    """Read whole numbers separated by commas."""
    read = make_whole_number_reader(1, 100_000)
    return Numbers(map(read, split_at_commas(text)))


@dataclass(frozen=True)
class WholeRange:
    """Whole numbers from the first up to but not including the end, ``FIRST:END``."""

    first: int
    end: int


def read_whole_range(text: str) -> WholeRange:
    """Read whole numbers as ``FIRST:END``."""
    first, separator, end = text.partition(":")
    read = make_whole_number_reader(0, _LARGEST_IN_RANGE)
    if not separator:
        raise ValueError(f"must be FIRST:END, such as 0:10, got {text!r:.40}")
    numbers = WholeRange(read(first.strip()), read(end.strip()))
    if numbers.end <= numbers.first:
        raise ValueError(f"must end after it begins, got {text!r:.40}")
    return numbers


def keep_given_options(**options: object) -> dict[str, Any]:
    """Keep the options that were given: the default of the others stands in the called function."""
    return {name: value for name, value in options.items() if value is not None}


def require_exactly_one(next_step: str, **options: object) -> None:
    """Require exactly one of several options that exclude each other."""
    count = len(keep_given_options(**options))
    if count != 1:
        names = " or ".join(map(_format_option_name, options))
        raise PipelineError(f"one of {names} must be given, got {count or 'none'}; {next_step}")


def refuse_more_than_one(**options: object) -> None:
    """Refuse more than one of several options that exclude each other."""
    if len(keep_given_options(**options)) > 1:
        names = " and ".join(map(_format_option_name, options))
        raise PipelineError(f"{names} exclude each other: give one of them")


def _format_option_name(name: str) -> str:
    """Return how a user writes an option; an argument stands in capitals."""
    if name.isupper():
        return name
    return f"--{name.replace('_', '-')}"


# What every command takes; a command that needs one of them itself names it in its signature.
Quiet = Annotated[
    bool, typer.Option("--quiet", help="print nothing but errors", rich_help_panel=_EVERYWHERE)
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", help="print what was done and found as JSON", rich_help_panel=_EVERYWHERE
    ),
]
Wide = Annotated[
    bool,
    typer.Option("--wide", help="print all columns of a table", rich_help_panel=_EVERYWHERE),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="replace files that another program or person wrote",
        rich_help_panel=_EVERYWHERE,
    ),
]

# What a command says of the tables and texts that it reads; `command` gathers them in one layout.
_OF_TABLES = "Tables and texts of numbers"
Missing = Annotated[
    list[Any] | None,
    typer.Option(
        "--missing",
        metavar="VALUE",
        parser=parse_missing_value,
        help="number or word that stands for a missing value, such as -9999; may be repeated",
        show_default="numbers that stand out",
        rich_help_panel=_OF_TABLES,
    ),
]
DecimalSign = Annotated[
    Literal[".", ","] | None,
    typer.Option(
        "--decimal",
        help="sign before the fraction",
        show_default="found",
        rich_help_panel=_OF_TABLES,
    ),
]
Encoding = Annotated[
    str | None,
    typer.Option(
        "--encoding",
        metavar="NAME",
        help="of the text, such as cp1252",
        show_default="found",
        rich_help_panel=_OF_TABLES,
    ),
]

# Stimuli and where they stand
Files = Annotated[
    list[Path] | None,
    typer.Argument(metavar="FILE", help="stimulus files or folders", show_default="stimuli"),
]
Blocks = Annotated[
    Path | None, typer.Argument(metavar="FILE", help="stimulus file with the blocks")
]
Faces = Annotated[
    Path | None,
    typer.Argument(metavar="FILE", exists=True, help="stimulus file, for the predicted energies"),
]
Stimuli = Annotated[
    Path | None,
    typer.Option(
        "--stimuli",
        "--set",
        metavar="FILE",
        exists=True,
        help="stimulus file or folder where it is declared",
        show_default="stimuli",
    ),
]
Only = Annotated[
    str | None,
    typer.Option(
        "--only",
        metavar="PATTERN",
        help="only these stimuli, such as 'step-0?0' or 'paper-ten/*'",
    ),
]
Table = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="CSV", help="write a table with units in its header"),
]
AsBuilt = Annotated[
    list[Path] | None,
    typer.Option(
        "--as-built",
        metavar="RECORD",
        help="as-built records of inspect, or folders of them, in place of the nominal sizes",
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        "-j",
        metavar="N",
        parser=make_whole_number_reader(1, 1024),
        help="processes",
        show_default="one per core",
    ),
]


On = Annotated[
    str | None,
    typer.Option(
        "--on",
        metavar="CLUSTER",
        help="a Dask cluster: tcp://ADDRESS:PORT of its scheduler, or slurm, pbs, sge, lsf, "
        "htcondor or oar, of which --jobs workers are asked for",
        show_default="this machine",
    ),
]


def _offer_laws_of_file(file: Path | None) -> Path | None:
    """Offer the effects of a user's file, if one is named; return its path for Typer."""
    if file is not None:
        from stepblocks.rig.effects.offered import offer_laws

        offer_laws(file)
    return file


Laws = Annotated[
    Path | None,
    typer.Option(
        "--laws",
        metavar="FILE.py",
        exists=True,
        callback=_offer_laws_of_file,
        help="Python file with effects of your own (stepblocks.Law), which is run",
    ),
]
Port = Annotated[
    int,
    typer.Option(
        "--port",
        metavar="N",
        parser=make_whole_number_reader(0, 65535),
        help="port of the page on this machine; 0: a free one",
    ),
]
NoOpen = Annotated[bool, typer.Option("--no-open", help="open no browser")]

# Conditions of a drag
TipRadius = Annotated[
    float | None,
    make_quantity_option(
        "length",
        "--tip-radius",
        help="radius of the tip",
        show_default="the first of the set's prediction",
    ),
]
Load = Annotated[
    float | None,
    make_quantity_option(
        "force",
        "--load",
        help="normal load",
        show_default="the first of the set's prediction",
    ),
]
Friction = Annotated[
    float | None,
    make_quantity_option(
        "ratio",
        "--friction",
        help="coefficient of friction",
        show_default="the first of the set's prediction",
    ),
]
Speed = Annotated[
    float | None,
    make_quantity_option(
        "speed",
        "--speed",
        help="speed of the handle",
        show_default="5 mm/s",
    ),
]
StepHeight = Annotated[
    float | None,
    make_quantity_option(
        "length",
        "--step-height",
        help="height of the step under a declared tip",
        show_default="the first of the set's prediction",
    ),
]
