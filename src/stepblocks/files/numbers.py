"""The one parser of numbers in text: decimal signs, thousands, and how programs write a minus.

A file has one notation. ``"1,000.5"`` and ``"0,15"`` in one file contradict each other, and a file
whose every doubtful number reads ``"1,234"`` is refused: it may mean 1.234 or 1234.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "NotationError",
    "NumberNotation",
    "find_number_notation",
    "is_plain_number",
    "simplify_number",
]

_SIGNS = str.maketrans(
    {
        "\u2212": "-",  # minus sign
        "\u2010": "-",
        "\u2011": "-",
        "\u2012": "-",
        "\u2013": "-",
        "\ufe63": "-",
        "\uff0d": "-",
        "\uff0b": "+",
        "\u00a0": " ",  # spaces between thousands: no-break, narrow no-break, thin, figure
        "\u202f": " ",
        "\u2009": " ",
        "\u2007": " ",
        "\u2019": "'",
        "\u02bc": "'",
    }
)
_LONGEST = 10_000  # letters of a number; a longer text is none
_SPECIAL = {"inf": math.inf, "+inf": math.inf, "-inf": -math.inf, "infinity": math.inf}
# sign, what stands before the exponent, and the exponent with the D of Fortran
_NUMBER = re.compile(
    r"(?P<sign>[-+]?)(?P<digits>[0-9][0-9 ',.]*|[.,][0-9]+)(?P<power>[eEdD][-+]?[0-9]+)?"
)
_GROUPED = r"[0-9]{1,3}(?:(?P<mark>[ '%s])[0-9]{3})(?:(?P=mark)[0-9]{3})*"
_PLAIN = {
    ".": re.compile(rf"(?:{_GROUPED % ','}|[0-9]+)?(?:\.[0-9]*)?"),
    ",": re.compile(rf"(?:{_GROUPED % '.'}|[0-9]+)?(?:,[0-9]*)?"),
}
_FAST = re.compile(r"[-+0-9.eE]*")
_PLAIN_NUMBER = re.compile(r"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?")


class _Sign(Enum):
    """What a number says about the decimal sign of its file."""

    NOTHING = "nothing"
    POINT = "."
    COMMA = ","
    POINT_OR_THOUSANDS = "1.234"
    COMMA_OR_THOUSANDS = "1,234"


class NotationError(ValueError):
    """Numbers of one file that contradict each other, or may be read in two ways.

    Parameters
    ----------
    message : str
        Rule and values.
    number : str
        The first number that breaks the rule, as the file writes it.
    """

    def __init__(self, message: str, number: str) -> None:
        super().__init__(message)
        self.number = number


@dataclass(frozen=True)
class NumberNotation:
    """How the numbers of a file are written.

    Attributes
    ----------
    decimal : {".", ","}
        The sign before the fraction; the other sign, a blank or an apostrophe may stand between
        thousands.
    """

    decimal: str = "."

    def parse_number(self, text: str) -> float:
        """Read a number.

        Raises
        ------
        ValueError
            If the text is no number in this notation.
        """
        simple = simplify_number(text)
        if simple.lower() in _SPECIAL:
            return _SPECIAL[simple.lower()]
        parsed = _NUMBER.fullmatch(simple)
        if parsed is None or _PLAIN[self.decimal].fullmatch(parsed["digits"]) is None:
            raise ValueError(f"{text!r} is no number with a decimal {self.decimal!r}")
        digits = parsed["digits"]
        for mark in " '.,":
            if mark != self.decimal:
                digits = digits.replace(mark, "")
        digits = digits.replace(",", ".")
        power = (parsed["power"] or "").lower().replace("d", "e")
        return float(parsed["sign"] + digits + power)

    def parse_column(self, texts: Sequence[str]) -> NDArray[np.float64] | None:
        """Read a column of plain numbers at once; None where a cell is anything else."""
        if self.decimal != "." or not _FAST.fullmatch("".join(texts)):
            return None
        try:
            return np.array(texts, dtype=np.float64)
        except ValueError:
            return None


def is_plain_number(text: str) -> bool:
    """Tell whether a text is a number as programs write it, with at most a decimal point."""
    return _PLAIN_NUMBER.fullmatch(text) is not None


def simplify_number(text: str) -> str:
    """Return the text of a number with plain signs, without blanks and quotes around it."""
    if len(text) > _LONGEST:
        return ""
    return text.translate(_SIGNS).strip().strip('"').strip()


@dataclass
class _Evidence:
    """Where a file first shows each use of the two decimal signs."""

    seen: dict[_Sign, str] = field(default_factory=dict)

    def add_number(self, text: str) -> None:
        """Note what one number shows."""
        sign = _classify_decimal_sign(text)
        if sign is not _Sign.NOTHING:
            self.seen.setdefault(sign, text)


def find_number_notation(texts: Iterable[str]) -> NumberNotation:
    """Find the notation that all numbers of a file share.

    Parameters
    ----------
    texts : iterable of str
        The cells of its columns of numbers; what is no number in any notation does not count.

    Returns
    -------
    NumberNotation
        That of a point where nothing speaks of a comma.

    Raises
    ------
    NotationError
        If two cells contradict each other, or all that show a sign may be read in two ways.
    """
    evidence = _Evidence()
    for text in texts:
        if "," in text or "." in text:
            evidence.add_number(text)
    seen = evidence.seen
    point, comma = seen.get(_Sign.POINT), seen.get(_Sign.COMMA)
    if point is not None and comma is not None:
        raise NotationError(
            f"numbers must have one decimal sign, got {point!r} and {comma!r} in one file", comma
        )
    if comma is not None:
        return NumberNotation(",")
    doubtful = seen.get(_Sign.COMMA_OR_THOUSANDS)
    if doubtful is not None and point is None:
        if _Sign.POINT_OR_THOUSANDS in seen:
            with_point = seen[_Sign.POINT_OR_THOUSANDS]
            raise NotationError(
                f"numbers must have one decimal sign, got {with_point!r} and {doubtful!r}",
                doubtful,
            )
        raise NotationError(
            f"a number must be clear, {doubtful!r} may be {doubtful.replace(',', '.')} or "
            f"{doubtful.replace(',', '')}; write one of them, or declare the decimal sign",
            doubtful,
        )
    return NumberNotation(".")


def _classify_decimal_sign(text: str) -> _Sign:
    """Classify what a number shows of the decimal sign: `NOTHING` where it is not a number."""
    parsed = _NUMBER.fullmatch(simplify_number(text))
    if parsed is None:
        return _Sign.NOTHING
    digits = parsed["digits"]
    fits = [sign for sign, pattern in _PLAIN.items() if pattern.fullmatch(digits)]
    if len(fits) == 1:
        return _Sign.COMMA if fits[0] == "," else _Sign.POINT
    if len(fits) == 0 or not ("," in digits or "." in digits):
        return _Sign.NOTHING
    # one sign with three digits behind it
    is_fraction = digits.startswith("0") or bool(parsed["power"])
    if "," in digits:
        return _Sign.COMMA if is_fraction else _Sign.COMMA_OR_THOUSANDS
    return _Sign.POINT if is_fraction else _Sign.POINT_OR_THOUSANDS
