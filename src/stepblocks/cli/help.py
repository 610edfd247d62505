"""``stepblocks new``, ``help`` and ``completion``: how one begins."""

from __future__ import annotations

import argparse
from typing import Any

from stepblocks.cli.arguments import add_command
from stepblocks.cli.outcome import Outcome


def add_to(commands: Any) -> None:
    """Register the commands."""
    helped = add_command(commands, "help", _help, "how a command is used", examples=("help", "help export"))
    helped.add_argument("about", nargs="*", metavar="COMMAND", help="such as build, or study design")

    description = "Print a script that completes commands and options; your shell reads it at its start."
    examples = (
        "completion bash > ~/.local/share/bash-completion/completions/stepblocks",
        "completion zsh > ~/.zfunc/_stepblocks",
    )
    said = "completion of commands and options for a shell"
    complete = add_command(commands, "completion", _completion, said, description, examples=examples)
    complete.add_argument("shell", choices=("bash", "zsh", "tcsh"))


def _help(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.cli import make_parser

    make_parser().parse_args([*arguments.about, "--help"])
    raise AssertionError  # asked for help, a parser prints it and ends


def _completion(arguments: argparse.Namespace) -> Outcome:
    import shtab

    from stepblocks.cli import make_parser

    print(shtab.complete(make_parser(), arguments.shell))
    return Outcome("")
