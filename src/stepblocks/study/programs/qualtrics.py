"""Qualtrics: a row for each participant, below two further rows of headers."""

from collections.abc import Sequence
from dataclasses import replace

from stepblocks.files.text_table import TextTable
from stepblocks.study.programs.program import Program, Records, keep_rows

_IMPORT = '"ImportId"'  # in every cell of the last row of headers
_HEADERS = 2
# what the column Status calls a response that no participant gave, as text and as number
_NO_PARTICIPANT = ("survey preview", "survey test", "spam", "1", "2", "8", "9")


def _convert_qualtrics_table(table: TextTable) -> Records:
    """Leave out the further rows of headers, previews and tests."""
    responses = range(_count_header_rows(table), len(table.rows))
    kept = _list_rows_of_participants(table, responses)
    left_out = len(responses) - len(kept)
    notes = [*table.notes]
    if left_out:
        notes.append(f"{left_out} previews and tests are left out")
    return Records(replace(keep_rows(table, kept), notes=tuple(notes)), ())


def _count_header_rows(table: TextTable) -> int:
    """Return how many rows below the names are further headers; zero where there are none."""
    headers = 0
    for number, cells in enumerate(table.rows[:_HEADERS], start=1):
        if any(_IMPORT in cell for cell in cells):
            headers = number
    return headers


def _list_rows_of_participants(table: TextTable, response_rows: Sequence[int]) -> list[int]:
    """List the rows, of those of responses, that a participant gave; all without a status."""
    if "Status" not in table.names:
        return [*response_rows]
    statuses = table.get_named_cells("Status")
    kept = []
    for row in response_rows:
        if statuses[row].lower() not in _NO_PARTICIPANT:
            kept.append(row)
    return kept


QUALTRICS = Program(
    title="Qualtrics",
    marks=(("ResponseId", "RecordedDate"), ("ResponseId", "StartDate")),
    people=("participant", "PROLIFIC_PID", "ExternalReference", "ResponseId"),
    administrative=(
        *("StartDate", "EndDate", "Status", "IPAddress", "Progress", "Duration (in seconds)"),
        *("Finished", "RecordedDate", "ResponseId", "Recipient*", "ExternalReference"),
        *("Location*", "DistributionChannel", "UserLanguage", "Q_*", "*_DO", "*_DO_*"),
    ),
    unfold=_convert_qualtrics_table,
)
