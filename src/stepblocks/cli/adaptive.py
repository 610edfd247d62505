"""``stepblocks study adaptive``: the next block follows from the answers so far."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from stepblocks.cli.study_options import add_command, add_observer, count, given, observed, whole


def add_to(jobs: Any) -> None:
    """Register the commands."""
    parser = jobs.add_parser("adaptive", help="QUEST+ or a staircase, trial by trial, resumable and blinded")
    steps = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    start = add_command(steps, "start", _start, "setup.json and the key of the blinding codes")
    start.add_argument("file", type=Path, metavar="FILE", help="stimulus file with the blocks")
    start.add_argument("--standard", required=True, metavar="ID", help="block that the others are compared with")
    start.add_argument("--method", choices=("quest", "staircase"), help="default: quest")
    start.add_argument("--participants", type=count, metavar="N", help="default: 10")
    start.add_argument("--trials", type=count, metavar="N", help="most per participant (default: 60)")
    start.add_argument("--reversals", type=count, metavar="N", help="a staircase ends after so many (default: 12)")
    start.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of codes and orders")
    start.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the study")

    for name, said, run in (
        ("next", "say which pair comes next", _next),
        ("answer", "take the answer to a trial and say which pair comes next", _answer),
        ("run", "ask trial after trial at the keyboard; q stops, the same command goes on", _run),
        ("simulate", "let simulated participants answer", _simulate),
        ("result", "thresholds and Weber fractions; writes what study analyse reads", _result),
    ):
        step = add_command(steps, name, run, said)
        step.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
        if name in ("next", "answer", "run"):
            step.add_argument("--participant", type=count, required=True, metavar="N", help="number of the participant")
        if name == "answer":
            step.add_argument("--trial", type=count, required=True, metavar="N", help="number of the trial")
            step.add_argument("answer", choices=("y", "n"), help="y if the second of the pair is higher")
        if name == "simulate":
            step.add_argument("file", type=Path, metavar="FILE", help="stimulus file, for the predicted energies")
            add_observer(step)
            step.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")


def _start(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive import start_adaptive

    asked = given(arguments, "standard", "method", "participants", "trials", "reversals", "seed")
    study = start_adaptive(arguments.file, arguments.output, **asked)
    print(
        f"{arguments.output / 'setup.json'}: {study.plan.method} with {len(study.plan.compared)} blocks against the standard, "
        f"{study.participants} participants, at most {study.plan.trials} trials each"
    )
    return 0


def _next(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive import open_adaptive

    print(open_adaptive(arguments.folder).session(arguments.participant))
    return 0


def _answer(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive import answer

    print(answer(arguments.folder, arguments.participant, arguments.trial, arguments.answer == "y"))
    return 0


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive import answer, next_pair

    while (pair := next_pair(arguments.folder, arguments.participant)) is not None:
        asked = f"trial {pair.trial}: first {pair.first}, then {pair.second}. Second higher? y, n or q: "
        print(asked, end="", flush=True)
        line = sys.stdin.readline()
        text = line.strip().lower()
        if not line or text == "q":
            print(f"stopped after {pair.trial - 1} trials; the same command goes on")
            return 0
        if text in ("y", "n"):
            answer(arguments.folder, arguments.participant, pair.trial, text == "y")
    return _next(arguments)


def _simulate(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive import simulate_adaptive

    number = simulate_adaptive(arguments.folder, arguments.file, **observed(arguments), **given(arguments, "seed"))
    print(f"{arguments.folder / 'answers'}: {number} simulated answers")
    return 0


def _result(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive import results
    from stepblocks.study.page import render_table

    sys.stdout.write(render_table(results(arguments.folder), "%.4g"))
    print(f"then: stepblocks study analyse {arguments.folder} {arguments.folder / 'answers.csv'} -o REPORT")
    return 0
