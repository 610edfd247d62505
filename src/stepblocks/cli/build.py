"""``stepblocks build`` and ``check``: make what the stimulus files ask for, and read it back from disk."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.cli.arguments import add_command, add_files, add_only, add_output

if TYPE_CHECKING:
    from stepblocks.build.make import Made


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "build, write, read back, measure and predict the stimuli of one or more files"
    description = "Build every stimulus that is not up to date. Exit code 1 if an artefact is out of tolerance."
    build = add_command(commands, "build", _build, said, description)
    add_files(build)
    add_output(build, "out")
    add_only(build)
    build.add_argument("--jobs", type=_jobs, metavar="N", help="number of processes (default: all cores)")
    said = "model.json of stepblocks loop: predict with what a session taught"
    build.add_argument("--model", type=Path, metavar="JSON", help=said)
    build.add_argument("--quiet", action="store_true", help="say nothing but failures")
    build.add_argument("--json", action="store_true", help="print the report as JSON")

    said = "read every artefact back from disk and measure it, or check anybody's STEP file"
    description = (
        "A verdict per artefact; of STEP files named on the command line, dimensions and tolerances against "
        "their geometry, read as text. Exit code 1 if one is out of tolerance, and its name."
    )
    check = add_command(commands, "check", _check, said, description)
    said = "stimulus files, folders (default: stimuli) or STEP files"
    check.add_argument("files", nargs="*", type=Path, metavar="FILE", help=said)
    add_output(check, "out")
    add_only(check)
    check.add_argument("--verbose", action="store_true", help="print every measurement, not only the verdicts")
    check.add_argument("--quiet", action="store_true", help="print failures only")
    check.add_argument("--json", action="store_true", help="print every measurement as JSON")


def _jobs(text: str) -> int:
    number = int(text) if text.isdecimal() else 0
    if not 1 <= number <= 1024:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 to 1024, got {text!r}")
    return number


def _build(arguments: argparse.Namespace) -> int:
    from stepblocks.build.run import build_sets

    progress = _Progress()
    try:
        report = build_sets(
            arguments.files,
            arguments.output,
            only=arguments.only,
            jobs=arguments.jobs,
            announce=None if arguments.quiet or arguments.json else progress.announce,
            model=arguments.model,
        )
    finally:
        if progress.bar is not None:
            progress.bar.close()
    if arguments.json:
        print(json.dumps(vars(report), indent=1))
        return 1 if report.failures else 0
    if not arguments.quiet:
        if report.built:
            print(f"{report.output}: {len(report.built)} stimuli built, {report.current} up to date")
        else:
            print(f"{report.output}: {report.current} stimuli, all up to date; nothing to do")
        if report.failures:
            print(f"{len(report.failures)} checks failed")
        print(f"open {Path(report.output) / 'index.html'}")
    for failure in report.failures:
        print(failure, file=sys.stderr)
    return 1 if report.failures else 0


class _Progress:
    """A bar on a terminal, plain lines elsewhere."""

    bar: Any = None

    def announce(self, made: Made, number: int, total: int) -> None:
        if not sys.stderr.isatty():
            print(f"[{number}/{total}] {made.name} {made.seconds:.1f} s", file=sys.stderr, flush=True)
            return
        if self.bar is None:
            from tqdm import tqdm

            self.bar = tqdm(total=total, unit="stimulus")
        self.bar.set_description(made.name)
        self.bar.update()


def _check(arguments: argparse.Namespace) -> int:
    if arguments.files and all(path.suffix.lower() in (".step", ".stp", ".p21") for path in arguments.files):
        return _check_step_files(arguments.files)
    from stepblocks.build.run import check_output

    failed, records, count = [], [], 0
    for name, verdicts in check_output(arguments.files, arguments.output, only=arguments.only):
        count += 1
        bad = [verdict for verdict in verdicts if not verdict.passed]
        if bad:
            failed.append(name)
        if arguments.json:
            records += [verdict.as_record() | {"path": name} for verdict in verdicts]
        elif bad or not arguments.quiet:
            within = f"{len(verdicts) - len(bad)} of {len(verdicts)} measurements within tolerance"
            print(f"{'FAIL' if bad else 'ok  '} {name}: {within}")
            for verdict in verdicts if arguments.verbose else bad:
                print(f"       {verdict}")
    if arguments.json:
        print(json.dumps({"artefacts": count, "failed": failed, "measurements": records}, indent=1, allow_nan=False))
    elif failed:
        print(f"{len(failed)} of {count} artefacts out of tolerance: {', '.join(failed)}")
    elif not arguments.quiet:
        print(f"{count} artefacts, all within tolerance")
    return 1 if failed else 0


def _check_step_files(paths: list[Path]) -> int:
    from stepblocks.artefacts.step.check_step import check_step, step_table

    reports = [check_step(path) for path in paths]
    print("\n\n".join(step_table(report) for report in reports))
    return 0 if all(report.passes for report in reports) else 1
