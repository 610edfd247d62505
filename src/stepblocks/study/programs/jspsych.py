"""jsPsych: a record for every trial of a plugin, as JSON or CSV, answers as JSON within a cell."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from stepblocks.errors import StudyError
from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import PREFIX, Channel, Program, Records, list_cells_in_order

_RESPONSES = ("response", "responses")  # version 7 and later, 6
_ANSWER = f"{PREFIX}answer"  # column that names the question of a trial
_NOTHING = ("", "null", "undefined")


def _convert_jspsych_table(table: TextTable) -> Records:
    """Give every question a column of its own, and take timeline variables out of their object."""
    records = []
    channels = dict[str, Channel]()
    for cells in table.rows:
        record = dict(zip(table.names, cells, strict=False))
        record.update(_parse_json_object(record.pop("timeline_variables", "")))
        for channel, text in _iterate_answers(record):
            channels[channel.column] = channel
            record[channel.column] = text
        for name in _RESPONSES:
            record.pop(name, None)
        records.append(record)
    names = _list_record_names(records)
    rows = []
    for record in records:
        rows.append(list_cells_in_order(record, names))
    return Records(replace(table, names=names, rows=rows), list(channels.values()))


def _list_record_names(records: Iterable[Mapping[str, object]]) -> tuple[str, ...]:
    """List the names of all records, each once, in the order in which they come up."""
    names = dict[str, None]()
    for record in records:
        names.update(dict.fromkeys(record))
    return tuple(names)


def _iterate_answers(record: Mapping[str, str]) -> Iterator[tuple[Channel, str]]:
    """Yield the answers of a record: of a form those to its questions, else the one there is."""
    text = _get_response_text(record)
    if text in _NOTHING:
        return
    answers = _parse_json_object(text)
    for question, answer in answers.items():
        yield Channel(f"answer to {question}", question, "rt"), answer
    if answers:
        return
    question = record.get(_ANSWER, "")
    if question:
        yield Channel(f"answer to {question}", question, "rt"), _strip_json_quotes(text)
        return
    kind = record.get("trial_type", "")
    is_position = "button" in kind
    yield Channel(f"response of {kind}", kind, "rt", is_position), _strip_json_quotes(text)


def _get_response_text(record: Mapping[str, str]) -> str:
    """Return the text of the response of a record; empty where there is none."""
    for name in _RESPONSES:
        if record.get(name, ""):
            return record[name]
    return ""


def _parse_json_object(text: str) -> dict[str, str]:
    """Read the members of a JSON object as texts; none where the text is no object."""
    if not text.startswith("{"):
        return {}
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    members = {}
    for name, value in document.items():
        members[name] = format_json_value(value)
    return members


def _strip_json_quotes(text: str) -> str:
    """Return a JSON string without its quotes; anything else as it stands."""
    if len(text) > 1 and text.startswith('"') and text.endswith('"'):
        return text[1:-1]
    return text


def format_json_value(value: object) -> str:
    """Write a value of a JSON document as the cell of a table."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value.strip()
    return json.dumps(value, ensure_ascii=False)


def _is_list_of_objects(document: object) -> bool:
    """Tell whether a JSON document is a list of objects."""
    if not isinstance(document, list):
        return False
    return all(isinstance(item, dict) for item in document)


def parse_json_records(text: str, file_name: str) -> TextTable:
    """Read the records that jsPsych writes as JSON: a list of objects.

    Parameters
    ----------
    text : str
        Content of the file.
    file_name : str
        Its path, for messages.

    Returns
    -------
    TextTable
        A row for each record, which its number from 1 places.

    Raises
    ------
    StudyError
        If it is no list of objects.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"records must be JSON: {error!s:.80} [{file_name}]") from error
    if not _is_list_of_objects(document):
        raise StudyError(
            f"records must be a JSON list of objects, one for each trial [{file_name}]"
        )
    names = _list_record_names(document)
    rows = []
    for record in document:
        cells = []
        for name in names:
            cells.append(format_json_value(record.get(name)))
        rows.append(cells)
    return TextTable(names, rows, range(1, len(rows) + 1), file_name)


JSPSYCH = Program(
    title="jsPsych",
    marks=(("trial_type", "trial_index", "time_elapsed"),),
    people=(
        *("participant", "participant_id", "subject", "subject_id", "subjectID"),
        *("PROLIFIC_PID", "prolific_pid", "workerId"),
    ),
    administrative=(
        *("trial_type", "trial_index", "time_elapsed", "internal_node_id", "plugin_version", "rt"),
        *("stimulus", "slider_start", "question_order", "view_history", "success", "timeout"),
        *("failed_images", "failed_audio", "failed_video", "accuracy", "key_press", "prompt"),
        *("button_pressed", "study_id", "session_id", "STUDY_ID", "SESSION_ID", _ANSWER),
    ),
    unfold=_convert_jspsych_table,
    seconds=1e-3,
    has_events=True,
)
