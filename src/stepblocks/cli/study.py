"""``stepblocks study``: the experiments on people, from the design to the report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import stepblocks
from stepblocks.cli import study_options as ask
from stepblocks.cli.arguments import add_jobs, add_output, given, quantity
from stepblocks.cli.outcome import Outcome
from stepblocks.errors import PipelineError

_ADAPTIVE = "study adaptive"
_EXPERIMENTS = ("estimates", "virtual", "constant", "magnitude", "2afc")


def add_to(commands: Any) -> None:
    """Register the commands."""
    parser = commands.add_parser(
        "study",
        help="design, run, simulate and analyse the experiments on people; how many participants",
        description="The experiments on people: a design, run sheets, answers, a report; and the power of a study before it is run.",
    )
    jobs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    said = "design.csv with every trial, and the key of the blinding codes"
    design = ask.add_command(jobs, "design", _design, said, "blocks")
    said = "experiment 1 (default), experiment 2, constant stimuli, or magnitude estimation; 2afc is constant"
    design.add_argument("--experiment", choices=_EXPERIMENTS, help=said)
    design.add_argument("--participants", type=ask.count, metavar="N", help="default: 10")
    design.add_argument("--probes", type=ask.names, metavar="A,B,...", help="default: bare,hard,soft")
    design.add_argument("--repetitions", type=ask.count, metavar="N", help="default: 3")
    design.add_argument("--standard", metavar="ID", help="block that all others are compared with (constant)")
    design.add_argument("--only", metavar="PATTERN", help="only these blocks")
    design.add_argument("--seed", type=ask.whole, required=True, metavar="N", help="seed of all random choices")
    add_output(design, "out/study", said="folder of the study")

    ask.add_command(jobs, "sheet", _sheet, "blinded run sheets, to print and as CSV to fill in", "folder")

    said = "lead a participant through the trials, in the browser or with a device; the same command goes on"
    run = ask.add_command(jobs, "run", _conduct, said, "folder", "faces")
    run.add_argument("--participant", required=True, metavar="N", help="whose run it is, as in the design")
    said = "what moves the probe over virtual blocks (default: mouse, with the loudspeaker)"
    run.add_argument("--device", choices=("mouse", "openhaptics", "dhd", "replay"), help=said)
    run.add_argument("--library", metavar="PATH", help="the device's library, or the HDF5 that is replayed")
    run.add_argument("--scale", type=float, metavar="S", help="magnification of all virtual blocks (default: 100)")
    run.add_argument("--ratings", type=ask.scale, metavar="LOW-HIGH", help="scale of the ratings (default: 1-7)")
    ask.add_place(run)
    said = "of the page on this machine (default: a free one)"
    run.add_argument("--port", type=ask.whole, default=0, metavar="N", help=said)
    run.add_argument("--no-open", action="store_true", default=False, help="print the address and open no browser")

    said = "let simulated participants fill in the run sheets"
    simulate = ask.add_command(jobs, "simulate", _simulate, said, "folder", "faces")
    ask.add_observer(simulate)
    simulate.add_argument("--seed", type=ask.whole, required=True, metavar="N", help="seed of all chance")
    add_output(simulate, metavar="CSV", said="answers to write (default: answers.csv in the folder)")

    analyse = ask.add_command(jobs, "analyse", _analyse, "answers to results.csv and report.html")
    analyse.add_argument("folder", type=Path, nargs="?", default=None, metavar="DIR", help="folder of the study")
    said = "filled-in run sheets, or a folder of them"
    analyse.add_argument("answers", type=Path, nargs="*", default=[], metavar="CSV", help=said)
    said = "a table of your own, a folder of them, or a BIDS or psych-DS dataset; without DIR"
    analyse.add_argument("--data", type=Path, nargs="+", metavar="PATH", help=said)
    said = "your names of columns, such as participant=subject,condition=probe,height_mm=h,estimate_um=answer"
    analyse.add_argument("--columns", type=ask.named, metavar="OURS=YOURS,...", help=said)
    said = "kind of the judgements of --data (default: estimates)"
    analyse.add_argument("--experiment", choices=_EXPERIMENTS, help=said)
    said = "conditions that differ by less than this count as equivalent"
    analyse.add_argument("--equivalent", type=quantity("length"), metavar="L", help=said)
    said = "table of participant and group, such as dentists and students, to compare"
    analyse.add_argument("--groups", type=Path, metavar="CSV", help=said)
    add_output(analyse, said="folder of the report (default: report in the folder)")
    analyse.add_argument("--ratings", type=ask.scale, metavar="LOW-HIGH", help="scale of the ratings (default: 1-7)")

    said = "share of simulated studies that find a difference between conditions"
    power = ask.add_command(jobs, "power", _power, said, "blocks")
    power.add_argument("--experiment", choices=("estimates", "constant", "2afc"), help="default: estimates")
    power.add_argument("--standard", metavar="ID", help="block that all others are compared with (constant)")
    said = "conditions compared (default: those of --damping and --noisier)"
    power.add_argument("--probes", type=ask.names, metavar="A,B,...", help=said)
    said = "what is tested (default: absolute error)"
    power.add_argument("--measure", choices=("absolute error", "bias", "spread"), help=said)
    power.add_argument("--participants", type=ask.counts, metavar="N,N,...", help="default: 10")
    power.add_argument("--repetitions", type=ask.counts, metavar="N,N,...", help="default: 3")
    ask.add_observer(power)
    power.add_argument("--analysis", choices=("mixed", "f-test"), help="default: mixed")
    power.add_argument("--runs", type=ask.count, metavar="N", help="simulated studies per size (default: 200)")
    power.add_argument("--seed", type=ask.whole, required=True, metavar="N", help="seed of all chance")
    add_jobs(power, 1)
    power.add_argument("--only", metavar="PATTERN", help="only these blocks")
    add_output(power, metavar="CSV", said="write a table with units in its header")

    said = "the study as BIDS, psych-DS, or conditions files of PsychoPy"
    share = ask.add_command(jobs, "share", _share, said, "folder")
    said = "run sheets, or a folder of them"
    share.add_argument("answers", type=Path, nargs="*", default=[], metavar="CSV", help=said)
    share.add_argument("--as", dest="form", choices=("bids", "psych-ds", "psychopy"), help="default: bids")
    add_output(share, "out/dataset", said="folder of the dataset")

    _add_adaptive(jobs)


def _design(arguments: argparse.Namespace) -> Outcome:
    design = stepblocks.design_study(
        ask.source_of(arguments), arguments.output, **ask.options(arguments, stepblocks.design_study)
    )
    trials, people = len(design.trials), int(design.trials[-1]["participant"])
    said = f"{arguments.output / 'design.csv'}: {trials} trials of {people} participants; {design.balance}"
    record = {"trials": trials, "participants": people, "balance": design.balance, "advice": design.advice}
    return Outcome(said, notes=list(filter(None, [design.advice])), record=record)


def _sheet(arguments: argparse.Namespace) -> Outcome:
    number = stepblocks.write_sheets(arguments.folder)
    said = f"{arguments.folder / 'sheets'}: {number} run sheets; print {arguments.folder / 'run-sheets.pdf'}"
    return Outcome(said, record={"sheets": number})


def _simulate(arguments: argparse.Namespace) -> Outcome:
    output = arguments.output or arguments.folder / "answers.csv"
    options = ask.options(arguments, stepblocks.simulate_study) | ask.observed(arguments)
    number = stepblocks.simulate_study(arguments.folder, arguments.file, output, **options)
    return Outcome(f"{output}: {number} simulated answers", record={"answers": number})


def _analyse(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.prose import headline

    data, folder = given(arguments, "data").get("data"), arguments.folder
    if bool(data) == bool(arguments.answers) or (data and folder):
        raise PipelineError("a folder of a study with its answers must be given, or --data with a table of your own")
    output = arguments.output or (folder or Path("out/study")) / "report"
    options = ask.options(arguments, stepblocks.analyse_study)
    result = stepblocks.analyse_study(folder, data or arguments.answers, output, **options)
    notes, said = [*result.notes, *result.remarks], headline(result)
    return Outcome(said, notes=notes, look=output / "report.html", record={"said": said, "notes": notes})


def _share(arguments: argparse.Namespace) -> Outcome:
    files = stepblocks.share_study(arguments.folder, arguments.answers, arguments.output, **given(arguments, "form"))
    return Outcome(f"{arguments.output}: {len(files)} files", record={"files": files})


def _conduct(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.conduct import RunServer

    options = ask.options(arguments, stepblocks.open_run) | ask.place_of(arguments)
    run = stepblocks.open_run(arguments.folder, arguments.participant, arguments.file, **options)
    server = RunServer(run, arguments.port)
    print(f"{run.path}: {run.answered} of {len(run.planned)} trials are answered")
    print(f"open {server.url}", flush=True)
    if not arguments.no_open:
        import webbrowser

        webbrowser.open(server.url)
    said = "all trials are answered"
    try:
        server.until_done()
    except KeyboardInterrupt:
        said = "stopped; the same command goes on"
    return Outcome(said, record={"answered": run.answered, "of": len(run.planned)})


def _power(arguments: argparse.Namespace) -> Outcome:
    options = ask.options(arguments, stepblocks.study_power) | ask.observed(arguments)
    table = stepblocks.study_power(ask.source_of(arguments), arguments.output, **options)
    return Outcome("", {"power": table.to_dict("records")})


def _add_adaptive(jobs: Any) -> None:
    parser = jobs.add_parser("adaptive", help="QUEST+ or a staircase, trial by trial, resumable and blinded")
    steps = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    said = "setup.json and the key of the blinding codes"
    start = ask.add_command(steps, "start", _start, said, "blocks", within=_ADAPTIVE)
    start.add_argument("--standard", required=True, metavar="ID", help="block that the others are compared with")
    start.add_argument("--method", choices=("quest", "staircase", "training"), help="default: quest")
    start.add_argument("--participants", type=ask.count, metavar="N", help="default: 10")
    start.add_argument("--trials", type=ask.count, metavar="N", help="most per participant (default: 60)")
    start.add_argument("--reversals", type=ask.count, metavar="N", help="a staircase ends after so many (default: 12)")
    start.add_argument("--seed", type=ask.whole, required=True, metavar="N", help="seed of codes and orders")
    add_output(start, "out/study", said="folder of the study")

    for name, said, run in (
        ("run", "ask trial after trial at the keyboard; q stops, the same command goes on", _run),
        ("undo", "take the last answer back; the same pair is asked again", _undo),
        ("result", "thresholds and Weber fractions; writes what study analyse reads", _result),
    ):
        step = ask.add_command(steps, name, run, said, "folder", within=_ADAPTIVE)
        if name != "result":
            step.add_argument(
                "--participant", type=ask.count, required=True, metavar="N", help="number of the participant"
            )


def _start(arguments: argparse.Namespace) -> Outcome:
    study = stepblocks.start_adaptive(
        ask.source_of(arguments), arguments.output, **ask.options(arguments, stepblocks.start_adaptive)
    )
    said = f"{study.plan.method} with {len(study.plan.compared)} blocks against the standard, {study.participants} participants"
    most = f"at most {study.plan.trials} trials each"
    return Outcome(f"{arguments.output / 'setup.json'}: {said}, {most}", notes=list(filter(None, [study.advice])))


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import answer, open_adaptive

    session = open_adaptive(arguments.folder).session(arguments.participant)
    while (pair := session.next_pair()) is not None:
        print(
            f"trial {pair.trial}: first {pair.first}, then {pair.second}. Second higher? y, n or q: ",
            end="",
            flush=True,
        )
        line = sys.stdin.readline()
        text = line.strip().lower()
        if not line or text == "q":
            return Outcome(f"stopped after {pair.trial - 1} trials; the same command goes on")
        if text in ("y", "n"):
            session = answer(arguments.folder, arguments.participant, pair.trial, text == "y")
            if session.plan.method == "training":
                print("right" if session.right else "wrong")
    return Outcome(str(session))


def _undo(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import undo

    return Outcome(str(undo(arguments.folder, arguments.participant)))


def _result(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import results

    then = f"then: stepblocks study analyse {arguments.folder} {arguments.folder / 'answers.csv'}"
    return Outcome(then, {"thresholds": results(arguments.folder).to_dict("records")})
