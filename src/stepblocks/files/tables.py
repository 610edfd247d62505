"""Tables at the border: a column's unit stands in its name, ``height_um`` or ``speed_mm_s``."""

import csv
import difflib
import io
import itertools
import math
import re
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import PipelineError, ReadingWarning
from stepblocks.files.atomic import replace_text
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.missing import is_missing_word
from stepblocks.files.numbers import NumberNotation
from stepblocks.files.text_table import TextTable, read_text_table
from stepblocks.mistakes import Mistake, format_mistakes, shorten_value
from stepblocks.quantities import multiply_by_unit, parse_quantity

if TYPE_CHECKING:
    import pandas as pd

Table: TypeAlias = "pd.DataFrame"  # by its name: pandas is loaded when a table is read

# for each dimension, the ending of a column's name and its unit
SUFFIXES: dict[str, dict[str, str]] = {
    "length": {"nm": "nm", "um": "um", "mm": "mm", "m": "m"},
    "force": {"n": "N", "mn": "mN"},
    "stiffness": {"n_m": "N/m", "n_mm": "N/mm"},
    "speed": {"mm_s": "mm/s", "m_s": "m/s"},
    "ratio": {"": "", "pct": "%"},
    "time": {"s": "s", "ms": "ms"},
    "energy": {"uj": "uJ", "nj": "nJ", "j": "J"},
}

_LARGEST_WHOLE = 2.0**53  # up to which every whole number is a float
_SIMILAR_ENOUGH = 0.8  # of two names of columns, as difflib measures it
_MISSING_OBJECTS = ("NAType", "NaTType", "MaskedConstant")  # of pandas and NumPy
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # OWASP, CSV injection
_NO_NUMBER_KINDS = ("b", "c", "m", "M")  # those of truth values, complex numbers, times and dates
_NUMBER_KINDS = "biufcM"  # NumPy's letters of types that are never a formula


class ColumnRule(NamedTuple):
    """How a column of a table is recognised and read."""

    names: Sequence[str]  # any of them, without the unit
    dimension: str  # one of `SUFFIXES`
    default: float | None  # in SI; a column without one must be there

    def list_units_by_column(self) -> dict[str, str]:
        """Return the unit of every column that fits, by its full name."""
        columns = {}
        for name in self.names:
            for suffix, unit in SUFFIXES[self.dimension].items():
                columns[f"{name}_{suffix}".rstrip("_")] = unit
        return columns


@dataclass(frozen=True, eq=False)
class FileTable:
    """A table of a file: its columns as numbers and texts, and where each row stands.

    Attributes
    ----------
    frame : DataFrame
        Columns of numbers are floats or whole numbers with NaN for what is missing; of texts, an
        empty cell is missing and nothing else.
    source : TextTable
        What the file writes, with the places of its rows.
    notes : tuple of str
        What had to be found out: encoding, separators, decimal signs, units, fill values.
    """

    frame: "pd.DataFrame"
    source: TextTable
    notes: tuple[str, ...] = ()


def read_table(
    path: Path, text_columns: Collection[str] = (), layout: TableLayout = UNDECLARED
) -> "pd.DataFrame":
    """Read a table with a header; what had to be found out about it is a `ReadingWarning`.

    See `load_table`.
    """
    table = load_table(path, text_columns, layout)
    warn_of_notes(table.notes, path)
    return table.frame


def warn_of_notes(notes: Iterable[str], place: object) -> None:
    """Say what had to be found out about a file, as one warning for each note."""
    for note in notes:
        warnings.warn(ReadingWarning(note, place), stacklevel=3)


def load_table(
    path: Path, text_columns: Collection[str] = (), layout: TableLayout = UNDECLARED
) -> FileTable:
    """Read a table with a header.

    Parameters
    ----------
    path : Path
        CSV, TSV or a workbook of Excel or LibreOffice; see `read_text_table`.
    text_columns : collection of str
        Columns that are texts, whatever they look like.
    layout : TableLayout
        What is declared of it.

    Raises
    ------
    PipelineError
        If it cannot be read, is too large, names a column twice, has no rows, or a row has another
        number of cells than the header.
    """
    import pandas as pd

    source = read_text_table(path, layout)
    if not source.rows:
        raise PipelineError(f"table has no rows [{path}]")
    notes = list(source.notes)
    columns = {}
    for number, name in enumerate(source.names):
        if name in text_columns or not source.holds_numbers(number):
            columns[name] = _make_text_column(source.get_cells(number))
            continue
        numbers = source.require_numbers(number, PipelineError)
        notes += filter(None, [numbers.describe_missing_values(name)])
        columns[name] = _make_number_column(numbers.values)
    frame = pd.DataFrame(columns)
    return FileTable(_append_units_to_names(frame, source), source, tuple(notes))


def _make_text_column(cells: list[str]) -> "pd.Series":
    """Return cells as a column of texts, empty ones missing."""
    import pandas as pd

    column = pd.Series(cells, dtype="str")
    return column.mask(column == "")


def _make_number_column(values: NDArray[np.float64]) -> "pd.Series":
    """Return numbers as whole ones where all are, as pandas reads them."""
    import pandas as pd

    is_bounded = bool((np.abs(values) < _LARGEST_WHOLE).all())  # which NaN is not
    if is_bounded and bool((values % 1.0 == 0.0).all()):
        return pd.Series(values.astype(np.int64))
    return pd.Series(values)


def _append_units_to_names(frame: "pd.DataFrame", source: TextTable) -> "pd.DataFrame":
    """Put the units of a row of units behind the names of their columns: ``load [N]``.

    A name that states its unit must agree with the row.
    """
    if not source.units:
        return frame
    renamed = {}
    for name, unit in zip(source.names, source.units, strict=True):
        stated = parse_unit_of_name(name)
        if unit in ("", "-", "1") or simplify_unit(unit) == stated:
            continue
        if stated:
            raise PipelineError(
                f"column {name!r} must have one unit, got {unit!r} in its row of units "
                f"[{source.file}]"
            )
        renamed[name] = f"{name} [{unit}]"
    return frame.rename(columns=renamed)


def convert_dataset_to_table(dataset: Any) -> "pd.DataFrame":
    """Turn a Dataset of xarray into a table, its coordinates among the columns.

    The unit that a variable states in its attribute ``units`` must agree with that of its name; a
    name without a unit takes it.

    Raises
    ------
    PipelineError
        If they differ.
    """
    frame = dataset.to_dataframe()
    named = [dimension for dimension in dataset.dims if dimension in dataset.coords]
    if named:
        frame = frame.reset_index(named)
    renamed = {}
    for name, variable in dataset.variables.items():
        unit = variable.attrs.get("units")
        stated = parse_unit_of_name(str(name))
        if unit is None or simplify_unit(str(unit)) == stated:
            continue
        if stated:
            raise PipelineError(
                f"{name} must have one unit, got {unit!r} in its attribute units [table]"
            )
        renamed[name] = f"{name} [{unit}]"
    renamed_frame: pd.DataFrame = frame.rename(columns=renamed)
    return renamed_frame


def find_misspelt_columns(frame: "pd.DataFrame", known_names: Collection[str]) -> dict[str, str]:
    """Return the known name that was probably meant, by the name of each column that is near it."""
    meant = {}
    for column in frame:
        if column in known_names:
            continue
        name = str(column)
        similar = difflib.get_close_matches(name, known_names, 1, _SIMILAR_ENOUGH)
        if similar:
            meant[name] = similar[0]
    return meant


# a name with its unit in brackets, as "Load [mN]" or "step height (µm)"
_BRACKETED = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]")


def simplify_unit(unit: str) -> str:
    """Return a unit as this program writes it, with the letter u for micro."""
    return unit.strip("[]() ").replace("µ", "u").replace("μ", "u").replace(" ", "")


def parse_unit_of_name(name: str) -> str:
    """Return the unit that a column's name states by its suffix or in brackets; empty without."""
    bracketed = _BRACKETED.fullmatch(name)
    if bracketed:
        return simplify_unit(bracketed["unit"])
    for units in SUFFIXES.values():
        for suffix in sorted(units, key=len, reverse=True):
            if suffix and name.lower().endswith(f"_{suffix}"):
                return units[suffix]
    return ""


def find_column_name(name: str, known_columns: Mapping[str, str]) -> str:
    """Return the known column that a name means: ``height_um`` for "Height [µm]".

    Parameters
    ----------
    name : str
        As a table has it.
    known_columns : mapping of str
        Unit of each known column by its full name.

    Returns
    -------
    str
        The known name; empty where it means none of them.
    """
    if name in known_columns:
        return name
    bracketed = _BRACKETED.fullmatch(name)
    words = name if bracketed is None else bracketed["name"]
    base = re.sub(r"[\s-]+", "_", words.strip()).lower()
    if bracketed is None:
        return base if base in known_columns else ""
    for suffix in _list_suffixes_of_unit(simplify_unit(bracketed["unit"])):
        column = f"{base}_{suffix}".rstrip("_")
        if column in known_columns:
            return column
    return ""


def _list_suffixes_of_unit(unit: str) -> list[str]:
    """Return the endings of names that say a unit; none at all says a ratio."""
    if unit in ("-", "1"):
        unit = ""
    suffixes = []
    for units in SUFFIXES.values():
        suffixes += [suffix for suffix in units if units[suffix] == unit]
    return suffixes


def read_si_columns(
    frame: "pd.DataFrame",
    wanted: Mapping[str, tuple[Sequence[str], str, float | None]],
    place: object,
    *,
    allow_missing: bool = False,
) -> dict[str, NDArray[np.float64]]:
    """Find columns by any of their names and units, and return them in SI.

    Parameters
    ----------
    frame : DataFrame
        The table; columns that are not wanted are the user's own.
    wanted : mapping
        By key: possible names without the unit, dimension, and the default in SI, or None where the
        column must be there (see `ColumnRule`).
    place : object
        Where the table stands, for the message; a `TextTable` says the line or the cell.
    allow_missing : bool
        Whether a number that is missing stays NaN, for a caller who says of each row what is wrong
        with it; an infinite number, or a text that is none, is refused all the same.

    Returns
    -------
    dict
        An array of shape (rows,) for each key that was found or has a default.

    Raises
    ------
    PipelineError
        With all mistakes at once.
    """
    rules = {key: ColumnRule(*rule) for key, rule in wanted.items()}
    misspelt = _find_misspelt_defaults(frame, list(rules.values()))
    meant = set(misspelt.values())
    mistakes: list[Mistake] = []
    for column, likely in misspelt.items():
        mistakes.append(("", f"column {column!r} is not known, is it {likely!r}?"))
    found: dict[str, NDArray[np.float64]] = {}
    for key, rule in rules.items():
        units = rule.list_units_by_column()
        present = _map_columns_to_known(frame, units)
        if len(present) > 1:
            names = " and ".join(present)
            mistakes.append(("", f"table must have one of the columns {names}, not both"))
        elif present:
            ((column, meaning),) = present.items()
            reading = _ColumnReading(
                units[meaning],
                rule.dimension,
                list(frame.columns).index(column),
                place if isinstance(place, TextTable) else None,
            )
            found[key] = _convert_column_to_si(frame[column], reading, mistakes, allow_missing)
        elif rule.default is not None:
            found[key] = np.full(len(frame), rule.default)
        elif meant.isdisjoint(units):
            usual = list(units)[: len(SUFFIXES[rule.dimension])]  # the first of its names
            mistakes.append(("", f"table must have a column {' or '.join(usual)}"))
    if mistakes:
        file = place.place if isinstance(place, TextTable) else place
        raise PipelineError(format_mistakes(mistakes, file))
    return found


@dataclass(frozen=True)
class _ColumnReading:
    """How a column is read: its unit and dimension, and the file that it comes from."""

    unit: str
    dimension: str
    column: int
    source: TextTable | None

    @property
    def notation(self) -> NumberNotation:
        """Of the texts in the column."""
        return NumberNotation() if self.source is None else self.source.notation

    def name_row(self, row: int) -> str:
        """Say where a cell stands, its row counted from 0."""
        if self.source is None:
            return f"row {row + 1}"
        return self.source.name_place_of_row(row, self.column)

    def format_wrong_cell(self, row: int, value: object) -> str:
        """Write a cell that is not a finite number as its file does, for a message."""
        if isinstance(value, np.generic):
            value = value.item()
        if self.source is None or not isinstance(value, float):
            return shorten_value(value)
        written = self.source.rows[row][self.column]
        if is_missing_word(written):
            return written or "an empty cell"
        if math.isnan(value):
            return f"{written}, which stands for a missing value"
        return shorten_value(written).strip("'")


def _map_columns_to_known(frame: "pd.DataFrame", units: Mapping[str, str]) -> dict[str, str]:
    """Map the columns of a table to the known names that they mean; others are left out."""
    present = {}
    for column in frame.columns:
        meaning = find_column_name(str(column), units)
        if meaning:
            present[column] = meaning
    return present


def _find_misspelt_defaults(frame: "pd.DataFrame", rules: Sequence[ColumnRule]) -> dict[str, str]:
    """Return the misspelt columns of a table where some column may be left out.

    There a misspelt name is a mistake: the default would be taken without a word.
    """
    if all(rule.default is None for rule in rules):
        return {}
    known: dict[str, str] = {}
    for rule in rules:
        known |= rule.list_units_by_column()
    misspelt = find_misspelt_columns(frame, known)
    for column in list(misspelt):
        if find_column_name(column, known):  # as "height [um]", which is another way to write it
            del misspelt[column]
    return misspelt


def _convert_column_to_si(
    cells: "pd.Series", reading: _ColumnReading, mistakes: list[Mistake], allow_missing: bool
) -> NDArray[np.float64]:
    """Return a column in SI; cells that are no finite number are added to the mistakes."""
    if getattr(cells.dtype, "kind", None) in _NO_NUMBER_KINDS:
        mistakes.append(("", f"{cells.name} must hold numbers, got {cells.dtype}"))
        return np.full(len(cells), np.nan)
    numbers = _convert_cells_to_numbers(cells, reading.notation)
    is_wrong = ~np.isfinite(numbers)
    if allow_missing:
        is_wrong &= np.isinf(numbers) | _find_word_cells(cells)
    for row in np.flatnonzero(is_wrong).tolist():
        got = reading.format_wrong_cell(row, cells.iloc[row])
        rule = f"{cells.name} must be a finite number, got {got}"
        mistakes.append((reading.name_row(row), rule))
    factor = 1.0
    if reading.unit:
        factor = parse_quantity(f"1 {reading.unit}", reading.dimension)
    return np.asarray(multiply_by_unit(numbers, factor))


def _holds_objects(cells: "pd.Series") -> bool:
    """Tell whether a column holds texts or other objects in place of numbers."""
    import pandas as pd

    if pd.api.types.is_object_dtype(cells.dtype):
        return True
    return bool(pd.api.types.is_string_dtype(cells))


def _find_word_cells(cells: "pd.Series") -> NDArray[np.bool_]:
    """Return a mask of the cells that are neither a number nor missing, shape (rows,)."""
    if not _holds_objects(cells):
        return np.zeros(len(cells), dtype=bool)
    return np.array([_is_word_cell(cell) for cell in cells], dtype=bool)


def _is_word_cell(cell: object) -> bool:
    """Tell whether a cell that is no number stands for something else than a missing one."""
    if isinstance(cell, str):
        return not is_missing_word(cell)
    if isinstance(cell, float | np.floating):
        return not math.isnan(cell)
    return cell is not None and type(cell).__name__ not in _MISSING_OBJECTS


def _convert_cells_to_numbers(cells: "pd.Series", notation: NumberNotation) -> NDArray[np.float64]:
    """Return the numbers of a column, NaN for what is none."""
    import pandas as pd

    if not _holds_objects(cells):
        numbers = pd.to_numeric(cells, errors="coerce")
        return np.asarray(numbers.to_numpy(dtype=np.float64, na_value=np.nan))
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        try:
            values[row] = notation.parse_number(str(cell))
        except ValueError:
            continue
    return values


def escape_formula(cell: object) -> object:
    """Put an apostrophe before a text that a spreadsheet would run as a formula.

    It is one that begins with ``=``, ``+``, ``-``, ``@``, a tab or a return (OWASP, CSV injection)
    and is no number.
    """
    if not isinstance(cell, str) or not cell.startswith(_FORMULA_STARTS):
        return cell
    try:
        float(cell)
    except ValueError:
        return "'" + cell.replace("\r", "\n")  # a bare return would not be quoted
    return cell


def format_csv(
    table: object, columns: Sequence[str] | None = None, float_format: str | None = None
) -> str:
    """Write a table, or rows as mappings, as the text of a CSV."""
    if columns is None and _are_rows_of_text(table):
        return _format_rows_of_text(table)
    import pandas as pd

    rows: Any = table
    names = None
    if columns is not None:
        names = list(columns)
    frame = pd.DataFrame(rows, columns=names)
    escaped = {}
    for name in frame.columns:
        if frame[name].dtype.kind not in _NUMBER_KINDS:
            escaped[str(name)] = frame[name].map(escape_formula)
    frame = frame.assign(**escaped).rename(columns=escape_formula)
    return str(frame.to_csv(index=False, lineterminator="\n", float_format=float_format))


def _are_rows_of_text(table: object) -> TypeGuard[list[Mapping[str, str]]]:
    """Tell whether a table is a sequence of mappings that hold only text."""
    if not isinstance(table, list) or not table:
        return False
    for row in table:
        if not isinstance(row, Mapping):
            return False
        if not all(isinstance(cell, str) for cell in row.values()):
            return False
    return True


def _format_rows_of_text(rows: Sequence[Mapping[str, str]]) -> str:
    """Write rows of text as a CSV; pandas, which would do the same, takes long to load."""
    names = list(dict.fromkeys(itertools.chain.from_iterable(rows)))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(escape_formula, names))
    for row in rows:
        writer.writerow([escape_formula(row.get(name, "")) for name in names])
    return text.getvalue()


def write_table(frame: "pd.DataFrame", path: Path, float_format: str | None = None) -> None:
    """Write a CSV beside its place and rename it; 17 digits give the same doubles back."""
    replace_text(path, format_csv(frame, None, float_format))
