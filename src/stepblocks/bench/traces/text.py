"""Traces in text: a CSV per trial."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from numpy.typing import ArrayLike

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.signal import format_first_eight_names
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace
from stepblocks.errors import BenchError
from stepblocks.files.layout import TableLayout
from stepblocks.files.text_table import CellError, TableShape, TextTable, read_text_table


class TextReader(TraceReader[TextTable, TextTable]):
    """Reads a file of one trial; columns without names are counted from 0."""

    def open(self, path: Path, layout: TextLayout) -> AbstractContextManager[TextTable]:
        """Read the whole file."""
        declared = TableLayout(layout.delimiter, layout.decimal, layout.encoding, layout.missing)
        shape = TableShape(layout.skip_lines, has_header=layout.is_named)
        try:
            table = read_text_table(path, declared, BenchError, shape=shape)
        except BenchError as error:
            reason = str(error).replace(str(path), path.name)
            raise TraceError(FaultKind.UNREADABLE, reason) from error
        if not table.rows:
            raise TraceError(FaultKind.UNREADABLE, f"{path.name}: the file holds no samples")
        return nullcontext(table)

    def find_group(self, file: TextTable, place: TrialPlace) -> TextTable:
        """Return the file itself."""
        return file

    def read_column(self, group: TextTable, column: str | int) -> ArrayLike:
        """Return one column of numbers, NaN for a missing sample."""
        file = Path(group.file).name
        index = _find_column_index(group, column)
        if index is None:
            names = group.names or tuple(map(str, range(group.column_count)))
            raise TraceError(
                FaultKind.UNKNOWN_CHANNEL,
                f"{file} has no {column!r}, it has {format_first_eight_names(names)}",
            )
        try:
            return group.read_numbers(index).values
        except CellError as error:
            place = group.name_place_of_row(error.row, index)
            raise TraceError(
                FaultKind.WITHOUT_HEADING, f"channel {column!r} {error} [{file}, {place}]"
            ) from error

    def list_notes(self, group: TextTable, names: Sequence[str | int]) -> list[str]:
        """Say what was found out about the text, and what stands for a missing sample."""
        notes = list(group.notes)
        for name in names:
            index = _find_column_index(group, name)
            if index is not None:
                notes += filter(
                    None, [group.read_numbers(index).describe_missing_values(str(name))]
                )
        return notes


def _find_column_index(table: TextTable, column: str | int) -> int | None:
    """Return the index of a column, from 0; None where the table has no such column."""
    if isinstance(column, int):
        return column if 0 <= column < table.column_count else None
    if column not in table.names:
        return None
    return table.names.index(column)
