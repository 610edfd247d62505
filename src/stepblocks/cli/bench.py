"""``stepblocks measure``, ``loop`` and ``simulate-session``: what takes or makes a session of the bench."""

import argparse
import sys
from typing import Any

from stepblocks.cli.outcome import Outcome, telling


def _measure(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.bench.measure import write_features

    told = telling(arguments, "measured trials", lines=10)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    given = {"jobs": arguments.jobs, "waveform": arguments.waveform}
    summary = write_features(arguments.session, arguments.output, progress=told, **given)
    if arguments.plots is not None:
        from stepblocks.bench.figures import draw_trials

        chosen = (
            [name.strip() for name in arguments.trials.split(",")] if arguments.trials else None
        )
        draw_trials(arguments.session, arguments.plots, chosen)
    reasons = dict(sorted(summary.reasons.items(), key=lambda item: -item[1]))
    notes = [f"excluded {count}: {reason}" for reason, count in reasons.items()]
    return Outcome(
        f"{summary.total - summary.excluded} of {summary.total} trials measured -> "
        f"{arguments.output}",
        notes=[*notes, *(f"note: {note}" for note in summary.notes)],
        record={"trials": summary.total, "excluded": reasons, "notes": list(summary.notes)},
    )


def _loop(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.loop.run import loop_session
    from stepblocks.loop.several import loop_sessions
    from stepblocks.quantities import format_units

    asked: dict[str, Any] = {name: getattr(arguments, name) for name in ("jobs", "forces_only")}
    asked |= {
        "as_built": arguments.as_built or [],
        "progress": telling(arguments, "measured trials"),
    }
    if len(arguments.session) > 1:
        document = loop_sessions(arguments.session, arguments.output, **asked)
        rows = [
            {
                "parameter": name,
                "unit": p["unit"],
                "mean": p["mean"],
                "among sessions": p["among_sessions_std"],
            }
            | p["next"]
            for name, p in document["parameters"].items()
            if len(p["sessions"]) > 1 and not name.startswith("height_error")
        ]
        verdicts = "; ".join(
            f"{name}: {found['verdict']}" for name, found in document["sessions"].items()
        )
        return Outcome(verdicts, {"in the next session, 95 %": rows}, record=document)
    result = loop_session(
        arguments.session[0], arguments.output, waveform=arguments.waveform, **asked
    )
    for scan in result.document["scans"]["left_out"]:
        print(format_units(f"scan of {scan['block']} left out: {scan['reason']}"), file=sys.stderr)
    page, excluded = arguments.output / "report.html", len(result.document["excluded"])
    notes = (
        [f"values or trials excluded, each with its reason in the report: {excluded}"]
        if excluded
        else []
    )
    return Outcome(
        f"{result.document['finding']} ({result.verdict})",
        notes=notes,
        look=page,
        record=result.document,
    )


def _simulate_session(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.bench.rehearse.run import simulate_session

    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    summary = simulate_session(arguments.plan, arguments.output)
    made, left = (
        summary.planned - summary.locked,
        f", {summary.locked} locked" if summary.locked else "",
    )
    return Outcome(
        f"{made} trials of {summary.planned}{left} -> {arguments.output}",
        record={
            "planned": summary.planned,
            "locked": summary.locked,
            "session": str(arguments.output),
        },
    )


COMMANDS = {"measure": _measure, "loop": _loop, "simulate-session": _simulate_session}
