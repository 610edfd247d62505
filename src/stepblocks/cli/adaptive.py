"""``stepblocks study adaptive``: the next block follows from the answers so far."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def add_to(
    jobs: Any,
    whole: Callable[[str], int],
    count: Callable[[str], int],
    add_observer: Callable[..., None],
    contact: Callable[[argparse.Namespace], Any],
    observer: Callable[[argparse.Namespace], Any],
) -> None:
    """Register the commands."""
    parser = jobs.add_parser("adaptive", help="QUEST+ or a staircase, trial by trial, resumable and blinded")
    steps = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    start = steps.add_parser("start", help="setup.json and the key of the blinding codes")
    start.add_argument("file", type=Path, metavar="FILE", help="stimulus file with the blocks")
    start.add_argument("--standard", required=True, metavar="ID", help="block that the others are compared with")
    start.add_argument("--method", choices=("quest", "staircase"), default="quest", help="default: quest")
    start.add_argument("--participants", type=count, default=10, metavar="N", help="default: 10")
    start.add_argument("--trials", type=count, default=60, metavar="N", help="most per participant (default: 60)")
    start.add_argument(
        "--reversals", type=count, default=12, metavar="N", help="a staircase ends after so many (default: 12)"
    )
    start.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of codes and orders")
    start.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the study")
    start.set_defaults(run=_start)

    def add_step(name: str, said: str, run: Callable[[argparse.Namespace], int]) -> Any:
        step = steps.add_parser(name, help=said)
        step.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
        step.set_defaults(run=run)
        return step

    for name, said, run in (
        ("next", "say which pair comes next", _next),
        ("answer", "take the answer to a trial and say which pair comes next", _answer),
        ("run", "ask trial after trial at the keyboard; q stops, the same command goes on", _run),
    ):
        step = add_step(name, said, run)
        step.add_argument("--participant", type=count, required=True, metavar="N", help="number of the participant")
        if name == "answer":
            step.add_argument("--trial", type=count, required=True, metavar="N", help="number of the trial")
            step.add_argument("answer", choices=("y", "n"), help="y if the second of the pair is higher")
    simulate = add_step("simulate", "let simulated participants answer", lambda a: _simulate(a, contact, observer))
    simulate.add_argument("file", type=Path, metavar="FILE", help="stimulus file, for the predicted energies")
    add_observer(simulate)
    simulate.add_argument("--seed", type=whole, required=True, metavar="N", help="seed of all chance")
    add_step("result", "thresholds and Weber fractions; writes what study analyse reads", _result)


def _start(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive.run import start_study

    study = start_study(
        arguments.file,
        arguments.method,
        arguments.standard,
        arguments.participants,
        arguments.trials,
        arguments.reversals,
        arguments.seed,
        arguments.output,
    )
    print(
        f"{arguments.output / 'setup.json'}: {study.plan.method} with {len(study.plan.compared)} blocks against the standard, "
        f"{study.participants} participants, at most {study.plan.trials} trials each"
    )
    return 0


def _say(session: Any) -> None:
    pair = session.next_pair()
    if pair is None:
        print(f"participant {session.participant}: done after {len(session.answers)} trials")
    else:
        print(f"participant {session.participant}, trial {pair.trial}: first {pair.first}, then {pair.second}")


def _next(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive.run import open_study, resume

    _say(resume(open_study(arguments.folder), arguments.participant))
    return 0


def _answer(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive.run import answer, open_study

    _say(answer(open_study(arguments.folder), arguments.participant, arguments.trial, arguments.answer))
    return 0


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive.run import answer, open_study, resume

    study = open_study(arguments.folder)
    session = resume(study, arguments.participant)
    while (pair := session.next_pair()) is not None:
        print(
            f"trial {pair.trial}: first {pair.first}, then {pair.second}. Second higher? y, n or q: ",
            end="",
            flush=True,
        )
        given = sys.stdin.readline()
        text = given.strip().lower()
        if not given or text == "q":
            print(f"stopped after {len(session.answers)} trials; the same command goes on")
            return 0
        if text in ("y", "n"):
            session = answer(study, arguments.participant, pair.trial, text)
    _say(session)
    return 0


def _simulate(
    arguments: argparse.Namespace,
    contact: Callable[[argparse.Namespace], Any],
    observer: Callable[[argparse.Namespace], Any],
) -> int:
    from stepblocks.study.adaptive.run import open_study, simulate_adaptive

    count = simulate_adaptive(
        open_study(arguments.folder), arguments.file, contact(arguments), observer(arguments), arguments.seed
    )
    print(f"{arguments.folder / 'answers'}: {count} simulated answers")
    return 0


def _result(arguments: argparse.Namespace) -> int:
    from stepblocks.study.adaptive.run import open_study, write_results
    from stepblocks.study.page import render_table

    sys.stdout.write(render_table(write_results(open_study(arguments.folder))))
    print(f"then: stepblocks study analyse {arguments.folder} {arguments.folder / 'answers.csv'} -o REPORT")
    return 0
