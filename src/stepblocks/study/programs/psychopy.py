"""PsychoPy: a row for every pass of a loop, columns named ``component.what``.

The format is that of `ExperimentHandler.saveAsWideText` and of the code that Builder writes.
"""

from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import Channel, Program, Records

_ENDINGS = (".response", ".keys", ".text", ".rating")  # sliders, keyboards, text boxes, old scales


def _convert_psychopy_table(table: TextTable) -> Records:
    """Return the table with its columns of answers."""
    channels = []
    for name in table.names:
        for ending in _ENDINGS:
            if name.endswith(ending):
                question = name.removesuffix(ending)
                channels.append(Channel(name, question, f"{question}.rt"))
    return Records(table, channels)


PSYCHOPY = Program(
    title="PsychoPy",
    marks=(("*.thisN",), ("psychopyVersion",)),
    people=("participant",),
    administrative=(
        "?*.?*",  # component.what and loop.what
        *("session", "date", "expName", "expVersion", "psychopyVersion", "frameRate", "expStart"),
        *("notes", "OS", "Unnamed: *"),
    ),
    unfold=_convert_psychopy_table,
)
