"""Qualtrics: a row for each participant, below two further rows of headers."""

from dataclasses import replace

from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import Program, Records, keep_rows

_IMPORT = '"ImportId"'  # in every cell of the last row of headers
_HEADERS = 2
# what the column Status calls a response that no participant gave, as text and as number
_NO_PARTICIPANT = ("survey preview", "survey test", "spam", "1", "2", "8", "9")


def _unfold(table: TextTable) -> Records:
    """Leave out the further rows of headers, previews and tests."""
    headers = 0
    for number, cells in enumerate(table.rows[:_HEADERS]):
        if any(_IMPORT in cell for cell in cells):
            headers = number + 1
    kept = [*range(headers, len(table.rows))]
    left_out = 0
    if "Status" in table.names:
        statuses = table.get_named_cells("Status")
        responses = kept
        kept = [row for row in responses if statuses[row].lower() not in _NO_PARTICIPANT]
        left_out = len(responses) - len(kept)
    notes = [*table.notes]
    if left_out:
        notes.append(f"{left_out} previews and tests are left out")
    return Records(replace(keep_rows(table, kept), notes=tuple(notes)), ())


QUALTRICS = Program(
    title="Qualtrics",
    marks=(("ResponseId", "RecordedDate"), ("ResponseId", "StartDate")),
    people=("participant", "PROLIFIC_PID", "ExternalReference", "ResponseId"),
    administrative=(
        *("StartDate", "EndDate", "Status", "IPAddress", "Progress", "Duration (in seconds)"),
        *("Finished", "RecordedDate", "ResponseId", "Recipient*", "ExternalReference"),
        *("Location*", "DistributionChannel", "UserLanguage", "Q_*", "*_DO", "*_DO_*"),
    ),
    unfold=_unfold,
)
