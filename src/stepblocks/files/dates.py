"""The one reader of dates and times: the order of day and month belongs to the column.

A column with a day above 12 tells its order; one that does not is refused, unless both orders give
the same times between its rows. Times with an offset from UTC are compared in UTC.
"""

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.files.missing import is_missing_word
from stepblocks.mistakes import shorten_value

__all__ = ["DateColumn", "DateError", "DateOrder", "holds_dates", "read_dates"]

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = r"(?P<word>[A-Za-z]{3,9})\.?"
_TIME = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9}))?)?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<offset>Z|z|UTC|GMT|[-+]\d{2}:?\d{2}|[-+]\d{2})?"
)
_DATES = (
    r"(?P<year>\d{4})(?P<mark>[-/.])(?P<month>\d{1,2})(?P=mark)(?P<day>\d{1,2})",
    r"(?P<year>\d{4})(?P<month>\d{2})(?P<day>\d{2})(?=[T ])",
    r"(?P<first>\d{1,2})(?P<mark>[-/.])(?P<second_part>\d{1,2})(?P=mark)(?P<year>\d{4}|\d{2})",
    rf"(?P<day>\d{{1,2}})[-/. ]\s*{_MONTH}[-/., ]\s*(?P<year>\d{{4}}|\d{{2}})",
    rf"{_MONTH}\s+(?P<day>\d{{1,2}}),?\s+(?P<year>\d{{4}})",
)
_PATTERNS = [re.compile(rf"{date}(?:(?:T|,?\s+){_TIME})?") for date in _DATES]
_PATTERNS.append(re.compile(_TIME))
_USUAL_SHARE = 0.9  # of the filled cells, that must be dates in a column of dates
_FIRST_YEAR, _LAST_YEAR = 1900, 2200
_NO_DATE = datetime.date(2000, 1, 1)  # of a time of day alone
_LONGEST = 60  # letters of a date
_HOUR = 3600.0


class DateOrder(Enum):
    """The order of the parts of a date."""

    YEAR_FIRST = "year, month, day"
    DAY_FIRST = "day, month, year"
    MONTH_FIRST = "month, day, year"
    TIME_ALONE = "a time of day"


class DateError(ValueError):
    """A column of dates that cannot be read, or may be read in two ways."""

    def __init__(self, message: str, row: int | None = None) -> None:
        super().__init__(message)
        self.row = row


@dataclass(frozen=True)
class DateColumn:
    """The dates of a column.

    Attributes
    ----------
    seconds : array, shape (n,)
        Since the begin of 1970, of UTC where the times have offsets, of local time elsewhere; NaN
        where a cell is empty.
    order : DateOrder
        Of the first date.
    notes : tuple of str
        What had to be found out: the order, offsets, local time that runs back.
    """

    seconds: NDArray[np.float64]
    order: DateOrder
    notes: tuple[str, ...] = ()


class _Written(NamedTuple):
    """A date as it is written: its parts, and which of the first two is the day."""

    parts: dict[str, str]
    is_open: bool  # whether it depends on the order of the column
    has_offset: bool


def holds_dates(texts: Sequence[str]) -> bool:
    """Tell whether nearly all filled cells of a column are dates or times of day."""
    filled = [text for text in texts if not is_missing_word(text)]
    if not filled:
        return False
    dates = sum(_parse_date(text) is not None for text in filled)
    return dates > _USUAL_SHARE * len(filled)


def read_dates(texts: Sequence[str], column_name: str) -> DateColumn:
    """Read a column of dates.

    Parameters
    ----------
    texts : sequence of str
        Cells: ISO 8601, day, month and year (or month, day and year) with dots, slashes or dashes,
        a month by its English name, or a time of day alone.
    column_name : str
        Of the column, for messages.

    Returns
    -------
    DateColumn
        Seconds of each cell, and what had to be found out.

    Raises
    ------
    DateError
        If a cell is no date, only some have an offset, or the order of day and month is open.
    """
    written = _parse_dates(texts, column_name)
    known = [row for row, date in enumerate(written) if date is not None]
    if not known:
        raise DateError(f"{column_name} must hold dates, got none")
    _refuse_partial_offsets(written, column_name)
    orders = _find_possible_orders(written, texts, column_name)
    seconds = _convert_dates_to_seconds(written, orders[0], texts, column_name)
    if len(orders) > 1:
        _refuse_open_order(
            seconds,
            _convert_dates_to_seconds(written, orders[1], texts, column_name),
            column_name,
            texts,
        )
    notes = _describe_date_column(written, seconds, orders, texts, column_name)
    first = written[known[0]]
    assert first is not None
    return DateColumn(seconds, _find_written_order(first, orders[0]), notes)


def _parse_date(text: str) -> _Written | None:
    """Return the parts of a date; None where a text is not a date."""
    text = text.strip()
    if len(text) > _LONGEST:
        return None
    for pattern in _PATTERNS:
        found = pattern.fullmatch(text)
        if found is None:
            continue
        parts = {key: value for key, value in found.groupdict().items() if value is not None}
        word = parts.get("word", "")[:3].lower()
        if word and word not in _MONTHS:
            continue
        if "first" in parts and parts["mark"] == "-" and len(parts["year"]) == 2:
            continue  # 08-11-26 has a year at either end
        is_open = "first" in parts and parts["mark"] != "."
        return _Written(parts, is_open, "offset" in parts)
    return None


def _parse_dates(texts: Sequence[str], column_name: str) -> list[_Written | None]:
    """Return the parts of each date, None for a cell without one; refuse what is neither."""
    written: list[_Written | None] = []
    for row, text in enumerate(texts):
        if is_missing_word(text):
            written.append(None)
            continue
        date = _parse_date(text)
        if date is None:
            raise DateError(
                f"{column_name} must be a date such as 2026-11-08 09:30, got {shorten_value(text)}",
                row,
            )
        written.append(date)
    return written


def _refuse_partial_offsets(written: Sequence[_Written | None], column_name: str) -> None:
    """Refuse a column in which only some times have an offset from UTC."""
    local = None
    fixed = None
    for row, date in enumerate(written):
        if date is None:
            continue
        if date.has_offset:
            fixed = row
        else:
            local = row
    if local is not None and fixed is not None:
        raise DateError(
            f"{column_name} must have an offset from UTC in all its times, or in none", local
        )


def _find_possible_orders(
    written: Sequence[_Written | None], texts: Sequence[str], column_name: str
) -> list[DateOrder]:
    """Return the orders that all open dates of a column allow, day first before month first."""
    above_as_first: int | None = None
    above_as_second: int | None = None
    has_open = False
    for row, date in enumerate(written):
        if date is None or not date.is_open:
            continue
        has_open = True
        if int(date.parts["first"]) > 12:
            above_as_first = row
        if int(date.parts["second_part"]) > 12:
            above_as_second = row
    if not has_open:
        return [DateOrder.DAY_FIRST]
    if above_as_first is not None and above_as_second is not None:
        raise DateError(
            f"{column_name} must have one order of day and month, got "
            f"{texts[above_as_first]!r} and {texts[above_as_second]!r}",
            above_as_second,
        )
    if above_as_first is not None:
        return [DateOrder.DAY_FIRST]
    if above_as_second is not None:
        return [DateOrder.MONTH_FIRST]
    return [DateOrder.DAY_FIRST, DateOrder.MONTH_FIRST]


def _convert_dates_to_seconds(
    written: Sequence[_Written | None], order: DateOrder, texts: Sequence[str], column_name: str
) -> NDArray[np.float64]:
    """Return each date in seconds since the beginning of 1970; NaN where there is none."""
    seconds = np.full(len(written), np.nan)
    for row, date in enumerate(written):
        if date is None:
            continue
        try:
            seconds[row] = _convert_date_to_seconds(date, order)
        except ValueError as error:
            raise DateError(
                f"{column_name} must be a date of the calendar, got {texts[row]!r}: {error}", row
            ) from error
    return seconds


def _convert_date_to_seconds(date: _Written, order: DateOrder) -> float:
    """Return a date in seconds since the beginning of 1970."""
    parts = date.parts
    day = _NO_DATE
    if "year" in parts:
        day = _make_day(parts, order)
    hour = int(parts.get("hour", "0"))
    half = parts.get("half", "").replace(".", "").lower()
    if half:
        if not 1 <= hour <= 12:
            raise ValueError(f"hour {hour} must lie between 1 and 12 with {half}")
        hour = hour % 12 + 12 * (half == "pm")
    fraction = parts.get("fraction", "0")
    moment = datetime.datetime(
        *(day.year, day.month, day.day, hour),
        int(parts.get("minute", "0")),
        int(parts.get("second", "0")),
        tzinfo=datetime.UTC,
    )
    return moment.timestamp() + float(f"0.{fraction}") - _parse_utc_offset(parts.get("offset", ""))


def _make_day(date_parts: dict[str, str], order: DateOrder) -> datetime.date:
    """Return the day that a date names, its open parts in an order."""
    year = int(date_parts["year"])
    if len(date_parts["year"]) == 2:
        year += 2000
    if not _FIRST_YEAR <= year <= _LAST_YEAR:
        raise ValueError(f"year must lie between {_FIRST_YEAR} and {_LAST_YEAR}")
    if "word" in date_parts:
        month = _MONTHS.index(date_parts["word"][:3].lower()) + 1
        return datetime.date(year, month, int(date_parts["day"]))
    if "first" not in date_parts:
        return datetime.date(year, int(date_parts["month"]), int(date_parts["day"]))
    first, second = int(date_parts["first"]), int(date_parts["second_part"])
    if order is DateOrder.MONTH_FIRST and date_parts["mark"] != ".":
        return datetime.date(year, first, second)
    return datetime.date(year, second, first)


def _parse_utc_offset(text: str) -> float:
    """Return an offset from UTC [s]."""
    digits = text.lstrip("-+").replace(":", "")
    if not digits.isdigit():
        return 0.0
    hours, minutes = int(digits[:2]), int(digits[2:] or "0")
    sign = -1.0 if text.startswith("-") else 1.0
    return sign * (_HOUR * hours + 60.0 * minutes)


def _refuse_open_order(
    day_first: NDArray[np.float64],
    month_first: NDArray[np.float64],
    column_name: str,
    texts: Sequence[str],
) -> None:
    """Refuse dates that may be read in two orders, unless both put them equally far apart."""
    shift = day_first - month_first
    known = shift[np.isfinite(shift)]
    if np.all(known == known[0]):
        return
    row = int(np.flatnonzero(np.isfinite(shift))[0])
    raise DateError(
        f"{column_name} must tell day from month, {texts[row]!r} may be either; write it as "
        "2026-11-08, or with dots as 08.11.2026",
        row,
    )


def _describe_date_column(
    written: Sequence[_Written | None],
    seconds: NDArray[np.float64],
    orders: Sequence[DateOrder],
    texts: Sequence[str],
    column_name: str,
) -> tuple[str, ...]:
    """Say what was found out about a column of dates."""
    notes = []
    dates = [date for date in written if date is not None]
    if any(date.is_open for date in dates) and len(orders) == 1:
        notes.append(f"dates in {column_name!r} are {orders[0].value}")
    offsets = {date.parts["offset"] for date in dates if date.has_offset}
    if len(offsets) > 1:
        notes.append(f"times in {column_name!r} have several offsets and are compared in UTC")
    back = _find_row_running_back(seconds)
    if back is not None and not offsets:
        notes.append(
            f"times in {column_name!r} run back at row {back + 1} ({texts[back]}): where that is "
            "the end of summer time, what follows is an hour later than it reads; state offsets "
            "from UTC"
        )
    return tuple(notes)


def _find_row_running_back(seconds: NDArray[np.float64]) -> int | None:
    """Return the first row whose time lies before that of the row above it.

    It is None where most rows run back: such a table is not in the order of time.
    """
    known = np.flatnonzero(np.isfinite(seconds))
    steps = np.diff(seconds[known])
    back = np.flatnonzero(steps < 0.0)
    if not back.size or back.size > 0.1 * steps.size:
        return None
    return int(known[back[0] + 1])


def _find_written_order(date: _Written, order: DateOrder) -> DateOrder:
    """Return the order in which a date is written."""
    if "year" not in date.parts:
        return DateOrder.TIME_ALONE
    if date.is_open:
        return order
    if "first" in date.parts or "word" in date.parts:
        return DateOrder.DAY_FIRST
    return DateOrder.YEAR_FIRST
