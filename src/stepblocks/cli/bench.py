"""``stepblocks measure``, ``loop`` and ``simulate-session``: what takes or makes a session of the bench."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, add_jobs, add_output
from stepblocks.cli.outcome import Outcome, telling


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "features of every trace of a bench session"
    description = (
        "Read a bench session and write one row of features per trial, with standard uncertainties. "
        "Trials that cannot be measured stay in the table with status `excluded` and the reason."
    )
    examples = ("measure session", "measure session -o features.csv --plots plots --trials 1,2")
    measure = add_command(commands, "measure", _measure, said, description, examples=examples)
    measure.add_argument("session", type=Path, metavar="SESSION", help="folder with session.toml")
    add_output(measure, "out/features.csv", "CSV", "table of features")
    add_jobs(measure)
    _add_waveform(measure)
    measure.add_argument("--plots", type=Path, metavar="DIR", help="also draw trials with what was fitted")
    said = "trials to draw, separated by commas (default: the first twelve)"
    measure.add_argument("--trials", metavar="LIST", help=said)

    said = "find what the model lacks for a measured session"
    description = (
        "Measure a session, trace the residual to an effect, add it, and report the error before and "
        "after: features.csv, result.json, model.json and report.html in the output folder."
    )
    examples = ("loop session", "loop session -o out/loop --as-built out/inspect")
    loop = add_command(commands, "loop", _loop, said, description, examples=examples)
    said = "folder with session.toml, trials.csv and traces; several are fitted in one hierarchy"
    loop.add_argument("session", type=Path, nargs="+", metavar="SESSION", help=said)
    add_output(loop, "out/loop")
    add_jobs(loop)
    _add_waveform(loop)
    loop.add_argument("--forces-only", action="store_true", help="leave the scans of the blocks out")
    said = "as-built records of inspected blocks, or folders of them, instead of the session's scans"
    loop.add_argument("--as-built", nargs="+", type=Path, default=[], metavar="RECORD", help=said)

    said = "a bench session from the equations, with any effect planted"
    description = (
        "Write a session with traces, scans and the truth behind them, so that a laboratory can ask "
        "before it measures whether a design would find an effect."
    )
    words = ("simulate-session plan.toml -o rehearsal",)
    rehearse = add_command(commands, "simulate-session", _simulate_session, said, description, examples=words)
    rehearse.add_argument("plan", type=Path, metavar="SPEC.toml", help="design, model, scatter, rig and effects")
    add_output(rehearse, "out/session", said="session to make")


def _add_waveform(command: argparse.ArgumentParser) -> None:
    command.add_argument("--waveform", action="store_true", help="also fit the drag in time to every whole trace")


def _measure(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.bench.measure import write_features

    told = telling(arguments, "measured trials", lines=10)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    given = {"jobs": arguments.jobs, "waveform": arguments.waveform}
    summary = write_features(arguments.session, arguments.output, progress=told, **given)
    if arguments.plots is not None:
        from stepblocks.bench.figures import draw_trials

        chosen = [name.strip() for name in arguments.trials.split(",")] if arguments.trials else None
        draw_trials(arguments.session, arguments.plots, chosen)
    reasons = dict(sorted(summary.reasons.items(), key=lambda item: -item[1]))
    notes = [f"excluded {count}: {reason}" for reason, count in reasons.items()]
    return Outcome(
        f"{summary.total - summary.excluded} of {summary.total} trials measured -> {arguments.output}",
        notes=[*notes, *(f"note: {note}" for note in summary.notes)],
        record={"trials": summary.total, "excluded": reasons, "notes": list(summary.notes)},
    )


def _loop(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.loop.run import loop_session
    from stepblocks.loop.several import loop_sessions
    from stepblocks.quantities import readable

    asked: dict[str, Any] = {name: getattr(arguments, name) for name in ("jobs", "forces_only", "as_built")}
    asked["progress"] = telling(arguments, "measured trials")
    if len(arguments.session) > 1:
        document = loop_sessions(arguments.session, arguments.output, **asked)
        rows = [
            {"parameter": name, "unit": p["unit"], "mean": p["mean"], "among sessions": p["among_sessions_std"]}
            | p["next"]
            for name, p in document["parameters"].items()
            if len(p["sessions"]) > 1 and not name.startswith("height_error")
        ]
        verdicts = "; ".join(f"{name}: {found['verdict']}" for name, found in document["sessions"].items())
        return Outcome(verdicts, {"in the next session, 95 %": rows}, record=document)
    result = loop_session(arguments.session[0], arguments.output, waveform=arguments.waveform, **asked)
    for scan in result.document["scans"]["left_out"]:
        print(readable(f"scan of {scan['block']} left out: {scan['reason']}"), file=sys.stderr)
    page = arguments.output / "report.html"
    return Outcome(f"{result.document['finding']} ({result.verdict})", look=page, record=result.document)


def _simulate_session(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.bench.rehearse.run import simulate_session

    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    summary = simulate_session(arguments.plan, arguments.output)
    made, left = summary.planned - summary.locked, f", {summary.locked} locked" if summary.locked else ""
    return Outcome(
        f"{made} trials of {summary.planned}{left} -> {arguments.output}",
        record={"planned": summary.planned, "locked": summary.locked, "session": str(arguments.output)},
    )
