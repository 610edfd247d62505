"""``stepblocks simulate-session``, ``measure`` and ``loop``: a bench session, and what it shows."""

import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.cluster import open_shown_cluster
from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    AsBuilt,
    Jobs,
    Laws,
    On,
    Quiet,
    WholeRange,
    keep_given_options,
    read_whole_range,
    split_at_commas,
)
from stepblocks.cli.outcome import Outcome, make_progress
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.text import Document

app = typer.Typer()


@register_command(
    app,
    "simulate-session",
    "simulate-session plan.toml -o rehearsal",
    "simulate-session plan.toml -o rehearsals --seeds 1:101 --jobs 2",
    panel="Bench",
)
def simulate_session(
    *,
    plan: Annotated[
        Path,
        typer.Argument(metavar="SPEC.toml", help="design, model, scatter, rig and effects"),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="session to make")
    ] = Path("out/session"),
    seeds: Annotated[
        WholeRange | None,
        typer.Option(
            "--seeds",
            metavar="FIRST:END",
            parser=read_whole_range,
            help="simulate one session for each seed from FIRST up to but not including END, into "
            "folders of DIR; finished ones are kept",
            show_default="one session, with the seed of the plan",
        ),
    ] = None,
    jobs: Jobs = None,
    on: On = None,
    laws: Laws = None,
    quiet: Quiet = False,
) -> Outcome:
    """Simulate a bench session from the equations, with any effect planted.

    Writes a session with traces, scans and the truth behind them, so that a laboratory can ask
    before it measures whether a design would find an effect.
    """
    if seeds is not None:
        return _simulate_sessions(plan, output, seeds, jobs, on, quiet=quiet)
    if jobs is not None or on is not None:
        raise PipelineError(
            "--jobs and --on divide several sessions: give their seeds with --seeds"
        )
    from stepblocks.rehearse.run import simulate_session

    summary = simulate_session(plan, output)
    locked = ""
    if summary.locked:
        locked = f", {summary.locked} locked"
    return Outcome(
        f"{summary.planned - summary.locked} trials of {summary.planned}{locked} -> {output}",
        record={
            "planned": summary.planned,
            "locked": summary.locked,
            "session": str(output),
        },
    )


def _simulate_sessions(
    plan: Path, output: Path, seeds: WholeRange, jobs: int | None, on: str | None, *, quiet: bool
) -> Outcome:
    """Simulate a session for each of several seeds."""
    from stepblocks.rehearse.many import simulate_sessions

    numbers = range(seeds.first, seeds.end)
    progress = make_progress("sessions", quiet=quiet)
    with open_shown_cluster(on, jobs, quiet=quiet) as cluster:
        done = simulate_sessions(
            plan,
            output,
            numbers,
            jobs=jobs,
            on=cluster,
            on_session=lambda _: progress(total=len(numbers)),
        )
    return Outcome(
        f"{len(numbers)} sessions: {done.simulated} simulated, {done.found} found [{output}]",
        record={"simulated": done.simulated, "found": done.found, "sessions": str(output)},
        kept=[folder / "session.toml" for folder in done.folders],
    )


@register_command(
    app,
    "measure",
    "measure session",
    "measure session -o features.csv --plots plots --trials 1,2",
    panel="Bench",
)
def measure(
    *,
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="folder with session.toml")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="CSV", help="table of features")
    ] = Path("out/features.csv"),
    jobs: Jobs = None,
    plots: Annotated[
        Path | None,
        typer.Option("--plots", metavar="DIR", help="also draw trials with what was fitted"),
    ] = None,
    trials: Annotated[
        str | None,
        typer.Option(
            "--trials",
            metavar="LIST",
            help="trials to draw, separated by commas",
            show_default="the first twelve",
        ),
    ] = None,
    whole_record: Annotated[
        Path | None,
        typer.Option(
            "--whole-record",
            metavar="CSV",
            help="also fit ramp, release and ring of each trace in one likelihood, and write that "
            "beside the features",
        ),
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(
            "--check",
            metavar="JSON",
            help="only hold some trials against session.toml, and write what they show of spring, "
            "load and sample rate",
        ),
    ] = None,
    layout: TableLayout = UNDECLARED,
    quiet: Quiet = False,
) -> Outcome:
    """Measure the features of every trace of a bench session.

    Reads a bench session and writes one row of features per trial, with standard uncertainties.
    Trials that cannot be measured stay in the table with status `excluded` and the reason.
    """
    from stepblocks.bench.measure import check_output, measure_session_to_file

    if check is not None:
        if plots is not None or whole_record is not None:
            raise PipelineError("--check measures no more than some trials: leave the others out")
        return _report_session_check(session, check, layout, quiet=quiet)
    if trials is not None and plots is None:
        raise PipelineError("--trials says which trials --plots draws: give --plots, too")
    if whole_record is not None:
        check_output(session, whole_record)
    summary = measure_session_to_file(
        session,
        output,
        progress=make_progress("measured trials", quiet=quiet, lines=10),
        jobs=jobs,
        layout=layout,
    )
    if plots is not None:
        from stepblocks.bench.figures import draw_trials

        chosen = None
        if trials:
            chosen = split_at_commas(trials)
        draw_trials(session, plots, chosen, layout=layout)
    reasons = dict(sorted(summary.reasons.items(), key=lambda item: -item[1]))
    notes = [f"excluded {count}: {reason}" for reason, count in reasons.items()]
    notes += [f"note: {note}" for note in summary.notes]
    measured = summary.total - summary.excluded
    record: Document = {
        "trials": summary.total,
        "excluded": reasons,
        "notes": list(summary.notes),
    }
    if whole_record is not None:
        from stepblocks.bench.whole_records import write_whole_record_comparison

        compared = write_whole_record_comparison(session, whole_record, jobs, layout)
        counts = [f"{shape} {count}" for shape, count in compared.shapes.items()]
        shapes = ", ".join(counts) or "none"
        notes.append(
            f"whole records: {compared.fitted} of {compared.total} fitted, {compared.differing} "
            f"differ from a feature; releases by shape: {shapes} -> {whole_record}"
        )
        record["whole_record"] = asdict(compared)
    return Outcome(
        f"{measured} of {summary.total} trials measured -> {output}", notes=notes, record=record
    )


def _report_session_check(
    session: Path, output: Path, layout: TableLayout, *, quiet: bool
) -> Outcome:
    """Hold some trials of a session against what it declares."""
    from stepblocks.loop.record import convert_to_json_values
    from stepblocks.loop.session_check import check_session

    progress = make_progress("trials held against session.toml", quiet=quiet)
    found = check_session(session, output, layout=layout, progress=progress)
    contradictions = found.contradictions
    summary = f"{found.measured} of {found.looked_at} trials agree with session.toml"
    code = 0
    if contradictions:
        summary = "session.toml is contradicted by its trials"
        code = 1
    elif found.spring is None:
        summary = f"too few of {found.looked_at} trials could be measured to tell: {found.reason}"
        code = 3
    return Outcome(
        f"{summary} -> {output}",
        {"shown over declared, 95 %": found.rows},
        notes=contradictions,
        code=code,
        record=convert_to_json_values(found),
    )


@register_command(
    app,
    "loop",
    "loop session",
    "loop session -o out/loop --as-built out/inspect",
    panel="Bench",
)
def loop(
    *,
    session: Annotated[
        list[Path],
        typer.Argument(
            metavar="SESSION",
            help="folder with session.toml, trials.csv and traces; several are fitted together, "
            "in one likelihood",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out/loop"),
    jobs: Jobs = None,
    forces_only: Annotated[
        bool, typer.Option("--forces-only", help="leave the scans of the blocks out")
    ] = False,
    as_built: AsBuilt = None,
    whole_record: Annotated[
        bool,
        typer.Option(
            "--whole-record",
            help="also fit ramp, release and ring of each trace in one likelihood, and use these "
            "values where they are predicted better on trials held out",
        ),
    ] = False,
    laws: Laws = None,
    layout: TableLayout = UNDECLARED,
    quiet: Quiet = False,
) -> Outcome:
    """Find what the model lacks for a measured session.

    Measures a session, traces the residual to an effect, adds it, and reports the error before and
    after: features.csv, result.json, model.json and report.html in the output folder.
    """
    from stepblocks.loop.run import loop_session
    from stepblocks.loop.several import loop_sessions
    from stepblocks.quantities import format_units

    show = make_progress("loop:", quiet=quiet)
    options = keep_given_options(
        jobs=jobs,
        forces_only=forces_only,
        as_built=as_built or [],
        whole_record=whole_record,
        layout=layout,
        progress=partial(show, name="trials measured"),
        announce=show,
    )
    if len(session) > 1:
        return _summarise_sessions(loop_sessions(session, output, **options), output)
    result = loop_session(session[0], output, **options)
    for scan in result.document["scans"]["left_out"]:
        print(format_units(f"scan of {scan['block']} left out: {scan['reason']}"), file=sys.stderr)
    notes = list(result.record.headline)
    excluded = len(result.document["excluded"])
    if excluded:
        notes.append(f"values or trials excluded, each with its reason in the report: {excluded}")
    return Outcome(
        f"{result.document['finding']} ({result.verdict})",
        notes=notes,
        page=output / "report.html",
        record=result.document,
    )


def _summarise_sessions(document: Document, output: Path) -> Outcome:
    """Tabulate the parameters that several sessions share; say the verdict of all and of each."""
    rows = []
    for name, parameter in document["parameters"].items():
        if len(parameter["sessions"]) < 2 or name.startswith("height_error"):
            continue
        row = {
            "parameter": name,
            "unit": parameter["unit"],
            "mean": parameter["mean"],
            "among sessions": parameter["among_sessions_std"],
        }
        rows.append(row | parameter["next"])
    verdicts = []
    for name, session in document["sessions"].items():
        verdicts.append(f"{name}: {session['verdict']}")
    together = "{finding} ({verdict})".format(**document["together"])
    return Outcome(
        f"{together}; by themselves {'; '.join(verdicts)}",
        {"in the next session, 95 %": rows},
        page=output / "report.html",
        record=document,
    )
