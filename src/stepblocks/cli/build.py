"""``stepblocks build``, ``check`` and ``workshop``: make what the stimulus files ask for, read it back, have it made."""

import argparse
from pathlib import Path

from stepblocks.cli.outcome import Outcome, telling


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
    if arguments.files and all(
        path.suffix.lower() in (".step", ".stp", ".p21") for path in arguments.files
    ):
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
    from stepblocks.artefacts.step.check_step import check_step, format_step_table

    reports = [check_step(path) for path in paths]
    passed = [report.passes for report in reports]
    return Outcome(
        f"{sum(passed)} of {len(paths)} STEP files hold what they say",
        notes=["\n\n".join(format_step_table(report) for report in reports)],
        record={"files": {str(path): good for path, good in zip(paths, passed, strict=True)}},
        code=0 if all(passed) else 1,
    )


def _workshop(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.workshop.run import order_parts, tabulate_routes

    told = telling(arguments, "drawn", lines=1000)
    chosen = {name: getattr(arguments, name) for name in ("only", "capability", "masks")}
    orders = order_parts(
        arguments.files,
        arguments.output,
        **chosen,
        announce=lambda one: told(name=f"{one.name}: {len(one.files)} files"),
    )
    missing = [f"MISSING {line}" for order in orders for line in order.missing]
    return Outcome(
        f"{sum(len(order.files) for order in orders)} files of {len(orders)} parts in "
        f"{arguments.output}",
        tables={"Routes": tabulate_routes(orders)},
        code=1 if missing else 0,
        failures=missing,
        record={order.name: [str(path) for path in order.files] for order in orders},
    )


COMMANDS = {"build": _build, "check": _check, "workshop": _workshop}
