"""Options that the commands of ``stepblocks study`` share."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.options import (
    make_quantity_reader,
    make_whole_number_reader,
    split_at_commas,
)
from stepblocks.errors import PipelineError


class Heights(tuple[float, ...]):
    """Heights [m], separated by commas on the command line."""


def _parse_heights(text: str) -> Heights:
    """Read heights in micrometres, or in the unit that each names."""
    read = make_quantity_reader("length")
    heights = []
    for part in text.split(","):
        has_unit = bool(part.strip(" 0123456789."))
        if has_unit:
            heights.append(read(part))
        else:
            heights.append(read(f"{part} um"))
    return Heights(heights)


class Names(tuple[str, ...]):
    """Names, separated by commas on the command line."""


def parse_names(text: str) -> Names:
    """Read names separated by commas."""
    found = Names(split_at_commas(text))
    for name in found:
        if not name.replace("-", "").isalnum():
            raise ValueError(
                "must be names of letters, digits and hyphens, separated by commas, got "
                f"{text!r:.60}"
            )
    return found


def parse_name_value_pairs(text: str, expected_form: str = "name=value") -> dict[str, str]:
    """Read name=value, separated by commas."""
    pairs = {}
    for part in split_at_commas(text):
        name, _, value = part.partition("=")
        if not name or not value:
            raise ValueError(f"must be {expected_form}, separated by commas, got {text!r:.60}")
        pairs[name] = value
    return pairs


HeightsOption = Annotated[
    Heights | None,
    typer.Option(
        "--heights",
        metavar="H,H,...",
        parser=_parse_heights,
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


def choose_height_source(file: Path | None, heights: Heights | None) -> Path | Heights:
    """Return the stimulus file or the heights, of which one must be given."""
    if file is not None and heights is None:
        return file
    if heights is not None and file is None:
        return heights
    number = "both"
    if heights is None:
        number = "neither"
    raise PipelineError(f"a stimulus FILE or --heights must be given, got {number}")
