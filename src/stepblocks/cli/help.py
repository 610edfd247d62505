"""``stepblocks new``, ``help`` and ``completion``: how one begins."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command
from stepblocks.cli.outcome import Outcome

_THINGS = ("block", "crown", "tip", "study", "session", "sweep")
# columns that a session's table of trials must have; the first row shows how
_TRIALS = "trial,block,height_um,load_n,speed_mm_s,tip\n1,step-025,25,0.5,5,tip-125\n"


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "a commented file to begin with"
    description = "Write a file that is valid as it stands and says what can be changed; a session is a folder."
    examples = ("new block mine.toml", "new crown", "new session bench-1")
    new = add_command(commands, "new", _new, said, description, examples=examples)
    new.add_argument("thing", choices=_THINGS)
    new.add_argument("file", nargs="?", type=Path, metavar="FILE", help="where to (default: my-THING.toml, my-session)")

    helped = add_command(commands, "help", _help, "how a command is used", examples=("help", "help export"))
    helped.add_argument("about", nargs="*", metavar="COMMAND", help="such as build, or study design")

    description = "Print a script that completes commands and options; your shell reads it at its start."
    scripts = (
        "completion bash > ~/.local/share/bash-completion/completions/stepblocks",
        "completion zsh > ~/.zfunc/_stepblocks",
    )
    said = "completion of commands and options for a shell"
    complete = add_command(commands, "completion", _completion, said, description, examples=scripts)
    complete.add_argument("shell", choices=("bash", "zsh", "tcsh"))


def _new(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.atomic import replace_text
    from stepblocks.errors import PipelineError

    thing = arguments.thing
    file = arguments.file or Path(f"my-{thing}" if thing == "session" else f"my-{thing}.toml")
    place = file / "session.toml" if thing == "session" else file.with_suffix(".toml")
    if place.exists() and not arguments.force:
        raise PipelineError(f"there is one already; --force replaces it [{place}]")
    place.parent.mkdir(parents=True, exist_ok=True)
    text, then = beginning(thing, file if thing == "session" else place)
    replace_text(place, text)
    if thing == "session":
        replace_text(file / "trials.csv", _TRIALS)
    return Outcome(f"{place}: change it, then run: {then}", record={"written": str(place), "then": then})


def beginning(thing: str, place: Path) -> tuple[str, str]:
    """Return a file to begin with, with what is usual for its kinds below it, and the command that takes it."""
    from stepblocks.parts.series import USUAL

    sections = Path(__file__).with_name("beginnings.txt").read_text(encoding="utf-8").split("==== ")
    (section,) = (one for one in sections if one.startswith(f"{thing}: "))
    head, _, text = section.replace("{file}", str(place)).replace("{folder}", str(place)).partition("\n")
    text, _, kinds = text.partition("%usual ")
    for kind in kinds.split():
        text += f"# What a {kind} leaves out; to change it for all of them, take the leading '# ' away.\n"
        tables = [f"[{table}" for table in USUAL.read_text(encoding="utf-8").split("\n[") if table.startswith(kind)]
        lines = (
            "\n".join(tables)
            .strip()
            .replace("otherwise", "tolerance")
            .replace(f"[{kind}", f"[defaults.{kind}")
            .splitlines()
        )
        text += "".join(f"# {line}\n" if line else "#\n" for line in lines if "{ tolerance" not in line) + "\n"
    return text.rstrip() + "\n", head.partition(": ")[2]


def _help(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.cli import make_parser

    make_parser().parse_args([*arguments.about, "--help"])
    raise AssertionError  # asked for help, a parser prints it and ends


def _completion(arguments: argparse.Namespace) -> Outcome:
    import shtab

    from stepblocks.cli import make_parser

    print(shtab.complete(make_parser(), arguments.shell))
    return Outcome("")
