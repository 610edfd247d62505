"""Traces as text, one file per trial."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

from stepblocks.bench.session import Acquisition, Place
from stepblocks.bench.signal import TraceError, listed


def open_text(path: Path, layout: Acquisition) -> nullcontext[Any]:
    """Read the whole file; columns without names are counted from 0."""
    import pandas as pd

    try:
        table = pd.read_csv(
            path,
            sep=layout.delimiter,
            decimal=layout.decimal,
            skiprows=layout.skip_lines,
            header=0 if layout.channels.named else None,
            skipinitialspace=True,
            float_precision="round_trip",
        )
    except (ValueError, UnicodeDecodeError, OSError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TraceError(f"unreadable: {path.name}: {reason[:120]}") from error
    table.columns = [c.strip() if isinstance(c, str) else c for c in table.columns]
    table.attrs["file"] = path.name
    return nullcontext(table)


def text_columns(table: Any, place: Place, names: tuple[str | int, ...]) -> dict[str | int, Any]:
    """Columns of the one trial that the file holds."""
    for name in names:
        if name not in table.columns:
            raise TraceError(
                f"unknown channel: {table.attrs['file']} has no {name!r}, it has {listed(map(str, table.columns))}"
            )
    return {name: table[name].to_numpy() for name in names}
