"""``stepblocks sweep``: many predictions at once."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import Quiet, make_whole_number_reader
from stepblocks.cli.outcome import Outcome, make_progress

app = typer.Typer()


@command(
    app,
    "sweep",
    "sweep sweep.toml",
    "sweep sweep.toml -o out/sweep --jobs 4",
    panel="What is felt",
)
def sweep(
    *,
    design: Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="the design")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out/sweep"),
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", metavar="N", parser=make_whole_number_reader(1, 1024), help="processes"
        ),
    ] = 1,
    quiet: Quiet = False,
) -> Outcome:
    """Predict a grid or random design of steps, tips and settings into partitioned Parquet.

    Computes the design into a folder, one Parquet file per partition; finished partitions are kept.
    """
    from stepblocks.predict.sweep.plan import load_sweep
    from stepblocks.predict.sweep.run import PLAN_FILE, run_sweep

    plan = load_sweep(design)
    progress = make_progress("partitions", quiet=quiet)
    done = run_sweep(
        plan, output, jobs=jobs, on_partition=lambda _: progress(total=plan.partitions)
    )
    return Outcome(
        (
            f"{plan.rows} rows in {plan.partitions} partitions: {done.computed} computed, "
            f"{done.found} found [{output}]"
        ),
        record={"rows": plan.rows, "computed": done.computed, "found": done.found},
        kept=[output / PLAN_FILE, *output.glob("part-*.parquet")],
    )
