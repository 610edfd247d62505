"""``stepblocks build``: make what the stimulus files ask for."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import Files, Jobs, Only, Quiet
from stepblocks.cli.outcome import Outcome, make_progress

app = typer.Typer()


@command(
    app,
    "build",
    "build",
    "build mine.toml -o out",
    "build stimuli --only 'paper-ten/step-0?0'",
    panel="Stimuli",
)
def build(
    *,
    files: Files = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out"),
    only: Only = None,
    jobs: Jobs = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="JSON",
            help="model.json of stepblocks loop: predict with the constants of a session",
        ),
    ] = None,
    quiet: Quiet = False,
) -> Outcome:
    """Build, write, read back, measure and predict the stimuli of one or more files.

    Builds every stimulus that is not up to date. Exit code 1 if an artefact is out of tolerance.
    """
    from stepblocks.build.run import build_sets

    progress = make_progress("built", quiet=quiet, lines=1000)
    report = build_sets(
        files or [],
        output,
        only=only,
        jobs=jobs,
        announce=lambda made, done, total: progress(
            done, total, f"{made.name} {made.seconds:.1f} s"
        ),
        model=model,
    )
    summary = f"{report.output}: {report.current} stimuli, all up to date; nothing to do"
    if report.built:
        summary = f"{report.output}: {len(report.built)} built, {report.current} up to date"
    return Outcome(
        summary,
        notes=report.notes + ([f"{len(report.failures)} checks failed"] if report.failures else []),
        page=Path(report.output) / "index.html",
        record=vars(report),
        code=1 if report.failures else 0,
        failures=report.failures,
    )
