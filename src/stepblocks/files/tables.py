"""Tables at the border: a column's unit stands in its name, ``height_um`` or ``speed_mm_s``."""

import difflib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.paths import describe_system_error
from stepblocks.files.text import measure_file_size
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
}

_LARGEST_FILE = 2_000_000_000  # bytes
_SIMILAR_ENOUGH = 0.8  # of two names of columns, as difflib measures it
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # OWASP, CSV injection
_NUMBER_KINDS = "biufcM"  # NumPy's letters of types that are never a formula


class ColumnRule(NamedTuple):
    """How a column of a table is recognised and read."""

    names: Sequence[str]  # any of them, without the unit
    dimension: str  # one of `SUFFIXES`
    default: float | None  # in SI; a column without one must be there

    def list_columns(self) -> dict[str, str]:
        """Return the unit of every column that fits, by its full name."""
        columns = {}
        for name in self.names:
            for suffix, unit in SUFFIXES[self.dimension].items():
                columns[f"{name}_{suffix}".rstrip("_")] = unit
        return columns


def read_table(path: Path, texts: Collection[str] = ()) -> "pd.DataFrame":
    """Read a CSV with a header.

    Parameters
    ----------
    path : Path
        The file, UTF-8 with or without a byte order mark.
    texts : collection of str
        Columns that are texts, whatever they look like.

    Raises
    ------
    PipelineError
        If it cannot be read, is too large, is no CSV, names a column twice or has no rows.
    """
    import pandas as pd

    try:
        if measure_file_size(path) > _LARGEST_FILE:
            raise PipelineError(f"table must be smaller than {_LARGEST_FILE} bytes [{path}]")
        with path.open(encoding="utf-8-sig") as file:
            names = [name.strip() for name in file.readline().split(",")]
        frame = pd.read_csv(
            path, encoding="utf-8-sig", skipinitialspace=True, dtype=dict.fromkeys(texts, "str")
        )
    except OSError as error:
        reason = describe_system_error(error, path)
        raise PipelineError(f"table cannot be read: {reason} [{path}]") from error
    except (ValueError, UnicodeDecodeError) as error:  # pandas' parser errors are ValueErrors
        reason = str(error).splitlines()[0]
        raise PipelineError(f"table must be a CSV: {reason} [{path}]") from error
    if len(set(names)) != len(names):
        raise PipelineError(f"table must not name a column twice [{path}]")
    if frame.empty:
        raise PipelineError(f"table has no rows [{path}]")
    frame.columns = [str(name).strip() for name in frame.columns]
    return frame


def find_misspelt_columns(frame: "pd.DataFrame", known: Collection[str]) -> dict[str, str]:
    """Return the known name that was probably meant, by the name of each column that is near it."""
    meant = {}
    for column in frame:
        if column in known:
            continue
        name = str(column)
        similar = difflib.get_close_matches(name, known, 1, _SIMILAR_ENOUGH)
        if similar:
            meant[name] = similar[0]
    return meant


def read_si_columns(
    frame: "pd.DataFrame",
    wanted: Mapping[str, tuple[Sequence[str], str, float | None]],
    place: object,
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
        Where the table stands, for the message.

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
        units = rule.list_columns()
        present = [column for column in units if column in frame.columns]
        if len(present) > 1:
            names = " and ".join(present)
            mistakes.append(("", f"table must have one of the columns {names}, not both"))
        elif present:
            column = present[0]
            found[key] = _convert_column(frame[column], units[column], rule.dimension, mistakes)
        elif rule.default is not None:
            found[key] = np.full(len(frame), rule.default)
        elif meant.isdisjoint(units):
            usual = list(units)[: len(SUFFIXES[rule.dimension])]  # the first of its names
            mistakes.append(("", f"table must have a column {' or '.join(usual)}"))
    if mistakes:
        raise PipelineError(format_mistakes(mistakes, place))
    return found


def _find_misspelt_defaults(frame: "pd.DataFrame", rules: Sequence[ColumnRule]) -> dict[str, str]:
    """Return the misspelt columns of a table where some column may be left out.

    There a misspelt name is a mistake: the default would be taken without a word.
    """
    if all(rule.default is None for rule in rules):
        return {}
    known: set[str] = set()
    for rule in rules:
        known.update(rule.list_columns())
    return find_misspelt_columns(frame, known)


def _convert_column(
    cells: "pd.Series", unit: str, dimension: str, mistakes: list[Mistake]
) -> NDArray[np.float64]:
    """Return a column in SI; cells that are no finite number are added to the mistakes."""
    import pandas as pd

    # a whole number of hundreds of digits is an object that only as a text becomes infinite
    texts = cells.astype(str) if cells.dtype == object else cells
    numbers = pd.to_numeric(texts, errors="coerce").to_numpy(dtype=np.float64)
    wrong_cells = cells.reset_index(drop=True)[~np.isfinite(numbers)]
    for row, cell in wrong_cells.items():
        rule = f"{cells.name} must be a finite number, got {shorten_value(cell)}"
        mistakes.append((f"row {row + 1}", rule))
    factor = parse_quantity(f"1 {unit}", dimension) if unit else 1.0
    return np.asarray(multiply_by_unit(numbers, factor))


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
    import pandas as pd

    rows: Any = table
    frame = pd.DataFrame(rows, columns=None if columns is None else list(columns))
    escaped = {}
    for name in frame.columns:
        if frame[name].dtype.kind not in _NUMBER_KINDS:
            escaped[str(name)] = frame[name].map(escape_formula)
    frame = frame.assign(**escaped).rename(columns=escape_formula)
    return str(frame.to_csv(index=False, lineterminator="\n", float_format=float_format))


def write_table(frame: "pd.DataFrame", path: Path, float_format: str | None = None) -> None:
    """Write a CSV beside its place and rename it; 17 digits give the same doubles back."""
    replace_text(path, format_csv(frame, None, float_format))
