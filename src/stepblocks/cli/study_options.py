"""Options that the commands on people share: how each is read, and which simulated participants are meant."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

_TAKEN = {
    "blocks": ("file", "FILE", "stimulus file with the blocks"),
    "folder": ("folder", "DIR", "folder of the study"),
    "energies": ("file", "FILE", "stimulus file, for the predicted energies"),
}


def add_command(commands: Any, name: str, run: Callable[[argparse.Namespace], int], said: str, *takes: str) -> Any:
    """Register a command with the files it takes; an option not given is left out, as its default has one home, the function called."""
    parser = commands.add_parser(name, help=said, argument_default=argparse.SUPPRESS)
    for argument, metavar, what in (_TAKEN[one] for one in takes):
        parser.add_argument(argument, type=Path, metavar=metavar, help=what)
    parser.set_defaults(run=run)
    return parser


def given(arguments: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Pick the options that were given."""
    return {name: value for name, value in vars(arguments).items() if name in names}


def add_observer(parser: Any) -> None:
    """Ask for simulated participants and for where they feel."""
    length, ratio = quantity("length"), quantity("ratio")

    def add(option: str, name: str, kind: Callable[[str], Any], metavar: str, said: str) -> None:
        parser.add_argument(option, dest=name, type=kind, metavar=metavar, help=said)

    said = "share of the vibration energy that each condition lets through, such as bare=1,hard=0.9,soft=0.5"
    add("--damping", "damping", _shares, "A=X,B=Y", said)
    add("--weber", "weber", ratio, "X", "Weber fraction of the energy (default: 0.2)")
    add("--noise", "response_noise", length, "L", "response noise (default: '5 um')")
    add("--spread", "participant_spread", length, "L", "between participants (default: '3 um')")
    said = "between participants in their response to a condition (default: 0)"
    add("--condition-spread", "condition_spread", length, "L", said)
    add("--lapse", "lapse", ratio, "X", "rate of lapses (default: 0)")
    add("--tip", "ball_radius", length, "L", "tip radius (default: the file's first)")
    add("--load", "normal_load", quantity("force"), "F", "normal load (default: the file's first)")
    add("--friction", "friction", ratio, "X", "friction (default: the file's first)")


def observed(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what `add_observer` asked for as keywords of the functions that simulate."""
    from stepblocks.study.simulate import Observer

    observer = Observer(**given(arguments, *vars(Observer())))
    return {"observer": observer, **given(arguments, "ball_radius", "normal_load", "friction")}


def whole(text: str) -> int:
    """Read a whole number."""
    if not text.isdecimal() or len(text) > 18:
        raise argparse.ArgumentTypeError(f"must be a whole number, got {text!r:.40}")
    return int(text)


def count(text: str) -> int:
    """Read a number of people, trials or processes."""
    number = whole(text)
    if not 1 <= number <= 100_000:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 to 100000, got {text!r:.40}")
    return number


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


def _shares(text: str) -> dict[str, float]:
    shares = {}
    for part in text.split(","):
        name, equals, value = part.strip().partition("=")
        if not (name and equals):
            raise argparse.ArgumentTypeError(f"must be name=share, separated by commas, got {text!r:.60}")
        shares[name] = quantity("ratio")(value)
    return shares


def quantity(dimension: str) -> Callable[[str], float]:
    """Return a reader of quantities of one dimension."""

    def parse(text: str) -> float:
        from stepblocks.quantities import parse_quantity

        try:
            return parse_quantity(text, dimension)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return parse
