"""``stepblocks check``: read what was written back from disk and say whether it is right."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_only, add_output


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "check",
        help="read every artefact back from disk and measure it, or check anybody's STEP file",
        description="A verdict per artefact; of STEP files named on the command line, dimensions and tolerances against "
        "their geometry, read as text. Exit code 1 if one is out of tolerance, and its name.",
    )
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="FILE", help="stimulus files, folders (default: stimuli) or STEP files"
    )
    add_output(parser, "out")
    add_only(parser)
    parser.add_argument("--verbose", action="store_true", help="print every measurement, not only the verdicts")
    parser.add_argument("--quiet", action="store_true", help="print failures only")
    parser.add_argument("--json", action="store_true", help="print every measurement as JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.files and all(path.suffix.lower() in (".step", ".stp", ".p21") for path in arguments.files):
        return _check_step_files(arguments.files)
    from stepblocks.build.run import check_output

    failed = []
    records = []
    count = 0
    for name, verdicts in check_output(arguments.files, arguments.output, only=arguments.only):
        count += 1
        bad = [verdict for verdict in verdicts if not verdict.passed]
        if bad:
            failed.append(name)
        if arguments.json:
            records += [verdict.as_record() | {"path": name} for verdict in verdicts]
        elif bad or not arguments.quiet:
            print(
                f"{'FAIL' if bad else 'ok  '} {name}: {len(verdicts) - len(bad)} of {len(verdicts)} measurements within tolerance"
            )
            for verdict in verdicts if arguments.verbose else bad:
                print(f"       {verdict}")
    if arguments.json:
        print(json.dumps({"artefacts": count, "failed": failed, "measurements": records}, indent=1, allow_nan=False))
    elif failed:
        print(f"{len(failed)} of {count} artefacts out of tolerance: {', '.join(failed)}")
    elif not arguments.quiet:
        print(f"{count} artefacts, all within tolerance")
    return 1 if failed else 0


def _check_step_files(paths: list[Path]) -> int:
    from stepblocks.artefacts.step.check_step import check_step, step_table

    reports = [check_step(path) for path in paths]
    print("\n\n".join(step_table(report) for report in reports))
    return 0 if all(report.passes for report in reports) else 1
