"""``stepblocks workshop``: write what a workshop is sent besides the STEP file."""

from __future__ import annotations

import argparse
from typing import Any

from stepblocks.cli.arguments import add_command, add_files, add_only, add_output


def add_to(commands: Any) -> None:
    """Register the command."""
    said = "write drawings, inspection sheets and gauge-block variants, and say which route reaches each tolerance"
    description = (
        "Drawings (DXF, SVG, PDF) and inspection sheets (CSV, PDF) of every part, the two-piece variant of "
        "step blocks, and a table of the ways to make them."
    )
    parser = add_command(commands, "workshop", _run, said, description)
    add_files(parser)
    add_output(parser, "out")
    add_only(parser)
    said = "deviation of a height that the workshop holds in one piece; ask it (default: 2 um, ground, not lapped)"
    parser.add_argument("--capability", metavar="LENGTH", help=said)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.workshop.run import order_parts, route_table

    orders = order_parts(
        arguments.files,
        arguments.output,
        only=arguments.only,
        capability=arguments.capability,
        announce=lambda order: print(f"{order.name}: {len(order.files)} files", flush=True),
    )
    if any(order.routes for order in orders):
        print("\n" + route_table(orders))
    return 0
