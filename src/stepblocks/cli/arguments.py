"""What several commands take alike."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path


def add_files(parser: argparse.ArgumentParser, metavar: str = "FILE", more: str = "") -> None:
    """Take stimulus files, or folders of them."""
    parser.add_argument(
        "files", nargs="*", type=Path, metavar=metavar, help=f"stimulus files or folders (default: stimuli){more}"
    )


def add_output(parser: argparse.ArgumentParser, default: str, metavar: str = "DIR") -> None:
    """Take where to write to."""
    parser.add_argument("-o", "--output", type=Path, default=Path(default), metavar=metavar, help=f"default: {default}")


def add_only(parser: argparse.ArgumentParser) -> None:
    """Take a pattern of stimuli."""
    parser.add_argument("--only", metavar="PATTERN", help="only these stimuli, such as 'step-0?0' or 'paper-ten/*'")


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
