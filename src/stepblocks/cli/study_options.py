"""Options that the commands of ``stepblocks study`` share."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.options import make_quantity_reader, make_whole_number_reader
from stepblocks.errors import PipelineError


class Heights(tuple[float, ...]):
    """Heights [m], separated by commas on the command line."""


def _read_heights(text: str) -> Heights:
    """Read heights in micrometres, or in the unit that each names."""
    read = make_quantity_reader("length")
    heights = []
    for part in text.split(","):
        has_unit = bool(part.strip(" 0123456789."))
        heights.append(read(part if has_unit else f"{part} um"))
    return Heights(heights)


class Names(tuple[str, ...]):
    """Names, separated by commas on the command line."""


def read_names(text: str) -> Names:
    """Read names separated by commas."""
    found = Names(part.strip() for part in text.split(","))
    if not all(name and name.replace("-", "").isalnum() for name in found):
        raise ValueError(
            f"must be names of letters, digits and hyphens, separated by commas, got {text!r:.60}"
        )
    return found


def read_pairs(text: str, form: str = "name=value") -> dict[str, str]:
    """Read name=value, separated by commas."""
    parts = [part.strip().partition("=") for part in text.split(",")]
    if not all(name and equals and value for name, equals, value in parts):
        raise ValueError(f"must be {form}, separated by commas, got {text!r:.60}")
    return {name: value for name, _, value in parts}


HeightsOption = Annotated[
    Heights | None,
    typer.Option(
        "--heights",
        metavar="H,H,...",
        parser=_read_heights,
        help="in place of a FILE: heights in micrometres, such as 20,40,60,80",
    ),
]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="folder of the study")]
Participants = Annotated[
    int | None,
    typer.Option(
        "--participants",
        metavar="N",
        parser=make_whole_number_reader(1, 100_000),
        help="number of participants",
        show_default="10",
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed",
        metavar="N",
        parser=make_whole_number_reader(0, 10**18 - 1),
        help="seed of all random choices",
    ),
]
StandardOption = Annotated[
    str | None,
    typer.Option(
        "--standard",
        metavar="ID",
        help="block that all others are compared with (constant, adaptive; power: constant)",
    ),
]


def choose_source(file: Path | None, heights: Heights | None) -> Path | Heights:
    """Return the stimulus file or the heights, of which one must be given."""
    if file is not None and heights is None:
        return file
    if heights is not None and file is None:
        return heights
    number = "neither" if heights is None else "both"
    raise PipelineError(f"a stimulus FILE or --heights must be given, got {number}")
