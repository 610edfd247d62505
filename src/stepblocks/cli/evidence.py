"""``stepblocks evidence``: the model against what others published."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "evidence",
        help="hold the model against what others published: agrees, disagrees, or not said",
        description="Published figures, the model's answers beside each, a verdict, and what would resolve the paper's own "
        "contradiction; one page with pictures.",
    )
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="publications of your own, one TOML each")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/evidence"), metavar="DIR", help="default: out/evidence"
    )
    parser.add_argument("--json", action="store_true", help="print both tables as JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.evidence.compare import hold_against_evidence

    found = hold_against_evidence(arguments.output, also=arguments.files)
    if arguments.json:
        import json

        tables = {"evidence": found.table, "resolutions": found.resolutions}
        print(json.dumps({name: table.to_dict("records") for name, table in tables.items()}, indent=1))
        return 0
    print(found.table.drop(columns=["said"]).to_string(index=False, justify="left"))
    print("\n" + found.resolutions.drop(columns=["setting"]).to_string(index=False, justify="left"))
    print(f"\n{found.finding()}\nopen {arguments.output / 'evidence.html'}")
    return 0
