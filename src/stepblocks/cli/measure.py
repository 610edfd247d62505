"""``stepblocks measure``: a session of traces to a table of features."""

from __future__ import annotations

import argparse
from pathlib import Path

from stepblocks.cli.arguments import progress


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "measure",
        help="features of every trace of a bench session",
        description="Read a bench session and write one row of features per trial, with standard uncertainties. "
        "Trials that cannot be measured stay in the table with status `excluded` and the reason.",
    )
    parser.add_argument("session", type=Path, help="folder with session.toml")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="table of features (CSV)")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes (default: one per core)")
    parser.add_argument("--quiet", action="store_true", help="say nothing but errors")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="also draw trials with what was fitted")
    parser.add_argument(
        "--trials", metavar="LIST", help="trials to draw, separated by commas (default: the first twelve)"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.bench.measure import write_features

    told = None if arguments.quiet else progress("measured", "trial", lines=10)
    summary = write_features(arguments.session, arguments.output, jobs=arguments.jobs, progress=told)
    if arguments.plots is not None:
        from stepblocks.bench.figures import draw_trials

        chosen = [name.strip() for name in arguments.trials.split(",")] if arguments.trials else None
        draw_trials(arguments.session, arguments.plots, chosen)
    if not arguments.quiet:
        print(f"{summary.total - summary.excluded} of {summary.total} trials measured -> {arguments.output}")
        for reason, count in sorted(summary.reasons.items(), key=lambda item: -item[1]):
            print(f"  excluded {count}: {reason}")
        for note in summary.notes:
            print(f"  note: {note}")
    return 0
