"""Traces as text, one file per trial."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from stepblocks.bench.sources.base import Array, Format, Names, Place, TextLayout, TraceError, as_samples


def _open(path: Path, layout: TextLayout) -> AbstractContextManager[Any]:
    import pandas as pd

    try:
        table = pd.read_csv(
            path,
            sep=layout.delimiter,
            decimal=layout.decimal,
            skiprows=layout.skip_lines,
            header=0 if layout.headed else None,
            skipinitialspace=True,
            float_precision="round_trip",
        )
    except (ValueError, UnicodeDecodeError, OSError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TraceError(f"unreadable: {path.name}: {reason[:120]}") from error
    table.columns = [c.strip() if isinstance(c, str) else c for c in table.columns]
    table.attrs["file"] = path.name
    return nullcontext(table)


def _columns(table: Any, place: Place, names: Names) -> dict[str | int, Array]:
    for name in names:
        if name not in table.columns:
            listed = ", ".join(str(column) for column in list(table.columns)[:8])
            raise TraceError(f"unknown channel: {table.attrs['file']} has no {name!r}, it has {listed}")
    return {name: as_samples(table[name].to_numpy(), name) for name in names}


FORMAT = Format((".csv", ".txt", ".tsv"), _open, _columns)
