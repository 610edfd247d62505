"""``stepblocks study``: the experiments on people, from the design to the report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from stepblocks.cli import adaptive
from stepblocks.cli.study_options import add_command, add_observer, count, counts, given, names, observed, scale, whole


def add_to(commands: Any) -> None:
    """Register the commands."""
    parser = commands.add_parser(
        "study",
        help="design, run, simulate and analyse the experiments on people; how many participants",
        description="The experiments on people: a design, run sheets, answers, a report; and the power of a study before it is run.",
    )
    jobs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    design = add_command(jobs, "design", _design, "design.csv with every trial, and the key of the blinding codes")
    design.add_argument("file", type=Path, metavar="FILE", help="stimulus file with the blocks")
    design.add_argument(
        "--experiment",
        choices=("estimates", "virtual", "constant", "magnitude"),
        help="experiment 1 (default), experiment 2, constant stimuli, or magnitude estimation",
    )
    design.add_argument("--participants", type=count, metavar="N", help="default: 10")
    design.add_argument("--probes", type=names, metavar="A,B,...", help="default: bare,hard,soft")
    design.add_argument("--repetitions", type=count, metavar="N", help="default: 3")
    design.add_argument("--standard", metavar="ID", help="block that all others are compared with (constant)")
    design.add_argument("--only", metavar="PATTERN", help="only these blocks")
    design.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all random choices")
    design.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the study")

    sheet = add_command(jobs, "sheet", _sheet, "blinded run sheets, to print and as CSV to fill in")
    sheet.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")

    simulate = add_command(jobs, "simulate", _simulate, "let simulated participants fill in the run sheets")
    simulate.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
    simulate.add_argument("file", type=Path, metavar="FILE", help="stimulus file, for the predicted energies")
    add_observer(simulate)
    simulate.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")
    simulate.add_argument("-o", "--output", type=Path, required=True, metavar="CSV", help="answers to write")

    analyse = add_command(jobs, "analyse", _analyse, "answers to results.csv and report.html")
    analyse.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
    analyse.add_argument("answers", type=Path, nargs="+", metavar="CSV", help="filled-in run sheets")
    analyse.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the report")
    said = "an estimate above X times the highest block is an error (default: 20)"
    analyse.add_argument("--largest-estimate", type=float, metavar="X", help=said)
    analyse.add_argument("--ratings", type=scale, metavar="LOW-HIGH", help="scale of the ratings (default: 1-7)")

    power = add_command(jobs, "power", _power, "share of simulated studies that find a difference between conditions")
    power.add_argument("file", type=Path, metavar="FILE", help="stimulus file with the blocks")
    power.add_argument("--participants", type=counts, metavar="N,N,...", help="default: 10")
    power.add_argument("--repetitions", type=counts, metavar="N,N,...", help="default: 3")
    add_observer(power)
    power.add_argument("--analysis", choices=("mixed", "f-test"), help="default: mixed")
    power.add_argument("--runs", type=count, metavar="N", help="simulated studies per size (default: 200)")
    power.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")
    power.add_argument("--jobs", type=count, metavar="N", help="processes (default: 1)")
    power.add_argument("--only", metavar="PATTERN", help="only these blocks")
    power.add_argument("-o", "--output", type=Path, metavar="CSV", help="write a table with units in its header")

    adaptive.add_to(jobs)


def _design(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import design_study

    asked = given(arguments, "experiment", "participants", "probes", "repetitions", "standard", "only", "seed")
    design = design_study(arguments.file, arguments.output, **asked)
    people = design.trials[-1].participant
    print(f"{arguments.output / 'design.csv'}: {len(design.trials)} trials of {people} participants; {design.balance}")
    return 0


def _sheet(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import write_sheets

    number = write_sheets(arguments.folder)
    print(f"{arguments.folder / 'sheets'}: {number} run sheets; print {arguments.folder / 'run-sheets.pdf'}")
    return 0


def _simulate(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import simulate_study

    asked = {**observed(arguments), **given(arguments, "damping", "seed")}
    number = simulate_study(arguments.folder, arguments.file, arguments.output, **asked)
    print(f"{arguments.output}: {number} simulated answers")
    return 0


def _analyse(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import analyse_study

    asked = given(arguments, "largest_estimate", "ratings")
    for note in analyse_study(arguments.folder, arguments.answers, arguments.output, **asked).notes:
        print(note)
    print(f"open {arguments.output / 'report.html'}")
    return 0


def _power(arguments: argparse.Namespace) -> int:
    from stepblocks.study.page import render_table
    from stepblocks.study.run import study_power

    asked = ("damping", "participants", "repetitions", "analysis", "runs", "seed", "jobs", "only", "output")
    table = study_power(arguments.file, **observed(arguments), **given(arguments, *asked))
    sys.stdout.write(render_table(table, "%.3f"))
    return 0
