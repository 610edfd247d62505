"""Gorilla: a row for every event of a screen, of which some are answers."""

from collections.abc import Mapping
from dataclasses import replace

from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import Channel, Program, Records, keep_rows

_SPREADSHEET = "Spreadsheet: "  # before the columns of the task's own spreadsheet
_NAMES = ("Zone Name", "Object Name", "Question Key", "Zone Type", "Component Name")
_NO_ANSWERS = ("BEGIN TASK", "END TASK", "AUDIO PLAY REQUESTED", "END OF FILE")


def _convert_gorilla_table(table: TextTable) -> Records:
    """Keep the rows of answers, and give each zone a column of its own."""
    names = [name.removeprefix(_SPREADSHEET) for name in table.names]
    if len(set(names)) < len(names):
        names = [*table.names]
    kept = []
    for number, cells in enumerate(table.rows):
        if _is_answer_row(dict(zip(names, cells, strict=False))):
            kept.append(number)
    answers = keep_rows(table, kept)
    channels = dict[str, Channel]()
    columns = []
    for cells in answers.rows:
        question = _get_question_name(dict(zip(names, cells, strict=False)))
        column = f"response of {question}"
        channels[column] = Channel(column, question, "Reaction Time")
        columns.append(column)
    response = names.index("Response")
    rows = []
    for cells, column in zip(answers.rows, columns, strict=True):
        by_channel = dict.fromkeys(channels, "")
        by_channel[column] = cells[response]
        rows.append([*cells, *by_channel.values()])
    table = replace(answers, names=(*names, *channels), rows=rows)
    return Records(table, list(channels.values()))


def _is_answer_row(record: Mapping[str, str]) -> bool:
    """Return whether a row is what a participant answered, rather than what was shown."""
    if not record.get("Response", "") or record["Response"] in _NO_ANSWERS:
        return False
    if "Response Type" in record:
        return record["Response Type"] == "response"
    if "Zone Type" in record:
        return record["Zone Type"].startswith("response")
    return True


def _get_question_name(record: Mapping[str, str]) -> str:
    """Return what a row calls the zone that was answered."""
    for name in _NAMES:
        if record.get(name, ""):
            return record[name]
    return "Response"


GORILLA = Program(
    title="Gorilla",
    marks=(
        ("Participant Private ID", "Zone Type"),
        ("Participant Private ID", "Response"),
    ),
    people=("Participant Private ID", "Participant Public ID"),
    administrative=(
        *("Event Index", "UTC *", "Local *", "Experiment *", "Tree Node Key", "Repeat Key"),
        *("Schedule ID", "Participant *", "Room *", "Task *", "Spreadsheet*", "Trial Number"),
        *("Screen*", "Zone *", "Reaction *", "Response*", "Attempt", "Correct", "Incorrect"),
        *("Dishonest", "X Coordinate", "Y Coordinate", "Timed Out", "Checkpoint", "checkpoint"),
        *("randomise_*", "display", "Display", "Object *", "Component *", "Tag", "Question *"),
        *("Clock *", "Absolute *", "Relative *", "Current *", "Manipulation*", "ShowProgressBar"),
        *("randomiser*", "branch*", "counterbalance*", "order-*", "Store*"),
    ),
    unfold=_convert_gorilla_table,
    seconds=1e-3,
    has_events=True,
)
