"""``stepblocks measure``, ``loop`` and ``simulate-session``: what takes or makes a session of the bench."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, add_output, progress


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "features of every trace of a bench session"
    description = (
        "Read a bench session and write one row of features per trial, with standard uncertainties. "
        "Trials that cannot be measured stay in the table with status `excluded` and the reason."
    )
    measure = add_command(commands, "measure", _measure, said, description)
    measure.add_argument("session", type=Path, help="folder with session.toml")
    add_output(measure, metavar="FILE", said="table of features (CSV)")
    measure.add_argument("--jobs", type=int, metavar="N", help="processes (default: one per core)")
    measure.add_argument("--quiet", action="store_true", help="say nothing but errors")
    measure.add_argument("--plots", type=Path, metavar="DIR", help="also draw trials with what was fitted")
    said = "trials to draw, separated by commas (default: the first twelve)"
    measure.add_argument("--trials", metavar="LIST", help=said)

    said = "find what the model lacks for a measured session"
    description = (
        "Measure a session, trace the residual to an effect, add it, and report the error before and "
        "after: features.csv, result.json, model.json and report.html in the output folder."
    )
    loop = add_command(commands, "loop", _loop, said, description)
    loop.add_argument("session", type=Path, help="folder with session.toml, trials.csv and traces")
    add_output(loop, said="folder to write to")
    loop.add_argument("-j", "--jobs", type=int, default=None, help="processes; all cores where omitted")
    loop.add_argument("--forces-only", action="store_true", help="leave the scans of the blocks out")
    said = "as-built records of inspected blocks, or folders of them, instead of the session's scans"
    loop.add_argument("--as-built", nargs="+", type=Path, default=[], metavar="RECORD", help=said)

    said = "a bench session from the equations, with any effect planted"
    description = (
        "Write a session with traces, scans and the truth behind them, so that a laboratory can ask "
        "before it measures whether a design would find an effect."
    )
    rehearse = add_command(commands, "simulate-session", _simulate_session, said, description)
    rehearse.add_argument("plan", type=Path, metavar="SPEC.toml", help="design, model, scatter, rig and effects")
    add_output(rehearse, said="session to make")


def _measure(arguments: argparse.Namespace) -> int:
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


def _loop(arguments: argparse.Namespace) -> int:
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


def _simulate_session(arguments: argparse.Namespace) -> int:
    from stepblocks.bench.rehearse.run import simulate_session

    summary = simulate_session(arguments.plan, arguments.output)
    left = f", {summary.locked} locked" if summary.locked else ""
    print(f"{summary.planned - summary.locked} trials of {summary.planned}{left} -> {arguments.output}")
    return 0
