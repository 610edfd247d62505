"""Options that the commands on people share: how each is read, and which simulated participants are meant."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command as add_leaf
from stepblocks.cli.arguments import given, number, quantity
from stepblocks.cli.outcome import Outcome

_TAKEN = {
    "blocks": ("file", "FILE", "stimulus file with the blocks", "mine.toml"),
    "folder": ("folder", "DIR", "folder of the study", "study"),
    "energies": ("file", "FILE", "stimulus file, for the predicted energies", "mine.toml"),
}

_EXAMPLES = {
    "design": "--seed 7 -o study",
    "simulate": "--seed 7",
    "analyse": "study/answers.csv",
    "power": "--damping bare=1,soft=0.5 --seed 7",
    "start": "--standard step-050 --seed 7 -o study",
    "next": "--participant 1",
    "answer": "--participant 1 --trial 1 y",
    "run": "--participant 1",
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
    for argument, metavar, what, _ in (_TAKEN[one] for one in takes):
        parser.add_argument(argument, type=Path, metavar=metavar, help=what)
    return parser


def add_observer(parser: Any) -> None:
    """Ask for simulated participants and for where they feel."""
    length, ratio = quantity("length"), quantity("ratio")

    def add(option: str, name: str, kind: Callable[[str], Any], metavar: str, said: str) -> None:
        parser.add_argument(option, dest=name, type=kind, metavar=metavar, help=said)

    said = "share of the vibration energy that each condition lets through, such as bare=1,hard=0.9,soft=0.5, or a set of sheaths"
    add("--damping", "damping", _shares, "A=X,B=Y", said)
    add("--weber", "weber", ratio, "X", "Weber fraction of the energy (default: 0.2)")
    add("--noise", "response_noise", length, "L", "response noise (default: '5 um')")
    add("--spread", "participant_spread", length, "L", "between participants (default: '3 um')")
    said = "between participants in their response to a condition (default: 0)"
    add("--condition-spread", "condition_spread", length, "L", said)
    add("--lapse", "lapse", ratio, "X", "rate of lapses (default: 0)")
    add("--tip-radius", "ball_radius", length, "L", "tip radius (default: the file's first)")
    add("--load", "normal_load", quantity("force"), "F", "normal load (default: the file's first)")
    add("--friction", "friction", ratio, "X", "friction (default: the file's first)")


def observed(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what `add_observer` asked for as keywords of the functions that simulate."""
    from stepblocks.study.simulate import Observer

    observer = Observer(**given(arguments, *vars(Observer())))
    return {"observer": observer, **given(arguments, "ball_radius", "normal_load", "friction")}


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


def _shares(text: str) -> dict[str, float]:
    if text.endswith(".toml"):
        from stepblocks.predict.sheaths import damping_of

        return damping_of(text)
    shares = {}
    for part in text.split(","):
        name, equals, value = part.strip().partition("=")
        if not (name and equals):
            raise argparse.ArgumentTypeError(f"must be name=share, separated by commas, got {text!r:.60}")
        shares[name] = quantity("ratio")(value)
    return shares
