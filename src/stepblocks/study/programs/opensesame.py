"""OpenSesame: its logger writes a row for each trial with every variable of the experiment."""

from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import Channel, Program, Records

_FORM = "form_response"


def _convert_opensesame_table(table: TextTable) -> Records:
    """Return the table with its columns of answers: of every item, or of the last one alone."""
    channels = []
    for name in table.names:
        if name.startswith("response_") and not name.startswith("response_time"):
            question = name.removeprefix("response_")
            channels.append(Channel(name, question, f"response_time_{question}"))
    if _FORM in table.names:
        channels.append(Channel(_FORM, _FORM))
    if not channels and "response" in table.names:
        channels.append(Channel("response", "response", "response_time"))
    return Records(table, channels)


OPENSESAME = Program(
    title="OpenSesame",
    marks=(
        ("subject_nr", "subject_parity"),
        ("subject_nr", "opensesame_version"),
        ("subject_nr", "count_*"),
    ),
    people=("subject_nr",),
    administrative=(
        *("count_*", "time_*", "response", "response_*", "correct", "correct_*", "live_row*"),
        *("font_*", "sound_*", "average_*", "avg_rt", "acc", "accuracy", "total_*", "form_*"),
        *("*_backend", "opensesame_*", "experiment_*", "subject_parity", "bidi", "background"),
        *("foreground", "color", "coordinates", "uniform_coordinates", "compensation"),
        *("datetime", "description", "disable_garbage_collection", "fullscreen", "height"),
        *("width", "logfile", "repeat_cycle", "round_decimals", "start", "title", "workspace"),
        *("jobs_index", "practice", "platform", "canvas", "mouse_*", "keyboard_*", "psychopy_*"),
    ),
    unfold=_convert_opensesame_table,
    seconds=1e-3,
)
