"""``stepblocks feel``: drag the probe with the mouse."""

from __future__ import annotations

import argparse
from typing import Any

from stepblocks.cli.arguments import add_files, add_output


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "feel",
        help="a page on which the mouse drags the probe over a block",
        description="Write one page that needs no network, and open it: force, spectrum, locking, and the ring as sound.",
    )
    add_files(parser, "SET")
    add_output(parser, "out/feel.html", "HTML")
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
