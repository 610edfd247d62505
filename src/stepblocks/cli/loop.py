"""``stepblocks loop``: measured session in; verdict, model, error before and after, and a report out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import progress


def add_to(subparsers: Any) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "loop",
        help="find what the model lacks for a measured session",
        description="Measure a session, trace the residual to an effect, add it, and report the error before and "
        "after: features.csv, result.json, model.json and report.html in the output folder.",
    )
    parser.add_argument("session", type=Path, help="folder with session.toml, trials.csv and traces")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.add_argument("-j", "--jobs", type=int, default=None, help="processes; all cores where omitted")
    parser.add_argument("--forces-only", action="store_true", help="leave the scans of the blocks out")
    parser.add_argument(
        "--as-built",
        nargs="+",
        type=Path,
        default=[],
        metavar="RECORD",
        help="as-built records of inspected blocks, or folders of them, instead of the session's scans",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.loop.run import loop_session

    result = loop_session(
        arguments.session,
        arguments.output,
        jobs=arguments.jobs,
        forces_only=arguments.forces_only,
        as_built=arguments.as_built,
        progress=progress("measured", "trial"),
    )
    for scan in result.document["scans"]["left_out"]:
        print(f"scan of {scan['block']} left out: {scan['reason']}", file=sys.stderr)
    print(f"{result.verdict}: see {arguments.output / 'report.html'}")
    return 0
