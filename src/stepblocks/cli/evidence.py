"""``stepblocks evidence``: the model against what others published."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, add_output
from stepblocks.cli.outcome import Outcome


def add_to(commands: Any) -> None:
    """Register the command."""
    said = "hold the model against what others published: agrees, disagrees, or not said"
    description = (
        "Published figures, the model's answers beside each, a verdict, and what would resolve the paper's own "
        "contradiction; one page with pictures."
    )
    examples = ("evidence", "evidence mine.toml -o out/evidence")
    parser = add_command(commands, "evidence", _run, said, description, examples=examples)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="publications of your own, one TOML each")
    add_output(parser, "out/evidence")


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.evidence.compare import hold_against_evidence

    found = hold_against_evidence(arguments.output, also=arguments.files)
    shown = found.table.drop(columns=["said"]), found.resolutions.drop(columns=["setting"])
    full = {"evidence": found.table.to_dict("records"), "resolutions": found.resolutions.to_dict("records")}
    tables = {title: table.to_dict("records") for title, table in zip(full, shown, strict=True)}
    return Outcome(found.finding(), tables, look=arguments.output / "evidence.html", record=full)
