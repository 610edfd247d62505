"""``stepblocks study``: the experiments on people, from the design to the report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_jobs, add_output, given
from stepblocks.cli.outcome import Outcome
from stepblocks.cli.study_options import add_command, add_observer, count, counts, names, observed, scale, whole

_ADAPTIVE = "study adaptive"


def add_to(commands: Any) -> None:
    """Register the commands."""
    parser = commands.add_parser(
        "study",
        help="design, run, simulate and analyse the experiments on people; how many participants",
        description="The experiments on people: a design, run sheets, answers, a report; and the power of a study before it is run.",
    )
    jobs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    said = "design.csv with every trial, and the key of the blinding codes"
    design = add_command(jobs, "design", _design, said, "blocks")
    said = "experiment 1 (default), experiment 2, constant stimuli, or magnitude estimation"
    design.add_argument("--experiment", choices=("estimates", "virtual", "constant", "magnitude"), help=said)
    design.add_argument("--participants", type=count, metavar="N", help="default: 10")
    design.add_argument("--probes", type=names, metavar="A,B,...", help="default: bare,hard,soft")
    design.add_argument("--repetitions", type=count, metavar="N", help="default: 3")
    design.add_argument("--standard", metavar="ID", help="block that all others are compared with (constant)")
    design.add_argument("--only", metavar="PATTERN", help="only these blocks")
    design.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all random choices")
    add_output(design, "out/study", said="folder of the study")

    add_command(jobs, "sheet", _sheet, "blinded run sheets, to print and as CSV to fill in", "folder")

    said = "let simulated participants fill in the run sheets"
    simulate = add_command(jobs, "simulate", _simulate, said, "folder", "energies")
    add_observer(simulate)
    simulate.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")
    add_output(simulate, metavar="CSV", said="answers to write (default: answers.csv in the folder)")

    analyse = add_command(jobs, "analyse", _analyse, "answers to results.csv and report.html", "folder")
    analyse.add_argument("answers", type=Path, nargs="+", metavar="CSV", help="filled-in run sheets")
    add_output(analyse, said="folder of the report (default: report in the folder)")
    said = "an estimate above X times the highest block is an error (default: 20)"
    analyse.add_argument("--largest-estimate", type=float, metavar="X", help=said)
    analyse.add_argument("--ratings", type=scale, metavar="LOW-HIGH", help="scale of the ratings (default: 1-7)")

    said = "share of simulated studies that find a difference between conditions"
    power = add_command(jobs, "power", _power, said, "blocks")
    power.add_argument("--participants", type=counts, metavar="N,N,...", help="default: 10")
    power.add_argument("--repetitions", type=counts, metavar="N,N,...", help="default: 3")
    add_observer(power)
    power.add_argument("--analysis", choices=("mixed", "f-test"), help="default: mixed")
    power.add_argument("--runs", type=count, metavar="N", help="simulated studies per size (default: 200)")
    power.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")
    add_jobs(power, 1)
    power.add_argument("--only", metavar="PATTERN", help="only these blocks")
    add_output(power, metavar="CSV", said="write a table with units in its header")

    _add_adaptive(jobs)


def _design(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.run import design_study

    asked = given(arguments, "experiment", "participants", "probes", "repetitions", "standard", "only", "seed")
    design = design_study(arguments.file, arguments.output, **asked)
    trials, people = len(design.trials), design.trials[-1].participant
    said = f"{arguments.output / 'design.csv'}: {trials} trials of {people} participants; {design.balance}"
    return Outcome(said, record={"trials": trials, "participants": people, "balance": design.balance})


def _sheet(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.run import write_sheets

    number = write_sheets(arguments.folder)
    said = f"{arguments.folder / 'sheets'}: {number} run sheets; print {arguments.folder / 'run-sheets.pdf'}"
    return Outcome(said, record={"sheets": number})


def _simulate(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.run import simulate_study

    output = arguments.output or arguments.folder / "answers.csv"
    asked = {**observed(arguments), **given(arguments, "damping", "seed")}
    number = simulate_study(arguments.folder, arguments.file, output, **asked)
    return Outcome(f"{output}: {number} simulated answers", record={"answers": number})


def _analyse(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.run import analyse_study

    output = arguments.output or arguments.folder / "report"
    asked = given(arguments, "largest_estimate", "ratings")
    notes = analyse_study(arguments.folder, arguments.answers, output, **asked).notes
    return Outcome("", notes=notes, look=output / "report.html", record={"notes": list(notes)})


def _power(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.run import study_power

    asked = ("damping", "participants", "repetitions", "analysis", "runs", "seed", "jobs", "only", "output")
    table = study_power(arguments.file, **observed(arguments), **given(arguments, *asked))
    return Outcome("", {"power": table.to_dict("records")})


def _add_adaptive(jobs: Any) -> None:
    parser = jobs.add_parser("adaptive", help="QUEST+ or a staircase, trial by trial, resumable and blinded")
    steps = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    said = "setup.json and the key of the blinding codes"
    start = add_command(steps, "start", _start, said, "blocks", within=_ADAPTIVE)
    start.add_argument("--standard", required=True, metavar="ID", help="block that the others are compared with")
    start.add_argument("--method", choices=("quest", "staircase"), help="default: quest")
    start.add_argument("--participants", type=count, metavar="N", help="default: 10")
    start.add_argument("--trials", type=count, metavar="N", help="most per participant (default: 60)")
    start.add_argument("--reversals", type=count, metavar="N", help="a staircase ends after so many (default: 12)")
    start.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of codes and orders")
    add_output(start, "out/study", said="folder of the study")

    for name, said, run in (
        ("next", "say which pair comes next", _next),
        ("answer", "take the answer to a trial and say which pair comes next", _answer),
        ("run", "ask trial after trial at the keyboard; q stops, the same command goes on", _run),
        ("simulate", "let simulated participants answer", _simulate_adaptive),
        ("result", "thresholds and Weber fractions; writes what study analyse reads", _result),
    ):
        takes = ("folder", "energies") if name == "simulate" else ("folder",)
        step = add_command(steps, name, run, said, *takes, within=_ADAPTIVE)
        if name in ("next", "answer", "run"):
            step.add_argument("--participant", type=count, required=True, metavar="N", help="number of the participant")
        if name == "answer":
            step.add_argument("--trial", type=count, required=True, metavar="N", help="number of the trial")
            step.add_argument("answer", choices=("y", "n"), help="y if the second of the pair is higher")
        if name == "simulate":
            add_observer(step)
            step.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")


def _start(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import start_adaptive

    asked = given(arguments, "standard", "method", "participants", "trials", "reversals", "seed")
    study = start_adaptive(arguments.file, arguments.output, **asked)
    return Outcome(
        f"{arguments.output / 'setup.json'}: {study.plan.method} with {len(study.plan.compared)} blocks against the standard, "
        f"{study.participants} participants, at most {study.plan.trials} trials each"
    )


def _next(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import open_adaptive

    return Outcome(str(open_adaptive(arguments.folder).session(arguments.participant)))


def _answer(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import answer

    return Outcome(str(answer(arguments.folder, arguments.participant, arguments.trial, arguments.answer == "y")))


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import answer, next_pair

    while (pair := next_pair(arguments.folder, arguments.participant)) is not None:
        asked = f"trial {pair.trial}: first {pair.first}, then {pair.second}. Second higher? y, n or q: "
        print(asked, end="", flush=True)
        line = sys.stdin.readline()
        text = line.strip().lower()
        if not line or text == "q":
            return Outcome(f"stopped after {pair.trial - 1} trials; the same command goes on")
        if text in ("y", "n"):
            answer(arguments.folder, arguments.participant, pair.trial, text == "y")
    return _next(arguments)


def _simulate_adaptive(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import simulate_adaptive

    number = simulate_adaptive(arguments.folder, arguments.file, **observed(arguments), **given(arguments, "seed"))
    return Outcome(f"{arguments.folder / 'answers'}: {number} simulated answers", record={"answers": number})


def _result(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import results

    then = f"then: stepblocks study analyse {arguments.folder} {arguments.folder / 'answers.csv'}"
    return Outcome(then, {"thresholds": results(arguments.folder).to_dict("records")})
