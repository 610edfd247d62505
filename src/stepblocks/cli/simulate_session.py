"""``stepblocks simulate-session``: a bench session from the equations, with any effect planted."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "simulate-session",
        help="a bench session from the equations, with any effect planted",
        description="Write a session with traces, scans and the truth behind them, so that a laboratory can ask "
        "before it measures whether a design would find an effect.",
    )
    parser.add_argument("plan", type=Path, metavar="SPEC.toml", help="design, model, scatter, rig and effects")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="session to make")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.bench.rehearse.run import simulate_session

    summary = simulate_session(arguments.plan, arguments.output)
    left = f", {summary.locked} locked" if summary.locked else ""
    print(f"{summary.planned - summary.locked} trials of {summary.planned}{left} -> {arguments.output}")
    return 0
