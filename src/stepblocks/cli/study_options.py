"""Options that the commands on people share: how each is read, and which simulated participants are meant."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command as add_leaf
from stepblocks.cli.arguments import given, number, quantity
from stepblocks.cli.outcome import Outcome
from stepblocks.errors import PipelineError

# argument, metavar, what it is, how it stands in an example; ? where it may be left out
_TAKEN = {
    "blocks": ("file", "FILE", "stimulus file with the blocks", "mine.toml", "?"),
    "folder": ("folder", "DIR", "folder of the study", "study", None),
    "faces": ("file", "FILE", "stimulus file, for the predicted energies", "mine.toml", "?"),
}

_EXAMPLES = {
    "design": "--seed 7 -o study",
    "simulate": "--seed 7",
    "analyse": "study/answers.csv",
    "power": "--damping bare=1,soft=0.5 --seed 7",
    "start": "--standard step-050 --seed 7 -o study",
    "run": "--participant 1",
    "undo": "--participant 1",
    "share": "study/answers.csv --as bids -o dataset",
}


def add_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], Outcome],
    said: str,
    *takes: str,
    within: str = "study",
) -> Any:
    """Register a command with the files it takes; an option not given is left out: its default stands in the function."""
    words = [within, name, *(_TAKEN[one][3] for one in takes), _EXAMPLES.get(name, "")]
    parser = add_leaf(commands, name, run, said, examples=(" ".join(words).strip(),), leave_out=True)
    for argument, metavar, what, _, nargs in (_TAKEN[one] for one in takes):
        parser.add_argument(argument, type=Path, metavar=metavar, help=what, nargs=nargs, default=None)
    if "blocks" in takes:
        said = "in place of a FILE: heights in micrometres, such as 20,40,60,80"
        parser.add_argument("--heights", type=heights, metavar="H,H,...", help=said)
    return parser


def add_observer(parser: Any) -> None:
    """Ask for simulated participants and for where they feel."""
    length, ratio = quantity("length"), quantity("ratio")
    shares = "share of the vibration energy that each condition lets through, such as bare=1,hard=0.9,soft=0.5, or a set of sheaths"
    noisier = "how many times the response noise each condition has, such as soft=3"
    condition = "between participants in their response to a condition (default: 0)"
    for option, name, kind, metavar, said in (
        ("--damping", "damping", _shares, "A=X,B=Y", shares),
        ("--noisier", "noise", _shares, "A=X,B=Y", noisier),
        ("--weber", "weber", ratio, "X", "Weber fraction of the energy (default: 0.2)"),
        ("--noise", "response_noise", length, "L", "response noise (default: '5 um')"),
        ("--spread", "participant_spread", length, "L", "between participants (default: '3 um')"),
        ("--condition-spread", "condition_spread", length, "L", condition),
        ("--lapse", "lapse", ratio, "X", "rate of lapses (default: 0)"),
    ):
        parser.add_argument(option, dest=name, type=kind, metavar=metavar, help=said)
    add_place(parser)


def add_place(parser: Any) -> None:
    """Ask for where blocks are felt."""
    for option, name, dimension, metavar, said in (
        ("--tip-radius", "ball_radius", "length", "L", "tip radius"),
        ("--load", "normal_load", "force", "F", "normal load"),
        ("--friction", "friction", "ratio", "X", "friction"),
    ):
        shown = f"{said} (default: the file's first)"
        parser.add_argument(option, dest=name, type=quantity(dimension), metavar=metavar, help=shown)


def heights(text: str) -> tuple[float, ...]:
    """Read heights in micrometres [m]."""
    return tuple(quantity("length")(part if part.strip(" 0123456789.") else f"{part} um") for part in text.split(","))


def source_of(arguments: argparse.Namespace) -> Any:
    """Return the stimulus file or the heights, of which one must be given."""
    asked = getattr(arguments, "heights", None)
    if (arguments.file is None) == (asked is None):
        raise PipelineError("a stimulus FILE or --heights must be given, got " + ("both" if asked else "neither"))
    return asked or arguments.file


def options(arguments: argparse.Namespace, function: Callable[..., Any]) -> dict[str, Any]:
    """Return the options that were given and that a function takes by their names."""
    takes = inspect.signature(function).parameters.values()
    return given(arguments, *(one.name for one in takes if one.kind is one.KEYWORD_ONLY))


def place_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return what `add_place` asked for."""
    return given(arguments, "ball_radius", "normal_load", "friction")


def observed(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what `add_observer` asked for as keywords of the functions that simulate."""
    from stepblocks.study.simulate import Observer

    observer = Observer(**given(arguments, *vars(Observer())))
    return {"observer": observer, **place_of(arguments)}


whole = number(0, 10**18 - 1)
count = number(1, 100_000)


def counts(text: str) -> tuple[int, ...]:
    """Read numbers separated by commas."""
    return tuple(count(part.strip()) for part in text.split(","))


def names(text: str) -> tuple[str, ...]:
    """Read names separated by commas."""
    found = tuple(part.strip() for part in text.split(","))
    if not all(name and name.replace("-", "").isalnum() for name in found):
        raise argparse.ArgumentTypeError(
            f"must be names of letters, digits and hyphens, separated by commas, got {text!r:.60}"
        )
    return found


def scale(text: str) -> tuple[int, int]:
    """Read the ends of a scale."""
    low, dash, high = text.partition("-")
    if not dash or whole(low) >= whole(high):
        raise argparse.ArgumentTypeError(f"must be LOW-HIGH such as 1-7, got {text!r:.40}")
    return whole(low), whole(high)


def _pairs(text: str, what: str) -> dict[str, str]:
    parts = [part.strip().partition("=") for part in text.split(",")]
    if not all(name and equals and value for name, equals, value in parts):
        raise argparse.ArgumentTypeError(f"must be {what}, separated by commas, got {text!r:.60}")
    return {name: value for name, _, value in parts}


def named(text: str) -> dict[str, str]:
    """Read names for columns."""
    return _pairs(text, "ours=theirs")


def _shares(text: str) -> dict[str, float]:
    if text.endswith(".toml"):
        from stepblocks.predict.sheaths import damping_of

        return damping_of(text)
    return {name: quantity("ratio")(value) for name, value in _pairs(text, "name=share").items()}
