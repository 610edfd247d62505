"""``stepblocks study adaptive``: QUEST+ or a staircase, trial by trial."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

import stepblocks
from stepblocks.cli.command import Group, command
from stepblocks.cli.options import Blocks, given, whole_number
from stepblocks.cli.outcome import Outcome
from stepblocks.cli.study_options import (
    Folder,
    HeightsOption,
    Participant,
    Participants,
    Seed,
    choose_source,
)

adaptive = typer.Typer(
    name="adaptive",
    cls=Group,
    help="QUEST+ or a staircase, trial by trial, resumable and blinded.",
    subcommand_metavar="COMMAND ...",
)
app = typer.Typer()
app.add_typer(adaptive)

_COUNT = whole_number(1, 100_000)


@command(
    adaptive,
    "start",
    "study adaptive start mine.toml --standard step-050 --seed 7 -o study",
)
def start(
    *,
    file: Blocks = None,
    heights: HeightsOption = None,
    standard: Annotated[
        str,
        typer.Option("--standard", metavar="ID", help="block that the others are compared with"),
    ],
    method: Annotated[
        Literal["quest", "staircase", "training"] | None,
        typer.Option("--method", help="how the next pair is chosen", show_default="quest"),
    ] = None,
    participants: Participants = None,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials",
            metavar="N",
            parser=_COUNT,
            help="most per participant",
            show_default="60",
        ),
    ] = None,
    reversals: Annotated[
        int | None,
        typer.Option(
            "--reversals",
            metavar="N",
            parser=_COUNT,
            help="a staircase ends after so many",
            show_default="12",
        ),
    ] = None,
    seed: Seed,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder of the study")
    ] = Path("out/study"),
) -> Outcome:
    """Write setup.json and the key of the blinding codes."""
    options = given(method=method, participants=participants, trials=trials, reversals=reversals)
    source = choose_source(file, heights)
    study = stepblocks.start_adaptive(source, output, standard=standard, seed=seed, **options)
    plan = study.plan
    return Outcome(
        f"{output / 'setup.json'}: {plan.method} with {len(plan.compared)} blocks against the "
        f"standard, {study.participants} participants, at most {plan.trials} trials each",
        notes=[study.advice] if study.advice else [],
    )


@command(adaptive, "run", "study adaptive run study --participant 1")
def run(*, folder: Folder, participant: Participant) -> Outcome:
    """Ask trial after trial at the keyboard; q stops, the same command goes on."""
    from stepblocks.study.adaptive import open_adaptive, record_answer

    session = open_adaptive(folder).session(participant)
    while (pair := session.next_pair()) is not None:
        question = f"first {pair.first}, then {pair.second}. Second higher? y, n or q: "
        print(f"trial {pair.trial}: {question}", end="", flush=True)
        line = sys.stdin.readline()
        text = line.strip().lower()
        if not line or text == "q":
            return Outcome(f"stopped after {pair.trial - 1} trials; the same command goes on")
        if text in ("y", "n"):
            session = record_answer(folder, participant, pair.trial, text == "y")
            if session.plan.method == "training":
                print("right" if session.right else "wrong")
    return Outcome(str(session))


@command(adaptive, "undo", "study adaptive undo study --participant 1")
def undo(*, folder: Folder, participant: Participant) -> Outcome:
    """Take the last answer back; the same pair is asked again."""
    from stepblocks.study.adaptive import undo_answer

    return Outcome(str(undo_answer(folder, participant)))


@command(adaptive, "result", "study adaptive result study")
def result(*, folder: Folder) -> Outcome:
    """Print thresholds and Weber fractions; write what study analyse reads."""
    from stepblocks.study.adaptive import estimate_participants

    then = f"then: stepblocks study analyse {folder} {folder / 'answers.csv'}"
    return Outcome(then, {"thresholds": estimate_participants(folder).to_dict("records")})
