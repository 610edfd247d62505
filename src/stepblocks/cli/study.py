"""``stepblocks study``: the experiments on people, from the design to the report."""

import argparse
import inspect
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import stepblocks
from stepblocks.cli.arguments import PLACE, given, quantity
from stepblocks.cli.outcome import Outcome
from stepblocks.errors import PipelineError


def _design(arguments: argparse.Namespace) -> Outcome:
    plan = stepblocks.design_study(
        _source(arguments), arguments.output, **_options(arguments, stepblocks.design_study)
    )
    trials, people = len(plan.trials), int(plan.trials[-1]["participant"])
    said = (
        f"{arguments.output / 'design.csv'}: {trials} trials of {people} participants; "
        f"{plan.balance}"
    )
    record = {
        "trials": trials,
        "participants": people,
        "balance": plan.balance,
        "advice": plan.advice,
    }
    return Outcome(said, notes=list(filter(None, [plan.advice])), record=record)


def _sheet(arguments: argparse.Namespace) -> Outcome:
    number = stepblocks.write_sheets(arguments.folder)
    said = (
        f"{arguments.folder / 'sheets'}: {number} run sheets; print "
        f"{arguments.folder / 'run-sheets.pdf'}"
    )
    return Outcome(said, record={"sheets": number})


def _simulate(arguments: argparse.Namespace) -> Outcome:
    output = arguments.output or arguments.folder / "answers.csv"
    options = _options(arguments, stepblocks.simulate_study) | _observed(arguments)
    number = stepblocks.simulate_study(arguments.folder, arguments.file, output, **options)
    return Outcome(f"{output}: {number} simulated answers", record={"answers": number})


def _analyse(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.prose import write_headline

    data, folder = given(arguments, "data").get("data"), arguments.folder
    if bool(data) == bool(arguments.answers) or (data and folder):
        raise PipelineError(
            "a folder of a study with its answers must be given, or --data with a table of your own"
        )
    output = arguments.output or (folder or Path("out/study")) / "report"
    options = _options(arguments, stepblocks.analyse_study)
    result = stepblocks.analyse_study(folder, data or arguments.answers, output, **options)
    notes, said = [*result.notes, *result.remarks], write_headline(result)
    return Outcome(
        said, notes=notes, look=output / "report.html", record={"said": said, "notes": notes}
    )


def _share(arguments: argparse.Namespace) -> Outcome:
    files = stepblocks.share_study(
        arguments.folder, arguments.answers, arguments.output, **given(arguments, "form")
    )
    return Outcome(f"{arguments.output}: {len(files)} files", record={"files": files})


def _conduct(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.conduct import RunServer

    options = _options(arguments, stepblocks.open_run) | given(arguments, *PLACE)
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
    options = _options(arguments, stepblocks.study_power) | _observed(arguments)
    table = stepblocks.study_power(_source(arguments), arguments.output, **options)
    return Outcome("", {"power": table.to_dict("records")})


def _start(arguments: argparse.Namespace) -> Outcome:
    study = stepblocks.start_adaptive(
        _source(arguments), arguments.output, **_options(arguments, stepblocks.start_adaptive)
    )
    said = (
        f"{study.plan.method} with {len(study.plan.compared)} blocks against the standard, "
        f"{study.participants} participants"
    )
    most = f"at most {study.plan.trials} trials each"
    return Outcome(
        f"{arguments.output / 'setup.json'}: {said}, {most}",
        notes=list(filter(None, [study.advice])),
    )


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import open_adaptive, record_answer

    session = open_adaptive(arguments.folder).session(arguments.participant)
    while (pair := session.next_pair()) is not None:
        asked = (
            f"trial {pair.trial}: first {pair.first}, then {pair.second}. Second higher? y, n or "
            "q: "
        )
        print(asked, end="", flush=True)
        line = sys.stdin.readline()
        text = line.strip().lower()
        if not line or text == "q":
            return Outcome(f"stopped after {pair.trial - 1} trials; the same command goes on")
        if text in ("y", "n"):
            session = record_answer(
                arguments.folder, arguments.participant, pair.trial, text == "y"
            )
            if session.plan.method == "training":
                print("right" if session.right else "wrong")
    return Outcome(str(session))


def _undo(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import undo_answer

    return Outcome(str(undo_answer(arguments.folder, arguments.participant)))


def _result(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.study.adaptive import estimate_participants

    then = f"then: stepblocks study analyse {arguments.folder} {arguments.folder / 'answers.csv'}"
    return Outcome(then, {"thresholds": estimate_participants(arguments.folder).to_dict("records")})


def _heights(text: str) -> tuple[float, ...]:
    """Read heights in micrometres [m]."""
    return tuple(
        quantity("length")(part if part.strip(" 0123456789.") else f"{part} um")
        for part in text.split(",")
    )


def _source(arguments: argparse.Namespace) -> Any:
    """Return the stimulus file or the heights, of which one must be given."""
    asked = getattr(arguments, "heights", None)
    if (arguments.file is None) == (asked is None):
        raise PipelineError(
            "a stimulus FILE or --heights must be given, got " + ("both" if asked else "neither")
        )
    return asked or arguments.file


def _options(arguments: argparse.Namespace, function: Callable[..., Any]) -> dict[str, Any]:
    """Return the options that were given and that a function takes by their names."""
    takes = inspect.signature(function).parameters.values()
    return given(arguments, *(one.name for one in takes if one.kind is one.KEYWORD_ONLY))


def _observed(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what ``@observer`` asks for as keywords of the functions that simulate."""
    from stepblocks.study.simulate import Observer

    observer = Observer(**given(arguments, *vars(Observer())))
    return {"observer": observer, **given(arguments, *PLACE)}


def _names(text: str) -> tuple[str, ...]:
    """Read names separated by commas."""
    found = tuple(part.strip() for part in text.split(","))
    if not all(name and name.replace("-", "").isalnum() for name in found):
        rule = "must be names of letters, digits and hyphens, separated by commas"
        raise argparse.ArgumentTypeError(f"{rule}, got {text!r:.60}")
    return found


def _scale(text: str) -> tuple[int, int]:
    """Read the ends of a scale."""
    low, dash, high = text.partition("-")
    if not (
        dash and low.isdecimal() and high.isdecimal() and len(text) < 40 and int(low) < int(high)
    ):
        raise argparse.ArgumentTypeError(f"must be LOW-HIGH such as 1-7, got {text!r:.40}")
    return int(low), int(high)


def _pairs(text: str, what: str) -> dict[str, str]:
    parts = [part.strip().partition("=") for part in text.split(",")]
    if not all(name and equals and value for name, equals, value in parts):
        raise argparse.ArgumentTypeError(f"must be {what}, separated by commas, got {text!r:.60}")
    return {name: value for name, _, value in parts}


def _shares(text: str) -> dict[str, float]:
    if text.endswith(".toml"):
        from stepblocks.predict.sheaths import find_damping

        return find_damping(text)
    return {name: quantity("ratio")(value) for name, value in _pairs(text, "name=share").items()}


READERS = {
    "A,B,...": _names,
    "A=X,B=Y": _shares,
    "H,H,...": _heights,
    "LOW-HIGH": _scale,
    "OURS=YOURS,...": partial(_pairs, what="ours=theirs"),
}
COMMANDS = {
    "study design": _design,
    "study sheet": _sheet,
    "study run": _conduct,
    "study simulate": _simulate,
    "study analyse": _analyse,
    "study power": _power,
    "study share": _share,
    "study adaptive start": _start,
    "study adaptive run": _run,
    "study adaptive undo": _undo,
    "study adaptive result": _result,
}
