"""``stepblocks sweep``: a table of predictions as large as one likes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "sweep",
        help="predict a grid or random design of steps, tips and settings into partitioned Parquet",
        description="Compute SWEEP.toml into DIR, one Parquet file per partition; finished ones are kept.",
    )
    parser.add_argument("sweep", type=Path, metavar="SWEEP.toml")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="local worker processes (default 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask scheduler, such as tcp://host:8786")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    from stepblocks.errors import PipelineError
    from stepblocks.predict.sweep.plan import load_sweep
    from stepblocks.predict.sweep.run import sweep

    if not 1 <= arguments.jobs <= 1024:
        raise PipelineError(f"--jobs must lie between 1 and 1024, got {arguments.jobs}")
    plan = load_sweep(arguments.sweep)
    report = None
    if not arguments.quiet:
        from tqdm import tqdm

        bar = tqdm(total=plan.partitions, unit="partition", disable=not sys.stderr.isatty())
        report = lambda _: bar.update(1)  # noqa: E731
    computed, found = sweep(
        plan, arguments.output, jobs=arguments.jobs, scheduler=arguments.scheduler, on_partition=report
    )
    if not arguments.quiet:
        print(
            f"{plan.rows} rows in {plan.partitions} partitions: {computed} computed, {found} found [{arguments.output}]"
        )
    return 0
