"""Tables at the border: a column's unit stands in its name, ``height_um`` or ``speed_mm_s``."""

import difflib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.text import measure_file_size
from stepblocks.mistakes import Mistake, format_mistakes, shorten_value
from stepblocks.quantities import multiply_by_unit, parse_quantity

if TYPE_CHECKING:
    import pandas as pd

Table: TypeAlias = "pd.DataFrame"  # by its name: pandas is loaded when a table is read

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


def read_table(path: Path, texts: Collection[str] = ()) -> "pd.DataFrame":
    """Read a CSV with a header; some of its columns may be texts, whatever they look like."""
    import pandas as pd

    try:
        PipelineError.require(
            measure_file_size(path) <= _LARGEST_FILE,
            f"table must be smaller than {_LARGEST_FILE} bytes [{path}]",
        )
        with path.open(encoding="utf-8-sig") as file:
            names = [name.strip() for name in file.readline().split(",")]
        frame = pd.read_csv(
            path, encoding="utf-8-sig", skipinitialspace=True, dtype=dict.fromkeys(texts, "str")
        )
    except OSError as error:
        raise PipelineError(f"table cannot be read: {error.strerror} [{path}]") from error
    except (ValueError, UnicodeDecodeError) as error:  # pandas' parser errors are ValueErrors
        raise PipelineError(
            f"table must be a CSV: {str(error).splitlines()[0]} [{path}]"
        ) from error
    PipelineError.require(
        len(set(names)) == len(names),
        f"table must not name a column twice [{path}]",
    )
    PipelineError.require(not frame.empty, f"table has no rows [{path}]")
    frame.columns = [str(name).strip() for name in frame.columns]
    return frame


def find_misspelt_columns(frame: "pd.DataFrame", known: Collection[str]) -> dict[str, str]:
    """Find columns that are nearly one of the known, and which."""
    near = {
        str(name): difflib.get_close_matches(str(name), known, 1, 0.8)
        for name in frame
        if name not in known
    }
    return {name: likely[0] for name, likely in near.items() if likely}


def read_si_columns(
    frame: "pd.DataFrame",
    wanted: Mapping[str, tuple[Sequence[str], str, float | None]],
    place: object,
) -> dict[str, NDArray[np.float64]]:
    """Find columns by any of their names and units, and return them in SI.

    All mistakes are listed at once.
    """
    # one without a default must be there; where one has a default, a column that is nearly one of
    # them is refused: else the default would be taken without a word
    found: dict[str, NDArray[np.float64]] = {}
    units = {
        key: {
            f"{name}_{suffix}".rstrip("_"): unit
            for name in names
            for suffix, unit in SUFFIXES[dimension].items()
        }
        for key, (names, dimension, _) in wanted.items()
    }
    known = sorted(column for columns in units.values() for column in columns)
    guessed = set(known) if any(default is not None for *_, default in wanted.values()) else set()
    near = find_misspelt_columns(frame, guessed)
    mistakes: list[Mistake] = [
        ("", f"column {column!r} is not known, is it {likely!r}?")
        for column, likely in near.items()
    ]
    meant = set(near.values())
    for key, (_, dimension, default) in wanted.items():
        here = [column for column in units[key] if column in frame.columns]
        if len(here) > 1:
            mistakes.append(
                ("", f"table must have one of the columns {' and '.join(here)}, not both")
            )
        elif here:
            found[key] = _convert_column(frame[here[0]], units[key][here[0]], dimension, mistakes)
        elif default is not None:
            found[key] = np.full(len(frame), default)
        elif not meant & set(units[key]):
            mistakes.append(
                (
                    "",
                    "table must have a column "
                    f"{' or '.join(list(units[key])[: len(SUFFIXES[dimension])])}",
                )
            )
    PipelineError.require(not mistakes, format_mistakes(mistakes, place))
    return found


def _convert_column(
    cells: "pd.Series", unit: str, dimension: str, mistakes: list[Mistake]
) -> NDArray[np.float64]:
    # Read a column; cells that are no finite number are among the mistakes
    import pandas as pd

    # a whole number of hundreds of digits is an object that only as a text becomes infinite
    texts = cells.astype(str) if cells.dtype == object else cells
    numbers = pd.to_numeric(texts, errors="coerce").to_numpy(dtype=np.float64)
    mistakes += [
        (f"row {row + 1}", f"{cells.name} must be a finite number, got {shorten_value(given)}")
        for row, given in cells.reset_index(drop=True)[~np.isfinite(numbers)].items()
    ]
    return np.asarray(
        multiply_by_unit(numbers, parse_quantity(f"1 {unit}", dimension) if unit else 1.0)
    )


def escape_formula(cell: object) -> object:
    """Put an apostrophe before a text that a spreadsheet would run as a formula."""
    # It is one that begins with ``=``, ``+``, ``-``, ``@``, a tab or a return (OWASP, CSV
    # injection) and is no number.
    if not isinstance(cell, str) or not cell.startswith(("=", "+", "-", "@", "\t", "\r")):
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

    frame = pd.DataFrame(table, columns=columns)
    texts = {
        str(name): frame[name] for name in frame.columns if frame[name].dtype.kind not in "biufcM"
    }
    frame = frame.assign(
        **{name: column.map(escape_formula) for name, column in texts.items()}
    ).rename(columns=escape_formula)
    return str(frame.to_csv(index=False, lineterminator="\n", float_format=float_format))


def write_table(frame: "pd.DataFrame", path: Path, float_format: str | None = None) -> None:
    """Write a CSV beside its place and rename it; 17 digits give the same doubles back."""
    replace_text(path, format_csv(frame, None, float_format))
