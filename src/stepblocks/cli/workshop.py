"""``stepblocks workshop``: have the stimuli made."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import Files, Only, Quiet, quantity_option
from stepblocks.cli.outcome import Outcome, make_progress

app = typer.Typer()


@command(
    app,
    "workshop",
    "workshop mine.toml",
    "workshop --only 'paper-ten/*' --capability '1 um'",
    panel="Stimuli",
)
def workshop(
    *,
    files: Files = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out"),
    only: Only = None,
    capability: Annotated[
        float | None,
        quantity_option(
            "length",
            "--capability",
            help="deviation of a height that your workshop holds in one piece; ask it",
            show_default="2 um, ground",
        ),
    ] = None,
    quiet: Quiet = False,
) -> Outcome:
    """Write drawings, inspection sheets and gauge-block variants; compare the routes of making.

    Drawings (DXF, SVG, PDF) and inspection sheets (CSV, PDF) of every part, the two-piece variant
    of step blocks, setup sheets with the stock, and a table of the ways to make them with what each
    lets a user feel.
    """
    from stepblocks.workshop.run import order_parts, tabulate_routes

    progress = make_progress("drawn", quiet=quiet, lines=1000)
    orders = order_parts(
        files or [],
        output,
        only=only,
        capability=capability,
        announce=lambda one: progress(name=f"{one.name}: {len(one.files)} files"),
    )
    return Outcome(
        f"{sum(len(order.files) for order in orders)} files of {len(orders)} "
        f"part{'s' * (len(orders) > 1)} in {output}",
        notes=[f"{order.name}: {order.note}" for order in orders if order.note],
        tables={"Routes": tabulate_routes(orders)},
        record={order.name: [str(path) for path in order.files] for order in orders},
    )
