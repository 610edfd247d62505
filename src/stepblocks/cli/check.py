"""``stepblocks check``: read what was built back from disk, and measure it."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import Only
from stepblocks.cli.outcome import Outcome

app = typer.Typer()


@command(app, "check", "check", "check part.step", panel="Stimuli")
def check(
    *,
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE",
            help="stimulus files or folders, or STEP files",
            show_default="stimuli",
        ),
    ] = None,
    built: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder of the build")
    ] = Path("out"),
    only: Only = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="print every measurement, not only the verdicts")
    ] = False,
) -> Outcome:
    """Read every artefact back from disk and measure it, or check any STEP file.

    Prints a verdict per artefact; for STEP files named on the command line, dimensions and
    tolerances against their geometry, read as text. Exit code 1 if one is out of tolerance.
    """
    files = files or []
    if files and all(path.suffix.lower() in (".step", ".stp", ".p21") for path in files):
        return _check_step_files(files)
    from stepblocks.build.run import check_output

    failed, records, rows = [], [], []
    for name, verdicts in check_output(files, built, only=only):
        bad = [verdict for verdict in verdicts if not verdict.passed]
        if bad:
            failed.append(name)
        records += [verdict.as_record() | {"path": name} for verdict in verdicts]
        rows.append(
            f"{'FAIL' if bad else 'ok  '} {name}: {len(verdicts) - len(bad)} of "
            f"{len(verdicts)} measurements within tolerance"
        )
        rows += [f"       {verdict}" for verdict in (verdicts if verbose else bad)]
    count = sum(not row.startswith(" ") for row in rows)
    summary = f"{count} artefacts, all within tolerance"
    if failed:
        summary = f"{len(failed)} of {count} artefacts out of tolerance: {', '.join(failed)}"
    return Outcome(
        summary,
        notes=rows,
        record={"artefacts": count, "failed": failed, "measurements": records},
        code=1 if failed else 0,
    )


def _check_step_files(paths: list[Path]) -> Outcome:
    from stepblocks.artefacts.step.check_step import check_step, format_step_table

    reports = [check_step(path) for path in paths]
    passed = [report.passes for report in reports]
    return Outcome(
        f"{sum(passed)} of {len(paths)} STEP files hold what they say",
        notes=["\n\n".join(format_step_table(report) for report in reports)],
        record={"files": {str(path): good for path, good in zip(paths, passed, strict=True)}},
        code=0 if all(passed) else 1,
    )
