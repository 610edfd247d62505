"""``stepblocks build``, ``check`` and ``workshop``: make stimuli, measure them, have them made."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepblocks.cli.cluster import open_shown_cluster
from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Files,
    Jobs,
    Laws,
    On,
    Only,
    Quiet,
    Stimuli,
    make_quantity_option,
)
from stepblocks.cli.outcome import Outcome, format_count, make_progress, name_first_of_several
from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from stepblocks.parts.verdict import Verdict
    from stepblocks.workshop.run import PartOrder

app = typer.Typer()

_STEP_ENDINGS = {".step", ".stp", ".p21"}


@register_command(
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
    on: On = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="JSON",
            help="model.json of stepblocks loop: predict with the constants of a session",
        ),
    ] = None,
    laws: Laws = None,
    quiet: Quiet = False,
) -> Outcome:
    """Build, write, read back, measure and predict the stimuli of one or more files.

    Builds every stimulus that is not up to date. Exit code 1 if an artefact is out of tolerance.
    """
    from stepblocks.build.run import build_sets

    progress = make_progress("built", quiet=quiet, lines=1000)
    with open_shown_cluster(on, jobs, quiet=quiet) as cluster:
        report = build_sets(
            files or [],
            output,
            only=only,
            jobs=jobs,
            announce=lambda made, done, total: progress(
                done, total, f"{made.name} {made.seconds:.1f} s"
            ),
            model=model,
            on=cluster,
        )
    if report.built:
        summary = f"{report.output}: {len(report.built)} built, {report.current} up to date"
    else:
        summary = f"{report.output}: {report.current} stimuli, all up to date; nothing to do"
    notes = list(report.notes)
    if report.failures:
        notes.append(f"{len(report.failures)} checks failed")
    if report.built:
        # loaded here, since a build that finds everything up to date needs no numpy
        from stepblocks.artefacts.meshes.write import MESH_FORMATS

        if ".3mf" not in MESH_FORMATS:
            notes.append("no 3MF files: lib3mf is missing, which has no wheel for this processor")
    return Outcome(
        summary,
        notes=notes,
        page=Path(report.output) / "index.html",
        record=vars(report),
        code=int(bool(report.failures)),
        failures=report.failures,
    )


@register_command(app, "check", "check", "check part.step", panel="Stimuli")
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
    stimulus: Annotated[
        str | None,
        typer.Option(
            "--stimulus",
            metavar="ID",
            help="check the files that are named against this declared part, such as step-050",
        ),
    ] = None,
    stimuli: Stimuli = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="print every measurement, not only the verdicts")
    ] = False,
) -> Outcome:
    """Read every artefact back from disk and measure it, or check any STEP file.

    Prints a verdict per artefact; for STEP files named on the command line, dimensions and
    tolerances against their geometry, read as text. Exit codes: 1 if one is out of tolerance, 3 if
    a STEP file states too little to prove anything.
    """
    from stepblocks.build.check import check_files, check_output

    files = files or []
    if stimulus is not None:
        if not files:
            raise PipelineError("--stimulus needs the files to check against it, got none")
        return _report_verdicts(check_files(files, stimulus, stimuli or "stimuli"), verbose=verbose)
    if stimuli is not None:
        raise PipelineError("--stimuli is for --stimulus, which is not given")
    endings = {path.suffix.lower() for path in files}
    if endings and endings <= _STEP_ENDINGS:
        return _check_step_files(files)
    return _report_verdicts(check_output(files, built, only=only), verbose=verbose)


def _report_verdicts(checked: "Iterable[tuple[str, list[Verdict]]]", *, verbose: bool) -> Outcome:
    """Report what was found of each artefact."""
    count = 0
    failed: list[str] = []
    records: list[dict[str, object]] = []
    notes: list[str] = []
    for name, verdicts in checked:
        count += 1
        passed = 0
        details = []
        for verdict in verdicts:
            passed += verdict.passed
            records.append(verdict.as_record() | {"path": name})
            if verbose or not verdict.passed:
                details.append(f"       {verdict}")
        word = "ok  "
        if passed < len(verdicts):
            word = "FAIL"
            failed.append(name)
        within = f"{passed} of {len(verdicts)}"
        notes.append(f"{word} {name}: {within} measurements within tolerance")
        notes += details
    summary = f"{count} artefacts, all within tolerance"
    if failed:
        summary = f"{len(failed)} of {count} artefacts out of tolerance: {', '.join(failed)}"
    return Outcome(
        summary,
        notes=notes,
        record={"artefacts": count, "failed": failed, "measurements": records},
        code=int(bool(failed)),
    )


def _check_step_files(paths: list[Path]) -> Outcome:
    """Check STEP files by themselves; what states too little is not proven."""
    from stepblocks.artefacts.step.check_step import check_step, format_step_requirements

    reports = [check_step(path) for path in paths]
    passed = [report.passes and not report.unproven for report in reports]
    code = 0
    if not all(report.passes for report in reports):
        code = 1
    elif not all(passed):
        code = 3
    return Outcome(
        f"{sum(passed)} of {len(paths)} STEP files hold what they say",
        notes=["\n\n".join(map(format_step_requirements, reports))],
        record={"files": dict(zip(map(str, paths), passed, strict=True))},
        code=code,
    )


@register_command(
    app,
    "workshop",
    "workshop mine.toml",
    "workshop --only 'paper-ten/*' --capability '1 um'",
    panel="Stimuli",
)
def workshop(
    *,
    files: Files = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out"),
    only: Only = None,
    capability: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--capability",
            help="deviation of a height that your workshop holds in one piece; ask the workshop",
            show_default="2 um, ground",
        ),
    ] = None,
    masks: Annotated[
        bool,
        typer.Option(
            "--masks",
            help="write the masks of etched steps, too: GDSII of the blocks of silicon of each set "
            "(extra masks)",
        ),
    ] = False,
    quiet: Quiet = False,
) -> Outcome:
    """Write drawings, inspection sheets and gauge-block variants; compare the routes of making.

    Drawings (DXF, SVG, PDF) and inspection sheets (CSV, PDF) of every part, the two-piece variant
    of step blocks, setup sheets with the stock, and a table of the ways to make them with what each
    lets a user feel.
    """
    from stepblocks.build.run import refresh_links
    from stepblocks.workshop.run import order_parts, tabulate_routes

    progress = make_progress("drawn", quiet=quiet, lines=1000)
    orders = order_parts(
        files or [],
        output,
        only=only,
        capability=capability,
        masks=masks,
        announce=lambda one: progress(name=f"{one.name}: {len(one.files)} files"),
    )
    refresh_links(files or None, output)
    files_written = 0
    count = 0
    record = {}
    for order in orders:
        files_written += len(order.files)
        count += not order.is_of_set
        record[order.name] = list(map(str, order.files))
    return Outcome(
        f"{files_written} files for {format_count(count, 'part')} in {output}",
        notes=_list_order_notes(orders),
        tables={"Routes": tabulate_routes(orders)},
        record=record,
    )


def _list_order_notes(orders: "Sequence[PartOrder]") -> list[str]:
    """List the notes of orders, each once: with its first part, and how many more it is of."""
    names: dict[str, list[str]] = {}
    for order in orders:
        if order.note:
            names.setdefault(order.note, []).append(order.name)
    notes = []
    for note, parts in names.items():
        notes.append(f"{name_first_of_several(parts)}: {note}")
    return notes
