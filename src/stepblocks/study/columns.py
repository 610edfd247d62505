"""Columns and cells that a design, its run sheets and its judgements have in common."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Row: TypeAlias = Mapping[str, str]  # of a table, by column

RATINGS = (1, 7)  # lowest and highest rating, where no others are named
WHEN = ("participant", "trial", "condition", "repetition")
COMPARED = ("second_is_higher",)  # answers that are yes or no
YES = ("y", "yes", "1")
NO = ("n", "no", "0")
ORDER = "order"  # number of the trial in tens, where it is a covariate of the mixed model
FACTOR = "factor_"  # begins the column of each declared factor
MICROMETRES = {"um": 1.0, "mm": 1e3, "m": 1e6}  # in each unit of a column


class PairOrder(StrEnum):
    """Condition of a comparison: which of the two blocks is given first."""

    STANDARD_FIRST = "standard-first"
    STANDARD_SECOND = "standard-second"

    @classmethod
    def list_names(cls) -> list[str]:
        """List the names of the orders."""
        return [order.value for order in cls]


def format_setting_name(row: Row) -> str:
    """Return the levels of a trial's declared factors, joined by slashes."""
    return "/".join(row[name] for name in list_factor_columns(row))


def list_factor_columns(names: Iterable[str]) -> list[str]:
    """List the columns of declared factors among some columns."""
    return [name for name in names if name.startswith(FACTOR)]


def collect_levels_of_trial(row: Row) -> set[str]:
    """Return the condition of a trial and all levels of its factors."""
    condition = row["condition"]
    return {condition, *condition.split("/"), *format_setting_name(row).split("/")}


def group_rows_by_participant(rows: Iterable[dict[str, str]]) -> dict[str, list[dict[str, str]]]:
    """Sort rows by their participants."""
    by_participant: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        by_participant.setdefault(row["participant"], []).append(row)
    return by_participant


def read_number_or_nan(text: str) -> float:
    """Read a finite number; NaN for any other text."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    if "_" in text or not math.isfinite(value):  # Python reads 1_000
        return math.nan
    return value


@dataclass(frozen=True)
class NamedColumns:
    """What the columns of the tables of others are called.

    Attributes
    ----------
    named : mapping of str
        Their names for ours; those that are not named are called as ours. Lengths may be in um, mm
        or m: ``height_mm=h`` reads the column ``h`` in millimetres.
    """

    named: Mapping[str, str]

    def find_stated_name(self, our_column: str) -> str:
        """Return the name that the table has for one of our columns; empty where none is stated.

        A length may stand in any unit.
        """
        stem = our_column.removesuffix("_um")
        for name in (our_column, f"{stem}_mm", f"{stem}_m"):
            if name in self.named:
                return self.named[name]
        return ""

    def get_table_name(self, our_column: str) -> str:
        """Return what one of our columns is called in their tables."""
        return self.find_stated_name(our_column) or our_column

    def read_cell(self, row: Row, our_column: str) -> str | None:
        """Return the cell of one of our columns, lengths in micrometres; None without one.

        What is no number stays as it is.
        """
        if not our_column.endswith("_um"):
            return row.get(self.get_table_name(our_column))
        stem = our_column.removesuffix("_um")
        for unit in self._list_possible_units(stem):
            text = row.get(self.get_table_name(f"{stem}_{unit}"))
            if text is None:
                continue
            number = read_number_or_nan(text)
            if unit == "um" or math.isnan(number):
                return text
            return f"{number * MICROMETRES[unit]:.12g}"
        return None

    def _list_possible_units(self, stem: str) -> list[str]:
        """List the units in which a length may stand: those that are named, else all."""
        named = [unit for unit in MICROMETRES if f"{stem}_{unit}" in self.named]
        return named or list(MICROMETRES)
