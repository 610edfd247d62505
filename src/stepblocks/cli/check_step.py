"""``stepblocks check-step``: say what stands in a STEP file, and whether it is true."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

__all__ = ["add_to"]


def add_to(commands: Any) -> None:
    """Register the command.

    Parameters
    ----------
    commands : argparse subparsers
        Where to register.
    """
    parser = commands.add_parser(
        "check-step",
        help="list dimensions and tolerances of any STEP file and hold them against its geometry",
        description="Read a STEP file as text, without the kernel that wrote it. Exit code 1 if something is wrong.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="STEP file, anybody's")
    parser.add_argument("--stimulus", metavar="ID", help="also require every characteristic of this stimulus")
    parser.add_argument(
        "--set",
        dest="where",
        type=Path,
        default=Path("stimuli"),
        metavar="PATH",
        help="stimulus file or folder (stimuli)",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from dataclasses import replace

    from stepblocks.metrology.part21.check_step import check_step_text
    from stepblocks.pipeline.check_step import check_part_step, step_table
    from stepblocks.pipeline.inspect import find_stimulus

    if arguments.stimulus is None:
        report = check_step_text(arguments.file)
    else:
        stimulus, _ = find_stimulus(arguments.stimulus, arguments.where)
        report, findings = check_part_step(arguments.file, stimulus)
        report = replace(report, findings=tuple(findings))
    print(step_table(report))
    return 0 if report.passes else 1
