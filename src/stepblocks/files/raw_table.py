"""Rows of cells as a file writes them, before it is known what they mean."""

from dataclasses import dataclass, field
from typing import NamedTuple

__all__ = ["RawTable", "Record", "name_sheet_column"]


class Record(NamedTuple):
    """One row of a table as the file writes it.

    Attributes
    ----------
    line : int
        Of its first letter, counted from 1.
    cells : list of str
        Without blanks around them.
    """

    line: int
    cells: list[str]

    @property
    def is_empty(self) -> bool:
        """Whether no cell holds anything."""
        return not any(self.cells)


@dataclass(frozen=True)
class RawTable:
    """Rows of cells before it is known what they mean.

    Attributes
    ----------
    records : list of Record
        The rows that hold anything, the header among them.
    comments : list of Record
        What stands above them behind a mark of a comment.
    sheet : str
        Name of the sheet; empty for a text.
    notes : tuple of str
    """

    records: list[Record]
    comments: list[Record] = field(default_factory=list)
    sheet: str = ""
    notes: tuple[str, ...] = ()


def name_sheet_column(column_index: int) -> str:
    """Return the letters of a sheet's column, counted from 0.

    >>> name_sheet_column(0), name_sheet_column(27)
    ('A', 'AB')
    """
    letters = ""
    column_index += 1
    while column_index:
        column_index, digit = divmod(column_index - 1, 26)
        letters = chr(ord("A") + digit) + letters
    return letters
