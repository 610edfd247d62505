"""What a format of traces has to do: open a file, find a trial in it, read its columns.

A format is one file with one subclass of `TraceReader`, named in ``READERS`` and, with its
suffixes, in ``FORMATS`` of the declaration of a session.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from numpy.typing import ArrayLike

from stepblocks.bench.traces.rows import TrialRow

File = TypeVar("File")
Group = TypeVar("Group")


@dataclass(frozen=True)
class TextLayout:
    """How the text of traces is written.

    Attributes
    ----------
    delimiter, decimal, encoding : str, optional
        What is not declared is found.
    skip_lines : int
        Lines before the header.
    is_named : bool
        Whether the first line names the columns.
    missing : tuple of float or str, optional
        What stands for a missing sample; by default the numbers that stand out.
    """

    delimiter: str | None
    decimal: str | None
    skip_lines: int
    is_named: bool
    encoding: str | None = None
    missing: tuple[float | str, ...] | None = None

    def __post_init__(self) -> None:
        if self.missing is not None:  # a list where it comes from JSON
            object.__setattr__(self, "missing", tuple(self.missing))


@dataclass(frozen=True)
class TrialPlace:
    """Where in a file a trial is to be looked for.

    Attributes
    ----------
    trial : str
    groups : tuple of str
        Names that its group may have, the likeliest first.
    has_own_file : bool
        Whether the file holds this trial alone.
    is_whole_file : bool
        Whether the file itself is the group.
    row : TrialRow or None
        Row of the arrays of the file that the trial is; None where it is a group.
    """

    trial: str
    groups: tuple[str, ...]
    has_own_file: bool
    is_whole_file: bool
    row: TrialRow | None = None


class TraceReader(ABC, Generic[File, Group]):
    """Reads the traces of one format; every method raises `TraceError`.

    ``File`` is what the library of the format calls an open file, ``Group`` what holds the columns
    of one trial.
    """

    @abstractmethod
    def open(self, path: Path, layout: TextLayout) -> AbstractContextManager[File]:
        """Open a file; `layout` concerns formats of text alone."""

    @abstractmethod
    def find_group(self, file: File, place: TrialPlace) -> Group:
        """Find the columns of one trial."""

    @abstractmethod
    def read_column(self, group: Group, column: str | int) -> ArrayLike:
        """Read one column by its name, or by its index from 0, in the units of the file."""

    def list_notes(self, group: Group, names: Sequence[str | int]) -> list[str]:
        """Say what had to be found out about the file to read these columns."""
        return []

    def read_attributes(self, group: Group, names: Sequence[str | int]) -> Mapping[str, object]:
        """Return what the file says of a trial and its columns beside the samples."""
        return {}
