"""``stepblocks build``: make everything that the stimulus files ask for."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.cli.arguments import add_files, add_only, add_output

if TYPE_CHECKING:
    from stepblocks.build.make import Made


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "build",
        help="build, write, read back, measure and predict the stimuli of one or more files",
        description="Build every stimulus that is not up to date. Exit code 1 if an artefact is out of tolerance.",
    )
    add_files(parser)
    add_output(parser, "out")
    add_only(parser)
    parser.add_argument("--jobs", type=_jobs, metavar="N", help="number of processes (default: all cores)")
    parser.add_argument(
        "--model", type=Path, metavar="JSON", help="model.json of stepblocks loop: predict with what a session taught"
    )
    parser.add_argument("--quiet", action="store_true", help="say nothing but failures")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.set_defaults(run=_run)


def _jobs(text: str) -> int:
    number = int(text) if text.isdecimal() else 0
    if not 1 <= number <= 1024:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 to 1024, got {text!r}")
    return number


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.build.run import build_sets

    silent = arguments.quiet or arguments.json
    progress = _Progress(silent)
    try:
        report = build_sets(
            arguments.files,
            arguments.output,
            only=arguments.only,
            jobs=arguments.jobs,
            announce=progress.announce,
            model=arguments.model,
        )
    finally:
        progress.close()
    if arguments.json:
        print(json.dumps(vars(report), indent=1))
    elif not arguments.quiet:
        _say(report)
    for failure in report.failures if not arguments.json else ():
        print(failure, file=sys.stderr)
    return 1 if report.failures else 0


def _say(report: Any) -> None:
    if not report.built:
        print(f"{report.output}: {report.current} stimuli, all up to date; nothing to do")
    else:
        print(f"{report.output}: {len(report.built)} stimuli built, {report.current} up to date")
    if report.failures:
        print(f"{len(report.failures)} checks failed")
    print(f"open {Path(report.output) / 'index.html'}")


class _Progress:
    """A bar on a terminal, plain lines elsewhere, nothing when silent."""

    def __init__(self, silent: bool) -> None:
        self._silent = silent
        self._bar: Any = None

    def announce(self, made: Made, number: int, total: int) -> None:
        if self._silent:
            return
        if not sys.stderr.isatty():
            print(f"[{number}/{total}] {made.name} {made.seconds:.1f} s", file=sys.stderr, flush=True)
            return
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(total=total, unit="stimulus")
        self._bar.set_description(made.name)
        self._bar.update()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
