"""What several commands take alike, and how each is read."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def add_command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], int], said: str, description: str
) -> argparse.ArgumentParser:
    """Register a command with what it runs."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=said, description=description)
    parser.set_defaults(run=run)
    return parser


def add_files(parser: argparse.ArgumentParser, metavar: str = "FILE", more: str = "") -> None:
    """Take stimulus files, or folders of them."""
    said = f"stimulus files or folders (default: stimuli){more}"
    parser.add_argument("files", nargs="*", type=Path, metavar=metavar, help=said)


def add_output(
    parser: argparse.ArgumentParser, default: str | None = None, metavar: str = "DIR", said: str | None = None
) -> None:
    """Take where to write to; without a default it must be said."""
    place = (
        {"required": True, "help": said}
        if default is None
        else {"default": Path(default), "help": f"default: {default}"}
    )
    parser.add_argument("-o", "--output", type=Path, metavar=metavar, **place)


def add_only(parser: argparse.ArgumentParser) -> None:
    """Take a pattern of stimuli."""
    parser.add_argument("--only", metavar="PATTERN", help="only these stimuli, such as 'step-0?0' or 'paper-ten/*'")


def quantities(arguments: argparse.Namespace, wanted: Mapping[str, str], said: str = "--{} {}") -> dict[str, float]:
    """Read those options that were given, by name and dimension; an error says the option as `said` does."""
    from stepblocks.errors import PipelineError, QuantityError
    from stepblocks.quantities import parse_quantity

    found = {}
    for name, dimension in wanted.items():
        text = getattr(arguments, name)
        if text is None:
            continue
        try:
            found[name] = parse_quantity(text, dimension)
        except QuantityError as error:
            raise PipelineError(said.format(name.replace("_", "-"), error)) from error
    return found


def progress(did: str, unit: str, *, lines: int = 0) -> Callable[[int, int], None]:
    """Show what is done of how many: a bar on a terminal, elsewhere so many plain lines."""
    if sys.stderr.isatty():
        from tqdm import tqdm

        bar = tqdm(unit=unit, desc=did)

        def on_terminal(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)
            if done == total:
                bar.close()

        return on_terminal

    def in_lines(done: int, total: int) -> None:
        if lines and (done % max(total // lines, 1) == 0 or done == total):
            print(f"{did} {done} of {total}", file=sys.stderr, flush=True)

    return in_lines
