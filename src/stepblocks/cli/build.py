"""``stepblocks build`` and ``check``: make what the stimulus files ask for, and read it back from disk."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, add_files, add_jobs, add_only, add_output
from stepblocks.cli.outcome import Outcome, telling


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "build, write, read back, measure and predict the stimuli of one or more files"
    description = "Build every stimulus that is not up to date. Exit code 1 if an artefact is out of tolerance."
    examples = ("build", "build mine.toml -o out", "build stimuli --only 'paper-ten/step-0?0'")
    build = add_command(commands, "build", _build, said, description, examples=examples)
    add_files(build)
    add_output(build, "out")
    add_only(build)
    add_jobs(build)
    said = "model.json of stepblocks loop: predict with what a session taught"
    build.add_argument("--model", type=Path, metavar="JSON", help=said)

    said = "read every artefact back from disk and measure it, or check anybody's STEP file"
    description = (
        "A verdict per artefact; of STEP files named on the command line, dimensions and tolerances against "
        "their geometry, read as text. Exit code 1 if one is out of tolerance, and its name."
    )
    check = add_command(commands, "check", _check, said, description, examples=("check", "check part.step"))
    add_files(check, ", or STEP files")
    # where to look, not where to write
    check.add_argument("-o", dest="built", type=Path, default=Path("out"), metavar="DIR", help="default: out")
    check.add_argument("--output", dest="built", type=Path, help=argparse.SUPPRESS)
    add_only(check)
    check.add_argument("--verbose", action="store_true", help="print every measurement, not only the verdicts")


def _build(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.build.run import build_sets

    told = telling(arguments, "built", lines=1000)
    report = build_sets(
        arguments.files,
        arguments.output,
        only=arguments.only,
        jobs=arguments.jobs,
        announce=lambda made, done, total: told(done, total, f"{made.name} {made.seconds:.1f} s"),
        model=arguments.model,
    )
    said = f"{report.output}: {report.current} stimuli, all up to date; nothing to do"
    if report.built:
        said = f"{report.output}: {len(report.built)} built, {report.current} up to date"
    return Outcome(
        said,
        notes=[f"{len(report.failures)} checks failed"] if report.failures else [],
        look=Path(report.output) / "index.html",
        record=vars(report),
        code=1 if report.failures else 0,
        failures=report.failures,
    )


def _check(arguments: argparse.Namespace) -> Outcome:
    if arguments.files and all(path.suffix.lower() in (".step", ".stp", ".p21") for path in arguments.files):
        return _check_step_files(arguments.files)
    from stepblocks.build.run import check_output

    failed, records, rows = [], [], []
    for name, verdicts in check_output(arguments.files, arguments.built, only=arguments.only):
        bad = [verdict for verdict in verdicts if not verdict.passed]
        if bad:
            failed.append(name)
        records += [verdict.as_record() | {"path": name} for verdict in verdicts]
        within = f"{len(verdicts) - len(bad)} of {len(verdicts)} measurements within tolerance"
        rows.append(f"{'FAIL' if bad else 'ok  '} {name}: {within}")
        rows += [f"       {verdict}" for verdict in (verdicts if arguments.verbose else bad)]
    count = sum(not row.startswith(" ") for row in rows)
    said = f"{count} artefacts, all within tolerance"
    if failed:
        said = f"{len(failed)} of {count} artefacts out of tolerance: {', '.join(failed)}"
    record = {"artefacts": count, "failed": failed, "measurements": records}
    return Outcome(said, notes=rows, record=record, code=1 if failed else 0)


def _check_step_files(paths: list[Path]) -> Outcome:
    from stepblocks.artefacts.step.check_step import check_step, step_table

    reports = [check_step(path) for path in paths]
    passed = [report.passes for report in reports]
    return Outcome(
        f"{sum(passed)} of {len(paths)} STEP files hold what they say",
        notes=["\n\n".join(step_table(report) for report in reports)],
        record={"files": {str(path): good for path, good in zip(paths, passed, strict=True)}},
        code=0 if all(passed) else 1,
    )
