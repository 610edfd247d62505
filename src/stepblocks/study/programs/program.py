"""What is known of a program that runs trials: how its records look, and where answers stand."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import TypeVar

from stepblocks.files.text_table import TextTable

Item = TypeVar("Item")
PREFIX = "sb_"  # begins the columns of a trial that `write_sheets` wrote for another program


@dataclass(frozen=True)
class Channel:
    """A column in which a program writes what a participant answered.

    Attributes
    ----------
    column : str
        Its name.
    question : str
        What the program calls the question: the name of a component, an item or a zone.
    reaction : str
        Column of the time that the answer took; empty where there is none.
    is_position : bool
        Whether it holds the position of a button rather than what stood on it.
    """

    column: str
    question: str
    reaction: str = ""
    is_position: bool = False


@dataclass(frozen=True)
class Records:
    """Records of a program as one flat table.

    Attributes
    ----------
    table : TextTable
        A row for every event that may hold an answer.
    channels : sequence of Channel
        Columns that hold answers.
    """

    table: TextTable
    channels: Sequence[Channel]

    @property
    def by_column(self) -> dict[str, Channel]:
        """The channels by the names of their columns."""
        return {channel.column: channel for channel in self.channels}


@dataclass(frozen=True)
class Program:
    """A program that runs trials.

    Attributes
    ----------
    title : str
        Its name.
    marks : tuple of tuple of str
        Patterns of column names; its records have a column for each pattern of a group.
    people : tuple of str
        Columns that may name the participant, the first that is there counts.
    administrative : tuple of str
        Patterns of the columns that it writes for itself.
    unfold : callable
        Takes the table as it is written, returns its records.
    seconds : float
        Unit of its reaction times [s].
    has_events : bool
        Whether a trial may have several rows, some of them without an answer.
    """

    title: str
    marks: tuple[tuple[str, ...], ...]
    people: tuple[str, ...]
    administrative: tuple[str, ...]
    unfold: Callable[[TextTable], Records]
    seconds: float = 1.0
    has_events: bool = False

    def recognises_columns(self, column_names: Sequence[str]) -> bool:
        """Return whether a table with such columns is a record of the program."""
        return any(_all_patterns_match(column_names, group) for group in self.marks)

    def is_administrative(self, name: str) -> bool:
        """Return whether a column is one that the program writes for itself."""
        patterns = (*self.administrative, *self.people)
        return any(fnmatchcase(name, pattern) for pattern in patterns)


def any_name_matches(names: Sequence[str], pattern: str) -> bool:
    """Return whether a name matches a pattern."""
    return any(fnmatchcase(name, pattern) for name in names)


def _all_patterns_match(names: Sequence[str], patterns: Sequence[str]) -> bool:
    """Return whether each pattern matches a name."""
    return all(any_name_matches(names, pattern) for pattern in patterns)


def keep_rows(table: TextTable, row_numbers: Sequence[int]) -> TextTable:
    """Return a table of some of the rows, by their numbers from 0."""
    return replace(
        table,
        rows=pick_by_indices(table.rows, row_numbers),
        places=pick_by_indices(table.places, row_numbers),
    )


def pick_by_indices(items: Sequence[Item], indices: Sequence[int]) -> list[Item]:
    """Return the items with some numbers, counted from 0, in the order of the numbers."""
    return [items[number] for number in indices]


def list_cells_in_order(record: Mapping[str, str], names: Sequence[str]) -> list[str]:
    """Return the cells of a record in the order of some names; empty where it has none."""
    return [record.get(name, "") for name in names]
