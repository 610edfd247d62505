"""What a user declares of a table or of a text of numbers; what is not declared is found."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stepblocks.errors import StepblocksError, UsageError
from stepblocks.files.decode import normalise_encoding_name

__all__ = [
    "UNDECLARED",
    "MissingValues",
    "TableLayout",
    "parse_missing_value",
    "refuse_declared_layout",
]

_DECIMAL_SIGNS = (".", ",")


class MissingValues(NamedTuple):
    """What a user names as missing: numbers, and words."""

    numbers: tuple[float, ...]
    words: tuple[str, ...]


@dataclass(frozen=True)
class TableLayout:
    """What is declared of a table; what is not is found in the file, and said.

    Parameters
    ----------
    separator : str, optional
        One letter between two cells; a blank stands for any run of blanks.
    decimal : {".", ","}, optional
        The decimal sign.
    encoding : str, optional
        Such as ``"cp1252"``; any encoding of text that Python knows by this name.
    missing : sequence of numbers and texts, optional
        Numbers and words that stand for a missing value, wherever they are. By default a number
        counts as missing that instruments write for it and that stands far off its column; words
        for it, as ``NA``, count in columns of numbers either way.

    Raises
    ------
    UsageError
        If one of them is no such thing.

    Examples
    --------
    >>> from stepblocks import TableLayout
    >>> TableLayout(decimal=",", missing=[-9999, "OVERLOAD"]).missing
    (-9999.0, 'OVERLOAD')
    """

    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    missing: Sequence[float | str] | None = None

    def __post_init__(self) -> None:
        if self.separator is not None and len(self.separator) != 1:
            raise UsageError(f"separator must be one letter, got {self.separator!r}")
        if self.decimal is not None and self.decimal not in _DECIMAL_SIGNS:
            raise UsageError(f"decimal must be '.' or ',', got {self.decimal!r}")
        if self.separator is not None and self.separator == self.decimal:
            raise UsageError(f"separator must not be the decimal sign, got {self.separator!r}")
        if self.encoding is not None:
            object.__setattr__(self, "encoding", _normalise_encoding(self.encoding))
        if self.missing is not None:
            object.__setattr__(self, "missing", _normalise_missing(self.missing))

    @property
    def missing_values(self) -> MissingValues | None:
        """What is declared as missing, numbers apart from words; None where nothing is."""
        if self.missing is None:
            return None
        numbers = []
        words = []
        for value in self.missing:
            if isinstance(value, str):
                words.append(value)
            else:
                numbers.append(value)
        return MissingValues(tuple(numbers), tuple(words))


UNDECLARED = TableLayout()  # nothing is declared


def refuse_declared_layout(
    layout: TableLayout, source_kind: str, raises: type[StepblocksError]
) -> None:
    """Refuse what is declared of a text for something that is none, and raise as `raises` says."""
    if layout != UNDECLARED:
        raise raises(
            "encoding, separator, decimal sign and missing values are declared of a text, and must "
            f"not be given for {source_kind}"
        )


def parse_missing_value(text: str) -> float | str:
    """Read a value that a user names as missing: a number where it is one, else a word.

    Raises
    ------
    ValueError
        If it is empty, or no finite number.
    """
    word = text.strip()
    if not word:
        raise ValueError("must be a number or a word; an empty cell is missing anyway")
    try:
        value = float(word)
    except ValueError:
        return word
    if not math.isfinite(value):
        raise ValueError(f"must be a finite number or a word, got {word!r}")
    return value


def _normalise_encoding(name: str) -> str:
    """Return Python's name of an encoding; refuse one that is not of text."""
    try:
        return normalise_encoding_name(name)
    except (ValueError, TypeError) as error:
        raise UsageError(str(error)) from error


def _normalise_missing(values: Sequence[float | str]) -> tuple[float | str, ...]:
    """Return values that stand for a missing one: finite numbers, and words."""
    if isinstance(values, str | float | int):
        raise UsageError(f"missing must be a list of numbers and words, got {values!r}")
    checked: list[float | str] = []
    for value in values:
        try:
            checked.append(parse_missing_value(str(value)))
        except ValueError as error:
            raise UsageError(f"missing {error}, got {value!r:.60}") from error
    return tuple(dict.fromkeys(checked))
