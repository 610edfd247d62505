"""Tables at the border: a column's unit stands in its name, ``height_um`` or ``speed_mm_s``."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.atomic import replace_text
from stepblocks.errors import PipelineError
from stepblocks.quantities import parse_quantity
from stepblocks.text_file import plain_size

if TYPE_CHECKING:
    import pandas as pd

# For each dimension, the ending of a column's name and its unit
SUFFIXES: dict[str, dict[str, str]] = {
    "length": {"nm": "nm", "um": "um", "mm": "mm", "m": "m"},
    "force": {"n": "N", "mn": "mN"},
    "stiffness": {"n_m": "N/m", "n_mm": "N/mm"},
    "speed": {"mm_s": "mm/s", "m_s": "m/s"},
    "ratio": {"": "", "pct": "%"},
    "time": {"s": "s", "ms": "ms"},
}

_LARGEST_FILE = 2_000_000_000  # bytes


def read_table(path: Path) -> pd.DataFrame:
    """Read a CSV with a header."""
    import pandas as pd

    try:
        if plain_size(path) > _LARGEST_FILE:
            raise PipelineError(f"table must be smaller than {_LARGEST_FILE} bytes [{path}]")
        with path.open(encoding="utf-8-sig") as file:
            names = [name.strip() for name in file.readline().split(",")]
        frame = pd.read_csv(path, encoding="utf-8-sig", skipinitialspace=True)
    except OSError as error:
        raise PipelineError(f"table cannot be read: {error.strerror} [{path}]") from error
    except (ValueError, UnicodeDecodeError) as error:  # pandas' parser errors are ValueErrors
        raise PipelineError(f"table is not a CSV: {str(error).splitlines()[0]} [{path}]") from error
    if len(set(names)) != len(names):
        raise PipelineError(f"table must not name a column twice [{path}]")
    if frame.empty:
        raise PipelineError(f"table has no rows [{path}]")
    frame.columns = [str(name).strip() for name in frame.columns]
    return frame


def si_column(
    frame: pd.DataFrame, names: tuple[str, ...], dimension: str, default: float | None, place: Any
) -> NDArray[np.float64]:
    """Find a column by one of its names and any unit of its dimension, and return it in SI."""
    found = []
    for name in names:
        for suffix, unit in SUFFIXES[dimension].items():
            column = f"{name}_{suffix}" if suffix else name
            if column in frame.columns:
                found.append((column, unit))
    wanted = " or ".join(f"{names[0]}_{s}" if s else names[0] for s in SUFFIXES[dimension])
    if not found:
        if default is None:
            raise PipelineError(f"table must have a column {wanted} [{place}]")
        return np.full(len(frame), default)
    if len(found) > 1:
        both = " and ".join(column for column, _ in found)
        raise PipelineError(f"table must have one of the columns {both}, not both [{place}]")
    import pandas as pd

    column, unit = found[0]
    numbers = pd.to_numeric(frame[column], errors="coerce").to_numpy(dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(numbers))
    if bad.size:
        row = int(bad[0])
        given = frame[column].iloc[row]
        text = repr(given) if isinstance(given, str) else str(given)
        raise PipelineError(f"{column} must be a finite number, got {text} [{place}, row {row + 1}]")
    factor = parse_quantity(f"1 {unit}", dimension) if unit else 1.0
    # 25 / 1e6 is the double nearest to 25e-6; 25 * 1e-6 is not
    inverse = round(1.0 / factor)
    exact = factor < 1.0 and abs(factor * inverse - 1.0) < 1e-12
    return np.asarray(numbers / inverse if exact else numbers * factor)


def refuse_misspelt(frame: pd.DataFrame, known: Iterable[str], place: Any) -> None:
    """Refuse a column that is nearly one of the known: else its default would be taken without a word."""
    names = sorted(known)
    for column in map(str, frame.columns):
        near = [] if column in names else difflib.get_close_matches(column, names, 1, 0.8)
        if near:
            raise PipelineError(f"column {column!r} is not known, is it {near[0]!r}? [{place}]")


def harmless(cell: object) -> object:
    """Return a text that a spreadsheet would run as a formula with an apostrophe before it, which keeps it text.

    It is one that begins with ``=``, ``+``, ``-``, ``@``, a tab or a return (OWASP, CSV injection) and is no number.
    """
    if not isinstance(cell, str) or not cell.startswith(("=", "+", "-", "@", "\t", "\r")):
        return cell
    try:
        float(cell)
    except ValueError:
        return "'" + cell.replace("\r", "\n")  # a bare return would not be quoted
    return cell


def _harmless(frame: pd.DataFrame) -> pd.DataFrame:
    texts = [name for name in frame.columns if frame[name].dtype.kind not in "biufcM"]
    return frame.assign(**{str(name): frame[name].map(harmless) for name in texts}).rename(columns=harmless)


def csv_text(table: Any, columns: Sequence[str] | None = None, float_format: str | None = None) -> str:
    """Write a table, or rows as mappings, as the text of a CSV."""
    import pandas as pd

    frame = _harmless(pd.DataFrame(table, columns=columns))
    return str(frame.to_csv(index=False, lineterminator="\n", float_format=float_format))


def write_table(frame: pd.DataFrame, path: Path, float_format: str | None = None) -> None:
    """Write a CSV beside its place and rename it; by default 17 digits, so that reading it back gives the same doubles."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, csv_text(frame, None, float_format))
    except OSError as error:
        raise PipelineError(f"table cannot be written: {error.strerror} [{path}]") from error
