"""``stepblocks feel``: drag the probe with the mouse."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "feel",
        help="a page on which the mouse drags the probe over a block",
        description="Write one page that needs no network, and open it: force, spectrum, locking, and the ring as sound.",
    )
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="SET", help="stimulus files or folders (default: stimuli)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/feel.html"), metavar="HTML", help="default: out/feel.html"
    )
    parser.add_argument("--no-open", action="store_true", help="write the page and leave it")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.simulators.feel import feel

    count = feel(arguments.files, arguments.output)
    print(f"{arguments.output}: {count} blocks")
    if not arguments.no_open:
        import webbrowser

        webbrowser.open(arguments.output.resolve().as_uri())
    return 0
