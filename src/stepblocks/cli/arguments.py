"""How a command is declared: what several take alike, how each option is read, and what every command takes."""

from __future__ import annotations

import argparse
import difflib
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from stepblocks.cli.outcome import Outcome

_WIDTH = 98  # of help, as of tables


class Parser(argparse.ArgumentParser):
    """A parser that says a mistake in one line, with what was probably meant."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=_formatter, **settings)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line, and what was probably meant."""
        meant, parser = [], self
        for word in (word.partition("=")[0] for word in sys.argv[1:]):
            commands = parser.commands
            known = [*parser._option_string_actions] if word.startswith("-") else [*commands]
            if word not in known:
                meant += difflib.get_close_matches(word, known, 1, 0.7)
            parser = commands.get(word, parser)
        hint = f"; did you mean {' '.join(meant)}?" if meant else f" (see {parser.prog} --help)"
        raise PipelineError(f"{message}{hint}")

    @property
    def commands(self) -> dict[str, Parser]:
        """Parsers of its commands, by name."""
        return {name: one for a in self._actions if isinstance(a.choices, dict) for name, one in a.choices.items()}


def _formatter(prog: str) -> argparse.HelpFormatter:
    from rich_argparse import RawDescriptionRichHelpFormatter

    RawDescriptionRichHelpFormatter.group_name_formatter = str
    return RawDescriptionRichHelpFormatter(prog, max_help_position=30, width=_WIDTH)


def add_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], Outcome],
    said: str,
    description: str = "",
    *,
    examples: Sequence[str] = (),
    leave_out: bool = False,
) -> Parser:
    """Register a command with what it runs and how it is called; `leave_out` drops options that are not given."""
    shown = "\n".join(["examples:", *(f"  stepblocks {one}" for one in examples)]) if examples else None
    parser: Parser = commands.add_parser(
        name,
        help=said,
        description=textwrap.fill(description or f"{said}.", _WIDTH),
        epilog=shown,
        argument_default=argparse.SUPPRESS if leave_out else None,
    )
    every = parser.add_argument_group("in every command")
    for option, meant in (
        ("quiet", "say nothing but errors"),
        ("json", "print what was done and found as JSON"),
        ("wide", "print all columns of a table"),
        ("force", "replace files that are not ours"),
    ):
        every.add_argument(f"--{option}", action="store_true", default=False, help=meant)
    parser.set_defaults(run=run, output=None)
    return parser


def add_files(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Take stimulus files, or folders of them."""
    said = f"stimulus files or folders (default: stimuli){more}"
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help=said)


def add_stimuli(parser: argparse.ArgumentParser) -> None:
    """Take where a stimulus that is named by its identity is declared; ``--set`` is its old name."""
    said = "stimulus file or folder where it is declared (default: stimuli)"
    parser.add_argument("--stimuli", type=Path, default=Path("stimuli"), metavar="FILE", help=said)
    parser.add_argument("--set", dest="stimuli", type=Path, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def add_output(
    parser: argparse.ArgumentParser, default: str | None = None, metavar: str = "DIR", said: str = "where to write"
) -> None:
    """Take where to write to."""
    shown = f"{said} (default: {default})" if default else said
    place = Path(default) if default else None
    parser.add_argument("-o", "--output", type=Path, default=place, metavar=metavar, help=shown)


def add_only(parser: argparse.ArgumentParser) -> None:
    """Take a pattern of stimuli."""
    parser.add_argument("--only", metavar="PATTERN", help="only these stimuli, such as 'step-0?0' or 'paper-ten/*'")


def add_jobs(parser: argparse.ArgumentParser, default: int | None = None) -> None:
    """Take a number of processes."""
    said = f"processes (default: {default or 'one per core'})"
    place = argparse.SUPPRESS if parser.argument_default is argparse.SUPPRESS else default
    parser.add_argument("-j", "--jobs", type=number(1, 1024), metavar="N", help=said, default=place)


def given(arguments: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Pick the options that were given, as a default has one home, the function called."""
    return {name: value for name, value in vars(arguments).items() if name in names and value is not None}


def number(least: int, most: int) -> Callable[[str], int]:
    """Return a reader of whole numbers."""

    def read(text: str) -> int:
        if not text.isdecimal() or len(text) > 18 or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"must be a whole number from {least} to {most}, got {text!r:.40}")
        return int(text)

    return read


def quantity(dimension: str, *, above_zero: bool = False) -> Callable[[str], float]:
    """Return a reader of quantities of one dimension."""

    def read(text: str) -> float:
        from stepblocks.quantities import parse_quantity

        try:
            value = parse_quantity(text, dimension)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        if above_zero and value <= 0.0:
            raise argparse.ArgumentTypeError(f"must be positive, got {text}")
        return value

    return read
