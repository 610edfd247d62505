"""``stepblocks measure``: a session of traces to a table of features."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

_PLAIN_LINES = 10  # lines of progress where there is no terminal


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

    with ExitStack() as stack:
        progress = None if arguments.quiet else _progress(stack)
        summary = write_features(arguments.session, arguments.output, jobs=arguments.jobs, progress=progress)
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


def _progress(stack: ExitStack) -> Callable[[int, int], None]:
    if sys.stderr.isatty():
        from tqdm import tqdm

        bar = stack.enter_context(tqdm(unit="trial", desc="measure", leave=False))

        def on_terminal(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        return on_terminal

    def in_lines(done: int, total: int) -> None:
        step = max(total // _PLAIN_LINES, 1)
        if done % step == 0 or done == total:
            print(f"measured {done} of {total}", file=sys.stderr, flush=True)

    return in_lines
