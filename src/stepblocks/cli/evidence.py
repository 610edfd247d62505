"""``stepblocks evidence``: the model beside what others published."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.outcome import Outcome

app = typer.Typer()


@command(app, "evidence", "evidence", panel="what will be felt")
def evidence(
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out/evidence"),
) -> Outcome:
    """Compare the model with what others published: agrees, disagrees, or not said.

    Published figures, the model's answers beside each, a verdict, and what would resolve the
    paper's own contradiction; one page with pictures.
    """
    from stepblocks.evidence.compare import hold_against_evidence

    found = hold_against_evidence(output)
    shown = found.table.drop(columns=["said"]), found.resolutions.drop(columns=["setting"])
    record = {
        "evidence": found.table.to_dict("records"),
        "resolutions": found.resolutions.to_dict("records"),
    }
    tables = {title: table.to_dict("records") for title, table in zip(record, shown, strict=True)}
    return Outcome(found.finding(), tables, page=output / "evidence.html", record=record)
