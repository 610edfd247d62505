"""``stepblocks workshop``: write what a workshop is sent besides the STEP file."""

from __future__ import annotations

import argparse
from typing import Any

from stepblocks.cli.arguments import add_command, add_files, add_only, add_output
from stepblocks.cli.outcome import Outcome, telling


def add_to(commands: Any) -> None:
    """Register the command."""
    said = "write drawings, inspection sheets and gauge-block variants, and say which route reaches each tolerance"
    description = (
        "Drawings (DXF, SVG, PDF) and inspection sheets (CSV, PDF) of every part, the two-piece variant of "
        "step blocks, setup sheets with the stock, and a table of the ways to make them with what each lets a user feel."
    )
    examples = ("workshop mine.toml", "workshop --only 'paper-ten/*' --capability '1 um'")
    parser = add_command(commands, "workshop", _run, said, description, examples=examples)
    add_files(parser)
    add_output(parser, "out")
    add_only(parser)
    said = "deviation of a height that the workshop holds in one piece; ask it (default: 2 um, ground, not lapped)"
    parser.add_argument("--capability", metavar="LENGTH", help=said)
    said = "write the masks of etched steps too, one GDSII file for each set (extra `masks`)"
    parser.add_argument("--masks", action="store_true", help=said)


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.workshop.run import order_parts, route_lines

    told = telling(arguments, "drawn", lines=1000)
    chosen = {name: getattr(arguments, name) for name in ("only", "capability", "masks")}
    orders = order_parts(
        arguments.files,
        arguments.output,
        **chosen,
        announce=lambda one: told(name=f"{one.name}: {len(one.files)} files"),
    )
    missing = [f"MISSING {line}" for order in orders for line in order.missing]
    return Outcome(
        f"{sum(len(order.files) for order in orders)} files of {len(orders)} parts in {arguments.output}",
        tables={"Routes": route_lines(orders)},
        code=1 if missing else 0,
        failures=missing,
        record={order.name: [str(path) for path in order.files] for order in orders},
    )
