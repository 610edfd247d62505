"""How the commands of commands.txt are taken, and how each option is read."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from stepblocks.errors import PipelineError
from stepblocks.quantities import DIMENSIONS, parse_quantity

if TYPE_CHECKING:
    from stepblocks.cli.outcome import Outcome

Run = Callable[[argparse.Namespace], "Outcome"]
Readers = Mapping[str, Callable[[str], Any]]

_WIDTH = 98  # of help, as of tables
_FILES = (
    "CSV",
    "DIR",
    "FILE",
    "FILE/ID",
    "HTML",
    "JSON",
    "PATH",
    "RECORD",
    "SCAN",
    "SESSION",
    "SPEC.toml",
    "SWEEP.toml",
)
PLACE = ("ball_radius", "normal_load", "friction")


class Parser(argparse.ArgumentParser):
    """A parser that says a mistake in one line, with what was probably meant."""

    groups: Mapping[str, Sequence[str]] = {}  # its commands by what they are for

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

    def format_help(self) -> str:
        """Show the commands of the program itself in their groups."""
        if not self.groups:
            return super().format_help()
        actions = [
            action for one in self._actions for action in getattr(one, "_choices_actions", ())
        ]
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, [], [])
        formatter.add_text(self.description)
        for title, names in self.groups.items():
            formatter.start_section(title)
            formatter.add_arguments([action for action in actions if action.dest in names])
            formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()

    @property
    def commands(self) -> dict[str, Parser]:
        """Parsers of its commands, by name."""
        return {
            name: one
            for a in self._actions
            if isinstance(a.choices, dict)
            for name, one in a.choices.items()
        }


def _formatter(prog: str) -> argparse.HelpFormatter:
    from rich_argparse import RawDescriptionRichHelpFormatter

    RawDescriptionRichHelpFormatter.group_name_formatter = str
    return RawDescriptionRichHelpFormatter(prog, max_help_position=30, width=_WIDTH)


def declare(commands: Any, runs: Mapping[str, Run], readers: Readers) -> dict[str, list[str]]:
    """Register the commands as commands.txt declares them; returns their names in groups."""
    families, shared, groups = {"": commands}, dict[str, list[str]](), dict[str, list[str]]()
    for part in (
        Path(__file__).with_name("commands.txt").read_text(encoding="utf-8").split("\n== ")[1:]
    ):
        head, *lines = part.strip().splitlines()
        if head.startswith("@"):
            shared[head] = [other for line in lines for other in shared.get(line, [line])]
            continue
        if head.startswith("#"):
            groups[head[2:]] = names = []
            continue
        name, _, said = head.partition(": ")
        within, _, word = name.rpartition(" ")
        if not within:
            names.append(name)
        examples = [f"  stepblocks {line[2:]}" for line in lines if line.startswith("$ ")]
        takes = [
            other
            for line in lines
            if "  " in line or line in shared
            for other in shared.get(line, [line])
        ]
        prose = " ".join(
            line for line in lines if not line.startswith(("$ ", "@")) and "  " not in line
        )
        parser: Parser = families[within].add_parser(
            word,
            help=said,
            description=textwrap.fill(prose or f"{said}.", _WIDTH),
            epilog="\n".join(["examples:", *examples]) if examples else None,
        )
        if name in runs:
            parser.set_defaults(run=runs[name], output=None)
            _take_all(parser, takes, readers)
            _take_all(parser.add_argument_group("in every command"), shared["@every"], readers)
        else:
            families[name] = parser.add_subparsers(
                title="commands", metavar="COMMAND", required=True
            )
    return groups


def _take_all(parser: Any, lines: Sequence[str], readers: Readers) -> None:
    group = None
    for line in lines:
        must, bar, option = (
            line.partition("| ") if line.startswith(("| ", "!| ")) else ("", "", line)
        )
        if not bar:
            group = None
        elif group is None:
            group = parser.add_mutually_exclusive_group(required=bool(must))
        _take(group or parser, option, readers)


def _take(parser: Any, line: str, readers: Readers) -> None:
    declared, said = re.split(r"\s{2,}", line, maxsplit=1)
    names, _, metavar = declared.lstrip("!").partition(" ")
    names, _, destination = names.partition(">")
    settings: dict[str, Any] = {"help": said.replace("%", "%%")}
    if names.startswith("-"):
        settings["dest"] = destination or names.rpartition("--")[2].replace("-", "_")
        settings["required"] = declared.startswith("!")
    if not metavar:
        settings |= {"action": "store_true"}
    elif metavar in readers:
        settings |= {"type": readers[metavar], "metavar": metavar}
    else:
        metavar, _, default = metavar.partition("=")
        if metavar[-1] in "+*?":
            settings["nargs"], metavar = metavar[-1], metavar[:-1]
        if default:  # of an option that may stand alone, what it means then
            settings["help"] += f" (default: {default})"
            settings["const" if settings.get("nargs") == "?" else "default"] = default
        if "|" in metavar:
            settings["choices"] = metavar.split("|")
        else:
            settings |= {
                "type": _reader(metavar),
                "metavar": "N" if metavar in ("JOBS", "SEED") else metavar.removesuffix(">0"),
            }
    parser.add_argument(*names.split("/"), **settings)


def _reader(metavar: str) -> Callable[[str], Any]:
    """Find how what a metavar names is read."""
    if metavar in _NUMBERS:
        return _NUMBERS[metavar]
    if (dimension := metavar.removesuffix(">0").lower()) in DIMENSIONS:
        return quantity(dimension, above_zero=metavar.endswith(">0"))
    return Path if metavar in _FILES else str


def given(arguments: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Pick the options that were given, as a default has one home, the function called."""
    return {
        name: value
        for name, value in vars(arguments).items()
        if name in names and value is not None
    }


def number(least: int, most: int) -> Callable[[str], int]:
    """Return a reader of whole numbers."""

    def read(text: str) -> int:
        if not text.isdecimal() or len(text) > 18 or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(
                f"must be a whole number from {least} to {most}, got {text!r:.40}"
            )
        return int(text)

    return read


_NUMBERS: Readers = {
    "N": number(1, 100_000),
    "N,N,...": lambda text: tuple(number(1, 100_000)(part.strip()) for part in text.split(",")),
    "JOBS": number(1, 1024),
    "SEED": number(0, 10**18 - 1),
    "X": float,
}


def quantity(dimension: str, *, above_zero: bool = False) -> Callable[[str], float]:
    """Return a reader of quantities of one dimension."""

    def read(text: str) -> float:
        try:
            value = parse_quantity(text, dimension)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        if above_zero and value <= 0.0:
            raise argparse.ArgumentTypeError(f"must be positive, got {text}")
        return value

    return read
