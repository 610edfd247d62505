"""What can be done with a file of the folder, as commands."""

from collections.abc import Callable
from pathlib import PurePosixPath

from stepblocks.window import texts
from stepblocks.window.command_line import (
    ShownCommand,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.folder import Entry, Kind


def suggest_beginnings() -> list[ShownCommand]:
    """Return what to begin with in an empty folder; a notebook begins with a file, too."""
    return [
        ShownCommand(texts.NEW_BLOCK, ("new", "block", "mine.toml")),
        ShownCommand(texts.NEW_SHIPPED, ("new", "--shipped", "stimuli")),
        ShownCommand(texts.NEW_SESSION, ("new", "session", "session")),
    ]


def suggest_commands(entry: Entry) -> list[ShownCommand]:
    """Return the commands that take a file or folder as it is."""
    return _SUGGESTIONS[entry.kind](entry.name)


def _suggest_for_stimuli(name: str) -> list[ShownCommand]:
    """Return the commands that predict, build, draw and study the stimuli of a file."""
    word = protect_leading_hyphen(name)
    predict = ShownCommand(
        texts.PREDICT, ("predict", word), format_function_call("predict_set", name)
    )
    build = ShownCommand(
        texts.BUILD,
        ("build", word, "-o", "out"),
        format_function_call("build_sets", [name], "out"),
        "out/index.html",
    )
    draw = ShownCommand(
        texts.DRAW,
        ("workshop", word, "-o", "out"),
        format_function_call("order_parts", [name], "out"),
    )
    design = ShownCommand(
        texts.DESIGN,
        ("study", "design", word, "--seed", "1", "-o", "study"),
        format_function_call("design_study", name, "study", seed=1),
    )
    return [predict, build, draw, design]


def _suggest_for_scan(name: str) -> list[ShownCommand]:
    """Return the command that lists the channels of a scan."""
    return [
        ShownCommand(
            texts.LIST_CHANNELS,
            ("inspect", protect_leading_hyphen(name), "--list-channels"),
            format_function_call("list_channels", name),
        )
    ]


def _suggest_for_session(name: str) -> list[ShownCommand]:
    """Return the commands that measure and explain a session."""
    word = protect_leading_hyphen(name)
    base = PurePosixPath(name).name
    features = f"out/{base}-features.csv"
    report = f"out/{base}-loop"
    measure = ShownCommand(
        texts.MEASURE,
        ("measure", word, "-o", features),
        format_function_call("measure_session", name, features),
    )
    explain = ShownCommand(
        texts.LOOP,
        ("loop", word, "-o", report),
        format_function_call("loop_session", name, report),
        f"{report}/report.html",
    )
    return [measure, explain]


def _suggest_for_study(name: str) -> list[ShownCommand]:
    """Return the command that writes the run sheets of a study."""
    return [
        ShownCommand(
            texts.SHEETS,
            ("study", "sheet", protect_leading_hyphen(name)),
            format_function_call("write_sheets", name),
            f"{name}/run-sheets.html",
        )
    ]


def _suggest_for_output(_: str) -> list[ShownCommand]:
    """Return no command: what a command wrote is only looked at."""
    return []


_SUGGESTIONS: dict[Kind, Callable[[str], list[ShownCommand]]] = {
    Kind.STIMULI: _suggest_for_stimuli,
    Kind.SCAN: _suggest_for_scan,
    Kind.SESSION: _suggest_for_session,
    Kind.STUDY: _suggest_for_study,
    Kind.OUTPUT: _suggest_for_output,
}
